"""The least-squares problem of a rung: whitened harmonics of all recordings, and a row for each prior."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from identification.periodic import Line
from identification.rivals.ladder import RungSpace
from identification.rivals.steady import HARMONICS, felt, whitened
from identification.search import UNSTABLE

#: Noise below this share of the amplitude is not believed.
_FLOOR = 1e-7


@dataclass(frozen=True, eq=False)
class Measured:
    """Harmonics of recordings as the compiled code takes them.

    Attributes:
        loads_kg, hz, places: (n,) load, fundamental, place in the session from -1/2 to 1/2.
        U, Y: (n, H) base and malleolus [m/s^2], of which counts (n,) are used. W: (n, 2 H, 2 H) whiteners.
        U_std, Y_std: (n, H) of the noise.
    """

    loads_kg: np.ndarray
    hz: np.ndarray
    places: np.ndarray
    counts: np.ndarray
    U: np.ndarray
    Y: np.ndarray
    U_std: np.ndarray
    Y_std: np.ndarray
    W: np.ndarray

    @classmethod
    def of(cls, lines: Sequence[Line]) -> "Measured":
        """Of measured lines in the order of the session; whitened by the measured transmissibility at first."""
        n, H = len(lines), max(line.count for line in lines)
        counts = np.array([line.count for line in lines])
        shape = (n, H)
        U, Y = np.zeros(shape, complex), np.zeros(shape, complex)
        U_std, Y_std = np.zeros(shape), np.zeros(shape)
        for i, line in enumerate(lines):
            for channel, A, S in ((line.base, U, U_std), (line.malleolus, Y, Y_std)):
                A[i, : line.count] = channel.amplitudes
                S[i, : line.count] = np.maximum(channel.std, _FLOOR * abs(channel.amplitudes[0]))
        weighs = ["m_F" in line.recording.condition.masses for line in lines]
        loads = [line.recording.condition.added_mass_kg * w for line, w in zip(lines, weighs, strict=True)]
        hz = np.array([line.base.frequency_hz for line in lines])
        places = np.arange(n) / max(1, n - 1) - 0.5
        W = np.zeros((n, 2 * H, 2 * H))
        for i, k in enumerate(counts):
            S = np.hypot(Y_std[i, :k], abs(Y[i, 0] / U[i, 0]) * U_std[i, :k])
            W[i, : 2 * k, : 2 * k] = np.diag(1 / np.tile(S, 2))
        return cls(np.array(loads, float), hz, places, counts, U, Y, U_std, Y_std, W)

    def weighed(self, c: np.ndarray) -> "Measured":
        """Whitened at constants c (29,): the base's noise through the exact derivative of the motion to it."""
        W = self.W.copy()
        for i, k in enumerate(self.counts):
            q = np.zeros(2 * (2 * HARMONICS + 1))
            found, _, D = felt(c, self.loads_kg[i], self.hz[i], self.U[i, :k], self.places[i], q, True)
            if not found:
                continue
            D = D.reshape(k, k, 2).transpose(0, 2, 1).reshape(k, 2 * k)  # all real parts of U, then all imaginary ones
            G = np.concatenate([D.real, D.imag])
            S = np.diag(np.tile(self.Y_std[i, :k] ** 2, 2)) + (G * np.tile(self.U_std[i, :k] ** 2, 2)) @ G.T
            W[i, : 2 * k, : 2 * k] = np.linalg.inv(np.linalg.cholesky(S))
        return replace(self, W=W)

    def only(self, kept: np.ndarray) -> "Measured":
        """Some of the recordings."""
        names = ("loads_kg", "hz", "places", "counts", "U", "Y", "U_std", "Y_std", "W")
        return Measured(**{name: getattr(self, name)[kept] for name in names})

    @property
    def size(self) -> int:
        """Numbers compared."""
        return int(2 * self.counts.sum())


class RungProblem:
    """Residual and Jacobian of a rung on recordings.

    Args:
        data: the recordings. space: of the rung.
    """

    def __init__(self, data: Measured, space: RungSpace) -> None:
        self.data, self.space = data, space
        self._starts = np.concatenate([[0], np.cumsum(2 * data.counts)[:-1]])
        self._motions = np.zeros((data.counts.size, 2 * (2 * HARMONICS + 1)))
        self._cache: tuple[bytes, np.ndarray, np.ndarray] | None = None
        self.evaluations = 0

    def evaluate(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual (m + k,) and Jacobian (m + k, n): the recordings' rows, then the priors'."""
        key = q.tobytes()
        if self._cache is None or self._cache[0] != key:
            self.evaluations += 1
            d, m = self.data, self.data.size
            c, slope = self.space.constants(q)
            r, J = np.empty(m), np.empty((m, c.size))
            found = whitened(c, d.loads_kg, d.hz, d.U, d.counts, d.places, d.Y, d.W, self._starts, self._motions, r, J)
            has, mean = self.space.prior
            rows = np.zeros((has.size, q.size))
            rows[np.arange(has.size), has] = 1.0
            if found and np.isfinite(r).all() and np.isfinite(J).all():
                out = np.concatenate([r, q[has] - mean]), np.concatenate([J @ slope, rows])
            else:
                out = np.full(m + has.size, UNSTABLE), np.zeros((m + has.size, q.size))
            self._cache = (key, *out)
        return self._cache[1], self._cache[2]

    def chi(self, q: np.ndarray) -> float:
        """Chi-square of the recordings at q (n,)."""
        r = self.evaluate(q)[0][: self.data.size]
        return float(r @ r)

    def predict(self, q: np.ndarray) -> list[np.ndarray]:
        """Harmonics (H,) of the malleolus' sensor in each recording [m/s^2]; zeros where there is no motion."""
        c, d = self.space.constants(q)[0], self.data
        return [
            felt(c, d.loads_kg[i], d.hz[i], d.U[i, :k], d.places[i], self._motions[i].copy(), False)[1]
            for i, k in enumerate(d.counts)
        ]

    def descend(self, q: np.ndarray, low: np.ndarray, high: np.ndarray, most: int) -> tuple[np.ndarray, float, bool]:
        """Minimise within bounds from q (n,): where it ended, the sum of squares, whether it came to rest."""
        inside = np.clip(q, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        self._motions[:] = 0.0
        found = least_squares(
            lambda q: self.evaluate(q)[0], inside, lambda q: self.evaluate(q)[1], bounds=(low, high), method="trf",
            x_scale="jac", ftol=1e-6, xtol=1e-7, gtol=1e-8, max_nfev=most,
        )  # fmt: skip
        return found.x, 2 * float(found.cost), bool(found.success)
