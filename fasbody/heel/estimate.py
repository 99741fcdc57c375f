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
from itertools import pairwise
from typing import Any

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
    paths, bounds = Paths.of(strikes, window), law.bounds
    p, offsets, end = _weighed(law, paths)
    rests = np.minimum(p - bounds[0], bounds[1] - p) < _RESTS * (bounds[1] - bounds[0])
    covariance = _jackknife(*_blocks(paths, p.size, end), ~rests)
    width = student.ppf(0.5 + 0.5 * LEVEL, len(strikes) - 1) * np.sqrt(np.diag(covariance))
    lower, upper = np.exp(p - width), np.exp(np.minimum(p + width, 700.0))
    parameters = {
        item.name: Interval(float(np.exp(p[i])), item.lower, item.upper, item.unit, True)
        if rests[i]
        else Interval(float(np.exp(p[i])), float(lower[i]), float(upper[i]), item.unit)
        for i, item in enumerate(law.parameters)
    }
    misfit = _misfit(paths, end.fun)
    return LawFit(law, window, np.exp(p), covariance, parameters, offsets, misfit)


def pooled(law: HeelLaw, strikes: Sequence[Strike], window: str, start: Array | None = None) -> Array:
    """Parameters (p,) that fit many people's strikes at once, without offsets.

    Args:
        law: which.
        strikes: of all.
        window: of `WINDOWS`.
        start: parameters (p,) to start from, the law's unless given.
    """
    from scipy.optimize import least_squares

    paths = Paths.of(strikes, window)
    first = law.start if start is None else np.log(start)
    inner = law.bounds + 1e-6 * np.array([[1.0], [-1.0]])
    end = least_squares(
        lambda p: paths.residual(law, np.exp(p), np.zeros(len(paths))), np.clip(first, *inner),
        bounds=inner, x_scale="jac", max_nfev=60, ftol=1e-6, xtol=1e-6,
    )  # fmt: skip
    return np.exp(end.x)


def _weighed(law: HeelLaw, paths: Paths) -> tuple[Array, Array, Any]:
    """Logarithms (p,), offsets (g,) [m], and scipy's end, with offsets weighed by the misfit before.

    The unknowns are the logarithms and the offsets in standard deviations; the weight is the error
    that an offset of one standard deviation counts as.
    """
    from scipy.optimize import least_squares

    p, g = len(law.parameters), len(paths)
    top = np.full(g, OFFSET_M / OFFSET_STD_M)
    limits = np.r_[law.bounds[0], -top], np.r_[law.bounds[1], top]
    q, weight = np.r_[law.start, np.zeros(g)], 0.3 / np.sqrt(_INDEPENDENT)

    def residual(q: Array, weight: float) -> Array:
        errors = paths.residual(law, np.exp(q[:p]), OFFSET_STD_M * q[p:])
        return np.concatenate([errors, weight * q[p:]])

    def jacobian(q: Array, weight: float) -> Array:
        """(n + g, p + g); an offset moves the errors of its strike only: all offsets at once."""
        n, now = paths.force_n.size, residual(q, weight)
        J = np.zeros((n + g, p + g))
        for i in range(p):
            step = _STEP if q[i] + _STEP <= limits[1][i] else -_STEP
            J[:, i] = (residual(q + step * (np.arange(p + g) == i), weight) - now) / step
        later = residual(q + _STEP * (np.arange(p + g) >= p), weight)
        strike = np.repeat(np.arange(g), np.diff(paths.begins))
        J[np.arange(n), p + strike] = (later - now)[:n] / _STEP
        J[n + np.arange(g), p + np.arange(g)] = weight
        return J

    for _ in range(_ROUNDS):
        end = least_squares(
            residual, np.clip(q, *limits), jacobian, limits, args=(weight,), x_scale="jac",
            max_nfev=100, ftol=1e-7, xtol=1e-7,
        )  # fmt: skip
        q, before = end.x, weight
        independent = paths.independent(law, np.exp(q[:p]), OFFSET_STD_M * q[p:])
        weight = _misfit(paths, end.fun) / np.sqrt(independent)
        if abs(weight - before) < 0.05 * weight:
            break
    return q[:p], OFFSET_STD_M * q[p:], end


def _misfit(paths: Paths, residual: Array) -> float:
    """Root mean square of the strikes' errors over the peak."""
    errors = residual[: paths.force_n.size]
    return float(np.sqrt(errors @ errors / len(paths)))


def _blocks(paths: Paths, p: int, end: Any) -> tuple[list[Array], list[Array]]:
    """Jacobian and residual of each strike at the end, less what its offset can imitate."""
    slopes, errors = [], []
    for k, (first, last) in enumerate(pairwise(paths.begins)):
        part = np.append(np.arange(first, last), paths.force_n.size + k)
        J, r = end.jac[part, :p], end.fun[part]
        unit = end.jac[part, p + k] / np.linalg.norm(end.jac[part, p + k])
        free = abs(end.x[p + k]) < OFFSET_M / OFFSET_STD_M - 1e-6
        slopes.append(J - np.outer(unit, unit @ J) * free)
        errors.append(r - unit * (unit @ r) * free)
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
