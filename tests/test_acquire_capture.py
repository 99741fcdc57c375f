"""The capture file: what was written is read back, up to the last whole record, whatever happened to the file."""

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fasbody.acquire.capture import MAGIC, Capture, pack, read
from fasbody.exceptions import InputFileError

RECORDS = [("M", 1.0, b'{"seconds": 2}'), ("B", 2.5, bytes(range(256))), ("E", 3.0, b"{}"), ("B", 4.0, b"\xfaR" * 9)]


def written(folder: Path) -> Path:
    file = folder / "captures" / "one.fascap"
    capture = Capture(file)
    for record in RECORDS:
        capture.add(*record)
    capture.close()
    return file


def test_round_trip_and_json(tmp_path: Path) -> None:
    got = list(read(written(tmp_path)))
    assert [(r.kind, r.host, r.content) for r in got] == RECORDS
    assert got[0].json() == {"seconds": 2} and got[1].json() == {}


def test_every_truncation_leaves_the_records_before_it(tmp_path: Path) -> None:
    data = written(tmp_path).read_bytes()
    ends = [len(MAGIC)]
    for kind, host, content in RECORDS:
        ends.append(ends[-1] + len(pack(kind, host, content)))
    torn = tmp_path / "torn.fascap"
    for size in range(len(MAGIC), len(data) + 1):
        torn.write_bytes(data[:size])
        assert len(list(read(torn))) == sum(end <= size for end in ends[1:])


@given(st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_damage_costs_only_the_records_it_hits(tmp_path: Path, data: st.DataObject) -> None:
    raw = bytearray(MAGIC + b"".join(pack(*record) for record in RECORDS))
    place = data.draw(st.integers(len(MAGIC), len(raw) - 1))
    raw[place] ^= data.draw(st.integers(1, 255))
    file = tmp_path / "dirty.fascap"
    file.write_bytes(raw)
    got = [(r.kind, r.host, r.content) for r in read(file)]
    assert len(got) >= len(RECORDS) - 1 and all(record in RECORDS for record in got)


@given(st.binary(max_size=3000))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_any_content_is_survived(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "any.fascap"
    file.write_bytes(MAGIC + content)
    list(read(file))


def test_refusals(tmp_path: Path) -> None:
    other = tmp_path / "other.fascap"
    other.write_bytes(b"time_s,base_m_s2")
    with pytest.raises(InputFileError, match="not a capture file"):
        list(read(other))
    with pytest.raises(InputFileError, match="cannot be read"):
        list(read(tmp_path / "none.fascap"))
    written(tmp_path)
    with pytest.raises(InputFileError, match="cannot be created"):
        Capture(tmp_path / "captures" / "one.fascap")


def test_full_disk_ends_a_capture_with_its_last_whole_record(tmp_path: Path) -> None:
    """A limit on the file size gives the same failing write as a full disk."""
    program = textwrap.dedent("""
        import resource, signal, sys
        from pathlib import Path
        from fasbody.acquire.capture import Capture
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
        capture = Capture(Path(sys.argv[1]))
        for i in range(80):
            capture.add("B", i, bytes([i]) * 100)
        capture.close()
        print(capture.trouble)
    """)
    file = tmp_path / "full.fascap"
    done = subprocess.run(
        [sys.executable, "-B", "-c", program, str(file)],  # bytecode that meets the limit would be kept cut off
        capture_output=True, text=True, check=True,
        env={"PATH": "/usr/bin:/bin", "TMPDIR": str(tmp_path), "PYTHONPATH": str(Path(__file__).parent.parent)},
    )  # fmt: skip
    assert f"{file}: cannot be written" in done.stdout
    got = [r.content for r in read(file)]
    assert len(got) > 30 and got == [bytes([i]) * 100 for i in range(len(got))] and file.stat().st_size <= 5000
