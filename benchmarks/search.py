"""Global search of a fit on each side of the mirror: the default starts against many.

A fit descends from a few starts on each side of the axis and compares the ends. Where many more
starts find a better one, odds and intervals of the default fit rest on the wrong end; it must then
say that its search is not exhausted. The many begin at the default's ends and everywhere else, with
the weights that the default settled on, so that ends are compared by one sum of squares. Feet are of
all worlds in turn.
"""

import time
from collections.abc import Sequence
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
from reproduction.check import Check, at_most, told
from simulator.worlds import SOURCES, WORLDS, member, recordings

#: Difference of two objectives (chi-square and prior) that makes two ends one.
SAME = 0.5
SIDES = 1, -1


@dataclass(frozen=True)
class Ends:
    """One foot, searched twice.

    Attributes:
        world: of the foot.
        seed: of the foot.
        starts: of a side in the second search.
        default: (2,) objective at the best end of each of `SIDES` by the default search; empty where the foot was
            refused.
        many: (2,) the same by both together.
        exhausted: (2,) whether the default says so.
        seconds: CPU time of both [s].
    """

    world: str
    seed: int
    starts: int
    default: Sequence[float]
    many: Sequence[float]
    exhausted: Sequence[bool]
    seconds: tuple[float, float]

    @property
    def missed(self) -> list[bool]:
        """Of each side, whether many starts found a better end."""
        return [one > other + SAME for one, other in zip(self.default, self.many, strict=True)]

    @property
    def silent(self) -> bool:
        """Whether a better end was missed on a side whose search is called exhausted."""
        return any(missed and done for missed, done in zip(self.missed, self.exhausted, strict=True))


def trial(world: str, seed: int, starts: int) -> Ends:
    """Record one foot, and search it twice."""
    from fasbody.foot.model import load
    from identification.optimiser import Effort, search
    from identification.setup import Settings, Setup

    began = time.process_time()
    try:
        problem = Setup.of(list(recordings(member(world, seed))), load("two_dof"), Settings()).problem()
        first = problem.variables.start(problem.variables.model_values)[None]
        default = search(problem, SIDES, first=first)
    except FasError:
        return Ends(world, seed, starts, [], [], [], (time.process_time() - began, 0.0))
    between = time.process_time()
    places = np.stack([optimum.q for optimum in default.optima])
    many = search(default.problem, SIDES, Effort(starts=starts, rounds=1), seed=1, estimate=False, first=places)
    seconds = between - began, time.process_time() - between
    one, other = ({o.sign: o for o in ends.optima} for ends in (default, many))
    best = [min(one[side].objective, other[side].objective) for side in SIDES]
    exhausted = [one[side].exhausted for side in SIDES]
    return Ends(world, seed, starts, [one[side].objective for side in SIDES], best, exhausted, seconds)


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
    missed = [ends for ends in fitted if any(ends.missed)]
    silent = [f"{ends.world} {ends.seed}" for ends in fitted if ends.silent]
    where, complete = f"of {len(fitted)} feet", len(fitted) - len(missed)
    rows = [
        at_most(f"a better end is missed in silence, {where}", len(silent), len(fitted) // 30),
        told(f"both ends found, {where}", f"{complete}", f"{feet[0].starts} starts"),
        told(f"refused, of {len(feet)} feet", f"{len(feet) - len(fitted)}"),
    ]
    if silent:
        rows.append(told("missed in silence", ", ".join(silent)))
    durations = np.transpose([ends.seconds for ends in feet])
    for name, seconds in zip(("default", "many"), durations, strict=True):
        median, worst = f"{np.median(seconds):.3g} s", f"worst {seconds.max():.3g} s"
        rows.append(told(f"CPU time of a search, {name} starts, median", median, worst))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    feet: Annotated[int, typer.Option(min=1, help="how many, over all worlds in turn")] = 60,
    starts: Annotated[int, typer.Option(min=2, help="of the search to compare with")] = 200,
    jobs: Annotated[int, typer.Option(min=1, help="processes")] = 2,
    first: Annotated[int, typer.Option(min=0, help="first seed")] = 0,
    state: Annotated[Path, typer.Option(help="file of what is done")] = Path("search.jsonl"),
    json_: JsonOption = False,
) -> None:
    """Count how often the search of a fit finds the best minimum of each branch, or warns that it may have missed it.

    Examples:
      python -m benchmarks.search

      python -m benchmarks.search --feet 6 --starts 50
    """
    report("search", measure(feet, starts, jobs, state, first), json_)


if __name__ == "__main__":
    command_line(app)
