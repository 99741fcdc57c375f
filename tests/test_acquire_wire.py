"""Both wire formats: the documented bytes, an independent decoder, and everything that a line can do to them."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from feeder import COUNTS, counts_of, hello
from hypothesis import given, settings
from hypothesis import strategies as st

from fasbody.acquire import wire
from fasbody.acquire.bench.line import corrupt
from fasbody.acquire.timeline import Timeline
from fasbody.acquire.wire import (
    Block,
    Channel,
    Damage,
    Decoder,
    FrameReader,
    Hello,
    LineReader,
    crc_ccitt,
    crc_modbus,
    encode_data,
    encode_header,
    encode_hello,
    encode_line,
)

DOCS = Path(__file__).parent.parent / "fasbody" / "acquire" / "README.md"
DEMO = Hello("demo", 1000.0, (Channel("base", 39.2, 800.0), Channel("malleolus", 39.2, 800.0)), 16, 2, 7)
HEADER = encode_header("uno", 1000.0, ("base", "malleolus"), 39.2)
PLAIN = b"# fas board=uno rate_hz=1000 range_m_s2=39.2\ntime_us,base_m_s2,malleolus_m_s2\n"


def documented(name: str) -> bytes:
    found = re.search(rf"^    {name}\s+((?:[0-9a-f]{{2}} ?)+)$", DOCS.read_text(), re.M)
    assert found, f"{DOCS} has no line {name!r}"
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


def unstuff(stuffed: bytes) -> bytes:
    """COBS by its paper: each code byte says how far the next zero is."""
    out, i = bytearray(), 0
    while i < len(stuffed):
        code = stuffed[i]
        out += stuffed[i + 1 : i + code]
        i += code
        if code < 255 and i < len(stuffed):
            out.append(0)
    return bytes(out)


@pytest.mark.parametrize("size", [0, 1, 253, 254, 255, 508, 1028])
def test_stuffing_at_the_ends_of_blocks(size: int) -> None:
    """Against the decoder above, which is written after the paper; what ends too early is refused."""
    for data in (b"\1" * size, b"\1" * size + b"\0", b"\0" + b"\1" * size):
        stuffed = wire.stuff(data)
        assert b"\0" not in stuffed
        assert unstuff(stuffed) == wire.unstuff(stuffed) == data
        assert wire.unstuff(stuffed[:-1]) is None or stuffed[-1] == 1


@given(st.binary(max_size=300))
def test_checks_are_the_standard_ones(data: bytes) -> None:
    assert (crc_ccitt(b"123456789"), crc_modbus(b"123456789")) == (0x29B1, 0x4B37)
    assert crc_ccitt(data) == bitwise_crc(data, 0x1021, False)
    assert crc_modbus(data) == bitwise_crc(data, 0x8005, True)


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


@pytest.mark.parametrize(("kind", "greeting"), [(FrameReader, encode_hello(DEMO)), (LineReader, HEADER)])
@given(pieces=st.lists(st.binary(max_size=2000), max_size=20), known=st.booleans())
def test_any_bytes_are_survived_in_bounded_memory(
    kind: type[FrameReader | LineReader], greeting: bytes, pieces: list[bytes], known: bool
) -> None:
    reader = kind()
    if known:
        reader.feed(greeting)
    for piece in pieces:
        for message in reader.feed(piece):
            assert isinstance(message, Damage) or kind is LineReader  # chance passes two CRC-16 once in 2^31
        assert reader.kept <= reader.LONGEST


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
    reader = FrameReader()
    reader.feed(encode_hello(DEMO))
    (message,) = reader.feed(encode_hello(replace(DEMO, **change)))  # type: ignore[arg-type]
    assert message == Damage("hello not understood", len(encode_hello(replace(DEMO, **change))) - 2)  # type: ignore[arg-type]


def test_documented_example() -> None:
    found = re.search(r"((?:    .*\n)+)", DOCS.read_text()[DOCS.read_text().index("## Text lines") :])
    assert found
    text = "\n".join(line.strip() for line in found[1].splitlines()) + "\n"
    about, block = LineReader().feed(text.encode())
    assert isinstance(about, Hello) and isinstance(block, Block)
    assert (about.board, about.rate_hz, about.roles) == ("uno", 1000.0, ("base", "malleolus"))
    assert block.time_us == 1000
    np.testing.assert_array_equal(block.samples, [[0.12, -0.38]])


@given(st.lists(st.floats(-39, 39), min_size=2, max_size=60), st.integers(1, 40))
def test_round_trip_in_pieces(values: list[float], size: int) -> None:
    wire = HEADER + b"".join(encode_line(1000 * i, np.array([v, -v])) for i, v in enumerate(values))
    reader, got = LineReader(), []
    for start in range(0, len(wire), size):
        got += reader.feed(wire[start : start + size])
    blocks = [m for m in got if isinstance(m, Block)]
    assert [b.sequence for b in blocks] == list(range(len(values)))
    np.testing.assert_allclose([b.samples[0, 0] for b in blocks], values, atol=5.1e-5)
    assert not any(isinstance(m, Damage) for m in got)


@given(st.text("0123456789.,-+eE*ABCDEFinfa_# \t", max_size=80))
def test_lines_that_look_almost_right_never_fail(text: str) -> None:
    reader = LineReader()
    assert isinstance(reader.feed(PLAIN)[0], Hello)
    for message in reader.feed(text.encode() + b"\n"):
        assert not isinstance(message, Block) or np.isfinite(message.samples).all()


def test_changed_digit_is_damage_with_a_check_only() -> None:
    good = encode_line(1000, np.array([0.12, -0.38]))
    bad = good.replace(b"0.12", b"0.92")
    reader = LineReader()
    reader.feed(HEADER)
    assert isinstance(reader.feed(bad)[0], Damage)
    assert isinstance(reader.feed(good.split(b"*")[0] + b"\n")[0], Damage)  # crc=1 promises one
    assert isinstance(reader.feed(good)[0], Block)
    plain = LineReader()
    plain.feed(PLAIN)
    assert isinstance(plain.feed(bad.split(b"*")[0] + b"\n")[0], Block)


def test_changed_header_is_believed_when_checked_or_repeated() -> None:
    reader = LineReader()
    assert isinstance(reader.feed(PLAIN)[0], Hello)
    damaged = PLAIN.replace(b"rate_hz=1000", b"rate_hz=1060")
    assert isinstance(reader.feed(damaged)[0], Damage)
    assert isinstance(reader.feed(PLAIN)[0], Hello)  # as before, so the other one was damage
    assert isinstance(reader.feed(damaged)[0], Damage)
    assert reader.hello is not None and reader.hello.rate_hz == 1000.0
    (hello,) = reader.feed(damaged)
    assert isinstance(hello, Hello) and hello.rate_hz == 1060.0 and reader.preamble == damaged
    checked = encode_header("uno", 500.0, ("base", "malleolus"), 39.2)
    (hello,) = reader.feed(checked)
    assert isinstance(hello, Hello) and hello.rate_hz == 500.0
    assert isinstance(reader.feed(checked.replace(b"rate_hz=500", b"rate_hz=900"))[0], Damage)
    assert isinstance(reader.feed(checked.replace(b"*", b","))[0], Damage)


def test_one_percent_damaged_bytes_change_no_header_and_no_sample() -> None:
    """60 headers and 6,000 lines; what is accepted is what was sent."""
    rng = np.random.default_rng(0)
    reader = LineReader()
    (first,) = reader.feed(HEADER)
    accepted = 0
    for second in range(60):
        values = rng.normal(0, 5, (100, 2))
        stamps = [second * 1_000_000 + 1000 * i for i in range(100)]
        wire = HEADER + b"".join(encode_line(t, v) for t, v in zip(stamps, values, strict=True))
        sent = dict(zip(stamps, np.round(values, 4), strict=True))
        for message in reader.feed(corrupt(wire, 0.01, rng)):
            if isinstance(message, Block):
                np.testing.assert_allclose(message.samples[0], sent[message.time_us], atol=1e-9)
                accepted += 1
            elif isinstance(message, Hello):
                assert message == first
    assert accepted > 3_000


def test_clock_of_32_bits_runs_over_and_a_missing_line_is_a_gap() -> None:
    reader = LineReader()
    (about,) = reader.feed(HEADER)
    assert isinstance(about, Hello)
    timeline = Timeline(about)
    stamps = [(2**32 - 10_296 + 1000 * i) % 2**32 for i in range(40) if i not in (20, 30, 31)]
    timeline.add(reader.feed(b"".join(encode_line(t, np.zeros(2)) for t in stamps)), 0.0)
    assert stamps[0] > stamps[-1]
    assert [(gap.after_s, gap.lost_samples) for gap in timeline.quality().gaps] == [(0.019, 1), (0.029, 2)]
    np.testing.assert_array_equal(timeline.samples()[0], [i for i in range(40) if i not in (20, 30, 31)])


def test_units_of_the_header_are_those_of_recordings() -> None:
    reader = LineReader()
    got = reader.feed(b"# fas rate_hz=500\ntime_ms,base_g,malleolus_mm_s2\n4,1,2500\n")
    assert isinstance(got[1], Block)
    np.testing.assert_allclose(got[1].samples, [[9.80665, 2.5]])
    assert got[1].time_us == 4000


@pytest.mark.parametrize("head", [b"# fas board=x\n", b"# fas rate_hz=-1\n", b"# fas rate_hz=nan\n", b"# other\n"])
def test_header_that_says_too_little(head: bytes) -> None:
    reader = LineReader()
    reader.feed(b"\n# start\n")
    assert not any(isinstance(m, Hello) for m in reader.feed(head + b"time_us,base_g,malleolus_g\n1000,1,2\n"))
    assert reader.hello is None


def test_the_format_is_found_by_listening() -> None:
    text, binary = Decoder(), Decoder()
    assert text.feed(b"garbage\0\0\xff\n") == []
    assert isinstance(text.feed(HEADER)[0], Hello)
    binary.feed(b"garbage\n\0" + encode_hello(hello()))
    assert binary.hello is not None and binary.hello.bits == 16
    again = Decoder(binary.preamble)
    (block,) = again.feed(encode_data(0, 0, counts_of(np.arange(16), 2), 16))
    assert again.hello == binary.hello and isinstance(block, Block)
    assert isinstance(Decoder(text.preamble).feed(encode_line(5000, np.zeros(2)))[0], Block)
