"""A mass dropped on a heel: what Kinoshita measured, and what a pad does that stiffens and damps with its load.

The spring is the leg's own, k_F under `PAD_N`, stiffening with the load; as a force, PAD_N (x/d)^n. Its damper is Hunt
and Crossley's, force (1 + eta rate).
"""

from functools import cache
from typing import Any

import numpy as np

from fasbody.arch.kinematics import Array
from fasbody.constants import MODEL_GRAVITY
from simulator.mounted import PAD_N, PAD_POWER

#: Kinoshita 1993: mass [kg], speed at touch [m/s]; what was measured, lowest, mean and highest.
MASS_KG, SPEED_M_S = 5.0, 0.93
#: Peak [g] and depth [mm] have no published scatter: 20 % is an assumption. Energy absorbed [%] has its own.
MEASURED = {"peak_g": (9.3, 11.6, 13.9), "depth_mm": (9.0, 11.3, 13.6), "absorbed_percent": (75.0, 79.0, 89.0)}
#: Descente Sports Science 12, the same from 30 mm on the heels of 14 adults (abstract; it gives no speed: free fall).
LOW_M_S = float(np.sqrt(2 * MODEL_GRAVITY * 0.03))
LOW = {"peak_g": (6.8, 8.5, 10.2), "depth_mm": (8.0, 10.0, 12.0), "absorbed_percent": (72.0, 76.0, 84.0)}
#: Longest drop, in times that the mass needs across its depth without gravity or damper.
LONGEST = 20
#: Where `falls` is tabulated: k_F [N/m], eta [s/m].
RANGE = (1e4, 3e6), (0.1, 10.0)


def absorbed(touched_m_s: float, depth: Any, x: Any, v: Any) -> Any:
    """Share of the work done on a pad, weight included, that it does not give back: the area of its loop.

    Args:
        touched_m_s: speed of the mass at touch. depth: deepest compression [m].
        x, v: compression [m] and its rate [m/s] where the drop ends.
    """
    return 1 - (v**2 / 2 + MODEL_GRAVITY * (depth - x)) / (touched_m_s**2 / 2 + MODEL_GRAVITY * depth)


def fall(k_F: Any, eta: Any, speed_m_s: float = SPEED_M_S, steps: int = 150) -> Array:
    """Peak [g], depth [mm] and energy absorbed [%] of the drop, shape (..., 3), of pads (...); by Runge-Kutta's steps.

    It ends where the mass leaves the pad, or where it turns down again, or creeps to rest.

    Args:
        k_F: under `PAD_N` [N/m]. eta: [s/m]. speed_m_s: at touch.
        steps: for the time that the mass needs across its depth without gravity or damper.
    """
    k_F, eta = np.broadcast_arrays(np.asarray(k_F, float), np.asarray(eta, float))
    n = 1 / (1 - PAD_POWER)
    d = n * PAD_N / k_F
    h = d * (MASS_KG * speed_m_s**2 * (n + 1) / (2 * PAD_N * d)) ** (1 / (n + 1)) / speed_m_s / steps

    def force(x: Array, v: Array) -> Array:
        return np.maximum(PAD_N * (np.maximum(x, 0) / d) ** n * (1 + eta * v), 0)

    def rate(x: Array, v: Array) -> tuple[Array, Array]:
        return v, MODEL_GRAVITY - force(x, v) / MASS_KG

    x, v = np.zeros_like(h), np.full_like(h, speed_m_s)
    peak, depth, lost = x, x, np.full_like(h, np.nan)
    for remaining in range(LONGEST * steps, -1, -1):
        a = rate(x, v)
        b = rate(x + h / 2 * a[0], v + h / 2 * a[1])
        c = rate(x + h / 2 * b[0], v + h / 2 * b[1])
        e = rate(x + h * c[0], v + h * c[1])
        x, before = x + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + e[0]), v
        v = v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + e[1])
        on, push = np.isnan(lost), force(x, v)
        peak, depth = np.where(on, np.maximum(peak, push), peak), np.where(on, np.maximum(depth, x), depth)
        over = on & ((v < 0) & (push <= 0) | (before < 0) & (v >= 0) | (remaining == 0))
        lost = np.where(over, absorbed(speed_m_s, depth, x, v), lost)
        if not np.isnan(lost).any():
            break
    return np.stack([peak / (MASS_KG * MODEL_GRAVITY), 1e3 * depth, 100 * lost], axis=-1)


@cache
def _table(speed_m_s: float, points: int) -> tuple[Any, ...]:
    from scipy.interpolate import RectBivariateSpline

    k_F, eta = (np.geomspace(*ends, points) for ends in RANGE)
    found = fall(k_F[:, None], eta, speed_m_s)
    return tuple(RectBivariateSpline(np.log(k_F), np.log(eta), found[..., i]) for i in range(3))


def falls(k_F: Array, eta: Array, i: int, speed_m_s: float = SPEED_M_S, points: int = 14) -> Array:
    """Peak, depth or energy (i = 0, 1, 2) of many pads (d,) within `RANGE`, shape (d,), from a table made once."""
    found: Array = _table(speed_m_s, points)[i](np.log(k_F), np.log(eta), grid=False)
    return found
