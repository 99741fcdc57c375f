"""Which order of the curves the data support: AIC and BIC of every order, on the model linearised about a fit.

About a fit, each recording says r_i + G_i (q - q_i) of its foot's search variable q. For any other order the curves'
coefficients, the scatter and the likelihood then follow from linear algebra alone, in milliseconds; the chosen order is
fitted in full afterwards, and the choice repeated there.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import product
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError, unknown
from identification.study.curves import CurveSpace, Order
from identification.study.scatter import LEAST, MOST, TrendProblem

#: More knots than these follow no trend but the scatter.
_KNOTS, _LOAD, _MIXED = 5, 2, 2
_PASSES = 20
#: A recording's fundamental is two numbers, of which the coefficients may use up this share: with more, the criteria,
#: which count on many data, cannot be trusted, and the scatter is fitted away.
_SHARE = 0.5


def orders_for(space: CurveSpace) -> list[Order]:
    """Orders worth comparing for the frequencies and loads there are; each curve keeps a spare frequency."""
    frequencies, loads = len(set(space.frequencies_hz.round(2))), len(set(space.loads_kg))
    knots = range(1, max(2, min(_KNOTS, frequencies - 1) + 1))
    found = [Order(k, 0, 1) for k in knots]
    found += [
        Order(k, p, m)
        for k, p, m in product(knots, range(1, min(_LOAD, loads - 1) + 1), range(1, _MIXED + 1))
        if m <= k
    ]
    most = _SHARE * 2 * space.frequencies_hz.size / len(space.places)
    return [order for order in found if order.count <= max(2, most)]


def choose(problem: TrendProblem, z: np.ndarray, criterion: str) -> tuple[Order, list[dict[str, Any]]]:
    """The order with the least criterion, and what each order reached.

    Args:
        problem: weighted at its solution z. criterion: "aic" or "bic".
    """
    if criterion not in ("aic", "bic"):
        raise SettingError(f"{unknown('criterion', criterion, ('aic', 'bic'))}.")
    space = problem.curves
    q = [B @ z for B in space.weights]
    feet = zip(problem.by_foot(z), problem.shared_errors(), q, strict=True)
    local = [(r - G @ at, G, V) for (r, G), V, at in feet]
    harmonics = sum(r.size for r, *_ in local)
    rows = []
    for order in orders_for(space):
        other = replace(space, order=order, scatter=False)
        deviance, tau = linear_deviance(local, other, problem.tau if space.scatter else None)
        count = other.size + (tau.size if space.scatter else 0)
        rows.append({
            **asdict(order), "coefficients": other.size, "deviance": deviance, "aic": deviance + 2 * count,
            "bic": deviance + float(np.log(harmonics)) * count,
        })  # fmt: skip
    rows.sort(key=lambda row: float(row[criterion]))
    return Order(*(int(rows[0][n]) for n in ("knots", "load", "mixed"))), rows


def linear_deviance(
    local: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], space: CurveSpace, tau: np.ndarray | None
) -> tuple[float, np.ndarray]:
    """-2 log likelihood of the linearised model at its best, up to the noise's constant, and the scatter there.

    Args:
        local: (r, G, V) of each recording: r + G q + V e is its residual over its noise, e the unit errors that all
            recordings share (`PeriodicProblem.shared_errors`). space: the curves, without offsets.
        tau: scatter to begin with, None for no scatter. It is learnt by MacKay's rule, as in `TrendProblem.learn`.
    """
    places, errors = space.places, local[0][2].shape[1]
    prior = np.diag([1e-9] * space.size + [1.0] * errors)
    new = start = np.zeros(0) if tau is None else tau
    for _ in range(_PASSES):
        start = new
        A, b = prior.copy(), np.zeros(space.size + errors)
        whitened = []
        total = 0.0
        for (r, G, V), B in zip(local, space.weights, strict=True):
            U = G[:, places[: start.size]] * start
            L = np.linalg.cholesky(np.eye(r.size) + U @ U.T)
            X, y = np.linalg.solve(L, np.hstack([G @ B, V])), np.linalg.solve(L, r)
            whitened.append((X, y, np.linalg.solve(L, U)))
            A += X.T @ X
            b -= X.T @ y
            total += 2 * float(np.log(np.diag(L)).sum())
        C = np.linalg.inv(A)
        beta = C @ b
        total += sum(float(np.sum((y + X @ beta) ** 2)) for X, y, _ in whitened)
        shared = slice(space.size, None)  # integrated out
        total += float(beta[shared] @ beta[shared]) + float(np.linalg.slogdet(A[shared, shared])[1])
        if tau is None:
            return total, start
        effective, squares = np.zeros(start.size), np.zeros(start.size)
        for X, y, V in whitened:  # u = -V' e in units of tau, its variance 1 - V' V + V' X C X' V
            e, left = y + X @ beta, V.T @ X
            squares += (V.T @ e) ** 2
            effective += np.sum(V**2, axis=0) - np.einsum("kn,nm,km->k", left, C, left)
        new = np.clip(start * np.sqrt(squares / np.maximum(effective, 1e-3 * len(local))), LEAST, MOST)
        if np.abs(np.log(new / start)).max() < 0.02:
            break
    return total, start
