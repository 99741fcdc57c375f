"""Which mechanism made the recordings of a person: the sines of a study, read and analysed.

The same analysis is applied to virtual subjects shaken as the person was. The result states how
many of them it names rightly.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.presentation import Presented, Sheet, counted
from fasbody.recording.checks import checked
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.recording import Recording
from fasbody.transmissibility.steps import steps_of
from identification.rivals.mechanism_fit import (
    AIR,
    DECIDED,
    DEPARTURE,
    HIGHER,
    NOISE,
    NONE,
    RICHER,
    UNDECIDED,
    Analysis,
    Confusion,
    Fitted,
    Plan,
    Responses,
    Verdict,
)
from identification.rivals.mechanisms import BODY_KG, MECHANISMS

Array = np.ndarray
#: Share of the table's second harmonic above which that of the malleolus is not used.
CLEAN = 0.01
#: A motion does not repeat where its subharmonics, at half and one and a half times the frequency,
#: exceed this share of the malleolus' acceleration,
SUBHARMONIC = 0.03
#: what the leg can amplify of the table's subharmonics (some threefold),
AMPLIFIED = 5.0
#: and the detection limit, in standard deviations of the noise.
DETECTED = 4.0
#: Numbers (real and imaginary parts) that a verdict takes for each constant of the richest.
ENOUGH = 2.0
#: Sum of squares per number below which a foot is far nearer than the departure assumed.
CLOSE = 0.1
#: Virtual subjects from which on the share that is named rightly is known to some 5 %.
RATE = 100
#: Mechanisms in a sentence, where their name alone says little.
_WORDS = {"constant": "constant parameters", "both": "second mode with lift-off"}


@dataclass(frozen=True)
class Sines:
    """The sines of one person in one posture.

    Attributes:
        subject: as the study calls the person.
        posture: of the foot.
        body_kg: stated body mass, None where it is not.
        plan: what was shaken.
        recordings: what was read, a row for each sine; repeated ones are one.
        used: recordings that they come from.
        left_out: a sentence on each recording that cannot serve.
        notes: sentences on what is not used.
    """

    subject: str
    posture: str
    body_kg: float | None
    plan: Plan
    recordings: Responses
    used: int
    left_out: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def who(self) -> str:
        """The person in a sentence."""
        return f"subject {self.subject}" if self.subject else "this person"


def read(recordings: Sequence[Recording]) -> list[Sines]:
    """Complex responses of each person's sines, by subject and posture.

    Frequencies are rounded to 0.1 Hz, so that two amplitudes at one frequency are seen as such. The
    tuberosity is used where every recording has it, the second harmonic where it can be read and
    the table has next to none. Recordings that are no sines are left out, with a note.
    """
    people: dict[tuple[str, str], list[Recording]] = {}
    for recording in recordings:
        people.setdefault((recording.condition.subject, recording.condition.posture), []).append(recording)
    return [_read(*person, some) for person, some in people.items()]


def _read(subject: str, posture: str, recordings: Sequence[Recording]) -> Sines:
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
    again = "does not repeat after one period and is not fitted"
    notes = [f"{row.file} {again}." for row in rows if not row.repeats]
    if worst is not None and not harmonics:
        slow = np.isinf(worst.distortion)
        why = "is sampled too slowly" if slow else "has harmonics of the table above 1 %"
        notes.append(f"Second harmonics are not used: {worst.file} {why}.")
    if rows and not tuberosity:
        without = next(row.file for row in rows if not np.isfinite(row.TB))
        notes.append(f"Only the malleolus is used: {without} has no tuberosity.")
    masses = {r.condition.body_mass_kg for r in recordings}
    if len(masses) > 1:
        raise RecordingError(f"Subject {subject} has several body masses; give one.")
    merged = _merged(rows)

    def column(name: str, kind: type) -> Array:
        return np.array([getattr(row, name) for row in merged], kind)

    hz, added, table = (column(name, float) for name in ("frequency_hz", "added_kg", "table"))
    MB, TB, second = (column(name, complex) for name in ("MB", "TB", "second"))
    plan = Plan("these recordings", hz, added, table, tuberosity, harmonics)
    made = Responses(MB, TB if tuberosity else MB, second, column("repeats", bool))
    used = len(recordings) - len(left_out)
    return Sines(
        subject, posture, masses.pop(), plan, made, used, tuple(left_out), tuple(notes)
    )


class _Row(NamedTuple):
    """One sine; the complex responses as `Responses` has them."""

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
    """Repeated sines as their mean: how far a foot departs from a mechanism is no scatter."""
    groups: list[list[_Row]] = []
    for row in sorted(rows, key=lambda r: (r.frequency_hz, r.added_kg, r.repeats, r.table)):
        first = groups[-1][0] if groups else None
        same = first and all(
            getattr(row, name) == getattr(first, name)
            for name in ("frequency_hz", "added_kg", "repeats")
        )
        if first and same and row.table < HIGHER * first.table:
            groups[-1].append(row)
        else:
            groups.append([row])
    means = ("table", "MB", "TB", "second")
    return [
        g[0]._replace(**{k: sum(getattr(row, k) for row in g) / len(g) for k in means})
        for g in groups
    ]


def _sines(recording: Recording) -> Iterator[_Row]:
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
        # as if the table moved as a sin(w t): its phase counts twice for the second harmonic
        turn = 1j * first / abs(first)
        second = malleolus.amplitudes[1] / moved / turn if two == 2 else complex(np.nan)
        distortion = abs(base.amplitudes[1] / first) if two == 2 else np.inf
        repeats = _repeats(t, good.base_m_s2[part], good.malleolus_m_s2[part], hz)
        added_kg, table, MB = good.condition.added_mass_kg, abs(first), moved / first
        yield _Row(round(hz, 1), added_kg, table, MB, TB, second, distortion, repeats, good.file)


def _repeats(time_s: Array, base: Array, malleolus: Array, frequency_hz: float) -> bool:
    """Whether a motion repeats after one period, but for the table's subharmonics."""
    if (time_s[-1] - time_s[0]) * frequency_hz < 6:
        return True  # too short to see
    moved, shaken = (fit_harmonics(time_s, x, frequency_hz / 2, 3) for x in (malleolus, base))
    size, table = abs(moved.amplitudes[1]), abs(shaken.amplitudes[1])
    return all(
        abs(moved.amplitudes[h])
        < max(
            SUBHARMONIC * size,
            AMPLIFIED * size * abs(shaken.amplitudes[h]) / table,
            DETECTED * moved.std[h],
        )
        for h in (0, 2)
    )


@dataclass(frozen=True, repr=False)
class Naming(Presented):
    """The mechanism that made one person's recordings.

    Attributes:
        seen: the recordings.
        verdict: of the analysis.
        fits: of each mechanism, the best one first.
        enough: whether there are numbers enough for a verdict.
        tried: virtual subjects who were shaken as the person was; None where none were.
    """

    seen: Sines
    verdict: Verdict
    fits: Sequence[Fitted]
    enough: bool
    tried: Confusion | None = None

    figures: ClassVar[str] = "identification.rivals.figures"
    plots: ClassVar[tuple[str, ...]] = ("naming",)

    @property
    def named(self) -> str:
        """The mechanism, "undecided" or "none of these"."""
        return self.verdict.named if self.enough and not self.stays else UNDECIDED

    @property
    def stays(self) -> bool:
        """Whether the best mechanism leaves the plate and its fit never does: it only stiffens."""
        best = self.fits[0]
        return self.verdict.named == best.rival and MECHANISMS[best.rival].pressed and best.air < AIR

    @property
    def sentence(self) -> str:
        """The result."""
        who, best = self.seen.who, self.verdict.best
        if not self.enough:
            count = int(self.seen.recordings.repeats.sum())
            few = f"{count} sines are too few to separate {len(self.fits)} mechanisms"
            return f"Undecided for {who}: {few}."
        if self.stays:
            return (
                f"Undecided for {who}: {best} fits best, but with a pad that never leaves the plate, "
                "so that it only stiffens."
            )
        if self.named == NONE:
            per_number = f"{self.verdict.per_dof:.1f} per number"
            return f"None of these for {who}: {best} is best, but does not fit (chi-square {per_number})."
        if self.named == UNDECIDED:
            return f"Undecided for {who}: {best} fits best, but at odds below 1000 to 1."
        first = self.fits[0].criterion
        text = f"{who[:1].upper()}{who[1:]}: {_WORDS.get(best, best)}. All other mechanisms are excluded (1000 to 1)"
        for richer in self.fits:
            over = richer.criterion - first
            if richer.rival in RICHER.get(best, ()) and over < DECIDED:
                special = f"which includes {_WORDS.get(best, best)} as a special case"
                return f"{text} except {_WORDS.get(richer.rival, richer.rival)}, {special} ({_against(over)})."
        return f"{text}."

    @property
    def notes(self) -> list[str]:
        """Limitations and notes on the result."""
        plan, seen = self.seen.plan, self.seen
        notes = [*(f"Left out: {text}" for text in seen.left_out), *seen.notes]
        if seen.body_kg is None:
            notes.append(f"No body mass is stated; {BODY_KG:g} kg is assumed.")
        if np.ptp(plan.added_kg) == 0:
            notes.append("All recordings have one load, so the effect of a load cannot separate the mechanisms.")
        if not (plan.partner >= 0).any():
            notes.append("No frequency was recorded at two amplitudes, which would show lift-off best.")
        within = f"a model error of {100 * DEPARTURE:g} %"
        notes.append(f"Assumed, not measured: scatter of {100 * NOISE:g} %, and {within}.")
        if self.enough and self.verdict.per_dof < CLOSE:
            notes.append(
                f"{self.fits[0].rival.capitalize()} fits much better than these assumptions imply "
                f"(chi-square {self.verdict.per_dof:.2g} per number, about 1 expected), so the odds are too cautious."
            )
        if self.tried is not None:
            t = self.tried
            others = f"{t.wrong} wrongly, {t.subjects - t.right - t.wrong} not at all"
            few = "; too few for a rate (more with --subjects)" if t.subjects < RATE else ""
            notes.append(
                f"Of {t.subjects} virtual subjects with the same recordings {t.right} were named correctly, "
                f"{others}{few}."
            )
        return notes

    def records(self) -> list[dict[str, Any]]:
        """One row for each mechanism."""
        best = self.fits[0].criterion
        return [{
            "subject": self.seen.subject, "posture": self.seen.posture, "named": self.named,
            "mechanism": fit.rival, "criterion_over_best": fit.criterion - best,
            "sum_of_squares": fit.chi2, "in_the_air": fit.air,
        } for fit in self.fits]  # fmt: skip

    def document(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "subject": self.seen.subject, "posture": self.seen.posture, "named": self.named,
            "sentence": self.sentence, "recordings": self.seen.used,
            "sines": self.seen.plan.frequency_hz.size,
            "per_degree_of_freedom": self.verdict.per_dof, "mechanisms": self.records(),
            "constants": {fit.rival: fit.values for fit in self.fits}, "notes": self.notes,
            "tried": None if self.tried is None else self.tried.record(),
        }  # fmt: skip

    def sheet(self) -> Sheet:
        """The mechanisms, the best one first."""
        rows = []
        for row in self.records():
            over, pressed = row["criterion_over_best"], MECHANISMS[row["mechanism"]].pressed
            odds = "misses" if self.named == NONE else _against(over)
            air = f"{100 * row['in_the_air']:.0f} %" if pressed else "–"
            size = f"{over:.1f}" if np.isfinite(over) else ""
            against = [odds] if self.enough else []
            rows.append([row["mechanism"], *against, size, f"{row['sum_of_squares']:.0f}", air])
        heading = ["odds"] if self.enough else []
        columns = ["mechanism", *heading, "criterion over the best", "sum of squares", "time off the table"]
        count = self.seen.plan.frequency_hz.size
        title = f"{counted(count, 'sine')}, {self.seen.posture}"
        return Sheet(title, columns, rows, (self.sentence, *self.notes))


def _against(over: float) -> str:
    """Odds of a criterion that lies so far above the best, in words."""
    if over == 0:
        return "best"
    return "excluded" if over >= DECIDED else f"{np.exp(over / 2):.0f} to 1 against"


def name(seen: Sines, subjects: int = 0, seed: int = 0) -> Iterator[Naming]:
    """Name the mechanism of one person; then shake virtual subjects of each likewise.

    Returns:
        The result, again after each virtual subject.

    Raises:
        RecordingError: no recording of the person can serve.
    """
    plan, data = seen.plan, seen.recordings
    if not data.repeats.any():
        why = "no motion repeats after one period." if data.repeats.size else seen.left_out[0]
        raise RecordingError(f"No recording of {seen.who} can be used: {why}")
    # one alone may have another reason, and would exclude every linear mechanism
    if (~data.repeats).sum() == 1:
        plan, data = plan.only(data.repeats), data.only(data.repeats)
    analysis = Analysis(plan, body_kg=seen.body_kg or BODY_KG)
    verdict, fits = analysis.judged(data)
    numbers = 2 * int(data.repeats.sum()) * (1 + plan.tuberosity)
    richest = max(len(mechanism.constants) for mechanism in analysis.rivals.values())
    result = Naming(seen, verdict, fits, numbers >= ENOUGH * richest)
    yield result
    from identification.rivals.virtual import draw, measured

    verdicts: dict[str, list[Verdict]] = {rival: [] for rival in MECHANISMS}
    for number in range(subjects if result.enough else 0):
        for index, rival in enumerate(MECHANISMS):
            rng = np.random.default_rng([seed, index, number])
            made = measured(draw(rival, rng, body_kg=seen.body_kg or BODY_KG), plan, rng)
            if made.repeats.any():
                verdicts[rival].append(analysis.verdict(made))
            yield replace(result, tried=Confusion(plan.name, verdicts))
