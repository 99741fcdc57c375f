"""What a board says in either wire format: who it is (Hello), samples (Block), and what is unreadable (Damage)."""

from dataclasses import dataclass

import numpy as np

#: Channel roles; base and malleolus are needed, the others optional.
ROLES = ("base", "malleolus", "tuberosity", "other")


@dataclass(frozen=True)
class Channel:
    """One accelerometer: its role, its range +-[m/s^2] and its sensitivity [counts per m/s^2] (1 if in m/s^2)."""

    role: str
    range_m_s2: float = float("inf")
    counts_per_m_s2: float = 1.0


@dataclass(frozen=True)
class Hello:
    """A board's description of itself.

    Attributes:
        board: its name. rate_hz: sampling rate. channels: in the order of the samples.
        bits: 16 or 24 for binary frames, 0 for text lines. frame_samples: samples a channel in each frame.
        boot: a number that changes when the board restarts.
    """

    board: str
    rate_hz: float
    channels: tuple[Channel, ...]
    bits: int = 0
    frame_samples: int = 1
    boot: int = 0

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the channels, in order."""
        return tuple(channel.role for channel in self.channels)

    def beyond(self, samples: np.ndarray) -> np.ndarray:
        """Which of the samples (n, channels) [m/s^2] reach their channel's range."""
        return np.abs(samples) >= np.array([channel.range_m_s2 for channel in self.channels])

    def reach(self, channel: int) -> float:
        """Highest acceleration +-[m/s^2] that a channel can show, by its range and its converter."""
        one = self.channels[channel]
        rail = (2 ** (self.bits - 1) - 1) / abs(one.counts_per_m_s2) if self.bits else float("inf")
        return min(one.range_m_s2, rail)

    def __str__(self) -> str:
        kind = f"{self.bits}-bit frames of {self.frame_samples}" if self.bits else "text lines"
        return f"{self.board}: {', '.join(self.roles)} at {self.rate_hz:g} Hz, {kind}"


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples.

    Attributes:
        sequence: number of this frame, modulo 2^32. time_us: device time of its first sample [us], modulo 2^32.
        samples: (n, channels) accelerations [m/s^2]. over: (channels,) how many of them are over range.
    """

    sequence: int
    time_us: int
    samples: np.ndarray
    over: np.ndarray


@dataclass(frozen=True)
class Damage:
    """Bytes that are no message: why, and how many."""

    why: str
    size: int


Message = Hello | Block | Damage
