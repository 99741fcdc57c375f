"""The tests of section 2.3, and beside them those that suit repeated measures.

The thesis compares frequencies by paired t tests, transmissibility with unity by a one-sample t test, and loads and
postures by a one-way analysis of variance, each at p < 0.05. Loads and postures are measured on the same subjects, so
the repeated-measures analysis (Greenhouse-Geisser corrected), Holm's correction for many tests, effect sizes and
confidence intervals are given as well. Arrays are (subjects, levels); subjects with a missing value are left out.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from fasbody.exceptions import RecordingError, SettingError

ALPHA = 0.05


@dataclass(frozen=True)
class Comparison:
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

    def __str__(self) -> str:
        return f"{self.difference:+.3f} [{self.lower:+.3f}, {self.upper:+.3f}], p = {self.p:.2g}, d = {self.effect:.2f}"


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
    half = float(stats.t.ppf(0.975, d.size - 1)) * spread / np.sqrt(d.size)
    p = float(stats.ttest_1samp(d, 0.0).pvalue)
    return Comparison(average, average - half, average + half, p, average / spread, d.size)


@dataclass(frozen=True)
class Variance:
    """One analysis of variance.

    Attributes:
        test: its name. F, p: statistic and probability. effect: (partial) eta squared. epsilon: Greenhouse-Geisser's
            (1 where sphericity is not needed). subjects: how many.
    """

    test: str
    F: float
    p: float
    effect: float
    epsilon: float
    subjects: int

    def __str__(self) -> str:
        return f"{self.test}: F = {self.F:.2f}, p = {self.p:.2g}, eta^2 = {self.effect:.2f}"


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
    """Repeated-measures analysis of variance of (subjects, levels), p corrected after Greenhouse and Geisser.

    Raises:
        SettingError: statsmodels is not installed. RecordingError: fewer than three complete subjects.
    """
    x = complete(levels)
    n, k = x.shape
    _need("statsmodels")
    import pandas as pd
    from statsmodels.stats.anova import AnovaRM

    frame = pd.DataFrame(
        {"y": x.ravel(), "subject": np.repeat(np.arange(n), k), "level": np.tile(np.arange(k), n).astype(str)}
    )
    F = float(AnovaRM(frame, "y", "subject", within=["level"]).fit().anova_table["F Value"].iloc[0])
    S = np.cov(x, rowvar=False)
    S = S - S.mean(axis=0) - S.mean(axis=1)[:, None] + S.mean()
    epsilon = float(np.clip(np.trace(S) ** 2 / ((k - 1) * (S * S).sum()), 1 / (k - 1), 1))
    p = float(stats.f.sf(F, epsilon * (k - 1), epsilon * (k - 1) * (n - 1)))
    return Variance("repeated-measures ANOVA", F, p, F / (F + n - 1), epsilon, n)


def mixed_model(levels: np.ndarray) -> Variance:
    """Linear mixed model with a random intercept a subject, for (subjects, levels) with gaps (NaN): a Wald test.

    Raises:
        SettingError: statsmodels is not installed.
    """
    _need("statsmodels")
    import pandas as pd
    import statsmodels.formula.api as smf
    from statsmodels.tools.sm_exceptions import ConvergenceWarning

    x = np.asarray(levels, float)
    n, k = x.shape
    frame = pd.DataFrame(
        {"y": x.ravel(), "subject": np.repeat(np.arange(n), k), "level": np.tile(np.arange(k), n).astype(str)}
    ).dropna()
    with warnings.catch_warnings():
        # subjects that do not differ put the random effect on its bound, zero: the model is then the one without it
        warnings.simplefilter("ignore", ConvergenceWarning)
        fit = smf.mixedlm("y ~ C(level)", frame, groups=frame["subject"]).fit(reml=True)
    R = np.eye(k)[1:, :]
    b, V = fit.fe_params.to_numpy(), fit.cov_params().to_numpy()[:k, :k]
    F = float((R @ b) @ np.linalg.solve(R @ V @ R.T, R @ b) / (k - 1))
    p = float(stats.chi2.sf(F * (k - 1), k - 1))
    return Variance("mixed model", F, p, F / (F + n - 1), 1.0, n)


def holm(p: Sequence[float]) -> np.ndarray:
    """Holm's adjusted p values, (n,)."""
    _need("statsmodels")
    from statsmodels.stats.multitest import multipletests

    return np.asarray(multipletests(list(p), method="holm")[1])


@dataclass(frozen=True)
class Resonance:
    """What the rule of section 2.3.1 finds.

    Attributes:
        kind: "peak", "plateau" or "none". low, high: its range [Hz]; top: its highest mean [Hz] (NaN if none).
    """

    kind: str
    low: float = np.nan
    high: float = np.nan
    top: float = np.nan

    def __str__(self) -> str:
        return self.kind if self.kind == "none" else f"{self.kind} {self.low:g}-{self.high:g} Hz"


def resonance(frequency_hz: np.ndarray, T: np.ndarray) -> Resonance:
    """Resonance range of one condition by paired t tests between frequencies.

    Peak: the highest mean is significantly greater than some frequency on both of its sides; the range holds the
    neighbours that it is not significantly greater than. Plateau: no such peak, but a frequency that differs
    significantly neither from the next lower nor from the next higher one, while the curve falls significantly beyond;
    the range holds the neighbours that do not differ.

    Args:
        frequency_hz: (f,) ascending. T: (subjects, f) transmissibility.
    """
    f, x = np.asarray(frequency_hz, float), complete(T)
    mean = x.mean(axis=0)
    top = int(np.argmax(mean))

    def reach(middle: int, step: int, stops: tuple[str, ...]) -> int:
        """Farthest neighbour in one direction that the middle still equals; -1 if the curve ends before it differs."""
        at = middle
        while 0 <= at + step < f.size:
            if paired(x[:, middle], x[:, at + step]).verdict in stops:
                return at
            at += step
        return -1

    if 0 < top < f.size - 1:
        low, high = reach(top, -1, ("above",)), reach(top, 1, ("above",))
        if low >= 0 and high >= 0:
            return Resonance("peak", f[low], f[high], f[top])
    flat = []
    for middle in range(1, f.size - 1):
        low, high = reach(middle, -1, ("above", "below")), reach(middle, 1, ("above",))
        if 0 <= low < middle < high and paired(x[:, middle], x[:, high]).verdict == "equal":
            flat.append((float(np.ptp(mean[low : high + 1])) / (high - low), low, high, middle))
    if flat:
        _, low, high, middle = min(flat)
        return Resonance("plateau", f[low], f[high], f[low + int(np.argmax(mean[low : high + 1]))])
    return Resonance("none")


def complete(levels: np.ndarray) -> np.ndarray:
    """Subjects without a gap, (n, levels).

    Raises:
        RecordingError: fewer than three.
    """
    x = np.asarray(levels, float)
    x = x[np.isfinite(x).all(axis=1)]
    if len(x) < 3:
        raise RecordingError(f"statistics need at least three subjects measured at every level, not {len(x)}.")
    return x


def _need(library: str) -> None:
    import importlib.util

    if importlib.util.find_spec(library) is None:
        raise SettingError(f"this statistic needs {library}: pip install 'fasbody[statistics]'.")
