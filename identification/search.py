"""Multi-start search: descents of a problem from many starts by the trust-region-reflective method."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from identification.space import Space


class Problem(Protocol):
    """What a descent needs: periodic.PeriodicProblem and time_domain.TimeProblem."""

    space: Space
    evaluations: int

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (n,) of the full search variable."""

    @property
    def size(self) -> int:
        """Number of residuals."""

    @property
    def log_determinant(self) -> float:
        """Sum of log variances."""

    def start(self, q: np.ndarray) -> np.ndarray:
        """Full search variable (n,) of a start q (p,)."""

    def residual(self, z: np.ndarray) -> np.ndarray:
        """Weighted residual (m,)."""

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """Its Jacobian (m, n)."""

    def covariance(self, z: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Covariance (p, p) of the active ones of q, NaN for the others."""


#: Every residual of a parameter set whose motion is unstable.
UNSTABLE = 1e6


@dataclass(frozen=True, eq=False)
class Descent:
    """One descent.

    Attributes:
        label: which start. theta0, theta: parameters at start and end. z: full search variable at the end.
        cost: weighted sum of squares at the end. evaluations: of residual and Jacobian. converged: by its tolerances.
        unstable: it never left the parameter sets whose motion is unstable.
    """

    label: str
    theta0: np.ndarray
    theta: np.ndarray
    z: np.ndarray
    cost: float
    evaluations: int
    converged: bool
    unstable: bool


def descend(
    problem: Problem, q0: np.ndarray, label: str, *, z0: np.ndarray | None = None, tight: bool = False
) -> Descent:
    """Minimise the cost, Eqs. (4.35) to (4.41), from one start.

    Args:
        problem: residual and Jacobian. q0: start (p,). label: its name. z0: full search variable to start from instead.
        tight: converge well below the standard errors, for a result to report.
    """
    p = problem.space.lower.size
    low, high = problem.bounds
    z = problem.start(q0) if z0 is None else z0
    inside = np.clip(z, low + 1e-9 * (high - low), high - 1e-9 * (high - low))  # the method starts inside its bounds
    before = problem.evaluations
    tolerance = 1e-10 if tight else 1e-8  # of the cost: 1e-10 of chi-square is far below a standard error
    found = least_squares(
        problem.residual, inside, problem.jacobian, bounds=(low, high), method="trf", x_scale="jac",
        ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=200,
    )  # fmt: skip
    return Descent(
        label=label,
        theta0=problem.space.to_theta(inside[:p]),
        theta=problem.space.to_theta(found.x[:p]),
        z=found.x,
        cost=2 * float(found.cost),
        evaluations=problem.evaluations - before,
        converged=bool(found.success),
        unstable=bool((found.fun == UNSTABLE).all()),
    )


def explore(
    problem: Problem, starts: Iterable[tuple[str, np.ndarray]], advance: Callable[[], None] = lambda: None
) -> tuple[list[Descent], bool]:
    """Descend from every start; Ctrl-C keeps what is done.

    Args:
        problem: what to minimise. starts: (label, q0). advance: called after each, for a progress bar.

    Returns:
        The descents, best first, and whether they were interrupted.
    """
    done: list[Descent] = []
    interrupted = False
    try:
        for label, q0 in starts:
            done.append(descend(problem, q0, label))
            advance()
    except KeyboardInterrupt:
        if not done:
            raise
        interrupted = True
    return sorted(done, key=lambda d: d.cost), interrupted
