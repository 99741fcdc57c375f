"""Transmissibility and phase of one recording, with their uncertainty: sine fit, or H1 for broadband excitation."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fasbody.recording.checks import checked
from fasbody.recording.harmonics import Harmonics, fit_harmonics
from fasbody.recording.recording import Recording, gain_and_delay
from fasbody.transmissibility.spectra import CUTOFF_HZ, excited, h1, peak_to_peak

#: Output and input channel of each pair.
PAIRS = {"MB": ("malleolus", "base"), "TB": ("tuberosity", "base"), "TM": ("tuberosity", "malleolus")}


@dataclass(frozen=True)
class Row:
    """One line of the table; an estimate that does not exist is NaN.

    `phase_deg` is that of the output relative to the input, negative where it lags. Standard deviations are those of
    the estimate, not those between subjects: noise, from the residual of the fit or the coherence, and the uncertain
    gain and delay of the two channels as far as study.toml states them (gain_std, delay_std_s).
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

    def document(self) -> dict[str, Any]:
        """As JSON has it."""
        return asdict(self)


def rows(recording: Recording, resolution_hz: float = 1.0) -> list[Row]:
    """The pairs of one recording, after its checks.

    Args:
        recording: as read. resolution_hz: distance of the frequencies, for broadband excitation.

    Raises:
        RecordingError: the recording cannot serve.
    """
    good = checked(recording)
    channels = {name.removesuffix("_m_s2"): values for name, values in good.channels.items() if name != "time_s"}
    pairs = {pair: c for pair, c in PAIRS.items() if set(c) <= set(channels)}
    if good.condition.frequency_hz is None:
        return _broadband(good, channels, pairs, resolution_hz)
    f = good.condition.frequency_hz
    nominal = recording.condition.frequency_hz or f
    fits = {name: fit_harmonics(good.time_s, values, f, 1) for name, values in channels.items()}
    return [
        _row(good, nominal, pair, *ratio(fits[out], fits[into]), _by_peaks(good, channels[out], channels[into]))
        for pair, (out, into) in pairs.items()
    ]


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


def _broadband(
    recording: Recording, channels: dict[str, np.ndarray], pairs: dict[str, tuple[str, str]], resolution_hz: float
) -> list[Row]:
    found = []
    use = excited(channels["base"], recording.rate_hz, resolution_hz)  # one band for all pairs
    for pair, (out, into) in pairs.items():
        estimate = h1(channels[into], channels[out], recording.rate_hz, resolution_hz, use)
        for f, H, std in zip(estimate.frequency_hz, estimate.H, estimate.std, strict=True):
            found.append(_row(recording, f, pair, complex(H), float(std), float("nan")))
    return found


def unwrapped(phase_deg: Sequence[float] | np.ndarray) -> np.ndarray:
    """Phases along ascending frequencies without jumps of 360 degrees; NaN is passed over."""
    phase = np.array(phase_deg, float)
    known = np.isfinite(phase)
    phase[known] = np.degrees(np.unwrap(np.radians(phase[known])))
    return phase
