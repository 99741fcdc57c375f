"""What devices without a firmware of ours send: frames that are made here."""

import time
from collections.abc import Sequence

import numpy as np

from fasbody.acquire.wire import ROLES, Channel, Hello, encode_data, encode_hello

#: Samples of a frame.
SAMPLES = 16
#: So much of full scale is over range.
FULL_SCALE = 1 - 1e-4


class Frames:
    """Samples of a device as the frames of docs/acquisition.md, behind a hello once a second.

    Args:
        name: of the device.
        rate_hz: of the samples.
        scales_m_s2: full scale of base, malleolus and so on; negative if upside down.
        bits: of a sample, 16 or 24.
        boot: number of this start; by the clock unless given.

    Example:
        >>> frames = Frames("mine", 1000.0, (40.0, -40.0))
        >>> len(frames.frame(np.zeros((SAMPLES, 2))))
        154
    """

    def __init__(
        self,
        name: str,
        rate_hz: float,
        scales_m_s2: Sequence[float] | np.ndarray,
        bits: int = 24,
        boot: int | None = None,
    ) -> None:
        self.rail = 2 ** (bits - 1)
        channels = tuple(
            Channel(role, FULL_SCALE * abs(scale), self.rail / scale)
            for role, scale in zip(ROLES, scales_m_s2, strict=False)
        )
        short = name.encode()[:32].decode(errors="ignore")
        boot = int(time.time()) % 65536 if boot is None else boot
        self.hello = encode_hello(Hello(short, rate_hz, channels, bits, SAMPLES, boot))
        self._rate_hz, self._bits = rate_hz, bits
        self._number = 0
        self._greeted = -1  # in which second
        self._events: list[str] = []

    def frame(self, shares: np.ndarray, flags: int = 0) -> bytes:
        """The next frame, of shares of full scale (SAMPLES, channels)."""
        start = self._number * SAMPLES / self._rate_hz
        greeting = self.hello if int(start) != self._greeted else b""
        self._greeted = int(start)
        counts = np.clip(np.round(self.rail * shares), -self.rail, self.rail - 1).astype(np.int32)
        self._number += 1
        stamp = round(1e6 * start)
        return greeting + encode_data(self._number - 1, stamp, counts, self._bits, flags)

    def skip(self, event: str) -> None:
        """Samples are missing here: a frame's number is left out."""
        self._number += 1
        self._events.append(event)

    def greet(self) -> None:
        """Begin the next frame with a hello."""
        self._greeted = -1

    def events(self) -> list[str]:
        """What was skipped since the last call."""
        events, self._events = self._events, []
        return events
