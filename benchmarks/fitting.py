"""How long a fit takes: steady state and time domain, the twin and MuJoCo alone, and scipy alone.

Steady state: the bundled nine recordings without load, pooled, the eight parameters and the delay free, from wild
starts. Time domain: one synthetic recording of 10 s at 1 kHz, a sine swept from 10 to 50 Hz, eight parameters and four
initial states, no delay, from the model's own values. All on one thread, in CPU time.
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
from identification.branches import mirrored, ratio
from identification.domains import PeriodicDomain, TimeDomain
from identification.engines.mujoco import Rollouts
from identification.periodic import PeriodicProblem
from identification.search import Descent, Problem, descend
from identification.space import space_of
from reproduction.check import Check, at_least, at_most

#: Costs that differ by less are equal: both minimisers stop at relative changes of 1e-8.
_SAME = 1e-7


@dataclass(frozen=True, eq=False)
class Timed:
    """A descent and its CPU time [s]."""

    descent: Descent
    seconds: float


def timed(problem: Problem, q0: np.ndarray, label: str) -> Timed:
    """One descent, as `identification.fit` explores."""
    began = time.process_time()
    descent = descend(problem, q0, label)
    return Timed(descent, time.process_time() - began)


def bundled() -> list[Recording]:
    """The nine recordings of the bundled synthetic study without load."""
    return [checked(recording) for recording in study.bundled().under(0.0)]


def sweep_recording(seconds: float = 10.0, seed: int = 16) -> Recording:
    """A synthetic recording of the laboratory's foot on a swept sine; a lead-in of one second is not recorded."""
    condition = Condition("16", body_mass_kg=SUBJECTS[16].mass_kg)
    foot = TwoDof.from_values({**TRUTH, **condition.masses})
    motion = shaker.sweep(10.0, 50.0, seconds + 1)
    made = record(foot, motion, seconds, Instrument(delay_s=0.0), np.random.default_rng(seed))
    return checked(replace(made, condition=condition))


def gap(a: np.ndarray, b: np.ndarray, problem: Problem) -> float:
    """Largest distance between search variables a and b (p,), in standard errors at a."""
    return float(np.max(np.abs(a - b) / np.sqrt(np.diag(problem.covariance(a, np.ones(a.size, bool))))))


def steady_state(timed_starts: int = 20, wild_starts: int = 50, mujoco_starts: int = 3) -> tuple[list[Check], float]:
    """Rows of the pooled steady-state fit, and the median time of one in the twin [s]."""
    foot, data = load("two_dof"), bundled()
    space = space_of(foot)
    domain = PeriodicDomain(foot, data, space, twin=True, threads=1)
    twin = domain.problem()
    engine = Rollouts(foot, [line.excitation for line in domain.lines], space.names, threads=1)
    mujoco = PeriodicProblem(domain.lines, engine, space)
    rng = np.random.default_rng(0)
    starts = [space.random(rng) for _ in range(max(wild_starts, timed_starts, mujoco_starts))]
    descend(twin, starts[0], "compiles")
    slow_problem = TimeDomain(foot, data, space, twin=True).problem()
    with progress_bar() as progress:
        task = progress.add_task("steady state", total=len(starts) + mujoco_starts + 1)
        quick = []
        for q0 in starts:
            quick.append(timed(twin, q0, "twin"))
            progress.advance(task)
        alone = []
        for q0 in starts[:mujoco_starts]:
            alone.append(timed(mujoco, q0, "mujoco"))
            progress.advance(task)
        slow = timed(slow_problem, starts[0], "time domain")
        progress.advance(task)

    # converge the same starts on both engines as a reported result is, then compare
    apart = 0.0
    twin.tolerance = mujoco.tolerance = 1e-7
    for fast, other in zip(quick, alone, strict=False):
        ends = [
            descend(problem, space.to_q(found.descent.theta), "tight", z0=found.descent.z, tight=True).z
            for problem, found in ((twin, fast), (mujoco, other))
        ]
        apart = max(apart, gap(ends[0], ends[1], twin))

    a = ratio([recording.condition.masses for recording in data], TRUTH)
    ends = [_end(twin, space.to_q(space.theta(values))) for values in (TRUTH, mirrored(TRUTH, a))]
    arrived = sum(min(gap(end, found.descent.z, twin) for end in ends) < 0.1 for found in quick[:wild_starts])
    median = float(np.median([found.seconds for found in quick[:timed_starts]]))
    mujoco_median = float(np.median([found.seconds for found in alone]))
    what = f"pooled steady-state fit of {len(data)} recordings"
    rows = [
        at_most(f"{what}, twin, median of {timed_starts} wild starts", 1e3 * median, 60.0, "ms"),
        at_most(f"{what}, MuJoCo alone, one thread, median of {mujoco_starts} wild starts", mujoco_median, 3.0, "s"),
        faster(f"{what}, twin", median, mujoco_median, "MuJoCo alone"),
        faster(f"{what}, twin", median, slow.seconds, "twin in the time domain, same recordings and start"),
        at_most("distance between the estimates of twin and MuJoCo alone, standard errors", apart, 0.01),
        at_least(f"of {wild_starts} wild starts, ends at the truth or its mirror", arrived, round(0.96 * wild_starts)),
    ]  # fmt: skip
    return rows, median


def _end(problem: PeriodicProblem, q0: np.ndarray) -> np.ndarray:
    return descend(problem, q0, "known", tight=True).z


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
        descend(problem, q0, "compiles")
        ours = [timed(problem, q0, "twin") for _ in range(repeats)]
        descent, median = ours[0].descent, float(np.median([found.seconds for found in ours]))
        limit = min(scipy_limit, descent.evaluations)
        began = time.process_time()
        z, _ = plain_scipy.fit(problem, problem.start(q0), limit)
        scipy_seconds = time.process_time() - began
    # the cost of scipy's own residual includes the error of its integrator; both are judged by the same one
    scipy_cost = float(np.sum(problem.residual(z) ** 2))
    other = f"scipy RK45 and least_squares, {limit} trial points allowed"
    return [
        faster(f"time-domain fit of a {seconds:g} s recording, twin ({descent.evaluations} evaluations)",
               median, scipy_seconds, other, 300.0),
        Check("its cost (weighted sum of squares)", descent.cost, high=scipy_cost * (1 + _SAME),
              said=f"{descent.cost:.8g}", beside=f"scipy: {scipy_cost:.8g}, equal or lower",
              ratio=scipy_cost / descent.cost),
        faster("pooled steady-state fit, twin", steady_seconds, scipy_seconds, "scipy on that one recording"),
    ]  # fmt: skip


def measure(
    timed_starts: int = 20, wild_starts: int = 50, mujoco_starts: int = 3, seconds: float = 10.0, scipy_limit: int = 200
) -> list[Check]:
    """All rows; the defaults are those of the requirements."""
    rows, median = steady_state(timed_starts, wild_starts, mujoco_starts)
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
