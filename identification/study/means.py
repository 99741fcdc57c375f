"""Parameters over frequency: a spline through the estimates of all subjects, with its confidence band."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import make_lsq_spline
from scipy.stats import t as student

from identification.study.summary import measured

#: Points of a drawn curve; frequencies that allow a cubic with a knot; subjects that make a mean, and a band.
_FINE, _ENOUGH, FEWEST, BAND = 121, 7, 3, 4
#: Constants that cannot be negative: their curves are those of their logarithms (c_12 and c_22 have either sign).
POSITIVE = ("k_T", "k_F", "c_11", "c_21", "c_13", "c_23")


@dataclass(frozen=True, eq=False)
class MeanCurve:
    """Mean over subjects of one parameter under one condition; the geometric mean of what cannot be negative.

    Attributes:
        frequency_hz: (n,).
        mean: (n,) spline through the estimates.
        lower: (n,) its 95 % limit by the scatter between subjects; NaN where fewer than four are, or where one subject
            carries the curve.
        upper: (n,) the other limit.
    """

    frequency_hz: np.ndarray
    mean: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def spline(f: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Least-squares cubic spline with one knot inside through (m,) estimates; its values (n,) at `at`.

    It is linear in the values, so without gaps it is the spline of the means, and the mean of the subjects' splines.
    Fewer than seven frequencies get a parabola, fewer than four a line; outside its frequencies a spline is NaN.
    """
    order = np.argsort(f, kind="stable")
    x, y = f[order], values[order]
    places = np.unique(x)
    out = np.full(at.shape, np.nan)
    if x.size == 0:
        return out
    degree = 3 if places.size >= _ENOUGH else min(2, places.size // 2)
    inside = np.array([np.median(places)]) if places.size >= _ENOUGH else np.empty(0)
    knots = np.concatenate([np.repeat(x[0], degree + 1), inside, np.repeat(x[-1], degree + 1)])
    within = (at >= x[0]) & (at <= x[-1])
    out[within] = make_lsq_spline(x, y, knots, degree)(at[within]) if places.size > 1 else y.mean()
    return out


def mean_curve(rows: pd.DataFrame, recorded: Iterable[float] = ()) -> MeanCurve:
    """The curve of rows of the tidy table that share parameter and condition.

    Estimates at a bound or without a standard error, and of fits that do not follow their recordings, are left
    out, as outliers are; so is a frequency where fewer than three subjects are left, which make
    no mean. The band is the jackknife over subjects, which is Student's interval of the mean where there is no gap,
    with the degrees of freedom of those subjects who have an estimate there.

    Args:
        rows: with subject, parameter, frequency_hz, value, std_error and outlier.
        recorded: further frequencies of the study [Hz]. Across one without a mean no curve leads: it is NaN there.
    """
    kept = rows[~rows["outlier"] & measured(rows) & rows["frequency_hz"].notna()]
    count = kept.groupby("frequency_hz")["subject"].nunique()
    count = count[count >= FEWEST]
    kept = kept[kept["frequency_hz"].isin(count.index)]
    places, who = count.index.to_numpy(float), kept["subject"].to_numpy()
    if places.size == 0:
        return MeanCurve(*(np.empty(0),) * 4)
    f, y = kept["frequency_hz"].to_numpy(), kept["value"].to_numpy()
    logarithmic = kept["parameter"].iloc[0] in POSITIVE and bool((y > 0).all())  # --bounds may allow less
    y = np.log(y) if logarithmic else y
    at = np.linspace(places[0], places[-1], _FINE)
    mean = spline(f, y, at)
    subjects = np.unique(who)
    without = np.array([spline(f[who != s], y[who != s], at) for s in subjects])
    spread = np.sqrt((subjects.size - 1) * np.var(without, axis=0))
    n = count.to_numpy()
    factor = np.where(n >= BAND, student.ppf(0.975, np.maximum(n, BAND) - 1), np.nan)
    half = np.interp(at, places, factor) * spread
    missed = np.setdiff1d([*rows["frequency_hz"].dropna(), *recorded], places)
    for low, high in itertools.pairwise(places):
        if ((missed > low) & (missed < high)).any():
            mean[(at > low) & (at < high)] = np.nan
    back = np.exp if logarithmic else np.asarray
    return MeanCurve(at, back(mean), back(mean - half), back(mean + half))
