"""The fit once more, with everything else that may be true: one constrained optimum a branch, from the certified ends.

What is said of a foot follows this fit: its intervals, whether a constant is identified, whether a branch is decided.
Where not even that follows the recordings, no constant and no branch is offered.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.special import chdtri

from fasbody.exceptions import SimulationError
from fasbody.recording.known import Known
from identification.branches import EXCHANGED, STIFF_ANKLE, STIFF_PAD
from identification.certification import Certified, size_that_matters
from identification.domains import Domain
from identification.engines.engine import Engine, Excitation
from identification.engines.mujoco import Rollouts
from identification.engines.twin import Twin
from identification.periodic import Line, PeriodicProblem
from identification.result import WEIGHED, Allowance, Branch, Estimate, Mass, World, identifiability
from identification.search import UNSTABLE, inverse_of_gram
from identification.settle import settle
from identification.space import MASSES, Space
from identification.world import WorldProblem, WorldSpace, assumed, nuisances, under

#: Chi-square per degree of freedom beyond which not even the wide fit follows the recordings: between these two where
#: noise exceeds it once in a thousand.
FOLLOWS, _AT_LEAST, _BY_CHANCE = 2.0, 1.5, 1e-3
#: Evaluations of a descent, and of one in MuJoCo, where each costs a simulation a parameter.
_MOST, _MOST_IN_MUJOCO = 100, 6
#: What a step more may promise at an end that has come to rest: odds of 1000 to 1 are 14 of it.
_SETTLED = 0.5
#: Standard deviations of chi-square above what noise leaves, beyond which the search goes on from more places, and by
#: how much heavier or lighter the leg is there: the valley of masses, loads and mount is long.
_POOR, _HEAVIER = 1.0, (0.1, -0.1)
#: How far apart the branches are where a search begins afresh (rho), evaluations of each such start, and how many of
#: them go on to the end.
_APART, _TRIED, _KEPT = 0.7, 15, 2
#: Sign of rho on each branch.
_SIGNS = {STIFF_ANKLE: 1, STIFF_PAD: -1}
#: No leg's mass is further off than this (of the logarithm), however little the recordings say.
_Z95 = 1.959963984540054
_IF_TRUE = ", if the model is true"


@dataclass(frozen=True, eq=False)
class End:
    """Where the wide fit of a branch ended.

    Attributes:
        name: of the branch. q: search variable (n,). problem: whose residual it minimises. objective: chi-square and
            the squares of the prior's rows. converged: a step more promises next to nothing.
        constant: the objective where the foot's constants do not follow the load; None where one load, or a laboratory,
            says nothing of that.
    """

    name: str
    q: np.ndarray
    problem: WorldProblem
    objective: float
    converged: bool
    constant: float | None = None


def widest(
    domain: Domain,
    space: Space,
    ratio: float | None,
    certified: Sequence[Certified],
    known: Known,
    without: Sequence[str],
) -> list[End]:
    """The wide fit of each branch, best first; nothing where all else is excluded.

    Args:
        domain: of the certified fit, on harmonics. space: its constants. ratio: of the mirror image. certified: the
            branches, best first. known: by the laboratory. without: names of branches that cannot be.
    """
    foot, data = domain.foot, list(domain.recordings)
    masses = {name: value for name, value in foot.values().items() if name in MASSES}
    allowed = nuisances(data, known, tuple(masses), domain.twin, domain.sensors)
    narrow = certified[0].problem
    if not allowed or not isinstance(narrow, PeriodicProblem):
        return []
    world = WorldSpace(space, allowed, data, foot.values(), masses, domain.twin, ratio if domain.twin else None)
    finest = min((c.problem.engine for c in certified), key=lambda e: min(d.step for d in e.drives))  # type: ignore[attr-defined]
    weighed = world.kinds if any(each.group == "masses" for each in allowed) else {}  # the load stays as it is
    drives: list[Excitation] = [
        replace(d, masses={name: kg for name, kg in d.masses.items() if name not in weighed}) for d in finest.drives
    ]
    engine: Engine[Excitation]
    if domain.twin:
        engine = Twin(finest.foot, drives, domain.sensors)
    else:
        engine = Rollouts(finest.foot, drives, world.names, domain.threads, domain.sensors)
    problem = WorldProblem(narrow.lines, engine, world, narrow)
    most = _MOST if domain.twin else _MOST_IN_MUJOCO
    starts = [(c.name, world.start(space.values(c.descent.theta))) for c in certified]
    if world.ratio is None:
        return sorted((_descend(problem, name, q, *world.bounds, most) for name, q in starts), key=_objective)
    both = [name for name in (STIFF_ANKLE, STIFF_PAD) if name not in without]
    ends = _Ends(problem, both, most)
    for name, q in starts:
        ends.enter(name, q)
    ends.mirror()
    misled = certified[0].descent.cost > FOLLOWS * problem.size
    ends.afresh(foot.values(), misled)
    for end in list(ends.found.values()):  # second harmonics have one optimum for each way that dampers bend
        for q in world.bent(end.q):
            ends.enter(end.name, q)
    ends.mirror()
    for share in _HEAVIER if weighed else ():
        for end in list(ends.found.values()) if ends.poor() else ():
            heavier = world.heavier(end.q, share)
            ends.enter(end.name, heavier)
            ends.enter(_other(end.name), world.image(heavier))
    if misled and reweighed(problem, [end.q for end in sorted(ends.found.values(), key=_objective)]):
        ends = _Ends(problem, both, most, ends.found)
        if any(map(_lost, ends.found.values())):
            ends.mirror()
    for name, end in list(ends.found.items()):  # the odds are between ends, not between places on the way
        if not end.converged:
            ends.enter(name, end.q)
    best, *others = sorted(ends.found.values(), key=_objective)
    if _lost(best):
        return []
    constants = [constant for end in (best, *others) if (constant := _constant(end, most)) is not None]
    return [replace(best, constant=min(constants, default=None)), *others]


def reweighed(problem: PeriodicProblem, places: Iterable[np.ndarray]) -> bool:
    """Whether a problem has the weights of the first of some places (n,) that has a motion; else it keeps its own.

    An end may rest where an orbit is barely found, and not found again by the stricter search that weights need.
    """
    for q in places:
        with suppress(SimulationError):
            problem.reweigh(q)
            return True
    return False


def _constant(end: End, most: int) -> float | None:
    """What the same branch comes to where constants do not follow the load; None where there is one load."""
    world = end.problem.world
    follow = [world.index[each.name] for each in world.nuisances if each.group == "load"]
    if not follow:
        return None
    low, high = (limit.copy() for limit in world.side(_SIGNS[end.name]))
    low[follow] = high[follow] = 0.0
    return _descend(end.problem, end.name, end.q, low, high, most).objective


class _Ends:
    """The best end of each branch so far.

    Args:
        problem: the wide fit. both: names of the branches that can be. most: evaluations of a descent. before: ends to
            go on from, under other weights.
    """

    def __init__(
        self, problem: WorldProblem, both: Sequence[str], most: int, before: Mapping[str, End] = MappingProxyType({})
    ) -> None:
        self.problem, self.both, self._most = problem, both, most
        self.found: dict[str, End] = {}
        self._imaged = np.empty(0)
        for name, end in before.items():
            self.enter(name, end.q)

    def enter(self, name: str, q: np.ndarray) -> None:
        """Descend on a branch from q (n,)."""
        if name in self.both:
            end = self._descended(name, q, self._most)
            if name not in self.found or end.objective < self.found[name].objective:
                self.found[name] = end

    def mirror(self) -> None:
        """Descend on the other branch from the image of the best end, where that is not done."""
        best = min(self.found.values(), key=_objective)
        if not np.array_equal(best.q, self._imaged):
            self._imaged = best.q
            self.enter(_other(best.name), self.problem.world.image(best.q))

    def afresh(self, own: Mapping[str, float], misled: bool) -> None:
        """Descend on each branch that would be left out, or on both, from places that owe nothing to what was found.

        A narrow fit that a wrong model drove into a corner is no place to start from, and a branch may be left out
        for its chi-square only where no better end of it is found.

        Args:
            own: constants of the model as it is. misled: the narrow fit followed nothing.
        """
        world = self.problem.world
        for name in self.both:
            if misled or self.poor(name):
                best = min(self.found.values(), key=_objective)
                starts = [world.start(own), *world.fresh(best.q, _APART * _SIGNS[name])]
                if starts[0][world.index["k_F"]] * _SIGNS[name] < 0:
                    starts[0] = world.image(starts[0])
                tried = [self._descended(name, q, _TRIED) for q in starts]
                for end in sorted(tried, key=_objective)[:_KEPT]:
                    self.enter(name, end.q)
        self.mirror()

    def poor(self, name: str = "") -> bool:
        """Whether the end of a branch, or even the best end, leaves more than the noise, or is none."""
        if name and name not in self.found:
            return True
        end = self.found[name] if name else min(self.found.values(), key=_objective)
        expected = self.problem.size
        return not end.converged or end.objective > expected + _POOR * np.sqrt(2 * expected)

    def _descended(self, name: str, q: np.ndarray, most: int) -> End:
        return _descend(self.problem, name, q, *self.problem.world.side(_SIGNS[name]), most)


def _other(name: str) -> str:
    return STIFF_PAD if name == STIFF_ANKLE else STIFF_ANKLE


def _lost(end: End) -> bool:
    """Whether an end has no periodic motion."""
    return end.objective >= UNSTABLE**2


def _objective(end: End) -> float:
    return end.objective


def _descend(problem: WorldProblem, name: str, q: np.ndarray, low: np.ndarray, high: np.ndarray, most: int) -> End:
    problem.start(q)  # orbits are sought from rest
    found = settle(problem, q, low, high, most)
    end = End(name, found.q, problem, found.objective, found.left < _SETTLED)
    return replace(end, converged=False) if _lost(end) else end  # it rests where nothing moves


def widened(end: End, narrow: Branch | None, space: Space, dof: int) -> Branch:
    """A branch as the wide fit knows it, beside what the narrow one says of it; None where that had no such end.

    Args:
        end: of the wide fit. narrow: the same branch if the model is true. space: the constants. dof: of the narrow.
    """
    world, q = end.problem.world, end.q
    chi_square = end.problem.chi(q)
    excess = chi_square / max(1, dof)
    follows = bool(not dof or excess <= np.clip(chdtri(dof, _BY_CHANCE) / dof, _AT_LEAST, FOLLOWS))
    C = inverse_of_gram(end.problem.jacobian(q)) * max(1.0, excess)
    theta, std, low, high, correlation = world.estimates(q, C)
    at_bound = space.at_bound(theta)
    theta = space.snapped(theta)
    parameters = {}
    for i, item in enumerate(space.free):
        word = identifiability(theta[i], std[i], size_that_matters(item), bool(at_bound[i]))
        if word == "identified" and not end.converged:
            word = "weak"  # another place may fit better, and say something else
        before = None if narrow is None else narrow.parameters[item.key]
        if before is not None and before.identifiability != "not identifiable":
            before = replace(before, identifiability=before.identifiability + _IF_TRUE)
        parameters[item.key] = Estimate(
            float(theta[i]), float(std[i]), float(low[i]), float(high[i]), bool(at_bound[i]),
            word if follows else "not identifiable", before,
        )  # fmt: skip
    told = World(
        chi_square,
        end.objective,
        dof,
        follows,
        _masses(world, q, C, follows and end.converged),
        _allowances(world, q, C),
        end.constant,
        _exponents(world, q, C),
    )
    if narrow is not None:
        return replace(narrow, parameters=parameters, world=told)
    fit = float(np.mean([_percent(y, line) for y, line in zip(end.problem.predict(q), end.problem.lines, strict=True)]))
    return Branch(
        end.name, end.objective, end.objective, fit, parameters, correlation.tolist(), chi_square, dof, None, told
    )


def trusting(branch: Branch) -> Branch:
    """A branch of which no wide fit was made: its words hold if the model is true."""
    told = {
        key: e if e.identifiability == "not identifiable" else replace(e, identifiability=e.identifiability + _IF_TRUE)
        for key, e in branch.parameters.items()
    }
    return replace(branch, parameters=told)


def untold(branch: Branch) -> Branch:
    """A branch that offers no interval that trusts the model, and calls no constant known by it."""
    word = "not identifiable"
    told = {}
    for key, e in branch.parameters.items():
        if branch.world is None:
            told[key] = replace(e, std_error=np.nan, lower=np.nan, upper=np.nan, identifiability=word)
        else:
            told[key] = replace(e, if_model_true=e.if_model_true and replace(e.if_model_true, identifiability=word))
    return replace(branch, parameters=told)


def _percent(y: np.ndarray, line: Line) -> float:
    """Fit percentage of model harmonics, the malleolus' first: Eq. (3.20) of the periodic motion that they make."""
    Y = line.malleolus.amplitudes
    return float(100 * (1 - np.linalg.norm(y[: Y.size] - Y) / np.linalg.norm(Y)))


def _masses(world: WorldSpace, q: np.ndarray, C: np.ndarray, sure: bool) -> tuple[Mass, ...]:
    """Each segment of each person: all recordings of one share it. `sure`: the fit follows them, and is at rest."""
    found = []
    loads = {recording.condition.added_mass_kg for recording in world.recordings}
    scales = len(loads) == 1 and set(EXCHANGED) <= set(world.base)  # the whole foot with its mass
    for name, kinds in world.kinds.items():
        for kind in dict.fromkeys(kinds):
            if kind in world.index:
                stated, i, prior = world.stated(kinds.index(kind))[name], world.index[kind], world.slope(kind)
                x, std = world.of(q, kind), float(np.sqrt(C[i, i]))
                ends = np.clip([x - _Z95 * std * prior, x + _Z95 * std * prior], *world.limits(kind))
                low, high = (stated * float(np.exp(end)) for end in ends)
                whose = name + kind.partition(" mass")[2]
                learned = max(0.0, 1 - std)
                weighed = sure and not scales and learned > WEIGHED
                guessed = assumed(world.recordings, world.recordings[kinds.index(kind)].condition.subject)
                value = stated * float(np.exp(x))
                found.append(Mass(whose, stated, prior, value, low, high, learned, weighed, guessed))
    return tuple(found)


def _exponents(world: WorldSpace, q: np.ndarray, C: np.ndarray) -> dict[str, tuple[float, float, float]]:
    """The power of the weight on the pad that each constant follows, with its 95 % interval."""
    loads = sorted({recording.condition.added_mass_kg for recording in world.recordings})
    leg = sum(world.stated(0).values())
    found = {}
    for name in EXCHANGED:
        at = [world.index[under(name, load)] for load in loads[1:] if under(name, load) in world.index]
        if at and leg > 0:
            x = np.log((leg + np.array(loads[1:])) / (leg + loads[0]))
            e = np.array([world.of(q, under(name, load)) for load in loads[1:]])
            size = np.array([world.slope(under(name, load)) for load in loads[1:]])
            weights = np.linalg.solve(C[np.ix_(at, at)] * np.outer(size, size), x)
            power, std = float(weights @ e / (weights @ x)), float(1 / np.sqrt(weights @ x))
            found[name] = (power, power - _Z95 * std, power + _Z95 * std)
    return found


def _allowances(world: WorldSpace, q: np.ndarray, C: np.ndarray) -> tuple[Allowance, ...]:
    found = []
    for each in world.nuisances:
        i = world.index[each.name]
        x, std = world.of(q, each.name), float(np.sqrt(C[i, i])) * each.std
        low, high = (float(np.clip(x + sign * _Z95 * std, each.lower, each.upper)) for sign in (-1, 1))
        ends = [float(np.clip(each.mean + sign * _Z95 * each.std, each.lower, each.upper)) for sign in (-1, 1)]
        found.append(
            Allowance(
                each.name, each.group, each.does, each.unit, each.value(each.mean), each.value(ends[0]),
                each.value(ends[1]), each.value(x), each.value(low), each.value(high), (x - each.mean) / each.std,
                (x - each.mean) / std, each.source,
            )
        )  # fmt: skip
    return tuple(found)
