"""Acquisition through real pseudo-terminals and pyserial: every fault on the way, and the whole chain to a fit."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from feeder import COUNTS, Feeder, counts_of, hello

from fasbody.acquire import folder, session
from fasbody.acquire.bench import Bench
from fasbody.acquire.board import Board
from fasbody.acquire.capture import Capture
from fasbody.acquire.display import bar, render, sparkline
from fasbody.acquire.folder import convert
from fasbody.acquire.frames import FrameReader, encode_data, encode_hello
from fasbody.acquire.generator import Generator
from fasbody.acquire.level import Safety, peak_to_peak, reach
from fasbody.acquire.probe import probe
from fasbody.acquire.session import Plan
from fasbody.acquire.shaken import BODY_MASS_KG, GAIN, TRUTH, Shaker
from fasbody.checks import checked
from fasbody.exceptions import AcquisitionError, FasError, InputFileError, RecordingError, SettingError
from fasbody.recording import Condition, Recording, Study

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
BAUD = 921600
CONDITION = Condition("16", "midstance", 0.0, BODY_MASS_KG)


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "fasbody.acquire", *words]


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with Bench(seed=4) as made:
        yield made


@pytest.fixture
def feeder(tmp_path: Path) -> Iterator[Feeder]:
    with Feeder(tmp_path) as made:
        yield made


def capture_of(study: Path, stem: str, wire: bytes, seconds: float | None = None, rate: float = 1000.0) -> Path:
    """A capture file of a stream of frames, arriving evenly."""
    duration = 16 / rate * wire.count(b"\0") / 2
    reader = FrameReader()
    reader.feed(encode_hello(hello(rate)))
    capture = Capture(study / "captures" / f"{stem}.fascap")
    about = {"seconds": seconds, "preamble": reader.preamble.hex(), "condition": vars(CONDITION), "origin": "measured"}
    capture.add("M", 0.0, about)
    for start in range(0, len(wire), 500):
        capture.add("B", duration * start / len(wire), wire[start : start + 500])
    capture.close()
    return capture.file


def sine_frames(count: int, missing: tuple[int, ...] = (), rate: float = 1000.0) -> bytes:
    """Frames of a 20 Hz sine on both channels, the malleolus a little late."""
    t = np.arange(count * 16) / rate
    noise = np.random.default_rng(0).normal(0, 20, (t.size, 2))
    wave = 8000 * np.column_stack([np.sin(40 * np.pi * t), 1.2 * np.sin(40 * np.pi * t - 0.4)]) + noise
    parts = np.round(wave).astype(int).reshape(count, 16, 2)
    stamps = np.round(np.arange(count) * 16 / rate * 1e6)
    frames = [encode_data(i, int(stamps[i]), parts[i], 16) for i in range(count) if i not in missing]
    return b"".join(frames)


def test_gap_is_marked_never_filled_and_refused_by_identification(tmp_path: Path) -> None:
    study = tmp_path / "study"
    made = convert([capture_of(study, "gap", sine_frames(120, missing=(40, 41, 90)))], study)
    assert made.quality.lost_samples == 48 and len(made.quality.gaps) == 2 and made.problems
    table = np.loadtxt(made.file, delimiter=",", skiprows=1)
    assert len(table) == 117 * 16
    steps = np.round(np.diff(table[:, 0]) * 1000).astype(int)
    assert sorted(steps[steps != 1]) == [17, 33] and np.flatnonzero(steps == 33)[0] == 40 * 16 - 1
    details = json.loads(made.file.with_suffix(".json").read_text())
    assert [gap["lost_samples"] for gap in details["quality"]["gaps"]] == [32, 16]
    assert details["usable"] is False and details["board"]["board"] == "feeder"
    with pytest.raises(RecordingError, match=r"2 such places\); samples are missing"):
        checked(Recording.read(made.file))
    with pytest.raises(InputFileError, match="lists no recording"):
        Study.read(study)
    again = convert([study / "captures" / "gap.fascap"], study, longest=True)
    assert again.problems == () and again.recording.time_s.size == 48 * 16
    (listed,) = Study.read(study).recordings
    assert checked(listed).condition.frequency_hz == pytest.approx(20, abs=0.01)
    assert any("longest stretch" in text for text in listed.warnings)


def test_conversion_is_cut_to_length_and_repeatable_and_times_are_exact_at_4_khz(tmp_path: Path) -> None:
    file = capture_of(tmp_path, "one", sine_frames(400, rate=4000.0), seconds=1.5, rate=4000.0)
    first, second = convert([file], tmp_path), convert([file], tmp_path)
    assert first.recording.time_s.size == 6000 and first.document() == second.document()
    read = Study.read(tmp_path).recordings
    assert len(read) == 1
    np.testing.assert_allclose(read[0].time_s, np.arange(6000) / 4000, atol=1e-9)
    assert (tmp_path / "subjects.csv").read_text() == "subject,mass_kg\n16,72.57\n"


def test_measured_and_synthetic_are_not_mixed_and_names_do_not_collide(tmp_path: Path) -> None:
    convert([capture_of(tmp_path, "20hz_0kg", sine_frames(60))], tmp_path)
    with pytest.raises(InputFileError, match="is not synthetic data"):
        Plan(tmp_path, (20.0,), CONDITION, origin="synthetic").check(True)
    assert folder.free_stem(tmp_path, "20hz_0kg") == "20hz_0kg_2"
    assert folder.body_mass(tmp_path, "16") == 72.57 and folder.body_mass(tmp_path, "17") is None


def test_three_channels_at_4_khz_arrive_whole_and_as_sent(tmp_path: Path) -> None:
    with Feeder(tmp_path, 4000.0, 3) as feeder:
        board = Board(feeder.port, BAUD)
        board.wait_for_hello()
        plan = Plan(tmp_path / "study", (None,), CONDITION, seconds=2.0)
        (made,) = session.run(plan, board)
        board.close()
    assert made.problems == () and made.quality.lost_frames == made.quality.damaged == 0
    _, timeline, _ = folder.replay([tmp_path / "study" / "captures" / "broadband_0kg.fascap"])
    index, values = timeline.samples()
    first = int(np.flatnonzero((counts_of(np.arange(40_000), 3) == values[0] * COUNTS).all(axis=1))[0])
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
    _, timeline, _ = folder.replay([capture.file])
    quality = timeline.quality()
    index, values = timeline.samples()
    first = int(np.flatnonzero((counts_of(np.arange(40_000), 3) == values[0] * COUNTS).all(axis=1))[0])
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
    index, values = folder.replay([capture.file])[1].samples()
    first = int(np.flatnonzero((counts_of(np.arange(9000), 2) == values[0] * COUNTS).all(axis=1))[0])
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
    made = session.run(Plan(tmp_path / "study", (None,), CONDITION, seconds=0.6), board)
    board.close()
    assert [bool(one.problems) for one in made] == [True, False] and session.unusable(made) == []
    assert session.unusable(made[:1]) == ["broadband_0kg.csv"]
    (listed,) = Study.read(tmp_path / "study").recordings
    assert listed.file.endswith("recordings/broadband_0kg_2.csv") and listed.time_s.size == 600


def test_full_disk_mid_run_loses_nothing(tmp_path: Path, feeder: Feeder) -> None:
    """A limit on the file size stands for the full disk; both files together give every sample without a gap."""
    study = tmp_path / "study"
    limited = "import resource, runpy; resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000)); "
    limited += "runpy.run_module('fasbody.acquire', run_name='__main__')"
    words = ["--port", feeder.port, "--out", str(study), "--body-mass", "72.57", "--seconds", "60"]
    done = subprocess.run(
        [sys.executable, "-c", limited, *words], env={**ENVIRONMENT, "TMPDIR": str(tmp_path)}, capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode == 2 and "cannot be written" in done.stderr and "recover" in done.stderr
    (rest,) = tmp_path.glob("*_rest_*.fascap")
    made = convert([study / "captures" / "broadband_0kg.fascap", rest], study)
    assert made.problems == () and made.recording.time_s.size > 1000
    assert rest.stat().st_size > 12


def test_not_plugged_in_again_silence_garbage_and_a_missing_channel(tmp_path: Path, feeder: Feeder) -> None:
    with pytest.raises(AcquisitionError, match="cannot be opened"):
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


def test_stalled_board_keeps_what_came(tmp_path: Path, feeder: Feeder) -> None:
    board = Board(feeder.port, BAUD)
    plan = Plan(tmp_path / "study", (None,), CONDITION, seconds=60.0)
    board.listener = lambda b: setattr(feeder, "paused", b.timeline is not None and b.timeline.length > 800)
    with pytest.raises(AcquisitionError, match="silent"):
        session.run(plan, board)
    board.close()
    (kept,) = Study.read(tmp_path / "study").recordings
    assert kept.time_s.size > 800 and any("silent" in text for text in kept.warnings)


def test_over_range_ends_early(tmp_path: Path, feeder: Feeder) -> None:
    board = Board(feeder.port, BAUD)
    board.listener = lambda b: setattr(feeder, "amplitude", 32_000 if b.timeline and b.timeline.length > 300 else 0)
    with pytest.raises(AcquisitionError, match="went over range"):
        session.run(Plan(tmp_path / "study", (None,), CONDITION, seconds=60.0), board)
    board.close()
    details = json.loads((tmp_path / "study" / "recordings" / "broadband_0kg.json").read_text())
    assert details["usable"] is False and details["quality"]["over_range"]["base"] >= 3


def test_killed_mid_run_then_recovered(tmp_path: Path, feeder: Feeder) -> None:
    """After kill -9 the capture is whole but for its last moment."""
    study = tmp_path / "study"
    words = ["--port", feeder.port, "--out", str(study), "--body-mass", "72.57", "--subject", "16", "--seconds", "60"]
    victim = subprocess.Popen(command(*words), env=ENVIRONMENT, stderr=subprocess.DEVNULL)
    file = study / "captures" / "broadband_0kg.fascap"
    deadline = time.monotonic() + 60
    while not (file.is_file() and file.stat().st_size > 12_000):
        assert time.monotonic() < deadline and victim.poll() is None
        time.sleep(0.02)
    sent = feeder.sent
    victim.send_signal(signal.SIGKILL)
    victim.wait()
    done = subprocess.run(command("recover", str(file), "--json"), env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["usable"] and document["quality"]["gaps"] == []
    _, values = folder.replay([file])[1].samples()
    last = int(np.flatnonzero((counts_of(np.arange(sent + 5000), 2) == values[-1] * COUNTS).all(axis=1))[-1])
    assert last >= sent - 500  # loose, for busy machines; benchmarks/acquire.py measures it
    (kept,) = Study.read(study).recordings
    assert kept.time_s.size == document["samples"]


DRIVER = """
import sys, time
from fasbody.acquire.generator import Generator
with Generator(sys.argv[1], 115200) as g:
    g.sine(20.0, 0.01)
    g.on()
    print("on", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_output_goes_off_when_the_driver_dies(bench: Bench, number: signal.Signals) -> None:
    driver = subprocess.Popen(
        [sys.executable, "-c", DRIVER, bench.generator_port], env=ENVIRONMENT, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    assert driver.stdout is not None and driver.stdout.readline() == b"on\n"
    time.sleep(0.2)  # past the guard's start, which does not matter: its pipe is there from the beginning
    driver.send_signal(number)
    driver.wait()
    driver.stdout.close()
    deadline = time.monotonic() + 20
    while output_of(bench) != "0":
        assert time.monotonic() < deadline
        time.sleep(0.2)


def output_of(bench: Bench) -> str:
    """Ask the instrument itself, without switching anything."""
    from fasbody.acquire.port import Port

    try:
        port = Port(bench.generator_port, 115200)
    except AcquisitionError:
        return "busy"
    try:
        port.write(b"\nOUTP?\n")
        answer, deadline = b"", time.monotonic() + 1
        while b"\n" not in answer and time.monotonic() < deadline:
            answer += port.read()
        return answer.decode().strip()
    finally:
        port.close()


def test_level_is_reached_limits_hold_and_the_output_is_off_afterwards(bench: Bench) -> None:
    board = Board(bench.board_port, BAUD)
    board.wait_for_hello()
    with Generator(bench.generator_port, 115200, guard=False) as generator:
        level = reach(generator, board, 25.0, 12.0, Safety())
        values = board.collect(1.0)[:, board.base]
        assert level.peak_to_peak == pytest.approx(12.0, rel=0.02)
        amplitude = 2 * np.abs(np.mean(values * np.exp(-2j * np.pi * 25 * np.arange(values.size) / 1000)))
        assert 2 * amplitude == pytest.approx(GAIN * level.volts, rel=0.01)
        with pytest.raises(AcquisitionError, match=r"would need about"):
            reach(generator, board, 25.0, 12.0, Safety(volts=0.4), guess_volts=0.8)
        with pytest.raises(AcquisitionError, match="beyond the safety limit"):
            reach(generator, board, 25.0, 12.0, Safety(peak_m_s2=6.01), guess_volts=1.9)
    board.close()
    assert output_of(bench) == "0"


def test_safety_is_judged_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"move the base by 50\.4 mm"):
        Safety().check(3.0, 17.9)
    with pytest.raises(SettingError, match=r"exceed the limit"):
        Safety().check(50.0, 60.0)
    Safety().check(10.0, 17.9)
    for wrong in ({"seconds": 0.01}, {"frequencies_hz": (1.0,)}, {"frequencies_hz": (5.0,), "seconds": 0.5}):
        with pytest.raises(SettingError):
            replace(Plan(tmp_path, (20.0,), CONDITION), **wrong).check(False)  # type: ignore[arg-type]


def test_peak_to_peak_is_that_of_the_motion_without_noise() -> None:
    t = np.arange(700) / 1000
    phase = 2 * np.pi * 17 * t
    clean = 5 * np.sin(phase) + 0.4 * np.sin(2 * phase + 1) + 9.81
    fine = np.linspace(0, 2 * np.pi, 100_001)
    exact = np.ptp(5 * np.sin(fine) + 0.4 * np.sin(2 * fine + 1))
    noisy = clean + np.random.default_rng(1).normal(0, 0.2, t.size)
    assert peak_to_peak(clean, 1000, 17) == pytest.approx(exact, rel=1e-3)
    assert peak_to_peak(noisy, 1000, 17) == pytest.approx(exact, rel=1e-2)


def test_instrument_reports_errors(bench: Bench) -> None:
    with Generator(bench.generator_port, 115200, guard=False) as generator:
        assert generator.identity.startswith("FAS,")
        with pytest.raises(AcquisitionError, match=r"VOLT 99.* is refused \(-222"):
            generator.set_volts(99.0)
        with pytest.raises(AcquisitionError, match=r"\(-113"):
            generator.command("BANANA")
    shaker = Shaker()
    assert shaker.do("FREQ abc") is None and shaker.do("SYST:ERR?") == '-104,"Data type error"'
    assert shaker.do("WHAT?") is None and shaker.output()["volts"] == 0.0


def test_probe_tells_boards_from_generators(bench: Bench, feeder: Feeder) -> None:
    found = probe(feeder.port, (BAUD,))
    assert found.kind == "board" and "base, malleolus at 1000 Hz, 16-bit frames of 16" in str(found)
    assert probe(bench.generator_port, (115200,)).kind == "generator"
    feeder.garbage = True
    assert probe(feeder.port, (9600,)).kind == "unknown bytes"
    feeder.paused = True
    assert "silence" in str(probe(feeder.port, (9600,)))


def test_text_board_of_the_bench(tmp_path: Path) -> None:
    with Bench(rate_hz=500.0, bits=0, channels=3) as text:
        board = Board(text.board_port, 115200)
        (made,) = session.run(Plan(tmp_path, (None,), CONDITION, seconds=0.8), board)
        board.close()
    assert made.problems == () and made.recording.time_s.size == 400
    assert made.recording.tuberosity_m_s2 is not None and made.recording.tuberosity_m_s2.std() < 0.1


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


def test_commands_refuse_in_one_sentence(tmp_path: Path) -> None:
    hidden = "import sys, runpy; sys.modules['serial'] = None; runpy.run_module('fasbody.acquire', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", hidden], env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 2 and "pip install 'fasbody[acquire]'" in done.stderr and "Traceback" not in done.stderr
    from fasbody.acquire.commands import app

    for words, text in (
        ([], "--out STUDY"),
        (["--out", "x"], "--simulate"),
        (["--out", "x", "--port", "p", "--sweep", "10:20:5"], "needs a function generator"),
        (["--out", "x", "--port", "p"], "body mass"),
        (["--out", "x", "--simulate"], "needs a frequency"),
        (["--out", "x", "--simulate", "--sweep", "10-20"], "START:STOP:STEP"),
        (["--out", "x", "--simulate", "--sweep", "20:10:5"], "holds no frequencies"),
    ):
        with pytest.raises(FasError, match=text):
            app(["record", *words], standalone_mode=False)


def test_interrupted_sweep_keeps_what_it_has(tmp_path: Path, bench: Bench) -> None:
    study = tmp_path / "study"
    words = ["--port", bench.board_port, "--generator", bench.generator_port, "--frequency", "30", "--seconds", "60"]
    words += ["--out", str(study), "--body-mass", "72.57"]
    run = subprocess.Popen(command(*words), env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
    file = study / "captures" / "30hz_0kg.fascap"
    deadline = time.monotonic() + 60
    while not (file.is_file() and file.stat().st_size > 6000):
        assert time.monotonic() < deadline and run.poll() is None
        time.sleep(0.02)
    run.send_signal(signal.SIGINT)
    _, told = run.communicate(timeout=30)
    assert run.returncode == 130 and "interrupted" in told
    assert output_of(bench) == "0"
    (kept,) = Study.read(study).recordings
    assert checked(kept).condition.frequency_hz == pytest.approx(30, abs=0.05)


def test_from_the_shaker_to_the_parameters(tmp_path: Path) -> None:
    """A sweep on the virtual bench, then the fit: every parameter within four standard errors of the bench's own."""
    study, out = tmp_path / "study", tmp_path / "out"
    words = ["--simulate", "--sweep", "15:45:15", "--seconds", "1.5", "--out", str(study), "--json"]
    done = subprocess.run(command(*words), env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [one["usable"] for one in json.loads(done.stdout)["recordings"]] == [True] * 3
    fit = [sys.executable, "-m", "identification.fit", str(study), "--starts", "2", "--out", str(out), "--json"]
    result = json.loads(subprocess.run(fit, env=ENVIRONMENT, capture_output=True, text=True, check=True).stdout)
    assert result["origin"] == "synthetic"
    estimates = next(b for b in result["branches"] if b["name"] == "stiff ankle")["parameters"]
    for name, truth in TRUTH.items():
        found = next(e for key, e in estimates.items() if key.startswith(f"{name}_"))
        assert found["at_bound"] or abs(found["value"] - truth) < 4 * found["std_error"], (name, found, truth)
    for name in ("k_T_n_per_m", "k_F_n_per_m", "c_11_n_s_per_m", "c_21_n_s_per_m"):
        assert estimates[name]["std_error"] < 0.03 * estimates[name]["value"]
