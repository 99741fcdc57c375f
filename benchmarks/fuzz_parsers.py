"""Random, damaged and almost right bytes for the parsers of both boards, as `python -m benchmarks.acquire fuzz`."""

import resource

import numpy as np

from fasbody.acquire.bench.line import corrupt
from fasbody.acquire.wire import (
    LONGEST_LINE,
    LONGEST_WIRE,
    Channel,
    FrameReader,
    Hello,
    LineReader,
    encode_data,
    encode_header,
    encode_hello,
    encode_line,
    wrap,
)
from fasbody.console import console
from reproduction.check import Check, at_most, told

HELLO = Hello("noisy", 4000.0, tuple(Channel(r, 39.2, 1024.0) for r in ("base", "malleolus", "tuberosity")), 16, 16, 1)


def counts_of(frame: int) -> np.ndarray:
    """Counts of a frame, a function of its number, so that each sample received can be checked."""
    index = np.arange(frame * 16, frame * 16 + 16)
    return ((index[:, None] * 7919 + np.arange(3) * 104729) % 60013 - 30006).astype(np.int32)


def fuzz(strings: int) -> list[Check]:
    """Random, damaged and almost right byte strings into both parsers."""
    rng = np.random.default_rng(2)
    good = [encode_hello(HELLO), *(encode_data(i, 4000 * i, counts_of(i), 16) for i in range(4))]
    header = encode_header("fuzz", 1000.0, ("base", "malleolus"), 39.2)
    good += [header, *(encode_line(1000 * i, rng.normal(size=2)) for i in range(4))]
    letters = np.frombuffer(b"0123456789.,-+eE*ABCDEFnaift_us# \n\r\0=", np.uint8)
    frames, lines = FrameReader(), LineReader()
    lines.feed(header)
    failures, longest, passed = 0, 0, 0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number in range(strings):
        kind = number % 6
        if kind == 0:
            data = rng.bytes(int(rng.integers(0, 200)))
        elif kind == 1:
            data = corrupt(good[int(rng.integers(len(good)))], 0.05, rng)
        elif kind == 2:
            data = good[int(rng.integers(len(good)))][int(rng.integers(0, 40)) :]
        elif kind == 3:  # sound frames of senseless content
            data = wrap(rng.choice([b"H", b"D"]) + rng.bytes(int(rng.integers(0, 150))))
        elif kind == 4:  # nothing that ends a frame or a line
            data = rng.integers(11, 256, int(rng.integers(0, 600)), dtype=np.uint8).tobytes()
        else:
            data = letters[rng.integers(0, letters.size, int(rng.integers(0, 120)))].tobytes()
        try:
            passed += len(frames.feed(data)) + len(lines.feed(data))
        except Exception as error:  # counted: this is what the run looks for
            failures += 1
            console.print(repr(error), repr(data))
        longest = max(longest, frames.kept, lines.kept)
        if frames.hello is None:
            frames.feed(good[0])
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return [
        Check(f"{strings:,} byte strings into both parsers: exceptions", failures, 0, 0, beside="none"),
        at_most("bytes kept between strings", longest, max(LONGEST_WIRE, LONGEST_LINE)),
        at_most("memory grown by the run", grown, 50, "MB"),
        told("messages made of them", f"{passed:,}"),
    ]
