"""What a second sensor on the foot decides: nearly linear legs, which the malleolus alone leaves undecided.

The recordings come from worlds.py, which shares no code with the fit. Every fit has all nuisances in. Each leg is
recorded twice, without any departure, and as a laboratory has it: everything that the fit allows for is there at its
usual size, in each sensor for itself. Strongly nonlinear legs whose constants differ by 3 % from recording to
recording say what that does to natural frequencies and damping ratios. What is done is kept in a file and not done
again while no source changes.
"""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks import kept
from benchmarks.table import JsonOption, report
from fasbody.console import command_line, progress_bar
from fasbody.recording.recording import Recording
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.derived_quantities import derived
from identification.result import FitResult
from reproduction.check import Check, at_least, at_most, told
from simulator.departure import Following, Maxwell, Mount, Rocking
from simulator.instrument import Gain
from simulator.leg import SENSORS, Leg
from simulator.worlds import LOADS_KG, SCATTER_3, SOURCES, Member, leg_of, recordings
from simulator.worlds import member as world_member

#: Strength of the dampers' nonlinearity, that of a leg which the malleolus alone leaves undecided; noise over the base.
STRENGTH, NOISE = 0.03, 0.003
CLEAN, USUAL = "nothing departs", "everything at its usual size"
ALONE, WITH_FOOT = ("malleolus",), ("malleolus", "foot")
#: What is fitted, world by world.
TASKS = (
    (CLEAN, WITH_FOOT), (CLEAN, ALONE), (USUAL, WITH_FOOT), (USUAL, ALONE),
    (SCATTER_3, WITH_FOOT), (SCATTER_3, ALONE),
)  # fmt: skip
STARTS = 4
#: Feet and error that were asked for.
ENOUGH, CLOSE = 50, 0.05


@dataclass(frozen=True)
class Judged:
    """One leg and the verdict of its fit.

    Attributes:
        world, seed, sensors: what was fitted. verdict: of the fit. right: the branch named first is the true one.
        k_T, k_F: estimate on the true branch over the truth, less one; None where that is not shown.
        holds: whether the 95 % intervals of k_T and k_F hold the truth.
        frequencies, ratios: whether those of the first natural frequency and of its damping ratio do, by load.
        follows: the fit follows the recordings.
        seconds: CPU time.
    """

    world: str
    seed: int
    sensors: int
    verdict: str
    right: bool
    k_T: float | None
    k_F: float | None
    holds: tuple[bool, bool]
    frequencies: tuple[bool, ...]
    ratios: tuple[bool, ...]
    follows: bool
    seconds: float


def member(world: str, seed: int) -> Member:
    """One leg under two loads: nearly linear, and the same in two worlds; strongly nonlinear where it scatters."""
    if world == SCATTER_3:
        return world_member(world, seed)
    rng = np.random.default_rng([seed, 71])
    body = rng.uniform(45, 110)
    leg = leg_of(rng, body, STRENGTH)
    made = Member(f"second sensor, {world}", seed, leg, (), LOADS_KG[:2], NOISE, STRENGTH, body)
    return made if world == CLEAN else usual(made, np.random.default_rng([seed, 72]))


def usual(made: Member, rng: np.random.Generator) -> Member:
    """The leg with everything that a laboratory cannot exclude, at its usual size."""
    n = rng.normal
    (ankle, pad), tau_s = np.abs(n(0, 0.35, 2)).clip(0, 0.8), float(np.exp(n(np.log(5e-3), 0.5)))
    turning_hz = 60 * float(np.exp(n(0, 0.15)))
    rocking = Rocking(n(0, 0.03), turning_hz, rng.uniform(0.06, 0.15), foot=n(0, 0.03))
    hz, zeta = 1e2 / np.sqrt(np.abs(n(0, 1.0, 2)).clip(1e-2, 1.6)), rng.uniform(0.1, 0.3, 2)
    mounts = (Mount(hz[i], zeta[i], sensor) for i, sensor in enumerate(SENSORS))
    departures = Following(n(0, 0.05)), Maxwell(ankle, pad, tau_s), rocking, *mounts
    gains = tuple(Gain(n(0, 0.01), n(0, 0.01), sensor) for sensor in SENSORS)
    stated = made.body_kg * float(np.exp(n(0, 0.05)))
    return replace(made, body_kg=stated, departures=departures, instruments=gains)


def judged(truth: Member, data: Sequence[Recording], sensors: tuple[str, ...], world: str) -> Judged:
    """Fit as a user does, and judge."""
    from fasbody.foot.model import load
    from identification.fitting import fit_foot

    began = time.process_time()
    result = fit_foot(data, load("two_dof"), starts=STARTS, threads=1, sensors=sensors)
    spent = time.process_time() - began
    name = STIFF_ANKLE if truth.stiff_ankle else STIFF_PAD
    branch = next((b for b in result.branches if b.name == name), None)
    off: dict[str, float | None] = {"k_T": None, "k_F": None}
    holds = {"k_T": False, "k_F": False}
    for constant in off if branch else ():
        assert branch is not None
        exact, e = truth.dynamic[constant], branch[constant]
        off[constant], holds[constant] = e.value / exact - 1, bool(e.lower <= exact <= e.upper)
    follows = result.departures is not None and result.departures.follows
    right = result.best.name == name
    about = (world, truth.seed, len(sensors), result.verdict, right, off["k_T"], off["k_F"])
    return Judged(*about, (holds["k_T"], holds["k_F"]), *modes_hold(truth, result), follows, spent)


def first_mode(leg: Leg, load_kg: float) -> tuple[float, float]:
    """Natural frequency [Hz] and damping ratio of the first mode of small motion."""
    chain = lambda ankle, pad: np.array([[ankle, -ankle], [-ankle, ankle + pad]])  # noqa: E731
    M, C, K = np.diag([leg.m_S + load_kg, leg.m_F]), chain(leg.c_11, leg.c_21), chain(leg.k_T, leg.k_F)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    pole = min(np.linalg.eigvals(A), key=abs)
    return float(abs(pole) / (2 * np.pi)), float(-pole.real / abs(pole))


def modes_hold(truth: Member, result: FitResult) -> tuple[tuple[bool, ...], tuple[bool, ...]]:
    """Whether the 95 % intervals of the first mode hold those of the linear leg, under each load."""
    rows = [row for row in derived(result).modes if row["branch"] == result.best.name and row["mode"] == 1]
    rows = [row for row in rows if row["basis"] == rows[0]["basis"]]
    frequencies, ratios = [], []
    for row in rows:
        hz, ratio = first_mode(truth.leg, row["added_mass_kg"])
        frequencies.append(bool(row["lower_hz"] <= hz <= row["upper_hz"]))
        ratios.append(bool(row["damping_lower"] <= ratio <= row["damping_upper"]))
    return tuple(frequencies), tuple(ratios)


def trial(world: str, sensors: tuple[str, ...], seed: int) -> Judged:
    """Record, fit and judge one leg."""
    truth = member(world, seed)
    return judged(truth, recordings(truth, foot=True), sensors, world)


def digest() -> str:
    """Of the worlds, and of everything that a fit depends on."""
    return kept.digest([*SOURCES, kept.ROOT / "benchmarks" / "sensors.py", *kept.fit_sources()])


def measure(feet: int, state: Path) -> list[Check]:
    """Rows from so many legs; what `state` holds is not done again."""
    file = kept.Kept(state, digest())
    before = [Judged(**row) for row in file.rows()]
    done = {(j.world, j.seed, j.sensors): j for j in before}
    keys = [(world, sensors, seed) for world, sensors in TASKS for seed in range(feet)]
    work = [key for key in keys if (key[0], key[2], len(key[1])) not in done]
    with progress_bar() as progress:
        for world, sensors, seed in progress.track(work, description="legs"):
            outcome = trial(world, sensors, seed)
            done[world, seed, len(sensors)] = outcome
            file.add(asdict(outcome))
    return rows_of([done[world, seed, len(sensors)] for world, sensors, seed in keys])


def rows_of(judgements: Sequence[Judged]) -> list[Check]:
    """The requirements on the second sensor, and the results of the malleolus alone."""
    rows = []
    for world, sensors in TASKS:
        legs = [j for j in judgements if (j.world, j.sensors) == (world, len(sensors))]
        if not legs:
            continue
        legs_ = "legs" if world == SCATTER_3 else "nearly linear legs"
        where = f"{' and '.join(sensors)}, {world}, {len(legs)} {legs_}"
        right = sum(j.verdict == "decided" and j.right for j in legs)
        wrong = sum(j.verdict == "decided" and not j.right for j in legs)
        off = np.array([abs(x) for j in legs for x in (j.k_T, j.k_F) if x is not None])
        holds = 100 * float(np.mean([held for j in legs for held in j.holds]))
        asked = (world, sensors) == (CLEAN, WITH_FOOT) and len(legs) >= ENOUGH
        if asked:
            rows.append(at_least(f"mirror decided, and rightly: {where}", right, len(legs)))
            rows.append(at_most(f"largest error of k_T and k_F: {where}", 100 * off.max(), 100 * CLOSE, "%"))
        else:
            rows.append(told(f"mirror decided, and rightly: {where}", f"{right}", f"wrongly: {wrong}"))
            text = f"median {100 * np.median(off):.2g} %"
            rows.append(told(f"largest error of k_T and k_F: {where}", f"{100 * off.max():.3g} %", text))
        missed = sum(not j.follows for j in legs)
        text = f"not followed by the wide fit: {missed}; CPU time a fit {np.median([j.seconds for j in legs]):.3g} s"
        rows.append(told(f"95 % intervals of k_T and k_F hold the truth: {where}", f"{holds:.3g} %", text))
        if world != USUAL:
            by_load = [[x for j in legs for x in of(j)] for of in (lambda j: j.frequencies, lambda j: j.ratios)]
            counts = " and ".join(f"{sum(hold)} of {len(hold)}" for hold in by_load)
            rows.append(told(f"those of the first natural frequency and its damping ratio: {where}", counts, ""))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    feet: Annotated[int, typer.Option(min=1, help="legs; the page uses 50")] = 50,
    state: Annotated[Path, typer.Option(help="file that keeps what is done, to go on from")] = Path("sensors.jsonl"),
    json_: JsonOption = False,
) -> None:
    """What a second sensor on the foot decides, on legs made by a separate simulator.

    Examples:
      python -m benchmarks.sensors --feet 5
    """
    report("sensors", measure(feet, state), json_)


if __name__ == "__main__":
    command_line(app)
