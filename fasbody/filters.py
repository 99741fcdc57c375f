"""The thesis' low-pass filter of section 2.2.3 and its peak-to-peak transmissibility."""

import numpy as np
from scipy.signal import butter, sosfilt, sosfiltfilt

from fasbody.exceptions import SettingError

ORDER = 5
CUTOFF_HZ = 100.0
_EDGE_S = 0.05


def lowpass(
    signal: np.ndarray, rate_hz: float, zero_phase: bool = True, cutoff_hz: float = CUTOFF_HZ, order: int = ORDER
) -> np.ndarray:
    """Butterworth low-pass filter.

    A single pass shifts by -93 degrees at 50 Hz, harmless only if every channel passes it. Forwards and backwards
    (`zero_phase`) shifts nothing and attenuates twice: -6 dB at the cut-off instead of -3 dB.

    Args:
        signal: (n,) or (n, channels). rate_hz: sampling rate. zero_phase: filter forwards and backwards.
        cutoff_hz: where a single pass attenuates by 3 dB. order: of a single pass.

    Raises:
        SettingError: the cut-off is not below half the sampling rate.
    """
    if not 0 < cutoff_hz < 0.5 * rate_hz:
        raise SettingError(f"a filter at {cutoff_hz:g} Hz needs sampling faster than {2 * cutoff_hz:g} Hz.")
    sections = butter(order, cutoff_hz, fs=rate_hz, output="sos")
    if zero_phase:
        return sosfiltfilt(sections, signal, axis=0, padlen=min(len(signal) - 1, round(3 * rate_hz / cutoff_hz)))
    return sosfilt(sections, signal, axis=0)


def peak_to_peak(
    out: np.ndarray, into: np.ndarray, rate_hz: float, zero_phase: bool = True, frequency_hz: float | None = None
) -> float:
    """Transmissibility by the peak-to-peak method of the thesis, after its filter.

    Noise widens both ranges, harmonics widen the one that has them: biased, kept for parity with print
    (`benchmarks/peak_to_peak.py` measures by how much).

    Args:
        out, into: (n,) accelerations. rate_hz: sampling rate. zero_phase: see `lowpass`; its transients of
            50 ms at both ends are left out. frequency_hz: if given, the mean range of single periods is taken
            instead of the range of the whole.
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
