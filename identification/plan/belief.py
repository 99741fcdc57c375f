"""What recordings say of a foot so far: the likeliest foot of each branch, and where it could lie beside that.

The problem is the fit's, with the population of feet as one more prior, so that one recording is enough to go on from.
It is the fit for the minute between two recordings; identification.fit, without a population, has the last word.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from fasbody.exceptions import SimulationError
from fasbody.presentation import readable
from fasbody.recording.recording import Recording
from identification.branches import DECISIVE_ODDS
from identification.estimates import Estimate
from identification.harmonics import Line, Measured
from identification.intervals import Solution
from identification.motion import TwoMassMotion
from identification.nuisances import Nuisance
from identification.optimiser import Effort, Searched, search
from identification.plan.prior import Person, PlanVariables, stream
from identification.residual import Problem, Scatter
from identification.sensors import MALLEOLUS
from identification.steady import FOLLOWS, SIDES

#: Feet of the population from which a first search starts, and how much is done from each.
_STARTS, _EFFORT = 12, Effort(starts=0, rounds=1, smooth=(0.1,))
#: Chi-square per degree of freedom beyond which such a foot does not make these recordings.
_MISFIT = 2.0
#: What keeps a correlation matrix positive definite.
_ROUNDING = 1e-10
#: That such a foot does not move like this is said from so many recordings on: one recording can itself be bad.
_SEVERAL = 3
#: Standard deviation of repeatability, a factor, and the least that is expected: nothing repeats better.
_FACTOR, _LEAST = 2.0, 1e-3
#: Values of it that are tried.
_TRIED = np.geomspace(1e-4, 1.0, 81)


@dataclass(frozen=True)
class Band:
    """A constant with its 95 % limits."""

    value: float
    lower: float
    upper: float

    @classmethod
    def of(cls, estimate: Estimate) -> "Band":
        """Of an estimate of the fit."""
        return cls(estimate.value, estimate.lower, estimate.upper)

    @property
    def half_width(self) -> float:
        """Half of the interval as a share of the value."""
        return 0.5 * (self.upper - self.lower) / self.value

    def __str__(self) -> str:
        return f"{readable(self.value, 4)} ({readable(self.lower, 4)} to {readable(self.upper, 4)})"


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed of a foot after recordings.

    Attributes:
        ends: the likeliest foot of each branch, the likelier first; the population is a prior of theirs.
    """

    ends: tuple[Solution, ...]

    @property
    def variables(self) -> PlanVariables:
        """Of the ends."""
        variables = self.ends[0].problem.variables
        assert isinstance(variables, PlanVariables)
        return variables

    @property
    def repeatability(self) -> float:
        """Relative scatter of a harmonic from recording to recording."""
        return self.ends[0].problem.repeatability

    @property
    def log_odds(self) -> float:
        """Of the first branch over the other."""
        return 0.5 * (self.ends[1].optimum.objective - self.ends[0].optimum.objective)

    @property
    def decided(self) -> bool:
        """Beyond 1000 to 1, by recordings that such a foot can make."""
        return self.follows and self.log_odds > np.log(DECISIVE_ODDS)

    @property
    def follows(self) -> bool:
        """Whether such a foot can make these recordings, if a person repeats as people do."""
        return self.repeatability <= FOLLOWS and self.ends[0].excess <= _MISFIT

    @property
    def strange(self) -> bool:
        """Whether there is evidence that no such foot makes these recordings."""
        return len(self.ends[0].problem.measured.lines) >= _SEVERAL and not self.follows

    def bands(self, names: Sequence[str], end: int = 0) -> dict[str, Band]:
        """Constants of one end as the fit has them: dynamic, without load and without the population."""
        solution = self.ends[end]
        problem = replace(solution.problem, variables=replace(self.variables, populated=False))
        estimates, _ = replace(solution, problem=problem).estimates(profiles=True)
        keys = {item.name: item.key for item in self.variables.space.free}
        return {name: Band.of(estimates[keys[name]]) for name in names}

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
        """A foot (n,) that the recordings leave possible, with the departures of the likeliest (`PlanVariables.draw`).

        The constants come first among the variables, and the factor of the covariance is triangular: so they do not
        depend on what else the candidates make possible.
        """
        other = 1 / (1 + np.exp(min(self.log_odds, 500.0)))
        end = self.ends[1 if np.random.default_rng(stream(seed, "branch")).random() < other else 0]
        free, J = ~self.variables.departing, end.evaluation.jacobian[0]
        C = np.linalg.inv(J[:, free].T @ J[:, free])
        std = np.sqrt(np.diag(C))
        factor = std[:, None] * np.linalg.cholesky(C / np.outer(std, std) + _ROUNDING * np.eye(std.size))
        q = end.q.copy()
        q[free] += factor @ self.variables.normals(seed)[free]
        return np.clip(q, *self.variables.side(end.optimum.sign))


def believe(
    person: Person,
    recordings: Sequence[Recording],
    allowed: tuple[Nuisance, ...],
    middle_hz: float,
    expected: float,
    seed: np.random.SeedSequence,
    before: Belief | None = None,
) -> Belief:
    """The likeliest foot of each branch, from starts on both sides and from each other's mirror image.

    Args:
        person: on the shaker.
        recordings: settled sines, checked.
        allowed: what else may be true.
        middle_hz: of the band.
        expected: repeatability where the recordings say little of it.
        seed: of the starts.
        before: what was believed, to go on from.

    Raises:
        SimulationError: no foot of the population has such a motion.
    """
    measured = Measured.of([Line.of(recording) for recording in recordings], MALLEOLUS)
    variables = person.variables(allowed, recordings, middle_hz)
    motion = TwoMassMotion(measured, variables.omega, (False,))
    problem = Problem.of(measured, variables, motion, max(expected, _LEAST))
    if before is None:
        first = [variables.draw(stream(seed, str(i)), (-1) ** i) for i in range(_STARTS)]
    else:
        first = [variables.carried(end.q, before.variables) for end in before.ends]

    def searched(problem: Problem, first: Sequence[np.ndarray]) -> Searched:
        return search(problem, (1, -1), _EFFORT, estimate=False, first=np.stack(first))

    for _ in range(2):  # what is left over says how well the recordings repeat, and weighs them anew
        optima = searched(problem, first).optima
        q, first = optima[0].q, [o.q for o in optima]
        problem = problem.weighed(q)
        problem = problem.with_repeatability(repeatability(problem, q, expected))
    last = searched(problem, first)
    ends = tuple(Solution(SIDES[o.sign], last.problem, o) for o in last.optima)
    if not all(end.evaluation.moves[0] for end in ends):
        raise SimulationError("no foot of the population moves as these recordings do; check masses and units.")
    return Belief(ends)


def repeatability(problem: Problem, q: np.ndarray, expected: float) -> float:
    """The likeliest scatter from recording to recording, with all variables integrated out to second order.

    Its prior is log-normal about what is expected, so that one recording changes little, and many decide.

    Args:
        problem: with weights.
        q: (n,) the likeliest foot.
        expected: before there were recordings.
    """
    rows, output = problem.measured.rows, problem.measured.output
    unit = np.broadcast_to(np.eye(rows.shape[1]), problem.noise.shape)
    now = replace(problem, noise=unit, scatter=Scatter()).evaluate(q[None])
    e, J = now.residual[0, : problem.size], now.jacobian[0, : problem.size]
    mean, std = problem.variables.prior
    e = e - J @ (q - mean)  # where the prior is centred, were the problem linear
    noise = block_diag(*(S[np.ix_(at, at)] for S, at in zip(problem.noise, rows, strict=True)))
    size = np.tile(np.abs(output).reshape(len(rows), -1), 2)[rows]
    rest, expected = noise + (J * std**2) @ J.T, max(expected, _LEAST)
    deviances = []
    for s in _TRIED:
        V = rest + np.diag((s * size) ** 2)
        prior = (np.log(s / expected) / np.log(_FACTOR)) ** 2
        deviances.append(e @ np.linalg.solve(V, e) + np.linalg.slogdet(V)[1] + prior)
    return float(_TRIED[int(np.argmin(deviances))])
