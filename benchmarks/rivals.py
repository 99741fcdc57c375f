"""Which rival is named first for legs that depart from the model in one known way.

The recordings come from worlds.py, which shares no code with the ladder. What is done is kept in a file and not done
again while neither the worlds nor the ladder's numbers change; how rivals are ranked is computed from what is kept.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks import kept
from benchmarks.kept import ROOT
from benchmarks.table import JsonOption, report
from fasbody.console import command_line, progress_bar
from fasbody.exceptions import FasError, SettingError
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.rivals.ladder import LADDER, LINEAR
from identification.rivals.result import MODEL, Rival, Rivals, preferred
from reproduction.check import Check, at_least, told
from simulator.worlds import CLEAN, SOURCES, WORLDS, Member, member, recordings

#: A clean world whose dampers are linear.
STRAIGHT = "linear dampers"
#: What is named rightly in each world; in the clean ones the model, or the linear foot nested in it.
RIGHT = {
    CLEAN: "clean", STRAIGHT: "clean", "mass +5 %": "clean", "mass -5 %": "clean", "springs relax": "relaxing",
    "sensor on tissue": "mount", "exponential springs": "stiffening", "cubic springs": "stiffening",
    "stiffer under load": "load",
}  # fmt: skip
#: Named by nothing on the ladder.
OTHERS = ("gain and drift", "rocking", "mass +10 %", "mass -10 %")
ASKED = ("relaxing", "mount", "stiffening")
ENOUGH = 20

#: Rungs that say the same of the foot, by what they say.
KINDS = {"exponential": "stiffening", "polynomial": "stiffening"}


@dataclass(frozen=True)
class Run:
    """One member, what its rivals came to, and what the adequate ones shared.

    Attributes:
        rivals: of each, the numbers that it is ranked by, and k_T, k_F with their limits. shared: conclusion -> whether
            it is true, of those that all adequate rivals share. seconds: CPU time. why: the refusal.
    """

    world: str
    seed: int
    strength: float
    loads: int
    rivals: tuple[dict[str, Any], ...]
    shared: dict[str, bool]
    seconds: float
    why: str = ""

    @property
    def first(self) -> str:
        """What is named first, rungs that say the same as one; "clean" for the model and the linear foot."""
        if not self.rivals:
            return "none"
        name = preferred([_rival(row) for row in self.rivals])[0].name
        return "clean" if name in (MODEL, LINEAR) else KINDS.get(name, name)


def _rival(row: dict[str, Any]) -> Rival:
    """A rival with what ranking needs."""
    rung = next(rung for rung in LADDER if rung.name == row["name"])
    return Rival(
        row["name"], rung.title, row["free"], row["chi_square"], row["dof"], row["bic"], row["held_out"], 0.0, "",
        None, None, None, None, None, (), {}, (), True, bool(rung.constants), row["repeatability"],
    )  # fmt: skip


def person(world: str, seed: int) -> Member:
    """One leg in one world; the straight one is a clean one without bends."""
    if world != STRAIGHT:
        return member(world, seed)
    made = member(CLEAN, 1000 + seed)
    return replace(made, seed=seed, leg=replace(made.leg, c_12=0.0, c_13=0.0, c_22=0.0, c_23=0.0), strength=0.0)


def trial(world: str, seed: int) -> Run:
    """Record one member, and compare rivals on it."""
    from identification.rivals.compare import compare_rivals

    truth = person(world, seed)
    data = recordings(truth)
    began = time.process_time()
    try:
        result = compare_rivals(data)
    except FasError as error:
        spent = time.process_time() - began
        return Run(world, seed, truth.strength, len(truth.loads_kg), (), {}, spent, str(error))
    rows = tuple(
        {
            "name": r.name, "free": r.free, "chi_square": r.chi_square, "dof": r.dof, "bic": r.bic,
            "held_out": dict(r.held_out), "branch": r.branch, "log_odds": r.log_odds, "repeatability": r.repeatability,
            "k_T": [r.k_T.value, r.k_T.lower, r.k_T.upper], "k_F": [r.k_F.value, r.k_F.lower, r.k_F.upper],
        }
        for r in result.rivals if r.k_T and r.k_F
    )  # fmt: skip
    spent = time.process_time() - began
    return Run(world, seed, truth.strength, len(truth.loads_kg), rows, truths(truth, result), spent)


def truths(truth: Member, result: Rivals) -> dict[str, bool]:
    """Conclusions that all adequate rivals share, and whether they are true.

    Rivals with springs that relax, and without, share any stiffness from rest to mid-band.
    """
    agreement = {}
    for conclusion in result.conclusions:
        if not conclusion.shared:
            continue
        if conclusion.what in ("k_T", "k_F"):
            any_of = (*truth.truth[conclusion.what], getattr(truth.leg, conclusion.what))
            low, high = min(any_of), max(any_of)
            assert conclusion.lower is not None and conclusion.upper is not None
            agreement[conclusion.what] = bool(conclusion.lower <= high and low <= conclusion.upper)
        elif conclusion.what == "branch":
            agreement["branch"] = conclusion.text.endswith(STIFF_ANKLE if truth.leg.stiff_ankle else STIFF_PAD)
        else:
            agreement["stiffer"] = conclusion.text.startswith("k_T" if truth.leg.k_T > truth.leg.k_F else "k_F")
    return agreement


def digest() -> str:
    """Of everything that a run's numbers depend on."""
    files = [*SOURCES, ROOT / "fasbody" / "foot" / "two_mass.py"]
    fit = ("harmonics", "nuisances", "parameters", "residual", "optimiser", "intervals", "motion")
    files += [ROOT / "identification" / f"{name}.py" for name in fit]
    files += [ROOT / "identification" / "rivals" / f"{name}.py" for name in ("ladder", "motion", "search")]
    return kept.digest(files)


def measure(seeds: int, state: Path, worlds: Sequence[str]) -> list[Check]:
    """Rows from so many seeds a world; what `state` holds is not done again.

    Raises:
        SettingError: no seed, or an unknown world.
    """
    if seeds < 1:
        raise SettingError(f"--seeds is {seeds}; at least 1 is needed, and {ENOUGH} or more to judge a world.")
    valid = (*WORLDS, STRAIGHT)
    for world in worlds:
        if world not in valid:
            raise SettingError(f"--world is {world!r}; there are {', '.join(valid)}.")
    file = kept.Kept(state, digest())
    keys = [(world, seed) for seed in range(seeds) for world in worlds]
    done = {
        (run.world, run.seed): run for run in (Run(**{**row, "rivals": tuple(row["rivals"])}) for row in file.rows())
    }
    work = [key for key in keys if key not in done]
    with progress_bar() as progress:
        for key in progress.track(work, description="worlds"):
            done[key] = trial(*key)
            file.add(vars(done[key]))
    return rows_of([done[key] for key in keys if key in done])


def confusion(runs: Sequence[Run]) -> dict[str, dict[str, int]]:
    """World -> what was named first -> how often."""
    table: dict[str, dict[str, int]] = {}
    for run in runs:
        row = table.setdefault(run.world, {})
        row[run.first] = row.get(run.first, 0) + 1
    return table


def rows_of(runs: Sequence[Run]) -> list[Check]:
    """What was required, and the confusion table."""
    if not runs:
        return []
    rows = []
    for kind in ASKED:
        of = [run for run in runs if RIGHT.get(run.world) == kind]
        if of:
            rows.append(_share(f"{kind} named first, {len(of)} legs", [run.first == kind for run in of], 80.0))
    clean = [run for run in runs if RIGHT.get(run.world) == "clean"]
    if clean:
        what = f"none preferred to the model in clean worlds, {len(clean)} legs"
        rows.append(_share(what, [run.first == "clean" for run in clean], 90.0))
    for world, row in confusion(runs).items():
        text = ", ".join(f"{name} {count}" for name, count in sorted(row.items(), key=lambda item: -item[1]))
        rows.append(told(f"named first, {world}", text, f"of {sum(row.values())}"))
    conclusions = [true for run in runs for true in run.shared.values()]
    if conclusions:
        wrong = len(conclusions) - sum(conclusions)
        rows.append(told("conclusions that all adequate rivals share", f"{len(conclusions)}", f"{wrong} of them wrong"))
        by = {run.world: 0 for run in runs}
        for run in runs:
            by[run.world] += sum(not true for true in run.shared.values())
        rows.append(
            told("wrong shared conclusions by world", ", ".join(f"{w} {n}" for w, n in by.items() if n) or "none")
        )
    seconds = np.array([run.seconds for run in runs])
    return [*rows, told("CPU time a comparison, median", f"{np.median(seconds):.3g} s", f"worst {seconds.max():.3g} s")]


def _share(what: str, hits: Sequence[bool], least: float) -> Check:
    row = at_least(what, 100 * float(np.mean(hits)), least, "%")
    if len(hits) >= ENOUGH:
        return row
    return replace(row, beside=f"{row.criterion}, judged from {ENOUGH} legs on", asked=False)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(help="legs per world; 20 take about half an hour")] = 20,
    world: Annotated[list[str] | None, typer.Option(help="only this world; repeat it for more")] = None,
    state: Annotated[Path, typer.Option(help="file that keeps what is done, to go on from")] = Path("rivals.jsonl"),
    json_: JsonOption = False,
) -> None:
    """Which rival is named in worlds that depart from the model, made by a separate simulator.

    Examples:
      python -m benchmarks.rivals --seeds 6

      python -m benchmarks.rivals --world "sensor on tissue" --world clean
    """
    report("rivals", measure(seeds, state, world or [*RIGHT, *OTHERS]), json_)


if __name__ == "__main__":
    command_line(app)
