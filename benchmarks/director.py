"""What the director foretells against what the fit then says, on virtual feet; sessions that run by themselves.

The feet and what their sensors record come from worlds.py and rig.py, which share no code with the plan
or the fit: legs of both branches, segment masses off by 10 % from what the scale and the table say, a
gain that is off by 1 %, recordings that repeat to 0 to 5 %. Each foot is recorded by the plan and by the
thesis' three loads, and fitted as a user fits it. A second population has springs twice as stiff.

The sessions run by themselves (`identification.plan.session`) on a shaker that misbehaves.

What is done is kept in a file and not done again while neither plan nor fit change.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks import kept
from benchmarks.table import JsonOption, report
from fasbody.console import command_line, progress_bar
from fasbody.exceptions import FasError
from fasbody.recording.recording import Recording
from identification.branches import EXCHANGED, STIFF_ANKLE, STIFF_PAD
from identification.parameters import names
from identification.plan.candidates import Step, thesis
from reproduction.check import Check, at_least, at_most, told, within
from simulator import rig
from simulator.rig import MASS_STD, Rig, Virtual, recorded, virtual
from simulator.worlds import SOURCES

ROOT = Path(__file__).parents[1]
#: What is compared: the plan, and the thesis' three loads.
PROTOCOLS = ("planned", "three loads")
#: Factors of the springs of each population, and repeatability of its people at most.
POPULATIONS, REPEATABILITY = {"usual": 1.0, "shifted": 2.0}, 0.05
#: Feet from which on something is required.
ENOUGH = 60
#: Bins of the foretold probability.
BINS = 5


@dataclass(frozen=True)
class Fitted:
    """One protocol on one foot.

    Attributes:
        population, protocol, seed: which.
        recordings, shaking_s: how many, how long.
        verdict: of the fit.
        right: the branch named first is the true one.
        half_width, holds: by constant, on the true branch where it is shown, else on the first.
        expected: half-widths that were foretold, the medians of the plan's feet.
        asked: half-widths that were asked for, drawn about these.
        probability: foretold, that the intervals become as asked and the branch is decided.
        plan_s, fit_s: CPU time.
        why: of a refusal.
    """

    population: str
    protocol: str
    seed: int
    recordings: int
    shaking_s: float
    verdict: str
    right: bool
    half_width: dict[str, float]
    holds: dict[str, bool]
    expected: dict[str, float]
    asked: dict[str, float]
    probability: float
    plan_s: float
    fit_s: float
    why: str = ""

    @property
    def met(self) -> bool:
        """Whether the fit decides and is as narrow as asked."""
        narrow = all(self.half_width.get(n, np.inf) <= share for n, share in self.asked.items())
        return self.verdict == "decided" and narrow


def _person(foot: Virtual, exclude: Sequence[str]) -> Any:
    from fasbody.foot.model import load
    from fasbody.recording.known import Known
    from identification.plan.prior import Person

    return Person(load("two_dof"), foot.body_kg, Known().overruled_by(MASS_STD, exclude=exclude), "made")


def trial(population: str, protocol: str, seed: int, exclude: Sequence[str]) -> Fitted:
    """Plan, record and fit; `exclude` names the nuisances that both leave out."""
    from identification.fitting import fit_foot
    from identification.plan.director import Director
    from identification.plan.shaker import Shaker

    foot = virtual(seed, POPULATIONS[population])
    rng = np.random.default_rng([seed, 5])
    scatter, factor = rng.uniform(0, REPEATABILITY), float(np.exp(rng.uniform(-1, 1)))
    began, person = time.process_time(), _person(foot, exclude)
    director = Director(person, Shaker(), seed=seed)
    director.aim(director.as_thesis())
    shaking = sum(step.seconds for step in thesis())
    steps = (
        director.session(len(thesis()) // 3, shaking)
        if protocol == "planned"
        else director.thesis()
    )
    expected = director.outlook(steps).half_width
    director.aim({name: min(factor * width, 9.0) for name, width in expected.items()})
    probability = director.outlook(steps).goal()
    planning = time.process_time() - began
    data = recorded(foot, steps, 1 + PROTOCOLS.index(protocol), float(scatter))
    began = time.process_time()
    done = Fitted(
        population, protocol, seed, len(steps), sum(s.seconds for s in steps), "none", False, {}, {}, expected,
        dict(director.asked), probability, planning, 0.0,
    )  # fmt: skip
    try:
        result = fit_foot(data, person.foot, threads=1, exclude=tuple(exclude), mass_std=MASS_STD)
    except FasError as error:
        return replace(done, fit_s=time.process_time() - began, why=str(error))
    name = STIFF_ANKLE if foot.leg.stiff_ankle else STIFF_PAD
    branch = {b.name: b for b in result.open}.get(name, result.best)
    half, holds = {}, {}
    for constant in EXCHANGED:
        e = next(e for key, e in branch.parameters.items() if key.startswith(f"{constant}_"))
        half[constant] = 0.5 * (e.upper - e.lower) / e.value
        holds[constant] = bool(e.lower <= getattr(foot.leg, constant) <= e.upper)
    return replace(
        done, verdict=result.verdict, right=result.best.name == name, half_width=half, holds=holds,
        fit_s=time.process_time() - began,
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
    from identification.plan.session import Session
    from identification.plan.shaker import Shaker

    foot = virtual(10_000 + seed)
    rig = Rig(foot, np.random.default_rng([seed, 77]))
    person = _person(foot, ("all",))
    waits, since = [0.0], [time.process_time()]

    def record(step: Step) -> Recording:
        waits.append(time.process_time() - since[0])
        try:
            return rig.record(step)
        finally:
            since[0] = time.process_time()

    shaker = Shaker(every_hz=5.0, loads_kg=(0.0, 4.5), seconds=4.0)
    asked = dict.fromkeys(EXCHANGED, 0.10)
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


def digest(exclude: Sequence[str], *rooms: str) -> str:
    """Of everything that these numbers depend on."""
    files = [*SOURCES, Path(rig.__file__), *kept.fit_sources()]
    for room in rooms:
        files += list((ROOT / room).glob("*.py"))
    return kept.digest(files, repr(tuple(exclude)))


def measure(feet: int, sessions: int, state: Path, exclude: Sequence[str] = (), first: int = 0) -> list[Check]:
    """Rows from so many feet and sessions, from the first seed on; what `state` holds is not done again."""
    keys = [
        (which, p, seed)
        for seed in range(first, first + feet)
        for p in PROTOCOLS
        for which in POPULATIONS
        if which == "usual" or p == PROTOCOLS[0]
    ]
    done = _kept(state, digest(exclude), keys, Fitted, lambda key: trial(key[0], key[1], key[2], exclude))
    rows = rows_of(done) if feet else []
    if sessions:
        file = state.with_suffix(".sessions.jsonl")
        rows += by_themselves(
            _kept(
                file,
                digest((), "fasbody/acquire"),
                [(seed,) for seed in range(first, first + sessions)],
                Ran,
                lambda key: session(key[0]),
            )
        )
    return rows


def _kept(
    state: Path, stamp: str, keys: Sequence[tuple[Any, ...]], of: Any, make: Callable[[Any], Any]
) -> list[Any]:
    """One result for each key, its first fields; those that a file holds are not made again."""
    file = kept.Kept(state, stamp)
    done = {tuple(row.values())[: len(keys[0]) if keys else 0]: of(**row) for row in file.rows()}
    with progress_bar() as progress:
        for key in progress.track(
            [key for key in keys if key not in done], description=of.__name__.lower()
        ):
            done[key] = make(key)
            file.add(asdict(done[key]))
    return [done[key] for key in keys]


def by_themselves(ran: Sequence[Ran]) -> list[Check]:
    """Rows from sessions on a rig that misbehaves."""
    held = [ok for r in ran for ok in r.holds.values()]
    ends = ", ".join(
        f"{word} {sum(r.ended == word for r in ran)}" for word in sorted({r.ended for r in ran})
    )
    wrong = sum(r.decided and not r.right for r in ran)
    over = [r for r in ran if r.peak_m_s2 > Rig.most_m_s2 or r.travel_m > Rig.most_m]
    peak, travel = max(r.peak_m_s2 for r in ran), 1e3 * max(r.travel_m for r in ran)
    still = [r for r in ran if not r.jumps]
    return [
        told("sessions that ended by themselves", f"{len(ran)}", ends),
        at_most(
            "sessions whose base exceeded a limit in a step without a jump",
            sum(r.crept for r in ran),
            0,
        ),
        told(
            "sessions whose base exceeded a limit at all",
            f"{len(over)}",
            f"of {len(ran)}, {len(ran) - len(still)} with jumps, {sum(r.ran_away > 0 for r in ran)} that ran away",
        ),
        told(
            "worst acceleration and travel of a base",
            f"{peak:.3g} m/s^2, {travel:.2g} mm",
            "limits 15 and 8",
        ),
        told(
            "the same where no gain jumped",
            f"{max([0.0, *(r.peak_m_s2 for r in still)]):.3g} m/s^2, "
            f"{1e3 * max([0.0, *(r.travel_m for r in still)]):.2g} mm",
            f"{len(still)} sessions",
        ),
        at_most(
            "longest time of a base beyond its acceleration",
            1e3 * max(r.beyond_s for r in ran),
            60.0,
            "ms",
        ),
        at_most("sessions with the output left on", sum(r.left_on for r in ran), 0),
        at_least("intervals that hold the truth", 100 * float(np.mean(held or [False])), 92.0, "%"),
        told(
            "decided, of these wrong", f"{sum(r.decided for r in ran)}, {wrong}", f"of {len(ran)}"
        ),
        told("changes of load a session", f"{np.mean([r.changes for r in ran]):.2g}", ""),
        told(
            "steps tried, of these failed",
            f"{sum(r.steps for r in ran)}, {sum(r.failed for r in ran)}",
            "",
        ),
        at_most("CPU time of a step, with the fit that confirms, worst", max(r.step_s for r in ran), 1.0, "s"),
    ]


def rows_of(feet: Sequence[Fitted]) -> list[Check]:
    """What was foretold, and what came."""
    rows: list[Check] = []
    for which, protocol in dict.fromkeys((f.population, f.protocol) for f in feet):
        mine = [f for f in feet if (f.population, f.protocol) == (which, protocol)]
        good, enough = [f for f in mine if f.half_width], len(mine) >= ENOUGH and which == "usual"
        title = protocol if which == "usual" else f"{protocol}, {which} population"
        count, shaking = (
            np.mean([f.recordings for f in mine]),
            np.mean([f.shaking_s for f in mine]) / 60,
        )
        rows.append(
            told(
                f"{title}: recordings, minutes of shaking",
                f"{count:.3g}, {shaking:.3g} min",
                f"of {len(mine)} feet",
            )
        )
        decided = [f for f in mine if f.verdict == "decided"]
        wrong = sum(not f.right for f in decided)
        rows.append(
            told(
                f"{title}: decided, of these wrong",
                f"{len(decided)}, {wrong}",
                f"{len(mine) - len(good)} refused",
            )
        )
        held = [ok for f in good for ok in f.holds.values()]
        share = 100 * float(np.mean(held)) if held else 0.0
        rows.append(
            _asked(within(f"{title}: coverage of 95 % intervals", share, 93.0, 100.0, "%"), enough)
        )
        for name in EXCHANGED:
            ratios = [f.half_width[name] / f.expected[name] for f in good]
            row = within(
                f"{title}: half-width of {name}, fitted over foretold, median",
                float(np.median(ratios)),
                0.9,
                1.15,
            )
            rows.append(_asked(row, enough))
        every = [f.half_width[name] / f.expected[name] for f in good for name in EXCHANGED]
        rows.append(
            _asked(within(f"{title}: all four", float(np.median(every)), 0.9, 1.15), enough)
        )
        rows += _calibration(title, mine, enough)
    plan = [f.plan_s for f in feet]
    rows.append(
        told("CPU time of a plan, median", f"{np.median(plan):.3g} s", f"worst {max(plan):.3g} s")
    )
    return rows


def _calibration(title: str, feet: Sequence[Fitted], enough: bool) -> list[Check]:
    """How often goals were met of which a probability was foretold, in equal bins of feet."""
    rows, order = [], sorted(feet, key=lambda f: f.probability)
    for part in filter(len, np.array_split(np.arange(len(order)), BINS)):
        some = [order[i] for i in part]
        foretold, met = (
            100 * float(np.mean(x)) for x in ([f.probability for f in some], [f.met for f in some])
        )
        row = within(
            f"{title}: goals met where {foretold:.0f} % are foretold",
            met,
            foretold - 10,
            foretold + 10,
            "%",
        )
        rows.append(_asked(row, enough))
    return rows


def _asked(row: Check, enough: bool) -> Check:
    return (
        row
        if enough
        else replace(row, beside=f"{row.criterion}, judged from {ENOUGH} feet on", asked=False)
    )


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    feet: Annotated[int, typer.Option(help="virtual feet; the statement takes 60")] = 60,
    sessions: Annotated[int, typer.Option(help="automatic sessions; the statement takes 50")] = 50,
    first: Annotated[int, typer.Option(help="first seed")] = 0,
    state: Annotated[Path, typer.Option(help="file that keeps what is done, to go on from")] = Path(
        "director.jsonl"
    ),
    exclude: Annotated[
        str,
        typer.Option(
            help="what plan and fit rule out: mount, relaxation, load, rocking, drift, all, or nothing"
        ),
    ] = "",
    json_: JsonOption = False,
) -> None:
    """Compare what a plan foretells with what the fit says, on feet that the plan did not know.

    Examples:
      python -m benchmarks.director --feet 16 --first 100 --sessions 0

      python -m benchmarks.director --feet 10 --sessions 0 --exclude all --state exact.jsonl
    """
    report("director", measure(feet, sessions, state, names(exclude) or (), first), json_)


if __name__ == "__main__":
    command_line(app)
