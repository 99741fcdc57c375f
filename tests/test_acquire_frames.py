"""Binary frames: the documented bytes, an independent decoder, and everything that a line can do to them."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from feeder import COUNTS, counts_of, hello
from hypothesis import given, settings
from hypothesis import strategies as st

from fasbody.acquire.wire import (
    LONGEST_WIRE,
    Block,
    Channel,
    Damage,
    FrameReader,
    Hello,
    crc_ccitt,
    crc_modbus,
    encode_data,
    encode_hello,
)

DOCS = Path(__file__).parent.parent / "docs" / "acquisition.md"
DEMO = Hello("demo", 1000.0, (Channel("base", 39.2, 800.0), Channel("malleolus", 39.2, 800.0)), 16, 2, 7)


def documented(name: str) -> bytes:
    found = re.search(rf"^    {name}\s+((?:[0-9a-f]{{2}} ?)+)$", DOCS.read_text(), re.M)
    assert found, f"docs/acquisition.md has no line {name!r}"
    return bytes.fromhex(found[1])


def bitwise_crc(data: bytes, polynomial: int, reflected: bool) -> int:
    """CRC-16 with start 0xFFFF, bit by bit from its definition."""
    crc = 0xFFFF
    for byte in data:
        for i in range(8):
            bit = byte >> (i if reflected else 7 - i) & 1
            top = crc & 1 if reflected else crc >> 15
            crc = crc >> 1 if reflected else crc << 1 & 0xFFFF
            if top ^ bit:
                crc ^= int(f"{polynomial:016b}"[::-1], 2) if reflected else polynomial
    return crc


def unstuff(wire: bytes) -> bytes:
    """COBS by its paper: each code byte says how far the next zero is."""
    out, i = bytearray(), 0
    while i < len(wire):
        code = wire[i]
        out += wire[i + 1 : i + code]
        i += code
        if code < 255 and i < len(wire):
            out.append(0)
    return bytes(out)


@given(st.binary(max_size=300))
def test_checks_are_the_standard_ones(data: bytes) -> None:
    assert crc_ccitt(data) == bitwise_crc(data, 0x1021, False)
    assert crc_modbus(data) == bitwise_crc(data, 0x8005, True)


def test_check_values() -> None:
    assert (crc_ccitt(b"123456789"), crc_modbus(b"123456789")) == (0x29B1, 0x4B37)


def test_documented_example_is_what_the_code_writes_and_reads() -> None:
    counts = np.array([[100, -100], [256, 0]])
    assert encode_hello(DEMO) == documented("hello on wire")
    assert encode_data(5, 10_000, counts, 16) == documented("data on wire")
    for name in ("hello", "data"):
        raw = unstuff(documented(f"{name} on wire")[1:-1])
        assert raw[:-4] == documented(f"{name} payload")
        assert raw[-4:-2] == bitwise_crc(raw[:-4], 0x1021, False).to_bytes(2, "little")
        assert raw[-2:] == bitwise_crc(raw[:-4], 0x8005, True).to_bytes(2, "little")
    first, block = FrameReader().feed(documented("hello on wire") + documented("data on wire"))
    assert isinstance(first, Hello) and isinstance(block, Block)
    assert (first.board, first.rate_hz, first.roles, first.boot) == ("demo", 1000.0, ("base", "malleolus"), 7)
    assert (block.sequence, block.time_us) == (5, 10_000)
    np.testing.assert_array_equal(block.samples, [[0.125, -0.125], [0.32, 0.0]])


@given(
    bits=st.sampled_from([16, 24]), channels=st.integers(1, 8), n=st.integers(1, 20),
    seed=st.integers(0, 2**32 - 1), cuts=st.lists(st.integers(0, 3000), max_size=8),
)  # fmt: skip
def test_round_trip_in_pieces_of_any_size(bits: int, channels: int, n: int, seed: int, cuts: list[int]) -> None:
    rng = np.random.default_rng(seed)
    rail = 2 ** (bits - 1)
    roles = tuple(Channel("other", 1e9, 1.0) for _ in range(channels))
    about = Hello("any", 4000.0, roles, bits, n, 3)
    counts = [rng.integers(-rail, rail, (n, channels)) for _ in range(3)]
    wire = encode_hello(about) + b"".join(encode_data(2**32 - 2 + i, i, c, bits) for i, c in enumerate(counts))
    places = sorted({min(cut, len(wire)) for cut in cuts} | {0, len(wire)})
    reader, got = FrameReader(), []
    for a, b in pairwise(places):
        got += reader.feed(wire[a:b])
    blocks = [m for m in got if isinstance(m, Block)]
    assert [b.sequence for b in blocks] == [2**32 - 2, 2**32 - 1, 0]
    for block, wanted in zip(blocks, counts, strict=True):
        np.testing.assert_array_equal(block.samples, wanted)
        np.testing.assert_array_equal(block.over, ((wanted <= -rail) | (wanted >= rail - 1)).sum(axis=0))


@given(st.lists(st.binary(max_size=2000), max_size=20), st.booleans())
def test_any_bytes_are_survived_in_bounded_memory(pieces: list[bytes], known: bool) -> None:
    reader = FrameReader()
    if known:
        reader.feed(encode_hello(DEMO))
    for piece in pieces:
        for message in reader.feed(piece):
            assert isinstance(message, Damage)  # chance passes two CRC-16 once in 2^31
        assert reader.kept <= LONGEST_WIRE


@given(st.data())
@settings(max_examples=300)
def test_no_damage_of_any_kind_passes_as_samples(data: st.DataObject) -> None:
    """Bytes changed, removed, doubled: whatever comes out is a frame that went in."""
    about = hello(channels=3)
    clean = [encode_data(i, 16_000 * i, counts_of(np.arange(16 * i, 16 * i + 16), 3), 16) for i in range(4)]
    wire = bytearray(b"".join(clean))
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(wire) - 1))
        kind = data.draw(st.sampled_from(["change", "remove", "double"]))
        if kind == "change":
            wire[place] ^= data.draw(st.integers(1, 255))
        elif kind == "remove":
            del wire[place]
        else:
            wire.insert(place, wire[place])
    reader = FrameReader()
    reader.feed(encode_hello(about))
    for message in reader.feed(bytes(wire)):
        if isinstance(message, Block):
            index = np.arange(16 * message.sequence, 16 * message.sequence + 16)
            np.testing.assert_array_equal(message.samples * COUNTS, counts_of(index, 3))


def test_every_single_damaged_byte_is_noticed() -> None:
    wire = bytearray(encode_data(9, 1, counts_of(np.arange(16), 2), 16))
    for place in range(len(wire)):
        for flip in (1, 0x80, 0xFF, wire[place] or 1):
            dirty = bytearray(wire)
            dirty[place] ^= flip
            reader = FrameReader()
            reader.feed(encode_hello(hello()))
            assert not any(isinstance(m, Block) for m in reader.feed(bytes(dirty) + b"\0"))


def test_start_in_the_middle_is_no_damage_and_over_range_flag_counts() -> None:
    about = hello()
    wire = encode_hello(about) + encode_data(0, 0, counts_of(np.arange(16), 2), 16, flags=1)
    reader = FrameReader()
    got = reader.feed(wire[7:] + wire)
    assert [type(m) for m in got] == [Hello, Block]
    block = got[1]
    assert isinstance(block, Block) and list(block.over) == [1, 1]


@pytest.mark.parametrize("change", [{"bits": 12}, {"channels": ()}, {"rate_hz": 0.0}])
def test_senseless_hello_is_damage(change: dict[str, object]) -> None:
    from dataclasses import replace

    reader = FrameReader()
    reader.feed(encode_hello(DEMO))
    (message,) = reader.feed(encode_hello(replace(DEMO, **change)))  # type: ignore[arg-type]
    assert message == Damage("hello not understood", len(encode_hello(replace(DEMO, **change))) - 2)  # type: ignore[arg-type]
