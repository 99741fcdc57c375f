"""Parameters over frequency: a spline through each subject's estimates, their mean, and its confidence band."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import make_lsq_spline
from scipy.stats import t as student

#: Points of a drawn curve; estimates that allow another bend; subjects that make a mean.
_FINE, _ENOUGH, FEWEST = 121, 7, 3


@dataclass(frozen=True, eq=False)
class MeanCurve:
    """Splines of one parameter under one condition.

    Attributes:
        frequency_hz: (n,). subjects: (s, n), NaN outside a subject's own frequencies.
        mean, lower, upper: (n,) mean over subjects and its 95 % limits (Student's t between subjects); NaN where fewer
            than three subjects are.
    """

    frequency_hz: np.ndarray
    subjects: np.ndarray
    mean: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def spline(f: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Least-squares cubic spline through (m,) estimates, one knot inside where seven or more allow it; (n,) at `at`.

    It is linear in the values, so the mean of splines is the spline of the means. Fewer than four points get the
    polynomial through them; outside its frequencies a spline is NaN.
    """
    order = np.argsort(f)
    x, y = f[order], values[order]
    out = np.full(at.shape, np.nan)
    if x.size == 0:
        return out
    degree = min(3, x.size - 1)
    inside = np.array([np.median(x)]) if x.size >= _ENOUGH else np.empty(0)
    knots = np.concatenate([np.repeat(x[0], degree + 1), inside, np.repeat(x[-1], degree + 1)])
    within = (at >= x[0]) & (at <= x[-1])
    out[within] = make_lsq_spline(x, y, knots, degree)(at[within]) if x.size > 1 else y[0]
    return out


def mean_curve(rows: pd.DataFrame) -> MeanCurve:
    """The curves of rows of the tidy table that share parameter and condition; outliers are left out.

    Args:
        rows: with subject, frequency_hz, value and outlier.
    """
    kept = rows[~rows["outlier"] & rows["value"].notna() & rows["frequency_hz"].notna()]
    if kept.empty:
        nothing = np.empty(0)
        return MeanCurve(nothing, np.empty((0, 0)), nothing, nothing, nothing)
    at = np.linspace(kept["frequency_hz"].min(), kept["frequency_hz"].max(), _FINE)
    curves = np.stack([
        spline(own["frequency_hz"].to_numpy(), own["value"].to_numpy(), at)
        for _, each in kept.groupby("subject", sort=False)
        for own in [each.groupby("frequency_hz", as_index=False)["value"].mean()]
    ])  # fmt: skip
    n = np.isfinite(curves).sum(axis=0)
    enough = n >= FEWEST
    mean, half = np.full(at.shape, np.nan), np.full(at.shape, np.nan)
    mean[enough] = np.nanmean(curves[:, enough], axis=0)
    scatter = np.nanstd(curves[:, enough], axis=0, ddof=1)
    half[enough] = student.ppf(0.975, n[enough] - 1) * scatter / np.sqrt(n[enough])
    return MeanCurve(at, curves, mean, mean - half, mean + half)
