"""Which mechanism made the recordings of a person: the sines of a study, read and given to the analysis of `decide`.

The same analysis is tried on virtual subjects who are shaken as the person was, so that its answer comes with how
many of them it names rightly.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.leg.decide import (
    AIR,
    DECIDED,
    DEPARTURE,
    HIGHER,
    NONE,
    RICHER,
    RIVALS,
    UNDECIDED,
    Analysis,
    Confusion,
    Fitted,
    Plan,
    Verdict,
    draw,
    is_pressed,
    measured,
)
from fasbody.leg.decide import named as named_mechanism
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
#: When a motion does not repeat after one period. Its subharmonics, at half and one and a half times the frequency,
#: exceed each of these: a share of the malleolus' acceleration at the frequency; what the leg can amplify of the
#: table's own subharmonics (some threefold); the detection limit, in standard deviations of the noise.
SUBHARMONIC, AMPLIFIED, DETECTED = 0.03, 5.0, 4.0
#: Numbers (real and imaginary parts) that a verdict takes at least, for each constant of the richest mechanism.
ENOUGH = 2.0
#: Sum of squares per number below which a foot is far nearer to a mechanism than the departure that is assumed.
CLOSE = 0.1
#: Virtual subjects from which on the share that is named rightly is known to some 5 %.
RATE = 100


@dataclass(frozen=True)
class Seen:
    """The sines of one person in one posture.

    Attributes:
        subject: as the study calls the person. posture: of the foot. body_kg: stated body mass, None where it is not.
        plan: what was shaken. recordings: what was read, a row for each sine; repeated ones are one. used: recordings
            that they come from. left_out: a sentence on each recording that cannot serve.
    """

    subject: str
    posture: str
    body_kg: float | None
    plan: Plan
    recordings: Recordings
    used: int
    left_out: tuple[str, ...]
    notes: tuple[str, ...]


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
    worst = max(rows, key=lambda row: row.distortion, default=None)
    harmonics = worst is not None and worst.distortion < CLEAN
    notes = [f"{row.file} does not repeat after one period and is not fitted." for row in rows if not row.repeats]
    if worst is not None and not harmonics:
        why = "is sampled too slowly" if np.isinf(worst.distortion) else "has a table with more than 1 % of its own"
        notes.append(f"Second harmonics are not used: {worst.file} {why}.")
    if rows and not tuberosity:
        without = next(row.file for row in rows if not np.isfinite(row.TB))
        notes.append(f"Only the malleolus is used: {without} has no tuberosity.")
    rows = _merged(rows)
    hz, added, table = (np.array([getattr(row, k) for row in rows]) for k in ("frequency_hz", "added_kg", "table"))
    plan = Plan("these recordings", hz, added, table, tuberosity, harmonics)
    MB, TB, second = (np.array([getattr(row, k) for row in rows], complex) for k in ("MB", "TB", "second"))
    repeats = np.array([row.repeats for row in rows], bool)
    made = Recordings(MB, TB if tuberosity else MB, second, np.full(len(rows), np.nan), repeats)
    masses = {r.condition.body_mass_kg for r in recordings}
    used = len(recordings) - len(left_out)
    if len(masses) > 1:
        raise RecordingError(f"Subject {subject} has several body masses; give one.")
    return Seen(subject, posture, masses.pop(), plan, made, used, tuple(left_out), tuple(notes))


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
    file: str


def _merged(rows: Sequence[_Row]) -> list[_Row]:
    """Sines that were repeated, as their mean: how far a foot departs from a mechanism does not scatter anew."""
    groups: list[list[_Row]] = []
    for row in sorted(rows, key=lambda row: (row.frequency_hz, row.added_kg, row.repeats, row.table)):
        last = groups[-1][0] if groups else None
        alike = last and (last.frequency_hz, last.added_kg, last.repeats) == (
            row.frequency_hz,
            row.added_kg,
            row.repeats,
        )
        if last and alike and row.table < HIGHER * last.table:
            groups[-1].append(row)
        else:
            groups.append([row])
    means = ("table", "MB", "TB", "second")
    return [replace(g[0], **{k: sum(getattr(row, k) for row in g) / len(g) for k in means}) for g in groups]


def _sines(recording: Recording) -> Iterator[_Row]:
    """What one recording gives at each of its sines.

    Raises:
        RecordingError: it cannot serve, or it is no sine.
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
        yield _Row(round(hz, 1), good.condition.added_mass_kg, abs(first), moved / first, TB, second, distortion,
                   _repeats(t, good.base_m_s2[part], good.malleolus_m_s2[part], hz), good.file)  # fmt: skip


def _repeats(time_s: Array, base: Array, malleolus: Array, frequency_hz: float) -> bool:
    """Whether a motion repeats after one period, but for what the table itself brings at half the frequency."""
    if (time_s[-1] - time_s[0]) * frequency_hz < 6:
        return True  # too short to see
    moved, shaken = (fit_harmonics(time_s, x, frequency_hz / 2, 3) for x in (malleolus, base))
    size, table = abs(moved.amplitudes[1]), abs(shaken.amplitudes[1])
    return all(
        abs(moved.amplitudes[h])
        < max(SUBHARMONIC * size, AMPLIFIED * size * abs(shaken.amplitudes[h]) / table, DETECTED * moved.std[h])
        for h in (0, 2)
    )


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
        return self.verdict.named if self.enough and not self.stays else UNDECIDED

    @property
    def stays(self) -> bool:
        """Whether a mechanism would be named for leaving the plate whose fit never does: it only stiffens."""
        best = self.fits[0]
        return self.verdict.named == best.rival and is_pressed(named_mechanism(best.rival)) and best.air < AIR

    @property
    def sentence(self) -> str:
        """The result."""
        who = f"subject {self.seen.subject}" if self.seen.subject else "this person"
        best = self.verdict.best
        if not self.enough:
            count = int(self.seen.recordings.repeats.sum())
            return f"Undecided for {who}: {count} sines are too few to tell {len(self.fits)} mechanisms apart."
        if self.stays:
            return (
                f"Undecided for {who}: {best} is nearest, but its fit never leaves the plate; a pad that stiffens in "
                "contact does the same."
            )
        if self.named == NONE:
            return f"None of these for {who}: even {best} misses ({self.verdict.per_dof:.1f} per number)."
        if self.named == UNDECIDED:
            return f"Undecided for {who}: {best} is nearest, but below odds of 1000 to 1."
        first = self.fits[0].criterion
        open_ = [f for f in self.fits if f.rival in RICHER.get(best, ()) and f.criterion - first < DECIDED]
        said = f"{best.capitalize()} for {who}, if it is one of these: at more than 1000 to 1 against the others"
        if not open_:
            return f"{said}."
        return f"{said}, but for {open_[0].rival}, which contains it ({_against(open_[0].criterion - first)})."

    @property
    def notes(self) -> list[str]:
        """What the reader has to know beside it."""
        plan, seen = self.seen.plan, self.seen
        said = [*(f"Left out: {text}" for text in seen.left_out), *seen.notes]
        if seen.body_kg is None:
            said.append(f"No body mass is stated; {BODY_KG:g} kg is taken.")
        if np.ptp(plan.added_kg) == 0:
            said.append("All recordings have one load: what a load does cannot tell mechanisms apart here.")
        if not (plan.partner >= 0).any():
            said.append("No frequency was shaken at two amplitudes, the best sign of a foot that leaves the plate.")
        within = f"a foot within {100 * DEPARTURE:g} % of one mechanism"
        said.append(f"Assumed, not measured: scatter of {100 * NOISE:g} % and {within}.")
        if self.enough and self.verdict.per_dof < CLOSE:
            said.append(
                f"{self.fits[0].rival.capitalize()} fits far better than that assumes ({self.verdict.per_dof:.2g} per "
                "number, where about 1 is expected): with a smaller departure less might stay undecided."
            )
        if self.tried is not None:
            t = self.tried
            others = f"{t.wrong} wrongly, {t.subjects - t.right - t.wrong} not at all"
            told = (
                f"Virtual subjects who were shaken in the same way: {t.subjects}, of whom {t.right} were named rightly"
            )
            few = "; so few tell no rate (--subjects asks for more)" if t.subjects < RATE else ""
            said.append(f"{told}, {others}{few}.")
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
            "recordings": self.seen.used, "sines": self.seen.plan.frequency_hz.size,
            "per_degree_of_freedom": self.verdict.per_dof,
            "mechanisms": self.records(), "constants": {fit.rival: fit.values for fit in self.fits},
            "notes": self.notes, "tried": None if self.tried is None else self.tried.record(),
        }  # fmt: skip

    def sheet(self) -> Sheet:
        """The mechanisms, the best one first."""
        rows = []
        for row in self.records():
            over, pressed = row["criterion_over_best"], is_pressed(named_mechanism(row["mechanism"]))
            odds = "" if not self.enough else "misses" if self.named == NONE else _against(over)
            air = f"{100 * row['in_the_air']:.0f} %" if pressed else "cannot"
            size = f"{over:.1f}" if np.isfinite(over) else ""
            rows.append((row["mechanism"], odds, size, f"{row['sum_of_squares']:.0f}", air))
        columns = ("mechanism", "odds", "criterion over the best", "sum of squares", "in the air")
        count = self.seen.plan.frequency_hz.size
        return Sheet(f"{count} sines, {self.seen.posture}", columns, rows, (self.sentence, *self.notes))


def _against(over: float) -> str:
    """Odds of a criterion that lies so far above the best, in words."""
    return "best" if over == 0 else "excluded" if over >= DECIDED else f"{np.exp(over / 2):.0f} to 1 against"


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
        why = "no motion repeats after one period." if data.repeats.size else seen.left_out[0]
        raise RecordingError(f"No recording of {who} can be used: {why}")
    if (~data.repeats).sum() == 1:  # one alone may have another reason, and would exclude every linear mechanism
        plan, data = plan.only(data.repeats), data.only(data.repeats)
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
