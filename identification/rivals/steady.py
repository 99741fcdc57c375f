"""The steady motion of the two-mass foot and of its rivals by harmonic balance, with derivatives.

One set of equations holds for every rival, and a rival is what of it differs from zero. With the motions z1 of the
ankle and z2 of the pad as harmonics, forces that bend (springs, dampers) are evaluated at instants of a period and
projected back; all that is linear is a number a harmonic, at s = i h omega:

    M(s) [s^2 (Z1 + Z2) + U] + N_T + k_T R(r_T) Z1 = 0
    m_F  [s^2 Z2 + U] - N_T - k_T R(r_T) Z1 + N_F + k_F R(r_F) Z2 = 0
    N   of  k [(exp(b z) - 1) / b + p z^2 + d z^3] + c_1 exp(-c_2 z) cos(c_3 z) z'
    R(r) = r s tau / (1 + s tau)                             a spring that relaxes (Zener)
    M(s) = load + m_S [1 - w + w T(s; f_w, zeta_w)]          a share w of the shank hangs on a spring
    T(s; f, zeta) = (1 + 2 zeta s / W) / (1 + 2 zeta s / W + (s / W)^2), W = 2 pi f

What the sensor gives is Y = [s^2 (Z1 + Z2) + U] T(s; 1 / sqrt(u), zeta_u) (1 + gain + drift x) exp(-s delay), with x
from -1/2 to 1/2 over a session. Springs and dampers may follow the load: k_T, c_11 times exp(e_T load / 2.3 kg), and
so for the pad.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fasbody.foot.harmonic_balance import Fourier, newton

Array = np.ndarray
#: Constants in the order of arrays.
CONSTANTS = (
    "k_T", "k_F", "c_11", "c_12", "c_13", "c_21", "c_22", "c_23", "b_T", "p_T", "d_T", "b_F", "p_F", "d_F", "r_T",
    "r_F", "tau", "w", "f_w", "zeta_w", "m_S", "m_F", "e_T", "e_F", "u", "zeta_u", "gain", "drift", "delay",
)  # fmt: skip
INDEX = {name: i for i, name in enumerate(CONSTANTS)}
#: Differences for derivatives: large against rounding, small against what bends a response by 1e-7.
_NUDGES = np.array([
    10, 10, 0.05, 0.02, 0.02, 0.05, 0.02, 0.02, 0.02, 0.02, 50, 0.02, 0.02, 50, 1e-4,
    1e-4, 5e-7, 1e-4, 2e-3, 2e-5, 1e-4, 1e-4, 1e-4, 1e-4, 1e-10, 1e-5, 1e-4, 1e-4, 1e-7,
])  # fmt: skip
#: Harmonics of the motion, and instants of a period.
HARMONICS, INSTANTS = 8, 32
#: Load to which e_T and e_F refer [kg].
LOAD_KG = 2.3
SERIES = Fourier(HARMONICS, INSTANTS)
#: Constants of ankle and pad.
_JOINTS = np.array([
    [INDEX[name] for name in names]
    for names in (("k_T", "c_11", "c_12", "c_13", "b_T", "p_T", "d_T", "e_T"),
                  ("k_F", "c_21", "c_22", "c_23", "b_F", "p_F", "d_F", "e_F"))
])  # fmt: skip
_SIZE = 2 * SERIES.size
#: Size of a last step over the motion: what is left is the square of it.
_TIGHT = 1e-8


@dataclass(frozen=True, eq=False)
class Feet:
    """One foot for each recording, with separate constants: `harmonic_balance.Equations`.

    Unknowns (n, 34) are the coefficients of z1, then those of z2 [m].

    Attributes:
        constants: (n, 29) in the order of `CONSTANTS`.
        loads_kg, hz, places: (n,) load on the knee, fundamental, place in the session from -1/2 to 1/2.
        U: (n, 8) complex harmonics of the base [m/s^2], from the first.
    """

    constants: Array
    loads_kg: Array
    hz: Array
    places: Array
    U: Array

    @classmethod
    def of(cls, constants: Array, loads_kg: Array, hz: Array, places: Array, U: Array) -> "Feet":
        """Feet of the same constants (29,) in recordings (n,) with base harmonics (n, H), H at most 8."""
        more = HARMONICS - U.shape[1]
        return cls(np.tile(constants, (len(hz), 1)), loads_kg, hz, places, np.pad(U, ((0, 0), (0, more))))

    def __len__(self) -> int:
        return len(self.hz)

    @cached_property
    def s(self) -> Array:
        """i h omega at each harmonic, (n, 8)."""
        return 2j * np.pi * self.hz[:, None] * np.arange(1, HARMONICS + 1)

    def _v(self, *names: str) -> list[Array]:
        """Constants by name, each (n, 1)."""
        return [self.constants[:, INDEX[name], None] for name in names]

    @cached_property
    def _joints(self) -> Array:
        """Constants of both joints (8, n, 2, 1), k and c_1 as the load makes them."""
        constants = np.moveaxis(self.constants[:, _JOINTS], -1, 0)[..., None].copy()
        constants[:2] *= np.exp(constants[-1] * self.loads_kg[:, None, None] / LOAD_KG)
        return constants

    @cached_property
    def _stiffness(self) -> tuple[Array, Array, Array, Array]:
        """M(s) and the relaxing stiffness of ankle and pad at each harmonic, (n, 8), and m_F."""
        r_T, r_F, tau, m_S, m_F = self._v("r_T", "r_F", "tau", "m_S", "m_F")
        w, f_w, zeta = self._v("w", "f_w", "zeta_w")
        k, relax = self._joints[0], self.s * tau / (1 + self.s * tau)
        ratio = self.s / (2 * np.pi * f_w)
        hangs = (1 + 2 * zeta * ratio) / (1 + 2 * zeta * ratio + ratio**2)
        M = self.loads_kg[:, None] + m_S * (1 - w + w * hangs)
        return M, r_T * k[:, 0] * relax, r_F * k[:, 1] * relax, m_F

    @cached_property
    def _linear(self) -> Array:
        """Matrix (n, 34, 34) from motion to the forces that are linear."""
        (M, T, F, m_F), s2 = self._stiffness, self.s**2
        Z = np.stack([M * s2 + T, M * s2, -T, m_F * s2 + F], axis=1)
        blocks = SERIES.dynamic(np.pad(Z, ((0, 0), (0, 0), (1, 0))))
        blocks = blocks.reshape(-1, 2, 2, SERIES.size, SERIES.size).swapaxes(2, 3)
        return blocks.reshape(-1, _SIZE, _SIZE)

    @cached_property
    def _shaken(self) -> Array:
        return self._inertia(np.zeros((len(self), _SIZE)))

    def _inertia(self, x: Array) -> Array:
        """Forces that are linear in motions x (n, 34) and in the base, (n, 34)."""
        (Z1, Z2), s2, (M, T, F, m_F) = _harmonics(x), self.s**2, self._stiffness
        one = M * (s2 * (Z1 + Z2) + self.U) + T * Z1
        two = m_F * (s2 * Z2 + self.U) - T * Z1 + F * Z2
        return SERIES.real(np.stack([one, two], axis=1)).reshape(-1, _SIZE)

    def _bent(self, x: Array, rows: Array, whole: bool = False) -> tuple[Array, ...]:
        """Force of the joints (n, 2, 32), its slopes in stretch and rate, and (8, n, 2, 32) in constants."""
        k, c_1, c_2, c_3, b, p, d, _ = self._joints[:, rows]
        z, v, _ = SERIES.at(x.reshape(-1, 2, SERIES.size))
        v *= 2 * np.pi * self.hz[rows, None, None]
        grown, over = np.expm1(b * z), np.where(b == 0, 1.0, b)
        spring, decay = np.where(b == 0, z, grown / over), np.exp(-c_2 * z)
        shape, slope = spring + p * z**2 + d * z**3, 1 + grown + 2 * p * z + 3 * d * z**2
        c, falls = decay * np.cos(c_3 * z), c_1 * decay * np.sin(c_3 * z)
        force = k * shape + c_1 * c * v  # Eq. (4.25) beside the spring
        stiff = k * slope - (c_2 * c_1 * c + c_3 * falls) * v
        if not whole:
            return force, stiff, c_1 * c
        series, small = z**2 / 2 + b * z**3 / 3, np.abs(b * z) < 1e-5
        bends = np.where(small, series, (z * (1 + grown) - spring) / over)
        by = shape, c * v, -c_1 * z * c * v, -z * falls * v, k * bends, k * z**2, k * z**3
        follows = self.loads_kg[rows, None, None] / LOAD_KG
        up = np.exp(self._joints[-1, rows] * follows)
        return force, stiff, c_1 * c, np.stack([up * by[0], up * by[1], *by[2:], force * follows])

    def residual(self, x: Array, rows: Array) -> Array:
        """What is not balanced [N], (n, 34), in some of the feet."""
        joints = _between(SERIES.project(self._bent(x, rows)[0]))
        return joints + (self._linear[rows] @ x[..., None])[..., 0] + self._shaken[rows]

    def jacobian(self, x: Array, rows: Array) -> Array:
        """Its derivative, (n, 34, 34)."""
        _, stiff, damp = self._bent(x, rows)
        rate = 2 * np.pi * self.hz[rows, None, None]
        T, F = SERIES.tangent(np.stack([stiff, rate * damp, 0 * damp])).swapaxes(0, 1)
        J, n = self._linear[rows], SERIES.size
        J[:, :n, :n] += T
        J[:, n:, :n] -= T
        J[:, n:, n:] += F
        return J

    def size(self, x: Array) -> Array:
        """Norm of unknowns by the accelerations of their harmonics, (n,)."""
        signals = x.reshape(len(x), 2, -1) * np.maximum(1, SERIES.order) ** 2
        return np.linalg.norm(signals, axis=(1, 2))

    def solve(self, start: Array) -> tuple[Array, Array]:
        """Motions (n, 34) and which there are, (n,); from rest where a start leads to none."""
        x, _, converged = newton(self, start, tight=_TIGHT)
        if not converged.all():
            x[~converged] = 0.0
            x, _, converged = newton(self, x, tight=_TIGHT)
        x[~converged] = 0.0
        return x, converged

    def felt(self, x: Array) -> Array:
        """What the malleolus' sensor gives of motions (n, 34): harmonics (n, 8) [m/s^2]."""
        u, zeta, gain, drift, delay = self._v("u", "zeta_u", "gain", "drift", "delay")
        f = self.s.imag / (2 * np.pi)
        above = 1 + 2j * zeta * f * np.sqrt(np.abs(u))
        chain = (1 + gain + drift * self.places[:, None]) * np.exp(-self.s * delay)
        return (self.s**2 * sum(_harmonics(x)) + self.U) * above / (above - f**2 * u) * chain

    def by_constants(self, x: Array) -> Array:
        """Derivatives (n, 8, 29) of the sensed acceleration at motions x (n, 34)."""
        nudges = np.diag(_NUDGES)
        many = self._copies(2 * len(nudges))
        nudged = many.constants + np.repeat(np.concatenate([nudges, -nudges]), len(x), axis=0)
        differences = self._differences(x, replace(many, constants=nudged))
        left, felt = (half / _NUDGES[:, None, None] for half in differences)
        by = SERIES.project(self._bent(x, np.arange(len(x)), whole=True)[-1])
        for joint, constants in enumerate(_JOINTS):
            left[constants] += _between(by * (np.arange(2) == joint)[:, None])
        return self._following(x, left, felt)

    def by_base(self, x: Array) -> Array:
        """Derivatives (n, 8, 16) of the sensed acceleration to the base's harmonics, real parts first."""
        unit = np.concatenate([np.eye(HARMONICS), 1j * np.eye(HARMONICS)])
        many = self._copies(2 * len(unit))
        nudged = many.U + np.repeat(np.concatenate([unit, -unit]), len(x), axis=0)
        return self._following(x, *self._differences(x, replace(many, U=nudged)))

    def _copies(self, count: int) -> "Feet":
        """The same feet so many times, one after the other."""
        fields = (getattr(self, name) for name in self.__dataclass_fields__)
        return Feet(*(np.concatenate([field] * count) for field in fields))

    def _differences(self, x: Array, many: "Feet") -> tuple[Array, Array]:
        """Half of what p copies of the feet have more than p others, at motions x that stay.

        Returns:
            Forces that are linear (p, n, 34), and sensed accelerations (p, n, 8).
        """
        still, shape = np.tile(x, (len(many) // len(x), 1)), (2, -1, len(x))
        force = many._inertia(still).reshape(*shape, _SIZE)
        felt = many.felt(still).reshape(*shape, HARMONICS)
        return (force[0] - force[1]) / 2, (felt[0] - felt[1]) / 2

    def _following(self, x: Array, left: Array, felt: Array) -> Array:
        """Change of the sensed acceleration (n, 8, p): motions x follow residual forces, `felt` (p, n, 8) is direct."""
        moved = np.linalg.solve(self.jacobian(x, np.arange(len(x))), -np.moveaxis(left, 0, -1))
        many = replace(self, U=0 * self.U)._copies(len(left))  # felt is linear in x and U
        follows = many.felt(np.moveaxis(moved, -1, 0).reshape(-1, _SIZE))
        return np.moveaxis(felt + follows.reshape(felt.shape), 0, -1)


def _harmonics(x: Array) -> Array:
    """Complex harmonics (2, n, 8) of z1 and z2, of unknowns x (n, 34)."""
    return SERIES.complex(x.reshape(-1, 2, SERIES.size)).swapaxes(0, 1)


def _between(joints: Array) -> Array:
    """Forces on shank and foot (..., 34) of ankle and pad (..., 2, 17)."""
    ankle, pad = joints[..., 0, :], joints[..., 1, :]
    return np.concatenate([ankle, pad - ankle], axis=-1)
