"""The least-squares problem of a rung: whitened harmonics of all recordings, and a row for each prior."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from identification.periodic import Line
from identification.rivals.ladder import RungSpace
from identification.rivals.steady import SERIES, Feet
from identification.search import UNSTABLE

#: Noise below this share of the amplitude is not believed.
_FLOOR = 1e-7


@dataclass(frozen=True, eq=False)
class Measured:
    """Harmonics of recordings as one set of arrays.

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

    def feet(self, c: np.ndarray) -> Feet:
        """The foot of constants c (29,) in each recording."""
        return Feet.of(c, self.loads_kg, self.hz, self.places, self.U)

    def weighed(self, c: np.ndarray) -> "Measured":
        """Whitened at constants c (29,): the base's noise through the exact derivative of the motion to it."""
        W, feet = self.W.copy(), self.feet(c)
        x, found = feet.solve(np.zeros((len(feet), 2 * SERIES.size)))
        by_base = feet.by_base(x).reshape(len(feet), -1, 2, SERIES.harmonics)
        for i, k in enumerate(self.counts):
            if not found[i]:
                continue
            D = by_base[i, :k, :, :k].reshape(k, 2 * k)
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
        self._motions = np.zeros((data.counts.size, 2 * SERIES.size))
        self._cache: tuple[bytes, np.ndarray, np.ndarray] | None = None
        self.evaluations = 0

    def evaluate(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual (m + k,) and Jacobian (m + k, n): the recordings' rows, then the priors'."""
        key = q.tobytes()
        if self._cache is None or self._cache[0] != key:
            self.evaluations += 1
            c, slope = self.space.constants(q)
            found, r, J = self._whitened(c)
            has, mean = self.space.prior
            rows = np.zeros((has.size, q.size))
            rows[np.arange(has.size), has] = 1.0
            if found and np.isfinite(J).all():
                out = np.concatenate([r, q[has] - mean]), np.concatenate([J @ slope, rows])
            else:
                size = self.data.size + has.size
                out = np.full(size, UNSTABLE), np.zeros((size, q.size))
            self._cache = (key, *out)
        return self._cache[1], self._cache[2]

    def _whitened(self, c: np.ndarray) -> tuple[bool, np.ndarray, np.ndarray]:
        """Whether every recording has a motion; whitened residual (m,) and its derivatives (m, 29) at constants c."""
        d, feet = self.data, self.data.feet(c)
        self._motions, found = feet.solve(self._motions)
        gap, by = feet.felt(self._motions)[:, : d.Y.shape[1]] - d.Y, feet.by_constants(self._motions)
        rows = np.concatenate([gap[..., None], by[:, : d.Y.shape[1]]], axis=2)
        parts = [
            W[: 2 * k, : 2 * k] @ np.concatenate([row[:k].real, row[:k].imag])
            for W, row, k in zip(d.W, rows, d.counts, strict=True)
        ]
        whole = np.concatenate(parts)
        return bool(found.all()), whole[:, 0], whole[:, 1:]

    def chi(self, q: np.ndarray) -> float:
        """Chi-square of the recordings at q (n,)."""
        r = self.evaluate(q)[0][: self.data.size]
        return float(r @ r)

    def predict(self, q: np.ndarray) -> list[np.ndarray]:
        """Harmonics (H,) of the malleolus' sensor in each recording [m/s^2]; zeros where there is no motion."""
        feet = self.data.feet(self.space.constants(q)[0])
        x, found = feet.solve(self._motions)
        Y = feet.felt(x) * found[:, None]
        return [row[:k] for row, k in zip(Y, self.data.counts, strict=True)]

    def descend(self, q: np.ndarray, low: np.ndarray, high: np.ndarray, most: int) -> tuple[np.ndarray, float, bool]:
        """Minimise within bounds from q (n,): where it ended, the sum of squares, whether it came to rest."""
        inside = np.clip(q, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        self._motions[:] = 0.0
        found = least_squares(
            lambda q: self.evaluate(q)[0], inside, lambda q: self.evaluate(q)[1], bounds=(low, high), method="trf",
            x_scale="jac", ftol=1e-6, xtol=1e-7, gtol=1e-8, max_nfev=most,
        )  # fmt: skip
        return found.x, 2 * float(found.cost), bool(found.success)
