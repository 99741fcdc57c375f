"""Ctrl-C, really sent: counted once, heeded whatever is made of it, and left to the parent by its workers."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from study_runs import ENVIRONMENT

from fasbody import console as interrupt


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """No key was pressed yet, no test before this one counts, and on a busy machine two presses may be far apart."""
    monkeypatch.setattr(interrupt, "_pressed", [])
    monkeypatch.setattr(interrupt, "_TOGETHER_S", 60.0)


def press() -> None:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)


def test_a_doubled_signal_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with interrupt.once():
        with pytest.raises(KeyboardInterrupt):
            press()
        press()  # is the same key press
        monkeypatch.setattr(interrupt, "_TOGETHER_S", 0.0)
        with pytest.raises(KeyboardInterrupt):
            press()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_where_ctrl_c_is_ignored_it_stays_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interrupt.heeded():
            press()
    finally:
        signal.signal(signal.SIGINT, before)


def swallow() -> None:
    try:
        press()
    except KeyboardInterrupt:
        return


def twist() -> None:
    try:
        press()
    except KeyboardInterrupt:
        raise SystemError("returned a result with an exception set") from None


@pytest.mark.parametrize("work", [press, swallow, twist])
def test_it_is_heeded_whatever_is_made_of_it(work) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(KeyboardInterrupt), interrupt.heeded():
        work()


def test_other_errors_stay_what_they_are() -> None:
    with pytest.raises(SystemError, match="own"), interrupt.heeded():
        raise SystemError("its own")


def test_children_started_while_it_is_held_never_see_it() -> None:
    """The child says when it runs, gets the signal, and still does what it is asked to; here it comes afterwards."""
    code, held = "print('up', flush=True); print(input(), flush=True)", False
    with interrupt.once(), pytest.raises(KeyboardInterrupt), interrupt.held():
        child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        press()
        while not (interrupt._pressed or signal.SIGINT in signal.sigpending()):  # another thread takes it, when it can
            time.sleep(0.01)
        held = True
    assert held
    assert child.stdout is not None and child.stdout.readline() == "up\n"
    child.send_signal(signal.SIGINT)
    assert child.communicate("alive\n") == ("alive\n", None)


SCRIPT = """
import os, pathlib, sys, time
from fasbody.console import command_line
from fasbody.runner import run

def work(task):
    folder, number = task
    pathlib.Path(folder, f"{os.getpid()}.{number}").touch()
    time.sleep(0.05 if number < 4 else 600)

def main():
    for _ in run(work, [(sys.argv[1], i) for i in range(50)], "works", 2):
        pass

if __name__ == "__main__":
    command_line(main)
"""


@pytest.mark.parametrize("presses", [1, 2])
def test_a_pool_ends_with_its_workers(tmp_path: Path, presses: int) -> None:
    """Ctrl-C to the whole group, and twice as `timeout` does: one word, 130, and no worker is left."""
    script, notes = tmp_path / "script.py", tmp_path / "notes"
    script.write_text(SCRIPT)
    notes.mkdir()
    process = subprocess.Popen(
        [sys.executable, str(script), str(notes)], env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, start_new_session=True,
    )  # fmt: skip
    while len(list(notes.iterdir())) < 6 and process.poll() is None:
        time.sleep(0.01)
    for _ in range(presses):
        os.killpg(process.pid, signal.SIGINT)
    said, _ = process.communicate(timeout=300)
    assert (process.returncode, said) == (130, "interrupted\n")
    assert not [pid for pid in {int(note.name.split(".")[0]) for note in notes.iterdir()} if alive(pid)]


LEAVING = """
import atexit, os, signal, time
from fasbody.console import command_line

def late():
    time.sleep(0.6)
    os.kill(os.getpid(), signal.SIGINT)

def main():
    atexit.register(late)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(60)

command_line(main)
"""


def test_a_signal_that_comes_while_the_process_ends_changes_nothing(tmp_path: Path) -> None:
    """Of two signals the second may be late, where the machine is busy; 130 is what was promised."""
    script = tmp_path / "script.py"
    script.write_text(LEAVING)
    done = subprocess.run([sys.executable, str(script)], check=False, env=ENVIRONMENT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and is not waited for does not."""
    status = Path(f"/proc/{pid}/status")
    return status.exists() and "State:\tZ" not in status.read_text()
