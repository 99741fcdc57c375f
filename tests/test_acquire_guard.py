"""The output is off when the driver ends, stops or hangs; and what an earlier user left at the generator is cleared."""

import os
import pty
import signal
import subprocess
import sys
import termios
import time
import tty
from pathlib import Path

import pytest
from instrument import Instrument

from fasbody.acquire.bench import Bench
from fasbody.acquire.generator import Generator
from fasbody.acquire.interruption import terminated
from fasbody.acquire.port import Port, Unplugged, is_identity
from fasbody.exceptions import AcquisitionError

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


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
        [sys.executable, "-m", "fasbody.acquire.guard", os.ttyname(slave), "115200", str(slave)], env=ENVIRONMENT,
        stdin=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0, pass_fds=[slave],
    )  # fmt: skip
    assert guard.stdin is not None and guard.stderr is not None
    guard.stdin.write(said)
    if closes:
        guard.stdin.close()
    assert guard.wait(60) == 0
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


WATCHER = """
import sys, time
from fasbody.acquire.generator import Generator
with Generator(sys.argv[1], 115200) as g:
    g.sine(20.0, 0.01)
    g.on()
    print("on", flush=True)
    while True:
        g.alive()
        time.sleep(0.05)
"""


def test_driver_that_is_stopped_leaves_no_output_on(tmp_path: Path) -> None:
    """SIGSTOP cannot be caught; the guard switches off through the port that the stopped process still holds."""
    with Instrument(tmp_path) as instrument:
        driver = subprocess.Popen(
            [sys.executable, "-c", WATCHER, instrument.port], env=ENVIRONMENT, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )  # fmt: skip
        assert driver.stdout is not None and driver.stdout.readline() == b"on\n" and instrument.shaker.on
        driver.send_signal(signal.SIGSTOP)
        deadline = time.monotonic() + 60
        while instrument.shaker.on:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        driver.send_signal(signal.SIGCONT)
        _, told = driver.communicate(timeout=60)
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


def test_bench_whose_starter_was_killed_clears_up() -> None:
    with Bench() as bench:
        folder = Path(bench.board_port).parent
        for process in bench._processes:
            assert process.stdin is not None
            process.stdin.close()  # what the end of the starter does
            process.wait(60)
        assert not folder.exists()
