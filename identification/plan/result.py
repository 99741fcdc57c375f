"""A session planned in advance, beside the thesis' protocol."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from fasbody.console import to_json, write_whole
from fasbody.presentation import Presented, Sheet, readable
from identification.branches import EXCHANGED
from identification.plan.candidates import PLANNED, THESIS, UNLOADED, Step, thesis
from identification.plan.director import GOAL, SHARE, Director
from identification.plan.feet import Outlook, Score
from identification.plan.protocol import Protocol, shaking_s

_TITLES = {PLANNED: "planned", THESIS: "the thesis, three loads", UNLOADED: "the thesis, unloaded"}


@dataclass(frozen=True)
class Expected:
    """What a protocol is expected to leave.

    Attributes:
        steps: of it. half_width: half of the 95 % interval as a share of the value, by constant; the geometric mean
            over the feet. least, most: over the feet. met: share of the feet for whom all that is asked is met.
            decided: share of the feet whose branch is decided.
    """

    steps: tuple[Step, ...]
    half_width: dict[str, float]
    least: dict[str, float]
    most: dict[str, float]
    met: float
    decided: float

    @classmethod
    def of(cls, steps: Sequence[Step], outlook: Outlook) -> "Expected":
        """Of an outlook."""
        low, high = ({name: ends[i] for name, ends in outlook.spread.items()} for i in (0, 1))
        return cls(tuple(steps), dict(outlook.half_width), low, high, outlook.met, outlook.decided)

    def document(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "recordings": len(self.steps), "shaking_s": shaking_s(self.steps), "relative_half_width": self.half_width,
            "relative_half_width_least": self.least, "relative_half_width_most": self.most,
            "met_share": self.met, "decided_share": self.decided,
        }  # fmt: skip


#: What is recorded where no few steps would do.
EVERY = "every candidate"


@dataclass(frozen=True)
class Longer:
    """What it takes where the noise is what is in the way.

    Attributes:
        times: how often the steps must be recorded, once for as they are planned. shaking_s: that takes.
        steps: "the plan", or every candidate where that is quicker.
    """

    times: float
    shaking_s: float
    steps: str

    def __str__(self) -> str:
        if self.steps == EVERY:
            return f"It would take {span(self.shaking_s)} of shaking, spread over {EVERY}."
        count = f"{self.times:.2g}" if self.times < 10 else f"{self.times:.0f}"
        return f"It would take {self.steps} {count} times over, {span(self.shaking_s)} of shaking."

    @classmethod
    def of(
        cls, director: Director, steps: Mapping[str, Sequence[Step]], names: Sequence[str], branch: bool
    ) -> "Longer | None":
        """The quickest of some protocols, by what they are called; None where none ever does."""
        found = []
        for what, each in steps.items():
            times = director.times(each, names, branch)
            if np.isfinite(times):
                found.append(cls(times, times * shaking_s(each), what))
        return min(found, key=lambda x: x.shaking_s, default=None)


@dataclass(frozen=True)
class Offer:
    """One more sensor in the same recordings.

    Attributes:
        sensor: of the model. expected: what the plan leaves with it. adds: to the plan, in nats.
    """

    sensor: str
    expected: Expected
    adds: Score

    def document(self) -> dict[str, Any]:
        """As plain data."""
        adds = asdict(self.adds) | {"total": self.adds.total}
        return {"sensor": self.sensor, **self.expected.document(), "adds_nat": adds}


@dataclass(frozen=True)
class Place:
    """One candidate on the map: what it adds as the first recording, and as one more after the plan."""

    step: Step
    first: Score
    more: Score


@dataclass(frozen=True, eq=False, repr=False)
class Planned(Presented):
    """A session in advance.

    Attributes:
        model, subject, body_mass_kg, posture, seed: whose plan, and of which draws. feet: how many draws.
        steps: to record, in order. adds: what each adds to all the others. expected: by protocol.
        asked: half-widths by constant; those that are not asked for are left out.
        reached: half-widths if every candidate were recorded until no noise is left, and the share decided then.
        causes: what keeps each constant uncertain then, in words.
        longer: what it takes to meet what the noise is in the way of; None where nothing is.
        offers: sensors that could be worn besides. allowed: departures of the world that are allowed for.
        earlier: how many recordings there are. places: the map. said: what they say. seconds: that the planning took.
    """

    figures: ClassVar[str] = "identification.plan.figures"
    plots: ClassVar[tuple[str, ...]] = ("session", "information")

    model: str
    subject: str
    body_mass_kg: float
    posture: str
    seed: int
    feet: int
    steps: tuple[Step, ...]
    adds: tuple[Score, ...]
    expected: dict[str, Expected]
    asked: dict[str, float]
    reached: Expected
    causes: dict[str, str]
    longer: Longer | None
    offers: tuple[Offer, ...]
    allowed: tuple[str, ...]
    earlier: int
    places: tuple[Place, ...]
    said: str
    seconds: float

    @property
    def missed(self) -> tuple[str, ...]:
        """Constants whose interval the plan is not expected to bring down to what is asked."""
        mine = self.expected[PLANNED].half_width
        return tuple(name for name, share in self.asked.items() if mine[name] > share)

    @property
    def never(self) -> tuple[str, ...]:
        """Constants whose interval no protocol of these candidates brings down to what is asked."""
        return tuple(name for name in self.missed if self.reached.half_width[name] > self.asked[name])

    @property
    def decides(self) -> bool:
        """The branch is expected to be decided."""
        return self.expected[PLANNED].decided >= SHARE

    @property
    def met(self) -> bool:
        """The branch is expected to be decided, and every asked interval to be met."""
        return self.decides and not self.missed

    @property
    def protocol(self) -> Protocol:
        """For the file."""
        return Protocol(self.steps, self.subject, self.body_mass_kg, self.posture, self.seed)

    def sentence(self) -> str:
        """What to expect."""
        mine, theirs = self.expected[PLANNED], self.expected[THESIS]
        text = (
            f"{_many(len(self.steps), 'recording')} and {shaking_s(self.steps) / 60:.2g} minutes of shaking in place "
            f"of {len(theirs.steps)} and {shaking_s(theirs.steps) / 60:.2g}: "
        )
        ratio = {name: mine.half_width[name] / theirs.half_width[name] for name in EXCHANGED}
        worst = max(ratio, key=lambda name: ratio[name])
        text += (
            f"intervals of {min(ratio.values()):.3g} to {ratio[worst]:.3g} times those of the thesis' three loads, and "
            f"the branch decided for {100 * mine.decided:.0f} % of such feet."
        )
        return f"{text} {self.stop()}"

    def stop(self) -> str:
        """Whether what is asked is met, will be, or never is."""
        if self.met:
            return (
                f"What is asked is met in the mean over the {self.feet} feet that the plan was made for, and for "
                f"{100 * self.expected[PLANNED].met:.0f} % of them in every interval; other feet come out wider."
            )
        mine = self.expected[PLANNED].half_width
        parts = [
            f"{name} stays at +-{_percent(mine[name])} (+-{_percent(self.asked[name])} asked)"
            for name in self.missed
            if name not in self.never
        ]
        if not self.decides and self.reached.decided >= SHARE:
            parts.append("the branch may stay open")
        never = [
            unreachable(name, self.reached.half_width[name], self.asked[name], self.causes[name]) for name in self.never
        ]
        if self.reached.decided < SHARE:
            never.append(f"the branch for more than {100 * self.reached.decided:.0f} % of such feet")
        text = ""
        if parts:
            text = f"More recordings or minutes are needed, as noise is in the way: {', '.join(parts)}. "
            text += f"{self.longer} " if self.longer else ""
        if never:
            text += (
                f"No protocol of these candidates is expected to bring {', nor '.join(never)}, with unlimited minutes "
                "of every candidate: what stays uncertain is not in the vibration. Weigh the segments, calibrate the "
                "channels, or add a load or a sensor on the foot."
            )
        return text.strip()

    def sheet(self) -> Sheet:
        """The session, step by step."""
        rows = [
            (
                str(i), step.kind, f"{step.frequency_hz:g}", f"{step.added_mass_kg:g}", f"{step.amplitude_m_s2:.3g}",
                f"{step.seconds:g}", f"{score.information:.2f}", f"{score.widest:.2f}", f"{score.branch:.2f}",
            )
            for i, (step, score) in enumerate(zip(self.steps, self.adds, strict=True), start=1)
        ]  # fmt: skip
        columns = (
            "step", "kind", "Hz", "kg", "m/s^2", "s", "information [nat]", "widest [nat]", "branch [nat]",
        )  # fmt: skip
        notes = [self.sentence(), goal(self.asked)]
        for name, e in self.expected.items():
            widths = ", ".join(f"{n} +-{_percent(w)}" for n, w in e.half_width.items())
            notes.append(
                f"{_TITLES[name]}: {_many(len(e.steps), 'recording')}, {shaking_s(e.steps) / 60:.2g} min, {widths}, "
                f"decided {100 * e.decided:.0f} %."
            )
        for offer in self.offers:
            mine, e = self.expected[PLANNED], offer.expected
            widths = ", ".join(f"{n} +-{_percent(e.half_width[n])} ({_percent(mine.half_width[n])})" for n in EXCHANGED)
            notes.append(
                f"With a sensor {offer.sensor!r} besides (without it): {widths}, decided {100 * e.decided:.0f} % "
                f"({100 * mine.decided:.0f} %)."
            )
        also = f", {', '.join(self.allowed)}" if self.allowed else ""
        notes.append(
            f"Averages over {self.feet} feet of {self.body_mass_kg:g} kg persons; masses, gain, delay{also} are "
            f"uncertain as in a fit. Seed {self.seed}."
        )
        if self.said:
            notes.append(self.said)
        return Sheet(f"{self.model}: the next session of subject {self.subject}", columns, rows, notes)

    def records(self) -> list[dict[str, Any]]:
        """One row a step."""
        return [
            asdict(step) | {"sensors": ",".join(step.sensors)} | asdict(score)
            for step, score in zip(self.steps, self.adds, strict=True)
        ]

    def document(self) -> dict[str, Any]:
        """The plan as plain data."""
        return {
            **self.protocol.document(), "model": self.model, "feet": self.feet,
            "next": asdict(self.steps[0]) if self.steps else None,
            "scores": [asdict(score) | {"total": score.total} for score in self.adds],
            "expected": {name: e.document() for name, e in self.expected.items()},
            "asked": {name: self.asked.get(name) for name in EXCHANGED}, "met": self.met,
            "never": {
                "constants": list(self.never), "relative_half_width": self.reached.half_width,
                "decided_share": self.reached.decided, "variance": {name: self.causes[name] for name in self.never},
            },
            "longer": None if self.longer is None else asdict(self.longer),
            "offers": [offer.document() for offer in self.offers],
            "allowed": list(self.allowed), "earlier_recordings": self.earlier,
            "information": [
                {
                    **asdict(p.step), "first_nat": p.first.information, "more_nat": p.more.information,
                    "first_total": p.first.total, "more_total": p.more.total,
                }
                for p in self.places
            ],
            "sentence": self.sentence(), "seconds": self.seconds,
        }  # fmt: skip

    def write(self, folder: Path | str) -> list[Path]:
        """Write protocol.json, which acquire runs, plan.json and plan.csv into a folder."""
        place = Path(folder)
        return [
            self.protocol.write(place / "protocol.json"),
            write_whole(place / "plan.json", to_json(self.document()) + "\n"),
            write_whole(place / "plan.csv", self.to_dataframe().to_csv(index=False)),
        ]


def planned(director: Director, most: int, seconds: float, took_s: float = 0.0) -> Planned:
    """A whole session of a director, and what is expected of it.

    Args:
        director: of the person. most: recordings. seconds: of shaking. took_s: that making the director took.
    """
    import time

    began = time.perf_counter()
    steps = director.session(most, seconds)
    protocols: dict[str, Sequence[Step]] = {PLANNED: steps, THESIS: thesis(), UNLOADED: thesis((0.0,))}
    expected = {
        name: Expected.of(each, director.outlook(each, fresh=name != PLANNED)) for name, each in protocols.items()
    }
    whole = director.outlook(steps).utility
    adds = []
    for number in range(len(steps)):
        without = director.outlook([*steps[:number], *steps[number + 1 :]]).utility
        adds.append(Score(*map(float, whole - without)))
    first, more = director.scores(()), director.scores(steps)
    person, reached = director.person, Expected.of((), director.for_ever())
    return Planned(
        person.foot.name, person.name, person.body_mass_kg, person.posture, director.seed, director.feet, steps,
        tuple(adds), expected, dict(director.asked), reached, director.causes(),
        _longer(director, steps, expected[PLANNED], reached),
        tuple(_offer(director, name, steps, whole) for name in director.offers), director.allowed, len(director.done),
        tuple(Place(s, a, b) for s, a, b in zip(director.candidates, first, more, strict=True)),
        "" if director.belief is None else believed(director), took_s + time.perf_counter() - began,
    )  # fmt: skip


def _offer(director: Director, sensor: str, steps: Sequence[Step], without: np.ndarray) -> Offer:
    outlook = director.wearing(sensor, steps)
    return Offer(sensor, Expected.of(steps, outlook), Score(*map(float, outlook.utility - without)))


def _longer(director: Director, steps: Sequence[Step], mine: Expected, reached: Expected) -> Longer | None:
    """What it takes to meet what can be met and is not."""
    asked, branch = director.asked, mine.decided < SHARE <= reached.decided
    names = [name for name, share in asked.items() if mine.half_width[name] > share >= reached.half_width[name]]
    if not names and not branch:
        return None
    return Longer.of(director, {"the plan": steps, EVERY: director.candidates}, names, branch)


def believed(director: Director) -> str:
    """What recordings say so far, in a sentence."""
    belief = director.belief
    if belief is None:
        return "Nothing is recorded yet."
    bands = ", ".join(f"{name} {band}" for name, band in belief.open_bands(EXCHANGED).items())
    odds = np.exp(min(belief.log_odds, np.log(1e6)))
    name = belief.ends[0].name
    told = f"{name}, decided" if belief.decided else f"branch open, {name} at {readable(odds)} to 1"
    lost = ""
    if belief.strange:
        lost = f" Such a foot does not move like this (chi-square {belief.per_dof:.3g} a dof)."
    elif not belief.follows:
        lost = f" Too little is recorded to say whether such a foot moves like this (chi-square {belief.per_dof:.3g})."
    return f"After {_many(len(director.done), 'recording')}: {told}; {bands}.{lost}"


def goal(asked: Mapping[str, float]) -> str:
    """What is asked for, in full."""
    wide = ", ".join(f"{name} +-{_percent(share)}" for name, share in asked.items())
    rest = ", ".join(name for name in EXCHANGED if name not in asked)
    usual = " (the usual goal, whatever the rig)" if asked == GOAL else ""
    return f"Asked: {wide}{usual}, and the branch.{f' Not asked: {rest}.' if rest else ''}"


def unreachable(name: str, reached: float, asked: float, cause: str) -> str:
    """A constant that no protocol brings down to what is asked, and why."""
    why = f"; its variance comes from {cause}" if cause else ""
    return f"{name} below +-{_percent(reached)} (+-{_percent(asked)} asked{why})"


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def span(seconds: float) -> str:
    """A time in words."""
    if seconds < 5400:
        return f"{seconds / 60:.2g} minutes"
    return f"{seconds / 3600:.2g} hours" if seconds < 48 * 3600 else f"{seconds / 86400:.0f} days"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"
