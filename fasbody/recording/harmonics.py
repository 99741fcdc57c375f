"""Harmonics of a periodic recording: least squares at the excitation frequency, with the noise of each.

A sine fit at a known frequency is the unbiased estimate of its amplitude and phase; fitted together with its harmonics
it is the discrete Fourier transform without leakage, for any number of samples a period. The excitation frequency
itself is refined from the base channel (four-parameter sine fit, IEEE Std 1057).
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.presentation import Tabled

#: Harmonics fitted so that the residual is noise; those above HIGHEST_HZ only serve that.
_FITTED = 20
#: The thesis filters at 100 Hz (section 2.2.3): harmonics above that are not compared.
HIGHEST_HZ = 100.0
HARMONICS = 6
#: Scatter over that of the noise beyond chance: chi-square with 6 degrees of freedom or more exceeds it once in 1000.
_BEYOND = 2.0


@dataclass(frozen=True, eq=False)
class Harmonics(Tabled):
    """Complex amplitudes of one channel: signal = offset + sum over h of Re(amplitude_h exp(i 2 pi h f t)).

    Attributes:
        frequency_hz: fundamental.
        amplitudes: (H,) complex [m/s^2].
        std: (H,) standard deviation of the real, and of the imaginary, part of each.
        offset: mean [m/s^2].
        sigma: standard deviation of the noise in a sample [m/s^2].
        scatter: relative standard deviation of the fundamental over the recording's parts, less
            what white noise makes of it: how periodic it is.
        onset: relative difference of the first part's fundamental from the others', where it is
            more than noise: a start-up transient.
    """

    frequency_hz: float
    amplitudes: np.ndarray
    std: np.ndarray
    offset: float
    sigma: float
    scatter: float
    onset: float

    def __str__(self) -> str:
        size = ", ".join(f"{abs(a):.4g}" for a in self.amplitudes)
        return f"{self.frequency_hz:.5g} Hz: amplitudes {size} m/s^2, noise {self.sigma:.2g} m/s^2"


def harmonic_count(frequency_hz: float, rate_hz: float) -> int:
    """Harmonics compared at an excitation frequency: six, or those up to 100 Hz and 0.4 of the sampling rate."""
    highest = 1.001 * min(HIGHEST_HZ, 0.4 * rate_hz)  # a frequency found a little high must not lose its 100 Hz line
    return max(1, min(HARMONICS, int(highest // frequency_hz)))


def fit_harmonics(time_s: np.ndarray, signal: np.ndarray, frequency_hz: float, count: int) -> Harmonics:
    """Fit harmonics 1..count of a known frequency by least squares, with offset.

    The noise of each amplitude comes from the residual, its spectrum near that harmonic where the noise is not white,
    and from the scatter between parts of the recording where that is larger than the noise explains.

    Args:
        time_s: (n,) [s].
        signal: (n,) [m/s^2].
        frequency_hz: fundamental.
        count: how many harmonics to return.
    """
    rate = (time_s.size - 1) / (time_s[-1] - time_s[0])
    fitted = max(count, min(_FITTED, int(0.45 * rate // frequency_hz)))
    basis = _basis(time_s, frequency_hz, fitted)
    coefficients = basis.solve(signal)
    residual = basis.residual(signal, coefficients)
    dof = max(1, signal.size - coefficients.size)
    sigma = float(np.sqrt(residual @ residual / dof))
    amplitudes = coefficients[1::2] - 1j * coefficients[2::2]
    power = np.abs(np.fft.rfft(residual)) ** 2
    std = np.full(count, sigma) * np.sqrt(2 / signal.size) * _colour(power, rate / signal.size, frequency_hz, count)
    floor = float(np.sqrt(2 * _white(power)) / signal.size)  # sidebands left out
    std, scatter, onset = _with_scatter(basis, time_s, signal, frequency_hz, count, std, amplitudes[0], floor)
    return Harmonics(frequency_hz, amplitudes[:count], std, float(coefficients[0]), sigma, scatter, onset)


def find_frequency(time_s: np.ndarray, signal: np.ndarray) -> float:
    """Fundamental frequency [Hz] of a periodic signal, to a small fraction of the inverse length.

    Args:
        time_s: (n,) [s].
        signal: (n,), offset removed.
    """
    thin = max(1, min(-(-time_s.size // _LONG), int((time_s.size - 1) / (time_s[-1] - time_s[0]) / _SLOW_HZ)))
    if thin == 1:
        return _refined(time_s, signal, _highest(time_s, signal))
    kept = time_s.size // thin * thin  # a long signal is looked through in means of a few samples first
    few = [x[:kept].reshape(-1, thin).mean(axis=1) for x in (time_s, signal)]
    return _refined(time_s, signal, _refined(few[0], few[1], _highest(few[0], few[1])))


def _highest(time_s: np.ndarray, signal: np.ndarray) -> float:
    """Where the spectrum is highest [Hz]."""
    rate = (time_s.size - 1) / (time_s[-1] - time_s[0])
    spectrum = np.abs(np.fft.rfft(signal * np.hanning(signal.size), 4 * signal.size))
    lowest = int(np.ceil(4 * signal.size * 0.5 / rate))
    return float((lowest + int(np.argmax(spectrum[lowest:]))) * rate / (4 * signal.size))


def _refined(time_s: np.ndarray, signal: np.ndarray, peak: float) -> float:
    """A frequency near a peak [Hz] by least squares."""
    f, middle = peak, float(time_s.mean())  # from the middle, where phase and frequency hardly share an error
    half = 0.5 * (time_s[-1] - time_s[0])
    blocks = [slice(a, a + _LONG) for a in range(0, time_s.size, _LONG)]
    for _ in range(20):  # Gauss-Newton on amplitude, phase and frequency
        N, right = np.zeros((5, 5)), np.zeros(5)
        for part in blocks:
            P = _with_slopes(time_s[part] - middle, f, half)
            N, right = N + P.T @ P, right + P.T @ signal[part]
        c = _solved(P[:, :3], N[:3, :3], right[:3], signal)
        size = np.hypot(c[1], c[2]) or 1.0
        slope = np.eye(5, 4)
        slope[3:, 3] = c[2] / size, -c[1] / size  # of a change of frequency
        step = _solved(P @ slope, slope.T @ N @ slope, slope.T @ right, signal)[3] / (2 * np.pi * half * size)
        f += step
        if not 0.5 * peak < f < 2 * peak:
            return peak
        if abs(step) < 1e-9 * peak:
            break
    return float(f)


def _with_slopes(passed: np.ndarray, f: float, half: float) -> np.ndarray:
    """1, cos, sin, and the latter two times the time (n,) over its half length."""
    turn = 2 * np.pi * f * passed
    cos, sin = np.cos(turn), np.sin(turn)
    return np.column_stack([np.ones_like(turn), cos, sin, passed / half * cos, passed / half * sin])


#: Means of a long signal are not slower than this: feet are shaken at less than a quarter of it.
_SLOW_HZ = 500.0


def sine_share(time_s: np.ndarray, signal: np.ndarray, frequency_hz: float) -> float:
    """Share of the power of a signal (n,) that a frequency [Hz] and its harmonics explain; 1 if periodic."""
    rate = (time_s.size - 1) / (time_s[-1] - time_s[0])
    basis = _basis(time_s, frequency_hz, max(1, min(_FITTED, int(0.45 * rate // frequency_hz))))
    centred = signal - signal.mean()
    residual = basis.residual(signal, basis.solve(signal))
    return float(1 - residual @ residual / max(1e-300, centred @ centred))


def narrow_share(time_s: np.ndarray, signal: np.ndarray, frequency_hz: float) -> float:
    """Share of the power near a frequency and its harmonics, with drift and white noise not counted; 1 if a sine.

    Unlike `sine_share` it allows for a shaker that wanders in amplitude and frequency.

    Args:
        time_s: (n,) [s].
        signal: (n,), offset removed.
        frequency_hz: fundamental.
    """
    n = signal.size
    rate = (n - 1) / (time_s[-1] - time_s[0])
    power = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(n))) ** 2
    f = np.arange(power.size) * rate / n
    white = _white(power)
    if white * power.size > _MOST_NOISE * power.sum():  # so much power is no noise of a sensor
        white = 0.0
    power = np.maximum(0.0, power - white)
    power[f < min(1.0, 0.25 * frequency_hz)] = 0.0
    near = np.abs(f - frequency_hz * np.maximum(1, np.round(f / frequency_hz))) < max(0.6, 3 * rate / n)
    return float(power[near].sum() / max(1e-300, power.sum()))


#: White noise of a sensor has at most this share of the power.
_MOST_NOISE = 0.2


#: Samples whose columns fit a processor's memory, and from which on columns are not kept.
_BLOCK, _LONG = 1 << 15, 1_500_000


class _Basis:
    """1 and the harmonics of a frequency, as columns P (n, 2 h + 1) of a least-squares fit.

    Of very many samples they are made anew, block by block, for each use: 41 columns of 3e6 samples
    take 1 GB.
    """

    def __init__(
        self, time_s: np.ndarray, frequency_hz: float, count: int, keep: bool = True
    ) -> None:
        if time_s.size <= 2 * count + 1:
            raise RecordingError(
                f"{time_s.size} samples are too few for {count} harmonics; record at least one "
                "period."
            )
        self.time_s, self.frequency_hz, self.count = time_s, frequency_hz, count
        self._columns = _columns(time_s, frequency_hz, count) if keep else None
        self._parts: dict[tuple[int, int], list[tuple[slice, _Basis]]] = {}

    def blocks(self) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """The samples of each block, its columns P, and P^T P."""
        if self._columns is not None:
            yield slice(None), *self._columns
            return
        for start in range(0, self.time_s.size, _BLOCK):
            part = slice(start, start + _BLOCK)
            yield part, *_columns(self.time_s[part], self.frequency_hz, self.count)

    def solve(self, signal: np.ndarray) -> np.ndarray:
        """Coefficients (2 h + 1,) of a signal (n,)."""
        size = 2 * self.count + 1
        N, right, P = np.zeros((size, size)), np.zeros(size), np.empty((0, size))
        for part, P, products in self.blocks():
            N, right = N + products, right + P.T @ signal[part]
        return _solved(P, N, right, signal)

    def residual(self, signal: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """What the columns leave of a signal (n,)."""
        return np.concatenate([signal[part] - P @ coefficients for part, P, _ in self.blocks()])

    def parts(self, count: int, parts: int) -> "list[tuple[slice, _Basis]]":
        """The first `count` harmonics on each of so many parts of the time."""
        if (count, parts) not in self._parts:
            edges = np.linspace(0, self.time_s.size, parts + 1).astype(int)
            keep = self._columns is not None
            self._parts[count, parts] = [
                (slice(a, b), _Basis(self.time_s[a:b], self.frequency_hz, count, keep))
                for a, b in pairwise(edges)
            ]
        return self._parts[count, parts]


def _solved(P: np.ndarray, N: np.ndarray, right: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Coefficients of columns P (n, p), or of all blocks of a long signal, with P^T P = N.

    Harmonics over whole periods are nearly orthogonal: normal equations lose no digits there.
    """
    if len(P) < signal.size or np.linalg.cond(N) < 1e4:
        return np.linalg.solve(N, right)
    return np.linalg.lstsq(P, signal, rcond=None)[0]


def _basis(time_s: np.ndarray, frequency_hz: float, count: int) -> _Basis:
    if time_s.size > _LONG:
        return _Basis(time_s, frequency_hz, count, keep=False)
    return _shared_basis(time_s.tobytes(), frequency_hz, count)


@functools.lru_cache(maxsize=4)  # the channels of a recording have one basis
def _shared_basis(times: bytes, frequency_hz: float, count: int) -> _Basis:
    return _Basis(np.frombuffer(times), frequency_hz, count)


def _columns(
    time_s: np.ndarray, frequency_hz: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Columns P (n, 2 h + 1), and P^T P."""
    P = np.ones((2 * count + 1, time_s.size))
    first = np.exp(2j * np.pi * frequency_hz * time_s)
    turning, sums = first.copy(), [complex(time_s.size)]
    for m in range(1, 2 * count + 1):  # by multiplication: sines of each would cost most of the fit
        if m <= count:
            P[2 * m - 1], P[2 * m] = turning.real, turning.imag
        sums.append(turning.sum())
        turning *= first
    return P.T, _products(np.array(sums))


def _products(sums: np.ndarray) -> np.ndarray:
    """P^T P of 1, cos wt, sin wt, cos 2wt, ... from the sums of exp(i m w t), m = 0 to 2 H, over all samples.

    2 cos h cos k = cos(h - k) + cos(h + k) and so on: 2 H sums in place of (2 H + 1)^2 products of long columns.
    """
    h = np.arange(len(sums) // 2 + 1)
    less, more = h - h[:, None], h + h[:, None]
    C, S = sums.real, sums.imag
    near, far = C[abs(less)], C[more]
    mixed = (S[more] + np.sign(less) * S[abs(less)]) / 2  # cos of the row, sin of the column
    N = np.empty((2 * h.size, 2 * h.size))  # with sin 0, which goes
    N[::2, ::2], N[1::2, 1::2] = (near + far) / 2, (near - far) / 2
    N[::2, 1::2], N[1::2, ::2] = mixed, mixed.T
    kept = np.arange(2 * h.size) != 1
    return N[np.ix_(kept, kept)]


def _white(power: np.ndarray) -> float:
    """Mean power of a line of white noise, by the median (n,), which few strong lines do not move."""
    return float(np.median(power)) / np.log(2)


def _colour(power: np.ndarray, bin_hz: float, frequency_hz: float, count: int) -> np.ndarray:
    """Noise near each harmonic over its mean over all frequencies (count,), 1 where the noise is white."""
    mean = power[1:].mean() or 1.0
    half = max(16, round(1.0 / bin_hz))
    out = np.ones(count)
    for h in range(count):
        centre = round((h + 1) * frequency_hz / bin_hz)
        local = power[max(1, centre - half) : centre + half + 1].mean() / mean
        if (
            not 0.6 < local < 1.6
        ):  # the mean of 33 or more white bins stays within, so white noise keeps its exact weight
            out[h] = np.sqrt(local)
    return out


def _with_scatter(
    basis: _Basis,
    time_s: np.ndarray,
    signal: np.ndarray,
    frequency_hz: float,
    count: int,
    std: np.ndarray,
    fundamental: complex,
    floor: float,
) -> tuple[np.ndarray, float, float]:
    """Widen `std` to the scatter between parts of the recording where that is larger beyond chance.

    Noise alone is neither a drift nor a transient: a weak sine is as steady as a strong one. `floor` is the standard
    deviation of a real part of the mean that white noise explains.
    """
    periods = int((time_s[-1] - time_s[0]) * frequency_hz)
    parts = min(10, periods // 3)
    if parts < 4:
        return std, 0.0, 0.0
    rows = []
    for part, piece in basis.parts(count, parts):
        c = piece.solve(signal[part])
        rows.append(c[1::2] - 1j * c[2::2])
    between = np.std(np.array(rows), axis=0, ddof=1) / np.sqrt(2 * parts)  # of a real part of the mean
    size = max(1e-300, abs(fundamental))
    more = between[0] ** 2 - floor**2 if between[0] > _BEYOND * floor else 0.0
    scatter = float(np.sqrt(2 * parts * more) / size)
    beyond = between > _BEYOND * std
    first = [row[0] for row in rows]
    late = abs(first[0] - np.mean(first[1:]))
    onset = float(late / size) if late > 2 * _BEYOND * floor * np.sqrt(parts) else 0.0
    return np.where(beyond, between, std), scatter, onset
