"""A mass on a pad that cannot pull, pressed down by a static force, on the shaken table.

With d the compression of the pad and W the static force (the weight and what rests on it, if that does not move),

    d'' = a_0(t) - (P - W) / m,    P = max(0, A d^n + c(d) d') for d > 0, else 0

where a_0 is the acceleration of the table and (P - W) / m that of the mass. The tangent stiffness at `REFERENCE_N` is
k, the damper goes with the tangent stiffness and is c there. Stepped by Runge-Kutta of fourth order; a contact that
opens or closes within a step is met by the force alone.

The map over a period takes (d, d') to (d, d') a period later. Newton's method looks for a state that it repeats after
1, 2 or 4 periods (shooting), from a motion that was stepped from rest; only a stable one nearby counts. Where there is
none yet the motion is stepped on, up to the last of `TRIALS`.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from identification.rivals.pad_balance import REFERENCE_N, TABLE_M_S2

Array = np.ndarray
#: Longest step [s]; the fewest steps a period; periods in which the table's amplitude grows to its whole.
LONGEST, FEWEST, GROWING = 2e-4, 120, 4
#: Periods after which shooting is tried; periods read of a motion that repeats, and of one that does not.
TRIALS, READ, READ_ALL = (8, 24, 64, 160, 400), 4, 32
#: Newton steps; how far, in sizes of the motion, they may lead; differences for the map's slope; what counts as met.
NEWTON, NEAR, APART, MET = 10, 0.5, 1e-5, 1e-8
#: Two states are the same if they differ by less than this share of the motion.
SAME = 1e-4
#: Period of a motion that repeats after neither 1, 2 nor 4 periods, and of one that still approaches such a motion.
NONE, NOT_SETTLED = 0, -1


@dataclass(frozen=True)
class Steady:
    """Steady motion of many systems at many frequencies, each array (systems, f).

    Attributes:
        response: acceleration of the mass at the table's frequency, over that of the table, complex.
        second: second harmonic over the first.
        air: share of the time without contact.
        period: after how many periods of the table it repeats: 1, 2, 4, `NONE` of these, or `NOT_SETTLED`.
        multiplier: by how much a small departure from it grows over that period; NaN where shooting found nothing.
    """

    response: Array
    second: Array
    air: Array
    period: Array
    multiplier: Array


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
    return Steady(found[0] + 1j * found[1], found[2], found[3], found[4], found[5])


@njit(cache=True)
def force(d: float, v: float, A: float, n: float, k: float, c: float) -> float:
    """Force of the pad [N] at compression d [m] and rate v [m/s]."""
    if d <= 0.0:
        return 0.0
    spring = A * d**n
    return max(0.0, spring + c / k * n * spring / d * v)


@njit(cache=True)
def _over(d, v, system, table, read):  # type: ignore[no-untyped-def]
    """State after one period; harmonics 1, 2, time in the air and bounds of d are added to `read` if it has room."""
    m, W, k, n, c, A, omega, count = system
    h = 2 * np.pi / (omega * count)
    for i in range(int(count)):
        angle = omega * h * i
        f0 = force(d, v, A, n, k, c)
        if read.size:
            a = (f0 - W) / m
            read[0] += a * np.sin(angle)
            read[1] += a * np.cos(angle)
            read[2] += a * np.sin(2 * angle)
            read[3] += a * np.cos(2 * angle)
            read[4] += 1.0 if f0 == 0.0 else 0.0
            read[5], read[6] = min(read[5], d), max(read[6], d)
        a0, a1 = table * np.sin(angle), table * np.sin(angle + 0.5 * omega * h)
        a2 = table * np.sin(angle + omega * h)
        k1 = a0 - (f0 - W) / m
        k2 = a1 - (force(d + 0.5 * h * v, v + 0.5 * h * k1, A, n, k, c) - W) / m
        k3 = a1 - (force(d + 0.5 * h * v + 0.25 * h * h * k1, v + 0.5 * h * k2, A, n, k, c) - W) / m
        k4 = a2 - (force(d + h * v + 0.5 * h * h * k2, v + h * k3, A, n, k, c) - W) / m
        d += h * v + h * h / 6 * (k1 + k2 + k3)
        v += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return d, v


@njit(cache=True)
def _after(d, v, system, table, periods):  # type: ignore[no-untyped-def]
    """State after some periods."""
    for _ in range(periods):
        d, v = _over(d, v, system, table, np.empty(0))
    return d, v


@njit(cache=True)
def _shoot(d, v, system, table, periods, size):  # type: ignore[no-untyped-def]
    """A state near (d, v) that repeats after so many periods, and its largest multiplier, or NaN if there is none.

    Lengths are measured in `size` [m], the span of the motion, and rates in that times the table's angular frequency.
    """
    omega = system[6]
    x, y, rate = d, v, size * omega
    for _ in range(NEWTON):
        dx, vx = _after(x, y, system, table, periods)
        r1, r2 = (dx - x) / size, (vx - y) / rate
        d1, v1 = _after(x + APART * size, y, system, table, periods)
        d2, v2 = _after(x, y + APART * rate, system, table, periods)
        j11, j21 = (d1 - dx) / (APART * size), (v1 - vx) / (APART * rate)
        j12, j22 = (d2 - dx) / (APART * size), (v2 - vx) / (APART * rate)
        if abs(r1) + abs(r2) < MET:
            half, product = 0.5 * (j11 + j22), j11 * j22 - j12 * j21
            under = half * half - product
            largest = abs(half) + np.sqrt(under) if under > 0 else np.sqrt(max(product, 0.0))
            return x, y, largest
        det = (1 - j11) * (1 - j22) - j12 * j21
        if det == 0.0:
            break
        x += size * ((1 - j22) * r1 + j12 * r2) / det
        y += rate * (j21 * r1 + (1 - j11) * r2) / det
        if not abs(x - d) / size + abs(y - v) / rate < NEAR:
            break
    return d, v, np.nan


@njit(cache=True)
def _gap(ends, last, periods, size, omega):  # type: ignore[no-untyped-def]
    """How far the states of the last `READ_ALL` periods up to `last` are from those so many periods before."""
    far = 0.0
    for j in range(max(periods, last + 1 - READ_ALL), last + 1):
        one = abs(ends[j, 0] - ends[j - periods, 0]) + abs(ends[j, 1] - ends[j - periods, 1]) / omega
        far = max(far, one / size)
    return far


@njit(cache=True)
def _settle(system, table):  # type: ignore[no-untyped-def]
    """From rest to a steady state: d, v, its period and its multiplier."""
    W, n, A, omega = system[1], system[3], system[5], system[6]
    d, v = (W / A) ** (1 / n), 0.0
    still, size = d, d
    ends = np.zeros((TRIALS[-1] + 1, 2))
    ends[0, 0] = d
    at = 0
    for trial in TRIALS:
        low_high = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1e9, -1e9])
        while at < trial:
            d, v = _over(d, v, system, table * min(1.0, (at + 1) / GROWING),
                         low_high if at >= trial - READ else np.empty(0))  # fmt: skip
            at += 1
            ends[at, 0], ends[at, 1] = d, v
        size = max(low_high[6] - low_high[5], 1e-12 * still)
        for periods in (1, 2, 4):
            if periods * GROWING > trial:
                break
            x, y, multiplier = _shoot(d, v, system, table, periods, size)
            if multiplier < 1.0:
                shorter = 1
                while shorter < periods:
                    x1, y1 = _after(x, y, system, table, shorter)
                    if abs(x1 - x) / size + abs(y1 - y) / (size * omega) < SAME:
                        break
                    shorter *= 2
                return x, y, shorter, multiplier
    nearest = 1e9
    before = 1e9
    for periods in (1, 2, 4):
        gap = _gap(ends, at, periods, size, omega)
        if gap < SAME:
            return d, v, periods, np.nan
        nearest = min(nearest, gap)
        before = min(before, _gap(ends, at // 2, periods, size, omega))
    return d, v, NOT_SETTLED if nearest < 0.5 * before else NONE, np.nan


@njit(cache=True, parallel=True)
def _steady(frequency, mass, static, stiffness, exponent, damping, table):  # type: ignore[no-untyped-def]
    S, F = mass.size, frequency.size
    out = np.zeros((6, S, F))
    for job in prange(S * F):
        s, f = job // F, job % F
        n = exponent[s]
        A = (stiffness[s] / (n * REFERENCE_N ** (1 - 1 / n))) ** n
        count = max(float(FEWEST), np.ceil(1 / (frequency[f] * LONGEST)))
        system = (
            mass[s],
            static[s],
            stiffness[s],
            n,
            damping[s],
            A,
            2 * np.pi * frequency[f],
            count,
        )
        d, v, period, multiplier = _settle(system, table)
        read = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1e9, -1e9])
        periods = READ if period > 0 else READ_ALL
        for _ in range(periods):
            d, v = _over(d, v, system, table, read)
        total = 2 / (table * count * periods)
        out[0, s, f], out[1, s, f] = read[0] * total, read[1] * total
        first = np.hypot(read[0], read[1])
        out[2, s, f] = np.hypot(read[2], read[3]) / first if first > 0 else 0.0
        out[3, s, f], out[4, s, f], out[5, s, f] = read[4] / (count * periods), period, multiplier
    return out
