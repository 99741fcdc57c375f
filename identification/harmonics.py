"""The harmonics of a steady recording, of every sensor that is fitted."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.recording.harmonics import Harmonics, fit_harmonics, harmonic_count
from fasbody.recording.recording import Recording
from identification.sensors import MALLEOLUS

#: Noise below this share of the amplitude is not believed: clocks and models are not that good.
_NOISE_FLOOR = 1e-7


@dataclass(frozen=True, eq=False)
class Line:
    """The harmonics of one recording: base U, malleolus Y, and those of other sensors that are fitted, by name."""

    recording: Recording
    base: Harmonics
    malleolus: Harmonics
    others: Mapping[str, Harmonics] = field(default_factory=dict)

    @classmethod
    @functools.lru_cache(maxsize=128)  # choosing the domain, fitting and drawing loops need the same harmonics
    def of(cls, recording: Recording) -> "Line":
        """Fit the harmonics of a checked recording with a known excitation frequency."""
        frequency = recording.condition.frequency_hz
        if frequency is None:
            raise RecordingError(f"{recording.file}: is not periodic, so it has no harmonics; use the time domain.")
        count = harmonic_count(frequency, recording.rate_hz)
        time = recording.time_s - recording.time_s[0]  # phases count from the first sample, where rollouts start
        channels = (recording.base_m_s2, recording.malleolus_m_s2)
        base, malleolus = (fit_harmonics(time, c, frequency, count) for c in channels)
        return cls(recording, base, malleolus)

    @classmethod
    @functools.lru_cache(maxsize=128)
    def with_sensors(cls, recording: Recording, sensors: tuple[str, ...]) -> "Line":
        """`of`, with the harmonics of the other sensors of these names that the recording has."""
        line, read = cls.of(recording), recording.sensors
        time = recording.time_s - recording.time_s[0]
        others = [name for name in sensors if name in read and name not in MALLEOLUS]
        lines = {name: fit_harmonics(time, read[name], line.base.frequency_hz, line.count) for name in others}
        return replace(line, others=lines) if lines else line

    @property
    def count(self) -> int:
        """Harmonics compared of each sensor."""
        return self.base.amplitudes.size

    @property
    def sensors(self) -> dict[str, Harmonics]:
        """Harmonics of every sensor that is fitted, the malleolus first."""
        return {MALLEOLUS[0]: self.malleolus} | dict(self.others)


@dataclass(frozen=True, eq=False)
class Measured:
    """Harmonics of R recordings by S sensors; what a recording has not is not valid.

    Attributes:
        lines: the recordings' harmonics.
        sensors: names, the malleolus first.
        base: (R, H) complex harmonics of the base [m/s^2].
        base_std: (R, H) noise of a real or imaginary part.
        output: (R, S, H) of the sensors.
        output_std: (R, S, H) noise.
        valid: (R, S, H) which were measured.
    """

    lines: Sequence[Line]
    sensors: tuple[str, ...]
    base: np.ndarray
    base_std: np.ndarray
    output: np.ndarray
    output_std: np.ndarray
    valid: np.ndarray

    @classmethod
    def of(cls, lines: Sequence[Line], sensors: Sequence[str]) -> "Measured":
        """Arrays from the harmonics of recordings."""
        H, R = max(line.count for line in lines), len(lines)
        base, base_std = np.zeros((R, H), complex), np.zeros((R, H))
        output, output_std = np.zeros((R, len(sensors), H), complex), np.ones((R, len(sensors), H))
        valid = np.zeros((R, len(sensors), H), bool)
        for r, line in enumerate(lines):
            base[r, : line.count], base_std[r, : line.count] = line.base.amplitudes, _std(line.base)
            for name, channel in line.sensors.items():
                s = list(sensors).index(name)
                output[r, s, : line.count], output_std[r, s, : line.count] = channel.amplitudes, _std(channel)
                valid[r, s, : line.count] = True
        return cls(lines, tuple(sensors), base, base_std, output, output_std, valid)

    @property
    def size(self) -> int:
        """How many real numbers were measured."""
        return 2 * int(self.valid.sum())

    @cached_property
    def rows(self) -> np.ndarray:
        """(R, 2 S H) which rows of a recording's residual, real parts before imaginary ones, are numbers."""
        flat = self.valid.reshape(len(self.lines), -1)
        return np.concatenate([flat, flat], 1)


def _std(channel: Harmonics) -> np.ndarray:
    return np.maximum(channel.std, _NOISE_FLOOR * np.abs(channel.amplitudes[0]))
