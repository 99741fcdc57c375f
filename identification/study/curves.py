"""Constants as smooth functions of frequency and load: log k = B(f, M) beta, with as few coefficients as data allow.

The logarithm of each curve is a natural cubic spline in log f, given by its values at knots spread evenly in log f,
plus powers of the load M / M_max, each times a spline of its own. All other parameters are constants of the subject.
The coefficients are in the units of `Space`, so that the bounds of a knot are those of the parameter.

No recording lies on smooth curves exactly: the foot stands a little differently each time. With `scatter`, recording i
has offsets u_i of its own in the logarithm of each curve, which follow beta in the search variable.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from fasbody.exceptions import SettingError
from identification.space import Space

#: A load may change a constant by this factor at most, and a recording lie off its curve by that.
_LOAD_FACTOR, _OFFSET = np.log(1e3), np.log(5.0)


@dataclass(frozen=True)
class Order:
    """How many coefficients a curve has.

    Attributes:
        knots: of the spline in log frequency; 1 a constant, 2 a power law, 3 and more a natural cubic spline.
        load: highest power of the load, 0 for none.
        mixed: knots of each power's factor; 1: the load multiplies a constant by the same at all frequencies.
    """

    knots: int = 3
    load: int = 0
    mixed: int = 1

    @property
    def count(self) -> int:
        """Coefficients a curve."""
        return self.knots + self.load * self.mixed

    def __str__(self) -> str:
        return f"{self.knots} knots, load {self.load}" + (f" x {self.mixed}" if self.load else "")


def natural_spline(f: np.ndarray, knots: int, low: float, high: float) -> np.ndarray:
    """Natural cubic spline in log f through unit values at each knot (n, knots); a straight line beyond the last knot.

    Args:
        f: (n,) frequencies. knots: how many, spread evenly in log f from `low` to `high`, same unit as f.
    """
    x = np.log(np.asarray(f, float))
    if knots == 1:
        return np.ones((x.size, 1))
    at = np.linspace(np.log(low), np.log(high), knots)
    if knots == 2:
        share = (x - at[0]) / (at[1] - at[0])
        return np.column_stack([1 - share, share])
    spline = CubicSpline(at, np.eye(knots), bc_type="natural")
    inside = np.clip(x, at[0], at[-1])
    return spline(inside) + (x - inside)[:, None] * spline(inside, 1)


@dataclass(frozen=True, eq=False)
class CurveSpace:
    """Search space of a trend: the coefficients of all curves in turn, then the constants.

    Attributes:
        feet: the space of one foot. curves: which of its parameters are curves. order: of all of them.
        frequencies_hz, loads_kg: (m,) of each recording.
        scatter: each recording has offsets from the curves.
        weights: (m, p, n) the search variable of recording i's foot is weights[i] @ z.
    """

    feet: Space
    curves: tuple[str, ...]
    order: Order
    frequencies_hz: np.ndarray
    loads_kg: np.ndarray
    scatter: bool = False
    weights: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        frequencies, loads = len(set(self.frequencies_hz.round(2))), len(set(self.loads_kg))
        o = self.order
        if not 1 <= o.knots <= frequencies or not 0 <= o.load < loads or not 1 <= o.mixed <= o.knots:
            raise SettingError(
                f"a trend of {o} cannot be: {frequencies} frequencies, {loads} loads allow 1 to {frequencies} knots, "
                f"powers of the load up to {loads - 1}, and no more knots for the load than for the frequency."
            )
        B = self.design(self.frequencies_hz, self.loads_kg)
        m, k = self.offsets
        U = np.zeros((self.frequencies_hz.size, len(self.feet.free), m * k))
        for i in range(m):
            U[i, self.places, i * k + np.arange(k)] = 1.0
        object.__setattr__(self, "weights", np.concatenate([B, U], axis=2))

    @property
    def places(self) -> list[int]:
        """Where the curves are among the foot's free parameters."""
        return [i for i, item in enumerate(self.feet.free) if item.name in self.curves]

    @property
    def logarithmic(self) -> np.ndarray:
        """Which of z belong to logarithmic parameters: coefficients of curves and offsets among them."""
        held = [c.start for c, item in zip(self.columns, self.feet.free, strict=True) if not item.logarithmic]
        return np.setdiff1d(np.arange(self.weights.shape[2]), held)

    @property
    def offsets(self) -> tuple[int, int]:
        """Recordings with offsets, and offsets each."""
        return (self.frequencies_hz.size if self.scatter else 0, len(self.places))

    def design(self, frequencies_hz: np.ndarray, loads_kg: np.ndarray) -> np.ndarray:
        """Weights (m, p, n): the search variable of a foot on the curves is design[i] @ beta."""
        low, high = self.frequencies_hz.min(), self.frequencies_hz.max()
        t = loads_kg / max(1e-9, self.loads_kg.max())
        blocks = [natural_spline(frequencies_hz, self.order.knots, low, high)]
        if self.order.load:
            mixed = natural_spline(frequencies_hz, self.order.mixed, low, high)
            blocks += [mixed * (t**power)[:, None] for power in range(1, self.order.load + 1)]
        one = np.hstack(blocks)
        B = np.zeros((frequencies_hz.size, len(self.feet.free), self.size))
        for place, columns in enumerate(self.columns):
            B[:, place, columns] = one if self._is_curve(place) else 1.0
        return B

    def _is_curve(self, place: int) -> bool:
        return self.feet.free[place].name in self.curves

    @property
    def columns(self) -> list[slice]:
        """Where the coefficients of each of the foot's parameters are."""
        sizes = [self.order.count if self._is_curve(i) else 1 for i in range(len(self.feet.free))]
        ends = np.cumsum(sizes)
        return [slice(int(end - size), int(end)) for size, end in zip(sizes, ends, strict=True)]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return sum(self.order.count if self._is_curve(i) else 1 for i in range(len(self.feet.free)))

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each coefficient: of a curve its value at a knot, or the log factor of the largest load."""
        found = []
        low, high = self.frequencies_hz.min(), self.frequencies_hz.max()
        for i, item in enumerate(self.feet.free):
            if not self._is_curve(i):
                found.append(item.key)
                continue
            at = np.geomspace(low, high, self.order.knots) if self.order.knots > 1 else [float("nan")]
            found += [f"log {item.name}" + (f" at {f:.4g} Hz" if np.isfinite(f) else "") for f in at]
            for power in range(1, self.order.load + 1):
                near = np.geomspace(low, high, self.order.mixed) if self.order.mixed > 1 else [float("nan")]
                text = f"log {item.name} per (load/{self.loads_kg.max():g} kg)" + (f"^{power}" if power > 1 else "")
                found += [text + (f" at {f:.4g} Hz" if np.isfinite(f) else "") for f in near]
        return tuple(found)

    # what a problem needs (identification.space.SearchSpace)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a foot's free parameters, without the delay."""
        return self.feet.names

    @property
    def has_delay(self) -> bool:
        """Whether the channel delay is estimated."""
        return self.feet.has_delay

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of z: knots within the parameter's bounds, load factors within a thousand, offsets within five."""
        m, k = self.offsets
        high = np.concatenate([np.full(self.size, _LOAD_FACTOR), np.full(m * k, _OFFSET)])
        low = -high
        for i, columns in enumerate(self.columns):
            knots = slice(columns.start, columns.start + (self.order.knots if self._is_curve(i) else 1))
            low[knots], high[knots] = (limit[i] for limit in self.feet.bounds)
        return low, high

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds of z."""
        return self.bounds[0]

    def at(self, number: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (p,) of one recording's foot, and their derivatives (p, n) to z."""
        return self.foot(self.weights[number], q)

    def foot(self, B: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same for any weights (p, n), such as those of `design` for a foot on the curves."""
        theta = self.feet.to_theta(B @ z)
        return theta, self.feet.slope(theta)[:, None] * B

    def values(self, theta: np.ndarray) -> dict[str, float]:
        """All parameter values of a foot by name."""
        return self.feet.values(theta)

    def to_q(self, theta: np.ndarray) -> np.ndarray:
        """Coefficients are searched as they are reported."""
        low, high = self.bounds
        return np.clip(theta, low, high)

    def to_theta(self, q: np.ndarray) -> np.ndarray:
        """Coefficients are reported as they are searched."""
        return q

    def at_bound(self, theta: np.ndarray) -> np.ndarray:
        """Which coefficients (n,) rest on a bound."""
        low, high = self.bounds
        return np.minimum(theta - low, high - theta) < 1e-4 * (high - low)

    def feet_of(self, z: np.ndarray) -> list[dict[str, float]]:
        """Named values of every recording's foot."""
        return [self.values(self.at(i, z)[0]) for i in range(self.frequencies_hz.size)]

    def project(self, q: Sequence[np.ndarray]) -> np.ndarray:
        """Coefficients, without offsets, that come nearest to search variables (p,) of every recording's foot."""
        B = self.weights[:, :, : self.size]
        found, *_ = np.linalg.lstsq(B.reshape(-1, self.size), np.concatenate(list(q)), rcond=None)
        m, k = self.offsets
        return self.to_q(np.concatenate([found, np.zeros(m * k)]))
