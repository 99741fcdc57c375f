"""The firmware as it is flashed, compiled and run on simavr cycle by cycle, recorded through a pseudo-terminal."""

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fasbody.acquire import firmware
from fasbody.acquire.bench.foot import BODY_MASS_KG
from fasbody.acquire.bench.line import corrupt
from fasbody.acquire.board import Board
from fasbody.acquire.commands import app
from fasbody.acquire.plan import Plan
from fasbody.acquire.port import HELLO_S
from fasbody.acquire.session import Session
from fasbody.acquire.wire import Block, FrameReader
from fasbody.exceptions import AcquisitionError, InputFileError
from fasbody.recording.recording import Condition
from fasbody.recording.study import Study
from simulator import simavr
from simulator.simavr import BAUD, SIGNAL_HZ, SimulatedBoard

Rig = Callable[..., SimulatedBoard]
pytestmark = pytest.mark.usefixtures("patient")


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program around the firmware."""
    if lacks := simavr.missing():
        pytest.skip(f"the firmware is not run: {lacks}")
    return simavr.compile_host(tmp_path_factory.mktemp("simavr"))


@pytest.fixture(scope="module")
def rig(host: Path) -> Rig:
    """Simulated boards; each program is compiled once."""
    folder = host.parent

    def make(sensor: str = "ANALOG", rate: int = 1000, **options: object) -> SimulatedBoard:
        elf = folder / f"fas_{sensor}_{rate}.elf"
        if not elf.is_file():
            elf = simavr.compile_firmware(folder, sensor, rate)
        return SimulatedBoard(host, elf, folder, **options)  # type: ignore[arg-type]

    return make


@pytest.mark.parametrize("rate", [1000, 2000])
def test_every_conversion_arrives_in_its_sample(rig: Rig, rate: int) -> None:
    """The converter gives numbers that say which conversion they are; so each sample is known beforehand."""
    with rig(rate=rate, seconds=4.0, real=False) as board:
        reader = FrameReader()
        blocks = [m for data in board.bytes() for m in reader.feed(data) if isinstance(m, Block)]
    assert reader.hello is not None and reader.hello.rate_hz == rate
    assert [block.sequence for block in blocks] == list(range(len(blocks)))
    counts = np.concatenate([block.samples for block in blocks]) * reader.hello.channels[0].counts_per_m_s2
    assert len(counts) > 3.1 * rate
    np.testing.assert_allclose(counts, simavr.readings(len(counts), rate), atol=1e-6)
    stamps = np.diff([block.time_us for block in blocks])
    assert (stamps == 16_000_000 / rate).all()
    # simavr raises a compare match between two instructions; the hardware is exact
    assert 1992 <= board.report["shortest_cycles"] <= board.report["longest_cycles"] <= 2008


def test_damaged_bytes_are_all_found(rig: Rig) -> None:
    rng = np.random.default_rng(3)
    clean, dirty, hit = FrameReader(), FrameReader(), set()
    came: dict[int, np.ndarray] = {}
    with rig(rate=2000, seconds=6.0, real=False) as board:
        rest = b""
        for data in board.bytes():
            *frames, rest = (rest + data).split(b"\0")
            for frame in filter(None, frames):
                (message,) = clean.feed(b"\0" + frame + b"\0") or [None]
                spoilt = corrupt(b"\0" + frame + b"\0", 0.01, rng)
                if isinstance(message, Block) and spoilt != b"\0" + frame + b"\0":
                    hit.add(message.sequence)
                found = dirty.feed(spoilt)
                came |= {block.sequence: block.samples for block in found if isinstance(block, Block)}
    assert dirty.hello is not None and len(came) > 100
    first, last = min(came), max(came)
    assert set(range(first, last)) - set(came) == {number for number in hit if first < number < last}
    want = simavr.readings(16 * (last + 1), 2000)
    for number, samples in came.items():
        counts = samples * dirty.hello.channels[0].counts_per_m_s2
        np.testing.assert_allclose(counts, want[16 * number : 16 * (number + 1)], atol=1e-6)


@pytest.mark.parametrize("sensor", ["ANALOG", "ADXL355"])
def test_recorded_by_the_command(rig: Rig, tmp_path: Path, sensor: str) -> None:
    """The virtual foot's transmissibility, as its sensors felt it: within 1 % and 1 degree from the converter."""
    hz = 25.0
    signal, transfer = simavr.foot(hz)
    study = tmp_path / "study"
    with rig(sensor, signal=signal) as board:
        words = ["--port", board.port, "--baud", str(BAUD), "--frequency", f"{hz:g}", "--seconds", "2"]
        words += ["--body-mass", f"{BODY_MASS_KG}", "--out", str(study), "--json"]
        app(["record", *words], standalone_mode=False)
    (one,) = Study.read(study).recordings
    details = json.loads((tmp_path / one.file).with_suffix(".json").read_text())
    assert details["usable"] and details["quality"]["gaps"] == [] and details["quality"]["damaged"] == 0
    base, malleolus = simavr.lines(np.column_stack([one.base_m_s2, one.malleolus_m_s2]), one.rate_hz, hz)
    found = malleolus / base / transfer
    assert abs(abs(found) - 1) < 0.01 and abs(np.degrees(np.angle(found))) < 1.0
    assert abs(2 * abs(base) / 8.95 - 1) < 0.01


#: Lines of the sketch without which a sensor stays silent, shows too little, or goes out of step.
MUTANTS = {
    "345 never measures": ("ADXL345", "write_to(channel, 0x2D, 0x08);", ""),
    "345 at +-8 g": ("ADXL345", "write_to(channel, 0x31, 0x0B);", "write_to(channel, 0x31, 0x0A);"),
    "355 stays in standby": ("ADXL355", "write_to(channel, 0x2D, 0x00);", ""),
    "355 at +-4 g": ("ADXL355", "write_to(channel, 0x2C, 0x83);", "write_to(channel, 0x2C, 0x82);"),
    "355 keeps its own time": ("ADXL355", "write_to(channel, 0x2B, 0x02);", ""),
}


@pytest.mark.parametrize("mutant", ["", *MUTANTS])
def test_sensors_are_set_as_their_data_sheets_ask(host: Path, tmp_path: Path, mutant: str) -> None:
    """Levels beyond half the range, a sine and its phase come out; with a line of the sketch missing, they do not."""
    t, hz, transfer = np.arange(round(SIGNAL_HZ)) / SIGNAL_HZ, 50.0, 1.2 * np.exp(-0.4j)
    for sensor, level in {"ADXL345": (120.0, -110.0), "ADXL355": (55.0, -50.0)}.items():
        if mutant and MUTANTS[mutant][0] != sensor:
            continue
        wave = 8.0 * np.exp(2j * np.pi * hz * t)
        signal = np.column_stack([level[0] + wave.imag, level[1] + (transfer * wave).imag])
        changed = dict([MUTANTS[mutant][1:]]) if mutant else {}
        elf = simavr.compile_firmware(tmp_path, sensor, changed=changed)
        hello, values, report = simavr.sent(host, elf, tmp_path, signal, 1.4)
        values = values[-400:]
        base, malleolus = simavr.lines(values, 1000, hz)
        found = malleolus / base / transfer if base else 0.0
        sound = (
            "FAILED" not in hello.board and report["conflicts"] == 0
            and np.allclose(values.mean(axis=0), level, atol=0.1) and abs(2 * abs(base) / 8.0 - 1) < 0.01
            and abs(abs(found) - 1) < 0.01 and abs(np.angle(found, deg=True)) < (3.0 if sensor == "ADXL345" else 0.1)
        )  # fmt: skip
        assert sound == (not mutant)
        if not mutant:
            assert report["first_byte_s"] + 2.0 < HELLO_S  # after the boot loader


@pytest.mark.parametrize("sensor", ["ANALOG", "ADXL345"])
def test_each_sensor_has_its_own_sensitivity(host: Path, tmp_path: Path, sensor: str) -> None:
    """The hello says both; a base of 10 % more, and a malleolus upside down, make of the same signal other numbers."""
    nominal = {"ANALOG": 0.33, "ADXL345": 256.0}[sensor]
    constants = {"BASE_PER_G": 1.1 * nominal, "MALLEOLUS_PER_G": -nominal}
    elf = simavr.compile_firmware(tmp_path, sensor, constants=constants)
    hello, values, _ = simavr.sent(host, elf, tmp_path, np.full((8, 2), 9.81), 1.2)
    base, malleolus = hello.channels
    assert base.counts_per_m_s2 == pytest.approx(-1.1 * malleolus.counts_per_m_s2) and base.counts_per_m_s2 > 0
    assert base.range_m_s2 == pytest.approx(malleolus.range_m_s2 / (1.1 if sensor == "ADXL345" else 1.0))
    np.testing.assert_allclose(values[-100:].mean(axis=0), [9.81 / 1.1, -9.81], atol=0.2)  # two steps of the converter


def test_frame_says_which_sensor_is_over_range(rig: Rig) -> None:
    """The malleolus of an analog pair at its rail, in flags of the frame."""
    signal = np.column_stack([np.full(8, 9.81), np.full(8, 60.0)])
    reader = FrameReader()
    with rig(signal=signal, seconds=1.5, real=False) as board:
        blocks = [m for data in board.bytes() for m in reader.feed(data) if isinstance(m, Block)]
    assert blocks and all(block.over[0] == 0 and block.over[1] > 0 for block in blocks)


@pytest.mark.parametrize("fault", ["unplugged", "stalled"])
def test_board_that_goes_away_or_falls_silent(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], fault: str
) -> None:
    """The simulator ends, or stands still for a moment, in the middle of a recording."""
    t = np.arange(round(SIGNAL_HZ)) / SIGNAL_HZ
    wave = 9.81 + 8.0 * np.column_stack([np.sin(40 * np.pi * t), np.sin(40 * np.pi * t - 0.3)])
    with rig(signal=wave) as simulated:
        board = Board(simulated.port, BAUD, patience=0.5 if fault == "unplugged" else 20.0)
        struck: list[bool] = []

        def strike(b: Board) -> None:
            if b.timeline is not None and b.timeline.length > 500 and not struck:
                struck.append(True)
                simulated.end() if fault == "unplugged" else simulated.pause()
                monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 20.0 if fault == "unplugged" else 0.5)
            elif struck and b.timeline is None and fault == "stalled":
                simulated.pause(False)
                monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 20.0)

        board.listener = strike
        # longer than a port holds samples for a busy computer, which may see 0.9 s of them at once
        run = Session(Plan(tmp_path, (20.0,), Condition("16", body_mass_kg=BODY_MASS_KG), seconds=2.0), board)
        if fault == "unplugged":
            with pytest.raises(AcquisitionError, match="unplugged, and not back after"):
                run.run()
        else:
            run.run()
            assert not run.made[-1].problems and run.made[-1].recording.time_s.size == 2000
        board.close()
    first = run.made[0]
    assert first.problems and any(text.startswith("usable: ") for text in first.remarks)
    told = " ".join(capsys.readouterr().err.split())
    assert "--longest" in told and ("the board is silent for" in told) == (fault == "stalled")


def test_commands_and_a_cut_cable(rig: Rig) -> None:
    """Stop and start are obeyed, each start is another boot; noise on the line is no command."""
    still = np.full((8, 2), 9.81)
    with rig("ADXL345", signal=still) as simulated:
        board = Board(simulated.port, BAUD)
        boot = board.wait_for_hello().boot
        np.testing.assert_allclose(board.collect(0.2), 9.81, atol=0.02)
        board.reader.send(b"stop\nstart over\n*IDN?\n")
        ended = _silent(board)
        board.reader.send(b"?\n")
        deadline = time.monotonic() + 60.0
        while not any(m == board.decoder.hello for m in board.pump()):
            assert time.monotonic() < deadline
        assert ended and board.decoder.hello is not None and board.decoder.hello.boot == boot
        board.reader.send(b"start\n")
        board.collect(0.2)
        assert board.decoder.hello.boot == boot + 1
        board.close()
    for sensor in ("ANALOG", "ADXL355"):
        with rig(sensor, signal=still, fault="dead1") as simulated:
            board = Board(simulated.port, BAUD)
            with pytest.raises(AcquisitionError, match=r"FAILED: malleolus: its own test fails"):
                board.wait_for_hello()
            board.close()


def _silent(board: Board) -> bool:
    """Whether the samples end within a minute, and stay away for half a second."""
    last = start = time.monotonic()
    while time.monotonic() - start < 60.0:
        if any(isinstance(message, Block) for message in board.pump()):
            last = time.monotonic()
        if time.monotonic() - last > 0.5:
            return True
    return False


def test_the_sketch_is_written_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    app(["record", "--firmware", str(tmp_path), "--json"], standalone_mode=False)
    file = Path(json.loads(capsys.readouterr().out)["sketch"])
    assert file == tmp_path / "fas_board" / "fas_board.ino" and file.read_text() == firmware.SKETCH.read_text()
    assert firmware.write(tmp_path) == file
    file.write_text(file.read_text() + "// mine\n")
    with pytest.raises(InputFileError, match="is there already, with changes"):
        firmware.write(tmp_path)
