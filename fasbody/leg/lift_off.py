"""A mass on a pad that cannot pull, pressed down by a static force, on the shaken table.

With d the compression of the pad and W the static force (the weight and what rests on it, if that does not move),

    d'' = a_0(t) - (P - W) / m,    P = max(0, A d^n + c(d) d') for d > 0, else 0

where a_0 is the acceleration of the table and (P - W) / m that of the mass. The tangent stiffness at `REFERENCE_N` is
k, the damper goes with the tangent stiffness and is c there. Stepped by Runge-Kutta of fourth order from the static
state; where the steady motion does not repeat after one period that is said, and the fundamental is read over four.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

Array = np.ndarray
#: Gravity [m/s^2], the force at which a pad's stiffness is named [N], and the table's acceleration [m/s^2].
G, REFERENCE_N, TABLE_M_S2 = 9.81, 43.0, 8.95
#: Periods before and while the motion is read; the longest step [s]; the fewest steps a period.
SETTLING, READ, LONGEST, FEWEST = 16, 4, 2e-4, 120
#: Two states are the same if they differ by less than this share of the motion.
SAME = 1e-3


@dataclass(frozen=True)
class Steady:
    """Steady motion of many systems at many frequencies, each array (systems, f).

    Attributes:
        response: acceleration of the mass at the table's frequency, over that of the table, complex.
        second: second harmonic over the first.
        air: share of the time without contact.
        period: after how many periods of the table it repeats: 1, 2, 4, or 0 for none of these.
    """

    response: Array
    second: Array
    air: Array
    period: Array


def steady(
    frequency_hz: Array,
    mass: Array,
    static: Array,
    stiffness: Array,
    exponent: Array,
    damping: Array,
    table: float = TABLE_M_S2,
) -> Steady:
    """Shake many systems at many frequencies.

    Args:
        frequency_hz: of the table [Hz], (f,).
        mass: that moves [kg], (s,).
        static: force that presses it on the pad [N], (s,).
        stiffness: of the pad at `REFERENCE_N` [N/m], (s,).
        exponent: n, (s,).
        damping: of the pad at `REFERENCE_N` [N s/m], (s,).
        table: amplitude of the table [m/s^2].
    """
    found = _steady(*(np.ascontiguousarray(a, float) for a in (frequency_hz, mass, static, stiffness, exponent,
                                                               damping)), table)  # fmt: skip
    return Steady(found[0] + 1j * found[1], found[2], found[3], found[4])


@njit(cache=True)
def force(d: float, v: float, A: float, n: float, k: float, c: float) -> float:
    """Force of the pad [N] at compression d [m] and rate v [m/s]."""
    if d <= 0.0:
        return 0.0
    spring = A * d**n
    return max(0.0, spring + c / k * n * spring / d * v)


@njit(cache=True, parallel=True)
def _steady(frequency, mass, static, stiffness, exponent, damping, table):  # type: ignore[no-untyped-def]
    S, F = mass.size, frequency.size
    out = np.zeros((5, S, F))
    for job in prange(S * F):
        s, f = job // F, job % F
        m, W, k, n, c = mass[s], static[s], stiffness[s], exponent[s], damping[s]
        A = (k / (n * REFERENCE_N ** (1 - 1 / n))) ** n
        omega = 2 * np.pi * frequency[f]
        count = max(FEWEST, int(np.ceil(1 / (frequency[f] * LONGEST))))
        h = 1 / (frequency[f] * count)
        d, v = (W / A) ** (1 / n), 0.0
        still = d
        ends = np.zeros((READ + 1, 2))
        re1, im1, re2, im2, air, low, high = 0.0, 0.0, 0.0, 0.0, 0.0, 1e9, -1e9
        for period in range(SETTLING + READ):
            if period >= SETTLING:
                ends[period - SETTLING, 0], ends[period - SETTLING, 1] = d, v
            ramp = min(1.0, (period + 1) / 4)
            for i in range(count):
                angle = omega * h * i
                if period >= SETTLING:
                    a = (force(d, v, A, n, k, c) - W) / m
                    re1 += a * np.sin(angle)
                    im1 += a * np.cos(angle)
                    re2 += a * np.sin(2 * angle)
                    im2 += a * np.cos(2 * angle)
                    air += 1.0 if force(d, v, A, n, k, c) == 0.0 else 0.0
                    low, high = min(low, d), max(high, d)
                a0, a1 = ramp * table * np.sin(angle), ramp * table * np.sin(angle + 0.5 * omega * h)
                a2 = ramp * table * np.sin(angle + omega * h)
                k1 = a0 - (force(d, v, A, n, k, c) - W) / m
                k2 = a1 - (force(d + 0.5 * h * v, v + 0.5 * h * k1, A, n, k, c) - W) / m
                k3 = a1 - (force(d + 0.5 * h * v + 0.25 * h * h * k1, v + 0.5 * h * k2, A, n, k, c) - W) / m
                k4 = a2 - (force(d + h * v + 0.5 * h * h * k2, v + h * k3, A, n, k, c) - W) / m
                d += h * v + h * h / 6 * (k1 + k2 + k3)
                v += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        ends[READ, 0], ends[READ, 1] = d, v
        scale = max(high - low, 1e-12 * still)
        repeats = 0
        for p in (4, 2, 1):
            gap = 0.0
            for j in range(READ + 1 - p):
                one = abs(ends[j, 0] - ends[j + p, 0]) + abs(ends[j, 1] - ends[j + p, 1]) / omega
                gap = max(gap, one / scale)
            repeats = p if gap < SAME else repeats
        total = 2 / (table * count * READ)
        out[0, s, f], out[1, s, f] = re1 * total, im1 * total
        first = np.sqrt(re1**2 + im1**2)
        out[2, s, f] = np.sqrt(re2**2 + im2**2) / first if first > 0 else 0.0
        out[3, s, f], out[4, s, f] = air / (count * READ), repeats
    return out
