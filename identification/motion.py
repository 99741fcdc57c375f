"""What moves under a candidate's parameters: the two-mass foot in closed form, or any MJCF on the engine's dynamics."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.rest import carrier, mass_on_table
from fasbody.foot.steady_state import Balance, Orbit
from fasbody.foot.two_mass import Orbits, orbits
from identification.harmonics import Measured

#: Harmonics of a motion, where no more are measured, and instants of a period.
_HARMONICS, _INSTANTS = 6, 128


def _drives(measured: Measured) -> np.ndarray:
    """(R, H) harmonics of the base; a line that is no more than noise moves nothing."""
    base = measured.base.copy()
    quiet = np.abs(base) < 4 * measured.base_std
    quiet[:, 0] = False
    base[quiet] = 0.0
    return base


class Motion(Protocol):
    """What moves: harmonics of the sensors' accelerations and their derivatives.

    Attributes:
        base: (R, H) harmonics that drive it [m/s^2].
        carrier: name of what the foot stands on the table by.
    """

    base: np.ndarray
    carrier: str

    def weight_kg(self, theta: np.ndarray) -> float:
        """Mass [kg] that the table carries, of one recording's parameters (P,)."""

    def response(self, theta: np.ndarray, near: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """Of C candidates (C, R, P).

        Returns:
            accelerations (C, R, S, H) [m/s^2], their derivatives (C, R, S, H, P), whether a candidate has a motion in
            every recording (C,), and what makes the next response quicker.
        """

    def states(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (R, S, H) [m/s^2] and states at time zero (R, s) of one candidate (R, P)."""

    def table_force(self, theta: np.ndarray) -> list[np.ndarray]:
        """Force [N] of the table on what stands on it over a period (n,), without its mean, in each recording."""

    def multipliers(self, theta: np.ndarray) -> np.ndarray:
        """(R,) largest modulus of the Floquet multipliers; above 1 a motion does not last."""

    def by_base(self, theta: np.ndarray) -> np.ndarray:
        """(R, S, 2 H, 2 H) derivatives of the accelerations of one candidate (R, P) to the base's harmonics."""


@dataclass(frozen=True, eq=False)
class Near:
    """Motions to start from: parameters (C, R, P), stretches (C, R, 2, H), and their slopes (C, R, 2, H, P)."""

    theta: np.ndarray
    stretch: np.ndarray
    slopes: np.ndarray

    def rows(self, which: np.ndarray) -> "Near":
        """Of some candidates."""
        return Near(self.theta[which], self.stretch[which], self.slopes[which])

    def replaced(self, other: "Near", where: np.ndarray) -> "Near":
        """With some candidates (C,) taken from another."""
        pairs = ((getattr(other, name), getattr(self, name)) for name in ("theta", "stretch", "slopes"))
        return Near(*(np.where(where.reshape(-1, *[1] * (b.ndim - 1)), a, b) for a, b in pairs))

    def at(self, theta: np.ndarray) -> np.ndarray:
        """Stretches (C, R, 2, H) at other parameters (C, R, P), to first order where that is not far."""
        moved = (self.slopes @ (theta - self.theta)[:, :, None, :, None])[..., 0]
        near = np.abs(moved).max((2, 3)) < 0.5 * np.abs(self.stretch).max((2, 3))
        return np.where(near[..., None, None], self.stretch + moved, self.stretch)


class TwoMassMotion:
    """Motions of the two-mass foot, in closed harmonic balance.

    Args:
        measured: what moves the base.
        omega: (R,) [rad/s].
        on_foot: (S,) whether a sensor sits on the foot's mass.
        harmonics: of the motion, at least those measured.
    """

    def __init__(self, measured: Measured, omega: np.ndarray, on_foot: Sequence[bool], harmonics: int = 0) -> None:
        self._count = measured.base.shape[1]
        H = max(self._count, harmonics, _HARMONICS)
        self.base = np.zeros((len(omega), H), complex)
        self.base[:, : self._count] = _drives(measured)
        self.omega, self.on_foot = omega, np.array(on_foot, bool)

    carrier = "fat_pad"

    def weight_kg(self, theta: np.ndarray) -> float:
        """See `Motion`."""
        return float(theta[8] + theta[9])

    def with_harmonics(self, harmonics: int) -> "TwoMassMotion":
        """The same with more harmonics."""
        more = copy.copy(self)
        more.base = np.zeros((len(self.omega), harmonics), complex)
        more.base[:, : self.base.shape[1]] = self.base
        return more

    def orbits(self, theta: np.ndarray, near: Near | None = None, slopes: bool = True) -> Orbits:
        """Motions of candidates (C, R, P), flat (C R,)."""
        C, R, P = theta.shape
        many = C > 1  # only a few of them go on; what is left of a motion is the square of the tolerance
        tolerance = 1e-3 if many else 1e-10 if near is None else 1e-5
        return orbits(
            theta.reshape(C * R, P), np.tile(self.omega, C), np.tile(self.base, (C, 1)),
            None if near is None else near.at(theta).reshape(C * R, 2, -1),
            slopes=slopes, passes=8 if many else 30, tolerance=tolerance,
        )  # fmt: skip

    def response(self, theta: np.ndarray, near: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """See `Motion`."""
        C, R, P = theta.shape
        motions = self.orbits(theta, near)
        slopes = motions.slopes
        assert slopes is not None and motions.stretch_slopes is not None
        masses = np.stack([motions.shank, motions.foot], 1)
        which = self.on_foot.astype(int)
        Y = masses[:, which, : self._count].reshape(C, R, len(which), self._count)
        D = slopes[:, which, : self._count].reshape(C, R, len(which), self._count, P)
        H = self.base.shape[1]
        memory = Near(theta, motions.stretch.reshape(C, R, 2, H), motions.stretch_slopes.reshape(C, R, 2, H, P))
        moves = np.asarray(motions.converged.reshape(C, R).all(1))
        return Y, D, moves, memory

    def table_force(self, theta: np.ndarray) -> list[np.ndarray]:
        """See `Motion`: what the two masses' accelerations take."""
        motions = self.orbits(theta[None], slopes=False)
        m_S, m_F = theta[:, 8:9], theta[:, 9:10]
        F = m_S * motions.shank + m_F * motions.foot
        k = np.arange(1, F.shape[1] + 1)
        turning = np.exp(2j * np.pi * np.outer(k, np.arange(_INSTANTS)) / _INSTANTS)
        return list((F @ turning).real)

    def multipliers(self, theta: np.ndarray) -> np.ndarray:
        """See `Motion`."""
        return self.orbits(theta[None], slopes=False).multipliers()

    def states(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Motion`: states are z_1, z_2 [m], their rates [m/s], and what relaxes [N]."""
        motions = self.orbits(theta[None], slopes=False)
        masses = np.stack([motions.shank, motions.foot], 1)
        return masses[:, self.on_foot.astype(int)], np.concatenate([motions.states(), motions.memories()], 1)

    def by_base(self, theta: np.ndarray) -> np.ndarray:
        """See `Motion`."""
        motions = self.orbits(theta[None], slopes=False)
        G = motions.by_base()[:, self.on_foot.astype(int)]
        H = self.base.shape[1]
        at = np.r_[: self._count, H : H + self._count]
        return G[:, :, at][..., at]


@dataclass(frozen=True, eq=False)
class Orbiting:
    """Motions of a model to start from: (C, R) of `Orbit`, None where there is none."""

    orbits: np.ndarray

    def rows(self, which: np.ndarray) -> "Orbiting":
        """Of some candidates."""
        return Orbiting(self.orbits[which])

    def replaced(self, other: "Orbiting", where: np.ndarray) -> "Orbiting":
        """With some candidates (C,) taken from another."""
        return Orbiting(np.where(where[:, None], other.orbits, self.orbits))


#: Candidates whose motions are kept.
_RECENT = 8


class EngineMotion:
    """Motions of any MJCF foot, by harmonic balance on MuJoCo's own inverse dynamics.

    Args:
        foot: the model.
        measured: what moves the base.
        omega: (R,) [rad/s].
        names: of a motion's parameters.
    """

    def __init__(self, foot: Foot, measured: Measured, omega: np.ndarray, names: Sequence[str]) -> None:
        self._balance, self._names = Balance(foot, measured.sensors), tuple(names)
        self._sensors, self._count = measured.sensors, measured.base.shape[1]
        self.base, self._frequency = _drives(measured), omega / (2 * np.pi)
        self._recent: dict[tuple[int, bytes], Orbit] = {}
        self._foot, self.carrier = foot, carrier(foot)

    def weight_kg(self, theta: np.ndarray) -> float:
        """See `Motion`."""
        return mass_on_table(self._foot.with_values(dict(zip(self._names, map(float, theta), strict=True))))

    def _orbit(self, r: int, theta: np.ndarray, near: Orbit | None = None) -> Orbit:
        """The motion of one recording at parameters (P,); recent ones are kept, with their derivatives."""
        key = r, theta.tobytes()
        if key not in self._recent:
            values = dict(zip(self._names, map(float, theta), strict=True))
            self._recent[key] = self._balance.orbit(float(self._frequency[r]), self.base[r], values, near)
            if len(self._recent) > _RECENT * len(self._frequency):
                del self._recent[next(iter(self._recent))]
        return self._recent[key]

    def _all(self, theta: np.ndarray) -> list[Orbit]:
        """The motion of one candidate (R, P) in each recording."""
        return [self._orbit(r, row) for r, row in enumerate(theta)]

    def _read(self, orbit: Orbit) -> np.ndarray:
        """(S, H) of the sensors."""
        Y = np.zeros((len(self._sensors), self._count), complex)
        for s, name in enumerate(self._sensors):
            H = orbit.harmonics(name)[: self._count]
            Y[s, : H.size] = H
        return Y

    def response(self, theta: np.ndarray, near: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """See `Motion`."""
        C, R, P = theta.shape
        shape = (C, R, len(self._sensors), self._count)
        Y, D, moves = np.zeros(shape, complex), np.zeros((*shape, P), complex), np.ones(C, bool)
        orbits = np.full((C, R), None, object)
        for c in range(C):
            for r in range(R):
                try:
                    orbit = self._orbit(r, theta[c, r], near.orbits[c, r] if near is not None else None)
                    slopes = self._balance.derivatives(orbit, self._names)
                except SimulationError:
                    moves[c] = False
                    break
                orbits[c, r], Y[c, r] = orbit, self._read(orbit)
                for s, name in enumerate(self._sensors):
                    part = slopes[name][: self._count]
                    D[c, r, s, : len(part)] = part
        return Y, D, moves, Orbiting(orbits)

    def states(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Motion`: positions from rest, velocities and activations, without the base."""
        rows, Y = [], []
        model, base = self._balance.model, self._balance.base
        for orbit in self._all(theta):
            qpos, qvel, act = orbit.initial_state()
            rows.append(np.concatenate([np.delete(qpos - model.qpos0, base), np.delete(qvel, base), act]))
            Y.append(self._read(orbit))
        return np.stack(Y), np.stack(rows)

    def table_force(self, theta: np.ndarray) -> list[np.ndarray]:
        """See `Motion`."""
        return [orbit.table_force_n for orbit in self._all(theta)]

    def multipliers(self, theta: np.ndarray) -> np.ndarray:
        """See `Motion`."""
        return np.array([np.abs(orbit.multipliers[0]) for orbit in self._all(theta)])

    def by_base(self, theta: np.ndarray) -> np.ndarray:
        """See `Motion`."""
        n = self._count
        G = np.zeros((len(theta), len(self._sensors), 2 * n, 2 * n))
        for r, orbit in enumerate(self._all(theta)):
            slopes = self._balance.base_derivatives(orbit)
            for s, name in enumerate(self._sensors):
                part = slopes[name][:n]
                G[r, s, : len(part)], G[r, s, n : n + len(part)] = part.real, part.imag
        return G
