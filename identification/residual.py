"""The residual of steady recordings: whitened harmonics of all sensors, and a row for each prior.

Following Pintelon and Schoukens, a periodic recording is worth its harmonics: 2 H numbers a sensor with known
variances. Their noise is that of the sensor, that of the base seen through the model, and the scatter from one
recording to the next: a person sits down anew, and repeats to some per cent of each harmonic. Of a true model the sum
of squares is chi-square distributed.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from identification.harmonics import Measured
from identification.motion import Motion
from identification.variables import Variables

#: Every residual where there is no motion.
NO_MOTION = 1e6
#: How far the logarithm of a spring may lie outside its bounds, as a standard deviation: next to nothing.
_WALL = 1e-5


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

    @property
    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        """J^T J (C, n, n) and J^T r (C, n)."""
        J = self.jacobian
        return np.swapaxes(J, 1, 2) @ J, np.einsum("cmn,cm->cn", J, self.residual)

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


@dataclass(frozen=True)
class Scatter:
    """What differs from one recording to the next.

    Attributes:
        harmonics: relative standard deviation of each harmonic, for itself.
        constants: standard deviation of the logarithm of each spring and damper.
    """

    harmonics: float = 0.0
    constants: float = 0.0

    def near(self, other: "Scatter", share: float) -> bool:
        """Whether it differs by no more than a share of another."""
        off = np.hypot(self.harmonics - other.harmonics, self.constants - other.constants)
        return bool(off <= share * np.hypot(other.harmonics, other.constants))


@dataclass(frozen=True, eq=False)
class Problem:
    """Whitened residual of all recordings and priors, for candidates (C, n) of the search variable.

    Attributes:
        measured: the data.
        variables: what is searched.
        motion: what moves.
        scatter: from recording to recording.
        held: (n,) variables that stay at the mean of their priors.
        noise: (R, 2 S H, 2 S H) covariance of the sensors' and the base's noise.
        seats: (R, 2 S H, k) derivatives of the harmonics to the logarithms of k springs and
            dampers, which differ from one seating to the next.
    """

    measured: Measured
    variables: Variables
    motion: Motion
    scatter: Scatter
    held: np.ndarray
    noise: np.ndarray
    seats: np.ndarray

    @classmethod
    def of(cls, measured: Measured, variables: Variables, motion: Motion, repeatability: float = 0.0) -> "Problem":
        """With the noise of the base as the measured transmissibility sees it."""
        gain = np.abs(measured.output[..., :1] / measured.base[:, None, :1])
        variance = measured.output_std**2 + (gain * measured.base_std[:, None]) ** 2
        flat = np.tile(variance.reshape(len(measured.lines), -1), 2)
        noise = flat[..., None] * np.eye(flat.shape[1])
        held, seats = np.zeros(variables.size, bool), np.zeros((*flat.shape, 0))
        return cls(measured, variables, motion, Scatter(repeatability), held, noise, seats)

    # weights

    @cached_property
    def repeatability(self) -> float:
        """Relative standard deviation of a first harmonic from recording to recording, in the mean."""
        output = self.measured.output
        of_parts = (self.seats**2).sum(-1).reshape(len(output), 2, *output.shape[1:])
        seated = np.mean(of_parts[:, :, 0, 0].mean(1) / np.abs(output[:, 0, 0]) ** 2)
        return float(np.hypot(self.scatter.harmonics, self.scatter.constants * np.sqrt(seated)))

    @cached_property
    def _whitener(self) -> np.ndarray:
        return self.whitener(self.scatter)

    def whitener(self, scatter: Scatter) -> np.ndarray:
        """(R, 2 S H, 2 S H) inverse of the Cholesky factor of the covariance; zero where nothing was measured."""
        rows = self.measured.rows
        size = np.tile(np.abs(self.measured.output).reshape(len(rows), -1), 2)
        one = np.eye(rows.shape[1])
        S = self.noise + (scatter.harmonics * size)[..., None] ** 2 * one
        if scatter.constants:
            S = S + scatter.constants**2 * self.seats @ np.swapaxes(self.seats, 1, 2)
        S = np.where(rows[:, :, None] & rows[:, None, :], S, one)
        return np.where(rows[:, :, None], np.linalg.inv(np.linalg.cholesky(S)), 0.0)

    def weighed(self, q: np.ndarray) -> "Problem":
        """The same with the base's noise and the constants' scatter seen through the model at q (n,)."""
        variables, measured = self.variables, self.measured
        G = self.motion.by_base(variables.theta(q))
        T = self.channel(q[None], measured.base.shape[1])[0][0]  # (R, S, H)
        H, R, S = measured.base.shape[1], len(measured.lines), len(measured.sensors)
        turn = G[:, :, :H] + 1j * G[:, :, H:]  # complex response to real and imaginary parts
        turn = (T[..., None] * turn).reshape(R, S * H, 2 * H)
        G = np.concatenate([turn.real, turn.imag], 1)
        base = np.tile(measured.base_std**2, 2)
        sensors = np.tile((measured.output_std**2).reshape(R, -1), 2)
        noise = (G * base[:, None]) @ np.swapaxes(G, 1, 2) + sensors[..., None] * np.eye(sensors.shape[1])
        return replace(self, noise=noise, seats=self._seats(q, T))

    def _seats(self, q: np.ndarray, T: np.ndarray) -> np.ndarray:
        """What a spring's or a damper's logarithm makes of what sensors with the gains T (R, S, H) read."""
        names = self.variables.seated
        at = [self.variables.motion_names.index(name) for name in names]
        theta = self.variables.theta(q[None])
        slopes = self.motion.response(theta, None)[1][0][..., at]  # (R, S, H, k)
        seen = (T[..., None] * slopes * theta[0][:, None, None, at]).reshape(len(T), T[0].size, len(at))
        return np.concatenate([seen.real, seen.imag], 1)

    def with_repeatability(self, repeatability: float) -> "Problem":
        """The same where each harmonic scatters for itself, by so much."""
        return self.with_scatter(Scatter(repeatability))

    def with_scatter(self, scatter: Scatter) -> "Problem":
        """The same with another scatter from recording to recording."""
        return replace(self, scatter=scatter)

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

    def missed(
        self, Q: np.ndarray, near: Evaluation | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:  # fmt: skip
        """By how much candidates Q (C, n) miss the harmonics, real parts first, without weights.

        Returns:
            misses (C, R, 2 S H), their derivatives (C, R, 2 S H, n), which candidates move (C,), and their motions.
        """
        variables = self.variables
        theta = variables.theta(Q)
        Y, D, moves, memory = self.motion.response(theta, None if near is None else near.memory)
        by_theta = variables.slopes(variables.theta, Q, variables.of_motion)  # (C, R, P, k)
        C, R, S, H, P = D.shape
        dY = np.zeros((C, R, S, H, Q.shape[1]), complex)
        dY[..., variables.of_motion] = (D.reshape(C, R, S * H, P) @ by_theta).reshape(C, R, S, H, -1)
        read, dread = self._read(Q, Y, dY)
        e, J = read - self.measured.output, dread
        n = Q.shape[1]
        e, J = e.reshape(C, R, -1), J.reshape(C, R, -1, n)
        return np.concatenate([e.real, e.imag], 2), np.concatenate([J.real, J.imag], 2), moves, memory

    def evaluate(self, Q: np.ndarray, near: Evaluation | None = None) -> Evaluation:
        """Residuals and derivatives of candidates Q (C, n)."""
        variables, n = self.variables, Q.shape[1]
        e, J, moves, memory = self.missed(Q, near)
        r = (self._whitener @ e[..., None])[..., 0][:, self.measured.rows]
        J = (self._whitener @ J)[:, self.measured.rows]
        mean, std = variables.prior
        known = np.isfinite(std) & ~self.held
        prior = ((Q - mean) / std)[:, known]
        rows = np.broadcast_to((np.eye(n) / std)[known], (len(Q), int(known.sum()), n))
        outside, walls = variables.outside(Q)
        r, J = np.concatenate([r, prior, outside / _WALL], 1), np.concatenate([J, rows, walls / _WALL], 1)
        J[..., self.held] = 0.0
        good = moves & np.isfinite(r).all(1) & np.isfinite(J).all((1, 2))
        r, J = np.where(good[:, None], r, NO_MOTION), np.where(good[:, None, None], J, 0.0)
        return Evaluation(r, J, good, memory)

    def whitened(self, read: np.ndarray) -> np.ndarray:
        """Residual (m,) of what sensors read (R, S, H), without the priors' rows."""
        return self._whitened_by(self._whitener, read)[self.measured.rows]

    def squares(self, read: np.ndarray) -> np.ndarray:
        """(R, S, H) share of each harmonic in chi-square where sensors read (R, S, H); zero where none was measured."""
        r = np.where(self.measured.rows, self._whitened_by(self._whitener, read), 0.0)
        return (r**2).reshape(len(r), 2, *read.shape[1:]).sum(1)

    def _whitened_by(self, W: np.ndarray, read: np.ndarray) -> np.ndarray:
        e = (read - self.measured.output).reshape(len(read), -1)
        e = np.concatenate([e.real, e.imag], 1)
        return (W @ e[..., None])[..., 0]

    def predicted(self, q: np.ndarray) -> np.ndarray:
        """(R, S, H) what the sensors read at q (n,)."""
        Y = self.motion.response(self.variables.theta(q[None]), None)[0]
        n = q.size
        return self._read(q[None], Y, np.zeros((*Y.shape, n), complex))[0][0]

    # sensors

    def _read(self, Q: np.ndarray, Y: np.ndarray, dY: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What sensors read (C, R, S, H), and its derivatives (C, R, S, H, n), where they move by Y."""
        H = self.measured.base.shape[1]
        T, rock = self.channel(Q, H)
        moved = Y + rock
        dread = T[..., None] * dY
        of = self.variables.of_channel
        if of.size:
            change = self.variables.slopes(lambda Q: np.stack(self.channel(Q, H), 1), Q, of)
            dread[..., of] += change[:, 0] * moved[..., None] + T[..., None] * change[:, 1]
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
        frequency = np.exp(v.value(Q, v.of_kind("rocking frequency"), np.log(60.0)))[one]
        ratio = v.value(Q, v.of_kind("rocking damping"), 0.1)[one]
        swing = base * f**2 / (frequency**2 - f**2 + 2j * ratio * frequency * f)
        for s, sensor in enumerate(measured.sensors):

            def of(kind: str, rest: float = 0.0, sensor: str = sensor) -> np.ndarray:
                return v.value(Q, v.of_kind(kind, sensor=sensor), rest)[one]

            softness, damping = np.maximum(of("mount"), 0.0), of("mount damping", 0.2)
            a = 1 + 2j * damping * f * np.sqrt(softness + 1e-16)
            gain = 1 + of("gain") + of("drift") * v.place_in_session[:, None]
            T[:, :, s] = gain * np.exp(-2j * np.pi * f * of("delay")) * a / (a - f**2 * softness)
            rock[:, :, s] = -of("rocking") * swing
        return T, rock
