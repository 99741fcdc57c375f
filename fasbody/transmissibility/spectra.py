"""The thesis' low-pass filter of section 2.2.3 and its peak-to-peak transmissibility.

Cross-spectra: the phase of Eqs. (2.2), (2.3), and H1, H2, Hv with coherence for broadband excitation.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import butter, csd, sosfilt, sosfiltfilt, welch
from scipy.signal import detrend as remove_mean

from fasbody.exceptions import RecordingError, SettingError
from fasbody.presentation import Tabled

ORDER = 5
CUTOFF_HZ = 100.0
_EDGE_S = 0.05


def lowpass(signal: np.ndarray, rate_hz: float, zero_phase: bool = True) -> np.ndarray:
    """Butterworth low-pass filter of section 2.2.3.

    A single pass shifts by -93 degrees at 50 Hz, harmless only if every channel passes it. Forwards and backwards
    (`zero_phase`) shifts nothing and attenuates twice: -6 dB at the cut-off instead of -3 dB.

    Args:
        signal: (n,) or (n, channels).
        rate_hz: sampling rate.
        zero_phase: filter forwards and backwards.

    Raises:
        SettingError: the cut-off is not below half the sampling rate.
    """
    if rate_hz <= 2 * CUTOFF_HZ:
        raise SettingError(f"a filter at {CUTOFF_HZ:g} Hz needs sampling faster than {2 * CUTOFF_HZ:g} Hz.")
    sections = butter(ORDER, CUTOFF_HZ, fs=rate_hz, output="sos")
    if zero_phase:
        return sosfiltfilt(sections, signal, axis=0, padlen=min(len(signal) - 1, round(3 * rate_hz / CUTOFF_HZ)))
    return sosfilt(sections, signal, axis=0)


def peak_to_peak(
    out: np.ndarray, into: np.ndarray, rate_hz: float, zero_phase: bool = True, frequency_hz: float | None = None
) -> float:
    """Transmissibility by the peak-to-peak method of the thesis, after its filter.

    Noise widens both ranges, harmonics widen the one that has them: biased, kept for parity with print
    (`benchmarks/peak_to_peak.py` measures by how much).

    Args:
        out: (n,) acceleration [m/s^2].
        into: (n,) acceleration [m/s^2].
        rate_hz: sampling rate.
        zero_phase: see `lowpass`; its transients of 50 ms at both ends are left out.
        frequency_hz: if given, the mean range of single periods is taken instead of that of the whole.
    """
    filtered = lowpass(np.column_stack([into, out]), rate_hz, zero_phase)
    edge = min(round(_EDGE_S * rate_hz), len(filtered) // 4)
    filtered = filtered[edge : len(filtered) - edge]
    if frequency_hz is None:
        accel_in, accel_out = np.ptp(filtered, axis=0)
    else:
        period = int(np.ceil(rate_hz / frequency_hz))
        windows = np.lib.stride_tricks.sliding_window_view(filtered, period, axis=0)[::period]
        accel_in, accel_out = np.ptp(windows, axis=-1).mean(axis=0)
    return float(accel_out / accel_in)  # Eq. (2.1)


def cross_covariance(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """C_XY(k) for lags k = 0 ... N-1, (N,); means removed."""
    x, y = x - x.mean(), y - y.mean()
    N = x.size
    size = 1 << (2 * N - 1).bit_length()
    product = np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size)
    return np.fft.irfft(product, size)[:N] / N  # Eq. (2.3)


def cross_spectrum(x: np.ndarray, y: np.ndarray, rate_hz: float, frequency_hz: float) -> complex:
    """Z_XY at one frequency, the exponent with omega_0 (docs/errata.md); its phase is that of y relative to x.

    The covariance of a finite record decays linearly with the lag and only positive lags enter, which biases the phase
    by up to 1 / (2 periods) rad; whole periods are taken, and the sum over both signs of the lag makes it exact.

    Args:
        x: (n,) input.
        y: (n,) output.
        rate_hz: sampling rate.
        frequency_hz: n omega_0 / (2 pi) of the equation.
    """
    periods = int(x.size * frequency_hz / rate_hz)
    if periods < 1:
        raise RecordingError(f"a cross-spectrum at {frequency_hz:g} Hz needs at least one period.")
    N = round(periods * rate_hz / frequency_hz)
    C = np.concatenate([cross_covariance(y[:N], x[:N])[:0:-1], cross_covariance(x[:N], y[:N])])
    k = np.arange(1 - N, N)
    return complex(np.mean(C * np.exp(-2j * np.pi * frequency_hz * k / rate_hz)) * C.size / N)  # Eq. (2.2)


@dataclass(frozen=True, eq=False)
class FrequencyResponse(Tabled):
    """Estimate by averaged spectra for broadband excitation.

    Attributes:
        frequency_hz: (n,).
        H: (n,) complex.
        coherence: (n,) 0 to 1.
        std: (n,) standard deviation of |H|, and of its phase times |H|.
        averages: number of independent segments.
    """

    frequency_hz: np.ndarray
    H: np.ndarray
    coherence: np.ndarray
    std: np.ndarray
    averages: float


#: Frequencies whose input lies this far below the strongest are not estimated: there is nothing but noise.
_EXCITED = 1e-3
#: And those that are not so many times above the noise of the quietest tenth.
_ABOVE_NOISE = 5.0
#: The excited band leaves out this share of the power below it, and above: what leaks from the mean and other bands.
_OUTSIDE = 1e-3


def excited(x: np.ndarray, rate_hz: float, resolution_hz: float = 1.0) -> np.ndarray:
    """Which frequencies of `h1` an input excites, (f,) bool: one band, without the gaps of a comb within it.

    Raises:
        RecordingError: shorter than three segments.
    """
    _, power = welch(remove_mean(x, type="constant"), **_segments(x, rate_hz, resolution_hz)[1])
    power[0] = 0.0
    noise = np.quantile(power, 0.1)
    if noise < 0.1 * power.max():  # else all frequencies are excited, and nothing shows the noise
        power = np.where(power > _ABOVE_NOISE * noise, power, 0.0)
    below = np.cumsum(power) / power.sum()
    return (below > _OUTSIDE) & (below - power / power.sum() < 1 - _OUTSIDE) & (power > _EXCITED * power.max())


def h1(
    x: np.ndarray, y: np.ndarray, rate_hz: float, resolution_hz: float = 1.0, use: np.ndarray | None = None
) -> FrequencyResponse:
    """H1 = S_xy / S_xx, as `by_welch` gives it."""
    return by_welch(x, y, rate_hz, resolution_hz, use)


#: Ways to divide averaged spectra: noise of the output only, of the input only, of both in proportion to their power.
WELCH = ("H1", "H2", "Hv")


def by_welch(
    x: np.ndarray, y: np.ndarray, rate_hz: float, resolution_hz: float = 1.0, use: np.ndarray | None = None,
    kind: str = "H1",
) -> FrequencyResponse:  # fmt: skip
    """H1, H2 or Hv by Welch's method with Hann windows, half overlapping, where the input has power.

    H1 = S_xy / S_xx is too small by the noise of the input, H2 = S_yy / S_yx too large by that of the output, and Hv,
    their geometric mean, is right where both channels have noise of the same share of their power.

    Args:
        x: (n,) input.
        y: (n,) output.
        rate_hz: sampling rate.
        resolution_hz: distance of the frequencies.
        use: (f,) where to estimate, from `excited` of the shaker's motion; default where the input itself has power.
        kind: one of `WELCH`.

    Raises:
        RecordingError: shorter than three segments. SettingError: no such kind.
    """
    if kind not in WELCH:
        raise SettingError(f"no estimate by Welch's method is named {kind!r} (valid: {', '.join(WELCH)}).")
    segments, common = _segments(x, rate_hz, resolution_hz)
    use = excited(x, rate_hz, resolution_hz) if use is None else use
    x, y = remove_mean(x, type="constant"), remove_mean(y, type="constant")
    f, Sxx = welch(x, **common)
    Syy, Sxy = welch(y, **common)[1], csd(x, y, **common)[1]
    H, coherence = Sxy[use] / Sxx[use], np.abs(Sxy[use]) ** 2 / (Sxx[use] * Syy[use])
    averages = 18 * segments**2 / (19 * segments - 1)  # independent ones of half overlapping Hann windows
    H = H * np.maximum(coherence, 1e-12) ** {"H1": 0.0, "H2": -1.0, "Hv": -0.5}[kind]
    std = np.abs(H) * np.sqrt(np.maximum(0, 1 - coherence) / (2 * averages * np.maximum(coherence, 1e-12)))
    return FrequencyResponse(f[use], H, coherence, std, averages)


def _segments(x: np.ndarray, rate_hz: float, resolution_hz: float) -> tuple[int, dict[str, Any]]:
    """How many segments Welch's method has, and its settings."""
    length = round(rate_hz / resolution_hz)
    segments = (x.size - length) // (length // 2) + 1 if x.size >= length else 0
    if segments < 3:
        raise RecordingError(
            f"{x.size / rate_hz:.3g} s are too short for a resolution of {resolution_hz:g} Hz; "
            f"record at least {2 / resolution_hz:g} s or ask for a coarser one."
        )
    return segments, {"fs": rate_hz, "nperseg": length, "noverlap": length // 2, "window": "hann"}
