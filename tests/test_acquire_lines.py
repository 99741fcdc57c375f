"""Text lines: the documented example, checks, clocks that run over, and whatever else may come."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fasbody.acquire.bench import corrupt
from fasbody.acquire.timeline import Timeline
from fasbody.acquire.wire import LONGEST_LINE, Block, Damage, Decoder, Hello, LineReader, encode_header, encode_line

DOCS = Path(__file__).parent.parent / "docs" / "acquisition.md"
HEADER = encode_header("uno", 1000.0, ("base", "malleolus"), 39.2)
PLAIN = b"# fas board=uno rate_hz=1000 range_m_s2=39.2\ntime_us,base_m_s2,malleolus_m_s2\n"


def test_documented_example() -> None:
    found = re.search(r"((?:    .*\n)+)", DOCS.read_text()[DOCS.read_text().index("### Text lines") :])
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


@given(st.lists(st.binary(max_size=700), max_size=20), st.booleans())
def test_any_bytes_are_survived_in_bounded_memory(pieces: list[bytes], known: bool) -> None:
    reader = LineReader()
    if known:
        reader.feed(HEADER)
    for piece in pieces:
        reader.feed(piece)
        assert reader.kept <= LONGEST_LINE


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
    """200 headers and 20,000 lines; what is accepted is what was sent."""
    rng = np.random.default_rng(0)
    reader = LineReader()
    (first,) = reader.feed(HEADER)
    accepted = 0
    for second in range(200):
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
    assert accepted > 10_000


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
    from feeder import counts_of, hello

    from fasbody.acquire.wire import encode_data, encode_hello

    text, binary = Decoder(), Decoder()
    assert text.feed(b"garbage\0\0\xff\n") == []
    assert isinstance(text.feed(HEADER)[0], Hello)
    binary.feed(b"garbage\n\0" + encode_hello(hello()))
    assert binary.hello is not None and binary.hello.bits == 16
    again = Decoder(binary.preamble)
    (block,) = again.feed(encode_data(0, 0, counts_of(np.arange(16), 2), 16))
    assert again.hello == binary.hello and isinstance(block, Block)
    assert isinstance(Decoder(text.preamble).feed(encode_line(5000, np.zeros(2)))[0], Block)
