"""Are the intervals of the heel's laws true? Strikes made from known laws, with the plate, the markers and the filters.

A leg of constant mass falls on a pad that follows a law; DOP853 integrates it at tight tolerance. What the plate and
the markers would have recorded is written as volts and millimetres, with the noise, the quantisation and the two
clocks of the measured study, and goes through the same corrections and the same fit. Each person has ten strikes of
one law, with other masses and speeds of contact.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Annotated

import numpy as np
import typer
from scipy.integrate import solve_ivp

from benchmarks.table import JsonOption, report
from fasbody import runner
from fasbody.console import command_line
from fasbody.exceptions import RecordingError
from fasbody.foot import damper
from fasbody.heel.analysis import analyse
from fasbody.heel.estimate import LEVEL, fit
from fasbody.heel.laws import LAWS, TAU_S, THICKNESS_M, HeelLaw
from fasbody.heel.plate import Plate
from fasbody.heel.strike import Strike, Trial, heel_strike
from fasbody.heel.study import HeelStudy
from reproduction.check import Check, at_most, told, within

#: Noise of each channel of the plate [V] and its step [V], and noise of a marker's coordinate [m], as in the study.
PLATE_V, STEP_V, MARKER_M = 9e-4, 3.05e-4, 8e-6
RATE_HZ, GAIN = 1293.5, 133.0
#: True laws: near the estimates of the measured people.
TRUTH = {
    "power": (60.0, 3.2), "exponential": (9.0, 430.0), "hunt_crossley": (45.0, 2.6, 1.0), "strain_damper": (600.0, 8.0),
    "ogden": (50.0, 6.0), "nonlinear": (1000.0, 2.9, 40.0, 2.5, 0.9), "qlv": (12.0, 7.5, 0.3),
}  # fmt: skip


def strike(law: HeelLaw, theta: np.ndarray, rng: np.random.Generator, number: int) -> Strike:
    """A synthetic strike of a law; those that the corrections refuse, as too weak, are made again."""
    for _ in range(20):
        with suppress(RecordingError):
            return _strike(law, theta, rng, number)
    raise RecordingError(f"{law.name}: twenty strikes in turn were refused.")


def _strike(law: HeelLaw, theta: np.ndarray, rng: np.random.Generator, number: int) -> Strike:
    """A strike through volts, markers and the published corrections."""
    mass, speed, push = rng.uniform(3.0, 6.0), rng.uniform(0.35, 0.75), rng.uniform(0.0, 40.0)
    t = np.arange(0.0, 0.12, 2e-4)
    if law.key == "qlv":
        rates = _with_memory(theta, mass, push)
    else:
        rates = lambda _, s: [s[1], (push - _force(law, theta, s[0], s[1])) / mass]  # noqa: E731
    start = [0.0, speed, *np.zeros(damper.BRANCHES if law.key == "qlv" else 0)]
    x = solve_ivp(rates, (0.0, t[-1]), start, method="DOP853", t_eval=t, rtol=1e-8, atol=1e-11).y[0]
    v = np.gradient(x, t)
    F = np.where(x > 0.0, law.force(t, np.maximum(x, 0.0), v, theta), 0.0)
    lead = 0.1 + rng.uniform(0.0, 1e-3)
    fall = lambda at: np.where(at < lead, speed * (at - lead), np.interp(at - lead, t, x))  # noqa: E731
    plate_t, frame_t = (np.arange(1, round(0.33 * rate) + 1) / rate for rate in (3000.0, RATE_HZ))
    force = np.where(plate_t < lead, 0.0, np.interp(plate_t - lead, t, F))
    volts = np.zeros((plate_t.size, 8))
    volts[:, 4:] = force[:, None] / (4.0 * GAIN)  # in the middle of the plate
    volts += rng.normal(0.0, PLATE_V, volts.shape)
    tilt = np.deg2rad(-20.0 + 60.0 * (frame_t - lead))
    along = np.column_stack([np.zeros_like(tilt), np.sin(-tilt), np.cos(tilt)])
    heel = np.column_stack([np.full(frame_t.size, 0.2), np.full(frame_t.size, 0.3), -fall(frame_t)])
    markers = np.stack([heel + 0.2 * along, heel + 0.345 * along], axis=1)
    markers = markers + rng.normal(0.0, MARKER_M, markers.shape)
    trial = Trial("1", "normal", str(number), STEP_V * np.round(volts / STEP_V), np.zeros(8), 0, markers, 0)
    return heel_strike(trial, Plate(), GAIN, 0.145, RATE_HZ)


def _force(law: HeelLaw, theta: np.ndarray, x: float, v: float) -> float:
    return 0.0 if x <= 0.0 else float(law.force(np.zeros(1), np.array([min(x, 0.0175)]), np.array([v]), theta)[0])


def _with_memory(theta: np.ndarray, mass: float, push: float) -> Callable[[float, np.ndarray], list[float]]:
    """Rates of position, velocity and the internal stresses (8,) of the quasi-linear pad: its differential form."""
    A, B, c = theta
    taus = [damper.branch_time(i, *TAU_S) for i in range(damper.BRANCHES)]
    weights = np.array([damper.branch_weight(i, *TAU_S) for i in range(damper.BRANCHES)])

    def rates(_: float, s: np.ndarray) -> list[float]:
        e = min(max(s[0], 0.0), 0.0175) / THICKNESS_M
        stress = A * np.expm1(B * e) + c * float(weights @ s[2:])
        force = max(stress / (1.0 + c * np.log(TAU_S[1] / TAU_S[0])), 0.0)
        driving = A * B * np.exp(B * e) * s[1] / THICKNESS_M if s[0] > 0.0 else 0.0
        return [s[1], (push - force) / mass, *(driving - h / tau for h, tau in zip(s[2:], taus, strict=True))]

    return rates


def person(task: tuple[str, int]) -> tuple[str, list[bool]]:
    """Whether each 95 % interval of a person of ten strikes holds the truth."""
    key, seed = task
    law, theta = LAWS[key], np.array(TRUTH[key])
    rng = np.random.default_rng([seed, list(LAWS).index(key)])
    found = fit(law, [strike(law, theta, rng, k) for k in range(10)], "whole")
    return key, [item.lower <= true <= item.upper for item, true in zip(found.parameters.values(), theta, strict=True)]


def measure(persons: int, jobs: int) -> Iterator[Check]:
    """The rows of this topic."""
    tasks = [(key, seed) for seed in range(persons) for key in TRUTH]
    hits: dict[str, list[bool]] = {}
    for _, (key, inside) in runner.run(person, tasks, "coverage", jobs):
        hits.setdefault(key, []).extend(inside)
    everything = [hit for inside in hits.values() for hit in inside]
    yield within(f"heel: parameters of {len(tasks)} synthetic people inside their {100 * LEVEL:g} % intervals",
                  100 * float(np.mean(everything)), 92.0, 98.0, "%")  # fmt: skip
    for key, inside in hits.items():
        yield told(f"the same, {LAWS[key].name}", f"{100 * np.mean(inside):.3g} % of {len(inside)}", "")
    began = time.perf_counter()
    found = analyse(HeelStudy.read())
    yield at_most("heel: the whole analysis of twelve walkers, wall time", time.perf_counter() - began, 120.0, "s")
    for window in ("loading", "whole"):
        for test, words in (("other_speed", "slow to normal"), ("other_person", "a person left out")):
            best = found.best(window, test)
            if best:
                yield told(
                    f"heel: {words}, {window}, error over the peak", f"{100 * best[1]:.3g} % ({LAWS[best[0]].name})", ""
                )


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    persons: Annotated[int, typer.Option(help="synthetic people per law")] = 40,
    jobs: Annotated[int, typer.Option(help="processes, 0 for all cores")] = 0,
    json_: JsonOption = False,
) -> None:
    """Count how often the intervals of the heel's laws hold the truth, and time the analysis.

    Examples:
      python -m benchmarks.heel --persons 100
    """
    report("heel", list(measure(persons, jobs)), json_)


if __name__ == "__main__":
    command_line(app)
