"""A board made of a thread: known samples in real time over a pseudo-terminal, with faults on demand."""

import time
from pathlib import Path

import numpy as np
from device import Device

from fasbody.acquire.bench import BODY_MASS_KG, FRAME_SAMPLES, Bench, corrupt
from fasbody.acquire.port import Port
from fasbody.acquire.wire import Channel, Hello, encode_data, encode_hello
from fasbody.exceptions import AcquisitionError
from fasbody.recording.recording import Condition

BAUD = 921600
CONDITION = Condition("16", "midstance", 0.0, BODY_MASS_KG)
RANGE = 39.2
COUNTS = 1024.0  # a power of two: nothing is rounded on the way


def hello(rate_hz: float = 1000.0, channels: int = 2, bits: int = 16, boot: int = 1) -> Hello:
    roles = ("base", "malleolus", "tuberosity")[:channels]
    return Hello("feeder", rate_hz, tuple(Channel(r, RANGE, COUNTS) for r in roles), bits, FRAME_SAMPLES, boot)


def counts_of(index: np.ndarray, channels: int) -> np.ndarray:
    """Counts of each sample (n, channels): a function of its number alone, so that every value can be checked."""
    primes = np.array([20011, 19997, 19993])[:channels]  # together they repeat after 4e8 samples
    return (index[:, None] * 7919 % primes - 10_000).astype(np.int32)


def number_of(sample: np.ndarray) -> int:
    """Which sample has these values (channels,) [m/s^2]."""
    return int(np.flatnonzero((counts_of(np.arange(400_000), sample.size) == sample * COUNTS).all(axis=1))[0])


def output_of(bench: Bench) -> str:
    """Ask the instrument itself, without switching anything."""
    try:
        port = Port(bench.generator_port, 115200)
    except AcquisitionError:
        return "busy"
    try:
        port.write(b"\nOUTP?\n")
        answer, deadline = b"", time.monotonic() + 1
        while b"\n" not in answer and time.monotonic() < deadline:
            answer += port.read()
        return answer.decode().strip()
    finally:
        port.close()


class Feeder(Device):
    """Sends frames in real time from a thread; `sent` is the number of samples a channel so far."""

    def __init__(self, folder: Path, rate_hz: float = 1000.0, channels: int = 2, damage: float = 0.0) -> None:
        super().__init__(folder / "feeder")
        self.hello = hello(rate_hz, channels)
        self.sent = 0
        self.damaged: set[int] = set()  # numbers of the frames that went out damaged
        self.paused = False
        self.garbage = False
        self.instead = b""  # sent in place of every frame
        self.amplitude = 0  # counts added to every sample
        self._damage, self._rng = damage, np.random.default_rng(5)

    def serve(self) -> None:
        start, n, frame = time.monotonic(), FRAME_SAMPLES, 0
        rate = self.hello.rate_hz
        while not self._end.is_set():
            time.sleep(max(0.0, start + (frame + 1) * n / rate - time.monotonic()))
            out = b""
            if frame % round(rate / n) == 0 or self.line.receive():
                out = encode_hello(self.hello)
            counts = counts_of(np.arange(frame * n, (frame + 1) * n), len(self.hello.channels)) + self.amplitude
            clean = encode_data(frame, round(frame * n / rate * 1e6), np.clip(counts, -32768, 32767), 16)
            dirty = corrupt(clean, self._damage, self._rng) if self._damage else clean
            if dirty != clean:
                self.damaged.add(frame)
            if not self.paused:
                self.line.send(self._rng.bytes(80) if self.garbage else self.instead or out + dirty)
            frame += 1
            self.sent = frame * n
