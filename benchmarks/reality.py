"""Is a result as sure as the world allows? Legs in worlds that depart from the model, fitted as a user fits them.

The recordings come from worlds.py, which shares no code with the fit. Each member of the population is one leg, one
session of one to three loads at nine frequencies, and one departure; the fit knows what a laboratory would know. What
it then says is counted: the branch it decides for, and whether the intervals that it calls identified hold the truth.

A world may make a constant a range: a spring that relaxes has another stiffness at every frequency. An interval holds
the truth if it holds any value of that range; the row "at rest, without load" asks for the constant itself.

What is done is kept in a file and not done again while neither the fit nor the worlds change.
"""

import itertools
import signal
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.progress import Progress

from benchmarks import kept
from benchmarks.kept import ROOT
from benchmarks.table import JsonOption, report
from benchmarks.worlds import CLEAN, WORLDS, Member, member, recordings
from fasbody.console import command_line, console, progress_bar
from fasbody.exceptions import FasError, SettingError
from fasbody.recording.recording import Recording
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.result import Branch, FitResult
from identification.space import names
from reproduction.check import Check, at_least, at_most, told, within

#: Constants whose intervals are counted.
COUNTED = ("k_T", "k_F", "c_11", "c_21")
STARTS = 4
#: Seeds a world below which nothing is required of its rates, and the largest share of wrong and decided results.
ENOUGH, WRONG = 20, 1 / 200
#: Strength of the dampers from which a leg counts as strongly nonlinear: the laboratory's own foot has 1.
STRONG = 0.7


@dataclass(frozen=True)
class Interval:
    """What was said of a constant on the branch that counts: how well it is known, and whether that is so.

    Attributes:
        word: "identified", "weak" or "not identifiable". holds: the 95 % interval holds a value that the constant has.
        strict: it holds the value at rest, without load.
    """

    word: str
    holds: bool
    strict: bool


@dataclass(frozen=True)
class Judged:
    """One member and what the fit said of it.

    Attributes:
        world, seed, strength, loads: of the member (loads: how many). verdict: the fit's word; "none" where it refused.
        true_first: the branch named first is the true one. true_shown: the true branch is among those shown.
        intervals: of the true branch where it is shown, else of the first. excess: chi-square a degree of freedom.
        seconds: CPU time of the fit. why: the refusal.
    """

    world: str
    seed: int
    strength: float
    loads: int
    verdict: str
    true_first: bool
    true_shown: bool
    intervals: dict[str, Interval]
    excess: float
    seconds: float
    why: str = ""

    @property
    def wrong_and_decided(self) -> bool:
        """Whether the fit decided for the branch that is not true."""
        return self.verdict == "decided" and not self.true_first

    @property
    def identified(self) -> list[Interval]:
        """The intervals called identified."""
        return [interval for interval in self.intervals.values() if interval.word == "identified"]


def fitted(data: Sequence[Recording], exclude: Sequence[str] = ()) -> FitResult:
    """The public fit, as a user calls it; the only place of this module that knows it."""
    from fasbody.foot.model import load
    from identification.estimate import fit_foot

    return fit_foot(data, load("two_dof"), starts=STARTS, threads=1, exclude=tuple(exclude))


def intervals_of(branch: Branch, truth: Member) -> dict[str, Interval]:
    """What a branch says of the counted constants."""
    found = {}
    for name in COUNTED:
        key = next(key for key in branch.parameters if key.startswith(f"{name}_"))
        e, (low, high), exact = branch.parameters[key], truth.ranges[name], getattr(truth.leg, name)
        found[name] = Interval(e.identifiability, e.lower <= high and low <= e.upper, e.lower <= exact <= e.upper)
    return found


def judged(truth: Member, result: FitResult, seconds: float) -> Judged:
    """What a result says, beside the truth."""
    name = STIFF_ANKLE if truth.leg.stiff_ankle else STIFF_PAD
    shown = {branch.name: branch for branch in result.open}
    branch = shown.get(name, result.best)
    return Judged(
        truth.world, truth.seed, truth.strength, len(truth.loads_kg), result.verdict, result.best.name == name,
        name in shown, intervals_of(branch, truth), result.best.chi_square / max(1, result.best.dof), seconds,
    )  # fmt: skip


def trial(world: str, seed: int, exclude: Sequence[str] = ()) -> Judged:
    """Record, fit and judge one member; `exclude` is what its laboratory says cannot be."""
    truth = member(world, seed)
    data = recordings(truth)
    began = time.process_time()
    try:
        result = fitted(data, exclude)
    except FasError as error:
        spent = time.process_time() - began
        return Judged(
            world, seed, truth.strength, len(truth.loads_kg), "none", False, False, {}, np.inf, spent, str(error)
        )
    return judged(truth, result, time.process_time() - began)


def digest(exclude: Sequence[str] = ()) -> str:
    """Of worlds and fit, and of what is excluded."""
    own = [ROOT / "benchmarks" / name for name in ("worlds.py", "reality.py")]
    return kept.digest([*own, *kept.fit_sources()], ",".join(sorted(exclude)))


def read(state: kept.Kept) -> list[Judged]:
    """What was done with these sources."""
    rows = state.rows()
    return [Judged(**{**r, "intervals": {k: Interval(**i) for k, i in r["intervals"].items()}}) for r in rows]


def _quiet() -> None:
    """Start of a worker: Ctrl-C is the parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def study(
    work: Sequence[tuple[str, int]], jobs: int, progress: Progress, exclude: Sequence[str] = ()
) -> Iterator[Judged]:
    """Members as they finish; Ctrl-C ends them and keeps what is done."""
    task = progress.add_task("worlds", total=len(work))
    with ProcessPoolExecutor(jobs, get_context("spawn"), _quiet) as pool:
        futures = [pool.submit(trial, world, seed, exclude) for world, seed in work]
        try:
            for future in as_completed(futures):
                progress.advance(task)
                yield future.result()
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            console.print("interrupted; the rows rest on what is done")


def seeds_of(world: str, count: int, first: int, strong: bool) -> list[int]:
    """So many seeds from the first on, or so many of those whose legs are strongly nonlinear."""
    found = (seed for seed in itertools.count(first) if not strong or member(world, seed).strength >= STRONG)
    return list(itertools.islice(found, count))


def measure(
    seeds: int,
    jobs: int,
    state: Path,
    worlds: Sequence[str] = WORLDS,
    first: int = 0,
    exclude: Sequence[str] = (),
    strong: bool = False,
) -> list[Check]:
    """Rows from so many seeds a world, from the first on; what `state` holds is not done again.

    Raises:
        SettingError: no seed, or an unknown world.
    """
    if seeds < 1:
        raise SettingError(f"--seeds is {seeds}; at least 1 is needed, and {ENOUGH} or more to judge a world.")
    for world in worlds:
        if world not in WORLDS:
            raise SettingError(f"--world is {world!r}; there are {', '.join(WORLDS)}.")
    file = kept.Kept(state, digest(exclude))
    each = [[(world, seed) for seed in seeds_of(world, seeds, first, strong)] for world in worlds]
    wanted = [key for keys in zip(*each, strict=True) for key in keys]
    done = {(j.world, j.seed): j for j in read(file)}
    work = [key for key in wanted if key not in done]
    with progress_bar() as progress:
        for found in study(work, jobs, progress, exclude) if work else ():
            done[found.world, found.seed] = found
            file.add(asdict(found))
    return rows_of([done[key] for key in wanted if key in done])


def rows_of(found: Sequence[Judged]) -> list[Check]:
    """What was required, over all worlds and by each."""
    if not found:
        return []
    n, rows = len(found), []
    wrong = [j for j in found if j.wrong_and_decided]
    rows.append(at_most(f"wrong and decided, of {n} legs", len(wrong), WRONG * n))
    alone = sum(not j.true_shown and not j.wrong_and_decided and j.verdict != "none" for j in found)
    rows.append(told("not decided, but only the wrong branch is shown, legs", f"{alone}", f"of {n}"))
    rows.append(told("no result, legs", f"{sum(j.verdict == 'none' for j in found)}", f"of {n}"))
    rows += _holding("all worlds", found, ENOUGH * len(WORLDS))
    said = [i for j in found for i in j.identified]
    if said:
        strict = 100 * float(np.mean([i.strict for i in said]))
        rows.append(told('"identified" holds the value at rest, without load', f"{strict:.3g} %", f"of {len(said)}"))
    for world in dict.fromkeys(j.world for j in found):
        members = [j for j in found if j.world == world]
        bad = sum(j.wrong_and_decided for j in members)
        rows += _holding(f"{world} ({len(members)} legs, {bad} wrong and decided)", members, ENOUGH)
    clean = [j for j in found if j.world == CLEAN and j.true_shown]
    if clean:
        share = 100 * float(np.mean([i.strict for j in clean for i in j.intervals.values()]))
        row = within(f"coverage of 95 % intervals inside the class, {len(clean)} legs", share, 92.0, 98.0, "%")
        rows.append(row if len(clean) >= 5 * ENOUGH else _unjudged(row, 5 * ENOUGH))
    for name, of in (("all", found), ("clean", [j for j in found if j.world == CLEAN])):
        decided = sum(j.verdict == "decided" for j in of)
        strong = [j for j in of if j.strength >= STRONG]
        right = sum(j.verdict == "decided" and j.true_first for j in strong)
        text = f"of {len(of)}; strongly nonlinear and right: {right} of {len(strong)}"
        rows.append(told(f"decided, {name}", f"{decided}", text))
    seconds = np.array([j.seconds for j in found])
    text = f"worst {seconds.max():.3g} s, {STARTS} starts"
    return [*rows, told("CPU time a fit, median", f"{np.median(seconds):.3g} s", text)]


def _holding(where: str, found: Sequence[Judged], enough: int) -> list[Check]:
    """How often intervals called identified hold the truth; nothing is required of fewer than enough legs."""
    said = [i for j in found for i in j.identified]
    what = f'"identified" holds the truth, {where}'
    if not said:
        return [told(what, "nothing identified", f"of {len(COUNTED) * len(found)}")]
    row = at_least(what, 100 * float(np.mean([i.holds for i in said])), 90.0, "%")
    row = replace(row, beside=f"{row.criterion} of {len(said)} ({len(COUNTED) * len(found)} intervals)")
    return [row if len(found) >= enough else _unjudged(row, enough)]


def _unjudged(row: Check, enough: int) -> Check:
    return replace(row, beside=f"{row.beside}, judged from {enough} legs on", asked=False)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(help="legs per world; the study takes 24")] = 24,
    jobs: Annotated[int, typer.Option(help="processes")] = 2,
    world: Annotated[list[str] | None, typer.Option(help="only this world; repeat it for more")] = None,
    first: Annotated[
        int, typer.Option(help="first seed; use others to judge what was changed after a look at these")
    ] = 0,
    exclude: Annotated[
        str | None, typer.Option(help="what the laboratory has excluded, as in identification.fit")
    ] = None,
    strong: Annotated[bool, typer.Option("--strong", help="only legs whose dampers are strongly nonlinear")] = False,
    state: Annotated[Path, typer.Option(help="file that keeps what is done, to go on from")] = Path("reality.jsonl"),
    json_: JsonOption = False,
) -> None:
    """Verdicts and intervals in worlds that depart from the model, made by a separate simulator.

    Examples:
      python -m benchmarks.reality --seeds 6

      python -m benchmarks.reality --world "sensor on tissue" --world clean
    """
    report("reality", measure(seeds, jobs, state, world or WORLDS, first, names(exclude) or (), strong), json_)


if __name__ == "__main__":
    command_line(app)
