"""Steady-state identification: harmonics of measured and modelled periodic motion, weighted by their noise.

Following Pintelon and Schoukens, a periodic recording is worth its harmonics: 2 H numbers with known variances. The
residual is whitened by the noise of the output harmonics and of the input harmonics seen through the model,
S = S_y + G S_u G^T, and by what the channels' gain and delay are uncertain, so that its sum of squares is chi-square
distributed, with 2 H degrees of freedom a recording less the parameters. No initial states are estimated: the model's
orbit is periodic too.

An uncertain gain and delay of the channels are errors that all harmonics share. With them the residual of all
recordings has the covariance S + V V^T: S the noise, recording by recording, and V (n, k) what one standard deviation
of each shared error does to the harmonics, k two or fewer. With S whitened away, V becomes W V = U s Q^T, and
I + W V V^T W^T is whitened by I - sum over k of (1 - 1 / sqrt(1 + s^2)) u u^T: a few inner products. A nuisance
parameter with a normal prior, integrated out, has the same likelihood.
"""

import functools
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fasbody.exceptions import RecordingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.harmonics import Harmonics, fit_harmonics, harmonic_count
from fasbody.recording.recording import Recording, gain_and_delay
from identification.engines.certified import CertifiedRollouts
from identification.engines.compiled import Compiled
from identification.engines.engine import LONGEST_STEP, MALLEOLUS, Engine, Excitation
from identification.engines.twin import Twin
from identification.search import UNSTABLE, inverse_of_gram
from identification.space import DELAY, SearchSpace, Space, delay_of

#: Noise below this share of the amplitude is not believed: clocks and models are not that good.
_NOISE_FLOOR = 1e-7
#: Relative gap of the orbits of a result.
_CERTIFIED = 1e-7
#: Rounds of the misfit's iteration, which contracts.
_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class Line:
    """The harmonics of one recording: base U, malleolus Y, and those of other sensors that are fitted, by name."""

    recording: Recording
    base: Harmonics
    malleolus: Harmonics
    others: Mapping[str, Harmonics] = field(default_factory=dict)

    @classmethod
    @functools.lru_cache(maxsize=128)  # choosing the domain, fitting and drawing loops need the same harmonics
    def of(cls, recording: Recording) -> "Line":
        """Fit the harmonics of a checked recording with a known excitation frequency."""
        frequency = recording.condition.frequency_hz
        if frequency is None:
            raise RecordingError(f"{recording.file}: is not periodic, so it has no harmonics; use the time domain.")
        count = harmonic_count(frequency, recording.rate_hz)
        time = recording.time_s - recording.time_s[0]  # phases count from the first sample, where rollouts start
        channels = (recording.base_m_s2, recording.malleolus_m_s2)
        base, malleolus = (fit_harmonics(time, c, frequency, count) for c in channels)
        return cls(recording, base, malleolus)

    @classmethod
    @functools.lru_cache(maxsize=128)
    def with_sensors(cls, recording: Recording, sensors: tuple[str, ...]) -> "Line":
        """`of`, with the harmonics of the other sensors of these names that the recording has."""
        line, read = cls.of(recording), recording.sensors
        time = recording.time_s - recording.time_s[0]
        wanted = [name for name in sensors if name in read and name not in MALLEOLUS]
        found = {name: fit_harmonics(time, read[name], line.base.frequency_hz, line.count) for name in wanted}
        return replace(line, others=found) if found else line

    @property
    def excitation(self) -> Excitation:
        """What drives the model."""
        return Excitation(self.base.frequency_hz, self.base.amplitudes, self.recording.condition.masses)

    @property
    def count(self) -> int:
        """Harmonics compared of each sensor."""
        return self.base.amplitudes.size

    @property
    def sensors(self) -> dict[str, Harmonics]:
        """Harmonics of every sensor that is fitted, the malleolus first."""
        return {MALLEOLUS[0]: self.malleolus} | dict(self.others)

    @property
    def measured(self) -> np.ndarray:
        """Complex harmonics (k H,) of the k sensors, one sensor behind the other."""
        return np.concatenate([channel.amplitudes for channel in self.sensors.values()])

    @property
    def size(self) -> int:
        """Complex harmonics compared, of all sensors."""
        return self.count * (1 + len(self.others))


def excitations(lines: Sequence[Line], foot: Foot) -> list[Excitation]:
    """What drives the model at each line; the step is the foot's own where that is finer than LONGEST_STEP."""
    longest = min(LONGEST_STEP, foot.step)
    return [replace(line.excitation, longest_step=longest) for line in lines]


def split(z: np.ndarray) -> np.ndarray:
    """Complex (H, ...) to real (2 H, ...): real parts, then imaginary parts."""
    return np.concatenate([z.real, z.imag])


def shared_errors(
    recordings: Sequence[Recording],
    frequencies_hz: Sequence[float],
    amplitudes: Sequence[np.ndarray],
    delay: bool,
    sensors: Sequence[Sequence[str]] | None = None,
) -> np.ndarray:
    """V (n, k): real, then imaginary parts of each recording's harmonics, under one standard deviation of each error.

    Nothing is known of how much of a gain's uncertainty belongs to the sensor and how much to its mounting, so it is
    the same error in all recordings: then more recordings do not make it smaller. Each sensor has errors of its own.

    Args:
        recordings: with their calibration. frequencies_hz: of their fundamentals. amplitudes: (k H,) harmonics of each
            [m/s^2], one sensor behind the other. delay: whether the delay is an error; not where it is estimated.
        sensors: of each recording, default the malleolus alone.
    """
    told = [MALLEOLUS] * len(recordings) if sensors is None else [tuple(each) for each in sensors]
    kinds = list(dict.fromkeys(name for each in told for name in each))
    columns = []
    for recording, f, Y, each in zip(recordings, frequencies_hz, amplitudes, told, strict=True):
        count = Y.size // len(each)
        errors = np.zeros((Y.size, 2 * len(kinds)), complex)
        for place, name in enumerate(each):
            gain_std, delay_std_s = gain_and_delay(recording, name, "base")
            rows, at = slice(place * count, (place + 1) * count), 2 * kinds.index(name)
            by_delay = -2j * np.pi * f * np.arange(1, count + 1) * Y[rows]
            errors[rows, at], errors[rows, at + 1] = gain_std * Y[rows], (delay_std_s if delay else 0.0) * by_delay
        columns.append(np.concatenate([errors.real, errors.imag]))
    V = np.concatenate(columns)
    return V[:, np.any(V != 0.0, axis=0)]


def misfit(r: np.ndarray, V: np.ndarray, dof: int) -> float:
    """How much larger than stated the noise must be to explain what shared errors leave of a residual, at least 1.

    Where the model misses by more than the noise, shared errors at their stated size would cost nothing beside the
    misfit, and a gain of any size would be believed. So noise and shared errors are weighed against each other after
    the noise has been raised to what is left: S x + V V^T with x = (r^T (I + V V^T / x)^-1 r) / dof, by iteration.

    Args:
        r: residual (n,) and V: shared errors (n, k), both whitened by the noise alone. dof: degrees of freedom; where
            none is left, a residual that is not zero is the end of a descent that went astray, and is judged by one.
    """
    dof = max(1, dof)
    x = max(1.0, float(r @ r) / dof)
    for _ in range(_ROUNDS):
        left = np.linalg.solve(np.eye(V.shape[1]) + V.T @ V / x, V.T @ r)
        x = max(1.0, float(r @ r - (V.T @ r) @ left / x) / dof)
    return x


def projection(V: np.ndarray) -> np.ndarray:
    """P (k, n) of the whitener I - P^T P of I + V V^T; its rows are orthogonal."""
    if not V.size:
        return np.zeros((0, V.shape[0]))
    U, s, _ = np.linalg.svd(V, full_matrices=False)
    return np.ascontiguousarray((U * np.sqrt(1 - 1 / np.sqrt(1 + s**2))).T)


class PeriodicProblem:
    """Whitened residual and Jacobian of all recordings together; its cost is chi-square distributed.

    Args:
        lines: the measured harmonics. engine: finds the orbits. space: the free parameters.
        tolerance: relative gap at which an orbit is accepted with a first-order correction.
        excess: of the misfit over the noise, beside which shared errors are weighed (`misfit`); infinite leaves
            them out.
    """

    chi_square = True

    def __init__(
        self,
        lines: Sequence[Line],
        engine: Engine[Excitation],
        space: SearchSpace,
        tolerance: float = 1e-3,
        excess: float = 1.0,
    ) -> None:
        self.lines, self.engine, self.space, self.tolerance = list(lines), engine, space, tolerance
        self._excess = excess
        self._whiten = [self._first_whitening(line) for line in self.lines]
        self._shared = self._shared_errors([line.measured for line in self.lines])
        self.evaluations = 0
        self._cache: tuple[bytes, np.ndarray, np.ndarray] | None = None
        self._projected: tuple[list[np.ndarray], np.ndarray] = [], np.empty(0)

    @property
    def size(self) -> int:
        """Number of residuals."""
        return sum(2 * line.size for line in self.lines)

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
        starts = np.cumsum([2 * line.size for line in self.lines])[:-1]
        return [W @ V for W, V in zip(self._whiten, np.split(self._shared, starts), strict=True)]

    @property
    def _projection(self) -> np.ndarray:
        made_of = [self._shared, *self._whiten]  # they stay from one evaluation to the next
        if len(self._projected[0]) != len(made_of) or any(map(operator.is_not, self._projected[0], made_of)):
            self._projected = made_of, projection(np.concatenate(self.shared_errors()))
        return self._projected[1]

    def _shared_errors(self, amplitudes: Sequence[np.ndarray]) -> np.ndarray:
        frequencies = [line.base.frequency_hz for line in self.lines]
        recordings = [line.recording for line in self.lines]
        sensors = [list(line.sensors) for line in self.lines]
        V = shared_errors(recordings, frequencies, amplitudes, not self.space.has_delay, sensors)
        return V / np.sqrt(self._excess)

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Whitened residual (n,) at the search variable q."""
        return self._evaluate(q)[0]

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Its derivatives (n, p)."""
        return self._evaluate(q)[1]

    def compiled(self) -> Compiled | None:
        """The whole descent as compiled code, where the engine is the twin and all recordings are of one foot.

        It knows the malleolus alone.
        """
        alone = self.engine.sensors == MALLEOLUS
        if not (isinstance(self.engine, Twin) and isinstance(self.space, Space) and alone):
            return None
        measured = [line.malleolus.amplitudes for line in self.lines]
        return Compiled(self.engine, self.space, measured, self._whiten, self._projection)

    def predict(self, q: np.ndarray) -> list[np.ndarray]:
        """Model harmonics (k H,) of each recording's sensors, delayed like the measurement."""
        return [Y for Y, _ in self.responses(q)]

    def responses(self, z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Model harmonics (k H,) of each recording, and their derivatives (k H, n) to z (n,)."""
        found = (self.response(i, z) for i in range(len(self.lines)))
        return [(Y, DY @ slope.astype(complex)) for Y, DY, slope in found]

    def _evaluate(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = q.tobytes()
        if self._cache is None or self._cache[0] != key:
            self.evaluations += 1
            rows_in_all = sum(2 * line.size for line in self.lines)
            r, J = np.empty(rows_in_all), np.empty((rows_in_all, q.size))
            row = 0
            try:
                for line, W, (Y, DY) in zip(self.lines, self._whiten, self.responses(q), strict=True):
                    rows = slice(row, row + 2 * line.size)
                    r[rows], J[rows] = W @ split(Y - line.measured), W @ split(DY)
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
        """Model harmonics (k H,) of one recording, one sensor behind the other.

        Returns:
            They, their derivatives (k H, p) to its parameters, and those of the parameters (p, n) to z.
        """
        (theta, slope), line = self.space.at(number, z), self.lines[number]
        values = self.space.values(theta)
        y, Dy = self.engine.orbit(number, values, self.space.names, self.tolerance)
        h = np.arange(1, line.count + 1)
        late = 2j * np.pi * line.base.frequency_hz * h
        n = y.size // len(self.engine.sensors)
        kinds = getattr(self.space, "delays", (DELAY.name,)) if self.space.has_delay else ()
        found, derivatives = [], []
        for name in line.sensors:
            place, delay = self.engine.sensors.index(name), delay_of(name).name
            rows = slice(place * n, (place + 1) * n)
            turn = np.exp(-late * values.get(delay, 0.0))
            Y = 2 / n * np.fft.rfft(y[rows])[h] * turn
            DY = 2 / n * np.fft.rfft(Dy[rows], axis=0)[h] * turn[:, None]
            DY = np.column_stack([DY, *(-late * Y if delay == kind else 0.0 * Y for kind in kinds)])
            found.append(Y)
            derivatives.append(DY)
        return np.concatenate(found), np.concatenate(derivatives), slope

    def _first_whitening(self, line: Line) -> np.ndarray:
        """Whitening before the model is known: input noise seen through the measured transmissibility."""
        std = []
        for channel in line.sensors.values():
            gain = abs(channel.amplitudes[0] / line.base.amplitudes[0])
            std.append(np.hypot(self._std(channel), gain * self._std(line.base)))
        return np.diag(1 / np.tile(np.concatenate(std), 2))

    @staticmethod
    def _std(channel: Harmonics) -> np.ndarray:
        return np.maximum(channel.std, _NOISE_FLOOR * abs(channel.amplitudes[0]))

    def noise(self, number: int) -> np.ndarray:
        """Covariance (2 k H, 2 k H) of one recording's residual, as weighted now, without the errors that all share."""
        return np.linalg.inv(self._whiten[number].T @ self._whiten[number])

    def weigh_as(self, other: "PeriodicProblem") -> None:
        """Take over the weights of another problem with the same recordings."""
        self._whiten, self._shared = other._whiten, other._shared
        self._cache = None

    def weigh_samples(self, sigma: Sequence[np.ndarray]) -> None:
        """Weigh as the sum of squares over all samples does, whose noise is sigma (k,) of each recording's sensors."""
        for i, (line, own) in enumerate(zip(self.lines, sigma, strict=True)):
            root = np.sqrt(line.recording.time_s.size / 2) / own  # of the mean square of a harmonic
            self._whiten[i] = np.diag(np.tile(np.repeat(root, line.count), 2))
        self._shared, self._cache = self._shared[:, :0], None

    def certified(self, foot: Foot) -> "PeriodicProblem":
        """The same problem with the same weights on MuJoCo's motion of a foot, whose step may be another."""
        if not isinstance(self.engine, Twin):  # it is MuJoCo's already
            self.tolerance = _CERTIFIED
            return self
        engine = CertifiedRollouts(foot, excitations(self.lines, foot), self.engine.sensors)
        found = PeriodicProblem(self.lines, engine, self.space, _CERTIFIED, self._excess)
        found.weigh_as(self)
        return found

    def states(self, z: np.ndarray, number: int) -> np.ndarray:
        """Initial states (s,) of one recording's orbit [m, m/s]."""
        self.residual(z)
        return self.engine.start(number)

    def reweigh(self, q: np.ndarray) -> None:
        """Exact whitening at q (p,): the input's noise through the derivative of the orbit to each input harmonic.

        Raises:
            SimulationError: there is no such motion; the weights stay what they were.
        """
        kinds = self.engine.sensors
        whiten = []
        for i, line in enumerate(self.lines):
            foot, U = self.space.values(self.space.at(i, q)[0]), line.base.amplitudes
            nudge = 1e-4 * abs(U[0])
            units = np.concatenate([np.eye(line.count), 1j * np.eye(line.count)])
            moved = [U + sign * nudge * unit for unit in units for sign in (1, -1)]
            drives = [replace(self.engine.drives[i], amplitudes=amplitudes) for amplitudes in moved]
            outputs = iter(self.engine.nearby(i, foot, self.space.names, drives))
            h = np.arange(1, line.count + 1)
            late = -2j * np.pi * line.base.frequency_hz * h
            turns = {name: np.exp(late * foot.get(delay_of(name).name, 0.0)) for name in line.sensors}
            columns = []
            for up, down in zip(outputs, outputs, strict=True):
                n = up.size // len(kinds)
                spectra = np.fft.rfft((up - down).reshape(len(kinds), n))[:, h]
                parts = [2 / n * spectra[kinds.index(name)] * turn for name, turn in turns.items()]
                columns.append(split(np.concatenate(parts)) / (2 * nudge))
            G = np.column_stack(columns)
            own = np.concatenate([self._std(channel) for channel in line.sensors.values()])
            S = np.diag(np.tile(own**2, 2)) + (G * np.tile(self._std(line.base) ** 2, 2)) @ G.T
            whiten.append(np.linalg.inv(np.linalg.cholesky(S)))
        self._shared, self._whiten[:] = self._shared_errors(self.predict(q)), whiten
        self._cache = None
