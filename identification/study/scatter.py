"""How far the recordings of one subject lie off its smooth curves: placement, muscle tone.

Recording i has the foot B_i beta + u_i with u_i ~ N(0, diag(tau^2)), independent from recording to recording. The
offsets are estimated with the coefficients, u_i / tau being residuals beside the harmonics: a hierarchical model whose
likelihood, the offsets integrated out, follows from Laplace's approximation.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from fasbody.exceptions import SimulationError
from identification.domains import PeriodicDomain
from identification.engines.engine import Engine, Excitation
from identification.engines.mujoco import Rollouts
from identification.periodic import Line, PeriodicProblem, excitations, split
from identification.search import UNSTABLE, Descent, descend, inverse_of_gram
from identification.study.curves import CurveSpace
from identification.study.levenberg import descend_fast

#: Scatter to begin with, and the least and the most that is believed; the least counts as none.
FIRST, LEAST, MOST = 0.1, 1e-3, 0.5
#: How far (in the logarithm) a curve between its knots may lie beyond a parameter's bounds: a wall, but not a cliff.
_WALL = 0.02
#: Rounds of weights and scatter at most, and relative change of the scatter that is none.
_ROUNDS, _SETTLED = 8, 0.02
#: A misfit that no further round will mend.
_HOPELESS = 100.0


class TrendProblem(PeriodicProblem):
    """Harmonics of all recordings, and their offsets from the curves over `tau` (k,)."""

    def __init__(
        self,
        lines: Sequence[Line],
        engine: Engine[Excitation],
        space: CurveSpace,
        tau: np.ndarray,
        tolerance: float = 1e-3,
    ) -> None:
        super().__init__(lines, engine, space, tolerance)
        self.curves, self.tau = space, tau
        self._anchor: np.ndarray | None = None

    def temper(self, share: float, anchor: np.ndarray) -> None:
        """Weigh every harmonic as if it were wrong by a share of the fundamental, for a search far from the answer.

        What such weights do not determine (delay, bend of the dampers) is tied to `anchor` (n,), or it would run away.
        """
        self._anchor = anchor
        for i, line in enumerate(self.lines):
            self._whiten[i] = self._first_whitening(line)
            self.widen(i, (share * abs(line.malleolus.amplitudes[0])) ** 2 * np.eye(2 * line.count))

    def release(self) -> None:
        """Let go of the anchor."""
        self._anchor = None

    @property
    def size(self) -> int:
        """Number of residuals."""
        m, k = self.curves.offsets
        return super().size + m * k

    def offsets(self, z: np.ndarray) -> np.ndarray:
        """Offsets (m, k) of the recordings from the curves, in the logarithm."""
        return z[self.curves.size :].reshape(self.curves.offsets)

    def residual(self, z: np.ndarray) -> np.ndarray:
        """Whitened harmonics, then offsets over their scatter, then what lies beyond the bounds."""
        r, (beyond, _) = super().residual(z), self._ties(z)
        parts = [r, (self.offsets(z) / self.tau).ravel(), beyond]
        return np.full(sum(p.size for p in parts), UNSTABLE) if (r == UNSTABLE).all() else np.concatenate(parts)

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """Derivatives of the residual."""
        m, k = self.curves.offsets
        own = np.hstack([np.zeros((m * k, self.curves.size)), np.diag(np.tile(1 / self.tau, m))])
        return np.vstack([super().jacobian(z), own, self._ties(z)[1]])

    def _ties(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of the feet beyond the parameters' bounds, zero inside, and of constants that are anchored."""
        space = self.curves
        B = space.weights[:, space.places].reshape(-1, z.size)
        low, high = (np.tile(limit[space.places], len(self.lines)) for limit in space.feet.bounds)
        q = B @ z
        beyond = q - np.clip(q, low, high)
        r, J = beyond / _WALL, (beyond != 0)[:, None] * B / _WALL
        if self._anchor is None:
            return r, J
        held = np.flatnonzero(~np.isin(np.arange(z.size), space.logarithmic))
        return np.append(r, (z - self._anchor)[held]), np.vstack([J, np.eye(z.size)[held]])

    def by_foot(self, z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Residual (2 H,) of each recording over its noise, its derivatives (2 H, p) to the foot's search variable."""
        found = []
        for i, line in enumerate(self.lines):
            Y, D, _ = self.response(i, z)
            theta, _ = self.curves.at(i, z)
            W = self._whiten[i]
            found.append((W @ split(Y - line.malleolus.amplitudes), W @ split(D * self.curves.feet.slope(theta))))
        return found

    def deviance(self, z: np.ndarray) -> float:
        """-2 log likelihood, offsets integrated out: cost + log det of S + G T^2 G' + V V', over all recordings."""
        r = self.residual(z)
        if (r == UNSTABLE).all():
            return float("inf")
        if not self.curves.scatter:
            return float(r @ r) + self.log_determinant
        total, shared = float(r @ r) + self._noise_log_determinant, np.eye(self._shared.shape[1])
        for (_, G), V in zip(self.by_foot(z), self.shared_errors(), strict=True):
            A = G[:, self.curves.places] * self.tau
            K = np.eye(A.shape[0]) + A @ A.T
            total += float(np.linalg.slogdet(K)[1])
            shared += V.T @ np.linalg.solve(K, V)
        return total + float(np.linalg.slogdet(shared)[1])

    def learn(self, z: np.ndarray) -> float:
        """Update tau to sum u^2 / effective number of offsets (MacKay 1992); returns the largest relative change."""
        m, k = self.curves.offsets
        if not m:
            return 0.0
        variance = np.diag(inverse_of_gram(self.jacobian(z)))[self.curves.size :].reshape(m, k)
        effective = np.maximum(m - np.sum(variance, axis=0) / self.tau**2, 1e-3 * m)
        tau = np.clip(np.sqrt(np.sum(self.offsets(z) ** 2, axis=0) / effective), LEAST, MOST)
        change = float(np.abs(np.log(tau / self.tau)).max())
        self.tau = tau
        return change


@dataclass(frozen=True, eq=False)
class TrendDomain(PeriodicDomain):
    """Steady state with smooth curves; `tau` (k,) is the scatter of new problems."""

    tau: np.ndarray | None = None

    def problem(self) -> TrendProblem:
        """See `Domain`."""
        return self._problem(self.engine(excitations(self.lines, self.foot), self.space.names))

    def certified(self, explored: TrendProblem) -> TrendProblem:
        """The same problem, with the same weights, on the MuJoCo rollout: the curves' feet have its differences."""
        engine = Rollouts(self.foot, excitations(self.lines, self.foot), self.space.names, self.threads)
        problem = self._problem(engine)
        problem.tolerance = 1e-7
        problem.weigh_as(explored)
        return problem

    def _problem(self, engine: Engine[Excitation]) -> TrendProblem:
        space = cast(CurveSpace, self.space)
        tau = np.full(len(space.places), FIRST) if self.tau is None else self.tau
        return TrendProblem(self.lines, engine, space, tau)

    def settle(self, z: np.ndarray) -> tuple["TrendDomain", TrendProblem, Descent]:
        """Bring weights, scatter and time step up to date, and go on, until the scatter stays."""
        domain, problem = self, self.problem()
        for number in range(_ROUNDS):
            domain, problem = domain._finer(problem, z)
            with suppress(
                SimulationError
            ):  # too far from the answer to have orbits with sharper input: as weighted so far
                problem.reweigh(z)
            descent = descend_fast(problem, z, "settled")
            z = descent.z
            if problem.learn(z) < _SETTLED:
                break
            if number and descent.cost > _HOPELESS * problem.size:
                return domain, problem, descent
        domain, problem = domain._finer(problem, z)
        # the surer method, for the end of a long valley
        return replace(domain, tau=problem.tau), problem, descend(problem, z, "settled", z0=z, tight=True)

    def _finer(self, problem: TrendProblem, z: np.ndarray) -> tuple["TrendDomain", TrendProblem]:
        """Domain and problem, or the same ones with the time step that their feet ask for."""
        finer = self.refined(z)
        if finer is self:
            return self, problem
        found = finer.problem()
        found.weigh_as(problem)
        found.tau = problem.tau
        return finer, found
