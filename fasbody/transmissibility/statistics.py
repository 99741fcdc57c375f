"""The tests of section 2.3, and beside them those that suit repeated measures.

The thesis compares frequencies by paired t tests, transmissibility with unity by a one-sample t test, and loads and
postures by a one-way analysis of variance, each at p < 0.05. Loads and postures are measured on the same subjects, so
the repeated-measures analysis (Greenhouse-Geisser corrected), Holm's correction for many tests, effect sizes and
confidence intervals are given as well. Arrays are (subjects, levels), NaN where nothing was measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from fasbody.exceptions import RecordingError
from fasbody.presentation import Tabled

ALPHA = 0.05


@dataclass(frozen=True)
class Comparison(Tabled):
    """One t test: mean difference with 95 % interval, p (two-sided), and Cohen's d of the differences."""

    difference: float
    lower: float
    upper: float
    p: float
    effect: float
    subjects: int

    @property
    def verdict(self) -> str:
        """One of above, below, equal at p < 0.05."""
        return "equal" if not self.p < ALPHA else "above" if self.difference > 0 else "below"


def paired(a: np.ndarray, b: np.ndarray) -> Comparison:
    """Paired t test of a - b, both (subjects,)."""
    return one_sample(np.asarray(a, float) - np.asarray(b, float), 0.0)


def one_sample(values: np.ndarray, mean: float = 1.0) -> Comparison:
    """One-sample t test of (subjects,) values against a number, unity for a transmissibility.

    Raises:
        RecordingError: fewer than three subjects.
    """
    d = np.asarray(values, float) - mean
    d = d[np.isfinite(d)]
    if d.size < 3:
        raise RecordingError(f"a t test needs at least three subjects, not {d.size}.")
    spread = float(d.std(ddof=1))
    average = float(d.mean())
    if spread == 0:
        return Comparison(average, average, average, float(average == 0), np.inf if average else 0.0, d.size)
    error = spread / np.sqrt(d.size)
    half = float(special.stdtrit(d.size - 1, 0.975)) * error
    # the same as stats.ttest_1samp, whose checks take thirty times as long; a study has thousands of tests
    p = 2 * float(special.stdtr(d.size - 1, -abs(average) / error))
    return Comparison(average, average - half, average + half, p, average / spread, d.size)


@dataclass(frozen=True)
class Variance(Tabled):
    """One analysis of variance.

    Attributes:
        test: its name.
        F: statistic.
        p: its probability.
        effect: (partial) eta squared.
        epsilon: Greenhouse-Geisser's, 1 where sphericity is not needed.
        subjects: how many.
    """

    test: str
    F: float
    p: float
    effect: float
    epsilon: float
    subjects: int


def one_way(levels: np.ndarray) -> Variance:
    """One-way analysis of variance between the columns of (subjects, levels), as the thesis did it."""
    groups = [column[np.isfinite(column)] for column in np.asarray(levels, float).T]
    if min(g.size for g in groups) < 2:
        raise RecordingError("an analysis of variance needs at least two subjects a level.")
    F, p = stats.f_oneway(*groups)
    every = np.concatenate(groups)
    within = sum(float(((g - g.mean()) ** 2).sum()) for g in groups)
    total = float(((every - every.mean()) ** 2).sum())
    return Variance("one-way ANOVA", float(F), float(p), 1 - within / total, 1.0, min(g.size for g in groups))


def repeated_measures(levels: np.ndarray) -> Variance:
    """Repeated-measures analysis of variance, p corrected after Greenhouse and Geisser.

    Levels are compared within subjects, by least squares with an effect a subject and an effect a
    level. Its F has (k - 1) and N - n - (k - 1) degrees of freedom for N values of n subjects,
    exactly where differences between levels are alike in variance; a Wald test of a mixed model,
    which takes the variance for known, rejects twice too often with five subjects. Subjects with a
    single value give no information on levels and are not counted.

    Args:
        levels: (subjects, levels), NaN where nothing was measured.

    Raises:
        RecordingError: fewer than three subjects measured at two levels, levels that no subject
            connects, or no scatter.
    """
    x = np.asarray(levels, float)
    x = x[np.isfinite(x).sum(axis=1) > 1]
    n, k = x.shape
    if n < 3:
        raise RecordingError(f"statistics need at least three subjects measured at two levels, not {n}.")
    subject, level = np.nonzero(np.isfinite(x))
    y = x[subject, level]
    effects = np.hstack([np.eye(n)[subject], np.eye(k)[level][:, 1:]])
    within = y.size - n - (k - 1)
    if np.linalg.matrix_rank(effects) < n + k - 1 or within < 1:
        raise RecordingError("statistics need levels that are connected by subjects measured at several of them.")
    full, alone = (float(((y - P @ np.linalg.lstsq(P, y)[0]) ** 2).sum()) for P in (effects, effects[:, :n]))
    if full <= 1e-20 * float((y * y).sum()):
        raise RecordingError("statistics need values that scatter.")
    F = (alone - full) / (k - 1) / (full / within)
    epsilon = _epsilon(x)
    p = float(stats.f.sf(F, epsilon * (k - 1), epsilon * within))
    test = "repeated-measures ANOVA" + (" with gaps" if y.size < x.size else "")
    return Variance(test, F, p, 1 - full / alone, epsilon, n)


def _epsilon(x: np.ndarray) -> float:
    """Greenhouse-Geisser's epsilon from the subjects without a gap, its least value if there are fewer than three."""
    x, k = x[np.isfinite(x).all(axis=1)], x.shape[1]
    if len(x) < 3:
        return 1 / (k - 1)
    S = np.cov(x, rowvar=False)
    S = S - S.mean(axis=0) - S.mean(axis=1)[:, None] + S.mean()
    return float(np.clip(np.trace(S) ** 2 / ((k - 1) * (S * S).sum()), 1 / (k - 1), 1))


def holm(p: Sequence[float] | np.ndarray) -> np.ndarray:
    """Holm's adjusted p values, (n,)."""
    p = np.asarray(p, float)
    order = np.argsort(p)
    stepped = np.maximum.accumulate((p.size - np.arange(p.size)) * p[order])
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted
