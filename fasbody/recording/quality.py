"""How good a recording is, in numbers: coherence, harmonic distortion, drift, and level by segment of each channel."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from fasbody.recording.clock import rate_of
from fasbody.recording.harmonics import Harmonics, columns, fit_harmonics, least_squares

#: Segments whose levels are compared, and the periods that one needs.
_SEGMENTS = 10
_PERIODS = 3
#: Phases that run evenly over so many segments or more, by this times their scatter and so many degrees, at an
#: amplitude that varies by no more than this share, are of two clocks.
_RUNS_LEAST, _EVEN, _TURNED_DEG, _STEADY = 5, 20.0, 2.0, 0.03
#: Harmonics of which distortion is the sum.
_DISTORTING = 5


@dataclass(frozen=True, eq=False)
class ChannelQuality:
    """One channel.

    Attributes:
        level_m_s2: (segments,) amplitude of the excitation in each segment, for broadband the standard deviation.
        drift: range of the segments' means over the channel's amplitude (broadband: standard deviation).
        distortion: root of the harmonics' power over the fundamental, nan for broadband.
        flat_tops: the third harmonic over the fundamental, as far as it flattens the tops; nan for broadband.
        alternates: whether the fifth raises them again, as of a sensor that saturates softly, or is none. Dry friction
            is a square wave of force, all of whose harmonics push one way.
    """

    level_m_s2: np.ndarray
    drift: float
    distortion: float
    flat_tops: float
    alternates: bool = True


@dataclass(frozen=True, eq=False)
class Quality:
    """A recording.

    Attributes:
        coherence: of malleolus and base, at the excitation; for broadband the mean over power to 100 Hz.
        lead_deg: how far the malleolus is ahead, and its standard deviation `lead_std_deg`.
        channels: by name.
        ratio: how much more the malleolus moves than the base, nan for broadband.
        turned_deg: by how much the malleolus' phase runs evenly from start to end at a steady amplitude; 0 for none.
    """

    coherence: float
    lead_deg: float
    lead_std_deg: float
    channels: dict[str, ChannelQuality]
    ratio: float = float("nan")
    turned_deg: float = 0.0

    def row(self) -> dict[str, Any]:
        """For the check's table and document."""
        return {"coherence": _rounded(self.coherence)} | {
            name: {
                "distortion": _rounded(c.distortion),
                "drift": _rounded(c.drift),
                "level_m_s2": [float(f"{level:.4g}") for level in c.level_m_s2],
            }
            for name, c in self.channels.items()
        }


def _rounded(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None


def quality(time_s: np.ndarray, channels: dict[str, np.ndarray], frequency_hz: float | None) -> Quality:
    """Of channels "base", "malleolus" and perhaps more, (n,) each.

    Args:
        time_s: (n,) [s].
        channels: (n,) each [m/s^2].
        frequency_hz: of the excitation, None for broadband.
    """
    if frequency_hz is None:
        return _broadband(time_s, channels)
    periods = (time_s[-1] - time_s[0]) * frequency_hz
    segments = max(1, min(_SEGMENTS, int(periods / _PERIODS)))
    edges = np.linspace(0, time_s.size, segments + 1).astype(int)
    rate = rate_of(time_s)
    count = max(1, min(_DISTORTING, int(0.45 * rate // frequency_hz)))
    by_channel, amplitudes, fits = {}, {}, {}
    all_parts = _segments(time_s, list(channels.values()), frequency_hz, edges)
    for place, (name, values) in enumerate(channels.items()):
        whole = fits[name] = fit_harmonics(time_s, values, frequency_hz, count)
        parts = all_parts[:, :, place]
        amplitudes[name] = parts[:, 1]
        first = abs(whole.amplitudes[0])
        beyond = whole.amplitudes[1:]
        third, fifth = _turned(whole, 3), _turned(whole, 5)
        flat = max(0.0, -third.real) if abs(third.imag) < -0.5 * third.real else 0.0
        by_channel[name] = ChannelQuality(
            np.abs(parts[:, 1]), float(np.ptp(parts[:, 0].real) / first),
            float(np.sqrt(np.sum(np.abs(beyond) ** 2)) / first), float(flat / first),
            alternates=fifth == 0 or fifth.real > abs(fifth.imag),
        )  # fmt: skip
    base, malleolus = fits["base"], fits["malleolus"]
    ratio = malleolus.amplitudes[0] / base.amplitudes[0]
    spread = np.hypot(*(fit.std[0] / abs(fit.amplitudes[0]) for fit in (base, malleolus)))
    return Quality(
        _coherence(amplitudes["base"], amplitudes["malleolus"]), float(np.degrees(np.angle(ratio))),
        float(np.degrees(spread)), by_channel, float(abs(ratio)),
        _turned_evenly(amplitudes["malleolus"] / amplitudes["base"]),
    )  # fmt: skip


def _turned(fit: Harmonics, order: int) -> complex:
    """A harmonic of a motion whose fundamental is a cosine with its top at zero; zero if noise may be all of it."""
    if len(fit.amplitudes) < order or abs(fit.amplitudes[order - 1]) <= 5 * fit.std[order - 1]:
        return 0j
    return complex(fit.amplitudes[order - 1] / (fit.amplitudes[0] / abs(fit.amplitudes[0])) ** order)


def _segments(time_s: np.ndarray, values: list[np.ndarray], frequency_hz: float, edges: np.ndarray) -> np.ndarray:
    """Offset and complex amplitude (segments, 2, channels) of values (n,) of each channel between edges."""
    segments = []
    for a, b in pairwise(edges):
        basis = columns(2 * np.pi * frequency_hz * time_s[a:b], 1)
        offset, real, imaginary = least_squares(basis, np.column_stack([x[a:b] for x in values]))
        segments.append(np.stack([offset + 0j, real - 1j * imaginary]))
    return np.array(segments)


def _turned_evenly(ratios: np.ndarray) -> float:
    """By how many degrees ratios (segments,) turn from start to end, if evenly: by clocks that run apart."""
    size, count = np.abs(ratios), ratios.size
    if count < _RUNS_LEAST or np.ptp(size) > _STEADY * size.mean():
        return 0.0
    phases, places = np.unwrap(np.angle(ratios)), np.arange(count)
    slope, start = np.polyfit(places, phases, 1)
    rest, turned = float(np.std(phases - start - slope * places)), float(np.degrees(slope * count))
    return turned if abs(slope) * count > _EVEN * rest and abs(turned) > _TURNED_DEG else 0.0


def _coherence(base: np.ndarray, malleolus: np.ndarray) -> float:
    """Of complex amplitudes by segment; one segment gives none."""
    if base.size < 3:
        return float("nan")
    power = np.mean(np.abs(base) ** 2) * np.mean(np.abs(malleolus) ** 2)
    return float(np.abs(np.mean(malleolus * base.conj())) ** 2 / max(1e-300, power))


def _broadband(time_s: np.ndarray, channels: dict[str, np.ndarray]) -> Quality:
    from scipy.signal import csd

    edges = np.linspace(0, time_s.size, _SEGMENTS + 1).astype(int)
    by_channel = {}
    for name, values in channels.items():
        levels = np.array([values[a:b].std() for a, b in pairwise(edges)])
        means = np.array([values[a:b].mean() for a, b in pairwise(edges)])
        by_channel[name] = ChannelQuality(
            levels, float(np.ptp(means) / max(1e-300, values.std())), float("nan"), float("nan")
        )
    rate = rate_of(time_s)
    length = max(16, time_s.size // 8)
    base, malleolus = channels["base"], channels["malleolus"]
    f, cross = csd(base, malleolus, rate, nperseg=length)
    into, out = (csd(x, x, rate, nperseg=length)[1].real for x in (base, malleolus))
    band = (f >= 2) & (f <= 100)
    if not band.any():
        return Quality(float("nan"), 0.0, float("inf"), by_channel)
    weight = into[band] / max(1e-300, into[band].sum())
    coherent = np.abs(cross[band]) ** 2 / np.maximum(1e-300, into[band] * out[band])
    phase = cross[band] / np.maximum(1e-300, np.abs(cross[band]))
    mean = np.sum(weight * coherent * phase)
    lines = 1 / max(1e-300, float(np.sum(weight**2)))  # how many lines carry the power
    coherence = float(np.sum(weight * coherent))
    spread = np.sqrt(max(0.0, 1 - coherence) / max(1e-9, 2 * coherence * 8 * lines))
    return Quality(coherence, float(np.degrees(np.angle(mean))), float(np.degrees(spread)), by_channel)


def still(
    time_s: np.ndarray, channels: dict[str, np.ndarray], frequency_hz: float | None
) -> tuple[str, float, float] | None:
    """A channel that stands still while another moves: its name, and from when to when [s].

    Args:
        time_s: (n,) [s].
        channels: (n,) each.
        frequency_hz: of a signal that is mostly one sine, else None.
    """
    rate = rate_of(time_s)
    window = max(16, time_s.size // 50, round(rate / frequency_hz) if frequency_hz else 0)
    count = time_s.size // window
    if count < 4:
        return None
    spread = {name: x[: count * window].reshape(count, window).std(axis=1) for name, x in channels.items()}
    share = 0.25 if frequency_hz else 1e-3  # a sweep leaves the foot nearly at rest where it isolates well
    moving = {name: s > 0.5 * (np.median(s[s > 0]) if (s > 0).any() else np.inf) for name, s in spread.items()}
    for name, levels in spread.items():
        usual = np.quantile(levels, 0.75)
        others = np.any([m for other, m in moving.items() if other != name], axis=0)
        where = np.flatnonzero((levels < share * usual) & others)
        if where.size:
            run = max(np.split(where, np.flatnonzero(np.diff(where) > 1) + 1), key=len)
            return name, float(time_s[run[0] * window]), float(time_s[(run[-1] + 1) * window - 1])
    return None
