"""A board that says nothing, or nothing that counts, while the shaker runs: through pseudo-terminals and pyserial."""

import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from feeder import BAUD, CONDITION, Feeder, hello

from fasbody.acquire.bench import Bench
from fasbody.acquire.board import Board, Stalled, Watch
from fasbody.acquire.conversion import convert
from fasbody.acquire.plan import Plan
from fasbody.acquire.session import Session
from fasbody.acquire.timeline import Quality
from fasbody.acquire.wire import encode_data, encode_hello
from fasbody.exceptions import AcquisitionError, InputFileError
from fasbody.recording.study import Study


def test_shaking_blindly_is_an_error(feeder: Feeder) -> None:
    board = Board(feeder.port, BAUD)
    board.wait_for_hello()
    board.watch = Watch(peak=100.0, offset=0.0)
    board.collect(0.2)
    feeder.paused = True
    with pytest.raises(AcquisitionError, match="no samples for 1 s while the shaker was on"):
        while True:
            board.pump()
    board.watch, feeder.paused = None, False
    board.collect(0.1)
    board.watch = Watch(peak=5.0, offset=0.0)
    with pytest.raises(AcquisitionError, match="beyond the safety limit of 5"):
        board.collect(0.2)
    board.close()


@pytest.mark.parametrize("instead", ["noise", "hello", "text"])
def test_bytes_without_samples_are_as_blind_as_silence(feeder: Feeder, instead: str) -> None:
    """While the shaker is on after one second, otherwise as a stall."""
    board = Board(feeder.port, BAUD)
    board.wait_for_hello()
    board.collect(0.2)
    board.watch = Watch(peak=100.0, offset=0.0)
    noise = np.random.default_rng(1).bytes(80)
    feeder.instead = {"noise": noise, "hello": encode_hello(feeder.hello), "text": b"sensor error -5\n"}[instead]
    with pytest.raises(AcquisitionError, match="no samples for 1 s while the shaker was on"):
        _pump_for(board, 3.0)
    board.watch = None
    with pytest.raises(AcquisitionError, match=r"sent \d+ bytes and no sample for 3 s"):
        _pump_for(board, 6.0)
    board.close()


def _pump_for(board: Board, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        board.pump()


def test_board_that_trickles_samples_ends_at_the_deadline(tmp_path: Path, feeder: Feeder) -> None:
    """Samples come, so the board is not stalled, but none of them belongs to the recording."""
    board = Board(feeder.port, BAUD, patience=0.2)
    board.wait_for_hello()
    other = replace(feeder.hello, channels=hello(channels=3).channels)  # samples that fit nothing recorded
    board.listener = lambda b: setattr(
        feeder, "instead", encode_hello(other) + encode_data(0, 0, np.zeros((16, 3), int), 16) if b.timeline else b""
    )
    with pytest.raises(AcquisitionError, match=r"of 500 samples came in time"):
        Session(Plan(tmp_path / "study", (None,), CONDITION, seconds=0.5, retries=0), board).run()
    board.close()


def test_board_that_stays_silent_keeps_what_came_and_lists_nothing(
    tmp_path: Path, feeder: Feeder, capsys: pytest.CaptureFixture[str]
) -> None:
    board = Board(feeder.port, BAUD, patience=0.5)
    plan = Plan(tmp_path / "study", (None,), CONDITION, seconds=60.0)
    board.listener = lambda b: setattr(feeder, "paused", feeder.paused or bool(b.timeline and b.timeline.length > 800))
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
    convert([tmp_path / "study" / "captures" / "broadband_0kg.fascap"], tmp_path / "study", longest=True)
    (kept,) = Study.read(tmp_path / "study").recordings
    assert kept.time_s.size == one.recording.time_s.size


def test_recording_whose_board_stalled_is_repeated(tmp_path: Path, feeder: Feeder) -> None:
    board = Board(feeder.port, BAUD, patience=20.0)
    stalled: list[int] = []

    def stall(b: Board) -> None:
        if b.timeline is not None and b.timeline.length > 200 and not stalled:
            stalled.append(1)
            feeder.paused = True
        elif b.timeline is None and stalled:
            feeder.paused = False  # it comes back once the recording is given up

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
    run.board.close()
    assert tried == [20.0] + 4 * [25.0]
    told = " ".join(capsys.readouterr().err.split())
    assert "not recorded: 25, 30 Hz; go on with --sweep 25:30:5 and the same --out" in told


def test_bench_at_rest_gives_no_recording(tmp_path: Path) -> None:
    with Bench() as bench:
        board = Board(bench.board_port, BAUD)
        (made,) = Session(Plan(tmp_path, (None,), CONDITION, seconds=1.0), board).run()
        board.close()
    assert made.problems[0].startswith("the base is at rest (0.0")
    with pytest.raises(InputFileError, match="lists no recording"):
        Study.read(tmp_path)
