"""The harmonics of a steady recording, of every sensor that is fitted."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.recording.harmonics import Harmonics, fit_harmonics, harmonic_count
from fasbody.recording.recording import Recording
from identification.sensors import MALLEOLUS


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
        wanted = [name for name in sensors if name in read and name not in MALLEOLUS]
        found = {name: fit_harmonics(time, read[name], line.base.frequency_hz, line.count) for name in wanted}
        return replace(line, others=found) if found else line

    @property
    def count(self) -> int:
        """Harmonics compared of each sensor."""
        return self.base.amplitudes.size

    @property
    def sensors(self) -> dict[str, Harmonics]:
        """Harmonics of every sensor that is fitted, the malleolus first."""
        return {MALLEOLUS[0]: self.malleolus} | dict(self.others)

    @property
    def measured(self) -> np.ndarray:
        """Complex harmonics (k H,) of the k sensors, one sensor behind the other."""
        return np.concatenate([channel.amplitudes for channel in self.sensors.values()])

    @property
    def size(self) -> int:
        """Complex harmonics compared, of all sensors."""
        return self.count * (1 + len(self.others))
