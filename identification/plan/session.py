"""Shaking, fitting and planning in turn, until what is asked is met, or can never be, or the time is over."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.acquire.board import Stalled
from fasbody.acquire.person import note
from fasbody.console import heeded
from fasbody.exceptions import AcquisitionError, FasError, RecordingError, SettingError, SimulationError
from fasbody.foot.parameters import symbol_and_unit
from fasbody.presentation import Presented, Sheet, counted, listed
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.branches import EXCHANGED
from identification.fitting import fit_foot
from identification.plan.belief import Band
from identification.plan.candidates import Step, shaking_s
from identification.plan.director import GOAL, HOPELESS, SHARE, Director
from identification.plan.observed import Observed, observed
from identification.plan.prior import Person
from identification.plan.result import Longer, believed, goal, nothing_brings
from identification.plan.shaker import Shaker
from identification.plan.words import chance, in_the_way, minutes, percent, plain

#: Why a session ended.
MET, NEVER, SPENT, FAILING, STOPPED = "met", "never", "spent", "failing", "stopped"
INTERRUPTED, BROKEN = "interrupted", "broken"
#: So many steps in a row that fail end a session: then it is the shaker, not the step.
_FAILURES = 3
#: Laying another load on the knee costs as much as so long a shaking under this one [s]: two hands lay it in half a
#: minute, and the person stands as before after as long again. An assumption, not a measurement.
CHANGE_S = 60.0
#: Within this factor of what unlimited minutes leave, an interval is as narrow as it gets: of that few recordings make
#: 1.1, by Student's quantile and as the fit has no population.
_NEARLY = 1.15
#: What is left to record helps if it is expected to bring an interval below this share of what it is.
_HELPS = 0.98
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

    def report(self, sentence: str) -> None:
        """What happened."""


@dataclass(frozen=True, eq=False)
class Taken:
    """One step that was tried.

    Attributes:
        step: as proposed.
        observed: what it was, None where it failed.
        why: it failed.
        bands: of the constants after it.
        log_odds: of the likelier branch after it.
        branch: its name.
        decided: whether that is beyond 1000 to 1.
        stalled: it was the board that failed, not the step.
    """

    step: Step
    observed: Observed | None
    why: str = ""
    bands: Mapping[str, Band] = field(default_factory=dict)
    log_odds: float = 0.0
    branch: str = ""
    decided: bool = False
    stalled: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Shaken(Presented):
    """A session that has ended.

    Attributes:
        taken: steps in order.
        ended: one of the words above.
        reason: in a sentence.
        findings: what is known of the foot.
        asked: half-widths by constant.
        recordings: all that count, the earlier ones first.
        bands: of the constants.
        left: steps that the last plan has and nobody has taken.
    """

    taken: tuple[Taken, ...]
    ended: str
    reason: str
    findings: str
    asked: Mapping[str, float]
    recordings: tuple[Recording, ...]
    bands: Mapping[str, Band]
    left: tuple[Step, ...]

    def write(self, folder: Path | str) -> list[Path]:
        """Write session.json into a folder; the exposure that it keeps of each day stays."""
        return [note(Path(folder), **self.document())]

    @property
    def good(self) -> tuple[Taken, ...]:
        """Steps that were recorded."""
        return tuple(t for t in self.taken if t.observed is not None)

    def sentence(self) -> str:
        """How it ended, and with what."""
        shaken = minutes(shaking_s([t.step for t in self.good]))
        return f"{self.reason} {counted(len(self.good), 'recording')}, {shaken} of shaking. {self.findings}"

    def sheet(self) -> Sheet:
        """Step by step, with the bands that narrow."""
        rows = []
        for number, t in enumerate(self.taken, start=1):
            h = t.observed
            rows.append(
                (
                    str(number), f"{t.step.frequency_hz:g}", f"{t.step.added_mass_kg:g}", f"{t.step.seconds:g}",
                    f"{h.level_m_s2:.3g}" if h else "stalled" if t.stalled else "failed",
                    plain(100 * h.distortion) if h else "–", f"{h.coherence:.4f}" if h else "–",
                    f"{h.transmissibility:.3g}" if h else "–",
                    *(plain(100 * t.bands[n].half_width, 3) if n in t.bands else "–" for n in EXCHANGED),
                    f"{t.branch}{'' if t.decided else '?'}" if t.branch else "–",
                )
            )  # fmt: skip
        columns = (
            "step", "frequency [Hz]", "load [kg]", "time [s]", "base [m/s^2]", "distortion [%]", "coherence", "T",
            *(f"{name} [±%]" for name in EXCHANGED), "branch",
        )  # fmt: skip
        last = self.left if self.ended in (STOPPED, INTERRUPTED, BROKEN) else ()
        left = [f"Planned and not recorded: {'; '.join(map(str, last))}."] if last else []
        failed = [
            f"Step {i} {'stalled' if t.stalled else 'failed'}: {t.why}"
            for i, t in enumerate(self.taken, start=1)
            if t.why
        ]
        title = "A session on the shaker (T: transmissibility; last columns: half of each 95 % interval)"
        return Sheet(title, columns, rows, [self.sentence(), goal(self.asked), *failed, *left])

    def records(self) -> list[dict[str, Any]]:
        """One row a step."""
        rows = []
        for t in self.taken:
            row: dict[str, Any] = {**asdict(t.step), "sensors": ",".join(t.step.sensors)}
            row |= asdict(t.observed) if t.observed else {}
            row |= {name: getattr(t, name) for name in ("why", "stalled", "branch", "log_odds", "decided")}
            for name in EXCHANGED:
                if name in t.bands:
                    row |= {f"{name}_{end}": getattr(t.bands[name], end) for end in ("value", "lower", "upper")}
            rows.append(row)
        return rows

    def document(self) -> dict[str, Any]:
        """The session as plain data."""
        return {
            "steps": self.records(), "ended": self.ended, "reason": self.reason, "sentence": self.sentence(),
            "shaking_s": shaking_s([t.step for t in self.good]), "recordings": len(self.good),
            "asked": {name: self.asked.get(name) for name in EXCHANGED},
            "fit": {name: asdict(band) for name, band in self.bands.items()}, "said": self.findings,
            "left": [asdict(step) for step in self.left],
        }  # fmt: skip


class Session:
    """Recordings one by one, each chosen after the last.

    Args:
        person: on the shaker.
        shaker: its limits.
        ask: half-widths that are asked for, and no others; none for the usual goal.
        most: recordings.
        seconds: of shaking in all.
        seed, draws: of the director.
        record: makes a recording.
        offering: tells and asks.
        earlier: recordings that exist, checked.
        change_s: what laying another load costs, in seconds of shaking.
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
        change_s: float = CHANGE_S,
    ) -> None:
        if not 0 <= change_s <= 3600:
            raise SettingError(f"a change of load that costs as much as {change_s:g} s of shaking; valid: 0 to 3600.")
        if most < 1 or seconds < shaker.seconds:
            raise SettingError(
                f"{seconds:g} s for {counted(most, 'recording')} leave no room for one of {shaker.seconds:g} s."
            )
        self._person, self._shaker, self._ask = person, shaker, dict(ask or GOAL)
        self._most, self._seconds, self._seed, self._draws = most, seconds, seed, draws
        self._record, self._offering = record, offering or Offering()
        self._recordings = list(earlier)
        self._taken: list[Taken] = []
        self._failed: set[tuple[float, float]] = set()
        self._again: Step | None = None
        self._director: Director | None = None
        self._change_s = change_s
        self._load: float | None = None
        self._left: tuple[Step, ...] = ()
        self._fitted: Mapping[str, Band] = {}

    def run(self) -> Shaken:
        """Until it ends by itself, nobody takes the next step, it is interrupted, or it cannot go on.

        Ctrl-C, or what can neither be recorded nor fitted, ends it with what there is.
        """
        self._offering.report(goal(self._ask))
        try:
            while True:
                with heeded():  # compiled code makes something else of Ctrl-C
                    director = self._direct()
                    ended = self._over(director)
                    step = None if ended else self._again or self._next(director)
                    ended = ended or (None if self._again else self._idle(director))
                if ended:
                    return self._end(*ended)
                if step is None:
                    return self._end(FAILING, "Every remaining step has failed.")
                count = len(self._recordings)
                why = f"adds the most information to {counted(count, 'recording')}"
                why = "again, as the board stalled" if self._again else why
                chosen = self._offering.step(step, why)
                if chosen is None:
                    return self._end(STOPPED, "The next step was not taken.")
                self._take(chosen)
        except KeyboardInterrupt:
            return self._end(INTERRUPTED, "Interrupted.")
        except FasError as error:
            if not self._taken:  # nothing is lost
                raise
            return self._end(BROKEN, f"Recording cannot continue: {error}")

    @property
    def _done(self) -> list[Step]:
        """The steps of this session that were recorded."""
        return [t.step for t in self._taken if t.observed]

    def _direct(self) -> Director:
        director = Director(
            self._person, self._shaker, self._ask, self._recordings, self._seed, self._draws,
            None if self._director is None else self._director.belief, compares=False,
        )  # fmt: skip
        self._director, belief = director, director.belief
        if belief is not None and self._taken and self._taken[-1].observed is not None:
            self._taken[-1] = replace(
                self._taken[-1], bands=belief.open_bands(EXCHANGED), log_odds=belief.log_odds,
                branch=belief.ends[0].branch, decided=belief.decided,
            )  # fmt: skip
            self._offering.report(believed(director))
        return director

    def _over(self, director: Director) -> tuple[str, str] | None:
        belief, done = director.belief, self._done
        if belief is not None:
            bands, missed = belief.open_bands(EXCHANGED), self._missed(director)
            if belief.decided and not missed and self._confirmed():
                return MET, "The fit of all recordings reaches the goal."
            ever = director.for_ever()
            never = [name for name in missed if ever.half_width[name] > director.asked[name]]
            open_ = not belief.decided and ever.decided < HOPELESS
            # it goes on while anything that is asked for comes nearer with more minutes
            near = [n for n in never if bands[n].half_width <= _NEARLY * ever.half_width[n]]
            if len(near) == len(missed) > 0 and ever.goal() < HOPELESS and (belief.decided or open_):
                return NEVER, nothing_brings(ever, director.causes(), never, open_, self._shaker)
        if len(done) >= self._most or shaking_s(done) + self._shaker.seconds > self._seconds + 1e-9:
            return SPENT, f"The planned recordings or minutes are used up. {self._missing(director)}".strip()
        last = self._taken[-_FAILURES:]
        if len(last) == _FAILURES and all(t.observed is None for t in last):
            if all(t.stalled for t in last):
                return FAILING, f"The board has stalled {_FAILURES} times in a row: {last[-1].why}"
            return FAILING, f"{_FAILURES} steps in a row have failed."
        return None

    def _confirmed(self) -> bool:
        """Whether the fit itself, which knows no population, decides and is as narrow as asked."""
        known = self._person.known
        try:
            result = fit_foot(
                self._recordings, self._person.foot, mass_std=known.mass_std, gain_std=known.gain_std,
                delay_std_s=known.delay_std_s, exclude=tuple(known.excluded), threads=1,
            )  # fmt: skip
        except FasError:
            return False
        estimates = {symbol_and_unit(key)[0]: e for key, e in result.best.parameters.items()}
        self._fitted = {name: Band.of(estimates[name]) for name in EXCHANGED}
        missed = [n for n, share in self._ask.items() if self._fitted[n].half_width > share]
        if result.verdict == "decided" and not missed:
            return True
        what = [f"{n} ±{percent(self._fitted[n].half_width)}" for n in missed]
        what += ["the branch undecided"] * (result.verdict != "decided")
        self._offering.report(f"The fit of all recordings has not reached the goal yet: {listed(what)}.")
        return False

    def _idle(self, director: Director) -> tuple[str, str] | None:
        """Why the session ends although there is time: all that is left would fail, and brings nothing nearer."""
        belief, rest = director.belief, self._left
        if belief is None or not rest:
            return None
        now, then, bands = director.outlook(()), director.outlook(rest), belief.open_bands(EXCHANGED)
        missed = self._missed(director)
        helps = any(then.half_width[name] < _HELPS * now.half_width[name] for name in missed)
        if then.goal() >= HOPELESS or helps or not missed or (not belief.decided and then.decided > now.decided):
            return None
        still = [f"{name} stays at ±{percent(bands[name].half_width)}" for name in missed]
        still += ["the branch stays undecided"] * (not belief.decided)
        return NEVER, (
            f"More recording would not help: after {counted(len(rest), 'more recording')} "
            f"({minutes(shaking_s(rest))} in all), {listed(still)}. The goal would be reached with a probability of "
            f"{chance(then.goal())}."
        )

    def _missing(self, director: Director) -> str:
        """What it would take where noise is in the way of what is asked."""
        belief = director.belief
        if belief is None or not self._done:
            return ""
        ever, missed = director.for_ever(), self._missed(director)
        names = [n for n in missed if ever.likely(n) >= SHARE]
        branch = not belief.decided and ever.decided >= SHARE
        never, open_ = [n for n in missed if n not in names], not belief.decided and not branch
        usual = [replace(step, seconds=self._shaker.seconds) for step in self._done]
        again = [s for s in usual if s in director.candidates]
        longer = Longer.of(director, "these recordings", again, names, branch, self._seconds)
        out_of_reach = nothing_brings(ever, director.causes(), never, open_, self._shaker)
        if not longer:
            return out_of_reach
        of = ", ".join([*names, *["the branch"] * branch])
        return f"{in_the_way(director.repeatability, of)} {longer} {out_of_reach}".strip()

    def _missed(self, director: Director) -> list[str]:
        assert director.belief is not None
        bands = director.belief.open_bands(EXCHANGED)
        return [name for name, share in director.asked.items() if bands[name].half_width > share]

    def _next(self, director: Director) -> Step | None:
        """The step of a plan for what is left of the time that adds most.

        Another load is laid where that adds more than going on under this one for as long as the change costs, too.
        """
        done = self._done
        left = self._seconds - shaking_s(done)
        barred = [s for s in director.candidates if (s.frequency_hz, s.added_mass_kg) in self._failed]
        planned = director.session(self._most - len(done), left)
        rest = [s for s in planned if not _among(s, barred)]
        self._left = tuple(rest)
        if not rest:
            scores = director.scores(())
            order = sorted(range(len(scores)), key=lambda i: -scores[i].total)
            rest = [director.candidates[i] for i in order if director.candidates[i] not in barred][:1]
        if not rest:
            return None
        # the first ones are for a look: what follows depends on them
        longest = self._shaker.seconds * (_LONGEST if self._recordings else 1)
        rest = [replace(s, seconds=min(s.seconds, longest, left)) for s in rest]
        same_load = [step for step in rest if step.added_mass_kg == self._load]
        other_load = [step for step in rest if step.added_mass_kg != self._load]
        if other_load and self._load is not None:
            stay = [step for step in director.candidates if step.added_mass_kg == self._load]
            longer = [replace(step, seconds=step.seconds + self._change_s) for step in stay if not _among(step, barred)]
            pays = not longer or director.gains(other_load).max() > director.gains(longer).max()
            rest = other_load if pays or not same_load else same_load
        return rest[int(np.argmax(director.gains(rest)))]

    def _take(self, step: Step) -> None:
        self._load, self._again = step.added_mass_kg, None
        try:
            recording = checked(self._record(step))
            lines = observed(recording)
        except Stalled as error:
            self._again = step
            self._taken.append(Taken(step, None, str(error), stalled=True))
            self._offering.report(f"{step}: the board stalled, {error}")
            return
        except (AcquisitionError, RecordingError, SimulationError) as error:
            self._failed.add((step.frequency_hz, step.added_mass_kg))
            self._taken.append(Taken(step, None, str(error)))
            self._offering.report(f"{step}: failed, {error}")
            return
        self._recordings.append(recording)
        self._taken.append(Taken(step, lines))
        done = next((i for i, s in enumerate(self._left) if _among(s, [step])), len(self._left))
        self._left = (*self._left[:done], *self._left[done + 1 :])  # a condition may be planned again
        notes = []
        if lines.distortion > DISTORTED:
            notes.append("the base is distorted")
        if lines.coherence < INCOHERENT:
            notes.append("the foot does not follow the base alone")
        self._offering.report(f"{step}: {lines}{'; ' + ', '.join(notes) if notes else ''}")

    def _end(self, ended: str, reason: str) -> Shaken:
        director = self._director
        belief = None if director is None else director.belief
        return Shaken(
            tuple(self._taken), ended, reason, "Nothing is recorded yet." if director is None else believed(director),
            self._ask, tuple(self._recordings),
            self._fitted if ended == MET else {} if belief is None else belief.open_bands(EXCHANGED), self._left,
        )  # fmt: skip


def _among(step: Step, barred: Sequence[Step]) -> bool:
    return any(replace(step, seconds=s.seconds) == s for s in barred)
