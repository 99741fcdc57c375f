"""The generator and its level: limits hold, errors are heard, and the output ends up off."""

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
from feeder import BAUD, CONDITION, Feeder, output_of

from fasbody.acquire.bench import GAIN, Bench, Shaker
from fasbody.acquire.board import Board, Watch
from fasbody.acquire.generator import Generator
from fasbody.acquire.level import Safety, peak_to_peak, reach
from fasbody.acquire.plan import Plan
from fasbody.acquire.port import probe
from fasbody.exceptions import AcquisitionError, SettingError

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with Bench(seed=4) as made:
        yield made


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a machine with many other processes a second without a sample is no fault of the board."""
    monkeypatch.setattr("fasbody.acquire.board.BLIND_S", 20.0)
    monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 20.0)


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
    deadline = time.monotonic() + 120
    while output_of(bench) != "0":
        assert time.monotonic() < deadline
        time.sleep(0.2)


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
            reach(generator, board, 25.0, 12.0, Safety(peak_m_s2=6.01), guess_volts=3.8)
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


@pytest.mark.parametrize("wrong", [float("nan"), -3.0, 0.0, float("inf")])
@pytest.mark.parametrize("name", ["volts", "peak_m_s2", "displacement_m"])
def test_limit_that_is_no_positive_number_is_refused(tmp_path: Path, name: str, wrong: float) -> None:
    plan = Plan(tmp_path, (20.0,), CONDITION, safety=replace(Safety(), **{name: wrong}))
    with pytest.raises(SettingError, match=f"{name} is .* positive"):
        plan.check(True)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -6.0])
def test_watch_trips_at_what_is_no_number(value: float) -> None:
    with pytest.raises(AcquisitionError, match="safety limit of 5"):
        Watch(5.0, 0.0).check(np.array([0.0, value]))


@pytest.mark.parametrize(("guess", "match"), [(1.94, r"moves by 0\.2[67]\d* mm"), (3.8, r"limit of 3\.[67]")])
def test_displacement_is_limited_while_the_base_moves(bench: Bench, guess: float, match: str) -> None:
    """6 m/s^2 at 25 Hz are 0.243 mm and allowed; a shaker that answers more strongly than before is stopped.

    The limit is 3.46 m/s^2 and 5.5 times the noise at rest, which holds what is left of the last motion, too.
    """
    board = Board(bench.board_port, BAUD)
    board.wait_for_hello()
    with Generator(bench.generator_port, 115200, guard=False) as generator:
        with pytest.raises(AcquisitionError, match=match):
            reach(generator, board, 25.0, 6.0, Safety(displacement_m=0.00025), guess_volts=guess)
        generator.off()
    board.close()


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
