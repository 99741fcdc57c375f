"""Steady motion of any linear structure on a pad that cannot pull, by harmonic balance.

Only the pad is nonlinear (`lift_off.force`), so its compression d(t) is all that is unknown. What stands on the pad
answers harmonic k of the table with a dynamic mass M_k, force over acceleration at the pad. With the static force W and
the table's acceleration a cos(w t), every harmonic of the pad's force P(d, d') must be

    P_0 = W,    P_k = M_k (a delta_k1 + (k w)^2 d_k)

which Newton's method solves for d_0 .. d_H. It finds motions that repeat after one period of the table, stable or not.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fasbody.leg.lift_off import REFERENCE_N

Array = np.ndarray
#: Harmonics that are balanced, and samples of a period.
HARMONICS, SAMPLES = 8, 40
#: Shares of the table's amplitude on the way to the whole, Newton steps at each but the last, and at the last.
RAMP, STEPS, LAST = (0.3, 0.65, 1.0), 5, 14
#: Largest unbalanced harmonic of the force over the static force that counts as balanced.
BALANCED = 1e-6

_angle = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
_k = np.arange(1, HARMONICS + 1)
#: d and d' (over w) from the unknowns d_0, cosines, sines: (SAMPLES, 2 HARMONICS + 1); and back.
_E = np.column_stack([np.ones(SAMPLES), np.cos(np.outer(_angle, _k)), np.sin(np.outer(_angle, _k))])
_V = np.column_stack([np.zeros(SAMPLES), -_k * np.sin(np.outer(_angle, _k)), _k * np.cos(np.outer(_angle, _k))])
_Q = _E.T * np.r_[1, np.full(2 * HARMONICS, 2)][:, None] / SAMPLES


@dataclass(frozen=True)
class Pressed:
    """Many systems, each under one sine of the table.

    Attributes:
        omega: of the table [rad/s], (n,). mass: dynamic mass at each harmonic [kg], complex, (n, HARMONICS).
        static: W [N], (n,). stiffness, exponent, damping: of the pad at `REFERENCE_N`, (n,).
        table: amplitude [m/s^2], (n,).
    """

    omega: Array
    mass: Array
    static: Array
    stiffness: Array
    exponent: Array
    damping: Array
    table: Array

    def __getitem__(self, rows: Array) -> "Pressed":
        return Pressed(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    @cached_property
    def factor(self) -> Array:
        """A of the pad's spring A d^n, (n,)."""
        n = self.exponent
        return (self.stiffness / (n * REFERENCE_N ** (1 - 1 / n))) ** n

    def force(self, x: Array) -> tuple[Array, Array, Array]:
        """Force of the pad [N], and its slopes in d and d', each (n, SAMPLES), for unknowns x (n, u)."""
        n, still = self.exponent[:, None], (self.static / self.factor)[:, None] ** (1 / self.exponent[:, None])
        d, v = x @ _E.T, self.omega[:, None] * (x @ _V.T)
        held = np.maximum(d, 1e-6 * still)
        spring = self.factor[:, None] * held**n
        share = n * (self.damping / self.stiffness)[:, None] / held
        P = spring * (1 + share * v)
        on = (d > 0) & (P > 0)
        return on * P, on * spring / held * (n + (n - 1) * share * v), on * spring * share

    def left_over(self, x: Array, amplitude: float = 1.0) -> Array:
        """What is not balanced [N], (n, u)."""
        return self.force(x)[0] @ _Q.T - self._inertia(x, amplitude)

    def slope(self, x: Array) -> Array:
        """Its derivative, (n, u, u)."""
        _, in_d, in_v = self.force(x)
        J = _Q @ (in_d[..., None] * _E + (in_v * self.omega[:, None])[..., None] * _V)
        H, w2 = HARMONICS, (self.omega[:, None] * _k) ** 2
        c, s = 1 + np.arange(H), 1 + H + np.arange(H)
        J[:, c, c] -= w2 * self.mass.real
        J[:, s, s] -= w2 * self.mass.real
        J[:, c, s] -= w2 * self.mass.imag
        J[:, s, c] += w2 * self.mass.imag
        return J

    def _inertia(self, x: Array, amplitude: float) -> Array:
        H, w2 = HARMONICS, (self.omega[:, None] * _k) ** 2
        a = w2 * (x[:, 1 : H + 1] - 1j * x[:, H + 1 :])
        a[:, 0] += amplitude * self.table
        F = self.mass * a
        return np.column_stack([self.static, F.real, -F.imag])

    def acceleration(self, x: Array) -> Array:
        """Harmonics of the acceleration above the pad [m/s^2], complex, (n, HARMONICS)."""
        H = HARMONICS
        a = (self.omega[:, None] * _k) ** 2 * (x[:, 1 : H + 1] - 1j * x[:, H + 1 :])
        a[:, 0] += self.table
        return a

    def air(self, x: Array) -> Array:
        """Share of the time without contact, (n,)."""
        return (self.force(x)[0] == 0).mean(axis=1)


def solve(systems: Pressed, start: Array | None = None) -> tuple[Array, Array]:
    """Unknowns (n, u) of the balanced motion, and which systems are balanced, (n,).

    Args:
        systems: what is shaken. start: unknowns to begin at; default the static state, the table's amplitude rising.
    """
    n = systems.omega.size
    if start is None:
        x = np.zeros((n, 2 * HARMONICS + 1))
        x[:, 0] = (systems.static / systems.factor) ** (1 / systems.exponent)
    else:
        x = start.copy()
    for share in RAMP if start is None else (1.0,):
        rows = np.arange(n)
        for _ in range(LAST if share == 1 else STEPS):
            some = systems[rows]
            rest = some.left_over(x[rows], share)
            size = np.linalg.norm(rest, axis=1) / some.static
            open_ = np.flatnonzero(size > BALANCED)
            if not open_.size:
                break
            rest, rows, some, size = rest[open_], rows[open_], some[open_], size[open_]
            slope = some.slope(x[rows])
            slope[:, 0, 0] += 1e-9 * some.stiffness  # a pad that is never touched has none
            step = np.linalg.solve(slope, rest[..., None])[..., 0]
            far = np.linalg.norm(step, axis=1) / (np.linalg.norm(x[rows], axis=1) + some.table / some.omega**2)
            step /= np.maximum(1, far)[:, None]
            scale, open_ = np.ones(rows.size), np.arange(rows.size)
            for part in (1.0, 0.4, 0.1):
                tried = x[rows[open_]] - part * step[open_]
                new = np.linalg.norm(some[open_].left_over(tried, share), axis=1) / some.static[open_]
                good = new < size[open_]
                scale[open_[good]] = part
                open_ = open_[~good]
                if not open_.size:
                    break
            x[rows] -= scale[:, None] * step
    left = np.linalg.norm(systems.left_over(x), axis=1) / systems.static
    return x, left < 1e3 * BALANCED


def begin(systems: Pressed, first: Array, second: Array | float = 0.0) -> Array:
    """Unknowns (n, u) to begin at, from the first two harmonics of the acceleration above the pad, complex, (n,).

    The mean compression is the one that carries the static force.
    """
    x = np.zeros((systems.omega.size, 2 * HARMONICS + 1))
    for k, d in ((1, (first - systems.table) / systems.omega**2), (2, second / (2 * systems.omega) ** 2)):
        x[:, k], x[:, HARMONICS + k] = np.real(d), -np.imag(d)
    still = (systems.static / systems.factor) ** (1 / systems.exponent)
    swing = np.abs(x[:, 1:]).sum(axis=1)
    low, high = -swing, still + swing
    for _ in range(30):
        x[:, 0] = 0.5 * (low + high)
        light = systems.force(x)[0].mean(axis=1) < systems.static
        low, high = np.where(light, x[:, 0], low), np.where(light, high, x[:, 0])
    return x
