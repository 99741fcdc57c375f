"""Recordings through real pseudo-terminals and pyserial, with every fault that a board and its line can have."""

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from feeder import BAUD, CONDITION, COUNTS, Feeder, counts_of, number_of

from fasbody.acquire import session
from fasbody.acquire.bench import Bench
from fasbody.acquire.board import Board
from fasbody.acquire.capture import Capture
from fasbody.acquire.conversion import convert, replay
from fasbody.acquire.display import bar, render, sparkline
from fasbody.acquire.generator import Generator
from fasbody.acquire.level import Level
from fasbody.acquire.plan import Plan
from fasbody.acquire.port import Arrival
from fasbody.acquire.session import Session
from fasbody.exceptions import AcquisitionError, InputFileError
from fasbody.recording.study import Study


def test_three_channels_at_4_khz_arrive_whole_and_as_sent(tmp_path: Path) -> None:
    with Feeder(tmp_path, 4000.0, 3) as feeder:
        board = Board(feeder.port, BAUD)
        board.wait_for_hello()
        plan = Plan(tmp_path / "study", (None,), CONDITION, seconds=2.0)
        (made,) = Session(plan, board).run()
        board.close()
    assert made.problems == () and made.quality.lost_frames == made.quality.damaged == 0
    _, timeline, _ = replay([tmp_path / "study" / "captures" / "broadband_0kg.fascap"])
    index, values = timeline.samples()
    first = number_of(values[0])
    np.testing.assert_array_equal(values * COUNTS, counts_of(first + index, 3))
    assert index.size >= 8000


def test_one_percent_damaged_bytes_are_all_found(tmp_path: Path) -> None:
    """Frames that did not come are those that were damaged, and every sample that came is right."""
    with Feeder(tmp_path, 4000.0, 3, damage=0.01) as feeder:
        board = Board(feeder.port, BAUD)
        board.wait_for_hello(5.0)
        capture = Capture(tmp_path / "study" / "captures" / "noisy.fascap")
        capture.add("M", 0.0, {"preamble": board.decoder.preamble.hex(), "condition": CONDITION.__dict__})
        board.start(capture)
        sent = feeder.sent
        while feeder.sent - sent < 6000:
            board.pump()
        board.stop()
        board.close()
        capture.close()
    _, timeline, _ = replay([capture.file])
    quality = timeline.quality()
    index, values = timeline.samples()
    first = number_of(values[0])
    np.testing.assert_array_equal(values * COUNTS, counts_of(first + index, 3))
    came = {int(number) // 16 for number in first + index}
    between = set(range(min(came), max(came)))
    assert between - came == between & feeder.damaged and quality.lost_frames == len(between - came)
    assert 0.5 < quality.lost_frames / len(between) < 0.85  # 1 - 0.99^112 of the frames are hit
    assert quality.problems(Plan(tmp_path, (), CONDITION).limits)


def test_unplugged_and_back(tmp_path: Path, feeder: Feeder) -> None:
    board = Board(feeder.port, BAUD)
    board.wait_for_hello()
    capture = Capture(tmp_path / "study" / "captures" / "pulled.fascap")
    capture.add("M", 0.0, {"preamble": board.decoder.preamble.hex(), "condition": CONDITION.__dict__})
    timeline = board.start(capture)
    while timeline.length < 500:
        board.pump()
    feeder.line.unplug()
    time.sleep(0.4)
    feeder.line.plug()
    while timeline.length < 1500:
        board.pump()
    board.stop()
    board.close()
    capture.close()
    assert board.unplugs == 1
    made = convert([capture.file], tmp_path / "study")
    (gap,) = made.quality.gaps
    assert gap.lost_samples >= 300 and gap.cause == "lost frames"  # the board itself went on
    details = json.loads(made.file.with_suffix(".json").read_text())
    assert [event["event"] for event in details["events"]] == ["unplugged", "replugged"]
    index, values = replay([capture.file])[1].samples()
    first = number_of(values[0])
    np.testing.assert_array_equal(values * COUNTS, counts_of(first + index, 2))


def test_recording_that_lost_samples_is_repeated(tmp_path: Path, feeder: Feeder) -> None:
    board = Board(feeder.port, BAUD)
    pulled: list[int] = []

    def pull(b: Board) -> None:
        if b.timeline is not None and b.timeline.length > 200 and not pulled:
            pulled.append(b.timeline.length)
            feeder.line.unplug()
            feeder.line.plug()

    board.listener = pull
    run = Session(Plan(tmp_path / "study", (None,), CONDITION, seconds=0.6), board)
    made = run.run()
    board.close()
    assert [bool(one.problems) for one in made] == [True, False] and run.unusable() == []
    run.made = made[:1]
    assert run.unusable() == ["broadband_0kg.csv"]
    (listed,) = Study.read(tmp_path / "study").recordings
    assert listed.file.endswith("recordings/broadband_0kg_2.csv") and listed.time_s.size == 600


def test_not_plugged_in_again_silence_garbage_and_a_missing_channel(tmp_path: Path, feeder: Feeder) -> None:
    with pytest.raises(AcquisitionError, match="there is no such port"):
        Board(str(tmp_path / "nothing"), BAUD)
    feeder.garbage = True
    board = Board(feeder.port, 9600)
    with pytest.raises(AcquisitionError, match=r"bytes came, but no hello; is 9600 the board's baud rate"):
        board.wait_for_hello(0.5)
    board.close()
    feeder.paused = True
    board = Board(feeder.port, BAUD)
    with pytest.raises(AcquisitionError, match="nothing came"):
        board.wait_for_hello(0.5)
    board.close()
    feeder.paused = feeder.garbage = False
    feeder.hello = replace(feeder.hello, channels=feeder.hello.channels[:1])
    board = Board(feeder.port, BAUD, patience=0.3)
    with pytest.raises(AcquisitionError, match="needs one channel 'malleolus'"):
        board.wait_for_hello()
    feeder.line.unplug()
    with pytest.raises(AcquisitionError, match="unplugged, and not back"):
        while True:
            board.pump()
    board.close()
    feeder.line.plug()


@pytest.mark.parametrize("place", ["", "captures", "recordings"])
def test_folder_that_cannot_be_written_is_refused_before_anything_moves(
    tmp_path: Path, feeder: Feeder, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    moved: list[object] = []
    monkeypatch.setattr(session, "reach", lambda *args: moved.append(args))
    study = tmp_path / "study"
    if place:
        study.mkdir()
    (study / place).write_text("a file where the folder should be")
    board = Board(feeder.port, BAUD)
    with pytest.raises(InputFileError, match="cannot be written"):
        Session(Plan(study, (20.0,), CONDITION), board, Generator.__new__(Generator)).run()
    board.close()
    assert not moved


def test_failing_ramp_still_gives_the_recording(
    tmp_path: Path, feeder: Feeder, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator = Generator.__new__(Generator)
    generator.identity, generator.is_on, told = "fake", True, []

    def ramp_down() -> None:
        raise AcquisitionError("no answer to VOLT")

    monkeypatch.setattr(generator, "ramp_down", ramp_down)
    monkeypatch.setattr(generator, "off", lambda: told.append("off"))
    monkeypatch.setattr(session, "reach", lambda *args: Level(17.9, 1.0, 3))
    board = Board(feeder.port, BAUD)
    with pytest.raises(AcquisitionError, match="no answer to VOLT"):
        Session(Plan(tmp_path / "study", (20.0,), CONDITION, seconds=0.4), board, generator).run()
    board.close()
    assert told == ["off"] and (tmp_path / "study" / "recordings" / "20hz_0kg.csv").is_file()


def test_over_range_ends_early(tmp_path: Path, feeder: Feeder) -> None:
    board = Board(feeder.port, BAUD)
    board.listener = lambda b: setattr(feeder, "amplitude", 32_000 if b.timeline and b.timeline.length > 300 else 0)
    with pytest.raises(AcquisitionError, match="went over range"):
        Session(Plan(tmp_path / "study", (None,), CONDITION, seconds=60.0), board).run()
    board.close()
    details = json.loads((tmp_path / "study" / "recordings" / "broadband_0kg.json").read_text())
    assert details["usable"] is False and details["quality"]["over_range"]["base"] >= 3


def test_text_board_of_the_bench(tmp_path: Path) -> None:
    with Bench(rate_hz=500.0, bits=0, channels=3) as text:
        text.shake(20.0, 0.6)
        board = Board(text.board_port, 115200)
        (made,) = Session(Plan(tmp_path, (None,), CONDITION, seconds=0.8), board).run()
        board.close()
    assert made.problems == () and made.recording.time_s.size == 400
    assert made.recording.tuberosity_m_s2 is not None and made.recording.tuberosity_m_s2.std() > 1


def test_display_shows_the_levels(feeder: Feeder) -> None:
    from fasbody.console import console

    board = Board(feeder.port, BAUD)
    board.wait_for_hello()
    board.collect(1.5)
    with console.capture() as captured:
        console.print(render(board))
    board.close()
    assert "base" in captured.get() and "m/s²" in captured.get()
    assert bar(0.5).count("█") == 12
    t = np.arange(2000) / 1000
    line = sparkline(np.sin(2 * np.pi * 31 * t), 1000)
    assert np.argmax(["  ▁▂▃▄▅▆▇█".index(c) for c in line]) == 15  # 31 Hz of 120 in 60 places


def test_collect_keeps_nothing_that_was_taken_before(feeder: Feeder) -> None:
    """Samples that wait in the queue of a busy computer show the base before the latest change of amplitude."""
    board = Board(feeder.port, BAUD)
    board.wait_for_hello()
    board.collect(0.2)
    real, held = board.reader.take, []

    def late(wait: float) -> list[Arrival]:
        """Everything comes half a second late."""
        held.extend(real(wait))
        now = time.monotonic()
        ready = [arrival for arrival in held if arrival.host < now - 0.5]
        del held[: len(ready)]
        return [replace(arrival, host=arrival.host + 0.5) for arrival in ready]

    board.reader.take = late  # type: ignore[method-assign]
    board.collect(0.1)
    before = feeder.sent
    first = number_of(board.collect(0.1)[0])
    board.close()
    assert first >= before - 100  # a tenth of a second: a frame, the way, and this test's own clocks
