"""A law of the heel, estimated from the strikes of one person at one speed, with intervals.

Least squares of the force over the peak, every strike with the same weight. The first newtons of a
contact lie in the noise of the plate, so the contact is detected early or late; each strike
therefore has an offset of its compression, estimated with the law and small by its prior: the worse
the law fits, the smaller the offset is held. Samples of one strike are not independent and
no law is the truth, so intervals come from the scatter between strikes: the jackknife that leaves
one strike out, linearised, with Student's t.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.heel.laws import HeelLaw
from fasbody.heel.strike import Strike
from fasbody.presentation import Tabled

Array = np.ndarray
#: Window that a law is compared with: contact to first force peak, or to standstill.
WINDOWS = ("loading", "whole")
#: Standard deviation of the offsets' prior [m], and their bound.
OFFSET_STD_M, OFFSET_M = 1e-3, 3e-3
#: Samples of a strike that count as independent at the start, before the errors' correlation.
_INDEPENDENT = 5.0
#: How often misfit and prior are weighed anew.
_ROUNDS = 6
#: Samples of a strike that are used: the path is filtered at 97 Hz, so more samples add no information.
_SAMPLES = 40
#: Level of the intervals.
LEVEL = 0.95
#: A parameter nearer than this to a bound, of its logarithm's range, rests on it.
_RESTS = 1e-3
#: Step of the numerical derivatives: of a logarithm, and of an offset over its standard deviation.
_STEP = 1e-5


@dataclass(frozen=True)
class Interval:
    """An estimate with its interval.

    Attributes:
        value: in `unit`.
        lower: 2.5 %.
        upper: 97.5 %.
        unit: of the three.
        bound: it rests on a bound of the search, and has no interval.
    """

    value: float
    lower: float
    upper: float
    unit: str = ""
    bound: bool = False


@dataclass(frozen=True, eq=False)
class Paths:
    """Strikes concatenated and thinned.

    Attributes:
        time_s: (n,).
        compression_m: (n,).
        rate_m_s: (n,).
        force_n: (n,).
        scale: makes the squares of a strike's errors their mean square over the peak, (n,).
        begins: where each strike begins, and the end, (g + 1,).
    """

    time_s: Array
    compression_m: Array
    rate_m_s: Array
    force_n: Array
    scale: Array
    begins: Array

    @classmethod
    def of(cls, strikes: Sequence[Strike], window: str = "whole") -> "Paths":
        """The samples of a window of `WINDOWS` of some strikes."""
        parts, scales = [], []
        for strike in strikes:
            part: slice = getattr(strike, window)
            even = np.linspace(0, part.stop - 1, min(part.stop, _SAMPLES))
            chosen = np.unique(even.round().astype(int))
            columns = strike.time_s, strike.compression_m, strike.rate_m_s, strike.force_n
            parts.append([values[chosen] for values in columns])
            scales.append(np.full(chosen.size, 1.0 / (strike.published.peak_n * np.sqrt(chosen.size))))
        begins = np.cumsum([0] + [len(scale) for scale in scales])
        t, x, v, F = (np.concatenate(values) for values in zip(*parts, strict=True))
        return cls(t, x, v, F, np.concatenate(scales), begins)

    def __len__(self) -> int:
        return self.begins.size - 1

    def residual(self, law: HeelLaw, theta: Array, offsets_m: Array) -> Array:
        """Errors (n,) of the force over the peak, if each contact was (g,) [m] earlier."""
        x = self.compression_m + np.repeat(offsets_m, np.diff(self.begins))
        return (law.force(self.time_s, x, self.rate_m_s, theta) - self.force_n) * self.scale

    def independent(self, law: HeelLaw, theta: Array, offsets_m: Array) -> float:
        """Independent samples of a strike, from the correlation of neighbouring errors."""
        r = self.residual(law, theta, offsets_m)
        inner = np.setdiff1d(np.arange(r.size - 1), self.begins[1:-1] - 1)
        rho = float(np.clip((r[inner] @ r[inner + 1]) / (r @ r), 0.0, 0.99))
        return max(1.0, r.size / len(self) * (1.0 - rho) / (1.0 + rho))

    def misfits(self, law: HeelLaw, theta: Array, offset_m: float = 0.0) -> Array:
        """Root mean square error of the force over its peak (g,), at one offset [m] for all."""
        r = self.residual(law, theta, np.full(len(self), offset_m))
        return np.sqrt(np.add.reduceat(r**2, self.begins[:-1]))


@dataclass(frozen=True, eq=False)
class LawFit(Tabled):
    """A law of some strikes.

    Attributes:
        law: which.
        window: of `WINDOWS`.
        theta: parameters, (p,).
        covariance: of their logarithms, by the jackknife over strikes, (p, p).
        parameters: by name, with intervals.
        offsets_m: (strikes,).
        misfit: root mean square error of the force over its peak.
    """

    law: HeelLaw
    window: str
    theta: Array
    covariance: Array
    parameters: Mapping[str, Interval]
    offsets_m: Array
    misfit: float

    @property
    def offset_m(self) -> float:
        """The median offset: what a strike that was not fitted is predicted with."""
        return float(np.median(self.offsets_m))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Parameters that rest on a bound of the search."""
        return tuple(name for name, item in self.parameters.items() if item.bound)


def fit(law: HeelLaw, strikes: Sequence[Strike], window: str = "whole") -> LawFit:
    """Estimate a law from strikes.

    Args:
        law: which.
        strikes: of one person at one speed, or of many.
        window: of `WINDOWS`.

    Raises:
        RecordingError: there are fewer than three strikes, so that there is no interval.
    """
    from scipy.stats import t as student

    if len(strikes) < 3:
        who = strikes[0] if strikes else "nobody"
        raise RecordingError(f"{who}: fewer than three strikes show no scatter.")
    search = _Search(law, Paths.of(strikes, window))
    q, misfit, jacobian, residual = _weighed(search)
    p, offsets = q[: search.p], OFFSET_STD_M * q[search.p :]
    low, high = search.bounds
    rests = np.minimum(p - low, high - p) < _RESTS * (high - low)
    covariance = _jackknife(jacobian, residual, ~rests)
    width = student.ppf(0.5 + 0.5 * LEVEL, len(strikes) - 1) * np.sqrt(np.diag(covariance))
    lower, upper = np.exp(p - width), np.exp(np.minimum(p + width, 700.0))
    parameters = {
        item.name: Interval(float(np.exp(p[i])), item.lower, item.upper, item.unit, True)
        if rests[i]
        else Interval(float(np.exp(p[i])), float(lower[i]), float(upper[i]), item.unit)
        for i, item in enumerate(law.parameters)
    }
    return LawFit(law, window, np.exp(p), covariance, parameters, offsets, misfit)


def _weighed(search: "_Search") -> tuple[Array, float, list[Array], list[Array]]:
    """Unknowns, misfit, and `_Search.blocks`, with offsets weighed by the misfit before."""
    q, weight = search.start, 0.3 / np.sqrt(_INDEPENDENT)
    for _ in range(_ROUNDS):
        q, r = search.minimum(q, weight)
        end = q, search.misfit(r), *search.blocks(q, r, weight)
        theta, offsets = np.exp(q[: search.p]), OFFSET_STD_M * q[search.p :]
        before = weight
        weight = end[1] / np.sqrt(search.paths.independent(search.law, theta, offsets))
        if abs(weight - before) < 0.05 * weight:
            break
    return end


@dataclass(frozen=True, eq=False)
class _Search:
    """Least squares of parameters' logarithms and of offsets in standard deviations (p + g,).

    A weight is the error that an offset of one standard deviation counts as.
    """

    law: HeelLaw
    paths: Paths

    @property
    def p(self) -> int:
        return len(self.law.parameters)

    @property
    def bounds(self) -> Array:
        """Of the parameters' logarithms (2, p)."""
        return np.log([[item.lower, item.upper] for item in self.law.parameters]).T

    @property
    def start(self) -> Array:
        first = np.log([item.start for item in self.law.parameters])
        return np.concatenate([first, np.zeros(len(self.paths))])

    def residual(self, q: Array, weight: float) -> Array:
        """Errors (n,), and the offsets' prior (g,)."""
        errors = self.paths.residual(self.law, np.exp(q[: self.p]), OFFSET_STD_M * q[self.p :])
        return np.concatenate([errors, weight * q[self.p :]])

    def jacobian(self, q: Array, weight: float) -> Array:
        """Its derivative (n + g, p + g)."""
        p, g, n = self.p, len(self.paths), self.paths.force_n.size
        now, out = self.residual(q, weight), np.zeros((n + g, p + g))
        for i in range(p):
            step = _STEP if q[i] + _STEP <= self.bounds[1, i] else -_STEP
            out[:, i] = (self.residual(q + step * (np.arange(p + g) == i), weight) - now) / step
        later = self.residual(q + _STEP * (np.arange(p + g) >= p), weight)
        number = np.repeat(np.arange(g), np.diff(self.paths.begins))
        out[np.arange(n), p + number] = (later - now)[:n] / _STEP  # of its strike only
        out[n + np.arange(g), p + np.arange(g)] = weight
        return out

    def minimum(self, start: Array, weight: float) -> tuple[Array, Array]:
        """Unknowns and residual at the minimum from a start."""
        from scipy.optimize import least_squares

        top = np.full(len(self.paths), OFFSET_M / OFFSET_STD_M)
        limits = np.r_[self.bounds[0], -top], np.r_[self.bounds[1], top]
        end = least_squares(
            self.residual, np.clip(start, *limits), self.jacobian, limits, args=(weight,),
            x_scale="jac", max_nfev=100, ftol=1e-7, xtol=1e-7,
        )  # fmt: skip
        return end.x, end.fun

    def misfit(self, r: Array) -> float:
        """Root mean square of the strikes' errors over the peak."""
        errors = r[: self.paths.force_n.size]
        return float(np.sqrt(errors @ errors / len(self.paths)))

    def blocks(self, q: Array, r: Array, weight: float) -> tuple[list[Array], list[Array]]:
        """Jacobian and residual of each strike, less what its offset can imitate."""
        J, p, n = self.jacobian(q, weight), self.p, self.paths.force_n.size
        slopes, errors = [], []
        for k in range(len(self.paths)):
            part = np.append(np.arange(self.paths.begins[k], self.paths.begins[k + 1]), n + k)
            unit = J[part, p + k] / np.linalg.norm(J[part, p + k])
            free = abs(q[p + k]) < OFFSET_M / OFFSET_STD_M - 1e-6
            slopes.append(J[part, :p] - np.outer(unit, unit @ J[part, :p]) * free)
            errors.append(r[part] - unit * (unit @ r[part]) * free)
        return slopes, errors


def _jackknife(jacobian: Sequence[Array], residual: Sequence[Array], free: Array) -> Array:
    """Covariance (p, p) by leaving one strike out, linearised; zero for what rests on a bound."""
    p, g = free.size, len(jacobian)
    normal = [J[:, free].T @ J[:, free] for J in jacobian]
    whole, moves = sum(normal), []
    for J, r, part in zip(jacobian, residual, normal, strict=True):
        moves.append(np.linalg.lstsq(whole - part, J[:, free].T @ r, rcond=None)[0])
    apart = np.array(moves) - np.mean(moves, axis=0)
    covariance = np.zeros((p, p))
    covariance[np.ix_(free, free)] = (g - 1) / g * apart.T @ apart
    return covariance
