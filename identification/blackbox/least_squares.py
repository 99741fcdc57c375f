"""Least squares on stacked recordings, with the initial states of each recording projected out."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from scipy import linalg, optimize

#: Directions of the parameters with less than this share of the largest singular value count as unseen and get that
#: share: a huge standard error, yet small enough not to leak by rounding into what is well determined.
UNSEEN = 1e-8
#: Share of its column at the start by which a parameter is held there: what rounding decides stays.
HELD = 1e-10


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Prediction errors at one parameter vector, and their derivatives after the initial states are fitted.

    Attributes:
        errors: of each recording, shape (N_i,) each.
        gradient: d errors / d theta of each recording, orthogonal to its initial states, shape (N_i, d) each.
            It is empty where only the errors were computed.
    """

    errors: list[np.ndarray]
    gradient: list[np.ndarray]

    @classmethod
    def of(cls, parts: Iterable[tuple[np.ndarray, np.ndarray]], gradient: bool) -> Self:
        """From the errors (N_i,) and columns (N_i, d) of each recording; the latter are kept on request."""
        errors, columns = map(list, zip(*parts, strict=True))
        return cls(errors, columns if gradient else [])

    @property
    def samples(self) -> int:
        """Number of residuals over all recordings."""
        return sum(len(e) for e in self.errors)

    @property
    def loss(self) -> float:
        """Mean squared prediction error, Eq. (3.15)."""
        return float(sum(e @ e for e in self.errors) / self.samples)


class Problem(Protocol):
    """What `minimise` needs."""

    def admissible(self, theta: np.ndarray) -> bool:
        """Whether the predictor is stable at theta (d,)."""

    def at(self, theta: np.ndarray, *, gradient: bool = False) -> Linearisation:
        """Errors at theta (d,), and their derivatives on request."""


def project_states(errors: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Fit `states` (N, n) to `errors` (N,): the coefficients, and the map that removes them from other columns.

    States may be nearly collinear (a pole far inside the unit circle leaves no trace of its start), so directions
    below 1e-9 of the largest count as absent.
    """
    if states.shape[1] == 0:
        return np.zeros(0), lambda columns: columns
    scale = np.linalg.norm(states, axis=0)
    scale[scale == 0] = 1.0
    q, r, order = linalg.qr(states / scale, mode="economic", pivoting=True, check_finite=False)
    size = np.abs(np.diag(r))
    keep = int(np.sum(size > 1e-9 * size[0]))
    q = q[:, :keep]
    fitted = np.zeros(states.shape[1])
    fitted[order[:keep]] = linalg.solve_triangular(r[:keep, :keep], q.T @ errors, check_finite=False)
    return fitted / scale, lambda columns: columns - q @ (q.T @ columns)


def minimise(
    problem: Problem, start: np.ndarray, *, evaluations: int = 60, tolerance: float = 1e-4
) -> tuple[np.ndarray, Linearisation, bool]:
    """Least mean squared prediction error, Eq. (3.16), by scipy's trust-region method.

    Parameters whose predictor is unstable have infinite errors, which no step enters. The end is reached when a step
    lowers chi-square (the sum of squares over the noise variance) by less than `tolerance`, so at 1e-4 the estimate is
    within a hundredth of a standard error of the minimum.

    Returns:
        theta (d,), its linearisation, and whether the end was reached within so many evaluations.
    """
    begin = problem.at(start, gradient=True)
    # what the data leave open stays at its start: rounding would move it as far as a step may go
    hold = HELD * np.linalg.norm(np.vstack(begin.gradient), axis=0)

    def errors(theta: np.ndarray) -> np.ndarray:
        if not problem.admissible(theta):
            return np.full(begin.samples + len(theta), np.inf)
        return np.concatenate([*problem.at(theta).errors, hold * (theta - start)])

    def jacobian(theta: np.ndarray) -> np.ndarray:
        return np.vstack([*problem.at(theta, gradient=True).gradient, np.diag(hold)])

    ended = optimize.least_squares(
        errors, start, jacobian, x_scale="jac", ftol=tolerance / begin.samples, xtol=1e-14,
        gtol=None, max_nfev=evaluations,
    )  # fmt: skip
    return ended.x, problem.at(ended.x, gradient=True), ended.status > 0


def reduced(at: Linearisation) -> tuple[np.ndarray, np.ndarray]:
    """Triangular factor (d, d) of the stacked gradient and the errors in its coordinates."""
    r = triangle(np.column_stack(pair) for pair in zip(at.gradient, at.errors, strict=True))
    width = r.shape[1] - 1
    return r[:width, :width], r[:width, width]


def triangle(blocks: Iterable[np.ndarray]) -> np.ndarray:
    """Triangular factor, at most (w, w), of blocks (N_i, w) that stand on one another: all that least squares needs."""
    factors = [linalg.qr(b, mode="r", overwrite_a=True, check_finite=False)[0][: b.shape[1]] for b in blocks]
    if len(factors) == 1:
        return factors[0]
    return linalg.qr(np.vstack(factors), mode="r", check_finite=False)[0][: factors[0].shape[1]]


def spread(at: Linearisation, *, coloured: bool = False) -> np.ndarray:
    """Square root S of the covariance S S' of the estimate, shape (d, d), from the linearisation at the minimum.

    The root, not the covariance, is kept: squared, what a single sine leaves open would drown what it determines.

    With `coloured` the errors need not be white: their spectrum, described by an autoregression of order 30, enters
    between the two inverses (the form that stays valid for output-error models under any stationary noise).
    """
    r, _ = reduced(at)
    scale = np.linalg.norm(r, axis=0)
    scale[scale == 0] = 1.0
    _, s, vt = linalg.svd(r / scale, full_matrices=False, check_finite=False)
    floored = np.maximum(s, UNSEEN * max(s.max(initial=0.0), 1e-300))
    inverse = vt.T / floored / scale[:, None]
    sigma = np.sqrt(at.loss * at.samples / max(at.samples - r.shape[1], 1))
    if not coloured:
        return sigma * inverse
    rows = [np.diag(sigma * np.sqrt(1.0 - (s / floored) ** 2))]  # the data do not determine the unexcited directions
    for gradient, errors in zip(at.gradient, at.errors, strict=True):
        filtered = _coloured_backwards(gradient @ inverse, errors)
        rows.append(linalg.qr(filtered, mode="r", overwrite_a=True, check_finite=False)[0][: r.shape[1]])
    return inverse @ np.vstack(rows).T


def _coloured_backwards(gradient: np.ndarray, errors: np.ndarray, order: int = 30) -> np.ndarray:
    """Gradient filtered backwards in time by the shaping filter of the errors' autoregression."""
    from scipy.signal import lfilter

    n = len(errors)
    order = min(order, n // 10)
    correlation = np.array([errors[: n - k] @ errors[k:] for k in range(order + 1)]) / n
    if correlation[0] <= 1e-300:
        return np.zeros_like(gradient)
    correlation[0] *= 1 + 1e-6  # keeps the equations regular for errors that are all rounding or one sine
    a = linalg.solve_toeplitz(correlation[:-1], correlation[1:]) if order else np.zeros(0)
    innovation = max(correlation[0] - a @ correlation[1:], 0.0)
    shaping = np.concatenate([[1.0], -a])
    return np.sqrt(innovation) * lfilter([1.0], shaping, gradient[::-1], axis=0)[::-1]
