"""Where a transmissibility has its peak or plateau: the rule of section 2.3.1, and one by significance tests.

The thesis calls two frequencies equal where a paired t test finds no difference; the fewer the subjects, the more is
then equal. `by_tests` claims a plateau only where an equivalence test finds the differences smaller than a margin. It
claims a peak only where the tests are significant after Holm's correction over all pairs of frequencies, and neither
only where the curve falls from each frequency to the next. All else is undecided.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import stats

from fasbody.presentation import Tabled
from fasbody.transmissibility.statistics import ALPHA, holm, paired

#: The equivalence test takes frequencies for equal that differ by less than this share of their mean. A choice: nothing
#: in the thesis says what difference would matter.
MARGIN = 0.05
_FEWEST = 3


@dataclass(frozen=True)
class Resonance(Tabled):
    """What a rule finds.

    Attributes:
        kind: "peak", "plateau", "none", "undecided" (`by_tests` only) or "not tested".
        low: lower end of its range [Hz], NaN without peak or plateau.
        high: upper end [Hz].
        top: where its mean is highest [Hz].
        why: it was not tested.
        subjects: how many were tested.
        left_out: frequencies that were not, because a subject lacks them [Hz].
    """

    kind: str
    low: float = np.nan
    high: float = np.nan
    top: float = np.nan
    why: str = ""
    subjects: int = 0
    left_out: tuple[float, ...] = ()

    @property
    def has_range(self) -> bool:
        """Whether there is a range."""
        return self.kind in ("peak", "plateau")

    def confirms(self, other: "Resonance") -> bool:
        """Whether this finds the same kind at a place in common."""
        return bool(self.has_range and self.kind == other.kind and self.low <= other.high and other.low <= self.high)

    @property
    def tested(self) -> bool:
        """Whether there were enough subjects and frequencies for any answer."""
        return self.kind != "not tested"

    def __str__(self) -> str:
        text = f"{self.kind} ({self.why})" if self.why else self.kind
        if self.has_range:
            text = f"{self.kind} {self.low:g}{f'-{self.high:g}' if self.high > self.low else ''} Hz"
        return text + (f", {len(self.left_out)} frequencies left out" if self.left_out else "")


def _tested(rule: Callable[..., Resonance]) -> Callable[..., Resonance]:
    """The rule on the subjects without a gap, where there are three of them and three frequencies.

    If too few are left, sparse frequencies are left out rather than subjects.
    """

    def checked(frequency_hz: np.ndarray, T: np.ndarray, *options: float) -> Resonance:
        f, x = np.asarray(frequency_hz, float), np.asarray(T, float)
        kept = np.ones(f.size, bool)
        if np.isfinite(x).all(axis=1).sum() < _FEWEST:
            present = x[np.isfinite(x).any(axis=1)]
            kept = np.isfinite(present).all(axis=0)
            kept = kept if len(present) >= _FEWEST and kept.sum() >= _FEWEST else np.ones(f.size, bool)
        left_out = tuple(float(v) for v in f[~kept])
        f, x = f[kept], x[:, kept]
        x = x[np.isfinite(x).all(axis=1)]
        if len(x) < _FEWEST:
            return Resonance("not tested", why=f"n = {len(x)}", subjects=len(x))
        if f.size < _FEWEST:
            return Resonance("not tested", why=f"{f.size} frequencies" if f.size != 1 else "one frequency")
        return replace(rule(f, x, *options), subjects=len(x), left_out=left_out)

    checked.__doc__ = rule.__doc__
    return checked


@_tested
def by_thesis(frequency_hz: np.ndarray, T: np.ndarray) -> Resonance:
    """Resonance range of one condition by paired t tests between frequencies, as section 2.3.1 reads them.

    Peak: the highest mean is significantly greater than some frequency on both of its sides; the range holds the
    neighbours that it is not significantly greater than. Plateau: no such peak, but a frequency that differs
    significantly neither from the next lower nor from the next higher one; the range holds the neighbours that do not
    differ from it, the next lower frequency differs, and the next higher one is significantly less.

    Args:
        frequency_hz: (f,) ascending.
        T: (subjects, f) transmissibility.
    """
    f, x = frequency_hz, T
    mean = x.mean(axis=0)
    top = int(np.argmax(mean))

    def reach(middle: int, step: int, stops: tuple[str, ...]) -> tuple[int, str]:
        """Farthest neighbour in one direction that the middle still equals, and how the next differs."""
        at = middle
        while 0 <= at + step < f.size:
            verdict = paired(x[:, middle], x[:, at + step]).verdict
            if verdict in stops:
                return at, verdict
            at += step
        return at, "the curve ends"

    if 0 < top < f.size - 1:
        (low, below), (high, beyond) = (reach(top, step, ("above",)) for step in (-1, 1))
        if below == beyond == "above":
            return Resonance("peak", f[low], f[high], f[top])
    flat = []
    for middle in range(1, f.size - 1):
        (low, below), (high, beyond) = (reach(middle, step, ("above", "below")) for step in (-1, 1))
        if low < middle < high and below in ("above", "below") and beyond == "above":
            flat.append((float(np.ptp(mean[low : high + 1])) / (high - low), low, high, middle))
    if flat:
        _, low, high, middle = min(flat)
        return Resonance("plateau", f[low], f[high], f[low + int(np.argmax(mean[low : high + 1]))])
    return Resonance("none")


@_tested
def by_tests(frequency_hz: np.ndarray, T: np.ndarray, margin: float = MARGIN) -> Resonance:
    """Resonance range of one condition by tests with corrected error rates.

    Peak: the highest mean is greater than some frequency on both of its sides, by paired t tests with Holm's correction
    over all pairs of frequencies, so that choosing the highest costs nothing; the range holds the neighbours that are
    not shown to be less. Plateau: the longest run of at least three frequencies whose every pair differs by less than
    the margin (two one-sided t tests; all must hold, so none needs a correction), from which the frequency before
    differs and the one after is less, corrected. None: each frequency is shown to be less than the one before.

    Args:
        frequency_hz: (f,) ascending.
        T: (subjects, f) transmissibility.
        margin: of equivalence, as a share of the mean.
    """
    f, x = frequency_hz, T
    mean, k = x.mean(axis=0), f.size
    i, j = np.triu_indices(k, 1)
    differ = np.zeros((k, k), bool)
    differ[i, j] = differ[j, i] = holm(_p_values(x[:, i] - x[:, j])) < ALPHA
    less = differ & (mean[:, None] > mean[None, :])  # less[i, j]: j is shown to be less than i
    top = int(np.argmax(mean))
    if less[top, :top].any() and less[top, top:].any():
        low = top - next((n for n in range(top) if less[top, top - 1 - n]), top)
        high = top + next((n for n in range(k - 1 - top) if less[top, top + 1 + n]), k - 1 - top)
        return Resonance("peak", f[low], f[high], f[top])
    runs = [(a, b) for a in range(1, k - 2) for b in range(a + 2, k - 1)]
    flat = [
        (b - a, a, b)
        for a, b in runs
        if differ[a - 1, a : b + 1].all() and less[a : b + 1, b + 1].all() and _equivalent(x[:, a : b + 1], margin)
    ]
    if flat:
        _, a, b = max(flat)
        return Resonance("plateau", f[a], f[b], f[a + int(np.argmax(mean[a : b + 1]))])
    falls = all(less[i, i + 1] for i in range(k - 1))
    return Resonance("none" if falls else "undecided")


def _p_values(differences: np.ndarray) -> np.ndarray:
    """Two-sided p of the paired t test of each column of (subjects, pairs): `paired` for many at once."""
    mean, n = differences.mean(axis=0), len(differences)
    error = differences.std(axis=0, ddof=1) / np.sqrt(n)
    t = np.divide(mean, error, out=np.where(mean == 0, 0.0, np.inf), where=error > 0)
    return 2 * stats.t.sf(np.abs(t), n - 1)


def _equivalent(x: np.ndarray, margin: float) -> bool:
    """Whether every pair of columns differs by less than a share of their mean: 90 % intervals within it."""
    quantile = float(stats.t.ppf(1 - ALPHA, len(x) - 1))
    for i, j in combinations(range(x.shape[1]), 2):
        d = x[:, i] - x[:, j]
        if abs(d.mean()) + quantile * d.std(ddof=1) / np.sqrt(d.size) >= margin * x.mean():
            return False
    return True
