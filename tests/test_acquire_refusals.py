"""What the user is told: wrong ports, wrong files, one or many, and a clock about which nothing can be said."""

from pathlib import Path

import numpy as np
import pytest
from feeder import Feeder, hello
from test_acquire_folder import CONDITION, capture_of, sine_frames

from fasbody.acquire.bench import Bench, Line
from fasbody.acquire.commands import app
from fasbody.acquire.conversion import convert
from fasbody.acquire.excitation import absent
from fasbody.acquire.generator import Generator
from fasbody.acquire.port import Port
from fasbody.acquire.timeline import Gap, Limits, Quality
from fasbody.acquire.wire import encode_hello
from fasbody.exceptions import AcquisitionError, FasError
from fasbody.recording.recording import Recording


def refusal(*words: str) -> str:
    with pytest.raises(FasError) as caught:
        app(list(words), standalone_mode=False)
    return str(caught.value)


def test_what_is_no_port_is_named(tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("x")
    for name, kind in ((str(tmp_path), "a folder"), (str(file), "a file"), ("/dev/null", "some other device")):
        with pytest.raises(AcquisitionError, match=f"{name}: is no serial port but {kind}; ports of this computer: "):
            Port(name, 9600)
    with pytest.raises(AcquisitionError, match="there is no such port"):
        Port(str(tmp_path / "ttyACM7"), 9600)
    line = Line(tmp_path / "line")
    line.plug()
    first = Port(str(line.link), 9600)
    with pytest.raises(AcquisitionError, match="another program uses this port"):
        Port(str(line.link), 9600)
    first.close()
    line.unplug()


def test_recover_names_the_captures_there_are(tmp_path: Path) -> None:
    study = tmp_path / "study"
    good = capture_of(study, "20hz_0kg", sine_frames(60))
    table = convert([good], study).file
    for wrong, problem in (
        (study / "captures" / "21hz_0kg.fascap", "cannot be read (No such file or directory)"),
        (table, "is not a capture file"), (study, "cannot be read (Is a directory)"),
    ):  # fmt: skip
        told = refusal("recover", str(wrong))
        assert told.startswith(f"{wrong}: {problem}; valid: ") and str(good) in told and not told.endswith("..")
    lonely = tmp_path / "lonely" / "x.csv"
    assert "acquisition writes them as STUDY/captures/NAME.fascap" in refusal("recover", str(lonely))
    elsewhere = tmp_path / "moved.fascap"
    elsewhere.write_bytes(good.read_bytes())
    assert "give --out STUDY" in refusal("recover", str(elsewhere))


def test_ports_that_are_the_same_or_swapped(tmp_path: Path) -> None:
    with Bench() as bench:
        board, generator = bench.board_port, bench.generator_port
        common = ["record", "--out", str(tmp_path / "study"), "--body-mass", "70", "--frequency", "20"]
        assert "are both" in refusal(*common, "--port", board, "--generator", board)
        told = refusal(*common, "--port", generator, "--generator", board)
        assert told.endswith(f"give --port {board} --generator {generator}.")
    assert not (tmp_path / "study").exists()


def test_board_taken_for_a_generator_is_told_nothing_about_outputs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Feeder(tmp_path) as feeder, pytest.raises(AcquisitionError, match=r"IDN\?"):
        feeder.instead = b"1000,0.1,0.2\n"
        Generator(feeder.port, 9600)
    assert "OUTP OFF" not in capsys.readouterr().err


def test_one_is_singular_and_a_clock_without_an_uncertainty_is_not_printed() -> None:
    one = Quality(frames=1, lost_frames=1, damaged=1, gaps=(Gap(0.1, 1, "skipped"),), over_range={"base": 1})
    assert str(one) == "1 frame, 1 lost, 1 damaged, 1 gap"
    assert one.problems(Limits())[0].startswith("1 sample is missing in 1 gap (")
    assert one.problems(Limits())[1] == "over range: base 1 sample"
    assert one.remarks(Limits()) == ["1 damaged piece on the line"]
    noise = Quality(frames=62, drift_ppm=2900.0, drift_std_ppm=1100.0, rate_ppm=900.0, rate_std_ppm=400.0)
    assert "clock" not in str(noise) and noise.remarks(Limits()) == noise.problems(Limits()) == []
    known = Quality(frames=6200, drift_ppm=900.0, drift_std_ppm=10.0)
    assert str(known).endswith("clock +900 +- 30 ppm")
    assert known.remarks(Limits()) == ["the board's clock runs +900 +- 30 ppm off the computer's"]


@pytest.mark.parametrize(("rms", "refused"), [(0.03, True), (0.15, True), (0.3, False), (6.3, False)])
def test_rest_is_no_excitation_whatever_the_offset_and_a_slow_drift(rms: float, refused: bool) -> None:
    rng = np.random.default_rng(4)
    t = np.arange(4000) / 1000
    base = rms * rng.normal(size=t.size) + 9.81 + 1.5 * np.sin(2 * np.pi * 0.25 * t)
    text = absent(Recording(t, base, rng.normal(size=t.size)))
    assert ("the base is at rest" in text) == refused


def test_short_of_what_was_planned_is_not_listed_until_asked_for(tmp_path: Path) -> None:
    """A session of 3 s whose last second never came, and one that was told to begin with a hello only."""
    file = capture_of(tmp_path, "20hz", sine_frames(125), seconds=3.0)
    made = convert([file], tmp_path, stopped="the board is silent for 3 s; check its supply.")
    assert made.problems == ("2 s are there of 3 s",)
    assert made.remarks == ("ended early: the board is silent for 3 s; check its supply",)
    assert (tmp_path / "recordings.csv").read_text().count("20hz") == 0 and file.is_file()
    assert convert([file], tmp_path, longest=True).problems == ()
    assert (tmp_path / "recordings.csv").read_text().count("20hz") == 1
    with pytest.raises(AcquisitionError, match="but no samples; no recording can be made"):
        convert([capture_of(tmp_path, "none", encode_hello(hello()), condition=CONDITION)], tmp_path)
