"""Profile likelihood: how far a constant can go before the best fit that is left is too unlikely.

A standard error takes the sum of squares for a parabola. Here a constant is held at the end that a parabola would have,
and everything else is fitted anew; where the sum of squares has not risen by what it should, the end is moved until it
has.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.optimiser import descend
from identification.residual import Evaluation, Problem

#: Steps of the fits at which an end is sought: short ones, then long ones for what a flat valley hides.
_STEPS = (*[20] * 10, *[100] * 6)
#: How near the rise must come to what is sought.
_NEAR = 0.1
#: Decrease of the sum of squares that is worth no further step.
_PROMISED = 0.05
#: Standard errors over the tolerance with which a constant is held, and how far off [standard errors] a fit may leave
#: it: farther, and bounds are in the way.
_STIFF, _HELD = 30.0, 0.1


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Constants as their intervals are symmetric.

    Attributes:
        of: (C, n) search variables -> (C, k) values.
        values: (k,) at the optimum.
        slopes: (k, n) derivatives there.
        std: (k,) standard errors.
    """

    of: Callable[[np.ndarray], np.ndarray]
    values: np.ndarray
    slopes: np.ndarray
    std: np.ndarray


@dataclass(frozen=True, eq=False)
class _Pinned:
    """A problem with one row more, which holds a coordinate of a candidate at a place.

    Which one, and where, says the last variable of a candidate, the number of its pin: pins 2 i and 2 i + 1 hold
    coordinate i.
    """

    problem: Problem
    sign: int
    coordinates: Coordinates
    places: np.ndarray

    def bounds(self, pin: int) -> tuple[np.ndarray, np.ndarray]:
        low, high = self.problem.bounds(self.sign)
        return np.append(low, pin), np.append(high, pin)

    def evaluate(self, Q: np.ndarray, near: Evaluation | None = None) -> Evaluation:
        pins, Q = Q[:, -1].astype(int), Q[:, :-1]
        C, n = Q.shape
        now, c, pinned = self.problem.evaluate(Q, near), self.coordinates, (np.arange(C), pins // 2)
        stiff = _STIFF / c.std[pins // 2]
        row = stiff * (c.of(Q)[pinned] - self.places[pins])
        slopes = np.zeros((C, 1, n + 1))
        slopes[:, 0, :n] = stiff[:, None] * self.problem.variables.slopes(c.of, Q, np.arange(n))[pinned]
        slopes[:, 0, :n][:, self.problem.held] = 0.0
        J = np.concatenate([now.jacobian, np.zeros((*now.jacobian.shape[:2], 1))], 2)
        r = np.concatenate([now.residual, row[:, None]], 1)
        return Evaluation(r, np.concatenate([J, slopes], 1), now.moves, now.memory)


def ends(
    problem: Problem,
    q: np.ndarray,
    sign: int,
    covariance: np.ndarray,
    coordinates: Coordinates,
    rise: float,
    quantile: float,
) -> np.ndarray:
    """How far (k, 2) below and above its value each coordinate reaches.

    Args:
        problem: with its weights.
        q: (n,) the optimum.
        sign: side of the mirror.
        covariance: (n, n) of the search variable.
        coordinates: k of them.
        rise: of the sum of squares at an end.
        quantile: standard errors to an end by the curvature; it is returned where no better end is reached,
            moved to between the places that are known to lie inside and outside.
    """
    c = coordinates
    pins = np.repeat(np.arange(c.std.size), 2)
    ways, std = np.tile([-1.0, 1.0], c.std.size), c.std[pins]
    along = (c.slopes @ covariance)[pins] / std[:, None] ** 2  # of a parabola, for a step of 1
    least, reach = float(problem.evaluate(q[None]).objective[0]), quantile * std
    going = np.arange(pins.size)
    at, distance = np.tile(q, (pins.size, 1)), reach.copy()
    inside, outside = np.zeros(pins.size), np.full(pins.size, np.inf)
    for steps in _STEPS:
        if not going.size:
            break
        places = c.values[pins] + ways * distance
        start = at + (places - c.of(at)[np.arange(pins.size), pins])[:, None] * along
        down = descend(
            _Pinned(problem, sign, c, places),  # type: ignore[arg-type]
            np.column_stack([start, np.arange(pins.size)])[going], going, steps, _PROMISED,
        )  # fmt: skip
        at[going] = down.Q[:, :-1]
        off = (c.of(at[going])[np.arange(going.size), pins[going]] - places[going]) / std[going]
        up = (down.objective - (_STIFF * off) ** 2 - least) / rise
        free = np.abs(off) < _HELD
        near = down.rests & (np.abs(up - 1) < _NEAR)
        reach[going[free & near]] = (distance[going] + ways[going] * off * std[going])[free & near]
        inside[going[up < 1]], outside[going[(up >= 1) & down.rests]] = (
            distance[going[up < 1]], distance[going[(up >= 1) & down.rests]]
        )  # fmt: skip
        step = distance[going] * np.clip(up, 0.1, 10.0) ** -0.5
        middle = 0.5 * (inside[going] + np.minimum(outside[going], 2 * distance[going]))
        step = np.where((inside[going] < step) & (step < outside[going]), step, middle)
        # what has not come to rest goes on where it is: its rise is still too large
        distance[going] = np.where(down.rests | (up < 1), step, distance[going])
        going = going[free & ~near]
    reach[going] = np.clip(reach, inside, outside)[going]
    return reach.reshape(-1, 2)
