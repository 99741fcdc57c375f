"""Profile likelihood: what the data say about one parameter when all others do their best to make up for it.

The parameter is moved away from its estimate and held, the others are fitted again, from where they were at the last
place. Twice the fall of the log likelihood is chi-square with one degree of freedom, so the 95 % limits are where the
deviance has risen by 3.84. Unlike the Wald interval (estimate and standard error) this sees curved valleys and limits
that do not exist. It sees one valley and what leads out of it, though, so its verdict may lower that of the standard
error and not raise it.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from fasbody.exceptions import SettingError, unknown
from identification.certification import size_that_matters, standard_errors
from identification.result import identifiability
from identification.search import Descent, Problem
from identification.space import Space

#: Rise of the deviance at the 95 % limits.
RISE = float(chi2.ppf(0.95, 1))
_Z95 = 1.959963984540054
#: First step in Wald standard errors, its growth, and steps a side at most.
_FIRST, _GROWTH, _STEPS = 0.5, 1.3, 40
#: Shares of the range by which parameters are moved off their bounds before the others are fitted again.
_OFF_BOUND = (1e-9, 0.02)
#: Verdicts, from what is known best.
_ORDER = ("identified", "weak", "not identifiable")
#: Steps to the limit at most, and the error of the rise there that is none.
_REFINED, _CLOSE = 15, 0.01
#: Share of its width by which an interval may miss the Wald interval and still agree with it.
DEPARTURE = 0.1


@dataclass(frozen=True)
class Profile:
    """The profile of one parameter.

    Attributes:
        key: parameter with unit. value: its estimate. values: where it was held, in order, the estimate among them.
        rises: deviance there above the least, over the reduced chi-square where the model misfits. lower, upper: 95 %
        limits. open_below, open_above: the deviance does not rise enough before the bound. wald: the Wald interval.
        departs: the limits miss the Wald interval's by more than 10 % of its width. verdict: identified / weak / not
        identifiable, the worse of profile and standard error; the last where there are no more numbers than parameters.
        better: a lower deviance was met, so the estimate was not the best.
    """

    key: str
    value: float
    values: tuple[float, ...]
    rises: tuple[float, ...]
    lower: float
    upper: float
    open_below: bool
    open_above: bool
    wald: tuple[float, float]
    departs: bool
    verdict: str
    better: bool

    def document(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    def __str__(self) -> str:
        low = "open" if self.open_below else f"{self.lower:.5g}"
        high = "open" if self.open_above else f"{self.upper:.5g}"
        apart = "; departs from" if self.departs else "; agrees with"
        return (
            f"{self.key} {self.value:.5g}: 95 % profile {low} to {high}{apart} Wald {self.wald[0]:.5g} to "
            f"{self.wald[1]:.5g}; {self.verdict}"
        )


def profiles(problem: Problem, space: Space, descent: Descent, dof: int, names: Sequence[str] = ()) -> list[Profile]:
    """Profiles of named parameters of a settled fit.

    Args:
        problem: with the weights of the estimate, which are kept. space: its parameters. descent: where it ended.
        dof: degrees of freedom. names: of parameters, all free ones where none are given.

    Raises:
        SettingError: a parameter that was not free.
    """
    free = [item.name for item in space.free]
    for name in names:
        if name not in free:
            raise SettingError(f"{unknown('parameter to profile', name, free)}.")
    std, _ = standard_errors(problem, descent, dof)
    excess = max(1.0, descent.cost / max(1, dof))
    return [_profile(problem, space, descent, free.index(n), float(std[free.index(n)]), excess) for n in names or free]


def _profile(problem: Problem, space: Space, descent: Descent, j: int, std: float, excess: float) -> Profile:
    low, high = problem.bounds
    wide = float(high[j] - low[j])
    step = min(std, 0.25 * wide) if np.isfinite(std) and std > 0 else 0.05 * wide
    best = float(descent.z[j])
    sides = [
        _walk(problem, descent, j, sign * _FIRST * step, float(limit), excess)
        for sign, limit in ((-1, low[j]), (1, high[j]))
    ]
    points = sorted([*sides[0].points, (best, 0.0), *sides[1].points])
    lower, upper = sides[0].limit, sides[1].limit

    def value(q: float) -> float:
        z = np.array(descent.z[: space.lower.size])
        z[j] = q
        return float(space.to_theta(z)[j])

    half = _Z95 * std if np.isfinite(std) else np.inf
    wald = (max(best - half, low[j]), min(best + half, high[j]))
    width = max(wald[1] - wald[0], 1e-300)
    open_below, open_above = sides[0].open, sides[1].open
    departs = open_below or open_above or max(abs(lower - wald[0]), abs(upper - wald[1])) > DEPARTURE * width
    item = space.free[j]
    size = size_that_matters(item)
    as_std = (value(upper) - value(lower)) / (2 * _Z95)
    if item.logarithmic and (open_below or open_above):
        as_std = np.inf
    own = std * float(space.slope(space.to_theta(descent.z[: space.lower.size]))[j])
    told = (
        identifiability(value(best), as_std, size, at_bound=open_below and open_above),
        identifiability(value(best), own, size, at_bound=False),
        _ORDER[2 if problem.size <= space.lower.size else 0],
    )
    return Profile(
        key=item.key, value=value(best), values=tuple(value(q) for q, _ in points), rises=tuple(r for _, r in points),
        lower=value(lower), upper=value(upper), open_below=open_below, open_above=open_above,
        wald=(value(wald[0]), value(wald[1])), departs=bool(departs),
        verdict=max(told, key=_ORDER.index),
        better=bool(min(r for _, r in points) < -0.01),
    )  # fmt: skip


@dataclass
class _Side:
    """One side of a profile: points (q, rise), the 95 % limit, and whether there is none before the bound."""

    points: list[tuple[float, float]]
    limit: float
    open: bool


def _walk(problem: Problem, descent: Descent, j: int, step: float, bound: float, excess: float) -> _Side:
    points: list[tuple[float, float]] = []
    z, q, rise = np.array(descent.z), float(descent.z[j]), 0.0
    inner, inner_rise, inner_z = q, 0.0, z
    for _ in range(_STEPS):
        ahead = q + step
        at_end = (ahead - bound) * np.sign(step) >= 0
        q = bound if at_end else ahead
        z = _refit(problem, z, j, q)
        rise = (_cost(problem, z) - descent.cost) / excess
        points.append((q, rise))
        if rise >= RISE:
            break
        if at_end:
            return _Side(points, bound, True)
        inner, inner_rise, inner_z = q, rise, z
        step *= _GROWTH
    else:
        return _Side(points, q, True)
    outer, outer_rise = q, rise
    for _ in range(_REFINED):  # the square root of the rise is nearly straight; where it is not, the bracket shrinks
        a, b = np.sqrt(max(inner_rise, 0.0)), np.sqrt(outer_rise)
        q = inner + (outer - inner) * float(np.clip((np.sqrt(RISE) - a) / (b - a), 0.2, 0.8))
        z = _refit(problem, inner_z, j, q)
        rise = (_cost(problem, z) - descent.cost) / excess
        points.append((q, rise))
        if abs(rise - RISE) < _CLOSE:
            break
        if rise < RISE:
            inner, inner_rise, inner_z = q, rise, z
        else:
            outer, outer_rise = q, rise
    return _Side(points, q, False)


def _cost(problem: Problem, z: np.ndarray) -> float:
    r = problem.residual(z)
    return float(r @ r)


def _refit(problem: Problem, z: np.ndarray, j: int, q: float) -> np.ndarray:
    """All others at their best with z[j] held at q: from where they are, and from off the bounds that they rest on."""
    others = np.delete(np.arange(z.size), j)
    low, high = (limit[others] for limit in problem.bounds)

    def whole(part: np.ndarray) -> np.ndarray:
        full = np.empty(z.size)
        full[others], full[j] = part, q
        return full

    if not others.size:
        return whole(np.empty(0))
    starts = [np.clip(z[others], low + off * (high - low), high - off * (high - low)) for off in _OFF_BOUND]
    if np.abs(starts[1] - starts[0]).max() == 0.0:
        starts.pop()
    found = [
        least_squares(
            lambda part: problem.residual(whole(part)), start, lambda part: problem.jacobian(whole(part))[:, others],
            bounds=(low, high), method="trf", x_scale="jac", ftol=1e-9, xtol=1e-9, gtol=1e-9, max_nfev=60,
        )
        for start in starts
    ]  # fmt: skip
    return whole(min(found, key=lambda each: float(each.cost)).x)
