"""Mutation tests: one fault after the other in a copy of the tree, and the tests that must fail.

Each fault is in a rule that decides something for the user: a limit moved, a repetition left out,
a rate forgotten.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.table import JsonOption, report
from fasbody.console import command_line, console
from fasbody.runner import ROOT
from reproduction.check import Check, exactly, told

#: What a test run needs of the checkout.
COPIED = (
    "benchmarks", "docs", "examples", "fasbody", "identification", "mjcf", "reproduction",
    "simulator", "tests", "viz",
)  # fmt: skip
#: Of the guard against limits: the shaker's gain runs away.
_GENERATOR = "test_acquire_generator.py"
_RUNS_AWAY = f"{_GENERATOR}::test_gain_that_grows_by_a_fifth_each_second_never_exceeds_a_limit"


@dataclass(frozen=True)
class Fault:
    """One change of one line.

    Attributes:
        what: the rule that it breaks.
        file: where it is.
        old: text that is there once.
        new: text in its place.
        tests: files, or single tests, that should fail.
    """

    what: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


FAULTS = (
    Fault(
        "a model follows up to 45 % of repeatability", "identification/steady.py",
        "FOLLOWS = 0.15", "FOLLOWS = 0.45",
        ("test_optimiser.py::test_beyond_the_bound_of_repeatability_nothing_is_offered",
         "test_rivals.py::test_nothing_is_said_where_no_rival_follows"),
    ),
    Fault(
        "repeatability beyond 3 % is cut off", "identification/repeatability.py",
        "_MOST, _STARTS = 1.0,",
        "_MOST, _STARTS = 0.03,",
        ("test_repeatability.py::test_harmonics_that_scatter_are_measured_as_such",),
    ),
    Fault(
        "noise alone counts as scatter", "identification/repeatability.py",
        "if chi_square <= float(chdtri(dof, _BY_CHANCE)):", "if chi_square <= 0:",
        ("test_repeatability.py::test_where_noise_suffices_there_is_none",),
    ),
    Fault(
        "odds of ten decide", "identification/branches.py",
        "DECISIVE_ODDS = 1000.0", "DECISIVE_ODDS = 300.0", ("test_branches.py",),
    ),
    Fault(
        "branches are tied up to odds of e", "identification/branches.py",
        "TIE = 0.01", "TIE = 1.0",
        ("test_branches.py",),
    ),
    Fault(
        "30 % of standard error are identified", "identification/estimates.py",
        "IDENTIFIED, WEAK = 0.1, 0.5", "IDENTIFIED, WEAK = 0.3, 0.5", ("test_result.py",),
    ),
    Fault(
        "intervals are always the curvature's", "identification/profile.py",
        "_STEPS = 60", "_STEPS = 0",
        ("test_intervals.py::test_where_a_parabola_does_not_hold_intervals_end_where_the_profile_does",),
    ),
    Fault(
        "a constant rests on a bound from afar", "identification/intervals.py",
        "_AT_BOUND = 1e-4", "_AT_BOUND = 0.1", ("test_intervals.py",),
    ),
    Fault(
        "what was found once is found", "identification/optimiser.py",
        "self.hits > 1", "self.hits > 0", ("test_optimiser.py",),
    ),
    Fault(
        "coloured noise is white", "fasbody/recording/harmonics.py",
        "not 0.6 < local < 1.6", "not 0.06 < local < 16", ("test_response.py",),
    ),
    Fault(
        "every second person is odd", "identification/study/population.py",
        "_ODD = 0.01", "_ODD = 0.5",
        ("test_study_population.py",),
    ),
    Fault(
        "nobody is odd", "identification/study/population.py", "_ODD = 0.01", "_ODD = 0.0005",
        ("test_study_population.py",),
    ),
    Fault(
        "nothing is recorded again", "fasbody/acquire/session.py",
        "reversed(range(self.plan.retries + 1))", "reversed(range(1))",
        ("test_acquire_session.py",),
    ),
    Fault(
        "nothing is recorded again by the command", "fasbody/acquire/commands.py",
        'repeat a recording that lost samples")] = 2',
        'repeat a recording that lost samples")] = 0',
        ("test_acquire.py::test_planned_session_goes_on_where_it_stopped",),
    ),
    Fault(
        "the output goes off beyond its limit", "fasbody/acquire/level.py",
        "TRIPPED = 0.97", "TRIPPED = 1.07",
        (_RUNS_AWAY,),
    ),
    Fault(
        "travel has no limit", "fasbody/acquire/level.py",
        "moving = 0.5 * self.displacement_m", "moving = 5.0 * self.displacement_m",
        (_RUNS_AWAY,),
    ),
    Fault(
        "the output of a killed driver stays on", "fasbody/acquire/guard.py",
        "if not data:\n            break", "if not data:\n            return",
        (f"{_GENERATOR}::test_guard_acts_on_silence_and_on_the_end_of_the_driver",),
    ),
    Fault(
        "no vibration dose value is too much", "fasbody/acquire/person.py",
        "if self.vdv > vdv:", "if self.vdv > 10 * vdv:",
        ("test_acquire_person.py",),
    ),
    Fault(
        "a shaker goes on blindly", "fasbody/acquire/board.py",
        "if self.watch is not None and time.monotonic()",
        "if self.watch is None and time.monotonic()",
        ("test_acquire_session.py::test_shaking_blindly_is_an_error",),
    ),
)  # fmt: skip


def outcome(fault: Fault, tree: Path, seconds: float) -> str:
    """What became of a fault: killed, survived, or not planted as a rule has changed its name.

    The tree is as before afterwards.
    """
    file = tree / fault.file
    before = file.read_text() if file.is_file() else ""
    if before.count(fault.old) != 1:
        return f"not planted: {fault.old!r} is there {before.count(fault.old)} times"
    file.write_text(before.replace(fault.old, fault.new))
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-m", "", "-p", "no:cacheprovider"]
    words += [f"tests/{test}" for test in fault.tests]
    try:
        done = subprocess.run(
            words, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=seconds,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "killed"
    finally:
        file.write_text(before)
    return {0: "survived", 1: "killed"}.get(done.returncode, f"not tested: {done.stdout[-300:]}")


def measure(only: str, seconds: float) -> list[Check]:
    """A row a fault, and how many survived."""
    rows, alive = [], 0
    with tempfile.TemporaryDirectory(prefix="fas_mutate_") as folder:
        tree = Path(folder)
        for name in COPIED:
            shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("pyproject.toml", "README.md", "Makefile"):
            shutil.copy(ROOT / name, tree)
        for fault in FAULTS:
            if only not in fault.what:
                continue
            word = outcome(fault, tree, seconds)
            alive += word != "killed"
            console.print(f"{word}: {fault.what} ({fault.file})", soft_wrap=True)
            rows.append(told(fault.what, word))
    return [*rows, exactly("faults in decision rules that no test notices", alive, 0)]


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    only: Annotated[str, typer.Option(help="part of the names of the faults wanted")] = "",
    seconds: Annotated[float, typer.Option(help="a fault whose tests take longer is killed")] = 300.0,
    json_: JsonOption = False,
) -> None:
    """Plant faults in decision rules, one at a time, and say which the tests kill. Takes some minutes.

    Examples:
      python -m benchmarks.mutate --only odds
    """
    report("Planted faults", measure(only, seconds), json_)


if __name__ == "__main__":
    command_line(app)
