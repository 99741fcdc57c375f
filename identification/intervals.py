"""What an optimum says of each constant: value, 95 % interval from the curvature, identified or not.

The covariance is the inverse of J^T J with a row for each prior. A chi-square beyond its degrees of freedom widens it;
where the scatter between recordings is estimated, Student's quantile stands for the normal one. A variable at its bound
is not known to lie there, so that all others keep their share of its uncertainty.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fasbody.constants import Z95
from fasbody.foot.parameters import Parameter
from identification.branches import EXCHANGED
from identification.estimates import WEIGHED, Allowance, Estimate, Mass, identifiability, quantile
from identification.nuisances import Nuisance, stated_mass
from identification.optimiser import Optimum
from identification.parameters import delay_of
from identification.profile import Coordinates, ends
from identification.residual import Evaluation, Problem

#: Distance to a bound, as a share of the range, at which a constant rests on it.
_AT_BOUND = 1e-4
#: Name of the factor that is common to all constants among the profiles.
SCALE = "scale"
#: Step of a variable for a slope, in its scale.
_STEP = 1e-4


def inverse_of_gram(J: np.ndarray) -> np.ndarray:
    """(J^T J)^-1 (p, p) of J (m, p), with infinite variance for parameters in directions that no residual sees."""
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    seen = s > 1e-10 * s[0]
    C = (Vt[seen].T / s[seen] ** 2) @ Vt[seen]
    blind = np.sum(Vt[seen] ** 2, axis=0) < 1 - 1e-6
    C[blind, blind] = np.inf
    return C


@dataclass(frozen=True, eq=False)
class Solution:
    """An optimum of a problem, with what is uncertain of it.

    Attributes:
        branch: name of its side.
        problem: with its weights.
        optimum: where it is.
    """

    branch: str
    problem: Problem
    optimum: Optimum

    @property
    def q(self) -> np.ndarray:
        """(n,) search variable."""
        return self.optimum.q

    @cached_property
    def evaluation(self) -> Evaluation:
        """Residual and derivatives there."""
        return self.problem.evaluate(self.q[None])

    @cached_property
    def chi_square(self) -> float:
        """Sum of squares of what was measured, without the priors' rows."""
        r = self.evaluation.residual[0, : self.problem.size]
        return float(r @ r)

    @cached_property
    def dof(self) -> int:
        """Numbers measured less those that the variables use up."""
        return max(0, round(self.problem.size - self._used))

    @cached_property
    def _gram(self) -> tuple[np.ndarray, np.ndarray]:
        low, high = self.problem.bounds()
        free = high > low
        return free, inverse_of_gram(self.evaluation.jacobian[0][:, free])

    @cached_property
    def _used(self) -> float:
        free, C = self._gram
        if not np.isfinite(C).all():
            return float(free.sum())
        J = self.evaluation.jacobian[0][: self.problem.size, free]
        return float(np.einsum("mi,ij,mj->", J, C, J))

    @property
    def excess(self) -> float:
        """Chi-square per degree of freedom, at least 1."""
        return max(1.0, self.chi_square / max(1, self.dof))

    @cached_property
    def covariance(self) -> np.ndarray:
        """(n, n) of the search variable; zero for what is held, infinite where nothing is known."""
        free, C = self._gram
        whole = np.zeros((free.size, free.size))
        whole[np.ix_(free, free)] = C * self.excess
        return whole

    @property
    def quantile(self) -> float:
        """How many standard errors a 95 % interval reaches to each side."""
        return quantile(self.problem.repeatability, self.dof)

    # what follows from it

    def deviance(self, objective: float) -> float:
        """-2 log likelihood at an end whose sum of squares is `objective`, up to a constant.

        Normal, or Student's where repeatability was estimated at this solution, the best of those compared.
        """
        if self.problem.repeatability == 0:
            return objective
        nu, least = max(2, self.dof), self.optimum.objective
        return float(least + nu * np.log1p(max(0.0, objective - least) / nu))

    def slopes(self, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """(m, n) derivatives of a function (m,) of q (n,), by differences: central ones, one-sided at a bound."""
        low, high = self.problem.variables.bounds
        steps = _STEP * np.eye(self.q.size)
        above, below = np.minimum(self.q + steps, high), np.maximum(self.q - steps, low)
        length = np.diagonal(above - below)
        return np.stack([function(a) - function(b) for a, b in zip(above, below, strict=True)], 1) / length

    def spread(self, J: np.ndarray) -> np.ndarray:
        """(m,) standard errors of what has the derivatives J (m, n); infinite where the recordings set no limit."""
        C = self.covariance
        blind = ~np.isfinite(np.diag(C))
        known = np.where(np.isfinite(C), C, 0.0)
        known[blind] = known[:, blind] = 0.0
        std = np.sqrt(np.maximum(np.einsum("mi,ij,mj->m", J, known, J), 0.0))
        return np.where((np.abs(J[:, blind]) > 1e-12).any(axis=1), np.inf, std)

    def foot(self, number: int, q: np.ndarray | None = None) -> dict[str, float]:
        """Constants and masses by name under the conditions of a recording, springs as they are at rest."""
        variables = self.problem.variables
        theta = variables.theta(self.q if q is None else q)[number]
        return {
            **variables.model_values,
            **variables.space.fixed,
            **dict(zip(variables.motion_names, map(float, theta), strict=True)),
        }

    # tables

    def _coordinates(self, q: np.ndarray, at_rest: bool = False) -> np.ndarray:
        """(p,) constants as their intervals are symmetric: logarithms, squares of c_13 and c_23, or plain."""
        variables = self.problem.variables
        values = variables.at_rest(q) if at_rest else variables.dynamic(q)
        return np.array([self._forth(name, value) for name, value in values.items()], float)

    def _item(self, name: str) -> Parameter:
        variables = self.problem.variables
        return next(item for item in variables.space.free if item.name == name)

    def _forth(self, name: str, value: Any) -> Any:
        if name in self.problem.variables._squared:
            return value * value
        return np.log(value) if self._item(name).logarithmic else value

    def _back(self, name: str, x: float) -> float:
        if name in self.problem.variables._squared:
            return float(np.sqrt(max(x, 0.0)))
        return float(np.exp(min(x, 700.0))) if self._item(name).logarithmic else x

    def estimates(self, profiles: bool = False) -> tuple[dict[str, Estimate], np.ndarray]:
        """Each free constant by its key, the delays last, and the correlations (p, p) of them.

        Args:
            profiles: springs and dampers of the two-mass foot have the ends of their profiles.
        """
        variables = self.problem.variables
        J = self.slopes(self._coordinates)
        names = list(variables.dynamic(self.q))
        x, stds = self._coordinates(self.q), self.spread(J)
        reach = self.profiles if profiles else {}
        estimates = {
            self._item(name).key: self._estimate(name, x[i], stds[i], reach.get(name)) for i, name in enumerate(names)
        }
        rest = self._at_rest()
        for name, estimate in rest.items():  # what relaxes only adds to it
            key = self._item(name).key
            upper = min(estimate.upper, estimates[key].upper)
            estimates[key] = replace(estimates[key], at_rest=replace(estimate, upper=upper))
        rows = [J]
        for i, item in variables.numbered:
            if item.kind == "delay":
                parameter = delay_of(item.sensor)
                estimates[parameter.key] = self._delay(item, i, parameter)
                rows.append(np.eye(self.q.size)[i : i + 1])
        return estimates, self._correlation(np.concatenate(rows))

    def _correlation(self, J: np.ndarray) -> np.ndarray:
        C = np.where(np.isfinite(self.covariance), self.covariance, 0.0)
        S = J @ C @ J.T
        root = np.sqrt(np.maximum(np.diag(S), 1e-300))
        return np.asarray(np.nan_to_num(S / np.outer(root, root)))

    @cached_property
    def profiles(self) -> dict[str, np.ndarray]:
        """How far (2,) springs, dampers, masses and their common scale reach below and above, of the two-mass foot.

        In the coordinates in which their intervals are symmetric; nothing where the optimum has not come to rest.
        """
        variables = self.problem.variables
        names = [name for name in variables.constants if name in EXCHANGED]
        masses = [(i, n) for i, n in variables.numbered if n.group == "masses"]
        masses = [(i, n) for i, n in masses if n.person is None and not self.problem.held[i]]
        if not (variables.two_mass and self.optimum.converged and np.isfinite(self.covariance).all()):
            return {}

        def coordinates(Q: np.ndarray) -> np.ndarray:
            values = variables.dynamic(Q)
            constants = (self._forth(name, values[name]) for name in names)
            return np.stack([*constants, self._scale(Q), *(Q[..., i] * item.std for i, item in masses)], -1)

        return self._reaches(coordinates, [*names, SCALE, *(item.name for _, item in masses)])

    def _reaches(self, function: Callable[[np.ndarray], np.ndarray], names: Sequence[str]) -> dict[str, np.ndarray]:
        """How far (2,) the profile of each coordinate of a function (..., k) reaches; none of what cannot vary."""
        std = self.spread(self.slopes(function))
        varies = np.flatnonzero(std)  # masses may be exact, and with them the scale
        coordinates = Coordinates(lambda Q: function(Q)[..., varies], function(self.q)[varies], std[varies])
        rise = self.quantile**2 * self.excess
        places = np.stack([self.q, *self.optimum.others])
        reaches = ends(self.problem, places, self.optimum.sign, coordinates, rise, self.quantile)
        return {names[int(i)]: reach for i, reach in zip(varies, reaches, strict=True)}

    def per_kilogram(self) -> list[tuple[str, float, float, float]]:
        """Name, value per kilogram of leg, and half-widths of the logarithm of constant and of constant per kilogram.

        Of the springs and dampers. Both half-widths are of profiles, or both of curvature: a profile ends at the
        mirror, and curvature does not, so one beside the other would say nothing of what the mass adds.
        """
        variables = self.problem.variables
        scaling = [item for item in variables.space.free if item.logarithmic and item.unit.startswith("N")]
        names = [item.name for item in scaling]
        if not names:  # bends alone are fitted, which have no kilogram in them
            return []

        def constants(Q: np.ndarray) -> np.ndarray:
            values = variables.dynamic(Q)
            return np.stack([np.log(values[name]) for name in names], -1)

        def per_kg(Q: np.ndarray) -> np.ndarray:
            return np.asarray(constants(Q) - self._scale(Q)[..., None])

        if all(name in self.profiles for name in names):
            reaches = self._reaches(per_kg, names)
            whole = [float(self.profiles[name].mean()) for name in names]
            bare = [float(reaches[name].mean()) for name in names]
        else:
            whole, bare = ((self.quantile * self.spread(self.slopes(of))).tolist() for of in (constants, per_kg))
        return list(zip(names, np.exp(per_kg(self.q)).tolist(), whole, bare, strict=True))

    def _scale(self, Q: np.ndarray) -> Any:
        """Logarithm (...,) of the mass m_S + m_F on the springs, a factor common to all constants, of Q (..., n).

        Under the smallest load, as the constants are reported.
        """
        variables = self.problem.variables
        weights, at = variables.masses(Q), int(np.argmin(variables.loads))
        return np.log(sum(weights[name][..., at] for name in variables.stated))

    def _estimate(self, name: str, x: float, std: float, reach: np.ndarray | None = None) -> Estimate:
        """An estimate from its coordinate, the standard error of that, and how far its profile reaches, if known."""
        item, variables = self._item(name), self.problem.variables
        place = variables._item[name]
        bounds = sorted(self._forth(name, e) for e in (variables.space.lower[place], variables.space.upper[place]))
        if name in variables._squared and variables.space.lower[place] <= 0:
            bounds[0] = 0.0
        at_bound = bool(min(x - bounds[0], bounds[1] - x) < _AT_BOUND * (bounds[1] - bounds[0]))
        below, above = (self.quantile * std if np.isfinite(std) else np.inf,) * 2 if reach is None else reach
        low, high = (self._back(name, float(np.clip(end, *bounds))) for end in (x - below, x + above))
        nearest = min(bounds, key=lambda end: abs(x - end))
        value = self._back(name, nearest if at_bound else float(np.clip(x, *bounds)))
        # what is called identified is so by curvature and profile
        half = (below + above) / (2 * self.quantile)
        width, widest = (
            s * value if item.logarithmic else (high - low) / (2 * self.quantile) for s in (half, max(std, half))
        )
        word = identifiability(value, widest, size_that_matters(item), at_bound)
        return Estimate(value, float(width), low, high, at_bound, word)

    def _at_rest(self) -> dict[str, Estimate]:
        """Springs and dampers without what relaxes, where that may be another number."""
        values = self.problem.variables.at_rest(self.q)
        relaxes = self.problem.variables.of_kind("relaxation time")
        if not values or relaxes is None or self.problem.held[relaxes]:
            return {}
        std = self.spread(self.slopes(lambda q: self._coordinates(q, at_rest=True)))
        return {
            name: self._estimate(name, self._forth(name, float(value)), s)
            for (name, value), s in zip(values.items(), std, strict=True)
        }

    def _nuisance(self, i: int, item: Nuisance) -> tuple[float, float, float, float]:
        """Value, standard error and 95 % limits, of the logarithm where the prior is of that."""
        x, std = float(self.q[i] * item.std), float(np.sqrt(self.covariance[i, i])) * item.std
        low, high = (float(np.clip(x + sign * self.quantile * std, item.lower, item.upper)) for sign in (-1, 1))
        return x, std, low, high

    def _delay(self, item: Nuisance, i: int, parameter: Parameter) -> Estimate:
        x, std, low, high = self._nuisance(i, item)
        at_bound = bool(min(x - item.lower, item.upper - x) < _AT_BOUND * (item.upper - item.lower))
        word = identifiability(x, std, size_that_matters(parameter), at_bound)
        if low <= 0 <= high and word != "not identifiable":
            word = "not distinguishable from zero"
        return Estimate(x, std, low, high, at_bound, word)

    def masses(self) -> tuple[Mass, ...]:
        """Each segment of each person: all recordings of one share it."""
        variables, masses = self.problem.variables, []
        data = list(variables.recordings)
        loaded = len({float(load) for load in variables.loads}) > 1
        for i, item in variables.numbered:
            if item.group != "masses":
                continue
            number = int(np.argmax(variables._acts(item)))
            for name in ("m_S", "m_T") if item.kind == "shank mass" else ("m_F",):
                if name not in variables.stated:
                    continue
                stated = float(variables.stated[name][number])
                x, std, _, _ = self._nuisance(i, item)
                below, above = self.profiles.get(item.name, np.full(2, self.quantile * std))
                low, high = (
                    stated * float(np.exp(np.clip(end, item.lower, item.upper))) for end in (x - below, x + above)
                )
                whose = name if item.person is None else f"{name} of {item.person or 'unnamed'}"
                learned = max(0.0, 1 - float(below + above) / (2 * self.quantile * item.std))
                weighed = loaded and learned > WEIGHED
                assumed = not stated_mass(data, item.person)
                value = stated * float(np.exp(x))
                masses.append(Mass(whose, stated, item.std, value, low, high, learned, weighed, assumed))
        return tuple(masses)

    def allowances(self) -> tuple[Allowance, ...]:
        """Every nuisance, with what was held possible and what the recordings say of it."""
        rows = []
        for i, item in self.problem.variables.numbered:
            x, std, low, high = self._nuisance(i, item)
            before = [float(np.clip(item.mean + sign * Z95 * item.std, item.lower, item.upper)) for sign in (-1, 1)]
            rows.append(
                Allowance(
                    item.name, item.group, item.does, item.unit, item.value(item.mean), item.value(before[0]),
                    item.value(before[1]), item.value(x), item.value(low), item.value(high), (x - item.mean) / item.std,
                    (x - item.mean) / max(std, 1e-300), item.source, item.kind, item.constant, item.sensor, item.person,
                )
            )  # fmt: skip
        return tuple(rows)

    def constant_under_load(self) -> float | None:
        """The sum of squares where no constant follows the load, to second order; None where there is one load."""
        v = self.problem.variables
        at = [i for i, item in v.numbered if item.group == "load"]
        if not at:
            return None
        x = self.q[at]
        return self.optimum.objective + float(x @ np.linalg.solve(self.covariance[np.ix_(at, at)], x))

    def exponents(self) -> Mapping[str, tuple[float, float, float]]:
        """The power of the weight on the pad that each constant follows, with its 95 % interval."""
        v = self.problem.variables
        leg = sum(float(kg[0]) for kg in v.stated.values())
        first = float(v.loads.min())
        powers: dict[str, tuple[float, float, float]] = {}
        for name in v.constants:
            items = [(i, n) for i, n in v.numbered if n.group == "load" and n.constant == name]
            if not items or leg <= 0:
                continue
            at = [i for i, _ in items]
            size = np.array([n.std for _, n in items])
            x = np.log((leg + np.array([n.load_kg for _, n in items])) / (leg + first))
            weights = np.linalg.solve(self.covariance[np.ix_(at, at)] * np.outer(size, size), x)
            power, std = float(weights @ (self.q[at] * size) / (weights @ x)), float(1 / np.sqrt(weights @ x))
            powers[name] = (power, power - self.quantile * std, power + self.quantile * std)
        return powers

    def scale_std(self) -> float:
        """Standard error of the logarithm of the common scale; of the middle of its profile where that is known."""
        v = self.problem.variables
        if not any(item.group in ("masses", "share") for item in v.nuisances):
            return 0.0
        if SCALE in self.profiles:
            return float(self.profiles[SCALE].mean() / self.quantile)
        return float(self.spread(self.slopes(lambda q: self._scale(q)[None]))[0])


def size_that_matters(item: Parameter) -> float:
    """A value that matters of a parameter that may be zero: a tenth of the way to its bound."""
    return 0.0 if item.logarithmic else 0.1 * max(abs(item.lower), abs(item.upper))
