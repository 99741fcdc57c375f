"""What stands in for hardware: devices made of a thread that serves a pseudo-terminal, with faults on demand."""

import os
import select
import threading
import time
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from fasbody.acquire.bench.foot import BODY_MASS_KG
from fasbody.acquire.bench.generator import VirtualGenerator
from fasbody.acquire.bench.line import Line, corrupt
from fasbody.acquire.capture import Capture
from fasbody.acquire.frames import SAMPLES
from fasbody.acquire.wire import Channel, FrameReader, Hello, encode_data, encode_hello
from fasbody.exceptions import FasError
from fasbody.recording.recording import Condition

BAUD = 921600
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent)}
#: `python -m fasbody.acquire` as a program that waits for long, as `conftest.patient` lets this process.
PATIENT = """
import runpy
from fasbody.acquire import board, generator, guard, session, timeline
timeline._drift = lambda pairs: (0.0, float("inf"))
board.BLIND_S = board.STALLED_S = board.HELLO_S = session.STALLED_S = generator._ANSWER_S = guard.SILENT_S = 60.0
runpy.run_module("fasbody.acquire", run_name="__main__")
"""
CONDITION = Condition("16", "midstance", 0.0, BODY_MASS_KG)
RANGE = 39.2
LATE_S = 0.1
COUNTS = 1024.0  # a power of two: nothing is rounded on the way


class Device:
    """Plugs its line and runs `serve` in a thread; `port` is the name to open."""

    def __init__(self, link: Path) -> None:
        self.line = Line(link)
        self.port = str(link)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self.serve, daemon=True)

    def serve(self) -> None:
        """Until `_end` is set."""

    def __enter__(self) -> Self:
        self.line.plug()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._end.set()
        self._thread.join()
        self.line.unplug()


def hello(rate_hz: float = 1000.0, channels: int = 2, bits: int = 16, boot: int = 1) -> Hello:
    roles = ("base", "malleolus", "tuberosity")[:channels]
    return Hello("feeder", rate_hz, tuple(Channel(r, RANGE, COUNTS) for r in roles), bits, SAMPLES, boot)


def counts_of(index: np.ndarray, channels: int) -> np.ndarray:
    """Counts of each sample (n, channels): a function of its number alone, so that every value can be checked."""
    primes = np.array([20011, 19997, 19993])[:channels]  # together they repeat after 4e8 samples
    return (index[:, None] * 7919 % primes - 10_000).astype(np.int32)


def number_of(sample: np.ndarray) -> int:
    """Which sample has these values (channels,) [m/s^2]."""
    return int(np.flatnonzero((counts_of(np.arange(400_000), sample.size) == sample * COUNTS).all(axis=1))[0])


class Feeder(Device):
    """Sends frames in real time from a thread; `sent` is the number of samples a channel so far.

    What a busy machine was late for it makes up for up to LATE_S: a whole recording that came at once would leave no
    moment in its middle.
    """

    def __init__(self, folder: Path, rate_hz: float = 1000.0, channels: int = 2, damage: float = 0.0) -> None:
        super().__init__(folder / "feeder")
        self.hello = hello(rate_hz, channels)
        self.sent = 0
        self.damaged: set[int] = set()  # numbers of the frames that went out damaged
        self.paused = False
        self.garbage = False
        self.instead = b""  # sent in place of every frame
        self.amplitude = 0  # counts added to every sample
        self._sending = threading.Lock()
        self._damage, self._rng = damage, np.random.default_rng(5)

    def pause(self) -> None:
        """Nothing is sent any more once this returns: setting `paused` alone lets one more frame through."""
        with self._sending:
            self.paused = True

    def serve(self) -> None:
        start, n, frame = time.monotonic(), SAMPLES, 0
        rate = self.hello.rate_hz
        while not self._end.is_set():
            late = time.monotonic() - start - (frame + 1) * n / rate
            start += max(0.0, late - LATE_S)
            time.sleep(max(0.0, -late))
            out = b""
            if frame % round(rate / n) == 0 or self.line.receive():
                out = encode_hello(self.hello)
            counts = counts_of(np.arange(frame * n, (frame + 1) * n), len(self.hello.channels)) + self.amplitude
            clean = encode_data(frame, round(frame * n / rate * 1e6), np.clip(counts, -32768, 32767), 16)
            dirty = corrupt(clean, self._damage, self._rng) if self._damage else clean
            if dirty != clean:
                self.damaged.add(frame)
            with self._sending:
                if self.paused:
                    self.line.send(b"")  # what the host was too late to fetch
                else:
                    self.line.send(self._rng.bytes(80) if self.garbage else self.instead or out + dirty)
            frame += 1
            self.sent = frame * n


class Instrument(Device):
    """Answers on a pseudo-terminal; `answers` replace what the bench's generator says, `unknown` are refused."""

    def __init__(self, folder: Path, answers: dict[str, str] | None = None, unknown: tuple[str, ...] = ()) -> None:
        super().__init__(folder / "instrument")
        self.shaker = VirtualGenerator()
        self.answers, self.unknown = answers or {}, unknown
        self.heard: list[str] = []

    def serve(self) -> None:
        rest = b""
        while not self._end.is_set():
            select.select([self.line.master], [], [], 0.05)
            *lines, rest = (rest + self.line.receive()).split(b"\n")
            for line in lines:
                text = line.decode().strip()
                if not text:
                    continue
                self.heard.append(text)
                if text.partition(" ")[0] in self.unknown:
                    self.shaker.errors.append('-113,"Undefined header"')
                    continue
                answer = self.answers.get(text, self.shaker.do(text))
                if answer is not None:
                    self.line.send(answer.encode() + b"\r\n")


def capture_of(
    study: Path, stem: str, wire: bytes, seconds: float | None = None, rate: float = 1000.0,
    condition: Condition = CONDITION, started: str | None = None,
) -> Path:  # fmt: skip
    """A capture file of a stream of frames, arriving evenly."""
    duration = 16 / rate * wire.count(b"\0") / 2
    reader = FrameReader()
    reader.feed(encode_hello(hello(rate)))
    capture = Capture(study / "captures" / f"{stem}.fascap")
    about = {"seconds": seconds, "preamble": reader.preamble.hex(), "condition": vars(condition), "origin": "measured"}
    capture.add("M", 0.0, about | ({"started_utc": started} if started else {}))
    for start in range(0, len(wire), 500):
        capture.add("B", duration * start / len(wire), wire[start : start + 500])
    capture.close()
    return capture.file


def sine_frames(count: int, missing: tuple[int, ...] = (), rate: float = 1000.0) -> bytes:
    """Frames of a 20 Hz sine on both channels, the malleolus a little late."""
    t = np.arange(count * 16) / rate
    noise = np.random.default_rng(0).normal(0, 20, (t.size, 2))
    wave = 8000 * np.column_stack([np.sin(40 * np.pi * t), 1.2 * np.sin(40 * np.pi * t - 0.4)]) + noise
    parts = np.round(wave).astype(int).reshape(count, 16, 2)
    stamps = np.round(np.arange(count) * 16 / rate * 1e6)
    frames = [encode_data(i, int(stamps[i]), parts[i], 16) for i in range(count) if i not in missing]
    return b"".join(frames)


def refusal(*words: str) -> str:
    """What a command says against these words."""
    from fasbody.acquire.commands import app

    with pytest.raises(FasError) as caught:
        app(list(words), standalone_mode=False)
    return str(caught.value)
