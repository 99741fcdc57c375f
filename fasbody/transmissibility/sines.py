"""The response to one sine, by segments: what amplitude and frequency of the shaker do is common to all channels.

Complex amplitudes are fitted to each segment with an offset and a slope, which take up drift. Their ratio is the
response of the foot. A varying amplitude of the shaker is common to both channels. What remains of a channel after
subtracting the ratio times the base is the noise that the interval accounts for.
"""

from itertools import pairwise

import numpy as np

from fasbody.recording.harmonics import least_squares
from fasbody.transmissibility.response import Response, widening

#: Segments at most, and the periods that each has at least.
_SEGMENTS, _PERIODS = 20, 3
#: From so many on their scatter is the noise, below it is what the fits leave.
_ENOUGH = 6
#: The amplitude of the shaker varies if that explains all but this part of the scatter.
_WANDERS = 3.0
#: Harmonics taken along, so that they do not leak into the fundamental.
_HARMONICS = 20


def by_segments(time_s: np.ndarray, channels: dict[str, np.ndarray], frequency_hz: float) -> Response:
    """Channels over the base at one frequency.

    Args:
        time_s: (n,) [s].
        channels: (n,) each [m/s^2], "base" among them.
        frequency_hz: of the excitation.
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
        solved = least_squares(basis, signals[a:b])
        amplitudes.append(solved[2] - 1j * solved[3])
        left = signals[a:b] - basis @ solved
        noise += left.T @ left
        freedom += max(0, b - a - basis.shape[1])
    A = np.array(amplitudes)  # (segments, channels)
    base = A[:, names.index("base")]
    outs = [name for name in names if name != "base"]
    moved = A[:, [names.index(name) for name in outs]]
    solved, left, weight, count = _common(base, moved)
    H = {name: solved[None, j] for j, name in enumerate(outs)}
    white = noise / max(1, freedom)
    covariance = {}
    for p, one in enumerate(outs):
        for q, other in enumerate(outs):
            if parts >= _ENOUGH:
                scatter = np.sum(left[:, p] * left[:, q].conj()) / count
                covariance[one, other] = np.array([scatter * weight * widening(2 * count) ** 2])
                continue
            i, j, k = names.index(one), names.index(other), names.index("base")
            h, g = H[one][0], H[other][0]
            noise_ij = white[i, j] + h * g.conj() * white[k, k] - h * white[k, j] - g.conj() * white[i, k]
            covariance[one, other] = np.array([4 * noise_ij / t.size * parts * weight])
    return Response("sine, by segments" if parts > 1 else "sine", np.array([frequency_hz]), H, covariance)


def _common(base: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Ratios (channels,) of amplitudes by segment, what they leave, their variance for unit scatter, and its freedom.

    A foot follows a varying base with the slope and curvature of its response: where the first and second
    differences of the base's amplitude explain most of what a constant ratio leaves, they are taken along.

    Args:
        base: (segments,) complex.
        moved: (segments, channels) complex.
    """
    weight = 1 / float(np.sum(np.abs(base) ** 2))
    ratio = weight * (base.conj() @ moved)
    left = moved - np.outer(base, ratio)
    if base.size < _SEGMENTS // 2:
        return ratio, left, weight, base.size - 1
    slope, bend = base[2:] - base[:-2], base[2:] - 2 * base[1:-1] + base[:-2]
    basis = np.column_stack([base[1:-1], slope, bend])
    wandering = least_squares(basis, moved[1:-1])
    rest = moved[1:-1] - basis @ wandering
    count = base.size - 5
    before, after = (np.sum(np.abs(v) ** 2, axis=0) / n for v, n in ((left, base.size - 1), (rest, count)))
    if not np.any(before > _WANDERS * after):
        return ratio, left, weight, base.size - 1
    return wandering[0], rest, float(np.linalg.inv(basis.conj().T @ basis)[0, 0].real), count


def _basis(time_s: np.ndarray, frequency_hz: float, harmonics: int) -> np.ndarray:
    """Offset, slope, and cosine and sine of each harmonic, (n, 2 + 2 h)."""
    count = min(harmonics, max(1, (time_s.size - 4) // 2))
    turn = np.exp(2j * np.pi * frequency_hz * np.outer(time_s, np.arange(1, count + 1)))
    basis = np.empty((time_s.size, 2 + 2 * count))
    basis[:, 0], basis[:, 1] = 1.0, np.linspace(-1, 1, time_s.size)
    basis[:, 2::2], basis[:, 3::2] = turn.real, turn.imag
    return basis
