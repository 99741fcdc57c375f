"""Sines of several frequencies one after the other in one file, cut into steps."""

import numpy as np

from fasbody.recording.harmonics import find_frequency, narrow_share

#: A step is at least so long [s], and so many periods.
_SHORTEST_S, _PERIODS = 1.0, 5
#: Left out at the start of a step: seconds, and periods; the foot settles.
_SETTLING_S, _SETTLING = 0.3, 3
#: Within a step the frequency stays within this [Hz], or this share.
_STEADY_HZ, _STEADY = 0.15, 0.01
#: A file is one of steps if they cover this share of it.
_COVERED = 0.6


def steps_of(time_s: np.ndarray, base: np.ndarray) -> list[tuple[slice, float]]:
    """Where each step is, settled, and its frequency [Hz]; none if the motion is no row of sines.

    Args:
        time_s: (n,) [s], uniform.
        base: (n,) [m/s^2], without offset.
    """
    from scipy.signal import hilbert

    rate = (time_s.size - 1) / (time_s[-1] - time_s[0])
    window = max(8, round(0.25 * rate))
    count = time_s.size // window
    if count < 8:
        return []
    turning = hilbert(base)[: count * window]
    slopes = np.angle(turning[1:] * turning[:-1].conj()) * rate / (2 * np.pi)
    weight = np.abs(turning[1:] * turning[:-1])
    slopes, weight = (np.append(v, v[-1]).reshape(count, window) for v in (slopes, weight))
    f = np.sum(slopes * weight, axis=1) / np.maximum(1e-300, weight.sum(axis=1))
    steps, covered, start = [], 0, 0
    for end in range(1, count + 1):
        tolerance = max(_STEADY_HZ, _STEADY * abs(f[start]))
        if end < count and abs(f[end] - np.median(f[start:end])) < tolerance:
            continue
        seconds = (end - start) * window / rate
        if seconds >= max(_SHORTEST_S, _PERIODS / max(0.1, abs(f[start]))):
            covered += end - start
            skip = round(max(_SETTLING_S, _SETTLING / max(0.1, f[start])) * rate)
            part = slice(start * window + skip, end * window - window // 2)
            if (step := _one(time_s[part], base[part])) is not None:
                steps.append((part, step))
        start = end
    return steps if len(steps) > 1 and covered > _COVERED * count else []


def _one(time_s: np.ndarray, base: np.ndarray) -> float | None:
    """The frequency of one step, None where it is no sine or goes on changing."""
    if time_s.size < 32:
        return None
    centred = base - base.mean()
    f = find_frequency(time_s, centred)
    third = time_s.size // 3
    length = time_s[-1] - time_s[0]
    if length * f < _SETTLING or narrow_share(time_s, centred, f) < 0.9:
        return None
    if length * f > 30:
        first, last = (find_frequency(time_s[s], centred[s]) for s in (slice(0, third), slice(-third, None)))
        if abs(last - first) > 0.5 / length + 0.002 * f:
            return None
    return f
