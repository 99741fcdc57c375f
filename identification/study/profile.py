"""Profile likelihood: the least deviance at each value of one parameter, all others fitted again.

The parameter is moved away from its estimate and held, the others are fitted again, from where they were at the last
place. Twice the fall of the log likelihood is chi-square with one degree of freedom, so the 95 % limits are where the
deviance has risen by 3.84. Unlike the Wald interval (estimate and standard error) this sees curved valleys and limits
that do not exist. It sees one valley and what leads out of it, though, so its verdict may lower that of the standard
error and not raise it.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from fasbody.constants import Z95
from fasbody.exceptions import SettingError, unknown
from fasbody.foot.parameters import Parameter
from identification.estimates import identifiability
from identification.intervals import Solution, inverse_of_gram, size_that_matters
from identification.parameters import delay_of
from identification.residual import Evaluation

#: Rise of the deviance at the 95 % limits.
RISE = float(chi2.ppf(0.95, 1))
#: First step in Wald standard errors, its growth, and steps a side at most.
_FIRST, _GROWTH, _STEPS = 0.5, 1.3, 40
#: Shares of the range by which parameters are moved off their bounds before the others are fitted again.
_OFF_BOUND = (1e-9, 0.02)
#: Verdicts, the best first.
_ORDER = ("identified", "weak", "not identifiable")
#: Steps to the limit at most, and the error of the rise there that is none.
_REFINED, _CLOSE = 15, 0.01
#: Share of its width by which an interval may miss the Wald interval and still agree with it.
DEPARTURE = 0.1


@dataclass(frozen=True)
class Profile:
    """The profile of one parameter.

    Attributes:
        key: parameter with unit.
        value: its estimate.
        values: where it was held, in order, the estimate among them.
        rises: deviance there above the least, over the reduced chi-square where the model misfits.
        lower: 95 % limit.
        upper: 95 % limit.
        open_below: the deviance does not rise enough before the lower bound.
        open_above: nor before the upper one.
        wald: the Wald interval.
        departs: the limits miss the Wald interval's by more than 10 % of its width.
        verdict: identified / weak / not identifiable, the worse of profile and standard error; the last where there are
            no more numbers than parameters.
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


@dataclass(frozen=True, eq=False)
class Place:
    """Where a parameter stands among the search variables, and its value [its unit] of that variable."""

    item: Parameter
    index: int
    value: Callable[[float], float]


class Likelihood:
    """A fit's residual over its free variables, each constant one of them.

    Attributes:
        q: (n,) where the fit ended.
        bounds: of q.
        places: of the constants and the delay.
        solution: the fit.
    """

    def __init__(self, solution: Solution) -> None:
        v = solution.problem.variables
        whole = solution.q.copy()
        for name in ("k_T", "k_F") if v.ratio is not None else ():  # in place of sigma and rho
            whole[v.index[name]] = np.log(float(v.dynamic(solution.q)[name]))
        self._problem = replace(solution.problem, variables=replace(v, ratio=None))
        low, high = self._problem.bounds()
        self._free, self._whole = high > low, whole
        self._last: tuple[bytes, Evaluation | None] = b"", None
        self.solution, self.q, self.bounds = solution, whole[self._free], (low[self._free], high[self._free])
        self.places = tuple(self._places())

    def _places(self) -> list[Place]:
        v = self._problem.variables
        order = np.cumsum(self._free) - 1
        items = {item.name: item for item in v.space.free}
        places = [self._place(items[name], i, int(order[i])) for name, i in v.index.items()]
        for item in v.nuisances:
            if item.kind == "delay" and self._free[v.place(item)]:
                places.append(self._place(delay_of(item.sensor), v.place(item), int(order[v.place(item)])))
        return places

    def _place(self, item: Parameter, i: int, index: int) -> Place:
        scale, squared = float(self._problem.variables.scale[i]), item.name in self._problem.variables._squared
        if squared:
            return Place(item, index, lambda x: float(np.sqrt(max(x * scale, 0.0))))
        return Place(item, index, lambda x: float(np.exp(x)) if item.logarithmic else float(x * scale))

    def _evaluated(self, q: np.ndarray) -> Evaluation:
        key, last = self._last
        if last is None or key != q.tobytes():
            whole = self._whole.copy()
            whole[self._free] = q
            last = self._problem.evaluate(whole[None], last)
            self._last = q.tobytes(), last
        return last

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Residuals (m,) at q (n,)."""
        return np.asarray(self._evaluated(q).residual[0])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Their derivatives (m, n)."""
        return np.asarray(self._evaluated(q).jacobian[0][:, self._free])


def profiles_of(solution: Solution, names: Sequence[str] = ()) -> list[Profile]:
    """Profiles of named parameters of a fit, of all free ones where none are given.

    Raises:
        SettingError: a parameter that was not free.
    """
    likelihood = Likelihood(solution)
    free = [place.item.name for place in likelihood.places]
    for name in names:
        if name not in free:
            raise SettingError(f"{unknown('parameter to profile', name, free)}.")
    enough = solution.problem.size > len(free)
    places = [place for place in likelihood.places if place.item.name in (names or free)]
    return profiles(likelihood, places, likelihood.q, solution.excess, enough)


def profiles(
    problem: Likelihood, places: Sequence[Place], q: np.ndarray, excess: float = 1.0, enough: bool = True
) -> list[Profile]:
    """Profiles of parameters where a fit ended.

    Args:
        problem: with the weights of the estimate, which are kept.
        places: of the parameters.
        q: (n,) the end.
        excess: chi-square per degree of freedom, at least 1.
        enough: there are more numbers than parameters.
    """
    std = np.sqrt(np.diag(inverse_of_gram(problem.jacobian(q))) * excess)
    return [_profile(problem, place, q, float(std[place.index]), excess, enough) for place in places]


def _profile(problem: Likelihood, place: Place, q: np.ndarray, std: float, excess: float, enough: bool) -> Profile:
    j, item, value = place.index, place.item, place.value
    low, high = (float(limit[j]) for limit in problem.bounds)
    step = min(std, 0.25 * (high - low)) if np.isfinite(std) and std > 0 else 0.05 * (high - low)
    best = float(q[j])
    sides = [_walk(problem, q, j, sign * _FIRST * step, limit, excess) for sign, limit in ((-1, low), (1, high))]
    points = sorted([*sides[0].points, (best, 0.0), *sides[1].points])
    lower, upper = sides[0].limit, sides[1].limit
    half = Z95 * std if np.isfinite(std) else np.inf
    wald = (max(best - half, low), min(best + half, high))
    width = max(wald[1] - wald[0], 1e-300)
    open_below, open_above = sides[0].open, sides[1].open
    departs = open_below or open_above or max(abs(lower - wald[0]), abs(upper - wald[1])) > DEPARTURE * width
    size = size_that_matters(item)
    as_std = (value(upper) - value(lower)) / (2 * Z95)
    if item.logarithmic and (open_below or open_above):
        as_std = np.inf
    by_wald = (value(wald[1]) - value(wald[0])) / (2 * Z95) if np.isfinite(std) else np.inf
    words = (
        identifiability(value(best), as_std, size, at_bound=open_below and open_above),
        identifiability(value(best), by_wald, size, at_bound=False),
        _ORDER[0 if enough else 2],
    )
    return Profile(
        key=item.key, value=value(best), values=tuple(value(x) for x, _ in points), rises=tuple(r for _, r in points),
        lower=value(lower), upper=value(upper), open_below=open_below, open_above=open_above,
        wald=(value(wald[0]), value(wald[1])), departs=bool(departs),
        verdict=max(words, key=_ORDER.index),
        better=bool(min(r for _, r in points) < -0.01),
    )  # fmt: skip


@dataclass
class _Side:
    """One side of a profile: points (q, rise), the 95 % limit, and whether there is none before the bound."""

    points: list[tuple[float, float]]
    limit: float
    open: bool


def _walk(problem: Likelihood, end: np.ndarray, j: int, step: float, bound: float, excess: float) -> _Side:
    points: list[tuple[float, float]] = []
    z, q, rise, least = np.array(end), float(end[j]), 0.0, _cost(problem, end)
    inner, inner_rise, inner_z = q, 0.0, z
    for _ in range(_STEPS):
        ahead = q + step
        at_end = (ahead - bound) * np.sign(step) >= 0
        q = bound if at_end else ahead
        z = _refit(problem, z, j, q)
        rise = (_cost(problem, z) - least) / excess
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
        rise = (_cost(problem, z) - least) / excess
        points.append((q, rise))
        if abs(rise - RISE) < _CLOSE:
            break
        if rise < RISE:
            inner, inner_rise, inner_z = q, rise, z
        else:
            outer, outer_rise = q, rise
    return _Side(points, q, False)


def _cost(problem: Likelihood, z: np.ndarray) -> float:
    r = problem.residual(z)
    return float(r @ r)


def _refit(problem: Likelihood, z: np.ndarray, j: int, q: float) -> np.ndarray:
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
    ends = [
        least_squares(
            lambda part: problem.residual(whole(part)), start, lambda part: problem.jacobian(whole(part))[:, others],
            bounds=(low, high), method="trf", x_scale="jac", ftol=1e-9, xtol=1e-9, gtol=1e-9, max_nfev=60,
        )
        for start in starts
    ]  # fmt: skip
    return whole(min(ends, key=lambda end: float(end.cost)).x)
