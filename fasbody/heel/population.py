"""The population behind persons, speeds and strikes: a hierarchical model in closed form.

The logarithms of a law's parameters of person i at speed s are mu_s + u_i + w_is. People differ by
u_i, one person's speeds by w_is; the strikes of one person and speed give the estimate and its
covariance (estimate.py). That likelihood is taken as Gaussian (Laplace's approximation), so u, w
and mu integrate out exactly, and the covariances of u and w are found by restricted maximum
likelihood, or sampled by importance. Intervals have Student's t with the number of persons less
one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.heel.estimate import LEVEL
from fasbody.presentation import Tabled

Array = np.ndarray
#: Fewest persons that make a population.
FEWEST = 4
#: Smallest and largest standard deviation of a logarithm, in parts of its scatter.
_RANGE = (1e-3, 5.0)
#: Variance of a correlation's slope under the prior, nearly flat; with few people a correlation of one is avoided.
_SLOPE_VARIANCE = 4.0
#: Samples: standard deviations of a logarithm are one half, times or divided by e, beforehand.
_SCATTER = np.log(0.5)
#: Rounds of draws by importance, draws of each, their degrees of freedom, and their seed.
ROUNDS, DRAWS, HEAVY, SEED = 8, 10000, 5, 0


@dataclass(frozen=True, eq=False)
class Observed:
    """An estimate of one person at one speed: logarithms (p,) and their covariance (p, p)."""

    person: str
    speed: str
    log: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Population(Tabled):
    """A population of laws.

    Attributes:
        names: of the parameters.
        speeds: in order.
        mu: mean logarithms, (speeds, p).
        covariance: of mu, (speeds p, speeds p).
        between: covariance between persons, (p, p).
        within: covariance between the speeds of one person, beyond the common difference, (p, p).
        persons: how many.
        converged: whether the search ended at a minimum.
        inside: share of persons whose estimates lie in the 95 % region predicted from the others.
    """

    names: tuple[str, ...]
    speeds: tuple[str, ...]
    mu: Array
    covariance: Array
    between: Array
    within: Array
    persons: int
    converged: bool
    inside: float | None

    def interval(self, speed: str, name: str, new_person: bool = False) -> tuple[float, float, float]:
        """Median of the population and its 95 % interval, in the parameter's unit.

        Args:
            speed: of `speeds`.
            name: of `names`.
            new_person: the interval is that in which a new person's parameter lies.
        """
        from scipy.stats import t as student

        s, i = self.speeds.index(speed), self.names.index(name)
        k = s * len(self.names) + i
        variance = self.covariance[k, k] + new_person * (self.between[i, i] + self.within[i, i])
        width = student.ppf(0.5 + 0.5 * LEVEL, self.persons - 1) * np.sqrt(variance)
        low, high = (float(np.exp(self.mu[s, i] + side * width)) for side in (-1, 1))
        return float(np.exp(self.mu[s, i])), low, high

    def rows(self) -> list[dict[str, Any]]:
        """One a speed and parameter: median, its interval, and where a new person lies."""
        keys = ("median", "lower", "upper", "new_person_lower", "new_person_upper")
        return [
            {"speed": speed, "parameter": name}
            | dict(zip(keys, (*self.interval(speed, name), *self.interval(speed, name, True)[1:]), strict=True))
            for speed in self.speeds
            for name in self.names
        ]

    def draws(self, speed: str, count: int = 2000, seed: int = 0) -> Array:
        """Parameters (count, p) of new persons."""
        p, s = len(self.names), self.speeds.index(speed)
        part = slice(s * p, (s + 1) * p)
        rng = np.random.default_rng(seed)
        variance = self.covariance[part, part] + self.between + self.within
        root = np.linalg.cholesky(variance + 1e-12 * np.eye(p))
        heavy = np.sqrt((self.persons - 1) / rng.chisquare(self.persons - 1, (count, 1)))
        return np.exp(self.mu[s] + heavy * rng.standard_normal((count, p)) @ root.T)


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Estimates and their model, in parts of each parameter's scatter.

    The unknowns q of the covariances, between persons and, where a person has several speeds,
    within, are each p logarithms of standard deviations, and the slopes of the Cholesky factor.

    Attributes:
        observed: one a person and speed.
        speeds: in order.
        scale: of each logarithm, (p,).
    """

    observed: Sequence[Observed]
    speeds: tuple[str, ...]
    scale: Array

    @classmethod
    def of(cls, observed: Sequence[Observed]) -> "Hierarchy":
        """Whiten estimates."""
        scale = np.std([item.log for item in observed], axis=0) + 1e-9
        whitened = [replace(i, log=i.log / scale, covariance=i.covariance / np.outer(scale, scale)) for i in observed]
        return cls(whitened, tuple(dict.fromkeys(item.speed for item in observed)), scale)

    @cached_property
    def people(self) -> dict[str, list[Observed]]:
        """Estimates by person."""
        names = sorted({item.person for item in self.observed})
        return {name: [item for item in self.observed if item.person == name] for name in names}

    @property
    def several(self) -> bool:
        """Whether a person has several speeds."""
        return len(self.observed) > len(self.people)

    @property
    def unknowns(self) -> int:
        """How many unknowns one covariance has."""
        return self.scale.size * (self.scale.size + 1) // 2

    def covariances(self, q: Array) -> tuple[Array, Array]:
        """Covariances (..., p, p) between and within persons, of unknowns (..., n)."""
        p = self.scale.size
        row, column = np.tril_indices(p, -1)
        parts = q.reshape(*q.shape[:-1], -1, self.unknowns)
        std = np.exp(parts[..., :p])
        roots = std[..., None] * np.eye(p)
        roots[..., row, column] = parts[..., p:] * std[..., row]
        V = roots @ roots.swapaxes(-1, -2)
        return V[..., 0, :, :], V[..., 1, :, :] if self.several else np.zeros_like(V[..., 0, :, :])

    def means(self, between: Array, within: Array) -> tuple[Array, Array, Array]:
        """Generalised least squares, for covariances (..., p, p).

        Returns:
            Means (..., speeds p), their covariance, and -2 log of the restricted likelihood (...).
        """
        p, many = self.scale.size, between.shape[:-2]
        size = p * len(self.speeds)
        information, right = np.zeros((*many, size, size)), np.zeros((*many, size, 1))
        total = np.zeros(many)
        for items in self.people.values():
            n = len(items)
            V = np.zeros((*many, n, p, n, p)) + between[..., None, :, None, :]
            for k, item in enumerate(items):
                V[..., k, :, k, :] += within + item.covariance
            firsts = p * np.array([self.speeds.index(item.speed) for item in items])
            place = (firsts[:, None] + np.arange(p)).ravel()
            root = np.linalg.cholesky(V.reshape(*many, n * p, n * p))
            y = np.concatenate([item.log for item in items])
            white = np.linalg.solve(root, np.column_stack([np.eye(n * p), y]))
            X, Y = white[..., :-1], white[..., -1:]
            total += 2 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(-1) + (Y**2).sum((-2, -1))
            information[..., place[:, None], place] += X.swapaxes(-1, -2) @ X
            right[..., place, :] += X.swapaxes(-1, -2) @ Y
        covariance = np.linalg.inv(information)
        mean = covariance @ right
        total += np.linalg.slogdet(information)[1] - (right * mean).sum((-2, -1))
        return mean[..., 0], covariance, total

    def slopes_prior(self, q: Array) -> Array:
        """-2 log of the slopes' prior density (...)."""
        slopes = q.reshape(*q.shape[:-1], -1, self.unknowns)[..., self.scale.size :]
        return (slopes**2).sum((-2, -1)) / _SLOPE_VARIANCE

    def prior(self, q: Array) -> Array:
        """-2 log of the prior density of the covariances (...)."""
        scatter = q.reshape(*q.shape[:-1], -1, self.unknowns)[..., : self.scale.size]
        return self.slopes_prior(q) + ((scatter - _SCATTER) ** 2).sum((-2, -1))

    def deviance(self, q: Array) -> float:
        """-2 log of the restricted likelihood and of the slopes' prior."""
        return float(self.means(*self.covariances(q))[2] + self.slopes_prior(q))

    def minimum(self) -> tuple[Array, bool]:
        """Where `deviance` is least, and whether the search came to rest."""
        from scipy.optimize import minimize

        p, slopes = self.scale.size, self.unknowns - self.scale.size
        stds = (0.7, 0.4)[: 1 + self.several]
        start = np.concatenate([np.r_[np.full(p, np.log(std)), np.zeros(slopes)] for std in stds])
        limits = ([tuple(np.log(_RANGE))] * p + [(-5.0, 5.0)] * slopes) * len(stds)
        end = minimize(self.deviance, start, method="L-BFGS-B", bounds=limits)
        return end.x, bool(end.success)


def estimate(names: Sequence[str], observed: Sequence[Observed]) -> Population:
    """The population of some estimates.

    Args:
        names: of the parameters.
        observed: one a person and speed.

    Raises:
        RecordingError: fewer than four persons.
    """
    people = {item.person for item in observed}
    if len(people) < FEWEST:
        raise RecordingError(f"{len(people)} persons make no population; at least {FEWEST} are needed.")
    model = Hierarchy.of(observed)
    q, converged = model.minimum()
    between, within = model.covariances(q)
    mu, covariance, _ = model.means(between, within)
    area, stretch = np.outer(model.scale, model.scale), np.tile(model.scale, len(model.speeds))
    return Population(
        tuple(names), model.speeds, (mu * stretch).reshape(-1, len(names)),
        covariance * np.outer(stretch, stretch), between * area, within * area, len(people),
        converged, _inside(model, between, within),
    )  # fmt: skip


def _inside(model: Hierarchy, between: Array, within: Array) -> float | None:
    """Share of persons and speeds inside the 95 % region that the others predict for a new person.

    The means are estimated anew without the person, the covariances are not: that would take a
    search for each.
    """
    from scipy.stats import f as fisher

    p, hits = model.scale.size, []
    for name, items in model.people.items():
        others = [item for item in model.observed if item.person != name]
        speeds = tuple(s for s in model.speeds if s in {other.speed for other in others})
        mu, covariance, _ = replace(model, observed=others, speeds=speeds).means(between, within)
        for item in items:
            if item.speed not in speeds:
                continue
            part = slice(speeds.index(item.speed) * p, (speeds.index(item.speed) + 1) * p)
            variance = covariance[part, part] + between + within + item.covariance
            apart = item.log - mu[part]
            limit = fisher.ppf(LEVEL, p, len(model.people) - 2)
            hits.append(float(apart @ np.linalg.solve(variance, apart)) / p < limit)
    return float(np.mean(hits)) if hits else None


def sampled(names: Sequence[str], observed: Sequence[Observed]) -> dict[str, Any]:
    """The means with the covariances uncertain too, by importance sampling, as plain data.

    Unknowns of the covariances are drawn from Student's t, whose mean and covariance are those of
    the round before, and weighed; given them the means are Gaussian.

    Args:
        names: of the parameters.
        observed: one a person and speed.
    """
    model, rng = Hierarchy.of(observed), np.random.default_rng(SEED)
    middle = model.minimum()[0]
    spread = 0.3 * np.eye(middle.size)
    for _ in range(ROUNDS):
        z = rng.standard_normal((DRAWS, middle.size))
        z /= np.sqrt(rng.chisquare(HEAVY, (DRAWS, 1)) / HEAVY)
        Q = middle + z @ np.linalg.cholesky(spread).T
        mean, covariance, deviance = model.means(*model.covariances(Q))
        proposed = -0.5 * (HEAVY + middle.size) * np.log1p((z**2).sum(axis=1) / HEAVY)
        log_weight = -0.5 * (deviance + model.prior(Q)) - proposed
        weight = np.exp(log_weight - log_weight.max())
        smooth = np.minimum(weight, np.sort(weight)[-DRAWS // 50])
        middle, spread = (
            np.average(Q, axis=0, weights=smooth),
            np.atleast_2d(np.cov(Q.T, aweights=smooth)),
        )
    rows = rng.choice(DRAWS, DRAWS, p=weight / weight.sum())
    z = rng.standard_normal((DRAWS, mean.shape[1], 1))
    mu = mean[rows] + (np.linalg.cholesky(covariance[rows]) @ z)[..., 0]
    mu = np.reshape(mu, (-1, len(model.speeds), len(names))) * model.scale
    table = []
    for s, speed in enumerate(model.speeds):
        for i, name in enumerate(names):
            low, middle, high = np.exp(np.percentile(mu[:, s, i], [2.5, 50, 97.5]))
            table.append({"speed": speed, "parameter": name, "median": middle, "lower": low, "upper": high})
    effective = float(weight.sum() ** 2 / (weight**2).sum())
    return {"method": "importance", "draws": DRAWS, "effective": effective, "parameters": table}


def of_documents(law_document: Mapping[str, Any]) -> tuple[list[Observed], int]:
    """The estimates of a law's document that rest on no bound, and how many do."""
    kept = [
        Observed(item["subject"], item["speed"], np.log(item["theta"]), np.asarray(item["covariance"]))
        for item in law_document["persons"]
        if not any(parameter["bound"] for parameter in item["parameters"].values())
    ]
    return kept, len(law_document["persons"]) - len(kept)
