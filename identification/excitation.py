"""How much the excitation can tell: its rank, two for each sine in it."""

from collections.abc import Sequence

import numpy as np

from fasbody.recording.harmonics import fit_harmonics, harmonic_count
from fasbody.recording.recording import Recording

#: A line counts if its amplitude exceeds this share of the largest one, and five times its noise.
_SHARE, _NOISE = 1e-3, 5.0


def excitation_rank(recordings: Sequence[Recording]) -> int:
    """Twice the number of distinct lines in the base motion of all recordings together.

    A linear system with more parameters than that is not identified by them. Noise is not excitation: lines below 1e-3
    of the largest, or below five standard deviations, do not count.
    """
    lines: list[float] = []
    for recording in recordings:
        found = _periodic_lines(recording) if recording.condition.frequency_hz else _broadband_lines(recording)
        resolution = 0.5 / (recording.time_s[-1] - recording.time_s[0])
        for frequency in found:
            if all(abs(frequency - other) > resolution for other in lines):
                lines.append(frequency)
    return 2 * len(lines)


def _periodic_lines(recording: Recording) -> list[float]:
    frequency = recording.condition.frequency_hz or 0.0
    h = fit_harmonics(recording.time_s, recording.base_m_s2, frequency, harmonic_count(frequency, recording.rate_hz))
    size = np.abs(h.amplitudes)
    counted = (size > _SHARE * size.max()) & (size > _NOISE * h.std)
    return [frequency * (i + 1) for i in np.flatnonzero(counted)]


def _broadband_lines(recording: Recording) -> list[float]:
    base = recording.base_m_s2
    size = np.abs(np.fft.rfft(base)) * 2 / base.size
    noise = np.median(size[int(0.7 * size.size) :])  # above 0.35 of the sampling rate there is only noise
    counted = (size > _SHARE * size.max()) & (size > _NOISE * noise)
    return list(np.flatnonzero(counted) * recording.rate_hz / base.size)
