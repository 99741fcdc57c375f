"""The residual of steady recordings: whitened harmonics of all sensors, and a row for each prior.

Following Pintelon and Schoukens, a periodic recording is worth its harmonics: 2 H numbers a sensor with known variances.
Their noise is that of the sensor, that of the base seen through the model, and the scatter from one recording to the
next: a person sits down anew, and repeats to some per cent of each harmonic. Of a true model the sum of squares is
chi-square distributed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from fasbody.foot.two_mass import Orbits, orbits
from identification.harmonics import Line
from identification.parameters import Variables

#: Noise below this share of the amplitude is not believed: clocks and models are not that good.
_NOISE_FLOOR = 1e-7
#: Harmonics of a motion, where no more are measured.
_HARMONICS = 6
#: Every residual where there is no motion.
NO_MOTION = 1e6


@dataclass(frozen=True, eq=False)
class Measured:
    """Harmonics of R recordings by S sensors; what a recording has not is not valid.

    Attributes:
        lines: the recordings' harmonics.
        sensors: names, the malleolus first.
        base: (R, H) complex harmonics of the base [m/s^2].
        base_std: (R, H) noise of a real or imaginary part.
        output: (R, S, H) of the sensors.
        output_std: (R, S, H) noise.
        valid: (R, S, H) which were measured.
    """

    lines: Sequence[Line]
    sensors: tuple[str, ...]
    base: np.ndarray
    base_std: np.ndarray
    output: np.ndarray
    output_std: np.ndarray
    valid: np.ndarray

    @classmethod
    def of(cls, lines: Sequence[Line], sensors: Sequence[str]) -> "Measured":
        """Arrays from the harmonics of recordings."""
        H, R = max(line.count for line in lines), len(lines)
        base, base_std = np.zeros((R, H), complex), np.zeros((R, H))
        output, output_std = np.zeros((R, len(sensors), H), complex), np.ones((R, len(sensors), H))
        valid = np.zeros((R, len(sensors), H), bool)
        for r, line in enumerate(lines):
            base[r, : line.count], base_std[r, : line.count] = line.base.amplitudes, _std(line.base)
            for name, channel in line.sensors.items():
                s = list(sensors).index(name)
                output[r, s, : line.count], output_std[r, s, : line.count] = channel.amplitudes, _std(channel)
                valid[r, s, : line.count] = True
        return cls(lines, tuple(sensors), base, base_std, output, output_std, valid)

    @property
    def size(self) -> int:
        """How many real numbers were measured."""
        return 2 * int(self.valid.sum())

    @cached_property
    def rows(self) -> np.ndarray:
        """(R, 2 S H) which rows of a recording's residual, real parts before imaginary ones, are numbers."""
        flat = self.valid.reshape(len(self.lines), -1)
        return np.concatenate([flat, flat], 1)


def _std(channel: Any) -> np.ndarray:
    return np.maximum(channel.std, _NOISE_FLOOR * np.abs(channel.amplitudes[0]))


class Motion(Protocol):
    """What moves: harmonics of the sensors' accelerations and their derivatives.

    Attributes:
        base: (R, H) harmonics that drive it [m/s^2].
    """

    base: np.ndarray

    def response(self, theta: np.ndarray, near: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """Of C candidates (C, R, P).

        Returns:
            accelerations (C, R, S, H) [m/s^2], their derivatives (C, R, S, H, P), whether a candidate has a motion in
            every recording (C,), and what makes the next response quicker.
        """

    def states(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (R, S, H) [m/s^2] and states at time zero (R, s) of one candidate (R, P)."""

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
        measured: what moves the base. omega: (R,) [rad/s]. on_foot: (S,) whether a sensor sits on the foot's mass.
        harmonics: of the motion, at least those measured.
    """

    def __init__(self, measured: Measured, omega: np.ndarray, on_foot: Sequence[bool], harmonics: int = 0) -> None:
        self._count = measured.base.shape[1]
        H = max(self._count, harmonics, _HARMONICS)
        self.base = np.zeros((len(omega), H), complex)
        self.base[:, : self._count] = measured.base
        # a line of the base that is no more than noise moves nothing
        quiet = np.abs(measured.base) < 4 * measured.base_std
        quiet[:, 0] = False
        self.base[:, : self._count][quiet] = 0.0
        self.omega, self.on_foot = omega, np.array(on_foot, bool)

    def orbits(self, theta: np.ndarray, near: Near | None = None, slopes: bool = True) -> Orbits:
        """Motions of candidates (C, R, P), flat (C R,)."""
        C, R, P = theta.shape
        many = C > 1  # a screening: what is left of a motion is the square of the tolerance
        return orbits(
            theta.reshape(C * R, P), np.tile(self.omega, C), np.tile(self.base, (C, 1)),
            None if near is None else near.at(theta).reshape(C * R, 2, -1),
            slopes=slopes, passes=8 if many else 30, tolerance=1e-3 if many else 1e-6,
        )  # fmt: skip

    def response(self, theta: np.ndarray, near: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """See `Motion`."""
        C, R, P = theta.shape
        found = self.orbits(theta, near)
        assert found.slopes is not None and found.stretch_slopes is not None
        both = np.stack([found.shank, found.foot], 1)[:, :, : self._count]
        slopes = found.slopes[:, :, : self._count]
        which = self.on_foot.astype(int)
        Y = both[:, which].reshape(C, R, len(which), self._count)
        D = slopes[:, which].reshape(C, R, len(which), self._count, P)
        H = self.base.shape[1]
        memory = Near(theta, found.stretch.reshape(C, R, 2, H), found.stretch_slopes.reshape(C, R, 2, H, P))
        return Y, D, found.converged.reshape(C, R).all(1), memory

    def states(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Motion`: states are z_1, z_2 [m], their rates [m/s], and what relaxes [N]."""
        found = self.orbits(theta[None], slopes=False)
        both = np.stack([found.shank, found.foot], 1)
        return both[:, self.on_foot.astype(int)], np.concatenate([found.states(), found.memories()], 1)

    def by_base(self, theta: np.ndarray) -> np.ndarray:
        """See `Motion`."""
        found = self.orbits(theta[None], slopes=False)
        G = found.by_base()[:, self.on_foot.astype(int)]
        H = self.base.shape[1]
        at = np.r_[: self._count, H : H + self._count]
        return G[:, :, at][..., at]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Residuals (C, m) and derivatives (C, m, n) of C candidates, which of them move (C,), and their motions."""

    residual: np.ndarray
    jacobian: np.ndarray
    moves: np.ndarray
    memory: Any

    @property
    def objective(self) -> np.ndarray:
        """(C,) sum of squares."""
        return np.einsum("cm,cm->c", self.residual, self.residual)

    def rows(self, which: np.ndarray) -> "Evaluation":
        """Some of the candidates."""
        memory = None if self.memory is None else self.memory.rows(which)
        return Evaluation(self.residual[which], self.jacobian[which], self.moves[which], memory)

    def replaced(self, other: "Evaluation", where: np.ndarray) -> "Evaluation":
        """With some candidates (C,) taken from another."""
        return Evaluation(
            np.where(where[:, None], other.residual, self.residual),
            np.where(where[:, None, None], other.jacobian, self.jacobian),
            np.where(where, other.moves, self.moves),
            other.memory if self.memory is None else self.memory.replaced(other.memory, where),
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """Whitened residual of all recordings and priors, for candidates (C, n) of the search variable.

    Attributes:
        measured: the data. variables: what is searched. motion: what moves.
        repeatability: relative standard deviation of a harmonic from recording to recording.
        held: (n,) variables that stay at the mean of their priors.
        noise: (R, 2 S H, 2 S H) covariance of the sensors' and the base's noise.
    """

    measured: Measured
    variables: Variables
    motion: Motion
    repeatability: float
    held: np.ndarray
    noise: np.ndarray

    @classmethod
    def of(cls, measured: Measured, variables: Variables, motion: Motion, repeatability: float = 0.0) -> "Problem":
        """With the noise of the base as the measured transmissibility sees it."""
        gain = np.abs(measured.output[..., :1] / measured.base[:, None, :1])
        variance = measured.output_std**2 + (gain * measured.base_std[:, None]) ** 2
        flat = np.tile(variance.reshape(len(measured.lines), -1), 2)
        noise = flat[..., None] * np.eye(flat.shape[1])
        return cls(measured, variables, motion, repeatability, np.zeros(variables.size, bool), noise)

    # weights

    @cached_property
    def _whitener(self) -> np.ndarray:
        """(R, 2 S H, 2 S H) inverse of the Cholesky factor of the covariance; zero where nothing was measured."""
        scatter = (self.repeatability * np.abs(self.measured.output)).reshape(len(self.measured.lines), -1) ** 2
        W = np.zeros_like(self.noise)
        for r, rows in enumerate(self.measured.rows):
            at = np.flatnonzero(rows)
            S = self.noise[r][np.ix_(at, at)] + np.diag(np.tile(scatter[r], 2)[at])
            W[r][np.ix_(at, at)] = np.linalg.inv(np.linalg.cholesky(S))
        return W

    def weighed(self, q: np.ndarray) -> "Problem":
        """The same with the base's noise seen through the model at q (n,)."""
        variables, measured = self.variables, self.measured
        G = self.motion.by_base(variables.theta(q))
        T = self.channel(q[None], measured.base.shape[1])[0][0]  # (R, S, H)
        H, R, S = measured.base.shape[1], len(measured.lines), len(measured.sensors)
        turn = G[:, :, :H] + 1j * G[:, :, H:]  # complex response to real and imaginary parts
        turn = (T[..., None] * turn).reshape(R, S * H, 2 * H)
        G = np.concatenate([turn.real, turn.imag], 1)
        base = np.tile(measured.base_std**2, 2)
        own = np.tile((measured.output_std**2).reshape(R, -1), 2)
        noise = (G * base[:, None]) @ np.swapaxes(G, 1, 2) + own[..., None] * np.eye(own.shape[1])
        return replace(self, noise=noise)

    def with_repeatability(self, repeatability: float) -> "Problem":
        """The same with another scatter from recording to recording."""
        return replace(self, repeatability=repeatability)

    def with_held(self, held: np.ndarray) -> "Problem":
        """The same with variables (n,) held at the mean of their priors."""
        return replace(self, held=held)

    # what is searched

    @property
    def size(self) -> int:
        """How many real numbers were measured."""
        return self.measured.size

    def bounds(self, sign: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (n,) of one side of the mirror, 0 for both; the same twice where a variable is held."""
        low, high = self.variables.side(sign)
        mean, _ = self.variables.prior
        return np.where(self.held, mean, low), np.where(self.held, mean, high)

    def evaluate(self, Q: np.ndarray, near: Evaluation | None = None) -> Evaluation:
        """Residuals and derivatives of candidates Q (C, n)."""
        variables = self.variables
        theta = variables.theta(Q)
        Y, D, moves, memory = self.motion.response(theta, None if near is None else near.memory)
        by_theta = variables.slopes(variables.theta, Q)  # (C, R, P, n)
        dY = np.einsum("crshp,crpn->crshn", D, by_theta)
        read, dread = self._read(Q, Y, dY)
        e, J = read - self.measured.output, dread
        C, R = e.shape[:2]
        n = Q.shape[1]
        e, J = e.reshape(C, R, -1), J.reshape(C, R, -1, n)
        e, J = np.concatenate([e.real, e.imag], 2), np.concatenate([J.real, J.imag], 2)
        r = (self._whitener @ e[..., None])[..., 0][:, self.measured.rows]
        J = (self._whitener @ J)[:, self.measured.rows]
        mean, std = variables.prior
        known = np.isfinite(std) & ~self.held
        prior = ((Q - mean) / std)[:, known]
        rows = np.broadcast_to((np.eye(n) / std)[known], (C, int(known.sum()), n))
        r, J = np.concatenate([r, prior], 1), np.concatenate([J, rows], 1)
        J[..., self.held] = 0.0
        good = moves & np.isfinite(r).all(1) & np.isfinite(J).all((1, 2))
        r, J = np.where(good[:, None], r, NO_MOTION), np.where(good[:, None, None], J, 0.0)
        return Evaluation(r, J, good, memory)

    def whitened(self, read: np.ndarray) -> np.ndarray:
        """Residual (m,) of what sensors read (R, S, H), without the priors' rows."""
        e = (read - self.measured.output).reshape(len(read), -1)
        e = np.concatenate([e.real, e.imag], 1)
        return (self._whitener @ e[..., None])[..., 0][self.measured.rows]

    def predicted(self, q: np.ndarray) -> np.ndarray:
        """(R, S, H) what the sensors read at q (n,)."""
        Y, D, _, _ = self.motion.response(self.variables.theta(q[None]), None)
        n = q.size
        return self._read(q[None], Y, np.zeros((*Y.shape, n), complex))[0][0]

    # sensors

    def _read(self, Q: np.ndarray, Y: np.ndarray, dY: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What sensors read (C, R, S, H), and its derivatives (C, R, S, H, n), where they move by Y."""
        H = self.measured.base.shape[1]
        T, rock = self.channel(Q, H)
        moved = Y + rock
        dread = T[..., None] * dY
        variables = self.variables
        of_channel = [
            variables.place(item)
            for item in variables.nuisances
            if item.group in ("gain", "delay", "drift", "mount", "rocking")
        ]
        for i in of_channel:
            step = 1e-5 * np.eye(variables.size)[i]
            (T_up, rock_up), (T_down, rock_down) = self.channel(Q + step, H), self.channel(Q - step, H)
            dread[..., i] += (T_up * (Y + rock_up) - T_down * (Y + rock_down)) / 2e-5
        return T * moved, dread

    def channel(self, Q: np.ndarray, H: int) -> tuple[np.ndarray, np.ndarray]:
        """Gain (C, R, S, H) of each channel, and what rocking of the leg adds to the motion under its sensor."""
        v, measured = self.variables, self.measured
        R, S, _ = measured.output.shape
        base = np.zeros((R, H), complex)
        base[:, : measured.base.shape[1]] = measured.base[:, :H]
        f = (v.omega / (2 * np.pi))[:, None] * np.arange(1, H + 1)  # (R, H)
        shape = (len(Q), R, S, H)
        T, rock = np.ones(shape, complex), np.zeros(shape, complex)
        one = (slice(None), None, None)
        own = np.exp(v.value(Q, v.of_kind("rocking frequency"), np.log(60.0)))[one]
        ratio = v.value(Q, v.of_kind("rocking damping"), 0.1)[one]
        swing = base * f**2 / (own**2 - f**2 + 2j * ratio * own * f)
        for s, sensor in enumerate(measured.sensors):
            def of(kind: str, rest: float = 0.0, sensor: str = sensor) -> np.ndarray:
                return v.value(Q, v.of_kind(kind, sensor=sensor), rest)[one]

            softness, damping = np.maximum(of("mount"), 0.0), of("mount damping", 0.2)
            a = 1 + 2j * damping * f * np.sqrt(softness + 1e-16)
            gain = 1 + of("gain") + of("drift") * v.place_in_session[:, None]
            T[:, :, s] = gain * np.exp(-2j * np.pi * f * of("delay")) * a / (a - f**2 * softness)
            rock[:, :, s] = -of("rocking") * swing
        return T, rock
