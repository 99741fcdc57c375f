"""Transmissibility and phase of one recording, with their uncertainty: of a sine, of several, or over a band."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fasbody.exceptions import by_name
from fasbody.recording.checks import checked
from fasbody.recording.harmonics import Harmonics
from fasbody.recording.recording import Recording, gain_and_delay
from fasbody.transmissibility.broadband import broadband
from fasbody.transmissibility.response import Response
from fasbody.transmissibility.sines import by_segments
from fasbody.transmissibility.spectra import CUTOFF_HZ, peak_to_peak
from fasbody.transmissibility.steps import steps_of

#: Output and input channel of each pair.
PAIRS = {"MB": ("malleolus", "base"), "TB": ("tuberosity", "base"), "TM": ("tuberosity", "malleolus")}


@dataclass(frozen=True)
class Row:
    """One line of the table; an estimate that does not exist is NaN.

    `phase_deg` is that of the output relative to the input, negative where it lags. Standard deviations are those of
    the estimate, not those between subjects: noise, from the residual of the fit or the coherence, and the uncertain
    gain and delay of the two channels as far as study.toml states them (gain_std, delay_std_s). `distortion_std` is
    the part of it that repeats with the motion, `resolution_bias` the relative error by the resolution, if they show.
    """

    file: str
    subject: str
    posture: str
    added_mass_kg: float
    frequency_hz: float
    pair: str
    transmissibility: float
    transmissibility_std: float
    phase_deg: float
    phase_std_deg: float
    transmissibility_peak_to_peak: float
    method: str = ""
    distortion_std: float = float("nan")
    resolution_bias: float = float("nan")

    def document(self) -> dict[str, Any]:
        """As JSON has it."""
        return asdict(self)


def rows(recording: Recording, resolution_hz: float = 1.0, estimate: str = "best") -> list[Row]:
    """The pairs of one recording, after its checks.

    Args:
        recording: as read. resolution_hz: distance of the frequencies, for broadband excitation.
        estimate: for broadband excitation, "best", "H1", "H2" or "Hv".

    Raises:
        RecordingError: the recording cannot serve. SettingError: no such estimate.
    """
    good = checked(recording)
    with by_name(recording.file):
        return _rows(good, recording.condition.frequency_hz, resolution_hz, estimate)


def _rows(good: Recording, nominal_hz: float | None, resolution_hz: float, estimate: str) -> list[Row]:
    channels = {name.removesuffix("_m_s2"): values for name, values in good.channels.items() if name != "time_s"}
    pairs = {pair: c for pair, c in PAIRS.items() if set(c) <= set(channels)}
    if good.condition.frequency_hz is not None:
        f = good.condition.frequency_hz
        found = by_segments(good.time_s, channels, f)
        return _pairs(good, found, pairs, channels, [nominal_hz or f])
    made = []
    for part, f in steps_of(good.time_s, channels["base"]):
        cut = {name: values[part] for name, values in channels.items()}
        found = by_segments(good.time_s[part], cut, f)
        made += _pairs(good, found, pairs, cut, [_named(f)])
    if made:
        return made
    found = broadband(good.time_s, channels, resolution_hz, estimate)
    return _pairs(good, found, pairs, None, found.frequency_hz)


def _named(frequency_hz: float) -> float:
    """A step's frequency as a generator was set to it: a half or whole number of Hz within half a per cent."""
    near = round(2 * frequency_hz) / 2
    return near if abs(near - frequency_hz) < 5e-3 * frequency_hz else round(frequency_hz, 2)


def _pairs(
    recording: Recording, found: Response, pairs: dict[str, tuple[str, str]], channels: dict[str, np.ndarray] | None,
    frequencies: Sequence[float] | np.ndarray,
) -> list[Row]:  # fmt: skip
    """One row a pair and frequency; peak to peak of the channels beside it, if they are given."""
    made = []
    for pair, (out, into) in pairs.items():
        H, std = found.ratio(out, into)
        peaks = float("nan") if channels is None else _by_peaks(recording, channels[out], channels[into])
        distorted, biased = found.distorted(out, into), found.biased(out, into)
        for i, f in enumerate(frequencies):
            row = _row(recording, f, pair, complex(H[i]), float(std[i]), peaks)
            bias = float(biased[i])
            made.append(replace(row, method=found.method, distortion_std=float(distorted[i]), resolution_bias=bias))
    return made


def ratio(out: Harmonics, into: Harmonics) -> tuple[complex, float]:
    """Complex ratio of the fundamentals, and the standard deviation of its real (or imaginary) part."""
    H = out.amplitudes[0] / into.amplitudes[0]
    relative = np.hypot(out.std[0] / abs(out.amplitudes[0]), into.std[0] / abs(into.amplitudes[0]))
    return complex(H), float(abs(H) * relative)


def _by_peaks(recording: Recording, out: np.ndarray, into: np.ndarray) -> float:
    if recording.rate_hz <= 2 * CUTOFF_HZ:
        return float("nan")
    return peak_to_peak(out, into, recording.rate_hz)


def _row(recording: Recording, f: float, pair: str, H: complex, std: float, by_peaks: float) -> Row:
    c = recording.condition
    gain, delay_s = gain_and_delay(recording, *PAIRS[pair])
    noise_deg = np.degrees(std / abs(H)) if abs(H) else np.nan
    T_std, phase_std = np.hypot(std, abs(H) * gain), np.hypot(noise_deg, 360 * f * delay_s)
    return Row(
        recording.file, c.subject, c.posture, c.added_mass_kg, float(f), pair, abs(H), float(T_std),
        float(np.degrees(np.angle(H))), float(phase_std), by_peaks,
    )  # fmt: skip


def unwrapped(phase_deg: Sequence[float] | np.ndarray) -> np.ndarray:
    """Phases along ascending frequencies without jumps of 360 degrees; NaN is passed over."""
    phase = np.array(phase_deg, float)
    known = np.isfinite(phase)
    phase[known] = np.degrees(np.unwrap(np.radians(phase[known])))
    return phase
