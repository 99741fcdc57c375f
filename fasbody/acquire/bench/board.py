"""The virtual board: its description, and samples as frames or lines."""

import numpy as np

from fasbody.acquire.wire import ROLES, Channel, Hello, encode_data, encode_header, encode_hello, encode_line

RANGE_M_S2 = 39.2
FRAME_SAMPLES = 16


class VirtualBoard:
    """Turns samples into the bytes that a board sends.

    Args:
        rate_hz: sampling rate.
        channels: 2, or 3 with the tuberosity.
        bits: of a sample in a frame; 0 for text lines.
        boot: number of this start.

    Attributes:
        greeting: the bytes of its hello.
        samples: samples a channel in each frame.
    """

    def __init__(self, rate_hz: float, channels: int, bits: int, boot: int) -> None:
        roles, span = ROLES[:channels], float(np.float32(RANGE_M_S2 * 0.9999))  # a hair inside the rails
        self.rate_hz, self.bits = rate_hz, bits
        self.samples = FRAME_SAMPLES if bits else 1
        self._rail = 2 ** (bits - 1) if bits else 0
        self._counts_per = self._rail / RANGE_M_S2
        if bits:
            kinds = tuple(Channel(role, span, self._counts_per) for role in roles)
            self.greeting = encode_hello(Hello("virtual board", rate_hz, kinds, bits, self.samples, boot))
        else:
            self.greeting = encode_header("virtual", rate_hz, roles, span)

    def message(self, number: int, values: np.ndarray) -> bytes:
        """Frame or line of this number, from its values (samples, channels) [m/s^2]; each second greets anew."""
        greeting = self.greeting if number % round(self.rate_hz / self.samples) == 0 else b""
        stamp = round(number * self.samples / self.rate_hz * 1e6)
        if not self.bits:
            return greeting + encode_line(stamp, values[0])
        counts = np.clip(np.round(values * self._counts_per), -self._rail, self._rail - 1).astype(np.int32)
        return greeting + encode_data(number, stamp, counts, self.bits)
