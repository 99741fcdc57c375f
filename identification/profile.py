"""Profile likelihood: how far a constant can go before the best fit that is left is too unlikely.

A standard error takes the sum of squares for a parabola. An end of the profile is where a constant is as large, or as
small, as the sum of squares allows: Venzon and Moolgavkar (1988) step there without a fit at each place between, here
by the same damped Gauss-Newton steps between bounds as every other descent.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.optimiser import LEAST_DAMPING, MOST_DAMPING, bent, bounded_step, damped
from identification.residual import Problem

#: Steps towards an end at most.
_STEPS = 60
#: Share of the way to an end, and of the rise of the sum of squares, that is worth no further step.
_NEAR, _CLOSE = 0.01, 0.05
#: First damping of a step.
_DAMPING = 1e-4
#: How far the sum of squares may be from what the quadratic foretold, as a share of its change or of its rise.
_WRONG = 0.75


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Constants as their intervals are symmetric.

    Attributes:
        of: (C, n) search variables -> (C, k) values.
        values: (k,) at the optimum.
        std: (k,) standard errors.
    """

    of: Callable[[np.ndarray], np.ndarray]
    values: np.ndarray
    std: np.ndarray


def ends(
    problem: Problem,
    q: np.ndarray,
    sign: int,
    coordinates: Coordinates,
    rise: float,
    quantile: float,
) -> np.ndarray:
    """How far (k, 2) below and above its value each coordinate reaches.

    Args:
        problem: with its weights.
        q: (n,) the optimum.
        sign: side of the mirror.
        coordinates: k of them.
        rise: of the sum of squares at an end.
        quantile: standard errors to an end by the curvature. Where no end is reached it is returned, or how far the
            sum of squares is known to allow, if that is farther.
    """
    c, n = coordinates, q.size
    pins, ways = np.repeat(np.arange(c.std.size), 2), np.tile([-1.0, 1.0], c.std.size)
    low, high = (np.tile(limit, (pins.size, 1)) for limit in problem.bounds(sign))
    Q = np.tile(q, (pins.size, 1))
    now = problem.evaluate(Q)
    limit = float(now.objective[0]) + rise
    reach, before = quantile * c.std[pins], np.full(pins.size, -np.inf)
    at, damping, factor = np.arange(pins.size), np.full(pins.size, _DAMPING), np.full(pins.size, 2.0)
    bend = np.zeros((pins.size, n, n))
    for _ in range(_STEPS):
        A, g = now.normal
        A = A + bend[at]
        rows = np.arange(at.size), pins[at]
        along = ways[at, None] * problem.variables.slopes(c.of, Q[at], np.arange(n))[rows]
        along[:, problem.held] = 0.0
        room = limit - now.objective
        way = ways[at] * (c.of(Q[at])[rows] - c.values[pins[at]])
        reach[at] = np.where(room > 0, np.maximum(reach[at], way), reach[at])
        place = A, g, Q[at], low[at], high[at]
        further = bounded_step(*place, np.full(at.size, LEAST_DAMPING), along, room)[0] - Q[at]
        end = way + np.einsum("cn,cn->c", along, further)
        rests = (np.abs(end - way) < _NEAR * way) & (np.abs(room) < _CLOSE * rise)
        again = rests & (np.abs(end - before[at]) > 2 * _NEAR * way)
        before[at[again]], bend[at[again]] = end[again], 0.0  # what the secant holds back would rest too early
        arrived = rests & ~again
        reach[at[arrived]] = end[arrived]
        go = ~arrived & (damping < MOST_DAMPING)
        if not go.any():
            break
        at, damping, factor, now = at[go], damping[go], factor[go], now.rows(go)
        place = A[go], g[go], Q[at], low[at], high[at]
        trial, falls = bounded_step(*place, damping, along[go], room[go])
        after = problem.evaluate(trial, now)
        wrong = np.abs(now.objective - falls - after.objective) / np.maximum(rise, np.abs(falls))
        good = after.moves & (wrong < _WRONG)
        damping, factor = damped(damping, factor, good, 1 - wrong)
        bend[at[good]] = bent(bend[at], trial - Q[at], now.jacobian, after)[good]
        Q[at[good]] = trial[good]
        now = now.replaced(after, good)
    return reach.reshape(-1, 2)
