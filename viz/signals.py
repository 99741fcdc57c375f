"""A recording as it was made, for the page: its traces, their spectra, and which columns of the file they are of."""

from dataclasses import replace
from typing import Any

import numpy as np

from fasbody.recording.checks import judged
from viz.source import Source

#: Most points of a trace and of a spectrum that the page gets.
POINTS, BINS = 40_000, 2_000


def signals(source: Source) -> dict[str, Any]:
    """All of a recording, with the spectra of the seconds that are fitted.

    Raises:
        InputFileError: it cannot be read. RecordingError: the seconds hold no samples.
    """
    from scipy.signal import periodogram

    whole = replace(source, start_s=None, end_s=None).read()
    part = whole.between(source.start_s, source.end_s)
    time = whole.time_s - whole.time_s[0]
    traces, spectra = {}, {}
    for name, values in whole.accelerations.items():
        kept = _extremes(values)
        traces[name] = {"time_s": time[kept].round(6).tolist(), "m_s2": values[kept].round(5).tolist()}
        frequency, power = periodogram(part.accelerations[name], part.rate_hz, "hann", scaling="spectrum")
        amplitude = np.sqrt(2 * power)
        kept = _extremes(amplitude, BINS)[1:]  # without the mean
        kept = kept[amplitude[kept] > 0]
        spectra[name] = {"frequency_hz": frequency[kept].tolist(), "m_s2": amplitude[kept].tolist()}
    return {
        "traces": traces, "spectra": spectra, "seconds": float(time[-1]), "rate_hz": whole.rate_hz,
        "part_s": part.part_s, "refused": bool(judged(part)["problem"]), "used": whole.used, "unused": whole.unused,
    }  # fmt: skip


def _extremes(values: np.ndarray, most: int = POINTS) -> np.ndarray:
    """Indices in order: all, or those of the least and the largest value of each of many pieces."""
    if values.size <= most:
        return np.arange(values.size)
    size = -(-values.size // (most // 2))
    pieces = values[: values.size // size * size].reshape(-1, size)
    starts = size * np.arange(len(pieces))
    ends = [0, values.size - 1]
    return np.unique(np.concatenate([starts + pieces.argmin(1), starts + pieces.argmax(1), ends]))
