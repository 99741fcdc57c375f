"""Profile likelihood: the least deviance at each value of one parameter, all others fitted again.

The parameter is moved away from its estimate and held, the others are fitted again, from where they were at the last
place. Twice the fall of the log likelihood is chi-square with one degree of freedom, so the 95 % limits are where the
deviance has risen by 3.84. Unlike the Wald interval (estimate and standard error) this sees curved valleys and limits
that do not exist. It sees one valley and what leads out of it, though, so its verdict may lower that of the standard
error and not raise it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2

from fasbody.constants import Z95
from fasbody.exceptions import SettingError, unknown
from fasbody.foot.parameters import Parameter
from identification.estimates import identifiability
from identification.intervals import Solution, inverse_of_gram, size_that_matters
from identification.parameters import delay_of
from identification.residual import Evaluation
from identification.study import VERDICTS

#: Rise of the deviance at the 95 % limits.
RISE = float(chi2.ppf(0.95, 1))
#: First step in Wald standard errors, its growth, and steps a side at most.
_FIRST, _GROWTH, _STEPS = 0.5, 1.3, 40
#: Shares of the range by which parameters are moved off their bounds before the others are fitted again.
_OFF_BOUND = (1e-9, 0.02)
#: Error of the rise, and share of a step in the limit, that are none.
_CLOSE = 0.01
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
        self.q, self.bounds = whole[self._free], (low[self._free], high[self._free])
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


def profiles_of(solution: Solution, names: Sequence[str]) -> list[Profile]:
    """Profiles of named parameters of a fit.

    Raises:
        SettingError: a parameter that was not free.
    """
    likelihood = Likelihood(solution)
    free = [place.item.name for place in likelihood.places]
    for name in names:
        if name not in free:
            raise SettingError(f"{unknown('parameter to profile', name, free)}.")
    places = [place for place in likelihood.places if place.item.name in names]
    enough = solution.problem.size > len(free)
    return profiles(likelihood, places, likelihood.q, solution.excess, enough)


def profiles(
    problem: Likelihood,
    places: Sequence[Place],
    q: np.ndarray,
    excess: float = 1.0,
    enough: bool = True,
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
    j, item, value, best = place.index, place.item, place.value, float(q[place.index])
    low, high = (float(limit[j]) for limit in problem.bounds)
    known = bool(np.isfinite(std) and std > 0)
    step = _FIRST * (min(std, 0.25 * (high - low)) if known else 0.05 * (high - low))
    below, above = (_side(problem, q, j, s, end, excess) for s, end in ((-step, low), (step, high)))
    rises = dict(sorted((below.rises | {best: 0.0} | above.rises).items()))
    half = Z95 * std if np.isfinite(std) else np.inf
    wald = max(best - half, low), min(best + half, high)
    missed = max(abs(below.limit - wald[0]), abs(above.limit - wald[1]))
    departs = missed > DEPARTURE * max(wald[1] - wald[0], 1e-300)
    size, open_side = size_that_matters(item), below.open or above.open
    as_std, by_wald = ((value(b) - value(a)) / (2 * Z95) for a, b in ((below.limit, above.limit), wald))
    as_std = np.inf if item.logarithmic and open_side else as_std
    by_wald = by_wald if np.isfinite(std) else np.inf
    verdicts = (
        identifiability(value(best), as_std, size, at_bound=below.open and above.open),
        identifiability(value(best), by_wald, size, at_bound=False),
        VERDICTS[0 if enough else 2],
    )
    return Profile(
        key=item.key,
        value=value(best),
        values=tuple(map(value, rises)),
        rises=tuple(rises.values()),
        lower=value(below.limit),
        upper=value(above.limit),
        open_below=below.open,
        open_above=above.open,
        wald=(value(wald[0]), value(wald[1])),
        departs=bool(open_side or departs),
        verdict=max(verdicts, key=VERDICTS.index),
        better=min(rises.values()) < -_CLOSE,
    )


@dataclass(frozen=True)
class _Side:
    """Rise at each place on one side of a profile, the limit, and whether there is none."""

    rises: dict[float, float]
    limit: float
    open: bool


def _side(problem: Likelihood, end: np.ndarray, j: int, step: float, bound: float, excess: float) -> _Side:
    """Go away from the end in growing steps, then close in on the limit."""
    least, rises = _deviance(problem, end), dict[float, float]()

    def rise(at: float, start: np.ndarray) -> np.ndarray:
        refitted = _refit(problem, start, j, at)
        rises[at] = (_deviance(problem, refitted) - least) / excess
        return refitted

    inner, start = float(end[j]), end
    for _ in range(_STEPS):
        outer = min(inner + step, bound) if step > 0 else max(inner + step, bound)
        refitted = rise(outer, start)
        if rises[outer] >= RISE:
            break
        if outer == bound:
            return _Side(rises, bound, True)
        inner, start, step = outer, refitted, step * _GROWTH
    else:
        return _Side(rises, outer, True)

    def above(at: float) -> float:  # nearly straight
        if at not in rises and at != end[j]:
            rise(at, start)
        return float(np.sqrt(max(rises.get(at, 0.0), 0.0)) - np.sqrt(RISE))

    limit = brentq(above, inner, outer, xtol=_CLOSE * abs(step), rtol=1e-12)
    return _Side(rises, float(limit), False)


def _deviance(problem: Likelihood, q: np.ndarray) -> float:
    r = problem.residual(q)
    return float(r @ r)


def _refit(problem: Likelihood, z: np.ndarray, j: int, q: float) -> np.ndarray:
    """All others at their best with z[j] held at q: from where they are, and from off their bounds."""
    others = np.delete(np.arange(z.size), j)
    low, high = (limit[others] for limit in problem.bounds)
    whole = np.array(z)
    whole[j] = q
    if not others.size:
        return whole

    def filled(part: np.ndarray) -> np.ndarray:
        whole[others] = part
        return whole

    margins = [off * (high - low) for off in _OFF_BOUND]
    starts = [np.clip(z[others], low + margin, high - margin) for margin in margins]
    ends = [
        least_squares(
            lambda part: problem.residual(filled(part)), start,
            lambda part: problem.jacobian(filled(part))[:, others],
            bounds=(low, high), x_scale="jac", ftol=1e-9, xtol=1e-9, gtol=1e-9, max_nfev=60,
        )
        for start in (starts if np.any(starts[0] != starts[1]) else starts[:1])
    ]  # fmt: skip
    return filled(min(ends, key=lambda end: float(end.cost)).x)
