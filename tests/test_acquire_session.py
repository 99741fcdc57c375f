"""Recordings through real pseudo-terminals and pyserial, with every fault that a board and its line can have."""

import json
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from feeder import BAUD, CONDITION, COUNTS, Feeder, counts_of, hello, number_of

from fasbody.acquire import folder, session
from fasbody.acquire.bench import Bench
from fasbody.acquire.bench.line import Line
from fasbody.acquire.board import Board, Stalled, Watch
from fasbody.acquire.capture import Capture
from fasbody.acquire.display import bar, render, sparkline
from fasbody.acquire.folder import convert, replay
from fasbody.acquire.generator import Generator
from fasbody.acquire.level import Level
from fasbody.acquire.plan import Plan
from fasbody.acquire.port import Arrival, Port
from fasbody.acquire.session import Session
from fasbody.acquire.timeline import Quality
from fasbody.acquire.wire import encode_data, encode_hello
from fasbody.exceptions import AcquisitionError, InputFileError
from fasbody.recording.study import Study

pytestmark = pytest.mark.usefixtures("patient")


def capture_for(board: Board, study: Path) -> Capture:
    capture = Capture(study / "captures" / "one.fascap")
    capture.add("M", 0.0, {"preamble": board.decoder.preamble.hex(), "condition": vars(CONDITION)})
    return capture


def as_sent(file: Path, channels: int) -> np.ndarray:
    """The numbers of the samples of a capture, each of which has the values that the feeder gave it."""
    index, values = replay(file)[1].samples()
    number = number_of(values[0]) + index
    np.testing.assert_array_equal(values * COUNTS, counts_of(number, channels))
    return number


def test_three_channels_at_4_khz_arrive_whole_and_as_sent(tmp_path: Path) -> None:
    with Feeder(tmp_path, 4000.0, 3) as feeder:
        board = Board(feeder.port, BAUD)
        board.wait_for_hello()
        plan = Plan(tmp_path / "study", (None,), CONDITION, seconds=1.0)
        (made,) = Session(plan, board).run()
        board.close()
    assert made.problems == () and made.quality.lost_frames == made.quality.damaged == 0
    assert as_sent(tmp_path / "study" / "captures" / "broadband_0kg.fascap", 3).size >= 4000


def test_one_percent_damaged_bytes_are_all_found(tmp_path: Path) -> None:
    """Frames that did not come are those that were damaged, and every sample that came is right."""
    with Feeder(tmp_path, 4000.0, 3, damage=0.01) as feeder:
        board = Board(feeder.port, BAUD)
        board.wait_for_hello()
        capture = capture_for(board, tmp_path / "study")
        board.start(capture)
        sent = feeder.sent
        while feeder.sent - sent < 6000:
            board.pump()
        board.stop()
        board.close()
        capture.close()
    quality = replay(capture.file)[1].quality()
    came = {int(number) // 16 for number in as_sent(capture.file, 3)}
    between = set(range(min(came), max(came)))
    assert between - came == between & feeder.damaged and quality.lost_frames == len(between - came)
    assert 0.5 < quality.lost_frames / len(between) < 0.85  # 1 - 0.99^112 of the frames are hit
    assert quality.problems()


def test_unplugged_and_back(tmp_path: Path, feeder: Feeder, board: Board) -> None:
    capture = capture_for(board, tmp_path / "study")
    timeline = board.start(capture)
    while timeline.length < 500:
        board.pump()
    feeder.line.unplug()
    time.sleep(0.4)
    feeder.line.plug()
    while timeline.length < 1500:
        board.pump()
    board.stop()
    capture.close()
    assert board.unplugs == 1
    made = convert(capture.file, tmp_path / "study")
    (gap,) = made.quality.gaps
    assert gap.lost_samples >= 300 and gap.cause == "lost frames, unplugged"  # the board itself went on
    details = json.loads(made.file.with_suffix(".json").read_text())
    assert [event["event"] for event in details["events"]] == ["unplugged", "replugged"]
    as_sent(capture.file, 2)


def test_recording_that_lost_samples_is_repeated(tmp_path: Path, feeder: Feeder, board: Board) -> None:
    pulled: list[int] = []

    def pull(b: Board) -> None:
        if b.timeline is not None and b.timeline.length > 200 and not pulled:
            pulled.append(b.timeline.length)
            feeder.line.unplug()
            feeder.line.plug()

    board.listener = pull
    run = Session(Plan(tmp_path / "study", (None,), CONDITION, seconds=0.6), board)
    made = run.run()
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
        board.wait_for_hello(3.0)
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
    tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    moved: list[object] = []
    monkeypatch.setattr(session, "reach", lambda *args: moved.append(args))
    study = tmp_path / "study"
    if place:
        study.mkdir()
    (study / place).write_text("a file where the folder should be")
    with pytest.raises(InputFileError, match="cannot be written"):
        Session(Plan(study, (20.0,), CONDITION), board, Generator.__new__(Generator)).run()
    assert not moved


def test_failing_ramp_still_gives_the_recording(tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    generator = Generator.__new__(Generator)
    generator.identity, generator.is_on, told = "fake", True, []

    def ramp_down() -> None:
        raise AcquisitionError("no answer to VOLT")

    monkeypatch.setattr(generator, "ramp_down", ramp_down)
    monkeypatch.setattr(generator, "off", lambda: told.append("off"))
    monkeypatch.setattr(session, "reach", lambda *args: Level(17.9, 1.0, 3))
    monkeypatch.setattr(session.Monitor, "add", lambda *args: [])  # the feeder shakes nothing
    with pytest.raises(AcquisitionError, match="no answer to VOLT"):
        Session(Plan(tmp_path / "study", (20.0,), CONDITION, seconds=0.4), board, generator).run()
    assert told == ["off"] and (tmp_path / "study" / "recordings" / "20hz_0kg.csv").is_file()


def test_over_range_ends_early(tmp_path: Path, feeder: Feeder, board: Board) -> None:
    board.listener = lambda b: setattr(feeder, "amplitude", 32_000 if b.timeline and b.timeline.length > 300 else 0)
    with pytest.raises(AcquisitionError, match="went over range"):
        Session(Plan(tmp_path / "study", (None,), CONDITION, seconds=60.0), board).run()
    details = json.loads((tmp_path / "study" / "recordings" / "broadband_0kg.json").read_text())
    assert details["usable"] is False and details["quality"]["over_range"]["base"] >= 3


def test_text_board_of_the_bench_at_rest_and_shaken_and_its_end(tmp_path: Path) -> None:
    """At rest it gives no recording; when whoever started it was killed, it clears up."""
    with Bench(rate=500.0, bits=0, channels=3) as text:
        board = Board(text.board_port, 115200)
        (rest,) = Session(Plan(tmp_path, (None,), CONDITION, seconds=0.8), board).run()
        assert rest.problems[0].startswith("the base is at rest (0.0")
        with pytest.raises(InputFileError, match="lists no recording"):
            Study.read(tmp_path)
        text.shake(20.0, 0.6)
        (made,) = Session(Plan(tmp_path, (None,), CONDITION, seconds=0.8), board).run()
        board.close()
        for process in text._processes:
            assert process.stdin is not None
            process.stdin.close()  # what the end of the starter does
            process.wait(300)
        assert not Path(text.board_port).parent.exists()
    assert made.problems == () and made.recording.time_s.size == 400
    assert made.recording.tuberosity_m_s2 is not None and made.recording.tuberosity_m_s2.std() > 1


def test_display_shows_the_levels(board: Board) -> None:
    from fasbody.console import console

    board.collect(1.5)
    with console.capture() as captured:
        console.print(render(board))
    assert "base" in captured.get() and "m/s²" in captured.get()
    assert bar(0.5).count("█") == 12
    t = np.arange(2000) / 1000
    line = sparkline(np.sin(2 * np.pi * 31 * t), 1000)
    assert np.argmax(["  ▁▂▃▄▅▆▇█".index(c) for c in line]) == 15  # 31 Hz of 120 in 60 places


def test_collect_keeps_nothing_that_was_taken_before(feeder: Feeder, board: Board) -> None:
    """Samples that wait in the queue of a busy computer show the base before the latest change of amplitude."""
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
    assert first >= before - 100  # a tenth of a second: a frame, the way, and this test's own clocks


def test_shaking_blindly_is_an_error(feeder: Feeder, board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    board.watch = Watch(peak=100.0, offset=0.0)
    board.collect(0.2)
    feeder.paused = True
    monkeypatch.setattr("fasbody.acquire.board.BLIND_S", 1.0)
    with pytest.raises(AcquisitionError, match="no samples for 1 s while the shaker was on"):
        while True:
            board.pump()
    monkeypatch.setattr("fasbody.acquire.board.BLIND_S", 60.0)
    board.watch, feeder.paused = None, False
    board.collect(0.1)
    board.watch = Watch(peak=5.0, offset=0.0)
    with pytest.raises(AcquisitionError, match="beyond the safety limit of 5"):
        board.collect(0.2)


def test_a_board_that_falls_silent_in_a_frame_is_called_silent(
    feeder: Feeder, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    board.collect(0.2)
    feeder.instead = b"half a frame"
    while board._last_byte <= board._last:  # until the half has come
        board.pump()
    feeder.paused = True
    monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 2.5)
    with pytest.raises(AcquisitionError, match=r"the board is silent for 2\.5 s"):
        _pump_on(board)


class Shaker:
    """A generator that is on from the level to its end, and a sine that a fault spoils in the first recording."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, fault: int, times: int = 1) -> None:
        self.identity, self.is_on, self.volts, self.latency_s, self.levels = "fake", False, 1.0, 0.0, 0
        self._fault, self._times, self._board = fault, times, None
        monkeypatch.setattr("feeder.counts_of", self.counts)
        monkeypatch.setattr(session, "reach", self.reach)

    def reach(self, generator: object, board: Board, *others: object) -> Level:
        self.is_on, self._board, self.levels = True, board, self.levels + 1
        board.watch = Watch(15.0, 0.0)
        return Level(17.9, 1.0, 3)

    def counts(self, index: np.ndarray, channels: int) -> np.ndarray:
        wt = 2 * np.pi * 20 * index / 1000
        both = 8.95 * COUNTS * np.column_stack([np.sin(wt), 1.2 * np.sin(wt - 0.4)])
        both += np.random.default_rng(index[0]).normal(0, 40, both.shape)
        timeline = self._board.timeline if self._board else None
        if timeline is not None and timeline.length > 500 and self.levels <= self._times:
            both[:, self._fault] = 0
        return np.round(both).astype(np.int32)[:, :channels]

    def off(self) -> None:
        self.is_on = False

    ramp_down = off


def test_a_base_that_goes_flat_switches_off_and_is_not_listed(
    tmp_path: Path, feeder: Feeder, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    shaker = Shaker(monkeypatch, fault=0)
    study = tmp_path / "study"
    with pytest.raises(AcquisitionError, match=r"^base (flat|lost|not as driven) at .*; output off\.$"):
        Session(Plan(study, (20.0,), CONDITION, seconds=60.0, wait_s=0.1), board, shaker).run()
    assert not shaker.is_on and shaker.levels == 1 and board.watch is None
    details = json.loads((study / "recordings" / "20hz_0kg.json").read_text())
    assert not details["usable"] and "ended early: base" in " ".join(details["remarks"])
    base = np.loadtxt(study / "recordings" / "20hz_0kg.csv", delimiter=",", skiprows=1)[:, 1]
    assert 0 < np.sum(base == 0) < 700  # half a second, and what a busy machine delivers at once
    with pytest.raises(InputFileError, match="lists no recording"):
        Study.read(study)
    assert len(json.loads((study / "session.json").read_text())["checklist"]["items"]) == 5


def test_a_malleolus_that_fails_is_said_and_recorded_again(
    tmp_path: Path, feeder: Feeder, board: Board, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shaker = Shaker(monkeypatch, fault=1)
    made = Session(Plan(tmp_path / "study", (20.0,), CONDITION, seconds=1.5, wait_s=0.1), board, shaker).run()
    assert [bool(one.problems) for one in made] == [True, False] and shaker.levels == 2
    assert "This recording is repeated." in " ".join(capsys.readouterr().err.split())
    shaker = Shaker(monkeypatch, fault=1, times=9)
    with pytest.raises(session.Faulty, match="malleolus"):
        Session(Plan(tmp_path / "other", (20.0,), CONDITION, seconds=60.0, retries=1), board, shaker).run()
    assert shaker.levels == 2 and not shaker.is_on


@pytest.mark.long
@pytest.mark.parametrize("instead", ["noise", "hello", "text"])
def test_bytes_without_samples_are_as_blind_as_silence(
    feeder: Feeder, board: Board, instead: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the shaker is on after one second, otherwise as a stall."""
    board.collect(0.2)
    board.watch = Watch(peak=100.0, offset=0.0)
    monkeypatch.setattr("fasbody.acquire.board.BLIND_S", 1.0)
    noise = np.random.default_rng(1).bytes(80)
    feeder.instead = {"noise": noise, "hello": encode_hello(feeder.hello), "text": b"sensor error -5\n"}[instead]
    with pytest.raises(AcquisitionError, match="no samples for 1 s while the shaker was on"):
        _pump_on(board)
    board.watch = None
    monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 4.0)
    with pytest.raises(AcquisitionError, match=r"sent \d+ bytes and no sample for 4 s"):
        _pump_on(board)


def _pump_on(board: Board) -> None:
    """Until it raises, or for so long that nothing but a fault keeps it from that."""
    end = time.monotonic() + 120.0
    while time.monotonic() < end:
        board.pump()


@pytest.mark.parametrize(("share", "calm"), [(0.6, False), (0.7, True), (1.4, True), (1.6, False)])
def test_after_a_stall_samples_count_once_they_come_evenly(
    board: Board, monkeypatch: pytest.MonkeyPatch, share: float, calm: bool
) -> None:
    """Otherwise nobody knows when they were taken, however long one waits."""
    board.reader.patience = 0.4
    monkeypatch.setattr(board, "watch_for", lambda seconds: setattr(board, "_kept", share * seconds * 1000))
    monkeypatch.setattr(board, "forget", lambda: time.sleep(0.1))
    if calm:
        board.revive()
    else:
        with pytest.raises(Stalled, match=r"samples come unevenly for 0\.4 s after a stall"):
            board.revive()


def test_board_that_trickles_samples_ends_at_the_deadline(
    tmp_path: Path, feeder: Feeder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Samples come, so the board is not stalled, but none of them belongs to the recording."""
    monkeypatch.setattr("fasbody.acquire.session.STALLED_S", 0.5)
    board = Board(feeder.port, BAUD, patience=0.2)
    board.wait_for_hello()
    other = replace(feeder.hello, channels=hello(channels=3).channels)  # samples that fit nothing recorded
    board.listener = lambda b: setattr(
        feeder, "instead", encode_hello(other) + encode_data(0, 0, np.zeros((16, 3), int), 16) if b.timeline else b""
    )
    with pytest.raises(AcquisitionError, match=r"of 500 samples came in time"):
        Session(Plan(tmp_path / "study", (None,), CONDITION, seconds=0.5, retries=0), board).run()
    board.close()


def test_what_was_held_back_in_a_stall_shows_the_base_as_it_was(feeder: Feeder, board: Board) -> None:
    """A second of a shaking base comes in a hurry once the base is at rest."""
    send, held, holding = feeder.line.send, list[bytes](), True

    def hold(data: bytes) -> None:
        held.append(data)
        if not holding:
            send(b"".join(held))
            held.clear()

    board.collect(0.1)
    feeder.amplitude = 20_000
    feeder.line.send = hold  # type: ignore[method-assign]
    time.sleep(1.2)
    feeder.amplitude, holding = 0, False
    board.revive()
    scale = 20_000 / feeder.hello.channels[0].counts_per_m_s2
    assert np.abs(board.collect(0.3)).max() < 0.5 * scale


def test_board_that_stays_silent_keeps_what_came_and_lists_nothing(
    tmp_path: Path, feeder: Feeder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = Board(feeder.port, BAUD, patience=0.5)
    plan = Plan(tmp_path / "study", (None,), CONDITION, seconds=60.0)

    def silence(b: Board) -> None:
        if b.timeline is not None and b.timeline.length > 800 and not feeder.paused:
            feeder.paused = True
            monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 0.5)

    board.listener = silence
    run = Session(plan, board)
    with pytest.raises(Stalled, match=r"no sample came for another 0\.5 s"):
        run.run()
    board.close()
    (one,) = run.made
    assert one.recording.time_s.size > 800 and any("of 60 s" in text for text in one.problems)
    assert any("silent" in text for text in one.remarks)
    told = " ".join(capsys.readouterr().err.split())
    assert "recover" in told and "--longest" in told and "anew" in told and ".." not in told.replace("...", "")
    with pytest.raises(InputFileError, match="lists no recording"):
        Study.read(tmp_path / "study")
    convert(tmp_path / "study" / "captures" / "broadband_0kg.fascap", tmp_path / "study", longest=True)
    (kept,) = Study.read(tmp_path / "study").recordings
    assert kept.time_s.size == one.recording.time_s.size


def test_recording_whose_board_stalled_is_repeated(
    tmp_path: Path, feeder: Feeder, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = Board(feeder.port, BAUD, patience=20.0)
    stalled: list[int] = []

    def stall(b: Board) -> None:
        if b.timeline is not None and b.timeline.length > 200 and not stalled:
            stalled.append(1)
            feeder.paused = True
            monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 0.5)
        elif b.timeline is None and stalled:
            feeder.paused = False  # it comes back once the recording is given up
            monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 60.0)

    board.listener = stall
    run = Session(Plan(tmp_path / "study", (None,), CONDITION, seconds=0.6), board)
    made = run.run()
    board.close()
    assert [bool(one.problems) for one in made] == [True, False] and run.unusable() == []
    (listed,) = Study.read(tmp_path / "study").recordings
    assert listed.file.endswith("broadband_0kg_2.csv") and listed.time_s.size == 600


def test_stalls_are_repeated_so_often_and_the_sweep_says_how_to_go_on(
    tmp_path: Path, feeder: Feeder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Session(Plan(tmp_path / "study", (20.0, 25.0, 30.0), CONDITION, retries=3), Board(feeder.port, BAUD))
    tried: list[float | None] = []

    def attempt(frequency: float | None) -> object:
        tried.append(frequency)
        if frequency == 25.0:
            raise Stalled("the board is silent.")
        return SimpleNamespace(quality=Quality())

    monkeypatch.setattr(run, "_attempt", attempt)
    with pytest.raises(Stalled):
        run.run()
    assert tried == [20.0] + 4 * [25.0]
    told = " ".join(capsys.readouterr().err.split())
    assert "not recorded: 25, 30 Hz; go on with --sweep 25:30:5 and the same --out" in told
    run.plan = replace(run.plan, frequencies_hz=(25.0,), again="--plan steps.json --first 3")
    with pytest.raises(Stalled):
        run.run()
    run.board.close()
    told = " ".join(capsys.readouterr().err.split())
    assert told.endswith("go on with --plan steps.json --first 3 and the same --out") and "--frequency" not in told


def test_capture_that_becomes_no_recording_says_how_to_try_again(
    tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """At the end of a recording that went well, and at the next start."""

    def full(*args: object) -> None:
        raise InputFileError("20hz.csv", "cannot be written")

    study = tmp_path / "study"
    monkeypatch.setattr("fasbody.acquire.session.convert", full)
    with pytest.raises(InputFileError):
        Session(Plan(study, (None,), CONDITION, seconds=0.3), board).run()
    capture = study / "captures" / "broadband_0kg.fascap"
    command = f"fasbody recover {capture}"
    assert f"to try again: {command}" in " ".join(capsys.readouterr().err.split())
    assert folder.left_behind(study) == [capture]
    convert(capture, study)
    assert folder.left_behind(study) == []


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


def test_what_broke_off_says_how_much_is_usable_and_an_unplug_is_called_so(
    tmp_path: Path, feeder: Feeder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cut at 0.8 s, and unplugged while the shaker was on."""
    board = Board(feeder.port, BAUD, patience=0.3)

    def cut(b: Board) -> None:
        if b.timeline is not None and b.timeline.length > 800 and feeder.line.master >= 0:
            feeder.line.unplug()
            monkeypatch.setattr("fasbody.acquire.board.BLIND_S", 0.2)
            b.watch = Watch(peak=100.0, offset=0.0)

    board.listener = cut
    run = Session(Plan(tmp_path / "study", (None,), CONDITION, seconds=60.0, retries=0), board)
    with pytest.raises(AcquisitionError, match=r"unplugged(, and not back| while the shaker was on)"):
        run.run()
    board.close()
    feeder.line.plug()
    (one,) = run.made
    (usable,) = [text for text in one.remarks if text.startswith("usable: ")]
    assert float(usable.split()[1]) == pytest.approx(one.recording.time_s[-1], rel=0.01) and "--longest" in usable
