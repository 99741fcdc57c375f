"""Planned sessions with a third of the recordings against the thesis' protocol, on virtual feet; automatic sessions.

The feet and what their sensors record come from worlds.py, which shares no code with the plan or the fit: legs of both
branches, segment masses off by 10 % from what the scale and the table say, a gain that is off by 1 %. Each foot is
recorded three times, by the plan, by the thesis' three loads and by its unloaded part, and fitted as a user fits it.

The sessions run by themselves (`identification.plan.session`) on a shaker that misbehaves.

What is done is kept in a file and not done again while neither plan nor fit change.
"""

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.table import JsonOption, report
from fasbody.console import command_line, progress_bar
from fasbody.exceptions import FasError
from fasbody.recording.recording import Recording
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.parameters import names
from identification.plan.candidates import Step, thesis
from reproduction.check import Check, at_least, at_most, told, within
from simulator import rig
from simulator.rig import MASS_STD, Rig, Virtual, recorded, virtual
from simulator.worlds import SOURCES

ROOT = Path(__file__).parents[1]
COUNTED = ("k_T", "k_F", "c_11", "c_21")
#: What is compared: the plan, the thesis' three loads, and its unloaded part.
PROTOCOLS = ("planned", "three loads", "one load")
STARTS = 4
#: Nuisances that plan and fit exclude by default; masses, gain and delay remain.
EXCLUDED = ("all",)
#: Repeatability of these recordings: exact, unlike a person's. The plan has the same value.
REPEATABILITY = 0.0
#: Feet from which on something is required.
ENOUGH = 100


@dataclass(frozen=True)
class Fitted:
    """One protocol on one foot.

    Attributes:
        protocol: which. seed, strength: of the foot. recordings, shaking_s: how many, how long. verdict: of the fit.
        right: the branch named first is the true one. half_width, holds: by constant, on the true branch where it is
            shown, else on the first. expected: half-widths that the plan predicts for such feet.
        plan_s, fit_s: CPU time. why: of a refusal.
    """

    protocol: str
    seed: int
    strength: float
    recordings: int
    shaking_s: float
    verdict: str
    right: bool
    half_width: dict[str, float]
    holds: dict[str, bool]
    expected: dict[str, float]
    plan_s: float
    fit_s: float
    why: str = ""


def planned(foot: Virtual, exclude: Sequence[str]) -> tuple[tuple[Step, ...], dict[str, float]]:
    """A session with a third of the thesis' recordings, planned from the body mass alone, and its half-widths."""
    from fasbody.foot.model import load
    from fasbody.recording.known import Known
    from identification.plan.director import Director
    from identification.plan.prior import Person
    from identification.plan.shaker import Shaker

    person = Person(load("two_dof"), foot.body_kg, Known().overruled_by(MASS_STD, exclude=exclude), "made")
    director = Director(person, Shaker(repeatability=REPEATABILITY), seed=foot.seed)
    director.aim(director.as_thesis())
    steps = director.session(len(thesis()) // 3, sum(step.seconds for step in thesis()))
    return steps, dict(director.outlook(steps).half_width)


def trial(protocol: str, seed: int, exclude: Sequence[str] = EXCLUDED) -> Fitted:
    """Plan, record and fit; `exclude` names the nuisances that both leave out."""
    from fasbody.foot.model import load
    from identification.fitting import fit_foot

    foot, model = virtual(seed), load("two_dof")
    expected: dict[str, float] = {}
    began = time.process_time()
    if protocol == "planned":
        steps, expected = planned(foot, exclude)
    else:
        steps = thesis() if protocol == "three loads" else thesis((0.0,))
    spent_on_plan = time.process_time() - began
    shaking = sum(step.seconds for step in steps)
    data = recorded(foot, steps, PROTOCOLS.index(protocol))
    began = time.process_time()
    try:
        result = fit_foot(data, model, starts=STARTS, threads=1, exclude=tuple(exclude), mass_std=MASS_STD)
    except FasError as error:
        spent = time.process_time() - began
        return Fitted(
            protocol, seed, foot.strength, len(steps), shaking, "none", False, {}, {}, expected, spent_on_plan, spent,
            str(error),
        )  # fmt: skip
    spent = time.process_time() - began
    name = STIFF_ANKLE if foot.leg.stiff_ankle else STIFF_PAD
    branch = {b.name: b for b in result.open}.get(name, result.best)
    half, holds = {}, {}
    for constant in COUNTED:
        e = next(e for key, e in branch.parameters.items() if key.startswith(f"{constant}_"))
        half[constant] = 0.5 * (e.upper - e.lower) / e.value
        holds[constant] = bool(e.lower <= getattr(foot.leg, constant) <= e.upper)
    return Fitted(
        protocol, seed, foot.strength, len(steps), shaking, result.verdict, result.best.name == name, half, holds,
        expected, spent_on_plan, spent,
    )  # fmt: skip


@dataclass(frozen=True)
class Ran:
    """One session that ran by itself.

    Attributes:
        seed: of foot and rig. ended: why. steps, failed, shaking_s: tried, of these in vain, and how long.
        decided, right: the branch. holds, half_width: of the main constants. changes: of the load. peak_m_s2, travel_m,
        beyond_s, jumps, ran_away, crept: see `Rig`. left_on: the output was on at the end. step_s: worst CPU time from
        one recording to the next.
    """

    seed: int
    ended: str
    steps: int
    failed: int
    shaking_s: float
    decided: bool
    right: bool
    holds: dict[str, bool]
    half_width: dict[str, float]
    changes: int
    peak_m_s2: float
    travel_m: float
    beyond_s: float
    jumps: int
    ran_away: int
    crept: bool
    left_on: bool
    step_s: float


def session(seed: int) -> Ran:
    """A session with --auto on a rig that misbehaves."""
    from fasbody.foot.model import load
    from fasbody.recording.known import Known
    from identification.plan.prior import Person
    from identification.plan.session import Session
    from identification.plan.shaker import Shaker

    foot = virtual(10_000 + seed)
    rig = Rig(foot, np.random.default_rng([seed, 77]))
    person = Person(load("two_dof"), foot.body_kg, Known().overruled_by(MASS_STD, exclude=("all",)), "made")
    waits, since = [0.0], [time.process_time()]

    def record(step: Step) -> Recording:
        waits.append(time.process_time() - since[0])
        try:
            return rig.record(step)
        finally:
            since[0] = time.process_time()

    shaker = Shaker(every_hz=5.0, loads_kg=(0.0, 4.5), seconds=4.0, repeatability=REPEATABILITY)
    asked = dict.fromkeys(COUNTED, 0.10)
    done = Session(person, shaker, asked, 9, 120.0, seed, 6, record).run()
    last = done.good[-1] if done.good else None
    name = STIFF_ANKLE if foot.leg.stiff_ankle else STIFF_PAD
    bands = dict(last.bands) if last else {}
    loads = [t.step.added_mass_kg for t in done.taken]
    return Ran(
        seed, done.ended, len(done.taken), len(done.taken) - len(done.good), sum(t.step.seconds for t in done.good),
        bool(last and last.decided), bool(last and last.branch == name),
        {n: bool(b.lower <= getattr(foot.leg, n) <= b.upper) for n, b in bands.items()},
        {n: b.half_width for n, b in bands.items()}, sum(a != b for a, b in pairwise(loads)), float(rig.peak_m_s2),
        float(rig.travel_m), float(rig.beyond_s), rig.jumps, rig.ran_away, bool(rig.crept), rig.is_on,
        max(waits[2:] or [0.0]),
    )  # fmt: skip


def digest(plan: bool, *rooms: str, exclude: Sequence[str] = EXCLUDED) -> str:
    """Of everything that a fit of these feet depends on: worlds, fit and models, and what is planned for two."""
    facts = [*map(str, exclude), *([planned(virtual(seed), exclude)[0] for seed in (0, 1)] if plan else [])]
    sha = hashlib.sha256(repr(facts).encode())
    files = [*SOURCES, Path(rig.__file__)]
    for room in ("identification", "identification/engines", "fasbody/foot", *rooms):
        files += list((ROOT / room).glob("*.py"))
    for file in sorted(files):
        sha.update(file.read_bytes())
    return sha.hexdigest()[:16]


def read(file: Path, stamps: Mapping[str, str]) -> list[Fitted]:
    """What was done with these sources; a line cut off by an interruption is not."""
    done = []
    for line in file.read_text().splitlines() if file.is_file() else []:
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if row.pop("digest", None) == stamps[row["protocol"]]:
            done.append(Fitted(**row))
    return done


def measure(feet: int, sessions: int, state: Path, exclude: Sequence[str] = EXCLUDED) -> list[Check]:
    """Rows from so many feet and sessions; what `state` holds is not done again."""
    rows = compared(feet, state, exclude) if feet else []
    return [*rows, *(by_themselves(sessions, state.with_suffix(".sessions.jsonl")) if sessions else [])]


def by_themselves(sessions: int, state: Path) -> list[Check]:
    """Rows from so many sessions on a rig that misbehaves."""
    stamp = digest(True, "identification/plan", "fasbody/acquire")
    lines = [json.loads(line) for line in state.read_text().splitlines()] if state.is_file() else []
    done = {row["seed"]: Ran(**row) for row in lines if row.pop("digest") == stamp}
    with progress_bar() as progress, state.open("a") as file:
        for seed in progress.track([s for s in range(sessions) if s not in done], description="sessions"):
            done[seed] = session(seed)
            file.write(json.dumps({**asdict(done[seed]), "digest": stamp}) + "\n")
            file.flush()
    ran = [done[seed] for seed in range(sessions)]
    held = [ok for r in ran for ok in r.holds.values()]
    ends = ", ".join(f"{word} {sum(r.ended == word for r in ran)}" for word in sorted({r.ended for r in ran}))
    wrong = sum(r.decided and not r.right for r in ran)
    over = [r for r in ran if r.peak_m_s2 > Rig.most_m_s2 or r.travel_m > Rig.most_m]
    peak, travel = max(r.peak_m_s2 for r in ran), 1e3 * max(r.travel_m for r in ran)
    still = [r for r in ran if not r.jumps]
    return [
        told("sessions that ended by themselves", f"{len(ran)}", ends),
        at_most("sessions whose base exceeded a limit in a step without a jump", sum(r.crept for r in ran), 0),
        told(
            "sessions whose base exceeded a limit at all",
            f"{len(over)}",
            f"of {len(ran)}, {len(ran) - len(still)} with jumps, {sum(r.ran_away > 0 for r in ran)} that ran away",
        ),
        told("worst acceleration and travel of a base", f"{peak:.3g} m/s^2, {travel:.2g} mm", "limits 15 and 8"),
        told(
            "the same where no gain jumped",
            f"{max([0.0, *(r.peak_m_s2 for r in still)]):.3g} m/s^2, "
            f"{1e3 * max([0.0, *(r.travel_m for r in still)]):.2g} mm",
            f"{len(still)} sessions",
        ),
        at_most("longest time of a base beyond its acceleration", 1e3 * max(r.beyond_s for r in ran), 60.0, "ms"),
        at_most("sessions with the output left on", sum(r.left_on for r in ran), 0),
        at_least("intervals that hold the truth", 100 * float(np.mean(held or [False])), 92.0, "%"),
        told("decided, of these wrong", f"{sum(r.decided for r in ran)}, {wrong}", f"of {len(ran)}"),
        told("changes of load a session", f"{np.mean([r.changes for r in ran]):.2g}", ""),
        told("steps tried, of these failed", f"{sum(r.steps for r in ran)}, {sum(r.failed for r in ran)}", ""),
        at_most("CPU time of a step, worst", max(r.step_s for r in ran), 1.0, "s"),
    ]


def compared(feet: int, state: Path, exclude: Sequence[str]) -> list[Check]:
    """Rows from so many feet."""
    stamps = {protocol: digest(protocol == PROTOCOLS[0], exclude=exclude) for protocol in PROTOCOLS}
    keys = [(protocol, seed) for seed in range(feet) for protocol in PROTOCOLS[:2]]
    keys += [(PROTOCOLS[2], seed) for seed in range(feet)]
    done = {(f.protocol, f.seed): f for f in read(state, stamps)}
    with progress_bar() as progress, state.open("a") as file:
        for key in progress.track([key for key in keys if key not in done], description="feet"):
            done[key] = trial(*key, exclude)
            file.write(json.dumps({**asdict(done[key]), "digest": stamps[key[0]]}) + "\n")
            file.flush()
    return rows_of([done[key] for key in keys])


def rows_of(feet: Sequence[Fitted]) -> list[Check]:
    """What was asked, over all feet that every protocol recorded."""
    by: dict[str, dict[int, Fitted]] = {p: {f.seed: f for f in feet if f.protocol == p} for p in PROTOCOLS}
    seeds = sorted(s for s in by["planned"] if all(by[p][s].half_width for p in PROTOCOLS))
    rows: list[Check] = []
    enough = len(seeds) >= ENOUGH
    for p in PROTOCOLS:
        mine = list(by[p].values())
        count, n = np.mean([f.recordings for f in mine]), len(mine)
        minutes = np.mean([f.shaking_s for f in mine]) / 60
        decided = sum(f.verdict == "decided" for f in mine)
        wrong = sum(f.verdict == "decided" and not f.right for f in mine)
        rows.append(told(f"{p}: recordings, minutes of shaking", f"{count:.3g}, {minutes:.3g} min", f"of {n} feet"))
        rows.append(told(f"{p}: decided, of these wrong", f"{decided}, {wrong}", f"of {n}, {_none(mine)} refused"))
        widths = [_mean([by[p][s].half_width[name] for s in seeds]) for name in COUNTED]
        text = ", ".join(f"{name} {100 * w:.3g} %" for name, w in zip(COUNTED, widths, strict=True))
        rows.append(told(f"{p}: half-widths, geometric means", text, f"of {len(seeds)} feet"))
        held = [ok for f in mine for ok in f.holds.values()]
        share = 100 * float(np.mean(held)) if held else 0.0
        row = within(f"{p}: coverage of 95 % intervals", share, 92.0, 98.0, "%")
        rows.append(row if enough else replace(row, asked=False))
    for other, most in (("three loads", 1.15), ("one load", None)):
        for name in COUNTED:
            ratio = _mean([by["planned"][s].half_width[name] / by[other][s].half_width[name] for s in seeds])
            what = f"half-width of {name}, planned over {other}"
            if most is not None:
                row = at_most(what, ratio, most)
            else:
                row = at_most(what, ratio, 0.5) if name == "k_T" else told(what, f"{ratio:.3g}", "")
            rows.append(row if enough else replace(row, asked=False))
    third = np.mean([by["planned"][s].recordings / by["three loads"][s].recordings for s in seeds])
    rows.append(at_most("recordings, planned over three loads", float(third), 0.334))
    pace = np.mean([by["planned"][s].shaking_s / by["three loads"][s].shaking_s for s in seeds])
    rows.append(told("shaking, planned over three loads", f"{pace:.3g}", ""))
    foretold = [_mean([by["planned"][s].half_width[n] / by["planned"][s].expected[n] for s in seeds]) for n in COUNTED]
    rows.append(told("half-widths, fitted over foretold", ", ".join(f"{x:.3g}" for x in foretold), ", ".join(COUNTED)))
    plan = [f.plan_s for f in by["planned"].values()]
    rows.append(told("CPU time of a plan, median", f"{np.median(plan):.3g} s", f"worst {max(plan):.3g} s"))
    return rows


def _none(feet: Sequence[Fitted]) -> int:
    return sum(f.verdict == "none" for f in feet)


def _mean(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values)))) if values else float("nan")


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    feet: Annotated[int, typer.Option(help="virtual feet; the statement takes 100")] = 100,
    sessions: Annotated[int, typer.Option(help="automatic sessions; the statement takes 50")] = 50,
    state: Annotated[Path, typer.Option(help="file that keeps what is done, to go on from")] = Path("director.jsonl"),
    exclude: Annotated[
        str, typer.Option(help="what plan and fit rule out: mount, relaxation, load, rocking, drift, all, or nothing")
    ] = "all",
    json_: JsonOption = False,
) -> None:
    """Compare planned sessions with that of the thesis, on feet that the plan did not know.

    Examples:
      python -m benchmarks.director --feet 10

      python -m benchmarks.director --feet 10 --sessions 0 --exclude "" --state default.jsonl
    """
    report("director", measure(feet, sessions, state, names(exclude) or ()), json_)


if __name__ == "__main__":
    command_line(app)
