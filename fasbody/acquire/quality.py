"""What happened on the line during a recording, and whether that makes it unusable."""

from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Limits:
    """What a recording may have.

    Attributes:
        clock_ppm: a sampling rate or a device clock that is off by more is mentioned [parts per million].
        clock_refused_ppm: and by more than this, the recording is refused.
        periods: fewest excitation periods without a gap.
    """

    clock_ppm: float = 200.0
    clock_refused_ppm: float = 5000.0
    periods: float = 3.0


@dataclass(frozen=True)
class Gap:
    """Samples that were taken and did not arrive.

    Attributes:
        after_s: time of the last sample before it [s]. lost_samples: how many a channel are missing.
        cause: "lost frames"; "skipped" (the device's time stamps jump); "restart" (length by the host's clock).
    """

    after_s: float
    lost_samples: int
    cause: str


@dataclass(frozen=True)
class Quality:
    """What happened on the line during a recording.

    Attributes:
        frames: frames (or lines) received. lost_frames: missing by their numbers. damaged: pieces that were no message.
        gaps: where samples are missing. over_range: samples over range, by channel.
        rate_ppm: sampling rate by the device's time stamps against the declared one.
        drift_ppm: device clock against the host's, and its standard error drift_std_ppm. changed: the board described
            itself differently during the recording.
    """

    frames: int = 0
    lost_frames: int = 0
    damaged: int = 0
    gaps: tuple[Gap, ...] = ()
    over_range: dict[str, int] = field(default_factory=dict)
    rate_ppm: float = 0.0
    drift_ppm: float = 0.0
    drift_std_ppm: float = 0.0
    changed: bool = False

    @property
    def lost_samples(self) -> int:
        """Missing samples a channel."""
        return sum(gap.lost_samples for gap in self.gaps)

    def problems(self, limits: Limits) -> list[str]:
        """Why this is no recording to identify from; empty if it is."""
        texts = []
        if self.frames == 0:
            texts.append("no samples arrived")
        if self.gaps:
            first = self.gaps[0]
            where = f"the first after {first.after_s:.4g} s, {first.cause}"
            texts.append(f"{self.lost_samples} samples are missing in {len(self.gaps)} gaps ({where})")
        over = {name: count for name, count in self.over_range.items() if count}
        if over:
            texts.append("over range: " + ", ".join(f"{name} {count} samples" for name, count in over.items()))
        if self.changed:
            texts.append("the board changed its description in the middle")
        if abs(self.rate_ppm) > limits.clock_refused_ppm:
            texts.append(f"the board samples {self.rate_ppm:+.0f} ppm off its declared rate")
        if abs(self.drift_ppm) > limits.clock_refused_ppm + 3 * self.drift_std_ppm:
            texts.append(f"the board's clock runs {self.drift_ppm:+.0f} ppm off the computer's")
        return texts

    def remarks(self, limits: Limits) -> list[str]:
        """What does not forbid using it, but should be known."""
        texts = []
        if self.damaged:
            texts.append(f"{self.damaged} damaged pieces on the line")
        if limits.clock_ppm < abs(self.rate_ppm) <= limits.clock_refused_ppm:
            texts.append(f"the board samples {self.rate_ppm:+.0f} ppm off its declared rate")
        if limits.clock_ppm + 3 * self.drift_std_ppm < abs(self.drift_ppm) <= limits.clock_refused_ppm:
            texts.append(f"the board's clock runs {self.drift_ppm:+.0f} ppm off the computer's")
        return texts

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    def __str__(self) -> str:
        return (
            f"{self.frames} frames, {self.lost_frames} lost, {self.damaged} damaged, {len(self.gaps)} gaps, "
            f"clock {self.drift_ppm:+.0f} +- {self.drift_std_ppm:.0f} ppm"
        )
