"""Coverage of the intervals: many noise seeds of one foot, fitted as `identification.fit` fits them, and counted.

The foot is integrated once a frequency; each seed draws anew: sensor noise, quantisation, harmonics,
fit of both branches from starts near the truth and near its mirror, weights, intervals and verdict. Three feet: one
with strongly nonlinear dampers, whose true branch must be chosen; a nearly linear one, which cannot be decided; and
one between, whose exponentials are as flat but whose cosines are not (of which nothing is required: a quarter of the
seeds).

`make bench` takes few seeds; the study is `python -m benchmarks.coverage --seeds 200`.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer
from scipy.stats import chi2, kstest

from benchmarks.table import JsonOption, report
from fasbody.console import command_line, console
from fasbody.exceptions import SettingError
from fasbody.foot.model import load
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.foot import TRUTH, exact
from fasbody.laboratory.instrument import Instrument
from fasbody.laboratory.study import FREQUENCIES_HZ
from fasbody.recording.condition import SUBJECTS
from fasbody.recording.recording import Condition, Recording
from fasbody.runner import run
from identification import optimiser
from identification.branches import judge
from identification.fitting import Settings
from identification.intervals import Solution
from identification.residual import Problem
from identification.setup import Setup
from identification.steady import SIDES
from identification.study.validation import held
from reproduction.check import Check, at_least, within

#: The laboratory's foot, and the same with less nonlinearity.
_FLAT = {**TRUTH, "c_12": 3.0, "c_22": -3.0}
STRONG, WEAK, BETWEEN = "strongly nonlinear", "nearly linear", "between"
FEET = {STRONG: TRUTH, WEAK: {**_FLAT, "c_13": 10.0, "c_23": 10.0}, BETWEEN: _FLAT}
COUNTED = ("k_T", "k_F", "c_11", "c_21")
INSTRUMENT = Instrument()
#: Seeds below which the chance of a miscount is too large to require anything.
_ENOUGH = 100


@dataclass(frozen=True)
class Trial:
    """One seed of one foot.

    Attributes:
        covered: name -> whether the 95 % interval of the true branch holds the truth, for each of `COUNTED`.
        chi_square, dof: of the true branch. true_is_best: the true branch is the likelier. decided: the verdict.
    """

    covered: Mapping[str, bool]
    chi_square: float
    dof: int
    true_is_best: bool
    decided: bool


def motions(truth: Mapping[str, float], frequencies_hz: Sequence[float], seconds: float) -> list[Recording]:
    """Recordings without noise of one foot, one a frequency."""
    rng = np.random.default_rng(16)
    body = SUBJECTS[16].mass_kg
    made = []
    for frequency in frequencies_hz:
        condition = Condition("16", "midstance", 0.0, body, frequency)
        foot = TwoDof.from_values({**truth, **condition.masses})
        clean = exact(foot, INSTRUMENT.motion(frequency, seconds + 2, rng), seconds, INSTRUMENT)
        made.append(replace(clean, condition=condition, file=f"{frequency:g} Hz"))
    return made


def trial(truth: Mapping[str, float], clean: Sequence[Recording], seed: int) -> Trial:
    """Add noise, fit both branches with the model assumed exact, and judge."""
    rng = np.random.default_rng(seed)
    data = [INSTRUMENT.observe(recording, rng) for recording in clean]
    problem = held(Setup.of(data, load("two_dof"), Settings()))
    variables = problem.variables
    true = _side(problem, variables.start(truth))
    near = variables.start({name: value * rng.uniform(0.9, 1.1) for name, value in truth.items()})
    starts = {_side(problem, q): q for q in (near, variables.image(near))}
    problem = problem.weighed(starts[true])
    ends = {sign: _end(problem, q, sign) for sign, q in starts.items()}
    best = min(ends, key=lambda sign: ends[sign].optimum.objective)
    order = [ends[best], ends[-best]]
    verdict = judge([s.branch for s in order], [s.optimum.objective for s in order], order[0].chi_square, order[0].dof)
    right = ends[true]
    estimates = {key.split("_n_")[0]: e for key, e in right.estimates()[0].items()}
    covered = {name: estimates[name].lower <= truth[name] <= estimates[name].upper for name in COUNTED}
    return Trial(covered, right.chi_square, right.dof, best == true, verdict.word == "decided")


def _side(problem: Problem, q: np.ndarray) -> int:
    return 1 if q[problem.variables.index["k_F"]] > 0 else -1


def _end(problem: Problem, q: np.ndarray, sign: int) -> Solution:
    q, objective, converged = optimiser.finished(problem, q, sign)
    return Solution(SIDES[sign], problem, optimiser.Optimum(sign, q, objective, converged, 1, 1))


def _work(task: tuple[str, int, Sequence[Recording]]) -> Trial:
    name, seed, clean = task
    return trial(FEET[name], clean, seed)


def study(seeds: int, jobs: int, seconds: float = 4.0) -> Iterator[tuple[str, Trial]]:
    """Trials of all feet as they finish; Ctrl-C ends them and keeps what is done."""
    clean = {name: motions(truth, FREQUENCIES_HZ, seconds) for name, truth in FEET.items()}
    feet = [(name, seed) for seed in range(seeds) for name in FEET if name != BETWEEN or seed % 4 == 0]
    work = [(name, seed, clean[name]) for name, seed in feet]
    try:
        for index, done in run(_work, work, "noise seeds", jobs):
            yield feet[index][0], done
    except KeyboardInterrupt:
        console.print("interrupted; the rows rest on the seeds that are done")


def rows_of(trials: Mapping[str, Sequence[Trial]]) -> list[Check]:
    """Rows from the trials of each foot; with fewer than 100 seeds nothing is required of rates."""
    strong, weak, middle = (trials[name] for name in (STRONG, WEAK, BETWEEN))
    rows = []
    if strong:
        n = len(strong)
        for name in COUNTED:
            what = f"95 % interval of {name} holds the truth, {n} seeds"
            rate = 100 * float(np.mean([t.covered[name] for t in strong]))
            row = within(what, rate, 92.0, 98.0, "%")
            if n < _ENOUGH:
                row = replace(row, beside=f"{row.against}, judged from {_ENOUGH} seeds on", asked=False)
            rows.append(row)
        dof = strong[0].dof
        test = kstest([t.chi_square for t in strong], chi2(dof).cdf)
        mean = float(np.mean([t.chi_square for t in strong]))
        what = f"chi-square is chi-square, Kolmogorov-Smirnov p, {n} seeds (mean {mean:.1f}, {dof} degrees of freedom)"
        rows.append(at_least(what, test.pvalue, 0.01))
        chosen = sum(t.true_is_best and t.decided for t in strong)
        rows.append(at_least(f"{_about(STRONG)}: true branch chosen and decided, seeds", chosen, n))
    if weak:
        undecided = sum(not t.decided for t in weak)
        rows.append(at_least(f"{_about(WEAK)}: undecided, seeds", undecided, len(weak)))
    if middle:
        count, wrong = sum(t.decided for t in middle), sum(t.decided and not t.true_is_best for t in middle)
        what = f"{_about(BETWEEN)}: decided, seeds (wrongly: {wrong})"
        rows.append(Check(what, wrong, 0, 0, said=f"{count}", beside=f"of {len(middle)}, none wrongly"))
    return rows


def _about(name: str) -> str:
    """A foot's name and the constants that make it."""
    law = ", ".join(f"{key} {FEET[name][key]:g}" for key in ("c_12", "c_13", "c_22", "c_23"))
    return f"{name} ({law})"


def measure(seeds: int = 20, jobs: int = 0, seconds: float = 4.0) -> list[Check]:
    """All rows from so many seeds, on so many processes (0: all cores).

    Raises:
        SettingError: fewer than two seeds.
    """
    if seeds < 2:
        raise SettingError(f"--seeds is {seeds}; at least 2 are needed, and 100 or more to judge the intervals.")
    trials: dict[str, list[Trial]] = {name: [] for name in FEET}
    for name, done in study(seeds, jobs or os.cpu_count() or 1, seconds):
        trials[name].append(done)
    return rows_of(trials)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(help="noise seeds of each foot; the study takes 200")] = 200,
    jobs: Annotated[int, typer.Option(help="processes, 0 for all cores")] = 0,
    json_: JsonOption = False,
) -> None:
    """Coverage of the confidence intervals, distribution of chi-square, and verdicts.

    Examples:
      python -m benchmarks.coverage --seeds 200
    """
    report("coverage", measure(seeds, jobs), json_)


if __name__ == "__main__":
    command_line(app)
