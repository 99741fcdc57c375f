"""Steady-state identification: harmonics of measured and modelled periodic motion, weighted by their noise.

Following Pintelon and Schoukens, a periodic recording is worth its harmonics: 2 H numbers with known variances. The
residual is whitened by the noise of the output harmonics and of the input harmonics seen through the model,
S = S_y + G S_u G^T, and by what the channels' gain and delay are uncertain (correlation.py), so that its sum of squares
is chi-square distributed, with 2 H degrees of freedom a recording less the parameters. No initial states are estimated:
the model's orbit is periodic too.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.response import Harmonics
from identification.compiled import Compiled
from identification.correlation import projection, shared_errors
from identification.line import Line
from identification.orbits import Engine, Excitation, Twin
from identification.search import UNSTABLE
from identification.space import DELAY, SearchSpace, Space

#: Noise below this share of the amplitude is not believed: clocks and models are not that good.
_NOISE_FLOOR = 1e-7


def split(z: np.ndarray) -> np.ndarray:
    """Complex (H, ...) to real (2 H, ...): real parts, then imaginary parts."""
    return np.concatenate([z.real, z.imag])


def inverse_of_gram(J: np.ndarray) -> np.ndarray:
    """(J^T J)^-1 (p, p) of J (m, p), with infinite variance for parameters in directions that no residual sees."""
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    seen = s > 1e-10 * s[0]
    C = (Vt[seen].T / s[seen] ** 2) @ Vt[seen]
    blind = np.sum(Vt[seen] ** 2, axis=0) < 1 - 1e-6
    C[blind, blind] = np.inf
    return C


class PeriodicProblem:
    """Whitened residual and Jacobian of all recordings together.

    Args:
        lines: the measured harmonics. engine: finds the orbits. space: the free parameters.
        tolerance: relative gap at which an orbit is accepted with a first-order correction.
        excess: of the misfit over the noise, beside which shared errors are weighed (correlation.misfit); infinite
            leaves them out.
    """

    def __init__(
        self, lines: Sequence[Line], engine: Engine, space: SearchSpace, tolerance: float = 1e-3, excess: float = 1.0
    ) -> None:
        self.lines, self.engine, self.space, self.tolerance = list(lines), engine, space, tolerance
        self._excess = excess
        self._whiten = [self._first_whitening(line) for line in self.lines]
        self._shared = self._shared_errors([line.malleolus.amplitudes for line in self.lines])
        self.evaluations = 0
        self._cache: tuple[bytes, np.ndarray, np.ndarray] | None = None

    @property
    def size(self) -> int:
        """Number of residuals."""
        return sum(2 * line.count for line in self.lines)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (p,) of the search variable."""
        return self.space.bounds

    def start(self, q: np.ndarray) -> np.ndarray:
        """Full search variable of a start: q (p,) itself, as no initial states are searched for."""
        self.engine.forget()
        return q

    def covariance(self, q: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Covariance (p, p) of q: the residual is whitened, so the inverse of J^T J; infinite where J has no rank.

        Args:
            q: search variable. active: (p,) which parameters vary; the others rest on a bound and get NaN.
        """
        C = np.full((q.size, q.size), np.nan)
        C[np.ix_(active, active)] = inverse_of_gram(self.jacobian(q)[:, active])
        return C

    @property
    def log_determinant(self) -> float:
        """Log det of the covariance; -2 log likelihood is the sum of squares plus this."""
        V = np.concatenate(self.shared_errors())
        return self._noise_log_determinant + float(np.linalg.slogdet(np.eye(V.shape[1]) + V.T @ V)[1])

    @property
    def _noise_log_determinant(self) -> float:
        return float(-2 * sum(np.linalg.slogdet(W)[1] for W in self._whiten))

    def shared_errors(self) -> list[np.ndarray]:
        """(2 H, k) of each recording: its whitened harmonics under a standard deviation of each error they share."""
        starts = np.cumsum([2 * line.count for line in self.lines])[:-1]
        return [W @ V for W, V in zip(self._whiten, np.split(self._shared, starts), strict=True)]

    @property
    def _projection(self) -> np.ndarray:
        return projection(np.concatenate(self.shared_errors()))

    def _shared_errors(self, amplitudes: Sequence[np.ndarray]) -> np.ndarray:
        frequencies = [line.base.frequency_hz for line in self.lines]
        recordings = [line.recording for line in self.lines]
        V = shared_errors(recordings, frequencies, amplitudes, delay=not self.space.has_delay)
        return V / np.sqrt(self._excess)

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Whitened residual (n,) at the search variable q."""
        return self._evaluate(q)[0]

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Its derivatives (n, p)."""
        return self._evaluate(q)[1]

    def compiled(self) -> Compiled | None:
        """The whole descent as compiled code, where the engine is the twin and all recordings are of one foot."""
        if not (isinstance(self.engine, Twin) and isinstance(self.space, Space)):
            return None
        measured = [line.malleolus.amplitudes for line in self.lines]
        return Compiled(
            self.engine, self.space, measured, self._whiten, projection(np.concatenate(self.shared_errors()))
        )

    def predict(self, q: np.ndarray) -> list[np.ndarray]:
        """Model harmonics (H,) of each recording, delayed like the measurement."""
        return [self.response(i, q)[0] for i in range(len(self.lines))]

    def _evaluate(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = q.tobytes()
        if self._cache is None or self._cache[0] != key:
            self.evaluations += 1
            rows_in_all = sum(2 * line.count for line in self.lines)
            r, J = np.empty(rows_in_all), np.empty((rows_in_all, q.size))
            row = 0
            try:
                for i, (line, W) in enumerate(zip(self.lines, self._whiten, strict=True)):
                    Y, DY, slope = self.response(i, q)
                    rows = slice(row, row + 2 * line.count)
                    r[rows], J[rows] = W @ split(Y - line.malleolus.amplitudes), W @ split(DY) @ slope
                    row = rows.stop
                P = self._projection
                r, J = r - P.T @ (P @ r), J - P.T @ (P @ J)
            except SimulationError:
                r[:], J[:] = UNSTABLE, 0.0
            if not (np.isfinite(r).all() and np.isfinite(J).all()):
                r[:], J[:] = UNSTABLE, 0.0
            self._cache = (key, r, J)
        return self._cache[1], self._cache[2]

    def response(self, number: int, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Model harmonics (H,) of one recording, derivatives (H, p) to its parameters, and of those (p, n) to z."""
        (theta, slope), line = self.space.at(number, z), self.lines[number]
        values = self.space.values(theta)
        y, Dy = self.engine.orbit(number, values, self.space.names, self.tolerance)
        h = np.arange(1, line.count + 1)
        late = 2j * np.pi * line.base.frequency_hz * h
        turn = np.exp(-late * values.get(DELAY.name, 0.0))
        Y = 2 / y.size * np.fft.rfft(y)[h] * turn
        DY = 2 / y.size * np.fft.rfft(Dy, axis=0)[h] * turn[:, None]
        if self.space.has_delay:
            DY = np.column_stack([DY, -late * Y])
        return Y, DY, slope

    def _first_whitening(self, line: Line) -> np.ndarray:
        """Whitening before the model is known: input noise seen through the measured transmissibility."""
        gain = abs(line.malleolus.amplitudes[0] / line.base.amplitudes[0])
        return np.diag(1 / np.hypot(*(np.tile(s, 2) for s in (self._std(line.malleolus), gain * self._std(line.base)))))

    @staticmethod
    def _std(channel: Harmonics) -> np.ndarray:
        return np.maximum(channel.std, _NOISE_FLOOR * abs(channel.amplitudes[0]))

    def noise(self, number: int) -> np.ndarray:
        """Covariance (2 H, 2 H) of one recording's residual, as weighted now, without the errors that all share."""
        return np.linalg.inv(self._whiten[number].T @ self._whiten[number])

    def widen(self, number: int, extra: np.ndarray) -> None:
        """Add a covariance (2 H, 2 H) to that of one recording's residual: what the model leaves beyond the noise."""
        self._whiten[number] = np.linalg.inv(np.linalg.cholesky(self.noise(number) + extra))
        self._cache = None

    def weigh_as(self, other: "PeriodicProblem") -> None:
        """Take over the weights of another problem with the same recordings."""
        self._whiten, self._shared = other._whiten, other._shared

    def reweigh(self, q: np.ndarray, engine_of: Callable[[Sequence[Excitation]], Engine]) -> None:
        """Exact whitening at q (p,): the input's noise through the derivative of the orbit to each input harmonic.

        Args:
            q: search variable. engine_of: makes an engine for other excitations.
        """
        feet = [self.space.values(self.space.at(i, q)[0]) for i in range(len(self.lines))]
        nudged, sizes, whose = [], [], []
        for i, line in enumerate(self.lines):
            U = line.base.amplitudes
            for direction in np.concatenate([np.eye(line.count), 1j * np.eye(line.count)]):
                nudge = 1e-4 * abs(U[0])
                for sign in (1, -1):
                    nudged.append(replace(self.engine.excitations[i], amplitudes=U + sign * nudge * direction))
                sizes.append(2 * nudge)
                whose += [i, i]
        engine = engine_of(nudged)
        outputs = iter([engine.orbit(n, feet[i], self.space.names, 1e-6)[0] for n, i in enumerate(whose)])
        size = iter(sizes)
        for i, line in enumerate(self.lines):
            h = np.arange(1, line.count + 1)
            turn = np.exp(-2j * np.pi * line.base.frequency_hz * h * feet[i].get(DELAY.name, 0.0))
            columns = []
            for _ in range(2 * line.count):
                up, down = next(outputs), next(outputs)
                columns.append(split(2 / up.size * np.fft.rfft(up - down)[h] * turn) / next(size))
            G = np.column_stack(columns)
            S = np.diag(np.tile(self._std(line.malleolus) ** 2, 2)) + (G * np.tile(self._std(line.base) ** 2, 2)) @ G.T
            self._whiten[i] = np.linalg.inv(np.linalg.cholesky(S))
        self._shared = self._shared_errors(self.predict(q))
        self._cache = None
