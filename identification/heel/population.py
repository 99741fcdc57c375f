"""The population behind persons, speeds and strikes: a hierarchical model in closed form.

The logarithms of a law's parameters of person i at speed s are mu_s + u_i + w_is. People differ by u_i, one person's
speeds by w_is; the strikes of one person and speed give the estimate and its covariance (estimate.py). That likelihood
is taken as Gaussian (Laplace's approximation), so u and w integrate out exactly, and their covariances are found by
restricted maximum likelihood. Intervals have Student's t with the number of persons less one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.presentation import Tabled

Array = np.ndarray
#: Fewest persons that make a population.
FEWEST = 4
#: Smallest and largest standard deviation of a logarithm, in parts of its scatter.
_RANGE = (1e-3, 5.0)
LEVEL = 0.95


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
        names: of the parameters. speeds: in order. mu: (speeds, p) mean logarithms. covariance: (speeds p, speeds p)
        of mu.
        between: (p, p) covariance between persons. within: (p, p) between the speeds of one person, beyond the common
        difference. persons: how many. converged: whether the search ended at a minimum. inside: share of persons whose
        estimates lie in the 95 % region predicted from the others.
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

    def interval(self, speed: str, name: str) -> tuple[float, float, float]:
        """Median of the population and its 95 % interval, in the parameter's unit."""
        s, i = self.speeds.index(speed), self.names.index(name)
        k = s * len(self.names) + i
        return _spread(float(self.mu[s, i]), float(np.sqrt(self.covariance[k, k])), self.persons)

    def predictive(self, speed: str, name: str) -> tuple[float, float]:
        """Where a new person's parameter lies with 95 %, in its unit."""
        s, i = self.speeds.index(speed), self.names.index(name)
        k = s * len(self.names) + i
        std = float(np.sqrt(self.covariance[k, k] + self.between[i, i] + self.within[i, i]))
        return _spread(float(self.mu[s, i]), std, self.persons)[1:]

    def draws(self, speed: str, count: int = 2000, seed: int = 0) -> Array:
        """Parameters (count, p) of new persons."""
        p = len(self.names)
        part = slice(self.speeds.index(speed) * p, (self.speeds.index(speed) + 1) * p)
        rng = np.random.default_rng(seed)
        root = np.linalg.cholesky(self.covariance[part, part] + self.between + self.within + 1e-12 * np.eye(p))
        heavy = np.sqrt((self.persons - 1) / rng.chisquare(self.persons - 1, (count, 1)))
        return np.exp(self.mu[self.speeds.index(speed)] + heavy * rng.standard_normal((count, p)) @ root.T)


def _spread(mean: float, std: float, persons: int) -> tuple[float, float, float]:
    from scipy.stats import t as student

    width = float(student.ppf(0.5 + 0.5 * LEVEL, persons - 1)) * std
    return float(np.exp(mean)), float(np.exp(mean - width)), float(np.exp(mean + width))


def estimate(names: Sequence[str], observed: Sequence[Observed]) -> Population:
    """The population of some estimates.

    Args:
        names: of the parameters. observed: one a person and speed.

    Raises:
        RecordingError: fewer than four persons.
    """
    people = sorted({item.person for item in observed})
    if len(people) < FEWEST:
        raise RecordingError(f"{len(people)} persons make no population; at least {FEWEST} are needed.")
    speeds = tuple(dict.fromkeys(item.speed for item in observed))
    level = np.std([item.log for item in observed], axis=0) + 1e-9  # whitens the search
    scaled = [Observed(i.person, i.speed, i.log / level, i.covariance / np.outer(level, level)) for i in observed]
    between, within, converged = _search(scaled, speeds)
    mu, covariance = _mean(scaled, speeds, between, within)
    p = len(names)
    stretch = np.tile(level, len(speeds))
    found = Population(
        tuple(names), speeds, (mu * stretch).reshape(len(speeds), p), covariance * np.outer(stretch, stretch),
        between * np.outer(level, level), within * np.outer(level, level), len(people), converged, None,
    )  # fmt: skip
    return Population(*(vars(found) | {"inside": _inside(found, observed, people)}).values())


def _inside(found: Population, observed: Sequence[Observed], people: Sequence[str]) -> float | None:
    """Share of persons and speeds inside the 95 % region that the others predict for somebody new.

    The means are found anew without the person, the covariances are not: that would take a search for each.
    """
    from scipy.stats import f as fisher

    p, hits = len(found.names), []
    for name in people:
        others = [item for item in observed if item.person != name]
        own = [item for item in observed if item.person == name and item.speed in {other.speed for other in others}]
        speeds = [speed for speed in found.speeds if speed in {other.speed for other in others}]
        mu, covariance = _mean(others, speeds, found.between, found.within)
        for item in own:
            part = slice(speeds.index(item.speed) * p, (speeds.index(item.speed) + 1) * p)
            spread = covariance[part, part] + found.between + found.within + item.covariance
            apart = item.log - mu[part]
            hits.append(float(apart @ np.linalg.solve(spread, apart)) / p < fisher.ppf(LEVEL, p, len(people) - 2))
    return float(np.mean(hits)) if hits else None


def _blocks(
    observed: Sequence[Observed], speeds: Sequence[str], between: Array, within: Array
) -> list[tuple[Array, Array, Array]]:
    """Design, covariance and data of each person."""
    p, out = between.shape[0], []
    for name in sorted({item.person for item in observed}):
        own = [item for item in observed if item.person == name]
        n = len(own)
        X = np.zeros((n * p, len(speeds) * p))
        V = np.kron(np.ones((n, n)), between)
        for k, item in enumerate(own):
            s = speeds.index(item.speed)
            part = slice(k * p, (k + 1) * p)
            X[part, s * p : (s + 1) * p] = np.eye(p)
            V[part, part] += within + item.covariance
        out.append((X, V, np.concatenate([item.log for item in own])))
    return out


def _mean(observed: Sequence[Observed], speeds: Sequence[str], between: Array, within: Array) -> tuple[Array, Array]:
    """Generalised least squares: means (speeds p,) and their covariance."""
    blocks = _blocks(observed, speeds, between, within)
    information = sum(X.T @ np.linalg.solve(V, X) for X, V, _ in blocks)
    covariance = np.linalg.inv(information)
    return covariance @ sum(X.T @ np.linalg.solve(V, y) for X, V, y in blocks), covariance


def _search(observed: Sequence[Observed], speeds: Sequence[str]) -> tuple[Array, Array, bool]:
    """Covariances between and within persons by restricted maximum likelihood."""
    from scipy.optimize import minimize

    p = observed[0].log.size
    several = len(observed) > len({item.person for item in observed})
    lower = np.tril_indices(p, -1)
    count = p + lower[0].size

    def covariance(q: Array) -> Array:
        root = np.diag(np.exp(q[:p]))
        root[lower] = q[p:] * np.exp(q[:p])[lower[0]]
        return root @ root.T

    def cost(q: Array) -> float:
        B = covariance(q[:count])
        W = covariance(q[count:]) if several else np.zeros((p, p))
        blocks = _blocks(observed, speeds, B, W)
        total, information, right = 0.0, np.zeros((len(speeds) * p,) * 2), np.zeros(len(speeds) * p)
        for X, V, y in blocks:
            root = np.linalg.cholesky(V)
            white_X, white_y = np.linalg.solve(root, X), np.linalg.solve(root, y)
            total += 2 * np.log(np.diag(root)).sum() + white_y @ white_y
            information += white_X.T @ white_X
            right += white_X.T @ white_y
        # a nearly flat belief in correlations near zero keeps few people from making them one
        return float(
            total + np.linalg.slogdet(information)[1] - right @ np.linalg.solve(information, right)
            + sum((part[p:] ** 2).sum() / 4.0 for part in (q[:count], q[count:]))
        )  # fmt: skip

    start = np.concatenate([np.full(p, np.log(0.7)), np.zeros(count - p)])
    if several:
        start = np.concatenate([start, np.full(p, np.log(0.4)), np.zeros(count - p)])
    limits = ([tuple(np.log(_RANGE))] * p + [(-5.0, 5.0)] * (count - p)) * (2 if several else 1)
    found = minimize(cost, start, method="L-BFGS-B", bounds=limits)
    within = covariance(found.x[count:]) if several else np.zeros((p, p))
    return covariance(found.x[:count]), within, bool(found.success)


def of_documents(law_document: Mapping[str, Any]) -> tuple[list[Observed], int]:
    """The estimates of a law's document that rest on no bound, and how many were left out for that."""
    kept = [
        Observed(item["subject"], item["speed"], np.log(item["theta"]), np.asarray(item["covariance"], float))
        for item in law_document["persons"]
        if not any(found["bound"] for found in item["parameters"].values())
    ]
    return kept, len(law_document["persons"]) - len(kept)
