"""Is a planned session worth its third of the recordings? Virtual feet that the plan did not know, and auto sessions.

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
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.table import JsonOption, report
from benchmarks.worlds import FOOT, RATE_HZ, SHANK, Departure, Leg, felt, leg_of, sample
from fasbody.console import command_line, progress_bar
from fasbody.exceptions import FasError
from fasbody.recording.condition import Condition
from fasbody.recording.recording import Recording
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.plan.candidates import Step, thesis
from reproduction.check import Check, at_most, told, within

ROOT = Path(__file__).parents[1]
COUNTED = ("k_T", "k_F", "c_11", "c_21")
#: What is compared: the plan, the thesis' three loads, and its unloaded part.
PROTOCOLS = ("planned", "three loads", "one load")
#: Standard deviations of the segment masses and of the gain (shares); of the noise in a sample [m/s^2], drawn between.
MASS_STD, GAIN_STD, NOISE = 0.10, 0.01, (0.25, 1.0)
STARTS = 4
#: Recordings are written so many times shorter, with less noise by the root of that: the same information about a
#: settled sine, for a fifth of the computing.
SHORTER = 5
#: Feet from which on something is required.
ENOUGH = 100


@dataclass(frozen=True)
class Virtual:
    """A foot that is recorded.

    Attributes:
        leg: the truth. body_kg: as the scale says. gain: error of the malleolus' channel. noise_m_s2: of a sample.
        strength: of the dampers' nonlinearity.
    """

    seed: int
    leg: Leg
    body_kg: float
    gain: float
    noise_m_s2: float
    strength: float


def virtual(seed: int) -> Virtual:
    """A foot of a population that is not the plan's: neither its springs, nor its dampers, nor its noise."""
    rng = np.random.default_rng([seed, 2020])
    body, strength = float(rng.uniform(45, 110)), float(np.exp(rng.uniform(np.log(0.03), np.log(1.3))))
    true = np.exp(MASS_STD * rng.standard_normal(2))
    leg = leg_of(rng, body, strength)
    leg = replace(leg, m_S=SHANK * body * true[0], m_F=FOOT * body * true[1])
    noise = float(np.exp(rng.uniform(*np.log(NOISE))))
    return Virtual(seed, leg, body, float(GAIN_STD * rng.standard_normal()), noise, strength)


def recorded(foot: Virtual, steps: Sequence[Step], session: int) -> list[Recording]:
    """What the laboratory writes of these steps."""
    rng = np.random.default_rng([foot.seed, session])
    made, noise = [], foot.noise_m_s2 / np.sqrt(SHORTER)
    for step in steps:
        base = step.amplitude_m_s2 * np.array([1.0, 0.015, 0.008]) * np.exp(1j * rng.uniform(0, 2 * np.pi, 3))
        t = np.arange(round(step.seconds / SHORTER * RATE_HZ)) / RATE_HZ
        hz = step.frequency_hz
        y = (1 + foot.gain) * felt(foot.leg, Departure(), step.added_mass_kg, hz, base)
        a, b = (sample(t, hz, x) + noise * rng.standard_normal(t.size) for x in (base, y))
        condition = Condition("made", "midstance", step.added_mass_kg, foot.body_kg, hz)
        made.append(Recording(t, a, b, condition=condition, file=str(step), origin="synthetic"))
    return made


@dataclass(frozen=True)
class Fitted:
    """One protocol on one foot.

    Attributes:
        protocol: which. seed, strength: of the foot. recordings, shaking_s: how many, how long. verdict: of the fit.
        right: the branch named first is the true one. half_width, holds: by constant, on the true branch where it is
            shown, else on the first. expected: half-widths that the plan foretold for such feet.
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


def planned(foot: Virtual) -> tuple[tuple[Step, ...], dict[str, float]]:
    """A session of a third of the thesis' recordings for a person of whom the scale alone is known, and its promise."""
    from fasbody.foot.model import load
    from fasbody.recording.known import Known
    from identification.plan.director import Director
    from identification.plan.prior import Person
    from identification.plan.shaker import Shaker

    person = Person(load("two_dof"), foot.body_kg, Known().told(exclude=("all",)))
    director = Director(person, Shaker(), seed=foot.seed)
    steps = director.session(len(thesis()) // 3, sum(step.seconds for step in thesis()))
    return steps, dict(director.outlook(steps).half_width)


def trial(protocol: str, seed: int) -> Fitted:
    """Plan, record and fit."""
    from fasbody.foot.model import load
    from identification.estimate import fit_foot

    foot, model = virtual(seed), load("two_dof")
    expected: dict[str, float] = {}
    began = time.process_time()
    if protocol == "planned":
        steps, expected = planned(foot)
    else:
        steps = thesis() if protocol == "three loads" else thesis((0.0,))
    spent_on_plan = time.process_time() - began
    shaking = sum(step.seconds for step in steps)
    data = recorded(foot, steps, PROTOCOLS.index(protocol))
    began = time.process_time()
    try:
        result = fit_foot(data, model, starts=STARTS, threads=1, exclude=("all",))
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


def digest(plan: bool) -> str:
    """Of everything that a fit of these feet depends on: worlds, fit and models, and what is planned for two."""
    found = hashlib.sha256(repr([planned(virtual(seed))[0] for seed in (0, 1)]).encode() if plan else b"")
    files = [ROOT / "benchmarks" / "worlds.py"]
    for room in ("identification", "identification/engines", "fasbody/foot"):
        files += list((ROOT / room).glob("*.py"))
    for file in sorted(files):
        found.update(file.read_bytes())
    return found.hexdigest()[:16]


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


def measure(feet: int, state: Path) -> list[Check]:
    """Rows from so many feet; what `state` holds is not done again."""
    stamps = {protocol: digest(protocol == PROTOCOLS[0]) for protocol in PROTOCOLS}
    wanted = [(protocol, seed) for seed in range(feet) for protocol in PROTOCOLS]
    done = {(f.protocol, f.seed): f for f in read(state, stamps)}
    with progress_bar() as progress, state.open("a") as file:
        for key in progress.track([key for key in wanted if key not in done], description="feet"):
            done[key] = trial(*key)
            file.write(json.dumps({**asdict(done[key]), "digest": stamps[key[0]]}) + "\n")
            file.flush()
    return rows_of([done[key] for key in wanted])


def rows_of(found: Sequence[Fitted]) -> list[Check]:
    """What was asked, over all feet that every protocol recorded."""
    by: dict[str, dict[int, Fitted]] = {p: {f.seed: f for f in found if f.protocol == p} for p in PROTOCOLS}
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
        told_ = ", ".join(f"{name} {100 * w:.3g} %" for name, w in zip(COUNTED, widths, strict=True))
        rows.append(told(f"{p}: half-widths, geometric means", told_, f"of {len(seeds)} feet"))
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


def _none(found: Sequence[Fitted]) -> int:
    return sum(f.verdict == "none" for f in found)


def _mean(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values)))) if values else float("nan")


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    feet: Annotated[int, typer.Option(help="virtual feet; the statement takes 100")] = 100,
    state: Annotated[Path, typer.Option(help="what is done, to go on from")] = Path("director.jsonl"),
    json_: JsonOption = False,
) -> None:
    """The planned session against the thesis' on virtual feet that the plan did not know, by their own simulator.

    Examples:
      python -m benchmarks.director --feet 10
    """
    report("director", measure(feet, state), json_)


if __name__ == "__main__":
    command_line(app)
