"""What sections 2.3.1, 2.3.2 and 2.4 state about the load, as data that a model without subjects can be held against.

The thesis compares means by tests; a model has one number. So "greater" needs `GREATER` more, "equal" and "close to"
allow `EQUAL`, and what the thesis prints as a trend may break by `GREATER`. Both tolerances are assumptions: the thesis
gives none. The statements that need a scatter (subjects that differ) are left to transmissibility/findings.py.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from fasbody.transmissibility.findings import FREQUENCIES_HZ, LOADS

Array = np.ndarray
#: Tolerances [1].
GREATER, EQUAL = 0.015, 0.03
ADDED_KG = tuple(kg for _, kg in LOADS)
#: Where the highest MB lies [Hz] by load: abstract and section 2.3.1.
RANGES_HZ = ((15.0, 25.0), (30.0, 35.0), (35.0, 40.0))
_F = np.array(FREQUENCIES_HZ)


@dataclass(frozen=True)
class Curves:
    """Of many models: MB and TM at the loads and frequencies of Chapter 2, complex, each (..., 3, 9)."""

    MB: Array
    TM: Array

    def size(self, pair: str, load: int) -> Array:
        """|T| of a pair at a load, (..., 9)."""
        T = {"MB": self.MB, "TM": self.TM, "TB": self.MB * self.TM}[pair]
        return np.abs(T[..., load, :])

    @property
    def lag(self) -> Array:
        """Phase lag of MB [deg], (..., 3, 9); between neighbours it changes by less than half a turn."""
        return -np.degrees(np.unwrap(np.angle(self.MB), axis=-1))


@dataclass(frozen=True)
class Statement:
    """One statement: section, pair, text, and the function that tests many models at once."""

    section: str
    pair: str
    says: str
    holds: Callable[[Curves], Array]


def at(T: Array, *hz: float) -> Array:
    """Columns of T (..., 9) at frequencies [Hz]."""
    return T[..., [int(np.flatnonzero(f == _F)[0]) for f in hz]]


def _alike(one: Array, other: Array | float) -> Array:
    return np.all(np.abs(one / np.asarray(other) - 1) <= EQUAL, axis=-1)


def _greater(one: Array, other: Array | float) -> Array:
    return np.all(one >= (1 + GREATER) * np.asarray(other), axis=-1)


def _falls(T: Array) -> Array:
    return np.all(T[..., 1:] <= (1 + GREATER) * T[..., :-1], axis=-1) & (T[..., -1] < T[..., 0])


def _above_one(load: int, most_hz: float, c: Curves) -> Array:
    return _greater(c.size("MB", load)[..., most_hz >= _F], 1.0)


def _below_one(pair: str, load: int, least_hz: float, c: Curves) -> Array:
    return np.all(c.size(pair, load)[..., least_hz <= _F] <= 1 - GREATER, axis=-1)


def _plateau(load: int, hz: tuple[float, ...], c: Curves) -> Array:
    T = at(c.size("TM", load), *hz)
    return T.max(-1) / T.min(-1) <= 1 + EQUAL


def _peak(load: int, top: tuple[float, ...], beside: tuple[float, ...], c: Curves) -> Array:
    T = c.size("TB", load)
    return _greater(at(T, *top).min(-1, keepdims=True), at(T, *beside))


def _resonance(
    load: int, top: float, equal: tuple[float, ...], beside: tuple[float, ...], c: Curves
) -> Array:
    """MB is greater at `top` than beside it, and not different at `equal`."""
    T = c.size("MB", load)
    return _alike(at(T, *equal), at(T, top)) & _greater(at(T, top), at(T, *beside))


def _no_peak(load: int, c: Curves) -> Array:
    """Nothing between the ends is greater than both ends of the curve to its left and right."""
    T = c.size("TM", load)
    left = np.minimum.accumulate(T, axis=-1)
    right = np.minimum.accumulate(T[..., ::-1], axis=-1)[..., ::-1]
    return ~np.any((1 + EQUAL) * np.maximum(left, right) < T, axis=-1)


def _steepest(load: int, c: Curves) -> Array:
    place = np.diff(c.lag[..., load, :], axis=-1).argmax(axis=-1)
    low, high = RANGES_HZ[load]
    return (_F[place] >= low - 5) & (_F[place + 1] <= high + 5)


def _less_lag(load: int, c: Curves) -> Array:
    less = c.lag[..., 0, :] - c.lag[..., load, :]
    place = _F[less.argmax(axis=-1)]
    return (less.max(axis=-1) > 0) & (place > 25) & (place < 40)


def _near_one(load: int, hz: float, c: Curves) -> Array:
    """TM "close to unity, like a rigid body": twice `EQUAL` below is still close."""
    return np.all(c.size("TM", load)[..., hz >= _F] >= 1 - 2 * EQUAL, axis=-1)


def _alike_under_load(c: Curves) -> Array:
    return _alike(*(at(c.size("TB", load), 15, 20, 25, 30, 35) for load in (1, 2)))


def _falls_with_load(c: Curves) -> Array:
    slow = [at(c.size("MB", load), 10, 15) for load in range(3)]
    return np.all((slow[0] > slow[1]) & (slow[1] > slow[2]), axis=-1)


def _differ_at_10(c: Curves) -> Array:
    T = np.sort(np.stack([at(c.size("TB", load), 10)[..., 0] for load in range(3)], -1), axis=-1)
    return T[..., -1] >= (1 + GREATER) * T[..., 0]


STATEMENTS: tuple[Statement, ...] = (
    Statement("2.3.1", "MB", "unloaded: above 1 below 40 Hz", partial(_above_one, 0, 35)),
    Statement("2.3.1", "MB", "unloaded: close to 1 at 45 and 50 Hz", lambda c: _alike(at(c.size("MB", 0), 45, 50), 1)),
    Statement("2.3.1", "MB", "unloaded: falls as frequency rises", lambda c: _falls(c.size("MB", 0))),
    Statement("2.3.1", "MB", "unloaded: plateau 15-25 Hz", partial(_resonance, 0, 20, (15, 25), (30,))),
    Statement("2.3.1", "MB", "2.3 kg: resonance 30-35 Hz", partial(_resonance, 1, 30, (35,), (25, 40))),
    Statement("2.3.1", "MB", "4.5 kg: resonance 35-40 Hz", partial(_resonance, 2, 35, (40,), (30, 45))),
    Statement("2.3.1", "MB", "2.3 kg: above 1 at all frequencies", partial(_above_one, 1, np.inf)),
    Statement("2.3.1", "MB", "4.5 kg: above 1 at all frequencies", partial(_above_one, 2, np.inf)),
    Statement("2.4", "MB", "below 20 Hz falls with load", _falls_with_load),
    *(
        Statement("2.3.1", "MB", f"{kg:g} kg: phase steepest within 5 Hz of the resonance", partial(_steepest, load))
        for load, kg in enumerate(ADDED_KG)
    ),
    *(
        Statement("2.3.1", "MB", f"{kg:g} kg: lags less than unloaded, most at 30-35 Hz", partial(_less_lag, load))
        for load, kg in enumerate(ADDED_KG) if load
    ),
    Statement("2.3.1", "TB", "differs between the loads at 10 Hz", _differ_at_10),
    Statement("2.3.1", "TB", "unloaded: falls without peak or flat part", lambda c: _falls(c.size("TB", 0))),
    *(
        Statement("2.3.1", "TB", f"{kg:g} kg: peak 25-30 Hz", partial(_peak, load, (25, 30), (20, 35)))
        for load, kg in enumerate(ADDED_KG) if load
    ),
    Statement("2.3.1", "TB", "2.3 and 4.5 kg alike at 15-35 Hz", _alike_under_load),
    *(
        Statement("2.3.1", "TB", f"{kg:g} kg: below 1 above {hz} Hz", partial(_below_one, "TB", load, hz + 1))
        for load, (kg, hz) in enumerate(zip(ADDED_KG, (40, 45, 49), strict=True))
    ),
    *(Statement("2.3.1", "TM", f"{kg:g} kg: no peak", partial(_no_peak, load)) for load, kg in enumerate(ADDED_KG)),
    *(
        Statement("2.3.1", "TM", f"{kg:g} kg: below 1 above {hz} Hz", partial(_below_one, "TM", load, hz + 1))
        for load, (kg, hz) in enumerate(zip(ADDED_KG, (25, 40, 40), strict=True))
    ),
    Statement("2.3.1", "TM", "unloaded: falls as frequency rises", lambda c: _falls(c.size("TM", 0))),
    *(
        Statement("2.3.1", "TM", f"{kg:g} kg: plateau 10-25 Hz", partial(_plateau, load, (10, 15, 20, 25)))
        for load, kg in enumerate(ADDED_KG) if load
    ),
    *(
        Statement("2.4", "TM", f"{kg:g} kg: close to 1 up to {hz} Hz", partial(_near_one, load, hz))
        for load, (kg, hz) in enumerate(zip(ADDED_KG, (25, 35, 35), strict=True))
    ),
)  # fmt: skip


def judge(curves: Curves) -> Array:
    """Which statements hold, bool, shape (..., statements). A model without a tibia (TM is NaN) meets none about it."""
    held = [s.holds(curves) & (s.pair == "MB" or np.isfinite(curves.TM).all(axis=(-2, -1))) for s in STATEMENTS]
    return np.stack(held, axis=-1)


def ranges_met(peak_hz: Array) -> Array:
    """Whether the highest MB lies in `RANGES_HZ` at each load, for peaks (..., 3) [Hz]: bool (..., 3)."""
    low, high = np.array(RANGES_HZ).T
    return (peak_hz >= low) & (peak_hz <= high)
