"""Shaking, fitting and planning in turn, until what is asked is met, or can never be, or the time is over."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fasbody.exceptions import AcquisitionError, RecordingError, SettingError, SimulationError
from fasbody.presentation import Presented, Sheet
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.branches import EXCHANGED
from identification.plan.belief import Band, Belief
from identification.plan.candidates import Step
from identification.plan.director import SHARE, Director
from identification.plan.heard import Heard, heard
from identification.plan.prior import Person
from identification.plan.protocol import shaking_s
from identification.plan.result import believed
from identification.plan.shaker import Shaker

#: Why a session ended.
MET, NEVER, SPENT, FAILING, STOPPED = "met", "never", "spent", "failing", "stopped"
#: So many steps in a row that fail end a session: then it is the shaker, not the step.
_FAILURES = 3
#: A step lasts at most so many of the usual lengths, as the next one may be worth more by then.
_LONGEST = 3
#: A base whose harmonics are larger than this share of its fundamental, or whose coherence is lower than that, is told.
DISTORTED, INCOHERENT = 0.10, 0.95

#: Makes the recording of a step.
Record = Callable[[Step], Recording]


class Offering:
    """What a session tells, and asks: this one takes every step and says nothing."""

    def step(self, proposed: Step, why: str) -> Step | None:
        """The step to take, None to end."""
        return proposed

    def told(self, sentence: str) -> None:
        """What happened."""


@dataclass(frozen=True, eq=False)
class Taken:
    """One step that was tried.

    Attributes:
        step: as proposed. heard: what it was, None where it failed. why: it failed. bands: of the constants after it.
        log_odds: of the likelier branch after it. branch: its name. decided: whether that is beyond 1000 to 1.
    """

    step: Step
    heard: Heard | None
    why: str
    bands: Mapping[str, Band]
    log_odds: float
    branch: str
    decided: bool


@dataclass(frozen=True, eq=False, repr=False)
class Shaken(Presented):
    """A session that has ended.

    Attributes:
        taken: steps in order. ended: MET, NEVER, SPENT, FAILING or STOPPED. reason: in a sentence. said: what is known
            of the foot. asked: half-widths by constant. recordings: all that count, the earlier ones first.
    """

    figures: ClassVar[str] = ""
    plots: ClassVar[tuple[str, ...]] = ()

    taken: tuple[Taken, ...]
    ended: str
    reason: str
    said: str
    asked: Mapping[str, float]
    recordings: tuple[Recording, ...]

    @property
    def good(self) -> tuple[Taken, ...]:
        """Steps that were recorded."""
        return tuple(t for t in self.taken if t.heard is not None)

    def sentence(self) -> str:
        """How it ended, and with what."""
        minutes = shaking_s([t.step for t in self.good]) / 60
        count = f"{len(self.good)} recording{'' if len(self.good) == 1 else 's'}"
        return f"{self.reason} {count}, {minutes:.2g} minutes of shaking. {self.said}"

    def sheet(self) -> Sheet:
        """Step by step, with the bands that narrow."""
        rows = []
        for number, t in enumerate(self.taken, start=1):
            h = t.heard
            rows.append(
                (
                    str(number), f"{t.step.frequency_hz:g}", f"{t.step.added_mass_kg:g}", f"{t.step.seconds:g}",
                    f"{h.level_m_s2:.3g}" if h else "failed", f"{100 * h.distortion:.2g} %" if h else "–",
                    f"{h.coherence:.4f}" if h else "–",
                    f"{h.transmissibility:.3g} +- {0.5 * (h.upper - h.lower):.2g}" if h else "–",
                    *(f"+-{100 * t.bands[n].half_width:.3g} %" if n in t.bands else "–" for n in EXCHANGED),
                    f"{t.branch}{'' if t.decided else '?'}" if t.branch else "–",
                )
            )  # fmt: skip
        columns = (
            "step", "Hz", "kg", "s", "m/s^2", "distortion", "coherence", "transmissibility", *EXCHANGED, "branch"
        )  # fmt: skip
        failed = [f"Step {i} failed: {t.why}" for i, t in enumerate(self.taken, start=1) if t.why]
        return Sheet("A session on the shaker", columns, rows, [self.sentence(), *failed])

    def records(self) -> list[dict[str, Any]]:
        """One row a step."""
        rows = []
        for t in self.taken:
            row: dict[str, Any] = {**asdict(t.step), "sensors": ",".join(t.step.sensors)}
            row |= asdict(t.heard) if t.heard else {}
            row |= {"why": t.why, "branch": t.branch, "log_odds": t.log_odds, "decided": t.decided}
            for name in EXCHANGED:
                if name in t.bands:
                    row |= {f"{name}_{end}": getattr(t.bands[name], end) for end in ("value", "lower", "upper")}
            rows.append(row)
        return rows

    def document(self) -> dict[str, Any]:
        """The session as plain data."""
        return {
            "steps": self.records(), "ended": self.ended, "reason": self.reason, "sentence": self.sentence(),
            "shaking_s": shaking_s([t.step for t in self.good]), "recordings": len(self.good), "asked": self.asked,
        }  # fmt: skip


class Session:
    """Recordings one by one, each chosen after the last.

    Args:
        person: on the shaker. shaker: its limits. ask: half-widths that are asked for. most: recordings. seconds: of
            shaking in all. seed, draws: of the director. record: makes a recording. offering: tells and asks.
        earlier: recordings that exist, checked.
    """

    def __init__(
        self,
        person: Person,
        shaker: Shaker,
        ask: Mapping[str, float],
        most: int,
        seconds: float,
        seed: int,
        draws: int,
        record: Record,
        offering: Offering | None = None,
        earlier: Sequence[Recording] = (),
    ) -> None:
        if most < 1 or seconds < shaker.seconds:
            raise SettingError(f"{most} recordings in {seconds:g} s leave no room for one of {shaker.seconds:g} s.")
        self._person, self._shaker, self._ask = person, shaker, dict(ask)
        self._most, self._seconds, self._seed, self._draws = most, seconds, seed, draws
        self._record, self._offering = record, offering or Offering()
        self._recordings = list(earlier)
        self._before = len(self._recordings)
        self._taken: list[Taken] = []
        self._failed: set[tuple[float, float]] = set()
        self._believed: Belief | None = None

    def run(self) -> Shaken:
        """Until it ends by itself, or nobody takes the next step."""
        load: float | None = None
        while True:
            director = self._direct()
            if ended := self._over(director):
                return self._end(director, *ended)
            step = self._next(director, load)
            if step is None:
                return self._end(director, FAILING, "Every step that is left has failed.")
            why = f"adds most to what {len(self._recordings)} recordings say"
            chosen = self._offering.step(step, why)
            if chosen is None:
                return self._end(director, STOPPED, "Nobody took the next step.")
            self._take(chosen)
            load = chosen.added_mass_kg

    def _direct(self) -> Director:
        director = Director(
            self._person, self._shaker, self._ask, self._recordings, self._seed, self._draws, self._believed,
            compares=False,
        )  # fmt: skip
        self._believed = director.belief
        if self._taken and self._taken[-1].heard is not None:
            self._taken[-1] = _after(self._taken[-1], director.belief)
            self._offering.told(believed(director))
        return director

    def _over(self, director: Director) -> tuple[str, str] | None:
        """Why the session ends here, if it does."""
        belief = director.belief
        count, spent = len(self._recordings) - self._before, shaking_s([t.step for t in self._taken if t.heard])
        if belief is not None:
            bands = belief.open_bands(EXCHANGED)
            wide = [name for name in EXCHANGED if bands[name].half_width > director.asked[name]]
            if belief.decided and not wide:
                return MET, "What is asked is met."
            ever = director.for_ever()
            never = [name for name in wide if ever.half_width[name] > director.asked[name]]
            open_ = not belief.decided and ever.decided < SHARE
            if (never or open_) and len(never) == len(wide) and (open_ or belief.decided):
                what = [f"{n} below +-{100 * ever.half_width[n]:.2g} %" for n in never] + ["the branch"] * open_
                return NEVER, f"No protocol of these candidates will ever bring {', nor '.join(what)}."
        if count >= self._most or spent + self._shaker.seconds > self._seconds + 1e-9:
            return SPENT, "The recordings or minutes that were given are spent."
        if len(self._taken) >= _FAILURES and all(t.heard is None for t in self._taken[-_FAILURES:]):
            return FAILING, f"{_FAILURES} steps in a row have failed."
        return None

    def _next(self, director: Director, load: float | None) -> Step | None:
        """The best step of a plan for what is left of the time, under the load that is there while it has one."""
        count = len(self._recordings) - self._before
        left = self._seconds - shaking_s([t.step for t in self._taken if t.heard])
        barred = [s for s in director.candidates if (s.frequency_hz, s.added_mass_kg) in self._failed]
        rest = [s for s in director.session(self._most - count, left) if not _among(s, barred)]
        if not rest:
            scores = director.scores(())
            order = sorted(range(len(scores)), key=lambda i: -scores[i].total)
            rest = [director.candidates[i] for i in order if director.candidates[i] not in barred][:1]
        if not rest:
            return None
        # the first ones are for a look: what follows depends on them
        longest = self._shaker.seconds * (_LONGEST if self._recordings else 1)
        rest = [replace(s, seconds=min(s.seconds, longest, left)) for s in rest]
        here = [s for s in rest if s.added_mass_kg == load] or rest
        gains = director.gains(here)
        return here[int(np.argmax(gains))]

    def _take(self, step: Step) -> None:
        try:
            recording = checked(self._record(step))
            found = heard(recording)
        except (AcquisitionError, RecordingError, SimulationError) as error:
            self._failed.add((step.frequency_hz, step.added_mass_kg))
            self._taken.append(Taken(step, None, str(error), {}, 0.0, "", False))
            self._offering.told(f"{step}: failed, {error}")
            return
        self._recordings.append(recording)
        self._taken.append(Taken(step, found, "", {}, 0.0, "", False))
        notes = []
        if found.distortion > DISTORTED:
            notes.append("the base is distorted")
        if found.coherence < INCOHERENT:
            notes.append("the foot does not follow the base alone")
        self._offering.told(f"{step}: {found}{'; ' + ', '.join(notes) if notes else ''}")

    def _end(self, director: Director, ended: str, reason: str) -> Shaken:
        said = believed(director)
        return Shaken(tuple(self._taken), ended, reason, said, dict(director.asked), tuple(self._recordings))


def _after(taken: Taken, belief: Belief | None) -> Taken:
    assert belief is not None
    return replace(
        taken, bands=belief.open_bands(EXCHANGED), log_odds=belief.log_odds, branch=belief.ends[0].name,
        decided=belief.decided,
    )  # fmt: skip


def _among(step: Step, barred: Sequence[Step]) -> bool:
    return any(replace(step, seconds=s.seconds) == s for s in barred)
