"""What a recording of one sine can tell: run `python examples/single_sine.py`.

A linear two-mass foot shaken at 20 Hz is identified with models of every structure and many orders. All simulate the
held-out half equally well and agree at 20 Hz; elsewhere they are wrong without bound, and the tool says so. Nine
recordings pooled give the whole response.
"""

from __future__ import annotations

import linear_foot as foot
import numpy as np

from identification.blackbox import excitation, frequency, pem, subspace
from identification.blackbox.candidate import judge
from identification.blackbox.data import Series
from identification.blackbox.keep import Single
from identification.blackbox.polynomial import Orders

NOISE = 0.25  # m/s^2
SAMPLES = 10_000
BAND = np.arange(10.0, 50.1, 1.0)  # Hz
MODELS = (
    ("arx", (4, 4, 1)), ("arx", (9, 6, 2)), ("arx", (12, 10, 9)), ("armax", (4, 4, 4, 1)), ("armax", (9, 6, 3, 2)),
    ("oe", (2, 2, 1)), ("oe", (4, 4, 1)), ("oe", (6, 3, 2)), ("oe", (10, 3, 9)), ("bj", (4, 2, 2, 4, 1)),
    ("bj", (6, 3, 3, 3, 2)), ("ss", (4,)), ("ss", (5,)),
)  # fmt: skip


def recording(frequency_hz: float, seed: int = 0) -> Series:
    """Ten seconds of one sine with noise on the output."""
    rng = np.random.default_rng([seed, round(10 * frequency_hz)])
    base = foot.sine(frequency_hz, SAMPLES)
    noise = NOISE * rng.standard_normal(SAMPLES)
    return Series(base, foot.linear_output(base) + noise, foot.SAMPLE_TIME, f"{frequency_hz:g} Hz")


def worst_error(model: frequency.Rational | Single, at: np.ndarray) -> float:
    """Largest relative error of the response in percent."""
    return float(100 * np.max(np.abs(model.response(at).value / foot.response(at) - 1)))


def single(seed: int = 0) -> list[tuple[str, float, float, float, str]]:
    """Rows (model, held-out fit %, error at 20 Hz %, largest error 10 to 50 Hz %, warning) from one 20 Hz recording."""
    estimation, validation = recording(20.0, seed).split()
    seen = excitation.examine(estimation)
    rows = []
    for structure, orders in MODELS:
        if structure == "ss":
            model: Single = subspace.estimate(estimation, orders[0])
        else:
            model = pem.estimate(structure, estimation, Orders.of(structure, orders))
        fit = judge(model, [validation]).fit_percent
        warnings = [seen.warning(len(model.poles()) + len(model.zeros()) + 1), *model.warnings]
        errors = worst_error(model, np.array([20.0])), worst_error(model, BAND)
        rows.append((model.label, fit, *errors, "; ".join(filter(None, warnings))))
    return rows


def pooled(seed: int = 0) -> list[tuple[str, float]]:
    """Rows (method, largest error 10 to 50 Hz %) from nine recordings, 10 to 50 Hz."""
    recordings = [recording(f, seed).centred() for f in np.arange(10.0, 51.0, 5.0)]
    model = pem.estimate("oe", recordings, Orders.of("oe", (4, 4, 1)))
    points = frequency.points(recordings)
    fitted = frequency.rational(points, zeros=2, poles=4)
    print(excitation.examine(recordings))
    print(frequency.leave_one_out(points))
    return [("OE (4, 4, 1) pooled", worst_error(model, BAND)), ("sine fits + 2/4 rational", worst_error(fitted, BAND))]


def main() -> None:
    """Print both tables."""
    print(excitation.examine(recording(20.0)))
    print(f"{'model':22} {'fit %':>7} {'20 Hz error %':>14} {'10-50 Hz error %':>17}  warning")
    for label, fit, here, everywhere, warning in single():
        print(f"{label:22} {fit:7.2f} {here:14.3f} {everywhere:17.1f}  {warning}")
    print()
    for label, everywhere in pooled():
        print(f"{label:22} largest error 10-50 Hz {everywhere:.2f} %")


if __name__ == "__main__":
    main()
