"""The harmonics of one periodic recording: what it is worth to the steady-state fit."""

import functools
from dataclasses import dataclass

from fasbody.exceptions import RecordingError
from fasbody.recording import Recording
from fasbody.response import Harmonics, fit_harmonics, harmonic_count
from identification.orbits import Excitation


@dataclass(frozen=True, eq=False)
class Line:
    """The harmonics of one recording: base U and malleolus Y."""

    recording: Recording
    base: Harmonics
    malleolus: Harmonics

    @classmethod
    @functools.lru_cache(maxsize=32)  # choosing the domain, fitting and drawing loops need the same harmonics
    def of(cls, recording: Recording) -> "Line":
        """Fit the harmonics of a checked recording with a known excitation frequency."""
        frequency = recording.condition.frequency_hz
        if frequency is None:
            raise RecordingError(f"{recording.file}: is not periodic, so it has no harmonics; use the time domain.")
        count = harmonic_count(frequency, recording.rate_hz)
        time = recording.time_s - recording.time_s[0]  # phases count from the first sample, where rollouts start
        channels = (recording.base_m_s2, recording.malleolus_m_s2)
        return cls(recording, *(fit_harmonics(time, c, frequency, count) for c in channels))

    @property
    def excitation(self) -> Excitation:
        """What drives the model."""
        return Excitation(self.base.frequency_hz, self.base.amplitudes, self.recording.condition.masses)

    @property
    def count(self) -> int:
        """Harmonics compared."""
        return self.base.amplitudes.size
