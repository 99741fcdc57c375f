"""A descent that stops where the sum of squares has no more to give, for bounds that many variables rest on.

What is half normal rests at zero in most worlds. There the trust-region-reflective method of search.py crawls, as it
keeps inside its bounds; here a step is the minimum of the damped quadratic between the bounds themselves. The descent
ends where that quadratic, undamped, promises less than can matter: a long valley whose floor is flat is no reason to
stop, and a cost of a million is no reason to go on.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

#: Decrease of the sum of squares that is worth no further step: a standard error squared is 1.
PROMISED = 0.01
#: Least and largest damping, in the units of the variables, and what keeps a matrix of unit diagonal invertible.
_LEAST_DAMPING, _MOST_DAMPING, _ROUNDING = 1e-6, 1e14, 1e-14


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a descent ended.

    Attributes:
        q: (n,).
        objective: sum of squares there.
        evaluations: of the residual.
        converged: no step promises more.
        left: what a last step promised.
    """

    q: np.ndarray
    objective: float
    evaluations: int
    converged: bool
    left: float


class SumOfSquares(Protocol):
    """A sum of squares whose value costs far less than its derivatives."""

    def values(self, q: np.ndarray) -> np.ndarray:
        """Residual (m,) at q (n,)."""

    def derivatives(self, q: np.ndarray) -> None:
        """Take the derivatives at q, for what follows."""

    def gram(self) -> np.ndarray:
        """J^T J (n, n)."""

    def back(self, r: np.ndarray) -> np.ndarray:
        """J^T r (n,)."""


#: Share of a step by which its curvature is felt, and how long the correction may be beside the step.
_FEELER, _BEND = 0.1, 0.75


def minimise(
    problem: SumOfSquares, q: np.ndarray, low: np.ndarray, high: np.ndarray, most: int, promised: float = PROMISED
) -> Minimum:
    """Minimise a sum of squares along a valley that bends: each step has the correction of second order.

    The second derivative of the residual along the step costs one more residual and no Jacobian (Transtrum and Sethna
    2012).
    """
    q = np.clip(q, low, high)
    r = problem.values(q)
    objective, count, factor, damping = float(r @ r), 1, 2.0, 1e-3
    while True:
        problem.derivatives(q)
        A, g = problem.gram(), problem.back(r)
        size = np.sqrt(np.maximum(np.diag(A), 1e-12 * max(1e-300, float(np.diag(A).max()))))
        A, g = A / np.outer(size, size), g / size
        ends = (low - q) * size, (high - q) * size
        full = between(A + _ROUNDING * np.eye(q.size), g, *ends)
        left = -float(2 * g @ full + full @ A @ full)
        if left < promised:
            return Minimum(q, objective, count, True, left)
        while True:
            if count >= most or damping > _MOST_DAMPING:
                return Minimum(q, objective, count, False, left)
            damped = A + np.diag(damping / size**2 + _ROUNDING)
            step = between(damped, g, *ends)
            foretold = -float(2 * g @ step + step @ A @ step)
            felt = problem.values(np.clip(q + _FEELER * step / size, low, high))
            along = problem.back((felt - r) / _FEELER) / size - A @ step  # J^T of half the second derivative, x h
            bend = -np.linalg.solve(damped, along / _FEELER)
            if np.linalg.norm(bend) <= _BEND * np.linalg.norm(step):
                step = np.clip(step + bend, *ends)
            trial = np.clip(q + step / size, low, high)
            r_new = problem.values(trial)
            count += 1
            gain = objective - float(r_new @ r_new)
            if gain > 0:
                damping = max(_LEAST_DAMPING, damping * max(0.1, 1 - (2 * gain / foretold - 1) ** 3))
                factor = 2.0
                q, r, objective = trial, r_new, objective - gain
                break
            damping, factor = damping * factor, 2 * factor


def between(A: np.ndarray, g: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The minimum (n,) of g p + p A p / 2 for low <= p <= high, A positive definite and zero inside; an active set.

    Each pass goes to the minimum over the free variables or up to the first bound, which is then held; at a minimum
    the held one whose slope points most inside is released. So the value falls with every pass.
    """
    p = np.zeros_like(g)
    held = ((low >= 0) & (g >= 0)) | ((high <= 0) & (g <= 0))
    for _ in range(8 * g.size):
        free = np.flatnonzero(~held)
        way = np.linalg.solve(A[np.ix_(free, free)], -(g + A @ p)[free])
        room = np.where(way > 0, high[free] - p[free], low[free] - p[free])
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(way != 0, room / way, np.inf)
        stride = min(1.0, float(reach.min(initial=np.inf)))
        p[free] += stride * way
        if stride < 1.0:
            first = free[int(np.argmin(reach))]
            p[first] = high[first] if way[np.searchsorted(free, first)] > 0 else low[first]
            held[first] = True
            continue
        slope = g + A @ p
        inside = np.where(p <= low, -slope, slope) * (held & (high > low))
        if inside.max(initial=0.0) <= 1e-12 * np.abs(g).max(initial=1e-300):
            break
        held[int(np.argmax(inside))] = False
    return p
