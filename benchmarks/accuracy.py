"""How exactly MuJoCo and the twin solve Eq. (4.29) for a recorded base motion, against DOP853 at a tolerance of 1e-10.

The reference is driven by the sine itself. MuJoCo gets what a user has: the samples of that sine at 1 kHz, so the error
of the spline between samples is part of what is measured. The observed order is taken with the sine itself as input,
because the error of the spline would hide it at small steps.
"""

from dataclasses import dataclass

import numpy as np
import typer
from scipy.integrate import solve_ivp

from benchmarks.table import JsonOption, report
from fasbody.console import command_line, progress_bar
from fasbody.foot import shaker
from fasbody.foot.model import Foot, load
from fasbody.foot.simulate import simulate
from fasbody.foot.stepper import trajectory
from fasbody.foot.two_dof import TwoDof
from reproduction.check import Check, at_least, at_most, told

RATE_HZ = 1000
STEPS = (1e-3, 5e-4, 2.5e-4)
FREQUENCIES_HZ = (10.0, 30.0, 50.0)
SECONDS = 0.5
_LAW = {"c_12": 90.0, "c_13": 140.0, "c_22": -120.0, "c_23": 180.0}
#: Feet from soft to stiff; the nominal one is the model as it stands.
SETS: dict[str, dict[str, float]] = {
    "nominal": {},
    "soft": {"k_T": 3e4, "k_F": 2e4, "c_11": 100.0, "c_21": 200.0, **_LAW},
    "mid": {"k_T": 1e5, "k_F": 1e5, "c_11": 300.0, "c_21": 800.0, **_LAW},
    "stiff": {"k_T": 2e5, "k_F": 3e5, "c_11": 800.0, "c_21": 2000.0, **_LAW},
}


@dataclass(frozen=True)
class Errors:
    """Errors of one foot at one frequency, as shares of the peak, by time step.

    Attributes:
        step: (n,) [s]. recorded: (n,) malleolus, driven by the samples. smooth: (n,) malleolus, driven by the sine.
        twin: (n,) twin against MuJoCo on the same input. at_samples, between: (n,) base acceleration.
    """

    step: tuple[float, ...]
    recorded: np.ndarray
    smooth: np.ndarray
    twin: np.ndarray
    at_samples: np.ndarray
    between: np.ndarray


def errors(foot: Foot, frequency_hz: float, steps: tuple[float, ...] = STEPS, seconds: float = SECONDS) -> Errors:
    """Run one foot from rest with each time step and compare."""
    sine = shaker.sine(frequency_hz, seconds)
    t = np.arange(round(seconds * RATE_HZ) + 1) / RATE_HZ
    recorded = shaker.samples(t, sine.acceleration(t))
    truth = TwoDof.from_values(foot.values())
    reference = solve_ivp(
        lambda time, x: truth.rates(time, x, float(sine.acceleration(time))), (0.0, t[-1]), np.zeros(4),
        method="DOP853", t_eval=t[:-1], rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    exact = truth.output(reference.y)
    rows = []
    for step in steps:
        stride, count = round(1 / (RATE_HZ * step)), round(seconds / step)
        run, smooth = (simulate(foot, each, step=step, accept=None) for each in (recorded, sine))
        y = run.malleolus[0]
        other, *_ = trajectory(
            np.zeros(4), truth.theta, truth.m_S, truth.m_F, recorded.half_steps(step, count), step, 1, 0
        )
        wrong = np.abs(run.base[0] - sine.acceleration(run.time[0])) / np.abs(sine.acceleration(t)).max()
        rows.append(
            (
                _share(y[::stride], exact), _share(smooth.malleolus[0, ::stride], exact), _share(other, y),
                wrong[::stride].max(), wrong.max(),
            )
        )  # fmt: skip
    return Errors(steps, *np.array(rows).T)


def _share(y: np.ndarray, exact: np.ndarray) -> float:
    return float(np.abs(y - exact).max() / np.abs(exact).max())


def order(step: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Observed orders (n - 1,) between neighbouring steps."""
    return np.diff(np.log(error)) / np.diff(np.log(step))


def measure(frequencies_hz: tuple[float, ...] = FREQUENCIES_HZ, seconds: float = SECONDS) -> list[Check]:
    """All feet at all frequencies; each row is the worst of them."""
    foot = load("two_dof")
    trials = [(name, f) for name in SETS for f in frequencies_hz]
    by_trial: dict[tuple[str, float], Errors] = {}
    with progress_bar() as progress:
        for name, f in progress.track(trials, description="accuracy"):
            by_trial[name, f] = errors(foot.with_values(SETS[name]), f, seconds=seconds)
    rows = []
    for column, limit in ((0, None), (1, 3e-4), (2, 2e-5)):
        (name, f), worst = max(by_trial.items(), key=lambda item: item[1].recorded[column])
        what = f"malleolus error at a step of {STEPS[column]:g} s, share of peak (worst: {name} foot, {f:g} Hz)"
        value = worst.recorded[column]
        rows.append(told(what, f"{value:.3g}") if limit is None else at_most(what, value, limit))
    orders = {name: order(np.array(STEPS), by_trial[name, max(frequencies_hz)].smooth)[-1] for name in SETS}
    name = min(orders, key=lambda name: orders[name])
    rows.append(at_least(f"observed order, {STEPS[1]:g} to {STEPS[2]:g} s (lowest: {name} foot)", orders[name], 3.8))
    worst = max(e.twin.max() for e in by_trial.values())
    rows.append(at_most("compiled equations against MuJoCo on the same input", worst, 1e-6))
    fast = [e for (_, f), e in by_trial.items() if f == max(frequencies_hz)]
    top = f"base acceleration at {max(frequencies_hz):g} Hz"
    rows.append(at_most(f"{top}, at samples", max(e.at_samples.max() for e in fast), 1e-6))
    rows.append(at_most(f"{top}, between samples", max(e.between.max() for e in fast), 1e-4))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(json_: JsonOption = False) -> None:
    """Errors of MuJoCo and of the compiled equations against DOP853.

    Examples:
      python -m benchmarks.accuracy
    """
    report("accuracy", measure(), json_)


if __name__ == "__main__":
    command_line(app)
