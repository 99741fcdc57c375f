"""Parameters over frequency: a spline through the means of the subjects, with its confidence band."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import make_lsq_spline
from scipy.stats import t as student

#: Points of a drawn curve; estimates that allow another bend; subjects that make a mean.
_FINE, _ENOUGH, FEWEST = 121, 7, 3


@dataclass(frozen=True, eq=False)
class MeanCurve:
    """Mean over subjects of one parameter under one condition.

    Attributes:
        frequency_hz: (n,). mean: (n,) spline through the means of each frequency.
        lower, upper: (n,) the same spline through the 95 % limits of those means (Student's t between subjects); NaN
            where fewer than three subjects are.
    """

    frequency_hz: np.ndarray
    mean: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def spline(f: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Least-squares cubic spline through (m,) estimates, one knot inside where seven or more allow it; (n,) at `at`.

    It is linear in the values, so the spline of the means is the mean of the subjects' splines where none has a gap.
    Fewer than four points get the polynomial through them; outside its frequencies a spline is NaN.
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
    values = kept.groupby("frequency_hz")["value"]
    f, mean, n = values.mean().index.to_numpy(), values.mean().to_numpy(), values.count().to_numpy()
    if f.size == 0:
        return MeanCurve(f, mean, mean, mean)
    at = np.linspace(f[0], f[-1], _FINE)
    enough = n >= FEWEST
    half = student.ppf(0.975, n[enough] - 1) * values.sem().to_numpy()[enough]
    limits = (spline(f[enough], mean[enough] + side * half, at) for side in (-1, 1))
    return MeanCurve(at, spline(f, mean, at), *limits)
