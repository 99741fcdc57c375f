"""A small Levenberg-Marquardt method with bounds, for problems of a hundred unknowns evaluated in milliseconds.

The general method of search.py factorises the whole Jacobian at each step, which takes longer than the foot does when
every recording has offsets of its own. Here a step solves the normal equations, damped by their diagonal (Marquardt
1963); a variable on its bound that wants to leave is held there for the step.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from identification.search import UNSTABLE, Descent, Problem

_EVALUATIONS = 300


def descend_fast(
    problem: Problem, z0: np.ndarray, label: str = "", tolerance: float = 1e-8, most: int = _EVALUATIONS
) -> Descent:
    """Minimise the sum of squares from one start.

    Args:
        problem: residual and Jacobian. z0: start (n,). label: its name.
        tolerance: relative decrease of the cost in two steps together that is none. most: evaluations at most.
    """
    low, high = problem.bounds
    z = np.clip(z0, low, high)
    r, J = problem.residual(z), problem.jacobian(z)
    cost, damping, count, idle = _cost(r), 1e-3, 1, 0
    while count < most and idle < 2 and np.isfinite(cost):
        with np.errstate(over="ignore", invalid="ignore"):
            A, g = J.T @ J, J.T @ r
        if not np.isfinite(A).all():  # on the brink of instability sensitivities outgrow all numbers
            break
        held = ((z <= low) & (g > 0)) | ((z >= high) & (g < 0))
        free = np.flatnonzero(~held)
        A, g = A[np.ix_(free, free)], g[free]
        scale = np.maximum(np.diag(A), 1e-12 * max(1e-300, np.diag(A).max()))
        while count < most:
            step = np.zeros_like(z)
            step[free] = -cho_solve(cho_factor(A + damping * np.diag(scale)), g)
            trial = np.clip(z + step, low, high)
            r_new = problem.residual(trial)
            count += 1
            new = _cost(r_new)
            if new < cost:
                idle = idle + 1 if cost - new < tolerance * cost else 0
                z, r, J, cost, damping = trial, r_new, problem.jacobian(trial), new, max(1e-9, 0.2 * damping)
                break
            damping *= 4.0
            if damping > 1e9 or np.abs(step).max() < 1e-10:
                idle = 2
                break
    return Descent(
        label, problem.space.to_theta(z0), problem.space.to_theta(z), z, cost, count, idle >= 2,
        not np.isfinite(cost) or bool((r == UNSTABLE).all()),
    )  # fmt: skip


def _cost(r: np.ndarray) -> float:
    """Sum of squares; infinite, and so never an improvement, where a foot on the brink answers beyond all numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(r @ r)
    return total if total == total else np.inf
