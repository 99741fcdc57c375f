"""A session planned in advance, beside the thesis' protocol."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from fasbody.console import to_json, write_whole
from fasbody.presentation import Presented, Sheet, counted, readable
from identification.branches import EXCHANGED
from identification.plan.candidates import PLANNED, THESIS, THESIS_AMPLITUDE, UNLOADED, Step, thesis
from identification.plan.director import GOAL, SHARE, Director
from identification.plan.feet import Outlook, Score
from identification.plan.protocol import Protocol, exposure, shaking_s
from identification.plan.words import in_the_way, listed, minutes, percent, plain, repeating, span, whole

_TITLES = {PLANNED: "planned", THESIS: "the thesis, three loads", UNLOADED: "the thesis, unloaded"}


@dataclass(frozen=True)
class Expected:
    """What a protocol is expected to leave.

    Attributes:
        steps: of it.
        half_width: half of the 95 % interval as a share of the value, by constant; the geometric
            mean over the feet.
        least, most: over the feet.
        met: share of the feet for whom all that is asked is met.
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


#: What a group of what is uncertain is, and what a laboratory does about it, in words that the fit takes.
_RELIEF = {
    "masses": ("masses that are not as stated", "weigh the segments, and say how well: --mass-std"),
    "gain": ("the gain between the channels", "compare them side by side on the table: --gain-std"),
    "delay": ("the delay between the channels", "measure it: --delay-std"),
    "mount": ("a sensor that rings on soft tissue", "where a tap shows that it does not: --exclude mount"),
    "relaxation": ("springs that relax", "higher frequencies tell it; where it is ruled out: --exclude relaxation"),
    "load": ("constants that follow the load", "where a slow push under each load rules it out: --exclude load"),
    "share": ("a load that the thigh helps to carry", "where a force plate shows all of it: --exclude share"),
    "rocking": ("a leg that rocks", "where a sensor across the leg rules it out: --exclude rocking"),
    "drift": ("a gain that drifts", "where the channels are compared before and after: --exclude drift"),
}
#: What the last columns of the table are.
_LEGEND = (
    "The last columns say what a recording adds to all others, in nat: to the asked intervals together, to the widest "
    "of them, and to the decision of the branch."
)
#: Shaking beyond this [s] is no plan, and relief by less than this factor is none.
_FAR_S, _WORTH = 6 * 3600.0, 1.1
#: What is recorded where no few steps would do.
EVERY = "every candidate"


@dataclass(frozen=True)
class Longer:
    """What it takes where the noise is what is in the way.

    Attributes:
        times: how often the steps must be recorded, once for as they are planned.
        shaking_s: that takes.
        steps: "the plan", or every candidate where that is quicker.
        available_s: of shaking, that there was.
    """

    times: float
    shaking_s: float
    steps: str
    available_s: float

    def __str__(self) -> str:
        if self.steps != EVERY:
            return f"It would take {self.steps} {plain(self.times)} times over, {span(self.shaking_s)} of shaking."
        if self.shaking_s <= self.available_s:
            return (
                f"The number of recordings is the limit: spread over {EVERY}, {span(self.shaking_s)} of shaking would "
                "do."
            )
        return f"It would take more recordings, and {span(self.shaking_s)} of shaking spread over {EVERY}."

    @classmethod
    def of(
        cls,
        director: Director,
        steps: Mapping[str, Sequence[Step]],
        names: Sequence[str],
        branch: bool,
        available_s: float,
    ) -> "Longer | None":
        """The quickest of some protocols, by what they are called; None where none ever does."""
        sessions = []
        for what, chosen in steps.items():
            times = director.times(chosen, names, branch)
            if np.isfinite(times):
                sessions.append(cls(times, times * shaking_s(chosen), what, available_s))
        return min(sessions, key=lambda x: x.shaking_s, default=None)


@dataclass(frozen=True)
class Offer:
    """One more sensor in the same recordings.

    Attributes:
        sensor: of the model.
        expected: what the plan leaves with it.
        adds: to the plan, in nats.
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
        model, subject, body_mass_kg, posture, seed: whose plan, and of which draws.
        feet: how many draws.
        steps: to record, in order.
        adds: what each adds to all the others.
        expected: by protocol.
        asked: half-widths by constant; those that are not asked for are left out.
        reached: half-widths if every candidate were recorded until no noise is left, and the share
            decided then.
        causes: what keeps each constant uncertain then, in words.
        longer: what it takes to meet what the noise is in the way of; None where nothing is.
        excluding: half-widths after the plan if one group of what is uncertain were known, by its
            name.
        offers: sensors that could be worn besides.
        earlier: how many recordings there are.
        places: the map.
        findings: what they say.
        computing_s: that the planning took.
        uncertain: what is not known beforehand, beside the constants.
        repeatability: relative scatter of a harmonic from recording to recording.
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
    excluding: dict[str, dict[str, float]]
    offers: tuple[Offer, ...]
    earlier: int
    places: tuple[Place, ...]
    findings: str
    computing_s: float
    uncertain: tuple[str, ...] = ()
    repeatability: float = 0.0

    @property
    def limited(self) -> str:
        """What of the thesis' protocol this shaker cannot do, in a sentence; empty where it can do it all."""
        theirs = self.expected[THESIS].steps
        unreachable = sorted({s.frequency_hz for s in thesis()} - {s.frequency_hz for s in theirs})
        weaker = [s for s in theirs if s.amplitude_m_s2 < THESIS_AMPLITUDE]
        parts = [f"without {listed([f'{f:g}' for f in unreachable])} Hz"] if unreachable else []
        if weaker:
            f, least = [s.frequency_hz for s in weaker], min(s.amplitude_m_s2 for s in weaker)
            where = f"at {min(f):g} to {max(f):g} Hz" if max(f) > min(f) else f"at {f[0]:g} Hz"
            parts.append(f"weaker {where}, down to {least:.3g} in place of {THESIS_AMPLITUDE:g} m/s^2")
        if not theirs:
            return "This shaker makes none of the thesis' sines, so nothing is compared with its protocol."
        return f"The thesis' protocol is taken as this shaker can do it: {', and '.join(parts)}." if parts else ""

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

    @property
    def _existing(self) -> str:
        """The earlier recordings, in words."""
        return "the recording that exists" if self.earlier == 1 else f"the {self.earlier} recordings that exist"

    def sentence(self) -> str:
        """What to expect."""
        mine, theirs = self.expected[PLANNED], self.expected[THESIS]
        if not self.steps:
            return f"Nothing more needs to be recorded. {self.stop()}"
        more = "more " if self.earlier else ""
        text = f"{counted(len(self.steps), f'{more}recording')} and {minutes(shaking_s(self.steps))} of shaking"
        if self.earlier:
            text += f" after {self._existing}:"
        elif theirs.steps:
            ratio = [mine.half_width[name] / theirs.half_width[name] for name in EXCHANGED]
            low, high = (plain(x, 3) for x in (min(ratio), max(ratio)))
            text += (
                f" in place of {len(theirs.steps)} and {plain(shaking_s(theirs.steps) / 60)}: intervals of {low} to "
                f"{high} times those of the thesis' three loads, and"
            )
        else:
            text += ":"
        text += f" the branch decided for {whole(mine.decided)} of such feet."
        return f"{text} {self.stop()}"

    def stop(self) -> str:
        """Whether what is asked is met, will be, or never is."""
        if self.met and not self.steps:
            return f"What is asked is met by {self._existing}."
        if self.met:
            feet, share = counted(self.feet, "foot", "feet"), whole(self.expected[PLANNED].met)
            return (
                f"What is asked is met in the mean over the {feet} that the plan was made for, and for {share} of them "
                "in every interval; other feet come out wider."
            )
        mine = self.expected[PLANNED].half_width
        parts = [
            f"{name} comes to +-{percent(mine[name])} (+-{percent(self.asked[name])} asked)"
            for name in self.missed
            if name not in self.never
        ]
        if not self.decides and self.reached.decided >= SHARE:
            parts.append("the branch may stay open")
        never = [
            unreachable(name, self.reached.half_width[name], self.asked[name], self.causes[name]) for name in self.never
        ]
        if self.reached.decided < SHARE:
            never.append(f"the branch for more than {whole(self.reached.decided)} of such feet")
        text = ""
        if parts and self.longer and self.longer.shaking_s > _FAR_S:
            text = f"Out of reach, as it would take {span(self.longer.shaking_s)} of shaking: {', '.join(parts)}. "
        elif parts:
            text = f"More is needed, as {in_the_way(self.repeatability)} in the way: {', '.join(parts)}. "
            text += f"{self.longer} " if self.longer else ""
        if never:
            text += (
                f"No protocol of these candidates is expected to bring {', nor '.join(never)}, with unlimited minutes "
                "of every candidate: what stays uncertain is not in the vibration. Weigh the segments, calibrate the "
                "channels, or add a load or a sensor on the foot. "
            )
        return f"{text}{self.relief()}".strip()

    def relief(self) -> str:
        """What keeps the missed intervals wide, and what would take it away; empty where nothing is missed by it."""
        mine = self.expected[PLANNED].half_width

        def narrower(half: Mapping[str, float]) -> float:
            return float(np.exp(np.mean([np.log(mine[name] / half[name]) for name in self.missed])))

        if not self.missed or not self.steps or not self.excluding:
            return ""
        most = max(self.excluding, key=lambda group: narrower(self.excluding[group]))
        if narrower(self.excluding[most]) < _WORTH:
            return ""
        what, how = _RELIEF[most]
        text = f"What costs most is {what}: without, {_widths(self.excluding[most], self.missed)} ({how})."
        offer = max(self.offers, key=lambda o: narrower(o.expected.half_width), default=None)
        if offer is not None and narrower(offer.expected.half_width) > narrower(self.excluding[most]):
            text += (
                f" A second sensor {offer.sensor!r} takes more away: {_widths(offer.expected.half_width, self.missed)}."
            )
        return text

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
            "step", "kind", "Hz", "kg", "m/s^2", "s", "together", "widest", "branch",
        )  # fmt: skip
        notes = [self.sentence(), goal(self.asked), *([_LEGEND] if rows else [])]
        notes += [self.limited] if self.limited else []
        for name, e in self.expected.items():
            if not e.steps and not (name == PLANNED and self.earlier):
                continue
            widths = _widths(e.half_width)
            title = _TITLES[name]
            if self.earlier:
                title += ", with what exists" if name == PLANNED else ", without what exists"
            notes.append(
                f"{title}: {counted(len(e.steps), 'recording')}, {minutes(shaking_s(e.steps))}, {widths}, "
                f"decided {whole(e.decided)}."
            )
        for offer in self.offers:
            mine, e = self.expected[PLANNED], offer.expected
            widths = ", ".join(f"{n} +-{percent(e.half_width[n])} ({percent(mine.half_width[n])})" for n in EXCHANGED)
            notes.append(
                f"With a second sensor {offer.sensor!r} (without it): {widths}, decided {whole(e.decided)} "
                f"({whole(mine.decided)})."
            )
        one = len(self.uncertain) == 1 and self.uncertain != ("masses",)
        also = (
            f"{listed(self.uncertain)} {'is' if one else 'are'} uncertain"
            if self.uncertain
            else "nothing beside their constants is uncertain"
        )
        notes.append(
            f"Averages over {counted(self.feet, 'foot', 'feet')} of persons of {self.body_mass_kg:g} kg; {also}; "
            f"{repeating(self.repeatability)}. Seed {self.seed}."
        )
        notes.append(exposure(self.steps).sentence())
        if self.findings:
            notes.append(self.findings)
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
            "longer": None if self.longer is None else asdict(self.longer), "excluding": self.excluding,
            "offers": [offer.document() for offer in self.offers],
            "uncertain": list(self.uncertain), "repeatability": self.repeatability,
            "limited": self.limited, "earlier_recordings": self.earlier,
            "information": [
                {
                    **asdict(p.step), "first_nat": p.first.information, "more_nat": p.more.information,
                    "first_total": p.first.total, "more_total": p.more.total,
                }
                for p in self.places
            ],
            "sentence": self.sentence(), "computing_s": self.computing_s,
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
        director: of the person.
        most: recordings.
        seconds: of shaking.
        took_s: that making the director took.
    """
    import time

    began = time.perf_counter()
    known = bool(director.done) and director.met(director.outlook(()))
    steps = () if known else director.session(most, seconds)
    protocols: dict[str, Sequence[Step]] = {
        PLANNED: steps,
        THESIS: director.thesis(),
        UNLOADED: director.thesis((0.0,)),
    }
    expected = {
        name: Expected.of(protocol, director.outlook(protocol, fresh=name != PLANNED))
        for name, protocol in protocols.items()
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
        _longer(director, steps, expected[PLANNED], reached, seconds), director.excluding(steps),
        tuple(_offer(director, name, steps, whole) for name in director.offers), len(director.done),
        tuple(Place(s, a, b) for s, a, b in zip(director.candidates, first, more, strict=True)),
        "" if director.belief is None else believed(director), took_s + time.perf_counter() - began,
        director.uncertain, director.shaker.repeatability,
    )  # fmt: skip


def _offer(director: Director, sensor: str, steps: Sequence[Step], without: np.ndarray) -> Offer:
    outlook = director.wearing(sensor, steps)
    return Offer(sensor, Expected.of(steps, outlook), Score(*map(float, outlook.utility - without)))


def _longer(
    director: Director, steps: Sequence[Step], mine: Expected, reached: Expected, available_s: float
) -> Longer | None:
    """What it takes to meet what can be met and is not."""
    asked, branch = director.asked, mine.decided < SHARE <= reached.decided
    names = [name for name, share in asked.items() if mine.half_width[name] > share >= reached.half_width[name]]
    if not names and not branch:
        return None
    return Longer.of(director, {"the plan": steps, EVERY: director.candidates}, names, branch, available_s)


def believed(director: Director) -> str:
    """What recordings say so far, in a sentence."""
    belief = director.belief
    if belief is None:
        return "Nothing is recorded yet."
    bands = ", ".join(f"{name} {band}" for name, band in belief.open_bands(EXCHANGED).items())
    odds = np.exp(min(belief.log_odds, np.log(1e6)))
    name = belief.ends[0].branch
    verdict = f"{name}, decided" if belief.decided else f"branch open, {name} at {readable(odds)} to 1"
    doubt = ""
    if not belief.follows:
        doubt = (
            " Such a foot does not move"
            if belief.strange
            else " Too little is recorded to say whether such a foot moves"
        )
        doubt += f" like this (chi-square {belief.ends[0].excess:.3g} per degree of freedom)."
    # theirs, in place of what was expected
    about = f"noise {readable(director.shaker.noise_m_s2, 2)} m/s^2, {repeating(belief.repeatability)}"
    return f"After {counted(len(director.done), 'recording')} ({about}): {verdict}; {bands}.{doubt}"


def _widths(half: Mapping[str, float], names: Sequence[str] = ()) -> str:
    """Half-widths by constant, of some or of all."""
    return ", ".join(f"{name} +-{percent(half[name])}" for name in names or half)


def goal(asked: Mapping[str, float]) -> str:
    """What is asked for, in full."""
    widths = _widths(asked)
    rest = ", ".join(name for name in EXCHANGED if name not in asked)
    usual = " (the usual goal, whatever the rig)" if asked == GOAL else ""
    return f"Asked: {widths}{usual}, and the branch.{f' Not asked: {rest}.' if rest else ''}"


def unreachable(name: str, reached: float, asked: float, cause: str) -> str:
    """A constant that no protocol brings down to what is asked, and why."""
    why = f"; its variance comes from {cause}" if cause else ""
    return f"{name} below +-{percent(reached)} (+-{percent(asked)} asked{why})"
