"""How well recordings repeat: two variances, estimated from what the best fit leaves over.

A person sits down anew for every recording. Springs and dampers then differ, each for itself, which moves all harmonics
of a recording together; what else differs moves each harmonic for itself. Both variances are those of the largest
restricted likelihood: that of the residual with the fitted variables integrated out, to second order. It is taken where
the fit is, not where it would go with other weights: so the scatter falls to the first value that explains itself, and
no farther, to a contrived place that fits better.
"""

from dataclasses import dataclass

import numpy as np

from identification.residual import Problem, Scatter

#: Chance of a chi-square from noise alone beyond which there is a scatter besides.
_BY_CHANCE = 0.05
#: Largest scatter, and where the search for both begins, as shares of the one that alone would do.
_MOST, _STARTS = 1.0, ((0.7, 0.7), (1.0, 0.05), (0.05, 1.0))
#: How near the scatter that alone would do is found, and the least.
_NEAR, _LEVEL = 0.01, 1e-4


@dataclass(frozen=True, eq=False)
class _Linear:
    """The problem about its end, free variables only.

    Attributes:
        problem: with noise and what constants do to the sensors.
        e: (R, m) residual.
        J: (R, m, n) derivatives.
        weight: (n,) inverse variance of the priors.
        free: (n,) places of these variables among all.
    """

    problem: Problem
    e: np.ndarray
    J: np.ndarray
    weight: np.ndarray
    free: np.ndarray

    @classmethod
    def of(cls, problem: Problem, q: np.ndarray) -> "_Linear":
        """At q (n,)."""
        e, J = (part[0] for part in problem.missed(q[None])[:2])
        low, high = problem.bounds()
        J = np.where(problem.held, 0.0, J)
        free = (low < q) & (q < high) & (np.abs(J).max((0, 1)) > 0)
        return cls(problem, e, J[..., free], problem.variables.prior[1][free] ** -2, np.flatnonzero(free))

    def whitened(self, scatter: Scatter) -> tuple[np.ndarray, np.ndarray, float]:
        """Residual (R, m), derivatives (R, m, n), and the logarithm of the covariance's determinant."""
        W = self.problem.whitener(scatter)
        determinant = -2 * np.log(np.diagonal(W, axis1=1, axis2=2)[self.problem.measured.rows]).sum()
        return (W @ self.e[..., None])[..., 0], W @ self.J, float(determinant)

    def excess(self, scatter: Scatter) -> tuple[float, float]:
        """Chi-square, and its degrees of freedom: the numbers measured less those that the variables use up."""
        e, J, _ = self.whitened(scatter)
        G = np.einsum("rmi,rmj->ij", J, J)
        used = np.trace(np.linalg.lstsq(G + np.diag(self.weight), G, rcond=None)[0])
        return float((e**2).sum()), max(self.problem.size - float(used), 3.0)

    def deviance(self, scatter: Scatter) -> float:
        """-2 log restricted likelihood, up to a constant."""
        e, J, determinant = self.whitened(scatter)
        A = np.einsum("rmi,rmj->ij", J, J) + np.diag(self.weight)
        A += 1e-12 * np.trace(A) * np.eye(len(A))
        return float(determinant + (e**2).sum() + np.linalg.slogdet(A)[1])


def repeatability(problem: Problem, q: np.ndarray) -> Scatter:
    """The likeliest scatter from recording to recording; none where noise alone leaves as much once in twenty times.

    Args:
        problem: with the weights at which q was found (`Problem.weighed`).
        q: (n,) the best end.
    """
    from scipy.optimize import minimize
    from scipy.special import chdtri

    linear = _Linear.of(problem, q)
    chi_square, dof = linear.excess(Scatter())
    if chi_square <= float(chdtri(dof, _BY_CHANCE)):
        return Scatter()
    low, high = 0.0, _MOST  # of harmonics, if they alone scattered: chi-square falls with it
    while high - low > _NEAR * high and high > _LEVEL:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if linear.excess(Scatter(middle))[0] > dof else (low, middle)
    if not problem.seats.any():
        return Scatter(high)
    ends = [
        minimize(
            lambda x: linear.deviance(Scatter(*np.exp(x))), np.log(high * np.array(start)), method="L-BFGS-B",
            bounds=[(np.log(_LEVEL / 10), np.log(_MOST))] * 2, options={"ftol": 1e-6, "gtol": 1e-2},
        )
        for start in _STARTS
    ]  # fmt: skip
    best = min(ends, key=lambda end: end.fun)
    return Scatter(*(0.0 if x < _LEVEL else float(x) for x in np.exp(best.x)))
