"""Coverage and verdicts of fits of legs that depart from the model.

The recordings come from worlds.py, which shares no code with the fit and says what an interval must
hold. Each member of the population is one leg and one session of one to three loads, fitted as a
user fits it, with what a laboratory knows. A fit is wrong where it decides for the other side of
the mirror's axis and its intervals do not hold: near the axis both sides are nearly one foot.

What is done is kept in a file and not done again while neither the fit nor the worlds change.
"""

import itertools
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import typer
from rich.progress import Progress

from benchmarks import kept
from benchmarks.kept import ROOT
from benchmarks.table import JsonOption, report
from fasbody.console import command_line, console, progress_bar
from fasbody.exceptions import FasError, SettingError
from fasbody.recording.recording import Recording
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.parameters import names
from identification.result import Branch, FitResult
from reproduction.check import Check, at_least, at_most, told, within
from simulator.worlds import CLEAN, SCATTER_3, SOURCES, STRONG, WORLDS, Member, member, recordings

#: Constants whose intervals are counted.
COUNTED = ("k_T", "k_F", "c_11", "c_21")
#: Legs a world from which on something is required of it.
ENOUGH = 14
#: Largest share of wrong legs; least share [%] of identified intervals that hold, of all worlds and
#: of each; least share [%] of legs that are decided where recordings scatter by 3 %.
WRONG, HOLD, HOLD_BY_WORLD, DECIDE = 1 / 200, 93.0, 85.0, 80.0
#: Word for an interval that the fit withholds.
WITHHELD = "withheld"
#: Clean legs from which on the coverage of their intervals is judged.
_COVERED = 100
#: What a fit comes to.
OUTCOMES = ("right", "wrong", "undecided", "nothing offered")
Row = TypeVar("Row")


@dataclass(frozen=True)
class Interval:
    """The 95 % interval of a constant on the branch that counts, beside the truth.

    Attributes:
        word: "identified", "weak" or "not identifiable", or `WITHHELD`.
        holds: it holds what a right one may (`Member.truth`).
        strict: it holds the value at rest, without load.
    """

    word: str
    holds: bool
    strict: bool


@dataclass(frozen=True)
class Judged:
    """One member and the verdict of its fit.

    Attributes:
        world: of the member.
        seed: of the member.
        strength: of the member.
        loads: how many.
        verdict: the fit's word; "none" where it refused.
        true_first: the branch named first is the true one.
        true_is_open: the true branch is among those that are open.
        intervals: of the true branch where it is open, else of the first.
        excess: chi-square a degree of freedom.
        seconds: CPU time of the fit [s].
        why: the refusal.
        ratio: log likelihood ratio of the branch named first over the other.
        exhausted: each side's best end was reached twice.
    """

    world: str
    seed: int
    strength: float
    loads: int
    verdict: str
    true_first: bool
    true_is_open: bool
    intervals: dict[str, Interval]
    excess: float
    seconds: float
    why: str = ""
    ratio: float = 0.0
    exhausted: bool = False

    @property
    def offered(self) -> list[Interval]:
        """The intervals that are not withheld."""
        return [interval for interval in self.intervals.values() if interval.word != WITHHELD]

    @property
    def identified(self) -> list[Interval]:
        """The intervals called identified."""
        return [interval for interval in self.offered if interval.word == "identified"]

    @property
    def across(self) -> bool:
        """Whether the fit decided for the other side of the axis."""
        return self.verdict == "decided" and not self.true_first

    @property
    def outcome(self) -> str:
        """One of `OUTCOMES`."""
        holds = bool(self.offered) and all(interval.holds for interval in self.offered)
        if self.verdict == "decided":
            return "wrong" if self.across and not holds else "right"
        return "undecided" if self.offered else "nothing offered"


def fitted(data: Sequence[Recording], exclude: Sequence[str] = ()) -> FitResult:
    """The public fit, as a user calls it."""
    from fasbody.foot.model import load
    from identification.fitting import fit_foot

    return fit_foot(data, load("two_dof"), threads=1, exclude=tuple(exclude))


def intervals_of(branch: Branch, truth: Member) -> dict[str, Interval]:
    """The intervals of the counted constants on a branch."""
    intervals = {}
    for name in COUNTED:
        key = next(key for key in branch.parameters if key.startswith(f"{name}_"))
        e, (low, high), rest = branch.parameters[key], truth.truth[name], getattr(truth.leg, name)
        word = WITHHELD if np.isnan([e.lower, e.upper]).any() else e.identifiability
        holds, strict = e.lower <= high and low <= e.upper, e.lower <= rest <= e.upper
        intervals[name] = Interval(word, bool(holds), bool(strict))
    return intervals


def judged(truth: Member, result: FitResult, seconds: float) -> Judged:
    """A result compared with the truth."""
    name = STIFF_ANKLE if truth.stiff_ankle else STIFF_PAD
    open_branches = {branch.name: branch for branch in result.open}
    branch = open_branches.get(name, result.best)
    return Judged(
        truth.world, truth.seed, truth.strength, len(truth.loads_kg), result.verdict, result.best.name == name,
        name in open_branches, intervals_of(branch, truth), result.best.chi_square / max(1, result.best.dof), seconds,
        ratio=result.log_likelihood_ratio,
        exhausted=all(branch.departures.exhausted for branch in result.branches if branch.departures),
    )  # fmt: skip


def trial(world: str, seed: int, exclude: Sequence[str] = ()) -> Judged:
    """Record, fit and judge one member; `exclude` names the nuisances that its laboratory rules out."""
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
    files = [*SOURCES, ROOT / "benchmarks" / "reality.py", *kept.fit_sources()]
    return kept.digest(files, ",".join(sorted(exclude)))


def read(state: kept.Kept) -> list[Judged]:
    """What was done with these sources."""
    rows = state.rows()
    return [Judged(**{**r, "intervals": {k: Interval(**i) for k, i in r["intervals"].items()}}) for r in rows]


def _quiet() -> None:
    """Start of a worker: Ctrl-C is the parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def study(
    task: Callable[..., Row], work: Sequence[tuple[Any, ...]], jobs: int, progress: Progress
) -> Iterator[Row]:  # fmt: skip
    """What a task returns for each member, as they finish; Ctrl-C keeps what is done."""
    bar = progress.add_task("worlds", total=len(work))
    with ProcessPoolExecutor(jobs, get_context("spawn"), _quiet) as pool:
        futures = [pool.submit(task, *arguments) for arguments in work]
        try:
            for future in as_completed(futures):
                progress.advance(bar)
                yield future.result()
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            console.print("interrupted; the rows rest on what is done")


def seeds_of(world: str, count: int, first: int, strong: bool) -> list[int]:
    """So many seeds from the first on, or so many of those whose legs are strongly nonlinear."""
    seeds = (seed for seed in itertools.count(first) if not strong or member(world, seed).strength >= STRONG)
    return list(itertools.islice(seeds, count))


def measure(
    seeds: int,
    jobs: int,
    state: Path,
    worlds: Iterable[str] = WORLDS,
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
    by_world = [[(world, seed) for seed in seeds_of(world, seeds, first, strong)] for world in worlds]
    keys_in_turn = [key for keys in zip(*by_world, strict=True) for key in keys]
    done = {(j.world, j.seed): j for j in read(file)}
    work = [(*key, exclude) for key in keys_in_turn if key not in done]
    with progress_bar() as progress:
        for outcome in study(trial, work, jobs, progress) if work else ():
            done[outcome.world, outcome.seed] = outcome
            file.add(asdict(outcome))
    return rows_of([done[key] for key in keys_in_turn if key in done])


def rows_of(judgements: Sequence[Judged]) -> list[Check]:
    """What was required, over all worlds and by each."""
    if not judgements:
        return []
    n, wrong = len(judgements), sum(j.outcome == "wrong" for j in judgements)
    across, refused = sum(j.across for j in judgements) - wrong, sum(j.verdict == "none" for j in judgements)
    by_world = {j.world: [k for k in judgements if k.world == j.world] for j in judgements}
    return [
        at_most(f"wrong and decided, of {n} legs", wrong, WRONG * n),
        told("decided for the other side, and all intervals hold, legs", f"{across}", f"of {n}"),
        told("no result, legs", f"{refused}", f"of {n}"),
        _holding("all worlds", judgements, HOLD, ENOUGH * len(WORLDS)),
        *(_holding(world, members, HOLD_BY_WORLD, ENOUGH) for world, members in by_world.items()),
        *_decided(by_world),
        *_strict(judgements, by_world.get(CLEAN, [])),
        _seconds(judgements),
    ]


def _holding(where: str, judgements: Sequence[Judged], least: float, enough: int) -> Check:
    """How often intervals called identified hold the truth, and what the fits came to."""
    outcomes, offered = [j.outcome for j in judgements], [i.holds for j in judgements for i in j.offered]
    legs = ", ".join(f"{outcomes.count(outcome)} {outcome}" for outcome in OUTCOMES)
    text = f"{len(judgements)} legs: {legs}; {sum(offered)} of {len(offered)} intervals offered hold"
    what = f'"identified" holds the truth, {where}'
    held = [i.holds for j in judgements for i in j.identified]
    if not held:
        return told(what, "nothing identified", text)
    row = at_least(what, 100 * float(np.mean(held)), least, "%")
    row = replace(row, beside=f"{row.criterion} of {len(held)}; {text}")
    return _judged_from(enough, len(judgements), row)


def _decided(by_world: Mapping[str, Sequence[Judged]]) -> list[Check]:
    """How often a fit decides: where recordings scatter, in all worlds, and in none."""
    rows = []
    if scattering := by_world.get(SCATTER_3):
        share = 100 * float(np.mean([j.verdict == "decided" for j in scattering]))
        what = f"decided, {SCATTER_3}, two loads and nine frequencies, {len(scattering)} legs"
        rows.append(_judged_from(ENOUGH, len(scattering), at_least(what, share, DECIDE, "%")))
    all_ = [j for members in by_world.values() for j in members]
    for name, members in (("all", all_), (CLEAN, by_world.get(CLEAN, ()))):
        strong = [j for j in members if j.strength >= STRONG]
        right = sum(j.verdict == "decided" and j.outcome == "right" for j in strong)
        decided = sum(j.verdict == "decided" for j in members)
        text = f"of {len(members)}; strongly nonlinear and right: {right} of {len(strong)}"
        rows.append(told(f"decided, {name}", f"{decided}", text))
    return rows


def _strict(judgements: Sequence[Judged], clean: Sequence[Judged]) -> list[Check]:
    """How often intervals hold the value at rest and without load."""
    rows, held = [], [i.strict for j in judgements for i in j.identified]
    if held:
        what, strict = '"identified" holds the value at rest, without load', float(np.mean(held))
        rows.append(told(what, f"{100 * strict:.3g} %", f"of {len(held)}"))
    on_branch = [j for j in clean if j.true_is_open and j.offered]
    if on_branch:
        what = f"coverage of 95 % intervals inside the class, {len(on_branch)} legs"
        share = 100 * float(np.mean([i.strict for j in on_branch for i in j.offered]))
        rows.append(_judged_from(_COVERED, len(on_branch), within(what, share, 92.0, 98.0, "%")))
    return rows


def _seconds(judgements: Sequence[Judged]) -> Check:
    seconds = np.array([j.seconds for j in judgements])
    median, worst = f"{np.median(seconds):.3g} s", f"worst {seconds.max():.3g} s"
    return told("CPU time a fit, median", median, worst)


def _judged_from(enough: int, legs: int, row: Check) -> Check:
    """A row of which nothing is required unless there are legs enough."""
    if legs >= enough:
        return row
    text = f"{row.beside or row.criterion}, judged from {enough} legs on"
    return replace(row, beside=text, asked=False)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(help="legs per world; the study takes 14")] = 14,
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
