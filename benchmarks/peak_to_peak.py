"""Bias and scatter of three estimates on signals of known transmissibility: `python benchmarks/peak_to_peak.py`.

10 s at 1 kHz, 2 % noise on both channels, 20 % second harmonic on the output: sine fit, peak to peak of the whole, mean
peak to peak of single periods; phase by sine fit and by cross-spectrum, Eqs. 2.2 and 2.3.
"""

import numpy as np

from fasbody.filters import peak_to_peak
from fasbody.response import fit_harmonics
from fasbody.spectra import cross_spectrum

RATE_HZ, SECONDS, TRUE = 1000.0, 10.0, 1.3 * np.exp(-0.7j)


def signals(f: float, noise: float, second: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Time, base and malleolus with amplitude 8.95 m/s^2 of the base."""
    t = np.arange(round(RATE_HZ * SECONDS)) / RATE_HZ
    turn = np.exp(2j * np.pi * f * t + 1j * rng.uniform(0, 2 * np.pi))
    base, out = 8.95 * turn.real, 8.95 * (TRUE * turn + abs(TRUE) * second * np.exp(1j) * turn**2).real
    return t, *(v + noise * 8.95 * rng.normal(size=t.size) for v in (base, out))


def errors(f: float, noise: float, second: float, trials: int = 40) -> np.ndarray:
    """(trials, 5) errors: sine fit, peak to peak, per period [%]; phase by sine fit, by cross-spectrum [degrees]."""
    rng = np.random.default_rng(round(f))
    rows = []
    for _ in range(trials):
        t, base, out = signals(f, noise, second, rng)
        H = fit_harmonics(t, out, f, 1).amplitudes[0] / fit_harmonics(t, base, f, 1).amplitudes[0]
        whole = peak_to_peak(out, base, RATE_HZ)
        single = peak_to_peak(out, base, RATE_HZ, frequency_hz=f)
        Z = cross_spectrum(base, out, RATE_HZ, f)
        rows.append(
            [100 * (v / abs(TRUE) - 1) for v in (abs(H), whole, single)]
            + [np.degrees(np.angle(v / TRUE)) for v in (H, Z)]
        )
    return np.array(rows)


def main() -> None:
    """Print bias and scatter of each estimate."""
    print("mean error ± standard deviation; |T| in %, phase in degrees")
    print("  f [Hz] noise second |  sine fit |T|    peak to peak    per period |  sine fit phase   cross-spectrum")
    for second in (0.0, 0.2):
        for f in (10.0, 20.0, 35.0, 50.0):
            e = errors(f, 0.02, second)
            cells = [f"{m:+7.3f} ± {s:5.3f}" for m, s in zip(e.mean(axis=0), e.std(axis=0), strict=True)]
            print(f"{f:8g}   2 % {100 * second:4g} % | {'  '.join(cells[:3])} | {'  '.join(cells[3:])}")


if __name__ == "__main__":
    main()
