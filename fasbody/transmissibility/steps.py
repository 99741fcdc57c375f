"""Sines of several frequencies one after the other in one file, cut into steps."""

import numpy as np

from fasbody.recording.clock import rate_of
from fasbody.recording.harmonics import find_frequency, narrow_share

#: A step is at least so long [s], and so many periods.
_SHORTEST_S, _PERIODS = 1.0, 5
#: Left out at the start of a step: seconds, and periods; the foot settles.
_SETTLING_S, _SETTLING = 0.3, 3
#: Within a step the frequency stays within this [Hz], or this share.
_STEADY_HZ, _STEADY = 0.15, 0.01
#: So many windows of another frequency within a step are noise.
_ODD = 2
#: A file is one of steps if they cover this share of it.
_COVERED = 0.6


def steps_of(time_s: np.ndarray, base: np.ndarray) -> list[tuple[slice, float]]:
    """Where each step is, settled, and its frequency [Hz]; none if the motion is no row of sines.

    Args:
        time_s: (n,) [s], uniform.
        base: (n,) [m/s^2], without offset.
    """
    from scipy.signal import hilbert, medfilt

    rate = rate_of(time_s)
    window = max(8, round(0.25 * rate))
    count = time_s.size // window
    if count < 8:
        return []
    phase = np.unwrap(np.angle(hilbert(base)[: count * window])).reshape(count, window)
    passed = (np.arange(window) - 0.5 * (window - 1)) / rate
    f = medfilt(phase @ passed / (2 * np.pi * passed @ passed), 3)  # its slope [Hz], by least squares against noise
    steps, covered = [], 0
    for start, end in _level(f):
        seconds = (end - start) * window / rate
        if seconds >= max(_SHORTEST_S, _PERIODS / max(0.1, abs(f[start]))):
            covered += end - start
            skip = round(max(_SETTLING_S, _SETTLING / max(0.1, f[start])) * rate)
            part = slice(start * window + skip, end * window - window // 2)
            if (step := _one(time_s[part], base[part])) is not None:
                steps.append((part, step))
    return steps if len(steps) > 1 and covered > _COVERED * count else []


def _level(f: np.ndarray) -> list[tuple[int, int]]:
    """Runs of windows of one frequency f (n,) [Hz]; one that goes on behind a few odd windows is one."""
    runs, start = list[tuple[int, int]](), 0
    for end in range(1, f.size + 1):
        if end < f.size and abs(f[end] - np.median(f[start:end])) < max(_STEADY_HZ, _STEADY * abs(f[start])):
            continue
        at, before = float(np.median(f[start:end])), runs[-1] if runs else (0, -_ODD)
        if end - start > _ODD:
            near = abs(np.median(f[slice(*before)]) - at) < max(_STEADY_HZ, _STEADY * abs(at)) if runs else False
            goes_on = near and start - before[1] <= _ODD
            runs[-1:] = [(before[0], end)] if goes_on else [*runs[-1:], (start, end)]
        start = end
    return runs


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
