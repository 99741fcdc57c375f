"""A foot stands on the shaker: the level is reached, limits hold, and the output ends up off, whatever happens."""

import contextlib
import os
import pty
import signal
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from feeder import BAUD, CONDITION, ENVIRONMENT, PATIENT, Feeder, Instrument, hello

from fasbody.acquire.bench import Bench
from fasbody.acquire.bench.foot import GAIN
from fasbody.acquire.bench.generator import VirtualGenerator
from fasbody.acquire.board import Board, Watch
from fasbody.acquire.folder import convert
from fasbody.acquire.generator import Generator
from fasbody.acquire.level import COMMANDED, Safety, peak_to_peak, reach
from fasbody.acquire.plan import Plan
from fasbody.acquire.port import Port, Unplugged, is_identity, probe
from fasbody.acquire.session import terminated
from fasbody.acquire.timeline import Lateness
from fasbody.acquire.wire import encode_hello
from fasbody.exceptions import AcquisitionError, FasError, SettingError
from fasbody.recording.checks import checked
from fasbody.recording.study import Study

pytestmark = pytest.mark.usefixtures("patient")


DRIVER = """
import sys, time
from fasbody.acquire import generator
from fasbody.acquire.generator import Generator
generator._ANSWER_S = 60.0  # on a busy machine
with Generator(sys.argv[1], 115200) as g:
    g.sine(20.0, 0.01)
    g.on()
    print("on", flush=True)
    while True:
        g.alive()
        time.sleep(0.05)
"""


def driving(instrument: Instrument, stderr: int) -> subprocess.Popen[bytes]:
    """A driver in a process of its own, with the output on."""
    driver = subprocess.Popen(
        [sys.executable, "-c", DRIVER, instrument.port], env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=stderr
    )
    assert driver.stdout is not None and driver.stdout.readline() == b"on\n" and instrument.shaker.on
    return driver


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_output_goes_off_when_the_driver_dies(tmp_path: Path, number: signal.Signals) -> None:
    with Instrument(tmp_path) as instrument:
        driver = driving(instrument, subprocess.DEVNULL)
        time.sleep(0.2)  # past the guard's start, which does not matter: its pipe is there from the beginning
        driver.send_signal(number)
        driver.wait()
        driver.stdout.close()
        deadline = time.monotonic() + 300
        while instrument.shaker.on:
            assert time.monotonic() < deadline
            time.sleep(0.05)


def test_safety_is_judged_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"move the base by 50\.4 mm"):
        Safety().check(3.0, 17.9)
    with pytest.raises(SettingError, match=r"are more than \+-12\.97 m/s\^2, which leave room to the limit of \+-15"):
        Safety().check(50.0, 60.0)
    for allowed in (10.0, 17.9), (50.0, 25.9):
        Safety().check(*allowed)
    for narrow in (50.0, 26.0), (6.0, 9.9):  # within the limits, and without room for harmonics, tolerance and growth
        with pytest.raises(SettingError, match="leave room to the limit"):
            Safety().check(*narrow)
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


def test_peak_to_peak_is_that_of_the_motion_without_noise() -> None:
    t = np.arange(700) / 1000
    phase = 2 * np.pi * 17 * t
    clean = 5 * np.sin(phase) + 0.4 * np.sin(2 * phase + 1) + 9.81
    fine = np.linspace(0, 2 * np.pi, 100_001)
    exact = np.ptp(5 * np.sin(fine) + 0.4 * np.sin(2 * fine + 1))
    noisy = clean + np.random.default_rng(1).normal(0, 0.2, t.size)
    assert peak_to_peak(clean, 1000, 17) == pytest.approx(exact, rel=1e-3)
    assert peak_to_peak(noisy, 1000, 17) == pytest.approx(exact, rel=1e-2)


def test_instrument_reports_errors(tmp_path: Path) -> None:
    with Instrument(tmp_path) as instrument, Generator(instrument.port, 115200, guard=False) as generator:
        assert generator.identity.startswith("FAS,")
        with pytest.raises(AcquisitionError, match=r"VOLT 99.* is refused \(-222"):
            generator.set_volts(99.0)
        with pytest.raises(AcquisitionError, match=r"\(-113"):
            generator.command("BANANA")
    shaker = VirtualGenerator()
    assert shaker.do("FREQ abc") is None and shaker.do("SYST:ERR?") == '-104,"Data type error"'
    assert shaker.do("WHAT?") is None and shaker.output()["volts"] == 0.0


def test_probe_tells_boards_from_generators(
    tmp_path: Path, feeder: Feeder, monkeypatch: pytest.MonkeyPatch
) -> None:

    def patience(listen_s: float, ask_s: float, hello_s: float) -> None:
        for name, seconds in (("_LISTEN_S", listen_s), ("_ASK_S", ask_s), ("HELLO_S", hello_s)):
            monkeypatch.setattr(f"fasbody.acquire.port.{name}", seconds)

    patience(60.0, 0.2, 60.0)
    found = probe(feeder.port, (BAUD,))
    assert found.kind == "board" and "base, malleolus at 1000 Hz, 16-bit frames of 16" in str(found)
    feeder.garbage = True
    patience(0.2, 0.2, 60.0)
    assert probe(feeder.port, (9600,)).kind == "unknown bytes"
    patience(0.2, 60.0, 0.2)
    with Instrument(tmp_path) as instrument:
        assert probe(instrument.port, (115200,)).kind == "generator"
    feeder.pause()
    patience(0.2, 0.2, 0.2)  # enough to hear nothing
    assert "silence" in str(probe(feeder.port, (9600,)))


@pytest.mark.parametrize("speaks_after", [3.0, 4.9, 0.0])
def test_probe_waits_for_a_board_that_starts(monkeypatch: pytest.MonkeyPatch, speaks_after: float) -> None:
    """Opening an Arduino's port resets it: it is silent for seconds, and then speaks at one rate only."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    now = [0.0]

    def tick() -> float:
        """A quarter of a second at each look at the clock."""
        now[0] += 0.25
        right = termios.tcgetattr(slave)[5] == termios.B230400
        if now[0] >= speaks_after:
            os.write(master, encode_hello(hello()) if right else b"\x80\x91")
        return now[0]

    monkeypatch.setattr("fasbody.acquire.port.time", SimpleNamespace(monotonic=tick))
    found = probe(os.ttyname(slave), (230400, 9600) if speaks_after else (9600, 19200, 230400))
    assert found.kind == "board" and found.baud == 230400
    os.close(master)
    os.close(slave)


@pytest.mark.parametrize("number", [signal.SIGTSTP, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_signals_that_would_leave_the_output_on_end_the_session(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), terminated():
        signal.raise_signal(number)
    assert signal.getsignal(number) == before


@pytest.mark.parametrize(("said", "closes", "acts"), [(b"+", False, True), (b"+", True, True), (b"+-.", False, False)])
def test_guard_acts_on_silence_and_on_the_end_of_the_driver(said: bytes, closes: bool, acts: bool) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    guard = subprocess.Popen(
        [sys.executable, "-m", "fasbody.acquire.guard", os.ttyname(slave), "115200", str(slave), "0.5"],
        env=ENVIRONMENT, stdin=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0, pass_fds=[slave],
    )  # fmt: skip
    assert guard.stdin is not None and guard.stderr is not None
    guard.stdin.write(said)
    if closes:
        guard.stdin.close()
    assert guard.wait(300) == 0
    told = guard.stderr.read().decode()
    os.set_blocking(master, False)
    if acts:
        assert os.read(master, 100) == b"\nOUTP OFF\n"
        assert ("nobody has watched the base" in told) == (not closes)
    else:
        with pytest.raises(BlockingIOError):
            os.read(master, 100)
    for stream in (guard.stdin, guard.stderr):
        stream.close()
    os.close(master)
    os.close(slave)


def test_driver_that_is_stopped_leaves_no_output_on(tmp_path: Path) -> None:
    """SIGSTOP cannot be caught; the guard switches off through the port that the stopped process still holds."""
    with Instrument(tmp_path) as instrument:
        driver = driving(instrument, subprocess.PIPE)
        driver.send_signal(signal.SIGSTOP)
        deadline = time.monotonic() + 300
        while instrument.shaker.on:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        driver.send_signal(signal.SIGCONT)
        _, told = driver.communicate(timeout=300)
        assert driver.returncode == 1 and b"the guard that switches the output off" in told


def test_what_an_earlier_user_left_is_cleared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Instrument(tmp_path) as instrument:
        instrument.shaker.on, instrument.shaker.values["VOLT:OFFS"] = True, 2.5
        with Generator(instrument.port, 115200, guard=False):
            assert instrument.shaker.values["VOLT:OFFS"] == 0.0 and not instrument.shaker.on
        assert instrument.heard.index("OUTP OFF") < instrument.heard.index("*RST")
    assert capsys.readouterr().err == ""
    with Instrument(tmp_path, unknown=("*RST",)) as instrument:
        instrument.shaker.values["VOLT:OFFS"] = 2.5
        Generator(instrument.port, 115200, guard=False).close()
        assert instrument.shaker.values["VOLT:OFFS"] == 0.0
    assert capsys.readouterr().err == ""
    with Instrument(tmp_path, unknown=("*RST", "VOLT:OFFS")) as instrument:
        Generator(instrument.port, 115200, guard=False).close()
    assert "see that its offset is 0" in " ".join(capsys.readouterr().err.split())


def test_answers_of_other_makers(tmp_path: Path) -> None:
    with Instrument(tmp_path, {"*IDN?": "HAMEG,HM8131-2,1.0", "OUTP?": "+0"}) as instrument:
        generator = Generator(instrument.port, 115200, guard=False)
        assert generator.identity == "HAMEG,HM8131-2,1.0"
        generator.close()
    for answer in ("1000,0.1,0.2,0.3", "time_us,base_m_s2,malleolus_m_s2*1531", "", "READY", "a,b"):
        assert not is_identity(answer)


@pytest.mark.parametrize("late", [False, True])
def test_unconfirmed_off_is_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str], late: bool) -> None:
    with Instrument(tmp_path) as instrument:
        instrument.answers = {} if late else {"OUTP?": "1"}
        with pytest.raises(AcquisitionError, match="does not confirm OUTP OFF"):  # noqa: SIM117
            with Generator(instrument.port, 115200, guard=False) as generator:
                instrument.answers = {"OUTP?": "1"}
                generator.off()
    assert "does not confirm" not in capsys.readouterr().err


def test_port_that_vanishes_in_a_write_is_unplugged_and_no_write_waits_for_the_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*args: object) -> None:
        raise termios.error(5, "Input/output error")

    with Instrument(tmp_path) as instrument:
        port = Port(instrument.port, 9600)
        monkeypatch.setattr(termios, "tcdrain", gone)
        port.write(b"\n")
        monkeypatch.setattr(port._serial, "write", gone)
        with pytest.raises(Unplugged, match="went away"):
            port.write(b"OUTP OFF\n")
        port.close()


NOISE = 0.03


class Rig:
    """Board and generator in one, in its own time: `volts` shake the base, a sensor shows at most `clip` of it.

    Args:
        gain: base acceleration, peak to peak [m/s^2 per V]. offset: of the sensor. ringing: of the base before [m/s^2],
            which fades within `fades` [s]. lag: of its amplitude [s].
    """

    def __init__(
        self, gain: float = 14.0, clip: float = np.inf, offset: float = 0.0, ringing: float = 0.0, fades: float = 0.4,
        lag: float = 1e-3,
    ) -> None:  # fmt: skip
        self.gain, self.clip, self.offset, self.ringing, self.fades = gain, clip, offset, ringing, fades
        self.decoder, self.base, self.unplugs = SimpleNamespace(hello=hello()), 0, 0
        self.watch: Watch | None = None
        self.is_on, self.was_on, self.volts, self.frequency_hz = False, False, 0.0, 20.0
        self.highest = self.now = self._amplitude = 0.0
        self.lag = lag
        self._rng = np.random.default_rng(1)

    def sine(self, frequency_hz: float, volts: float) -> None:
        self.frequency_hz, self.volts = frequency_hz, volts

    def set_volts(self, volts: float) -> None:
        self.volts = volts

    def on(self) -> None:
        self.is_on = self.was_on = True
        self.began = self.now

    def alive(self) -> None:
        """A living driver."""

    latency_s = 0.0

    def watch_for(self, seconds: float) -> None:
        if seconds:
            self.collect(seconds)

    def collect(self, seconds: float) -> np.ndarray:
        passed = np.arange(round(1000 * seconds)) / 1000
        t = self.now + passed
        self.now = t[-1] + 1e-3
        wanted = 0.5 * self.gain * self.volts * self.is_on
        size = wanted + (self._amplitude - wanted) * np.exp(-passed / self.lag)
        self._amplitude = float(size[-1])
        true = size * np.sin(2 * np.pi * self.frequency_hz * t)
        true = true + self.ringing * np.exp(-t / self.fades) * np.sin(2 * np.pi * 11 * t)
        self.highest = max(self.highest, float(np.abs(true).max()))
        shown = np.clip(true + self._rng.normal(0, NOISE, t.size), -self.clip, self.clip) + self.offset
        if self.watch is not None:
            self.watch.check(shown)
        return np.column_stack([shown, shown])

    def reach(self, wanted: float = 17.9, safety: Safety | None = None, guess: float = 0.0) -> Any:
        return reach(self, self, 20.0, wanted, safety or Safety(), guess)  # type: ignore[arg-type]


@pytest.mark.parametrize("lag", [0.3, 1.0])
def test_late_loop_is_waited_for(lag: float) -> None:
    """As a sound card's is: without the wait the amplitude rises far above what is wanted."""
    rig = Rig(lag=lag)
    rig.latency_s = 5 * lag
    assert rig.reach().peak_to_peak == pytest.approx(17.9, rel=0.02) and rig.highest < 0.53 * 17.9


@pytest.mark.parametrize("clip", [1.0, 3.0, 5.0, 7.0, 8.0])
@pytest.mark.parametrize(("gain", "guess"), [(14.0, 0.0), (14.0, 1.28), (40.0, 1.28), (4.5, 0.0)])
def test_sensor_that_clips_unsaid_drives_the_shaker_nowhere(clip: float, gain: float, guess: float) -> None:
    """At the next frequency the shaker may answer three times as strongly as expected; 15 m/s^2 are the limit."""
    rig = Rig(gain, clip)
    with pytest.raises(AcquisitionError, match=r"does its sensor clip, or the amplifier\? Output off"):
        rig.reach(guess=guess)
    assert rig.highest <= 15.0


@pytest.mark.parametrize("late", range(4, 14))
def test_samples_that_come_late_once_are_no_sensor_that_clips(late: int) -> None:
    """A third of the level, as of a sound card on a busy computer; the same twice is believed."""

    class Late(Rig):
        looks, often = 0, 1

        def collect(self, seconds: float) -> np.ndarray:
            found = super().collect(seconds)
            self.looks += self.is_on
            return found / 3 if late <= self.looks < late + 2 * self.often else found

    assert Late().reach().peak_to_peak == pytest.approx(17.9, rel=0.02)
    rig = Late()
    rig.often = 20
    with pytest.raises(AcquisitionError, match=r"does its sensor clip|did not settle"):
        rig.reach()


@pytest.mark.parametrize("late", range(4, 12))
@pytest.mark.parametrize("gain", [40.0, 200.0])
def test_a_base_sensor_lost_while_the_level_is_found_raises_nothing(late: int, gain: float) -> None:
    """Where little voltage shakes strongly, a loop that saw nothing would go on doubling it."""

    class Lost(Rig):
        looks, before = 0, 0.0

        def collect(self, seconds: float) -> np.ndarray:
            found = super().collect(seconds)
            self.looks += self.is_on
            if self.looks < late:
                self.before = self.highest
            return found * (self.looks < late)

    rig = Lost(gain)
    try:
        rig.reach()
    except AcquisitionError as error:
        assert "does not follow the amplitude: 0 m/s^2" in str(error)
        assert rig.highest <= 2.1 * max(rig.before, 0.5 * gain * Safety.start_volts)
    else:
        assert rig.looks < late  # it was there before


@pytest.mark.parametrize("gain", [4.5, 14.0, 200.0])
@pytest.mark.parametrize("guess", [0.0, 1.28])
@pytest.mark.parametrize("lag", [0.001, 0.1, 0.2])
def test_sound_sensor_reaches_the_level(gain: float, guess: float, lag: float) -> None:
    if gain * guess > 50:
        guess = 0.0  # ten times as strong as expected is a case for the watch
    rig = Rig(gain, lag=lag)
    level = rig.reach(guess=guess)
    assert level.peak_to_peak == pytest.approx(17.9, rel=0.02)
    slow = 0.025 if lag < 0.05 else 0.15  # the loop takes a slow shaker at its word
    assert gain * level.volts == pytest.approx(17.9, rel=slow)
    assert peak_to_peak(rig.collect(1.0)[:, 0], 1000, 20) == pytest.approx(17.9, rel=slow)


@pytest.mark.parametrize(("guess", "seconds"), [(0.0, 2.8), (1.28, 1.1)])
def test_a_person_is_shaken_only_for_seconds_while_the_level_is_found(guess: float, seconds: float) -> None:
    """At 20 Hz, in the rig's own time: six doublings of 20 mV; three steps where the voltage is about known."""
    rig = Rig(lag=0.03)
    rig.reach(guess=guess)
    assert 0.4 < rig.now - rig.began <= seconds


@pytest.mark.parametrize("frequency_hz", [8.0, 10.0, 50.0])  # travel limits the first
def test_gain_that_grows_by_a_fifth_each_second_never_exceeds_a_limit(frequency_hz: float) -> None:
    """The largest level that may be commanded, on a shaker that runs away once it is there."""

    class Growing(Rig):
        def collect(self, seconds: float) -> np.ndarray:
            found = [super().collect(0.016)]  # block by block, as a board's
            for _ in range(max(0, round(seconds / 0.016) - 1)):
                self.gain *= 1 + 0.2 * 0.016 * self.grows
                found.append(super().collect(0.016))
            return np.concatenate(found)

        grows = False

    safety, highest = Safety(), []
    limit = min(safety.peak_m_s2, 0.5 * safety.displacement_m * (2 * np.pi * frequency_hz) ** 2)
    for blocks in range(12):  # it begins in another place of the sine
        rig = Growing(lag=0.01)
        rig.frequency_hz = frequency_hz
        reach(rig, rig, frequency_hz, 2 * 0.999 * COMMANDED * limit, safety)  # type: ignore[arg-type]
        rig.collect(0.016 * (blocks + 1))
        rig.grows = True
        with pytest.raises(AcquisitionError, match="beyond the safety limit"):
            rig.collect(5.0)
        rig.is_on, rig.watch = False, None
        rig.collect(0.2)
        highest.append(rig.highest)
    assert COMMANDED * limit < min(highest) and max(highest) <= limit


@pytest.mark.parametrize(
    ("span", "counts", "offset"), [(19.6, 1024.0, 9.81), (14.0, 1024.0, 0.0), (39.2, 32768 / 14.0, 0.0)]
)
def test_range_too_small_for_the_watch_is_refused_before_the_output_is_on(
    span: float, counts: float, offset: float
) -> None:
    """Gravity takes half of +-2 g; and a converter may end before the range that is said."""
    rig = Rig(offset=offset)
    known = rig.decoder.hello
    channels = tuple(replace(channel, range_m_s2=span, counts_per_m_s2=counts) for channel in known.channels)
    rig.decoder.hello = replace(known, channels=channels)
    with pytest.raises(AcquisitionError, match=r"less than the safety limit of 14\.[56], .* larger range on the board"):
        rig.reach()
    assert not rig.was_on
    rig.reach(10.0, replace(Safety(), peak_m_s2=9.0))


def test_shaker_rings_down_before_it_is_blamed_and_the_watch_knows_its_real_rest() -> None:
    rig = Rig(ringing=9.0, fades=0.5)
    rig.reach(10.0, Safety(displacement_m=0.001))
    assert rig.watch is not None
    assert rig.watch.peak == pytest.approx(Safety(displacement_m=0.001).peak(20.0, NOISE), rel=0.05)
    other = Rig(ringing=3.0, fades=1e9)
    with pytest.raises(AcquisitionError, match="is another source driving the shaker"):
        other.reach()
    assert not other.was_on and 4.0 < other.now < 6.0


def test_any_sensor_over_range_while_the_shaker_is_on_ends_it(feeder: Feeder, board: Board) -> None:
    looked: list[int] = []
    board.watch = Watch(1e9, 0.0, lambda: looked.append(1))
    board.collect(0.1)
    assert looked
    feeder.amplitude = 40_000
    with pytest.raises(AcquisitionError, match="base, malleolus went over range while the shaker was on; output off"):
        board.collect(1.0)


def test_stamps_that_stand_still_are_said_at_once(board: Board) -> None:
    real = Lateness.of
    board._lateness.of = lambda us, host: real(board._lateness, 0, host)  # type: ignore[method-assign]
    with pytest.raises(AcquisitionError, match="its time stamps do not advance"):
        board.collect(5.0)


def test_board_taken_for_a_generator_is_told_nothing_about_outputs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Feeder(tmp_path) as feeder, pytest.raises(AcquisitionError, match=r"IDN\?"):
        feeder.instead = b"1000,0.1,0.2\n"
        Generator(feeder.port, 9600)
    assert "OUTP OFF" not in capsys.readouterr().err


# with the whole bench, which computes as long as it is there


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with Bench(seed=4) as made:
        yield made


def output_of(bench: Bench) -> str:
    """Ask the instrument itself, without switching anything."""
    try:
        with contextlib.closing(Port(bench.generator_port, 115200)) as port:
            return port.ask(b"\nOUTP?\n", 60.0)[0]
    except AcquisitionError:
        return "busy"


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
            reach(generator, board, 25.0, 12.0, Safety(peak_m_s2=6.95), guess_volts=4.4)
    board.close()
    assert output_of(bench) == "0"


def test_displacement_is_limited_while_the_base_moves(bench: Bench) -> None:
    """6 m/s^2 at 25 Hz are 0.243 mm and allowed; a shaker that answers more strongly than before is stopped.

    0.29 mm are 3.58 m/s^2, and 3 % below that the output goes off, but for the noise.
    """
    board = Board(bench.board_port, BAUD)
    board.wait_for_hello()
    with Generator(bench.generator_port, 115200, guard=False) as generator:
        with pytest.raises(AcquisitionError, match=r"limit of 3\.5"):
            reach(generator, board, 25.0, 6.0, Safety(displacement_m=0.00029), guess_volts=3.8)
        generator.off()
    board.close()


@pytest.mark.long
def test_interrupted_sweep_keeps_what_it_has(tmp_path: Path, bench: Bench) -> None:
    study = tmp_path / "study"
    words = ["--port", bench.board_port, "--generator", bench.generator_port, "--frequency", "30", "--seconds", "60"]
    words += ["--out", str(study), "--body-mass", "72.57"]
    # a shell's background job ignores Ctrl-C, and its children inherit that
    words = ["env", "--default-signal=INT", sys.executable, "-c", PATIENT, *words]
    run = subprocess.Popen(words, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
    file = study / "captures" / "30hz_0kg.fascap"
    deadline = time.monotonic() + 300
    while not (file.is_file() and file.stat().st_size > 6000):
        assert time.monotonic() < deadline and run.poll() is None
        time.sleep(0.02)
    run.send_signal(signal.SIGINT)
    _, told = run.communicate(timeout=300)
    assert run.returncode == 130 and "interrupted" in told
    assert output_of(bench) == "0"
    assert "30hz_0kg.fascap --longest" in told and "go on with --frequency 30" in told
    with pytest.raises(FasError, match="lists no recording"):
        Study.read(study)
    convert(file, study, longest=True)
    (kept,) = Study.read(study).recordings
    assert checked(kept).condition.frequency_hz == pytest.approx(30, abs=0.05)
