"""Global search of a fit on each side of the mirror: the default starts against many.

A fit descends from a few starts on each side of the axis and compares the ends. Where many more
starts find a better one, odds and intervals of the default fit rest on the wrong end; it must then
say that its search is not exhausted, and decide nothing. Feet are of all worlds in turn.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks import kept
from benchmarks.reality import study
from benchmarks.table import JsonOption, report
from fasbody.console import command_line, progress_bar
from fasbody.exceptions import FasError
from identification.result import FitResult
from reproduction.check import Check, at_most, told
from simulator.worlds import SOURCES, WORLDS, member, recordings

#: Difference of two objectives (chi-square and prior) that makes two ends one.
SAME = 0.5
#: What a fit says where it has not found an end twice.
WORDS = "search was not exhaustive"


@dataclass(frozen=True)
class Ends:
    """One foot, fitted twice.

    Attributes:
        world: of the foot.
        seed: of the foot.
        starts: of the second fit.
        default: branch -> objective at its end, of the default fit; empty where it refused.
        many: the same of the fit with many starts.
        verdict: of the default fit.
        says: the default fit says that its search is not exhausted.
        seconds: CPU time of both fits [s].
    """

    world: str
    seed: int
    starts: int
    default: Mapping[str, float]
    many: Mapping[str, float]
    verdict: str
    says: bool
    seconds: tuple[float, float]

    @property
    def complete(self) -> bool:
        """Whether no branch has an end that many starts make better."""
        return all(self.default.get(name, np.inf) <= end + SAME for name, end in self.many.items())

    @property
    def open(self) -> bool:
        """Whether the fit reports it: the branch is undecided, with the reason."""
        return self.says and self.verdict != "decided"


def ends_of(result: FitResult) -> dict[str, float]:
    """Branch -> objective at its end, with everything that may be true."""
    return {branch.name: branch.departures.objective for branch in result.branches if branch.departures}


def trial(world: str, seed: int, starts: int) -> Ends:
    """Record one foot, and fit it twice."""
    from fasbody.foot.model import load
    from identification.fitting import fit_foot

    data, began = recordings(member(world, seed)), time.process_time()
    try:
        result = fit_foot(data, load("two_dof"), threads=1)
        between = time.process_time()
        many = ends_of(fit_foot(data, load("two_dof"), threads=1, starts=starts))
    except FasError:
        return Ends(world, seed, starts, {}, {}, "none", False, (time.process_time() - began, 0.0))
    says = WORDS in " ".join([result.reason, *result.warnings])
    seconds = between - began, time.process_time() - between
    return Ends(world, seed, starts, ends_of(result), many, result.verdict, says, seconds)


def measure(feet: int, starts: int, jobs: int, state: Path, first: int = 0) -> list[Check]:
    """Rows of so many feet over all worlds in turn; what `state` holds is not done again."""
    sources = [*SOURCES, Path(__file__), *kept.fit_sources()]
    file, worlds = kept.Kept(state, kept.digest(sources, str(starts))), list(WORLDS)
    rows = [Ends(**{**row, "seconds": tuple(row["seconds"])}) for row in file.rows()]
    done = {(ends.world, ends.seed): ends for ends in rows}
    keys = [(worlds[i % len(worlds)], first + i // len(worlds)) for i in range(feet)]
    work = [(*key, starts) for key in keys if key not in done]
    with progress_bar() as progress:
        for ends in study(trial, work, jobs, progress) if work else ():
            done[ends.world, ends.seed] = ends
            file.add(asdict(ends))
    return rows_of([done[key] for key in keys if key in done])


def rows_of(feet: Sequence[Ends]) -> list[Check]:
    """What was required, and how often the default search finds the best ends."""
    if not feet:
        return []
    fitted = [ends for ends in feet if ends.many]
    missed = [ends for ends in fitted if not ends.complete]
    silent = [f"{ends.world} {ends.seed}" for ends in missed if not ends.open]
    where, complete = f"of {len(fitted)} feet", len(fitted) - len(missed)
    rows = [
        at_most(f"a better end is missed in silence, {where}", len(silent), 0),
        told(f"both ends found, {where}", f"{complete}", f"{feet[0].starts} starts"),
        told(f"no result, of {len(feet)} feet", f"{len(feet) - len(fitted)}"),
    ]
    if silent:
        rows.append(told("missed in silence", ", ".join(silent)))
    durations = np.transpose([ends.seconds for ends in feet])
    for name, seconds in zip(("default", "many"), durations, strict=True):
        median, worst = f"{np.median(seconds):.3g} s", f"worst {seconds.max():.3g} s"
        rows.append(told(f"CPU time of a fit, {name} starts, median", median, worst))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    feet: Annotated[int, typer.Option(min=1, help="how many, over all worlds in turn")] = 60,
    starts: Annotated[int, typer.Option(min=2, help="of the fit to compare with")] = 200,
    jobs: Annotated[int, typer.Option(min=1, help="processes")] = 2,
    first: Annotated[int, typer.Option(min=0, help="first seed")] = 0,
    state: Annotated[Path, typer.Option(help="file of what is done")] = Path("search.jsonl"),
    json_: JsonOption = False,
) -> None:
    """Whether a fit finds the best end on each side, or says that it may not have.

    Examples:
      python -m benchmarks.search

      python -m benchmarks.search --feet 6 --starts 50
    """
    report("search", measure(feet, starts, jobs, state, first), json_)


if __name__ == "__main__":
    command_line(app)
