"""What recordings say of a foot so far: the likeliest foot of each branch, and where it could lie beside that.

The problem is that of the wide fit, with the population of feet as one more prior, so that one recording is enough to
go on from. It is the fit for the minute between two recordings; identification.fit, without a population, has the last
word.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.presentation import readable
from fasbody.recording.recording import Recording
from identification.branches import DECISIVE_ODDS, STIFF_ANKLE, STIFF_PAD
from identification.engines.twin import Twin
from identification.periodic import Line, PeriodicProblem, excitations
from identification.plan.prior import Person, PlanSpace, stream
from identification.search import inverse_of_gram
from identification.settle import settle
from identification.wide import reweighed
from identification.world import Nuisance, WorldProblem

#: Starts of a first descent on each branch, and evaluations of a descent.
_STARTS, _MOST = 6, 40
#: Up to so many recordings the dampers may yet bend the other way.
_FEW = 4
_Z95 = 1.959963984540054
#: What keeps a correlation matrix positive definite.
_ROUNDING = 1e-10
#: Chi-square per degree of freedom beyond which it is open whether such a foot makes these recordings. It is said that
#: none does from so many recordings on, where noise alone is less likely than this: one recording can itself be bad.
FOLLOWS, _SEVERAL, _UNLIKELY = 2.0, 3, 1e-3


@dataclass(frozen=True)
class Band:
    """A constant with its 95 % limits."""

    value: float
    lower: float
    upper: float

    @property
    def half_width(self) -> float:
        """Half of the interval as a share of the value."""
        return 0.5 * (self.upper - self.lower) / self.value

    def __str__(self) -> str:
        return f"{readable(self.value, 4)} ({readable(self.lower, 4)} to {readable(self.upper, 4)})"


@dataclass(frozen=True, eq=False)
class End:
    """The likeliest foot of a branch.

    Attributes:
        name: of the branch. q: (n,). objective: chi-square and the squares of the prior's rows. A: information (n, n)
            of recordings and priors. C: covariance (n, n) as the fit has it, without the population. chi_square: of the
            recordings alone. dof: their numbers less the foot's constants.
    """

    name: str
    q: np.ndarray
    objective: float
    A: np.ndarray
    C: np.ndarray
    chi_square: float
    dof: int


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed of a foot after recordings.

    Attributes:
        ends: of both branches, the likelier first. space: of their variables. problem: whose ends they are.
    """

    ends: tuple[End, ...]
    space: PlanSpace
    problem: WorldProblem

    @property
    def log_odds(self) -> float:
        """Of the first branch over the other."""
        return 0.5 * (self.ends[1].objective - self.ends[0].objective)

    @property
    def decided(self) -> bool:
        """Beyond 1000 to 1, by recordings that such a foot can make."""
        return self.follows and self.log_odds > np.log(DECISIVE_ODDS)

    @property
    def per_dof(self) -> float:
        """Chi-square per degree of freedom of the likelier foot."""
        return self.ends[0].chi_square / max(1, self.ends[0].dof)

    @property
    def follows(self) -> bool:
        """Whether such a foot can make these recordings."""
        return self.per_dof <= FOLLOWS

    @property
    def strange(self) -> bool:
        """Whether there is evidence that no such foot makes these recordings."""
        from scipy.special import chdtrc

        end = self.ends[0]
        several = len(self.problem.lines) >= _SEVERAL and end.dof >= 1
        return several and not self.follows and float(chdtrc(end.dof, end.chi_square)) < _UNLIKELY

    def bands(self, names: Sequence[str], end: int = 0) -> dict[str, Band]:
        """Constants at rest, without load, of one end, as the fit has them: without the population, cut at the bounds,
        and wider where such a foot does not quite follow the recordings.
        """
        found, e, feet = {}, self.ends[end], self.space.feet
        L, seen = self.space.logarithms(e.q, names), np.isfinite(e.C).all(axis=1)
        std = np.sqrt(np.diag(L[:, seen] @ e.C[np.ix_(seen, seen)] @ L[:, seen].T))
        std[(L[:, ~seen] != 0).any(axis=1)] = np.inf
        std *= np.sqrt(max(1.0, e.chi_square / max(1, e.dof)))
        for name, s in zip(names, std, strict=True):
            value, i = self.space.value(e.q, name), self.space.index[name]
            ends = value * np.exp(-_Z95 * s), value * np.exp(min(_Z95 * s, 50.0))
            found[name] = Band(value, max(float(ends[0]), feet.lower[i]), min(float(ends[1]), feet.upper[i]))
        return found

    def open_bands(self, names: Sequence[str]) -> dict[str, Band]:
        """The same, over both feet while their branch is open."""
        first = self.bands(names)
        if self.decided:
            return first
        other = self.bands(names, 1)
        return {
            n: replace(b, lower=min(b.lower, other[n].lower), upper=max(b.upper, other[n].upper))
            for n, b in first.items()
        }

    def draw(self, seed: np.random.SeedSequence) -> np.ndarray:
        """A foot (n,) that the recordings leave possible, with the departures of the likeliest (`PlanSpace.draw`).

        The constants come first among the variables, and the factor of the covariance is triangular: so they do not
        depend on what else the candidates make possible.
        """
        other = 1 / (1 + np.exp(min(self.log_odds, 500.0)))
        end = self.ends[1 if np.random.default_rng(stream(seed, "branch")).random() < other else 0]
        free = np.setdiff1d(np.arange(end.q.size), self.space.departing)
        C = np.linalg.inv(end.A[np.ix_(free, free)])
        std = np.sqrt(np.diag(C))
        factor = std[:, None] * np.linalg.cholesky(C / np.outer(std, std) + _ROUNDING * np.eye(std.size))
        q = end.q.copy()
        q[free] += factor @ self.space.normals(seed)[free]
        low, high = self.space.side(1 if end.name == STIFF_ANKLE else -1)
        return np.clip(q, low, high)


def believe(
    person: Person,
    recordings: Sequence[Recording],
    allowed: tuple[Nuisance, ...],
    middle_hz: float,
    seed: np.random.SeedSequence,
    before: Belief | None = None,
) -> Belief:
    """The likeliest foot of each branch.

    Args:
        person: on the shaker. recordings: settled sines, checked. allowed: what else may be true. middle_hz: of the
            band. seed: of the starts. before: what was believed, to go on from.

    Raises:
        SimulationError: no foot of the population has such a motion.
    """
    lines = [Line.of(recording) for recording in recordings]
    space = person.space(allowed, recordings, middle_hz)
    weighed = any(each.group == "masses" for each in allowed)
    drives = [replace(d, masses={}) if weighed else d for d in excitations(lines, person.foot)]
    engine = Twin(person.foot, drives)
    problem = WorldProblem(lines, engine, space, PeriodicProblem(lines, engine, space))
    ends = _ends(problem, space, seed, before)
    reweighed(problem, [e.q for e in sorted(ends, key=lambda e: e.objective)])
    again = [_descend(problem, space, e.name, e.q) for e in ends]
    if len(again) < 2 or not all(np.isfinite(e.objective) for e in again):
        raise SimulationError("no foot of the population moves as these recordings do; check masses and units.")
    return Belief(tuple(sorted(again, key=lambda e: e.objective)), space, problem)


def _ends(problem: WorldProblem, space: PlanSpace, seed: np.random.SeedSequence, before: Belief | None) -> list[End]:
    found: dict[str, End] = {}

    def enter(name: str, q: np.ndarray) -> None:
        end = _descend(problem, space, name, q)
        if name not in found or end.objective < found[name].objective:
            found[name] = end

    known = {e.name: e.q for e in before.ends} if before is not None and before.space.index == space.index else {}
    for name, sign in ((STIFF_ANKLE, 1), (STIFF_PAD, -1)):
        if name in known:
            enter(name, known[name])
        for number in range(0 if known else _STARTS):
            enter(name, space.draw(stream(seed, f"{name} {number}"), sign))
    best = min(found.values(), key=lambda e: e.objective)
    enter(STIFF_PAD if best.name == STIFF_ANKLE else STIFF_ANKLE, space.image(best.q))
    best = min(found.values(), key=lambda e: e.objective)
    for q in space.bent(best.q) if len(problem.lines) <= _FEW else []:
        enter(best.name, q)
    best = min(found.values(), key=lambda e: e.objective)
    enter(STIFF_PAD if best.name == STIFF_ANKLE else STIFF_ANKLE, space.image(best.q))
    return list(found.values())


def _descend(problem: WorldProblem, space: PlanSpace, name: str, q: np.ndarray) -> End:
    problem.start(q)
    low, high = space.side(1 if name == STIFF_ANKLE else -1)
    found = settle(problem, q, low, high, _MOST)
    J = problem.jacobian(found.q)
    own = np.delete(J, problem.size + space.population, axis=0)  # the fit knows of no population
    dof = problem.size - len(space.base)
    return End(name, found.q, found.objective, J.T @ J, inverse_of_gram(own), problem.chi(found.q), dof)
