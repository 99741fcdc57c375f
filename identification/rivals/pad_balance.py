"""Steady motion of any linear structure on a pad that cannot pull, by harmonic balance.

Only the pad is nonlinear, P = max(0, A d^n + c(d) d') for a compression d > 0, else 0; its damper
goes with the tangent stiffness. So d(t) is all that is unknown. What stands on the pad has at
harmonic k of the table the dynamic mass M_k, force over acceleration at the pad. With the static
force W and the table's acceleration a cos(w t), every harmonic of the pad's force must be

    P_0 = W,    P_k = M_k (a delta_k1 + (k w)^2 d_k)

which `fasbody.foot.harmonic_balance` solves for d_0 .. d_H. It gives motions that repeat after one
period of the table, stable or not.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fasbody.foot.harmonic_balance import Fourier, newton

Array = np.ndarray
#: Force at which a pad's stiffness is named [N].
REFERENCE_N = 43.0
#: Acceleration of the table in Chapter 2 [m/s^2].
TABLE_M_S2 = 8.95
#: Harmonics that are balanced, and samples of a period.
HARMONICS, SAMPLES = 8, 40
#: Shares of the table's amplitude on the way to the whole.
RAMP = (0.3, 0.65, 1.0)
#: Size of a Newton step over the motion that counts as balanced.
BALANCED = 1e-7

SERIES = Fourier(HARMONICS, SAMPLES)
_K = np.arange(1, HARMONICS + 1)


@dataclass(frozen=True)
class Pressed:
    """Many systems under a sine of the table: `harmonic_balance.Equations` of the compressions.

    Attributes:
        omega: of the table [rad/s], (n,).
        mass: dynamic mass at each harmonic [kg], complex, (n, HARMONICS).
        static: W [N], (n,).
        stiffness: of the pad at `REFERENCE_N` [N/m], (n,).
        exponent: n of the pad, (n,).
        damping: of the pad at `REFERENCE_N` [N s/m], (n,).
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

    @property
    def still(self) -> Array:
        """Compression under the static force alone [m], (n,)."""
        return (self.static / self.factor) ** (1 / self.exponent)

    def force(self, x: Array) -> tuple[Array, Array]:
        """Force of the pad (n, SAMPLES) [N] and slopes (2, n, SAMPLES) in d and d', at x (n, u)."""
        n, A = self.exponent[:, None], self.factor[:, None]
        d, v, _ = SERIES.at(x)
        held = np.maximum(d, 1e-6 * self.still[:, None])
        spring, share = A * held**n, n * (self.damping / self.stiffness)[:, None] / held
        P = spring * (1 + share * self.omega[:, None] * v)
        on = (d > 0) & (P > 0)
        slopes = spring / held * (n + (n - 1) * share * self.omega[:, None] * v), spring * share
        return on * P, on * np.stack(slopes)

    def residual(self, x: Array, rows: Array) -> Array:
        """What is not balanced [N], (n, u), in some of the systems."""
        some = self[rows]
        return SERIES.project(some.force(x)[0]) - SERIES.real(some.mass * some.acceleration(x), some.static)

    def jacobian(self, x: Array, rows: Array) -> Array:
        """Its derivative, (n, u, u)."""
        some = self[rows]
        in_d, in_v = some.force(x)[1]
        J = SERIES.tangent(np.stack([in_d, some.omega[:, None] * in_v, 0 * in_d]))
        J[:, 0, 0] += 1e-9 * some.stiffness  # a pad that is never touched has none
        w2 = (some.omega[:, None] * _K) ** 2
        return J - SERIES.dynamic(np.pad(w2 * some.mass, ((0, 0), (1, 0))))

    def size(self, x: Array) -> Array:
        """Norm of unknowns by the accelerations of their harmonics, (n,)."""
        return np.linalg.norm(x * np.maximum(1, SERIES.order) ** 2, axis=1)

    def acceleration(self, x: Array) -> Array:
        """Harmonics of the acceleration above the pad [m/s^2], complex, (n, HARMONICS)."""
        a = (self.omega[:, None] * _K) ** 2 * SERIES.complex(x)
        a[:, 0] += self.table
        return a

    def air(self, x: Array) -> Array:
        """Share of the time without contact, (n,)."""
        return (self.force(x)[0] == 0).mean(axis=1)


def solve(systems: Pressed, start: Array | None = None) -> tuple[Array, Array]:
    """Unknowns (n, u) of the balanced motion, and which systems are balanced, (n,).

    Args:
        systems: what is shaken.
        start: unknowns to begin at; default the static state, the table's amplitude rising.
    """
    rising = RAMP if start is None else (1.0,)
    rest = np.zeros((systems.omega.size, 0))
    x = SERIES.real(rest, systems.still) if start is None else start
    for share in rising:
        louder = replace(systems, table=share * systems.table)
        x, _, balanced = newton(louder, x, tight=BALANCED, longest=1.0)
    return x, balanced


def begin(systems: Pressed, first: Array, second: Array | float = 0.0) -> Array:
    """Unknowns (n, u) to begin at, from harmonics of the acceleration above the pad.

    The mean compression is the one that carries the static force.

    Args:
        systems: what is shaken.
        first: harmonic, complex, (n,).
        second: harmonic, complex, (n,).
    """
    d = np.stack([first - systems.table, np.broadcast_to(second, first.shape) / 4], axis=1)
    x = SERIES.real(d / systems.omega[:, None] ** 2)
    swing = np.abs(x[:, 1:]).sum(axis=1)
    low, high = -swing, systems.still + swing
    for _ in range(30):
        x[:, 0] = 0.5 * (low + high)
        light = systems.force(x)[0].mean(axis=1) < systems.static
        low, high = np.where(light, x[:, 0], low), np.where(light, high, x[:, 0])
    return x
