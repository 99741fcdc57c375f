"""Harmonics of a periodic recording: least squares at the excitation frequency, with the noise of each.

A sine fit at a known frequency is the unbiased estimate of its amplitude and phase; fitted together with its harmonics
it is the discrete Fourier transform without leakage, for any number of samples a period. The excitation frequency
itself is refined from the base channel (four-parameter sine fit, IEEE Std 1057).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.presentation import Tabled
from fasbody.recording.clock import rate_of

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
        scatter: relative standard deviation of the fundamental over parts, less that of white noise.
        onset: relative difference of the first part from the others beyond noise: a start-up transient.
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
    rate = rate_of(time_s)
    fitted = max(count, min(_FITTED, int(0.45 * rate // frequency_hz)))
    coefficients, residual = _fitted(time_s, signal, frequency_hz, fitted)
    sigma = float(np.sqrt(residual @ residual / max(1, signal.size - coefficients.size)))
    amplitudes = coefficients[1::2] - 1j * coefficients[2::2]
    power = np.abs(np.fft.rfft(residual)) ** 2
    std = np.full(count, sigma) * np.sqrt(2 / signal.size) * _colour(power, rate / signal.size, frequency_hz, count)
    floor = float(np.sqrt(2 * _white(power)) / signal.size)  # sidebands left out
    std, scatter, onset = _with_scatter(time_s, signal, frequency_hz, std, amplitudes[0], floor)
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
    rate = rate_of(time_s)
    spectrum = np.abs(np.fft.rfft(signal * np.hanning(signal.size), 4 * signal.size))
    lowest = int(np.ceil(4 * signal.size * 0.5 / rate))
    return float((lowest + int(np.argmax(spectrum[lowest:]))) * rate / (4 * signal.size))


def _refined(time_s: np.ndarray, signal: np.ndarray, peak: float) -> float:
    """A frequency near a peak [Hz] by least squares."""
    f, middle = peak, float(time_s.mean())  # from the middle, where phase and frequency hardly share an error
    half = 0.5 * (time_s[-1] - time_s[0])
    for _ in range(20):  # Gauss-Newton on amplitude, phase and frequency
        N, right = np.zeros((5, 5)), np.zeros(5)
        for part in _blocks(time_s.size, _LONG):
            passed = time_s[part] - middle
            waves = columns(2 * np.pi * f * passed, 1)
            P = np.column_stack([waves, passed[:, None] / half * waves[:, 1:]])
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


#: Means of a long signal are not slower than this: feet are shaken at less than a quarter of it.
_SLOW_HZ = 500.0


def sine_share(time_s: np.ndarray, signal: np.ndarray, frequency_hz: float) -> float:
    """Share of the power of a signal (n,) that a frequency [Hz] and its harmonics explain; 1 if periodic."""
    rate = rate_of(time_s)
    count = max(1, min(_FITTED, int(0.45 * rate // frequency_hz)))
    centred = signal - signal.mean()
    _, residual = _fitted(time_s, signal, frequency_hz, count)
    return float(1 - residual @ residual / max(1e-300, centred @ centred))


def narrow_share(time_s: np.ndarray, signal: np.ndarray, frequency_hz: float) -> float:
    """Share of the power near a frequency and its harmonics, with drift and white noise not counted; 1 if a sine.

    Unlike `sine_share` it allows for a shaker that wanders in amplitude and frequency.

    Args:
        time_s: (n,) [s].
        signal: (n,), offset removed.
        frequency_hz: fundamental.
    """
    n, rate = signal.size, rate_of(time_s)
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


#: Samples whose columns fit a processor's memory, and of a signal that is looked through in means.
_BLOCK, _LONG = 1 << 15, 1_500_000


def columns(phase: np.ndarray, count: int) -> np.ndarray:
    """1, then cosine and sine of each multiple of a phase (n,) [rad] up to so many: (n, 2 count + 1)."""
    P = np.ones((2 * count + 1, phase.size))
    first = np.exp(1j * phase)
    turning = first.copy()
    for h in range(1, count + 1):  # by multiplication: sines of each would cost most of the fit
        P[2 * h - 1], P[2 * h] = turning.real, turning.imag
        turning *= first
    return P.T


def _blocks(size: int, length: int) -> Iterator[slice]:
    return (slice(start, start + length) for start in range(0, size, length))


def _fitted(time_s: np.ndarray, signal: np.ndarray, frequency_hz: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (2 count + 1,) of `columns`, and what they leave of a signal (n,)."""
    # block by block: all columns of an hour at 1 kHz would take 1 GB
    size = 2 * count + 1
    if time_s.size <= size:
        raise RecordingError(
            f"{time_s.size} samples are too few for {count} harmonics; record at least one period."
        )
    N, right, turns = np.zeros((size, size)), np.zeros(size), 2 * np.pi * frequency_hz * time_s
    for part in _blocks(signal.size, _BLOCK):
        P = columns(turns[part], count)
        N, right = N + P.T @ P, right + P.T @ signal[part]
    c = _solved(P, N, right, signal)
    if signal.size <= _BLOCK:
        return c, signal - P @ c
    left = [signal[part] - columns(turns[part], count) @ c for part in _blocks(signal.size, _BLOCK)]
    return c, np.concatenate(left)


def _solved(P: np.ndarray, N: np.ndarray, right: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Coefficients of columns P (n, p), or of all blocks of a long signal, with P^T P = N."""
    # harmonics over whole periods are nearly orthogonal: normal equations lose no digits there
    if len(P) < signal.size or np.linalg.cond(N) < 1e4:
        return np.linalg.solve(N, right)
    return least_squares(P, signal)


def least_squares(P: np.ndarray, signals: np.ndarray) -> np.ndarray:
    """Coefficients of columns P (n, p) in signals (n,) or (n, k): by QR, as an SVD does not always converge."""
    from scipy.linalg import lstsq

    rank = max(P.shape) * np.finfo(float).eps
    return np.asarray(lstsq(P, signals, cond=rank, lapack_driver="gelsy", check_finite=False)[0])


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
        if not 0.6 < local < 1.6:  # the mean of 33 white bins stays within: white noise keeps its exact weight
            out[h] = np.sqrt(local)
    return out


def _with_scatter(
    time_s: np.ndarray, signal: np.ndarray, frequency_hz: float, std: np.ndarray, fundamental: complex, floor: float,
) -> tuple[np.ndarray, float, float]:  # fmt: skip
    """Widen `std` to the scatter between parts that is beyond chance; white noise explains `floor`."""
    # noise alone is neither a drift nor a transient: a weak sine is as steady as a strong one
    periods = int((time_s[-1] - time_s[0]) * frequency_hz)
    parts = min(10, periods // 3)
    if parts < 4:
        return std, 0.0, 0.0
    rows = []
    for a, b in pairwise(np.linspace(0, time_s.size, parts + 1).astype(int)):
        c, _ = _fitted(time_s[a:b], signal[a:b], frequency_hz, std.size)
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
