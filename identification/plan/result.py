"""A session planned in advance, beside the thesis' protocol."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from fasbody.acquire.level import Safety
from fasbody.acquire.plan import PROTOCOL
from fasbody.console import to_json, write_whole
from fasbody.presentation import Presented, Sheet, counted, listed, readable
from identification.branches import EXCHANGED
from identification.plan.candidates import (
    PLANNED,
    THESIS,
    THESIS_AMPLITUDE,
    UNLOADED,
    Step,
    exposure,
    shaking_s,
    thesis,
)
from identification.plan.director import GOAL, SHARE, Director
from identification.plan.feet import Cause, Outlook, Score
from identification.plan.shaker import Shaker
from identification.plan.words import (
    chance,
    in_the_way,
    minutes,
    percent,
    plain,
    repeating,
    span,
)

_TITLES = {
    PLANNED: "This plan", THESIS: "Protocol of the thesis, three loads", UNLOADED: "Protocol of the thesis, unloaded"
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Expected:
    """What a protocol is expected to leave: its steps, and the outlook after them."""

    steps: tuple[Step, ...]
    outlook: Outlook

    def document(self) -> dict[str, Any]:
        """As plain data; eight of ten feet lie between low and high."""
        x, widths = self.outlook, "relative_half_width"
        ends = {"": 0.5, "_low": 0.1, "_high": 0.9, "_least": 0.0, "_most": 1.0}
        return {
            "recordings": len(self.steps), "shaking_s": shaking_s(self.steps),
            **{widths + end: x.quantile(share) for end, share in ends.items()},
            "met_share": x.goal(branch=False), "decided_share": x.decided, "goal_probability": x.goal(),
        }  # fmt: skip

    def width(self, name: str) -> str:
        """The interval of a constant, and of how many feet."""
        low, high = (percent(self.outlook.quantile(share)[name]) for share in (0.1, 0.9))
        return f"{name} ±{percent(self.outlook.half_width[name])} ({low} to {high})"

    def widths(self) -> str:
        """Those of all, without their range."""
        return _widths(self.outlook.half_width, EXCHANGED)


#: What a group of what is uncertain is, and what a laboratory does about it, in words that the fit takes.
_RELIEF = {
    "masses": ("the segment masses", "Measure them, and state their accuracy (--mass-std)."),
    "gain": ("the gain between the channels", "Compare the sensors side by side on the table (--gain-std)."),
    "delay": ("the delay between the channels", "Measure it (--delay-std)."),
    "mount": ("the sensor on soft tissue", "If a tap shows that it does not resonate, use --exclude mount."),
    "relaxation": ("relaxation of the springs", "If you know that they do not relax, use --exclude relaxation."),
    "load": (
        "a change of the constants with the load",
        "If a slow push under each load shows no change, use --exclude load.",
    ),
    "share": (
        "the share of the load that the thigh carries",
        "If a force plate shows that the leg carries all of the load, use --exclude share.",
    ),
    "rocking": ("rocking of the leg", "If a sensor across the leg shows none, use --exclude rocking."),
    "seating": ("the difference between seatings", "If the person does not stand up between, use --exclude seating."),
    "drift": ("drift of the gain", "If the sensors agree before and after the session, use --exclude drift."),
}
#: What the last columns of the table are.
_LEGEND = (
    "Gain from each recording, given all others. All: information about the constants of the goal, in nats. Widest: "
    "reduction of the logarithm of the widest interval. Branch: increase of the expected log odds, as a share of "
    "ln 1000. Intervals: median of the simulated feet, with the range of 80 % of them in brackets."
)
#: What measures a cause that the vibration does not show, by the kinds of nuisance.
_MEASURED = {
    "determine the segment masses from their volumes": ("shank mass", "foot mass"),
    "calibrate the channels": ("gain", "delay"),
    "measure the foot's force with and without the load": ("load share",),
}
#: Shaking beyond this [s] is no plan, and relief by less than this factor is none.
_FAR_S, _WORTH = 6 * 3600.0, 1.1
#: A sensor comes first where it adds so much to the probability of a decision, or of the goal.
_DECIDES = 0.1
#: What is recorded where no few steps would do.
EVERY = "all candidates"


@dataclass(frozen=True)
class Longer:
    """What it takes where the noise is what is in the way.

    Attributes:
        times: how often the steps must be recorded, once for as they are planned.
        shaking_s: that takes.
        steps: "the plan", or all candidates where that is quicker.
        available_s: of shaking, that there was.
    """

    times: float
    shaking_s: float
    steps: str
    available_s: float

    def __str__(self) -> str:
        if self.steps != EVERY:
            often = f"{self.steps} {plain(self.times)} times"
            return f"To reach their goal, record {often}: {span(self.shaking_s)} of shaking."
        if self.shaking_s <= self.available_s:
            time = f"in the same time, {span(self.shaking_s)} of shaking"
        else:
            time = f"{span(self.shaking_s)} of shaking"
        return f"To reach their goal, make more recordings, {time}, spread over {EVERY}."

    @classmethod
    def of(
        cls,
        director: Director,
        what: str,
        steps: Sequence[Step],
        names: Sequence[str],
        branch: bool,
        available_s: float,
    ) -> "Longer | None":
        """The quicker of some steps, by what they are called, or `EVERY`; None where neither does."""
        sessions = []
        protocols = {what: steps, EVERY: director.candidates} if names or branch else {}
        for what, chosen in protocols.items():
            times = director.times(chosen, names, branch) if chosen else np.inf
            times = times if what == EVERY else max(1.0, times)
            if np.isfinite(times):
                seconds = max(times * shaking_s(chosen), director.shaker.seconds)
                sessions.append(cls(times, seconds, what, available_s))
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
        reached: what is left if every candidate were recorded until no noise is left.
        causes: what keeps each constant uncertain then.
        longer: what it takes to meet what the noise is in the way of; None where nothing is.
        excluding: half-widths after the plan if one group of what is uncertain were known, by its
            name.
        offers: sensors that could be worn besides.
        earlier: how many recordings there are.
        places: the map.
        findings: what they say.
        computing_s: that the planning took.
        uncertain: what is not known beforehand, beside the constants.
        repeatability: relative scatter of a harmonic from recording to recording, of the middle foot.
        shaker: with the middle foot's noise and repeatability.
    """

    figures: ClassVar[str] = "identification.plan.figures"
    plots: ClassVar[tuple[str, ...]] = ("session",)

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
    reached: Outlook
    causes: dict[str, tuple[Cause, ...]]
    longer: Longer | None
    excluding: dict[str, dict[str, float]]
    offers: tuple[Offer, ...]
    earlier: int
    places: tuple[Place, ...]
    findings: str
    computing_s: float
    uncertain: tuple[str, ...]
    repeatability: float
    shaker: Shaker

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
            parts.append(f"weaker {where}, down to {least:.3g} instead of {THESIS_AMPLITUDE:g} m/s^2")
        if not theirs:
            return "This shaker cannot make any sine of the thesis' protocol, so the plan is not compared with it."
        return f"The thesis' protocol is limited to what this shaker can do: {', and '.join(parts)}." if parts else ""

    @property
    def mine(self) -> Outlook:
        """What the plan is expected to leave."""
        return self.expected[PLANNED].outlook

    @property
    def missed(self) -> tuple[str, ...]:
        """Constants whose interval the plan does not bring down to what is asked with `SHARE`."""
        return tuple(name for name in self.asked if self.mine.likely(name) < SHARE)

    @property
    def never(self) -> tuple[str, ...]:
        """Constants whose interval no protocol of these candidates brings down to what is asked, of most feet."""
        return tuple(name for name in self.missed if self.reached.likely(name) < 0.5)

    @property
    def met(self) -> bool:
        """The branch is decided, and every asked interval is met, with a probability of `SHARE`."""
        return self.mine.goal() >= SHARE

    @property
    def begins_with(self) -> Offer | None:
        """The sensor that decides: what to begin with."""

        def gain(offer: Offer) -> float:
            e = offer.expected
            return max(e.outlook.decided - self.mine.decided, e.outlook.goal() - self.mine.goal())

        best = max(self.offers, key=gain, default=None)
        return best if best is not None and self.steps and gain(best) > _DECIDES else None

    @property
    def warning(self) -> str:
        """What of the daily exposure recording would refuse, and what would do; empty where it would not."""
        dose, most = exposure(self.steps), (Safety.daily_a8, Safety.daily_vdv)
        over = [
            f"{name} would be {value:.3g} {unit}, above the {what} of {limit:g} ({option})"
            for name, unit, value, limit, what, option in (
                ("A(8)", "m/s^2", dose.a8, most[0], "action value", "--max-exposure"),
                ("VDV", "m/s^1.75", dose.vdv, most[1], "limit", "--max-vdv"),
            )
            if value > limit
        ]
        if not over:
            return ""
        shorter = int(allowed_s(self.steps) / 6) / 10
        ways = [f"--minutes {shorter:g}"] if 60 * shorter >= self.shaker.seconds else []
        loads = {s.added_mass_kg for s in self.steps}
        parts = [exposure([s for s in self.steps if s.added_mass_kg == kg]) for kg in loads]
        if len(loads) > 1 and not any(part.beyond(*most) for part in parts):
            ways.append("one day for each load (fasbody record --added-mass)")
        use = f" Use {' or '.join(ways)}." if ways else " Plan for less."
        return f"fasbody record would refuse this plan: {', and '.join(over)}.{use} "

    @property
    def protocol(self) -> dict[str, Any]:
        """The steps in order, and whom they are for, as `fasbody record --plan` reads them."""
        return {
            "format": PROTOCOL, "subject": self.subject, "body_mass_kg": self.body_mass_kg, "posture": self.posture,
            "seed": self.seed, "protocol": [asdict(step) for step in self.steps],
        }  # fmt: skip

    def sentence(self) -> str:
        """What to expect, and what to do about it."""
        return " ".join(self._sentences())

    def _sentences(self) -> list[str]:
        existing = "the recording" if self.earlier == 1 else f"the {self.earlier} recordings"
        verb = "reaches" if self.earlier == 1 else "reach"
        likely = f"the goal with a probability of {chance(self.mine.goal())}"
        if not self.steps:
            return [f"Nothing more needs to be recorded: {existing} so far {verb} {likely}."]
        more = "more " if self.earlier else ""
        steps = counted(len(self.steps), f"{more}recording")
        text = f"{self.warning}{steps} ({minutes(shaking_s(self.steps))} of shaking) will reach {likely}."
        parts = [f"{self.expected[PLANNED].width(name)}, goal ±{percent(self.asked[name])}" for name in self.missed]
        text += f" Expected 95 % intervals: {'; '.join(parts)}." if parts else ""
        if self.mine.decided < SHARE:
            text += f" The branch is decided with a probability of {chance(self.mine.decided)}."
        return [text, *filter(None, (self._first(), self._more(), self._never(), self.relief()))]

    def _first(self) -> str:
        offer = self.begins_with
        if offer is None:
            return ""
        e = offer.expected
        return (
            f"Add a sensor {offer.sensor!r} first. Then the branch is decided with a probability of "
            f"{chance(e.outlook.decided)}, and the intervals are {e.widths()}."
        )

    def _more(self) -> str:
        names = [name for name in self.missed if name not in self.never]
        if self.mine.decided < SHARE and self.reached.decided >= 0.5:
            names.append("the branch")
        if not names:
            return ""
        of = listed(names)
        if self.longer is not None and self.longer.shaking_s > _FAR_S:
            return f"The goal for {of} is out of reach: it would take {span(self.longer.shaking_s)} of shaking."
        ever = f"With unlimited time the goal is reached with a probability of {chance(self.reached.goal())}."
        return f"{in_the_way(self.repeatability, of)} {self.longer or ever}"

    def _never(self) -> str:
        open_ = self.reached.decided < 0.5
        return nothing_brings(self.reached, self.causes, self.never, open_, self.shaker)

    def relief(self) -> str:
        """What keeps the missed intervals wide, and what would take it away; empty where nothing is missed by it."""

        def narrower(half: Mapping[str, float]) -> float:
            mine = self.mine.half_width
            return float(np.exp(np.mean([np.log(mine[name] / half[name]) for name in self.missed])))

        if not self.missed or not self.steps or not self.excluding:
            return ""
        most = max(self.excluding, key=lambda group: narrower(self.excluding[group]))
        if narrower(self.excluding[most]) < _WORTH:
            return ""
        what, how = _RELIEF[most]
        widths = _widths(self.excluding[most], self.missed)
        return f"The largest avoidable uncertainty is {what}. Without it, the intervals would be {widths}. {how}"

    def sheet(self) -> Sheet:
        """The session, step by step."""
        rows = [
            (
                str(i), step.kind, f"{step.frequency_hz:g}", f"{step.added_mass_kg:g}", f"{step.amplitude_m_s2:.3g}",
                f"{step.seconds:g}", f"{score.information:z.2f}", f"{score.widest:z.2f}", f"{score.branch:z.2f}",
            )
            for i, (step, score) in enumerate(zip(self.steps, self.adds, strict=True), start=1)
        ]  # fmt: skip
        columns = (
            "step", "kind", "frequency [Hz]", "load [kg]", "amplitude [m/s^2]", "time [s]", "gain: all",
            "gain: widest", "gain: branch",
        )  # fmt: skip
        notes = [*self._sentences(), goal(self.asked), _LEGEND if rows else "", self.limited]
        for name, e in self.expected.items():
            if not e.steps and not (name == PLANNED and self.earlier):
                continue
            title = _TITLES[name]
            if name != PLANNED and len(self.shaker.sensors) > 1:
                title += f", with {listed(self.shaker.sensors)}"
            if self.earlier:
                title += f", {'with' if name == PLANNED else 'without'} the earlier recordings"
            notes.append(
                f"{title}: {counted(len(e.steps), 'recording')}, {minutes(shaking_s(e.steps))}, {e.widths()}. "
                f"Probability of a decided branch: {chance(e.outlook.decided)}; of the whole goal: "
                f"{chance(e.outlook.goal())}."
            )
        for offer in self.offers:
            e = offer.expected
            widths = ", ".join(
                f"{n} ±{percent(e.outlook.half_width[n])} ({percent(self.mine.half_width[n])})" for n in EXCHANGED
            )
            notes.append(
                f"With a second sensor {offer.sensor!r} (in brackets: without it): {widths}. Probability of a decided "
                f"branch: {chance(e.outlook.decided)} ({chance(self.mine.decided)})."
            )
        also = f"Nuisance parameters: {listed(self.uncertain) or 'none'}"
        notes += [
            f"Predicted from {counted(self.feet, 'simulated foot', 'simulated feet')} at a body mass of "
            f"{self.body_mass_kg:g} kg (seed {self.seed}). {also}. {repeating(self.repeatability).capitalize()}.",
            exposure(self.steps).sentence(),
            self.findings,
        ]
        title = f"planned session for a new person of {self.body_mass_kg:g} kg"
        if self.earlier:
            title = f"planned next session of subject {self.subject}"
        return Sheet(f"{self.model}: {title}", columns, rows, [*filter(None, notes)])

    def records(self) -> list[dict[str, Any]]:
        """One row a step."""
        return [
            asdict(step) | {"sensors": ",".join(step.sensors)} | asdict(score)
            for step, score in zip(self.steps, self.adds, strict=True)
        ]

    def document(self) -> dict[str, Any]:
        """The plan as plain data."""
        first = self.begins_with
        return {
            **self.protocol, "model": self.model, "feet": self.feet,
            "next": asdict(self.steps[0]) if self.steps else None,
            "scores": [asdict(score) | {"total": score.total} for score in self.adds],
            "expected": {name: e.document() for name, e in self.expected.items()},
            "asked": {name: self.asked.get(name) for name in EXCHANGED}, "met": self.met,
            "goal_probability": self.mine.goal(), "begin_with": first and first.sensor,
            "never": {
                "constants": list(self.never), "relative_half_width": self.reached.half_width,
                "decided_share": self.reached.decided,
                "variance": {name: _texts(self.causes[name]) for name in self.never},
            },
            "longer": None if self.longer is None else asdict(self.longer), "excluding": self.excluding,
            "offers": [offer.document() for offer in self.offers],
            "uncertain": list(self.uncertain), "repeatability": self.repeatability, "shaker": asdict(self.shaker),
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
            write_whole(place / "protocol.json", to_json(self.protocol) + "\n"),
            write_whole(place / "plan.json", to_json(self.document()) + "\n"),
            write_whole(place / "plan.csv", self.to_dataframe().to_csv(index=False)),
        ]


def allowed_s(steps: Sequence[Step]) -> float:
    """Time [s] that steps may shake in one day, shortened alike: finding the levels takes its time all the same."""
    dose = exposure(steps)
    share = min((Safety.daily_a8 / dose.a8) ** 2, (Safety.daily_vdv / dose.vdv) ** 4)
    return share * dose.seconds - (dose.seconds - shaking_s(steps))


def planned(director: Director, most: int, seconds: float, took_s: float = 0.0, shorten: bool = False) -> Planned:
    """A whole session of a director, and what is expected of it.

    Args:
        director: of the person.
        most: recordings.
        seconds: of shaking.
        took_s: that making the director took.
        shorten: to what the daily exposure allows, if a recording fits in.
    """
    began = time.perf_counter()
    known = bool(director.done) and director.met(director.outlook(()))
    steps = () if known else director.session(most, seconds)
    while shorten and steps and exposure(steps).beyond(Safety.daily_a8, Safety.daily_vdv):
        seconds = min(0.95 * shaking_s(steps), allowed_s(steps))
        if seconds < director.shaker.seconds:
            break
        steps = director.session(most, seconds)
    protocols = {PLANNED: steps, THESIS: director.thesis(), UNLOADED: director.thesis((0.0,))}
    outlooks = {name: director.outlook(x, fresh=name != PLANNED) for name, x in protocols.items()}
    mine = outlooks[PLANNED].utility
    adds = []
    for number in range(len(steps)):
        without = director.outlook([*steps[:number], *steps[number + 1 :]]).utility
        adds.append(Score(*map(float, mine - without)))
    first, more = director.scores(()), director.scores(steps)
    offers = []
    for sensor in director.offers:
        worn = director.wearing(sensor, steps)
        offers.append(
            Offer(sensor, Expected(tuple(steps), worn), Score(*map(float, worn.utility - mine)))
        )
    person = director.person
    noise, repeatability = director.noise_m_s2, director.repeatability
    shaker = replace(director.shaker, noise_m_s2=noise, repeatability=repeatability)
    return Planned(
        person.foot.name, person.name, person.body_mass_kg, person.posture, director.seed, director.feet, steps,
        tuple(adds), {name: Expected(tuple(protocols[name]), x) for name, x in outlooks.items()}, dict(director.asked),
        director.for_ever(), director.causes(),
        _longer(director, steps, seconds), director.excluding(steps), tuple(offers), len(director.done),
        tuple(Place(s, a, b) for s, a, b in zip(director.candidates, first, more, strict=True)),
        "" if director.belief is None else believed(director), took_s + time.perf_counter() - began,
        director.uncertain, repeatability, shaker,
    )  # fmt: skip


def _longer(director: Director, steps: Sequence[Step], available_s: float) -> Longer | None:
    """What it takes to meet what can be met and is not likely to be."""
    mine, ever = director.outlook(steps), director.for_ever()
    if director.met(mine):
        return None
    names = [n for n in director.asked if ever.likely(n) >= SHARE]
    branch = ever.decided >= SHARE
    if mine.goal(names, branch) >= SHARE:
        return None
    return Longer.of(director, "the plan", steps, names, branch, available_s)


def believed(director: Director) -> str:
    """What recordings say so far, in a sentence."""
    belief = director.belief
    if belief is None:
        return "Nothing is recorded yet."
    bands = ", ".join(f"{name} {band}" for name, band in belief.open_bands(EXCHANGED).items())
    odds = np.exp(min(belief.log_odds, np.log(1e6)))
    name = belief.ends[0].branch
    verdict = f"{name}, decided" if belief.decided else f"branch undecided, {name} at odds of {readable(odds)} to 1"
    doubt = ""
    if not belief.follows:
        doubt = (
            " The model does not follow these recordings"
            if belief.strange
            else " Too little is recorded to say whether the model follows the recordings"
        )
        doubt += f" (chi-square {belief.ends[0].excess:.3g} per degree of freedom)."
    # theirs, in place of what was expected
    about = f"noise {readable(director.noise_m_s2, 2)} m/s^2, {repeating(belief.repeatability)}"
    return f"After {counted(len(director.done), 'recording')} ({about}): {verdict}; {bands}.{doubt}"


def _widths(half: Mapping[str, float], names: Sequence[str]) -> str:
    return ", ".join(f"{name} ±{percent(half[name])}" for name in names)


def goal(asked: Mapping[str, float]) -> str:
    """What is asked for, in full."""
    widths = _widths(asked, list(asked))
    rest = ", ".join(name for name in EXCHANGED if name not in asked)
    usual = (
        " This is the default. It is narrower than recordings usually reach, so that a plan uses all of its time. Set "
        "another with --ask."
    )
    text = f"Goal: {widths}, and the branch decided."
    return f"{text}{usual if asked == GOAL else ''}{f' No goal for {rest}.' if rest else ''}"


def _texts(causes: Sequence[Cause]) -> str:
    return ", ".join(map(str, causes))


def nothing_brings(
    reached: Outlook,
    causes: Mapping[str, Sequence[Cause]],
    names: Sequence[str],
    open_: bool,
    shaker: Shaker,
) -> str:
    """What no protocol brings, why, and what else would; empty where there is nothing.

    Args:
        reached: with unlimited minutes.
        causes: what keeps each constant uncertain then.
        names: of the constants that stay wider than asked.
        open_: whether the branch stays open.
        shaker: whose loads and sensors the candidates have.
    """
    if not names and not open_:
        return ""
    together: dict[str, list[str]] = {}
    for name in names:
        together.setdefault(_texts(causes[name]), []).append(
            f"{name} ±{percent(reached.half_width[name])} (goal ±{percent(reached.asked[name])})"
        )
    what = [
        listed(texts) + (f" (remaining variance: {cause})" if cause else "")
        for cause, texts in together.items()
    ]
    parts = [f"the plan predicts no narrower intervals than {'; '.join(what)}"] if what else []
    if open_:
        parts.append(f"the branch is decided with a probability of at most {chance(reached.decided)}")
    kinds = {cause.kind for name in names for cause in causes[name]}
    ways = [way for way, measured in _MEASURED.items() if not kinds.isdisjoint(measured)]
    if open_ or not ways:
        ways += ["add a load"] * (len(set(shaker.loads_kg)) < 2)
        ways += ["wear a sensor on the foot"] * ("foot" not in shaker.sensors)
    remedy = listed(ways, "or")
    return f"However long you record, {', and '.join(parts)}." + (
        f" {remedy[:1].upper()}{remedy[1:]}." if ways else ""
    )
