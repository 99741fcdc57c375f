"""Which mechanism made the recordings of a person: the sines of a study, read and given to the analysis of `decide`.

The same analysis is tried on virtual subjects who are shaken as the person was, so that its answer comes with how often
it is right for these very recordings.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.leg.decide import (
    DECIDED,
    NONE,
    RIVALS,
    UNDECIDED,
    Analysis,
    Confusion,
    Fitted,
    Plan,
    Verdict,
    draw,
    measured,
)
from fasbody.leg.mechanisms import BODY_KG
from fasbody.leg.virtual import NOISE, Recordings
from fasbody.presentation import Presented, Sheet
from fasbody.recording.checks import checked
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.recording import Recording
from fasbody.transmissibility.steps import steps_of

Array = np.ndarray
#: Share of the table's own second harmonic above which the malleolus' second one says nothing about the foot.
CLEAN = 0.01
#: Share of the malleolus' acceleration at half and one and a half times the frequency beyond which a motion does not
#: repeat after one period, and standard deviations of the noise that it must exceed.
DOUBLED, BEYOND = 0.03, 4.0
#: Numbers (real and imaginary parts) that a verdict takes at least, for each constant of the richest mechanism.
ENOUGH = 2.0


@dataclass(frozen=True)
class Seen:
    """The sines of one person in one posture.

    Attributes:
        subject: as the study calls the person. posture: of the foot. body_kg: stated body mass, None where it is not.
        plan: what was shaken. recordings: what was read. left_out: a sentence on each recording that cannot serve.
    """

    subject: str
    posture: str
    body_kg: float | None
    plan: Plan
    recordings: Recordings
    left_out: tuple[str, ...]


def read(recordings: Sequence[Recording]) -> list[Seen]:
    """Complex responses of each person's sines, by subject and posture.

    Frequencies are rounded to 0.1 Hz, so that two amplitudes at one frequency are seen as such. The tuberosity is used
    where every recording has it, the second harmonic where it can be read and the table has next to none of its own.

    Args:
        recordings: of any number of people; those that are no sines are left out, and said to be.
    """
    people: dict[tuple[str, str], list[Recording]] = {}
    for recording in recordings:
        people.setdefault((recording.condition.subject, recording.condition.posture), []).append(recording)
    return [_read(subject, posture, own) for (subject, posture), own in people.items()]


def _read(subject: str, posture: str, recordings: Sequence[Recording]) -> Seen:
    rows: list[_Row] = []
    left_out = []
    for recording in recordings:
        try:
            rows += _sines(recording)
        except RecordingError as error:
            left_out.append(str(error))
    tuberosity = bool(rows) and all(np.isfinite(row.TB) for row in rows)
    harmonics = bool(rows) and all(row.distortion < CLEAN for row in rows)
    hz, added, table = (np.array([getattr(row, k) for row in rows]) for k in ("frequency_hz", "added_kg", "table"))
    plan = Plan("these recordings", np.round(hz, 1), added, table, tuberosity, harmonics)
    MB, TB, second = (np.array([getattr(row, k) for row in rows], complex) for k in ("MB", "TB", "second"))
    repeats = np.array([row.repeats for row in rows], bool)
    made = Recordings(MB, TB if tuberosity else MB, second, np.full(len(rows), np.nan), repeats)
    return Seen(subject, posture, recordings[0].condition.body_mass_kg, plan, made, tuple(left_out))


@dataclass(frozen=True)
class _Row:
    frequency_hz: float
    added_kg: float
    table: float
    MB: complex
    TB: complex
    second: complex
    distortion: float
    repeats: bool


def _sines(recording: Recording) -> Iterator[_Row]:
    """What one recording gives at each of its sines.

    Raises:
        RecordingError: its checks, or it is no sine.
    """
    good = checked(recording)
    f = good.condition.frequency_hz
    parts = [(slice(None), f)] if f is not None else steps_of(good.time_s, good.base_m_s2)
    if not parts:
        raise RecordingError(f"{good.file} is no sine; only sines name a mechanism.")
    for part, hz in parts:
        t = good.time_s[part] - good.time_s[part][0]
        two = 2 if 2 * hz < 0.4 * good.rate_hz else 1
        base, malleolus = (fit_harmonics(t, x[part], hz, two) for x in (good.base_m_s2, good.malleolus_m_s2))
        first, moved = base.amplitudes[0], malleolus.amplitudes[0]
        TB = complex(np.nan)
        if good.tuberosity_m_s2 is not None:
            TB = fit_harmonics(t, good.tuberosity_m_s2[part], hz, 1).amplitudes[0] / first
        # as if the table moved as a sin(w t): its phase counts once for the first harmonic, twice for the second
        turn = 1j * first / abs(first)
        second = malleolus.amplitudes[1] / moved / turn if two == 2 else complex(np.nan)
        distortion = abs(base.amplitudes[1] / first) if two == 2 else np.inf
        yield _Row(hz, good.condition.added_mass_kg, abs(first), moved / first, TB, second, distortion,
                   _repeats(t, good.malleolus_m_s2[part], hz))  # fmt: skip


def _repeats(time_s: Array, signal: Array, frequency_hz: float) -> bool:
    """Whether a motion repeats after one period: it has nothing at half and at one and a half times the frequency."""
    if (time_s[-1] - time_s[0]) * frequency_hz < 6:
        return True  # too short to see
    found = fit_harmonics(time_s, signal, frequency_hz / 2, 3)
    size = abs(found.amplitudes[1])
    return all(abs(found.amplitudes[h]) < max(DOUBLED * size, BEYOND * found.std[h]) for h in (0, 2))


@dataclass(frozen=True, repr=False)
class Naming(Presented):
    """The mechanism that made one person's recordings.

    Attributes:
        seen: the recordings. verdict: what the analysis says. fits: of each mechanism, the best one first.
        enough: whether there are numbers enough for a verdict. tried: virtual subjects who were shaken as the person
            was; None where none were.
    """

    seen: Seen
    verdict: Verdict
    fits: Sequence[Fitted]
    enough: bool
    tried: Confusion | None = None

    figures: ClassVar[str] = "fasbody.leg.figures"
    plots: ClassVar[tuple[str, ...]] = ("naming",)

    @property
    def named(self) -> str:
        """The mechanism, "undecided" or "none of these"."""
        return self.verdict.named if self.enough else UNDECIDED

    @property
    def sentence(self) -> str:
        """The result."""
        who = f"subject {self.seen.subject}" if self.seen.subject else "this person"
        if not self.enough:
            count = self.seen.plan.frequency_hz.size
            return f"Undecided for {who}: {count} sines are too few to tell {len(self.fits)} mechanisms apart."
        if self.named == NONE:
            return f"None of these for {who}: even {self.verdict.best} misses ({self.verdict.per_dof:.1f} per number)."
        if self.named == UNDECIDED:
            return f"Undecided for {who}: {self.verdict.best} is nearest, but below odds of 1000 to 1."
        return f"{self.named.capitalize()} for {who}, at odds of more than 1000 to 1, if it is one of these mechanisms."

    @property
    def notes(self) -> list[str]:
        """What the reader has to know beside it."""
        plan, seen = self.seen.plan, self.seen
        said = [f"Left out: {text}" for text in seen.left_out]
        if self.verdict.lost:
            said.append(f"{self.verdict.lost} recordings do not repeat after one period and are not fitted.")
        if seen.body_kg is None:
            said.append(f"No body mass is stated; {BODY_KG:g} kg is taken.")
        if np.ptp(plan.added_kg) == 0:
            said.append("All recordings have one load: what a load does cannot tell mechanisms apart here.")
        if not plan.tuberosity:
            said.append("Without the tuberosity in each recording only the malleolus is used.")
        if not plan.harmonics:
            said.append(f"Second harmonics are not used: the table has more than {100 * CLEAN:g} % of its own, "
                        "or the sampling is too slow.")  # fmt: skip
        if not (plan.partner >= 0).any():
            said.append(
                "No frequency was shaken at two amplitudes, which shows best whether the foot leaves the plate."
            )
        said.append(f"Assumed, not measured: scatter of {100 * NOISE:g} % and a foot within 8 % of one mechanism.")
        if self.tried is not None:
            t = self.tried
            likewise = f"Of {t.subjects} virtual subjects who were shaken in the same way"
            said.append(f"{likewise} the analysis names {t.right} rightly, {t.wrong} wrongly.")
        return said

    def records(self) -> list[dict[str, Any]]:
        """One row for each mechanism."""
        best = self.fits[0].criterion
        return [{
            "subject": self.seen.subject, "posture": self.seen.posture, "named": self.named, "mechanism": fit.rival,
            "criterion_over_best": fit.criterion - best, "sum_of_squares": fit.chi2, "in_the_air": fit.air,
        } for fit in self.fits]  # fmt: skip

    def document(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "subject": self.seen.subject, "posture": self.seen.posture, "named": self.named, "sentence": self.sentence,
            "recordings": self.seen.plan.frequency_hz.size, "per_degree_of_freedom": self.verdict.per_dof,
            "mechanisms": self.records(), "constants": {fit.rival: fit.values for fit in self.fits},
            "notes": self.notes, "tried": None if self.tried is None else self.tried.record(),
        }  # fmt: skip

    def sheet(self) -> Sheet:
        """The mechanisms, the best one first."""
        rows = []
        for row in self.records():
            over = row["criterion_over_best"]
            odds = "best" if over == 0 else "excluded" if over >= DECIDED else f"{np.exp(over / 2):.0f} to 1 against"
            air = f"{100 * row['in_the_air']:.0f} %" if row["in_the_air"] else ""
            rows.append(
                (
                    row["mechanism"],
                    odds,
                    f"{over:.1f}" if np.isfinite(over) else "",
                    f"{row['sum_of_squares']:.0f}",
                    air,
                )
            )
        columns = ("mechanism", "odds", "criterion over the best", "sum of squares", "in the air")
        count = self.seen.plan.frequency_hz.size
        return Sheet(f"{count} sines, {self.seen.posture}", columns, rows, (self.sentence, *self.notes))


def name(seen: Seen, subjects: int = 0, seed: int = 0) -> Iterator[Naming]:
    """Name the mechanism of one person; then, one by one, virtual subjects of each mechanism are shaken likewise.

    Args:
        seen: one person's sines.
        subjects: virtual subjects of each mechanism.
        seed: of the virtual subjects.

    Returns:
        The result, again after each virtual subject.

    Raises:
        RecordingError: no recording of the person can serve.
    """
    plan, data = seen.plan, seen.recordings
    if not data.repeats.any():
        who = f"subject {seen.subject}" if seen.subject else "this person"
        why = seen.left_out[0] if seen.left_out else "no motion repeats after one period."
        raise RecordingError(f"No recording of {who} can be used: {why}")
    analysis = Analysis(plan, body_kg=seen.body_kg or BODY_KG)
    verdict, fits = analysis.judged(data)
    numbers = 2 * int(data.repeats.sum()) * (1 + plan.tuberosity)
    richest = max(len(each.constants) for each in analysis.rivals.values())
    result = Naming(seen, verdict, fits, numbers >= ENOUGH * richest)
    yield result
    found: dict[str, list[Verdict]] = {rival: [] for rival in RIVALS}
    for number in range(subjects if result.enough else 0):
        for rival in RIVALS:
            rng = np.random.default_rng([seed, RIVALS.index(rival), number])
            made = measured(draw(rival, rng, body_kg=seen.body_kg or BODY_KG), plan, rng)
            if made.repeats.any():
                found[rival].append(analysis.verdict(made))
            yield replace(result, tried=Confusion(plan.name, found))
