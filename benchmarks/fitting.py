"""How long a fit takes: steady state in closed form and on MuJoCo alone, time domain, and scipy alone.

Steady state: the bundled nine recordings without load, pooled, the eight parameters and the delay free, from random
starts, the model assumed exact; and the whole fit with every nuisance. Time domain: one synthetic recording of 10 s at
1 kHz, a sine swept from 10 to 50 Hz, eight parameters and four initial states, no delay, from the values of the model.
All on one thread, in CPU time.
"""

import time
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from benchmarks import plain_scipy
from benchmarks.table import JsonOption, faster, report
from fasbody.console import command_line, progress_bar
from fasbody.foot import shaker
from fasbody.foot.model import load
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.foot import TRUTH, record
from fasbody.laboratory.instrument import Instrument
from fasbody.recording import study
from fasbody.recording.checks import checked
from fasbody.recording.condition import SUBJECTS
from fasbody.recording.recording import Condition, Recording
from identification import optimiser, steady
from identification.fitting import Settings, fit_foot
from identification.intervals import Solution
from identification.multistart import Descent, descend
from identification.parameters import space_of
from identification.setup import Setup
from identification.study.validation import held
from identification.time_domain import TimeDomain
from identification.time_problem import TimeProblem
from reproduction.check import Check, at_least, at_most

#: Costs that differ by less are equal: both minimisers stop at relative changes of 1e-8.
_SAME = 1e-7


@dataclass(frozen=True, eq=False)
class Timed:
    """A descent and its CPU time [s]."""

    descent: Descent
    seconds: float


def timed(problem: TimeProblem, q0: np.ndarray, label: str) -> Timed:
    """One descent, as `identification.fit` explores."""
    began = time.process_time()
    descent = descend(problem, label, problem.start(q0))
    return Timed(descent, time.process_time() - began)


def bundled() -> list[Recording]:
    """The nine recordings of the bundled synthetic study without load."""
    return list(study.bundled().under(0.0))


def sweep_recording(seconds: float = 10.0, seed: int = 16) -> Recording:
    """A synthetic recording of the laboratory's foot on a swept sine; a lead-in of one second is not recorded."""
    condition = Condition("16", body_mass_kg=SUBJECTS[16].mass_kg)
    foot = TwoDof.from_values({**TRUTH, **condition.masses})
    motion = shaker.sweep(10.0, 50.0, seconds + 1)
    made = record(foot, motion, seconds, Instrument(delay_s=0.0), np.random.default_rng(seed))
    return checked(replace(made, condition=condition))


#: Two ends are one where their constants differ by less, in standard errors.
_ONE = 0.1


def constants(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping of an end and their standard errors."""
    estimates = list(solution.estimates()[0].items())
    kept = [e for key, e in estimates if "_n_" in key]
    return np.array([e.value for e in kept]), np.array([e.std_error for e in kept])


def steady_state(wild_starts: int = 50) -> tuple[list[Check], float]:
    """Rows of the pooled steady-state fit, and the time of one start [s]."""
    foot = load("two_dof")
    question = Setup.of(bundled(), foot, Settings())
    problem = held(question)
    rng, count = np.random.default_rng(0), wild_starts // 2
    Q = np.concatenate([optimiser.random_starts(problem, sign, count, rng) for sign in (1, -1)])
    signs = np.repeat([1, -1], count)
    began = time.process_time()
    ends = optimiser.descend(problem, Q, signs)
    seconds_per_start = (time.process_time() - began) / len(Q)
    best = {}
    for sign in (1, -1):
        mine = np.flatnonzero(signs == sign)
        best[sign] = optimiser.finished(problem, ends.Q[mine[np.argmin(ends.objective[mine])]], sign)
    least = np.array([best[sign][1] for sign in signs])
    arrived = int(np.sum(ends.objective < least + optimiser.SAME))
    began = time.process_time()
    whole = fit_foot(bundled(), foot)
    seconds = time.process_time() - began

    any_model = steady.problem_of(
        question.recordings, foot, question.space, question.known, question.sensors, None, question.delay
    )
    variables = any_model.variables
    other = any_model.with_held(variables.held([item.kind for item in variables.nuisances if item.kind != "delay"]))
    sign = 1 if best[1][1] < best[-1][1] else -1
    ours = Solution(steady.SIDES[sign], problem, _optimum(best[sign], sign))
    began = time.process_time()
    near = other.variables.start({name: value * rng.uniform(0.9, 1.1) for name, value in ours.foot(0).items()})
    theirs = Solution("best", other, _optimum(optimiser.finished(other, near, 0), 0))
    alone = time.process_time() - began
    (a, std), (b, _) = constants(ours), constants(theirs)
    what = f"pooled steady-state fit of {len(question.recordings)} recordings"
    rows = [
        at_most(
            f"{what}, model assumed exact, one of {len(Q)} random starts", 1e3 * seconds_per_start, 60.0, "ms"
        ),
        faster(f"{what}, one start", seconds_per_start, alone, "MuJoCo's inverse dynamics, for any model"),
        at_most(
            "largest difference of a constant between the fits by compiled equations and by MuJoCo, standard errors",
            float(np.max(np.abs(a - b) / std)),
            _ONE,
        ),
        at_least(f"of {len(Q)} random starts, end at the best minimum of their branch", arrived, round(0.5 * len(Q))),
        at_most(f"{what}, both branches, all nuisance parameters, replay in MuJoCo, CPU time", seconds, 60.0, "s"),
        at_least("times that its search found the best minimum", int(whole.starts[0]["hits"]), 2),
    ]
    return rows, seconds_per_start


def _optimum(end: tuple[np.ndarray, float, bool], sign: int) -> optimiser.Optimum:
    return optimiser.Optimum(sign, *end, 1, 1)


def time_domain(steady_seconds: float, seconds: float = 10.0, repeats: int = 5, scipy_limit: int = 200) -> list[Check]:
    """Rows of the time-domain fit beside scipy's.

    Args:
        steady_seconds: time of a pooled steady-state fit, for its ratio to scipy. seconds: length of the recording.
        repeats: how often our fit is timed. scipy_limit: at most so many trial points for scipy, and never more than
            our fit took.
    """
    foot, recording = load("two_dof"), sweep_recording(seconds)
    space = space_of(foot, delay=False)
    problem = TimeDomain(foot, [recording], space, twin=True).problem()
    q0 = space.to_q(space.theta(foot.values()))
    with progress_bar() as progress:
        progress.add_task("time domain", total=None)
        descend(problem, "compiles", problem.start(q0))
        ours = [timed(problem, q0, "twin") for _ in range(repeats)]
        descent, median = ours[0].descent, float(np.median([run.seconds for run in ours]))
        limit = min(scipy_limit, descent.evaluations)
        began = time.process_time()
        z, _ = plain_scipy.fit(problem, problem.start(q0), limit)
        scipy_seconds = time.process_time() - began
    # the cost of scipy's own residual includes the error of its integrator; both are judged by the same one
    scipy_cost = float(np.sum(problem.residual(z) ** 2))
    other = f"scipy RK45 and least_squares, {limit} trial points allowed"
    return [
        faster(f"time-domain fit of a {seconds:g} s recording, compiled equations ({descent.evaluations} evaluations)",
               median, scipy_seconds, other, 300.0),
        Check("its cost (weighted sum of squares)", descent.cost, high=scipy_cost * (1 + _SAME),
              said=f"{descent.cost:.8g}", beside=f"scipy: {scipy_cost:.8g}, equal or lower",
              ratio=scipy_cost / descent.cost),
        faster("pooled steady-state fit, one start", steady_seconds, scipy_seconds, "scipy on that one recording"),
    ]  # fmt: skip


def measure(wild_starts: int = 50, seconds: float = 10.0, scipy_limit: int = 200) -> list[Check]:
    """All rows; the defaults are those of the requirements."""
    rows, median = steady_state(wild_starts)
    return rows + time_domain(median, seconds, scipy_limit=scipy_limit)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    scipy_limit: Annotated[int, typer.Option(help="trial points allowed to scipy (at most what our fit took)")] = 200,
    json_: JsonOption = False,
) -> None:
    """Compare fits with those of scipy, which take minutes.

    Examples:
      python -m benchmarks.fitting --scipy-limit 3
    """
    report("fitting", measure(scipy_limit=scipy_limit), json_)


if __name__ == "__main__":
    command_line(app)
