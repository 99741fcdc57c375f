"""Profile likelihood: how far a constant can go before the best fit that is left is too unlikely.

A standard error takes the sum of squares for a parabola. An end of the profile is where a constant is as large, or as
small, as the sum of squares allows: Venzon and Moolgavkar (1988) step there without a fit at each place between, here
by the same damped Gauss-Newton steps between bounds as every other descent. The sum of squares may have several
valleys: steps begin at every end of the search that is as likely, and the farthest place counts.
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
    places: np.ndarray,
    sign: int,
    coordinates: Coordinates,
    rise: float,
    quantile: float,
) -> np.ndarray:
    """How far (k, 2) below and above its value each coordinate reaches.

    Args:
        problem: with its weights.
        places: (m, n) ends of the search on this side, the optimum first.
        sign: side of the mirror.
        coordinates: k of them.
        rise: of the sum of squares at an end.
        quantile: standard errors to an end by the curvature. Where no end is reached it is returned, or how far the
            sum of squares is known to allow, if that is farther.
    """
    c, n = coordinates, places.shape[1]
    at_places = problem.evaluate(places)
    limit = float(at_places.objective[0]) + rise
    begin, pins, ways = _beginnings(at_places.objective < limit, c.of(places) - c.values)
    low, high = (np.tile(bound, (pins.size, 1)) for bound in problem.bounds(sign))
    Q, now = places[begin], at_places.rows(begin)
    reach, before = np.where(begin == 0, quantile * c.std[pins], 0.0), np.full(pins.size, -np.inf)
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
    farthest = np.zeros((c.std.size, 2))
    np.maximum.at(farthest, (pins, (ways > 0).astype(int)), reach)
    return farthest


def _beginnings(likely: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where steps begin: at the optimum, and where the sum of squares allows it and a coordinate is farther already.

    Args:
        likely: (m,) whether the sum of squares allows each end of the search, the optimum first.
        distance: (m, k) of their coordinates from those of the optimum.

    Returns:
        of each beginning the place (b,), the coordinate (b,) and the way (b,), -1 or 1.
    """
    ways = np.array([-1.0, 1.0])
    begins = (distance[..., None] * ways > 0) & likely[:, None, None]
    begins[0] = True
    begin, pins, way = np.nonzero(begins)
    return begin, pins, ways[way]
