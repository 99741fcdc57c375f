"""A law of the heel, estimated from the strikes of one person at one speed, with intervals.

Least squares of the force over the peak, every strike with the same weight. The first newtons of a contact lie in the
noise of the plate, so the contact is found early or late; each strike therefore has an offset of its compression,
estimated with the law and believed to be small: the worse the law fits anyway, the less it is let imitate. Samples of
one strike are not independent and no law is the truth, so intervals come from the scatter between
strikes: the jackknife that leaves one strike out, linearised, with Student's t.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.heel.laws import HeelLaw
from fasbody.heel.strike import Strike
from fasbody.presentation import Tabled

Array = np.ndarray
#: What a law is held against: contact to first force peak, or to standstill.
WINDOWS = ("loading", "whole")
#: Standard deviation that is believed of the offsets [m], and the bound that they cannot pass.
OFFSET_STD_M, OFFSET_M = 1e-3, 3e-3
#: Samples of a strike that count as independent at the start, before the errors' own correlation tells.
_INDEPENDENT = 5.0
#: How often misfit and belief are weighed anew.
_ROUNDS = 6
#: Samples of a strike that are used: more at 3 kHz say the same, as the path is filtered at 97 Hz.
_SAMPLES = 40
#: Level of the intervals.
LEVEL = 0.95
#: A parameter nearer than this to a bound, of its logarithm's range, rests on it.
_RESTS = 1e-3
#: Step of the numerical derivatives: of a logarithm, and of an offset over its standard deviation.
_STEP = 1e-5


@dataclass(frozen=True)
class Interval:
    """An estimate with its interval; `bound` if it rests on a bound of the search, which then is no interval."""

    value: float
    lower: float
    upper: float
    unit: str = ""
    bound: bool = False


@dataclass(frozen=True, eq=False)
class Paths:
    """Strikes behind each other, thinned: (n,) samples of each quantity, and where each strike begins (g + 1,).

    Attributes:
        time_s, compression_m, rate_m_s, force_n: (n,). scale: (n,) what makes the squares of a strike's errors sum to
        the mean square of their share of the peak. begins: (g + 1,).
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
            chosen = np.unique(np.linspace(0, part.stop - 1, min(part.stop, _SAMPLES)).round().astype(int))
            parts.append(
                [values[chosen] for values in (strike.time_s, strike.compression_m, strike.rate_m_s, strike.force_n)]
            )
            scales.append(np.full(chosen.size, 1.0 / (strike.published.peak_n * np.sqrt(chosen.size))))
        begins = np.cumsum([0] + [len(scale) for scale in scales])
        t, x, v, F = (np.concatenate(values) for values in zip(*parts, strict=True))
        return cls(t, x, v, F, np.concatenate(scales), begins)

    def __len__(self) -> int:
        return self.begins.size - 1

    def residual(self, law: HeelLaw, theta: Array, offsets_m: Array) -> Array:
        """Errors (n,) of the force over the peak, if each contact was (g,) [m] of compression earlier than found."""
        x = self.compression_m + np.repeat(offsets_m, np.diff(self.begins))
        return (law.force(self.time_s, x, self.rate_m_s, theta) - self.force_n) * self.scale

    def independent(self, law: HeelLaw, theta: Array, offsets_m: Array) -> float:
        """How many samples of a strike count as independent, from the correlation of neighbouring errors."""
        r = self.residual(law, theta, offsets_m)
        inner = np.setdiff1d(np.arange(r.size - 1), self.begins[1:-1] - 1)
        rho = float(np.clip((r[inner] @ r[inner + 1]) / (r @ r), 0.0, 0.99))
        return max(1.0, r.size / len(self) * (1.0 - rho) / (1.0 + rho))

    def misfits(self, law: HeelLaw, theta: Array, offset_m: float = 0.0) -> Array:
        """Root mean square error of the force over its peak, strike by strike (g,), at one offset [m] for all."""
        r = self.residual(law, theta, np.full(len(self), offset_m))
        return np.sqrt(np.add.reduceat(r**2, self.begins[:-1]))


@dataclass(frozen=True, eq=False)
class LawFit(Tabled):
    """A law of some strikes.

    Attributes:
        law: which. window: of `WINDOWS`. theta: (p,) parameters. covariance: (p, p) of their logarithms, by the
        jackknife over strikes. parameters: by name, with intervals. offsets_m: (strikes,). misfit: root mean square
        error of the force over its peak.
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


def fit(law: HeelLaw, strikes: Sequence[Strike], window: str = "whole", start: Array | None = None) -> LawFit:
    """Estimate a law from strikes.

    Args:
        law: which. strikes: of one person at one speed, or of many. window: of `WINDOWS`. start: (p,) parameters to
        start from, beside the law's own.

    Raises:
        RecordingError: there are fewer than three strikes, so that no interval can be found.
    """
    from scipy.stats import t as student

    if len(strikes) < 3:
        raise RecordingError(f"{strikes[0] if strikes else 'nobody'}: fewer than three strikes show no scatter.")
    paths = Paths.of(strikes, window)
    bounds = np.log([[item.lower, item.upper] for item in law.parameters]).T
    first = np.log([item.start for item in law.parameters])
    solutions = [_weighed(law, paths, first, bounds)]
    if start is not None:
        solutions.append(_weighed(law, paths, np.clip(np.log(start), *bounds), bounds))
    p, offsets, misfit, jacobian, residual = min(solutions, key=lambda found: found[2])
    rests = (p - bounds[0] < _RESTS * (bounds[1] - bounds[0])) | (bounds[1] - p < _RESTS * (bounds[1] - bounds[0]))
    covariance = _jackknife(jacobian, residual, ~rests)
    width = student.ppf(0.5 + 0.5 * LEVEL, len(strikes) - 1) * np.sqrt(np.diag(covariance))
    parameters = {
        item.name: Interval(
            float(np.exp(p[i])), float(np.exp(p[i] - width[i])) if not rests[i] else item.lower,
            float(np.exp(min(p[i] + width[i], 700.0))) if not rests[i] else item.upper, item.unit, bool(rests[i]),
        )
        for i, item in enumerate(law.parameters)
    }  # fmt: skip
    return LawFit(law, window, np.exp(p), covariance, parameters, offsets, misfit)


_Found = tuple[Array, Array, float, list[Array], list[Array]]


def _weighed(law: HeelLaw, paths: Paths, first: Array, bounds: Array) -> _Found:
    """`_search` with the belief in small offsets weighed by the misfit of the round before."""
    q, belief = np.concatenate([first, np.zeros(len(paths))]), 0.3 / np.sqrt(_INDEPENDENT)
    for _ in range(_ROUNDS):
        q, found = _search(law, paths, q, bounds, belief)
        before, belief = belief, found[2] / np.sqrt(paths.independent(law, np.exp(found[0]), found[1]))
        if abs(belief - before) < 0.05 * belief:
            break
    return found


def _search(law: HeelLaw, paths: Paths, start: Array, bounds: Array, belief: float) -> tuple[Array, _Found]:
    """The minimum from a start (p + g,), and parameters, offsets, misfit, Jacobian and residual by strike.

    `belief` is the error that an offset of one standard deviation counts as, one more for each strike.
    """
    from scipy.optimize import least_squares

    g, n = len(paths), paths.force_n.size
    p = start.size - g
    top = OFFSET_M / OFFSET_STD_M
    own_strike = np.repeat(np.arange(g), np.diff(paths.begins))

    def residual(q: Array) -> Array:
        return np.concatenate([paths.residual(law, np.exp(q[:p]), OFFSET_STD_M * q[p:]), belief * q[p:]])

    def jacobian(q: Array) -> Array:
        now, out = residual(q), np.zeros((n + g, p + g))
        for i in range(p):
            step = _STEP if q[i] + _STEP <= bounds[1, i] else -_STEP
            moved = q.copy()
            moved[i] += step
            out[:, i] = (residual(moved) - now) / step
        moved = q.copy()
        moved[p:] += _STEP
        change = (residual(moved) - now) / _STEP
        out[np.arange(n), p + own_strike] = change[:n]  # a strike's offset moves that strike only
        out[n + np.arange(g), p + np.arange(g)] = belief
        return out

    limits = np.concatenate([bounds[0], np.full(g, -top)]), np.concatenate([bounds[1], np.full(g, top)])
    found = least_squares(
        residual,
        np.clip(start, *limits),
        jac=jacobian,
        bounds=limits,
        x_scale="jac",
        max_nfev=100,
        ftol=1e-7,
        xtol=1e-7,
    )
    J, r = jacobian(found.x), found.fun
    blocks, rests = [], []
    for k in range(g):
        part = np.append(np.arange(paths.begins[k], paths.begins[k + 1]), n + k)
        own = J[part, p + k] / np.linalg.norm(J[part, p + k])
        inside = abs(found.x[p + k]) < top - 1e-6
        blocks.append(
            J[part, :p] - np.outer(own, own @ J[part, :p]) * inside
        )  # what the strike's offset cannot imitate
        rests.append(r[part] - own * (own @ r[part]) * inside)
    misfit = float(np.sqrt(r[:n] @ r[:n] / g))
    return found.x, (found.x[:p], OFFSET_STD_M * found.x[p:], misfit, blocks, rests)


def _jackknife(jacobian: Sequence[Array], residual: Sequence[Array], free: Array) -> Array:
    """Covariance (p, p) by leaving one strike out, linearised; zero for parameters that rest on a bound."""
    p, g = free.size, len(jacobian)
    normal = [J[:, free].T @ J[:, free] for J in jacobian]
    whole, moves = sum(normal), []
    for J, r, own in zip(jacobian, residual, normal, strict=True):
        moves.append(np.linalg.lstsq(whole - own, J[:, free].T @ r, rcond=None)[0])
    apart = np.array(moves) - np.mean(moves, axis=0)
    covariance = np.zeros((p, p))
    covariance[np.ix_(free, free)] = (g - 1) / g * apart.T @ apart
    return covariance
