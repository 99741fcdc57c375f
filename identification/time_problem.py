"""Time-domain identification: prediction error of every sample, Eq. (4.34), for transients, sweeps and random input.

The model runs the whole recording, driven by the spline through the measured base acceleration; the initial states of
each recording are estimated with the parameters. Residual and Jacobian of a recording are replaced by the triangular
factor of their QR decomposition, which has the same cost, gradient and Gauss-Newton step as the ten thousand rows it
stands for.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording, gain_and_delay
from identification.delay import delayed
from identification.engines.certified import CertifiedRollouts
from identification.engines.engine import Engine, Whole
from identification.engines.twin import Twin
from identification.intervals import inverse_of_gram
from identification.parameters import Space, delay_of

#: Every residual of a parameter set whose motion is unstable.
UNSTABLE = 1e6
#: Bound of the scaled initial states.
_STATE_LIMIT = 1e3


class TimeProblem:
    """Residual and Jacobian of all recordings in the time domain, initial states included in the search variable.

    Args:
        recordings: checked recordings.
        engine: runs them.
        space: the free parameters.
    """

    def __init__(self, recordings: Sequence[Recording], engine: Engine, space: Space) -> None:
        self.recordings, self.engine, self.space = list(recordings), engine, space
        #: Of each recording, which sensors are fitted, and the noise of each.
        self.sensors = [[name for name in engine.sensors if name in r.sensors] for r in self.recordings]
        self.sigma = [
            np.array([noise_floor(r, name) for name in names])
            for r, names in zip(self.recordings, self.sensors, strict=True)
        ]
        self.evaluations = 0
        self._cache: tuple[bytes, np.ndarray, np.ndarray] | None = None

    @property
    def size(self) -> int:
        """Number of residuals, before their compression."""
        return sum(r.time_s.size * len(names) for r, names in zip(self.recordings, self.sensors, strict=True))

    @property
    def log_determinant(self) -> float:
        """Sum of the logarithms of all variances."""
        pairs = zip(self.recordings, self.sigma, strict=True)
        return float(sum(r.time_s.size * 2 * np.log(s) for r, sigma in pairs for s in sigma))

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (n,) of the search variable."""
        low, high = self.space.bounds
        limit = np.full(self._states * len(self.recordings), _STATE_LIMIT)
        return np.concatenate([low, -limit]), np.concatenate([high, limit])

    @property
    def _states(self) -> int:
        return self.engine.state_scale.size

    def start(self, q: np.ndarray) -> np.ndarray:
        """Full search variable (n,) of a start q (p,): rest in every recording."""
        return np.concatenate([q, np.zeros(self._states * len(self.recordings))])

    def residual(self, z: np.ndarray) -> np.ndarray:
        """Compressed residual (m,) at the full search variable z (n,)."""
        return self._evaluate(z)[0]

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """Its derivatives (m, n)."""
        return self._evaluate(z)[1]

    def states(self, z: np.ndarray, number: int) -> np.ndarray:
        """Initial states of one recording [m, m/s]."""
        p, ns = self.space.lower.size, self._states
        return z[p + number * ns : p + (number + 1) * ns] * self.engine.state_scale

    def certified(self, foot: Foot) -> "TimeProblem":
        """The same problem on MuJoCo's motion of a foot, whose step may be another."""
        if not isinstance(self.engine, Twin):  # it is MuJoCo's already
            return self
        drives = [Whole.of(recording, foot) for recording in self.recordings]
        return TimeProblem(self.recordings, CertifiedRollouts(foot, drives, self.engine.sensors), self.space)

    def rows(self, z: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of one recording, one sensor behind the other: model output (k n,), residual over its noise, and Jacobian.

        The Jacobian is (k n, p + states).
        """
        p = self.space.lower.size
        theta, recording = self.space.to_theta(z[:p]), self.recordings[number]
        values = self.space.values(theta)
        y, D = self.engine.run(number, values, self.space.names, self.states(z, number))
        if not (np.isfinite(y).all() and np.isfinite(D).all()):
            raise SimulationError(f"{recording.file}: the model became unstable.")
        n, outputs = recording.time_s.size, []
        for name, sigma in zip(self.sensors[number], self.sigma[number], strict=True):
            place = self.engine.sensors.index(name)
            rows = slice(place * n, (place + 1) * n)
            out, J = self._late(recording, values, delay_of(name).name, y[rows], D[rows])
            J[:, :p] *= self.space.slope(theta)
            outputs.append((out, (out - recording.sensors[name]) / sigma, J / sigma))
        if len(outputs) == 1:
            return outputs[0]
        outs, residuals, jacobians = zip(*outputs, strict=True)
        return np.concatenate(outs), np.concatenate(residuals), np.concatenate(jacobians)

    def _late(
        self, recording: Recording, values: Mapping[str, float], delay: str, y: np.ndarray, D: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output (n,) of one sensor as late as its channel, and its derivatives (n, p + states)."""
        columns = [D[:, self._states :], D[:, : self._states] * self.engine.state_scale]
        if self.space.has_delay:
            samples = recording.rate_hz * values.get(delay, 0.0)
            late, slope = delayed(np.column_stack([y, *columns]), samples), recording.rate_hz * delayed(y, samples, 1)
            y, width = late[:, 0], columns[0].shape[1]
            slopes = np.column_stack([slope if kind == delay else 0.0 * slope for kind in self.space.delays])
            columns = [late[:, 1 : 1 + width], slopes, late[:, 1 + width :]]
        return y, np.hstack(columns)

    def covariance(self, z: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Covariance (p, p) of q for coloured residuals: (J^T J)^-1 J^T R J (J^T J)^-1, R from their autocorrelation.

        The noise of the base sensor comes through the foot and is not white, and all sensors have it; ignoring that
        would make the standard errors wrong. The correlations are tapered (Bartlett) over 5 % of the recording. R has
        the uncertain gain and delay of the channels too, which all samples of all recordings share.

        Args:
            z: full search variable.
            active: (p,) which parameters vary; the others rest on a bound and get NaN.
        """
        p, total = self.space.lower.size, z.size
        varied = np.concatenate([active, np.ones(total - p, bool)])
        names = list(self.engine.sensors)
        middle, shared = np.zeros((total, total)), np.zeros((total, 2 * len(names)))
        for i, recording in enumerate(self.recordings):
            columns, sensors = self.columns(i), self.sensors[i]
            parts = [np.split(part, len(sensors)) for part in self.rows(z, i)]
            for k, (y, r, J) in enumerate(zip(*parts, strict=True)):
                middle[np.ix_(columns, columns)] += J.T @ _correlated(r, J)
                for m in range(len(sensors)):
                    if m != k:
                        middle[np.ix_(columns, columns)] += J.T @ _correlated(r, parts[2][m], parts[1][m])
                gain_std, delay_std_s = gain_and_delay(recording, sensors[k], "base")
                late = np.gradient(y, 1 / recording.rate_hz) * (0.0 if self.space.has_delay else delay_std_s)
                at = 2 * names.index(sensors[k])
                shared[columns, at : at + 2] += J.T @ np.column_stack([gain_std * y, late]) / self.sigma[i][k]
        middle += shared @ shared.T
        bread = inverse_of_gram(self.jacobian(z)[:, varied])
        blind = np.isinf(np.diag(bread))
        bread[blind] = bread[:, blind] = 0.0
        inner = bread @ middle[np.ix_(varied, varied)] @ bread
        inner[blind, blind] = np.inf
        full = np.full((total, total), np.nan)
        full[np.ix_(varied, varied)] = inner
        return full[:p, :p]

    def columns(self, number: int) -> np.ndarray:
        """Places (p + states,) of one recording's variables in the search variable."""
        p, ns = self.space.lower.size, self._states
        return np.concatenate([np.arange(p), p + number * ns + np.arange(ns)])

    def _evaluate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = z.tobytes()
        if self._cache is None or self._cache[0] != key:
            self.evaluations += 1
            width = self.space.lower.size + self._states + 1
            r, J = np.zeros(width * len(self.recordings)), np.zeros((width * len(self.recordings), z.size))
            try:
                for i in range(len(self.recordings)):
                    _, residual, D = self.rows(z, i)
                    R = np.asarray(np.linalg.qr(np.column_stack([D, residual]), mode="r"))
                    rows = slice(i * width, i * width + R.shape[0])
                    r[rows], J[rows, self.columns(i)] = R[:, -1], R[:, :-1]
            except SimulationError:
                r[:], J[:] = UNSTABLE, 0.0
            self._cache = (key, r, J)
        return self._cache[1], self._cache[2]


def noise_floor(recording: Recording, sensor: str = "malleolus") -> float:
    """Noise of a sensor's sample [m/s^2], base sensor included, from the spectra above 0.35 of the sampling rate."""
    floors, read = [], recording.sensors[sensor]
    for channel in (recording.base_m_s2, read):
        power = np.abs(np.fft.rfft(channel * np.hanning(channel.size))) ** 2
        floors.append(np.sqrt(np.median(power[int(0.7 * power.size) :]) / np.log(2) / (0.375 * channel.size)))
    gain = read.std() / recording.base_m_s2.std()
    floor = float(np.hypot(floors[1], gain * floors[0]))
    return max(floor, 1e-6 * float(read.std()))


def _correlated(r: np.ndarray, J: np.ndarray, other: np.ndarray | None = None) -> np.ndarray:
    """R J for the Toeplitz matrix R of the tapered correlation of r with itself, or with another residual, by FFT."""
    n, lags = r.size, max(10, r.size // 20)
    size = 2 ** int(np.ceil(np.log2(2 * n)))
    power = np.abs(np.fft.rfft(r, size)) ** 2
    if other is not None:
        power = np.fft.rfft(r, size) * np.conj(np.fft.rfft(other, size))
    correlation, taper = np.fft.irfft(power, size) / n, 1 - np.arange(lags) / lags
    kernel = np.zeros(size)
    kernel[:lags] = correlation[:lags] * taper
    kernel[-lags + 1 :] = (kernel[1:lags] if other is None else correlation[-1:-lags:-1] * taper[1:])[::-1]
    spectrum = np.fft.rfft(kernel)[:, None] * np.fft.rfft(J, size, axis=0)
    return np.fft.irfft(spectrum, size, axis=0)[:n]
