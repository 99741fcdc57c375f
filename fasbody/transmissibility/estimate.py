"""Transmissibility and phase of one recording, with their uncertainty: of a sine, of several, or over a band."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.exceptions import by_name
from fasbody.recording.checks import checked
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


def rows(recording: Recording, resolution_hz: float = 1.0, estimate: str = "best") -> list[Row]:
    """The pairs of one recording, after its checks.

    Args:
        recording: as read.
        resolution_hz: distance of the frequencies, for broadband excitation.
        estimate: for broadband excitation, "best", "H1", "H2" or "Hv".

    Raises:
        RecordingError: the recording cannot serve. SettingError: no such estimate.
    """
    good = checked(recording)
    with by_name(recording.file):
        return _rows(good, recording.condition.frequency_hz, resolution_hz, estimate)


def _rows(good: Recording, nominal_hz: float | None, resolution_hz: float, estimate: str) -> list[Row]:
    channels = good.accelerations
    pairs = {pair: c for pair, c in PAIRS.items() if set(c) <= set(channels)}
    if good.condition.frequency_hz is not None:
        f = good.condition.frequency_hz
        return _pairs(good, by_segments(good.time_s, channels, f), pairs, channels, [nominal_hz or f])
    lines = []
    for part, f in steps_of(good.time_s, channels["base"]):
        step = {name: values[part] for name, values in channels.items()}
        lines += _pairs(good, by_segments(good.time_s[part], step, f), pairs, step, [_nominal(f)])
    if lines:
        return lines
    response = broadband(good.time_s, channels, resolution_hz, estimate)
    return _pairs(good, response, pairs, None, response.frequency_hz)


def _nominal(frequency_hz: float) -> float:
    """A step's frequency as a generator was set to it: a half or whole number of Hz within half a per cent."""
    near = round(2 * frequency_hz) / 2
    return near if abs(near - frequency_hz) < 5e-3 * frequency_hz else round(frequency_hz, 2)


def _pairs(
    recording: Recording, response: Response, pairs: dict[str, tuple[str, str]], channels: dict[str, np.ndarray] | None,
    frequencies: Sequence[float] | np.ndarray,
) -> list[Row]:  # fmt: skip
    """One row a pair and frequency; peak to peak of the channels beside it, if they are given."""
    c, lines = recording.condition, []
    for pair, (out, into) in pairs.items():
        H, std = response.ratio(out, into)
        size, f = np.abs(H), np.asarray(frequencies, float)
        gain, delay_s = gain_and_delay(recording, out, into)
        with np.errstate(divide="ignore", invalid="ignore"):
            noise_deg = np.degrees(std / np.where(size > 0, size, np.nan))
        peaks = float("nan")
        if channels is not None and recording.rate_hz > 2 * CUTOFF_HZ:
            peaks = peak_to_peak(channels[out], channels[into], recording.rate_hz)
        columns = (
            f, size, np.hypot(std, size * gain), np.degrees(np.angle(H)), np.hypot(noise_deg, 360 * f * delay_s),
            response.distorted(out, into), response.biased(out, into),
        )  # fmt: skip
        for at, T, T_std, phase, phase_std, distorted, biased in zip(*(v.tolist() for v in columns), strict=True):
            lines.append(Row(
                recording.file, c.subject, c.posture, c.added_mass_kg, at, pair, T, T_std, phase, phase_std, peaks,
                response.method, distorted, biased,
            ))  # fmt: skip
    return lines


def unwrapped(phase_deg: Sequence[float] | np.ndarray) -> np.ndarray:
    """Phases along ascending frequencies without jumps of 360 degrees; NaN is passed over."""
    phase = np.array(phase_deg, float)
    known = np.isfinite(phase)
    phase[known] = np.degrees(np.unwrap(np.radians(phase[known])))
    return phase
