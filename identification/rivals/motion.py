"""The steady motion of rivals whose springs bend or whose shank swings, with its derivatives.

What the two-mass foot has in closed form (`fasbody.foot.two_mass`) is here extended by nine
constants, `EXTRA`. The harmonics of z1 (ankle) and z2 (pad) are balanced at s = i h omega,

    M(s) [s^2 (Z1 + Z2) + U] + N_T = 0
    m_F  [s^2 Z2 + U] - N_T + N_F  = 0
    N    of  k [(exp(b z) - 1) / b + p z^2 + d z^3] + c_1 exp(-c_2 z) cos(c_3 z) z'
    M(s) = m_S [1 - w + w T(s; f_w, zeta_w)]         a share w of the shank hangs on a spring
    T(s; f, zeta) = (1 + 2 zeta s / W) / (1 + 2 zeta s / W + (s / W)^2), W = 2 pi f

Forces that bend are evaluated at instants of a period and projected back.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fasbody.foot.harmonic_balance import Fourier, newton
from fasbody.foot.two_mass import PARAMETERS, orbits, parameters
from identification.motion import TwoMassMotion

Array = np.ndarray
#: Constants that only rivals have, behind those of the foot; w is a share of shank and load.
EXTRA = ("b_T", "p_T", "d_T", "b_F", "p_F", "d_F", "w", "f_w", "zeta_w")
#: Place of each in a row of parameters.
AT = {name: i for i, name in enumerate((*PARAMETERS, *EXTRA))}
#: Load to which e_T and e_F refer [kg].
LOAD_KG = 2.3
#: What grows by exp(e load / `LOAD_KG`), by the constant e.
FOLLOWING = {"e_T": ("k_T", "c_11"), "e_F": ("k_F", "c_21")}
#: Harmonics of the motion, and instants of a period.
HARMONICS, INSTANTS = 8, 32
SERIES = Fourier(HARMONICS, INSTANTS)
#: Places of the constants of ankle and pad: k, c_1, c_2, c_3, b, p, d.
_JOINTS = np.array(
    [
        [AT[name] for name in ("k_T", "c_11", "c_12", "c_13", "b_T", "p_T", "d_T")],
        [AT[name] for name in ("k_F", "c_21", "c_22", "c_23", "b_F", "p_F", "d_F")],
    ]
)
#: Differences in each parameter: large against rounding, small against what bends a response.
_NUDGES = np.array(
    [
        *(10, 10, 0.05, 0.02, 0.02, 0.05, 0.02, 0.02, 1e-4, 1e-4, 1, 1, 1),  # `PARAMETERS`
        *(0.02, 0.02, 50, 0.02, 0.02, 50, 1e-4, 2e-3, 2e-5),  # `EXTRA`
    ]
)
#: Size of a last step over the motion: what is left is the square of it.
_TIGHT = 1e-8


def hung(s: Array, hz: Array | float, zeta: Array | float) -> Array:
    """Motion of a mass on a spring and a damper over that of what it hangs on, at s = i h omega."""
    ratio = s / (2 * np.pi * hz)
    return (1 + 2 * zeta * ratio) / (1 + 2 * zeta * ratio + ratio**2)


@dataclass(frozen=True, eq=False)
class Feet:
    """Many feet on a base each: `harmonic_balance.Equations`.

    Unknowns x (n, 34) are the coefficients of z1, then those of z2 [m].

    Attributes:
        theta: (n, 22) parameters by their place `AT`.
        omega: (n,) fundamental [rad/s].
        base: (n, 8) harmonics of the base [m/s^2].
    """

    theta: Array
    omega: Array
    base: Array

    @cached_property
    def s(self) -> Array:
        """i h omega at each harmonic (n, 8)."""
        return 1j * self.omega[:, None] * np.arange(1, HARMONICS + 1)

    def __getitem__(self, rows: Array) -> "Feet":
        return Feet(self.theta[rows], self.omega[rows], self.base[rows])

    def _masses(self) -> tuple[Array, Array]:
        """M(s) (n, 8) and m_F (n, 1)."""
        m_S, m_F, w, f_w, zeta = (
            self.theta[:, AT[name], None] for name in ("m_S", "m_F", "w", "f_w", "zeta_w")
        )
        return m_S * (1 - w + w * hung(self.s, f_w, zeta)), m_F

    def _inertia(self, Z: Array) -> Array:
        """Forces (n, 34) of the masses at harmonics Z (n, 2, 8) of the motion."""
        (M, m_F), s2 = self._masses(), self.s**2
        forces = M * (s2 * Z.sum(1) + self.base), m_F * (s2 * Z[:, 1] + self.base)
        return SERIES.real(np.stack(forces, 1)).reshape(len(self.omega), -1)

    def _joints(self, x: Array) -> tuple[Array, Array, Array]:
        """Forces of ankle and pad (n, 2, 32), and their slopes in stretch and rate."""
        k, c_1, c_2, c_3, b, p, d = np.moveaxis(self.theta[:, _JOINTS], -1, 0)[..., None]
        z, v, _ = SERIES.at(x.reshape(-1, 2, SERIES.size))
        v *= self.omega[:, None, None]
        grown = np.expm1(b * z)
        spring, decay = np.where(b == 0, z, grown / np.where(b == 0, 1.0, b)), np.exp(-c_2 * z)
        shape, slope = spring + p * z**2 + d * z**3, 1 + grown + 2 * p * z + 3 * d * z**2
        c, falls = c_1 * decay * np.cos(c_3 * z), c_1 * decay * np.sin(c_3 * z)
        return k * shape + c * v, k * slope - (c_2 * c + c_3 * falls) * v, c  # Eq. (4.25)

    def _forces(self, x: Array) -> Array:
        """What is not balanced (n, 34) [N]."""
        ankle, pad = SERIES.project(self._joints(x)[0]).swapaxes(0, 1)
        return np.concatenate([ankle, pad - ankle], axis=-1) + self._inertia(_harmonics(x))

    def residual(self, x: Array, rows: Array) -> Array:
        """What is not balanced [N], (b, 34), in some of the feet."""
        return self[rows]._forces(x)

    def jacobian(self, x: Array, rows: Array) -> Array:
        """Its derivative (b, 34, 34)."""
        feet = self[rows]
        (_, stiff, damp), (M, m_F), s2 = feet._joints(x), feet._masses(), feet.s**2
        T, F = SERIES.tangent(
            np.stack([stiff, feet.omega[:, None, None] * damp, 0 * damp])
        ).swapaxes(0, 1)
        by_mass = np.stack([M * s2, m_F * s2], axis=1)
        shank, foot = SERIES.dynamic(np.pad(by_mass, ((0, 0), (0, 0), (1, 0)))).swapaxes(0, 1)
        return np.concatenate(
            [np.concatenate([T + shank, shank], -1), np.concatenate([-T, F + foot], -1)], -2
        )

    def size(self, x: Array) -> Array:
        """Norm of unknowns by the accelerations of their harmonics, (n,)."""
        signals = x.reshape(len(x), 2, -1) * np.maximum(1, SERIES.order) ** 2
        return np.linalg.norm(signals, axis=(1, 2))

    def solve(self, start: Array | None = None) -> tuple[Array, Array]:
        """Motions (n, 34) and which there are (n,); from rest where a start leads to none."""
        rest = np.zeros((len(self.omega), 2 * SERIES.size))
        x, _, converged = newton(self, rest if start is None else start, tight=_TIGHT)
        if start is not None and not converged.all():
            x[~converged] = 0.0
            x, _, converged = newton(self, x, tight=_TIGHT)
        return np.where(converged[:, None], x, 0.0), converged

    def shank(self, x: Array) -> Array:
        """Harmonics (n, 8) of the shank's acceleration [m/s^2]."""
        return self.s**2 * _harmonics(x).sum(1) + self.base

    def by_parameters(self, x: Array) -> Array:
        """Derivatives (n, 8, 22) of the shank's acceleration at motions x."""
        left = []
        for step, nudge in zip(np.diag(_NUDGES), _NUDGES, strict=True):
            more, less = (replace(self, theta=self.theta + sign * step) for sign in (1, -1))
            left.append((more._forces(x) - less._forces(x)) / (2 * nudge))
        return self._following(x, np.stack(left))

    def by_base(self, x: Array) -> Array:
        """Derivatives (n, 8, 16) of the shank's acceleration to the base's harmonics, real parts first."""
        unit = np.concatenate([np.eye(HARMONICS), 1j * np.eye(HARMONICS)])
        still = np.zeros((len(x), 2, HARMONICS))
        left = [replace(self, base=np.tile(e, (len(x), 1)))._inertia(still) for e in unit]
        return self._following(x, np.stack(left)) + unit.T

    def _following(self, x: Array, left: Array) -> Array:
        """Change of the shank's acceleration (n, 8, p) with motions x that follow forces (p, n, 34)."""
        J = self.jacobian(x, np.arange(len(x)))
        moved = np.linalg.solve(J, -np.moveaxis(left, 0, -1))
        Z = _harmonics(np.moveaxis(moved, -1, 1).reshape(-1, x.shape[1])).sum(1)
        return self.s[..., None] ** 2 * np.swapaxes(Z.reshape(len(x), -1, HARMONICS), 1, 2)


def _harmonics(x: Array) -> Array:
    """Complex harmonics (n, 2, 8) of z1 and z2, of unknowns x (n, 34)."""
    return SERIES.complex(x.reshape(-1, 2, SERIES.size))


def under_load(values: Mapping[str, float], load_kg: float) -> dict[str, float]:
    """Constants by name, of which springs and dampers hold under a load [kg]."""
    v = dict(values)
    for e, names in FOLLOWING.items():
        for name in names:
            v[name] *= float(np.exp(v[e] * load_kg / LOAD_KG))
    return v


def felt(values: Mapping[str, float], hz: float, base: Array, load_kg: float = 0.0) -> Array:
    """What a malleolus' sensor feels of a rival, without its channel's gain and delay.

    Args:
        values: constants by name; masses without the load.
        hz: fundamental.
        base: (H,) harmonics of the base [m/s^2], at most 8.
        load_kg: on the knee, all of it carried.

    Returns:
        Harmonics (8,) of the acceleration [m/s^2].
    """
    v, omega = under_load(values, load_kg), 2 * np.pi * np.array([hz])
    v["w"] *= v["m_S"] / (v["m_S"] + load_kg)
    v["m_S"] += load_kg
    U = np.pad(base, (0, HARMONICS - len(base)))[None]
    if any(v[name] for name in EXTRA if name not in ("f_w", "zeta_w")):
        feet = Feet(np.array([[*parameters(v), *(v[name] for name in EXTRA)]]), omega, U)
        shank = feet.shank(feet.solve()[0])[0]
    else:
        shank = orbits(parameters(v)[None], omega, U, slopes=False).shank[0]
    s = 1j * omega * np.arange(1, HARMONICS + 1)
    return shank * hung(s, max(v["u"], 1e-12) ** -0.5, v["zeta_u"])


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Motions to start from: (C, R, 34) of `Feet`."""

    x: Array

    def rows(self, which: Array) -> "Coefficients":
        """Of some candidates."""
        return Coefficients(self.x[which])

    def replaced(self, other: "Coefficients", where: Array) -> "Coefficients":
        """With some candidates (C,) taken from another."""
        return Coefficients(np.where(where[:, None, None], other.x, self.x))


class RivalMotion(TwoMassMotion):
    """Motions of the two-mass foot with `EXTRA`, of which only `response` and `by_base` know."""

    def _feet(self, theta: Array) -> Feet:
        """Feet of candidates (C, R, 22), flat; the load is in their masses."""
        C = len(theta)
        return Feet(theta.reshape(-1, len(AT)), np.tile(self.omega, C), np.tile(self.base, (C, 1)))

    def response(self, theta: Array, near: Any) -> tuple[Array, Array, Array, Any]:
        """See `Motion`."""
        (C, R, P), feet = theta.shape, self._feet(theta)
        x, moves = feet.solve(None if near is None else near.x.reshape(C * R, -1))
        Y, D = feet.shank(x)[:, : self._count], feet.by_parameters(x)[:, : self._count]
        shape, lasts = (C, R, 1, self._count), np.asarray(moves.reshape(C, R).all(1))
        return Y.reshape(shape), D.reshape(*shape, P), lasts, Coefficients(x.reshape(C, R, -1))

    def by_base(self, theta: Array) -> Array:
        """See `Motion`."""
        feet = self._feet(theta[None])
        G = feet.by_base(feet.solve()[0])[:, : self._count]
        G = G[..., np.r_[: self._count, HARMONICS : HARMONICS + self._count]]
        return np.concatenate([G.real, G.imag], 1)[:, None]
