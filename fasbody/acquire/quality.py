"""What happened on the line during a recording, and whether that makes it unusable."""

from dataclasses import asdict, dataclass, field
from typing import Any

#: A number is sure within so many standard errors.
_SURE = 3.0


def counted(count: int, noun: str) -> str:
    """A count with its noun, one gap or two gaps."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


@dataclass(frozen=True)
class Limits:
    """What a recording may have.

    Attributes:
        clock_ppm: a sampling rate or a device clock that is off by more is mentioned [parts per million].
        clock_refused_ppm: and by more than this, the recording is refused.
        periods: fewest excitation periods without a gap.
        jitter: time stamps that jitter by more are mentioned [samples, rms].
    """

    clock_ppm: float = 200.0
    clock_refused_ppm: float = 5000.0
    periods: float = 3.0
    jitter: float = 0.25


@dataclass(frozen=True)
class Gap:
    """Samples that were taken and did not arrive.

    Attributes:
        after_s: time of the last sample before it [s]. lost_samples: how many a channel are missing.
        cause: "lost frames"; "damaged lines"; "skipped" (the device's time stamps jump); "restart" (length by the
            host's clock).
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
        stamps_advance: whether the device's time stamps do. jitter: theirs [samples, rms].
        rate_ppm: sampling rate by the device's time stamps against the declared one, rate_std_ppm: its standard error.
        drift_ppm: device clock against the host's, and its standard error drift_std_ppm. changed: the board described
            itself differently during the recording.
    """

    frames: int = 0
    lost_frames: int = 0
    damaged: int = 0
    gaps: tuple[Gap, ...] = ()
    over_range: dict[str, int] = field(default_factory=dict)
    stamps_advance: bool = True
    jitter: float = 0.0
    rate_ppm: float = 0.0
    rate_std_ppm: float = float("inf")
    drift_ppm: float = 0.0
    drift_std_ppm: float = float("inf")
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
            many = "is" if self.lost_samples == 1 else "are"
            gaps = counted(len(self.gaps), "gap")
            texts.append(f"{counted(self.lost_samples, 'sample')} {many} missing in {gaps} ({where})")
        over = {name: count for name, count in self.over_range.items() if count}
        if over:
            texts.append("over range: " + ", ".join(f"{name} {counted(n, 'sample')}" for name, n in over.items()))
        if self.changed:
            texts.append("the board changed its description in the middle")
        if not self.stamps_advance:
            texts.append("the board's time stamps do not advance, so that samples which it skipped stay unseen")
        texts += [text for off, text in self._clocks() if off > limits.clock_refused_ppm]
        return texts

    def remarks(self, limits: Limits) -> list[str]:
        """What does not forbid using it, but should be known."""
        texts = []
        if self.damaged:
            texts.append(f"{counted(self.damaged, 'damaged piece')} on the line")
        if self.jitter > limits.jitter:
            texts.append(
                f"the board's time stamps jitter by {self.jitter:.2g} samples rms, so that a single sample which it "
                "skipped may stay unseen"
            )
        return texts + [text for off, text in self._clocks() if limits.clock_ppm < off <= limits.clock_refused_ppm]

    def _clocks(self) -> list[tuple[float, str]]:
        """By how much the two clocks are off for certain [ppm], and how to say it."""
        if not self.stamps_advance:
            return []
        rate, drift = _SURE * self.rate_std_ppm, _SURE * self.drift_std_ppm
        return [
            (
                abs(self.rate_ppm) - rate,
                f"the board samples {self.rate_ppm:+.0f} +- {rate:.0f} ppm off its declared rate",
            ),
            (
                abs(self.drift_ppm) - drift,
                f"the board's clock runs {self.drift_ppm:+.0f} +- {drift:.0f} ppm off the computer's",
            ),
        ]

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    def __str__(self) -> str:
        clock = ""
        if self.stamps_advance and _SURE * self.drift_std_ppm <= Limits.clock_ppm:  # else it says nothing
            clock = f", clock {self.drift_ppm:+.0f} +- {_SURE * self.drift_std_ppm:.0f} ppm"
        lines = f"{counted(self.frames, 'frame')}, {self.lost_frames} lost, {self.damaged} damaged"
        return f"{lines}, {counted(len(self.gaps), 'gap')}{clock}"
