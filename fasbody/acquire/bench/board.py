"""The virtual board: its description, and samples as frames or lines."""

import numpy as np

from fasbody.acquire.frames import FULL_SCALE, SAMPLES, Frames
from fasbody.acquire.wire import ROLES, encode_header, encode_line

RANGE_M_S2 = 39.2


class VirtualFrames(Frames):
    """The binary board, of a sample rate in Hz, 2 or 3 channels of 16 or 24 bits, and a number of this start."""

    samples = SAMPLES

    def __init__(self, rate_hz: float, channels: int, bits: int, boot: int) -> None:
        super().__init__("virtual board", rate_hz, channels * (RANGE_M_S2,), bits, boot)


class VirtualLines:
    """The text board, a sample a line."""

    samples = 1

    def __init__(self, rate_hz: float, channels: int) -> None:
        self.hello = encode_header("virtual", rate_hz, ROLES[:channels], FULL_SCALE * RANGE_M_S2)
        self._rate_hz, self._number = rate_hz, -1

    def frame(self, shares: np.ndarray) -> bytes:
        """The next line, of shares of the range (1, channels), behind a header once a second."""
        self._number += 1
        greeting = self.hello if self._number % round(self._rate_hz) == 0 else b""
        stamp = round(1e6 * self._number / self._rate_hz)
        return greeting + encode_line(stamp, RANGE_M_S2 * shares[0])
