"""The response to one sine, by segments: what amplitude and frequency of the shaker do is common to all channels.

Each segment has its own complex amplitudes, with its own offset and slope, so that drift stays out of them. Their ratio
is what the foot does; what the shaker's wander does to one channel it does to the other, and what is left of one
channel when the ratio times the base is taken off is the noise that the interval holds.
"""

from itertools import pairwise

import numpy as np

from fasbody.transmissibility.response import Response, widening

#: Segments at most, and the periods that each has at least.
_SEGMENTS, _PERIODS = 20, 3
#: Harmonics taken along, so that they do not leak into the fundamental.
_HARMONICS = 20


def by_segments(time_s: np.ndarray, channels: dict[str, np.ndarray], frequency_hz: float) -> Response:
    """Channels over the base at one frequency.

    Args:
        time_s: (n,) [s]. channels: (n,) each [m/s^2], "base" among them. frequency_hz: of the excitation.
    """
    names = list(channels)
    t = time_s - time_s[0]
    rate = (t.size - 1) / t[-1]
    parts = max(1, min(_SEGMENTS, int(t[-1] * frequency_hz / _PERIODS)))
    harmonics = max(1, min(_HARMONICS, int(0.45 * rate // frequency_hz)))
    edges = np.linspace(0, t.size, parts + 1).astype(int)
    signals = np.column_stack([channels[name] for name in names])
    amplitudes, noise, freedom = [], np.zeros((len(names), len(names))), 0
    for a, b in pairwise(edges):
        basis = _basis(t[a:b], frequency_hz, harmonics)
        solved = np.linalg.lstsq(basis, signals[a:b])[0]
        amplitudes.append(solved[2] - 1j * solved[3])
        left = signals[a:b] - basis @ solved
        noise += left.T @ left
        freedom += max(0, b - a - basis.shape[1])
    A = np.array(amplitudes)  # (segments, channels)
    base = A[:, names.index("base")]
    power = float(np.sum(np.abs(base) ** 2))
    outs = [name for name in names if name != "base"]
    H = {name: np.array([np.sum(A[:, names.index(name)] * base.conj()) / power]) for name in outs}
    left_over = {name: A[:, names.index(name)] - H[name] * base for name in outs}
    white = noise / max(1, freedom)
    covariance = {}
    for one in outs:
        for other in outs:
            if parts >= 6:
                scatter = np.sum(left_over[one] * left_over[other].conj()) / (parts - 1)
                covariance[one, other] = np.array([scatter / power * widening(2 * parts - 2) ** 2])
                continue
            i, j, k = names.index(one), names.index(other), names.index("base")
            h, g = H[one][0], H[other][0]
            each = white[i, j] + h * g.conj() * white[k, k] - h * white[k, j] - g.conj() * white[i, k]
            covariance[one, other] = np.array([4 * each / t.size * parts / power])
    return Response("sine, by segments" if parts > 1 else "sine", np.array([frequency_hz]), H, covariance)


def _basis(time_s: np.ndarray, frequency_hz: float, harmonics: int) -> np.ndarray:
    """Offset, slope, and cosine and sine of each harmonic, (n, 2 + 2 h)."""
    count = min(harmonics, max(1, (time_s.size - 4) // 2))
    turn = np.exp(2j * np.pi * frequency_hz * np.outer(time_s, np.arange(1, count + 1)))
    basis = np.empty((time_s.size, 2 + 2 * count))
    basis[:, 0], basis[:, 1] = 1.0, np.linspace(-1, 1, time_s.size)
    basis[:, 2::2], basis[:, 3::2] = turn.real, turn.imag
    return basis
