"""Excitation by an input: its order, its band, and single sines with their harmonics."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, signal

from fasbody.exceptions import SettingError
from identification.blackbox.data import Series, listed

THRESHOLD = 1e-3  # of the largest singular value: weaker directions drown in sensor noise, whatever eps allows
LAGS = 200  # the largest excitation order looked for
LINES = 60  # excited frequencies up to which they count as separate lines
HARMONICS = 6  # of a sine that are looked for
SIGNIFICANT = 20.0  # times the median power: noise of a whole record reaches 14 to 17


@dataclass(frozen=True, eq=False)
class Excitation:
    """What the input of one recording, or of several pooled, excites.

    Attributes:
        rank: order of persistent excitation, counted up to `limit`; the number of plant parameters it determines.
        limit: number of lags examined.
        frequency_hz: fundamental of a periodic input; NaN otherwise.
        harmonics: significant multiples of the fundamental, 1 included; empty unless the input is a single sine.
        band_hz: frequencies at which the input stands out, shape (M,), rising.
    """

    rank: int
    limit: int
    frequency_hz: float
    harmonics: tuple[int, ...]
    band_hz: np.ndarray

    @property
    def single_sine(self) -> bool:
        """Whether the input is one sine with its harmonics."""
        return bool(self.harmonics)

    @property
    def lines(self) -> bool:
        """Whether the input is separate spectral lines, between which nothing is known."""
        return len(self.band_hz) <= LINES

    def warning(self, parameters: int) -> str:
        """The sentence for a model with `parameters` plant coefficients, or an empty string."""
        if parameters <= self.rank or self.rank >= self.limit:
            return ""
        cause = f"a single {self.frequency_hz:.4g} Hz sine" if self.single_sine else "this input"
        return (
            f"{cause} excites rank {self.rank}, but the plant has {parameters} coefficients: "
            f"{parameters - self.rank} combinations of them are arbitrary, and so is the response elsewhere"
        )

    def __str__(self) -> str:
        if self.single_sine:
            lines = ", ".join(f"{h * self.frequency_hz:.4g}" for h in self.harmonics)
            return (
                f"a single sine of {self.frequency_hz:.4g} Hz, rank {self.rank}: it determines gain and phase "
                f"at {lines} Hz only; pool recordings at several frequencies for a transfer function"
            )
        more = " or more" if self.rank >= self.limit else ""
        return f"rank {self.rank}{more}, excited from {self.band_hz[0]:.4g} to {self.band_hz[-1]:.4g} Hz"


def examine(recordings: Series | Sequence[Series]) -> Excitation:
    """Excitation of one recording or of many pooled (their excited directions add up)."""
    pooled = listed(recordings)
    limit = min(LAGS, min(len(series) for series in pooled) // 3)
    gram = np.zeros((limit, limit))
    bands = []
    for series in pooled:
        clean, band = _significant_part(series)
        gram += _gram(clean, limit) / np.mean(clean**2) / len(clean)
        bands.append(band)
    size = np.sqrt(np.maximum(linalg.eigvalsh(gram), 0.0))
    rank = int(np.sum(size > THRESHOLD * size[-1]))
    band = np.unique(np.concatenate(bands))
    sines = [single_sine(series) for series in pooled]
    first = sines[0][0]
    if not all(multiples and abs(f / first - 1) < 0.01 for f, multiples in sines):
        return Excitation(rank, limit, np.nan, (), band)
    harmonics = tuple(sorted(set().union(*(multiples for _, multiples in sines))))
    return Excitation(min(rank, 2 * len(harmonics)), limit, first, harmonics, band)


def _significant_part(series: Series) -> tuple[np.ndarray, np.ndarray]:
    """The input without spectral lines at its noise floor, and the frequencies of the lines kept.

    The floor is the median power; an input whose lines all keep close to it (white noise, a pseudo-random binary
    signal) is kept whole. Lines hold the power, two bins or more from zero; that of a step falls from zero on.
    """
    u = series.u - series.u.mean()
    spectrum = np.fft.rfft(u)
    frequency = np.fft.rfftfreq(len(u), series.sample_time)
    power = np.abs(spectrum) ** 2
    floor = max(float(np.median(power[1:])), 1e-20 * float(power.max()))
    strong = power > SIGNIFICANT * floor
    kept = power[strong].sum()
    smooth = np.convolve(power, np.ones(9) / 9, mode="same")
    broad = frequency[(smooth > 1e-4 * smooth.max()) & (frequency > 0)]
    if kept < 0.9 * power.sum():  # a few bins above the floor are chance
        return u, broad
    windowed = np.abs(np.fft.rfft(np.hanning(len(u)) * u)) ** 2  # without the skirts of lines between the bins
    lines = (windowed > 1e-4 * windowed.max()) & (windowed > SIGNIFICANT * np.median(windowed)) & (frequency > 0)
    lines[1:-1] &= (windowed[1:-1] >= windowed[:-2]) & (windowed[1:-1] > windowed[2:])  # tops, not their flanks
    lines[:2] = False
    above = np.where(windowed > SIGNIFICANT * np.median(windowed), windowed, 0.0)
    beside = np.convolve(lines, np.ones(5), mode="same") > 0  # a line's lobe behind a Hann window is two bins wide
    band = frequency[lines] if above[beside].sum() > 0.9 * above.sum() else broad
    return np.fft.irfft(np.where(strong, spectrum, 0.0), len(u)), band


def attenuation(recordings: Sequence[Series], noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz], and the share of a plant's gain that white noise of the input's sensor takes of its estimate.

    It is S_nn / (S_uu - S_nn), S_uu of the measured input.

    Raises:
        SettingError: the noise is not smaller than the input.
    """
    power = np.mean([np.var(series.u) for series in recordings])
    if not 0 <= noise**2 < power:
        raise SettingError(
            f"input noise {noise:g} is not between 0 and the standard deviation {np.sqrt(power):.4g} of the input.",
            setting="input_noise",
        )
    length, rate = min(256, *(len(series) // 2 for series in recordings)), 1 / recordings[0].sample_time
    spectra = [signal.welch(series.u, rate, nperseg=length)[1] for series in recordings]
    frequency = np.fft.rfftfreq(length, 1 / rate)
    taken = np.minimum(2 * noise**2 / rate / np.maximum(np.mean(spectra, axis=0), 1e-300), 0.9)
    return frequency[1:], (taken / (1 - taken))[1:]


def _gram(u: np.ndarray, lags: int) -> np.ndarray:
    """Inner products of all pairs of delayed inputs over the complete rows, shape (lags, lags)."""
    rows = np.lib.stride_tricks.sliding_window_view(u, lags)[:, ::-1]
    parts = (rows[k : k + 10_000] for k in range(0, len(rows), 10_000))
    return np.sum([part.T @ part for part in parts], axis=0)


def single_sine(series: Series) -> tuple[float, tuple[int, ...]]:
    """Frequency [Hz] and significant harmonics of an input that is one sine; no harmonics when it is not.

    A harmonic counts when it has more than a thousandth of the fundamental and five of its standard errors.
    """
    u = series.u - series.u.mean()
    frequency = fundamental(u, series.sample_time)
    multiples = [h for h in range(1, HARMONICS + 1) if h * frequency < 0.5 / series.sample_time]
    if not multiples or frequency * series.sample_time * len(u) < 2:
        return frequency, ()
    amplitude, sigma, rest = sine_fit(u, series.sample_time, frequency, multiples)
    if rest > 0.05 * np.mean(u**2) or abs(amplitude[0]) ** 2 / 2 < 0.5 * np.mean(u**2):
        return frequency, ()
    size = np.abs(amplitude)
    return frequency, tuple(
        h for h, a in zip(multiples, size, strict=True) if h == 1 or a > max(THRESHOLD * size[0], 5 * sigma)
    )


def fundamental(u: np.ndarray, sample_time: float) -> float:
    """Frequency [Hz] of the strongest line: the spectrum's peak, refined by Gauss-Newton on one sine and a level."""
    power = np.abs(np.fft.rfft(np.hanning(len(u)) * u)) ** 2
    peak = int(np.argmax(power[1:])) + 1
    width = 1.0 / (len(u) * sample_time)
    frequency = peak * width
    t = (np.arange(len(u)) - (len(u) - 1) / 2) * sample_time
    for _ in range(6):
        cosine, sine = np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)
        phi = np.column_stack([np.ones(len(u)), cosine, sine])
        a, b = np.linalg.lstsq(phi, u, rcond=None)[0][1:]
        slope = 2 * np.pi * t * (b * cosine - a * sine)
        step = np.linalg.lstsq(np.column_stack([phi, slope]), u, rcond=None)[0][3]
        step = float(np.clip(step, -0.5 * width, 0.5 * width))
        if not max(peak - 1.5, 0.2) * width < frequency + step < (peak + 1.5) * width:
            break  # not one line: keep the best so far
        frequency += step
        if abs(step) < 1e-7 * width:
            break
    return float(frequency)


def sine_fit(
    signal: np.ndarray, sample_time: float, frequency: float, multiples: Sequence[float]
) -> tuple[np.ndarray, float, float]:
    """Least-squares complex amplitudes at multiples of a frequency.

    Returns:
        amplitudes Z_h of Re(Z_h exp(2 pi i h f t)), shape (H,); the standard error of their real and imaginary
        parts under white noise; the mean square of what is left.
    """
    angle = 2 * np.pi * frequency * sample_time * np.arange(len(signal))
    columns = [np.ones(len(signal))]
    for h in multiples:
        columns += [np.cos(h * angle), -np.sin(h * angle)]
    phi = np.column_stack(columns)
    solution = linalg.solve(phi.T @ phi, phi.T @ signal, assume_a="pos", check_finite=False)
    rest = signal - phi @ solution
    mean_square = float(rest @ rest / max(len(signal) - phi.shape[1], 1))
    return solution[1::2] + 1j * solution[2::2], float(np.sqrt(2 * mean_square / len(signal))), mean_square
