"""Error of three estimates on signals of known transmissibility and phase: `python -m benchmarks.peak_to_peak`.

10 s at 1 kHz, 2 % noise on both channels, 20 % second harmonic on the output: sine fit, peak to peak of the whole, mean
peak to peak of single periods; phase by sine fit and by cross-spectrum, Eqs. 2.2 and 2.3.
"""

from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from benchmarks.table import report
from fasbody.console import command_line, console, results
from fasbody.recording.harmonics import fit_harmonics
from fasbody.transmissibility.spectra import cross_spectrum, peak_to_peak
from reproduction.check import Check, at_most, told

RATE_HZ, SECONDS, TRUE = 1000.0, 10.0, 1.3 * np.exp(-0.7j)
FREQUENCIES_HZ = (10.0, 20.0, 35.0, 50.0)
NOISE, SECOND = 0.02, 0.2
_NAMES = ("sine fit", "peak to peak", "per period")


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


def measure(seeds: int = 100) -> list[Check]:
    """The sine fit's systematic error and scatter, and peak to peak beside it, worst of the frequencies."""
    rows = []
    every = {f: errors(f, NOISE, SECOND, seeds) for f in FREQUENCIES_HZ}
    mean = {f: e.mean(axis=0) for f, e in every.items()}
    std = {f: e.std(axis=0, ddof=1) for f, e in every.items()}
    signal = f"2 % noise, 20 % second harmonic, {seeds} recordings"
    for what, column, unit in (("transmissibility", 0, "%"), ("phase", 3, "degrees")):
        worst = max(mean, key=lambda f: abs(mean[f][column]))
        text = f"sine fit, {signal}: mean error of {what} (worst, {worst:g} Hz)"
        rows.append(at_most(text, float(abs(mean[worst][column])), 0.1, unit))
        worst = max(std, key=lambda f: std[f][column])
        text = f"the same: standard deviation of one recording's {what} (worst, {worst:g} Hz)"
        rows.append(at_most(text, float(std[worst][column]), 0.1, unit))
    inside = np.mean([(abs(e[:, 0]) < 0.1) & (abs(e[:, 3]) < 0.1) for e in every.values()])
    rows.append(told("the same: recordings within 0.1 % and 0.1 degrees", f"{100 * inside:.1f} %"))
    worst = max(mean, key=lambda f: abs(mean[f][1]))
    what = f"peak to peak on the same recordings: mean error (worst, {worst:g} Hz)"
    rows.append(told(what, f"{mean[worst][1]:+.2f} %"))
    return rows


def table(seeds: int) -> Table:
    """Every estimate at each frequency: mean error ± standard deviation of one recording."""
    printed = Table(
        title=f"2 % noise, {seeds} recordings: mean error ± standard deviation of one", title_justify="left"
    )
    for name in (
        "f [Hz]",
        "2nd harmonic",
        *(f"{n} [%]" for n in _NAMES),
        "phase, sine fit [deg]",
        "cross-spectrum [deg]",
    ):
        printed.add_column(escape(name), justify="right")
    for second in (0.0, SECOND):
        for f in FREQUENCIES_HZ:
            e = errors(f, NOISE, second, seeds)
            cells = [f"{m:+.3f} ± {s:.3f}" for m, s in zip(e.mean(axis=0), e.std(axis=0, ddof=1), strict=True)]
            printed.add_row(f"{f:g}", f"{100 * second:g} %", *cells)
    return printed


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(min=2, help="recordings at each frequency")] = 100,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Sine fit and peak to peak on signals whose answer is known.

    Examples:
      python -m benchmarks.peak_to_peak --seeds 100
    """
    with console.status("fitting"):
        rows = measure(seeds)
        every = None if json_ else table(seeds)
    if every is not None:
        results.print(every)
    report("Estimates of transmissibility", rows, json_)


if __name__ == "__main__":
    command_line(app)
