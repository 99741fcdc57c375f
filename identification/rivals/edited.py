"""A user's own MJCF as a rival: fitted in MuJoCo beside masses, gain, delay and drift, as the rungs are."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from fasbody.foot.model import Foot
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording
from identification.engines.engine import Engine, Excitation
from identification.engines.mujoco import Rollouts
from identification.estimate import fit_foot
from identification.periodic import Line, excitations
from identification.result import Estimate, identifiability
from identification.rivals.problem import Measured
from identification.rivals.result import Rival
from identification.rivals.search import folds, surprise
from identification.search import inverse_of_gram
from identification.space import MASSES, space_of
from identification.world import WorldProblem, WorldSpace, nuisances

#: Starts of the first fit, evaluations of the descent beside the nuisances, and of a refit without some recordings.
_STARTS, _MOST, _REFIT = 4, 15, 4
_Z95 = 1.959963984540054
#: Departures that rungs of their own stand for.
_NAMED = ("mount", "relaxation", "load", "rocking")
#: Constants of the two-mass foot: a model with more frees more than it.
_OF_MODEL = 8


def edited(foot: Foot, data: Sequence[Recording], lines: Sequence[Line], measured: Measured, known: Known) -> Rival:
    """Fit a user's model, with the weights that all rivals have.

    Args:
        foot: the model. data: the recordings. lines: their harmonics. measured: the same, as they are weighed.
        known: what is known of masses and instrument.
    """
    names = foot.parameters
    space = space_of(foot, delay=False)
    masses = {name: value for name, value in foot.values().items() if name in MASSES and name != "added_mass"}
    allowed = nuisances(data, known.told(exclude=_NAMED), tuple(masses), False)
    world = WorldSpace(space, allowed, data, foot.values(), masses, False, None)
    drives = []
    for drive in excitations(lines, foot):
        own = {"added_mass": drive.masses["added_mass"]} if "added_mass" in names else {}
        drives.append(replace(drive, masses=own if world.names != space.names else drive.masses))
    problem = _Weighed(lines, Rollouts(foot, drives, world.names), world, measured)
    narrow = fit_foot(data, foot, starts=_STARTS, wide=False)
    q = world.start({name: narrow.best[name].value for name in space.names})
    q = problem.descend(q, _MOST)
    r, J = problem.residual(q), problem.jacobian(q)
    dof = max(1, measured.size - len(space.free))
    C = inverse_of_gram(J) * max(1.0, problem.chi(q) / dof)
    told, error = _held_out(problem, measured, q)
    springs = [_spring(world, q, C, name) for name in ("k_T", "k_F")]
    ratio = None
    if springs[0] and springs[1]:
        T, F = world.index["k_T"], world.index["k_F"]
        spread = C[T, T] + C[F, F] - 2 * C[T, F]
        ratio = (float(q[T] - q[F]), float(np.sqrt(max(spread, 0.0))))
    free = len(space.free)
    return Rival(
        name=foot.name, title=foot.name, free=free, chi_square=problem.chi(q), dof=dof,
        bic=float(r @ r) + free * float(np.log(measured.size)), held_out=told, error=error, branch="best",
        log_odds=None, k_T=springs[0], k_F=springs[1], log_ratio=ratio, other=None, own=(), values={},
        predicted=tuple(problem.predict(q)), converged=True, nested=False, extra=free > _OF_MODEL,
    )  # fmt: skip


class _Weighed(WorldProblem):
    """The problem of a user's model with the weights of the rungs; recordings may be left out."""

    def __init__(
        self, lines: Sequence[Line], engine: Engine[Excitation], world: WorldSpace, measured: Measured
    ) -> None:
        self._all = [W[: 2 * k, : 2 * k] for W, k in zip(measured.W, measured.counts, strict=True)]
        super().__init__(lines, engine, world, self)
        self.keep(np.ones(len(lines), bool))

    def _first_whitening(self, line: Line) -> np.ndarray:
        return np.eye(2 * line.count)  # `keep` brings the weights

    def keep(self, kept: np.ndarray) -> None:
        """Leave out the recordings that a mask (n,) does not hold."""
        self._whiten = [W * float(k) for W, k in zip(self._all, kept, strict=True)]
        self._cache = None

    def descend(self, q: np.ndarray, most: int) -> np.ndarray:
        """Search variable (n,) at the least sum of squares from q (n,), in so many evaluations at most."""
        low, high = self.world.bounds
        inside = np.clip(q, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        found = least_squares(
            self.residual, inside, self.jacobian, bounds=(low, high), method="trf", x_scale="jac", ftol=1e-5,
            xtol=1e-6, gtol=1e-8, max_nfev=most,
        )  # fmt: skip
        return np.asarray(found.x)


def _held_out(problem: _Weighed, measured: Measured, q: np.ndarray) -> tuple[dict[str, float], float]:
    """As `search.held_out`."""
    found: dict[str, float] = {}
    missed = total = 0.0
    for kind, out in folds(measured):
        problem.keep(~out)
        at = problem.descend(q, _REFIT)
        C = inverse_of_gram(problem.jacobian(at))
        problem.keep(out)
        rows = np.concatenate([np.full(2 * k, left) for k, left in zip(measured.counts, out, strict=True)])
        r, J = problem.residual(at)[: measured.size], problem.jacobian(at)[: measured.size]
        found[kind] = found.get(kind, 0.0) + surprise(r[rows], J[rows], C)
        for y, line, left in zip(problem.predict(at), problem.lines, out, strict=True):
            if left:
                missed += float(np.sum(np.abs(y - line.malleolus.amplitudes) ** 2))
                total += float(np.sum(np.abs(line.malleolus.amplitudes) ** 2))
    problem.keep(np.ones(len(problem.lines), bool))
    return found, float(np.sqrt(missed / total)) if total else 0.0


def _spring(world: WorldSpace, q: np.ndarray, C: np.ndarray, name: str) -> Estimate | None:
    """A stiffness that the model declares and the fit frees."""
    if name not in world.base:
        return None
    i = world.index[name]
    std, value = float(np.sqrt(C[i, i])), float(np.exp(q[i]))
    low, high = world.feet.lower[i], world.feet.upper[i]
    lower, upper = (float(np.clip(value * np.exp(z * std), low, high)) for z in (-_Z95, _Z95))
    bound = value < 1.001 * low or value > 0.999 * high
    return Estimate(value, value * std, lower, upper, bound, identifiability(value, value * std, 0.0, bound))
