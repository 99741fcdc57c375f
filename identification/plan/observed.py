"""What a recording was, right after it was made: level, distortion, coherence, and the response with its interval."""

from dataclasses import dataclass

import numpy as np

from fasbody.constants import Z95
from fasbody.recording.quality import quality
from fasbody.recording.recording import Recording
from fasbody.transmissibility.sines import by_segments
from identification.harmonics import Line
from identification.plan.words import percent


@dataclass(frozen=True)
class Observed:
    """One recording.

    Attributes:
        level_m_s2: amplitude of the base's fundamental.
        distortion: its harmonics over that, as a share.
        coherence: of malleolus and base at the fundamental, over segments.
        transmissibility: with its 95 % limits lower and upper.
        phase_deg: of the malleolus against the base.
        noise_m_s2: rms of a sample, of both channels together.
    """

    level_m_s2: float
    distortion: float
    coherence: float
    transmissibility: float
    lower: float
    upper: float
    phase_deg: float
    noise_m_s2: float

    def __str__(self) -> str:
        return (
            f"level {self.level_m_s2:.3g} m/s^2, distortion {percent(self.distortion)}, coherence "
            f"{self.coherence:.4f}, transmissibility {self.transmissibility:.4g} ({self.lower:.4g} to "
            f"{self.upper:.4g}), phase {self.phase_deg:.3g} deg"
        )


def observed(recording: Recording) -> Observed:
    """What a checked recording of one sine was."""
    line = Line.of(recording)
    f = line.base.frequency_hz
    channels = {"base": recording.base_m_s2, "malleolus": recording.malleolus_m_s2}
    measures = quality(recording.time_s, channels, f)
    H, std = by_segments(recording.time_s, channels, f).ratio("malleolus")
    size, half = float(abs(H[0])), Z95 * float(std[0])
    return Observed(
        float(abs(line.base.amplitudes[0])), measures.channels["base"].distortion, measures.coherence,
        size, max(0.0, size - half), size + half, float(np.degrees(np.angle(H[0]))),
        float(np.sqrt(0.5 * (line.base.sigma**2 + line.malleolus.sigma**2))),
    )  # fmt: skip
