"""A real Dask scheduler with two worker processes: one is killed, and every result is that of the serial run."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from study_runs import ENVIRONMENT, arguments, documents, done, elsewhere, fitted, small

from fasbody.exceptions import FasError
from identification.study import cluster

distributed = pytest.importorskip("distributed")


#: A scheduler's process, its address, its workers, and the folder of each.
Cluster = tuple["subprocess.Popen[str]", str, "list[subprocess.Popen[str]]", list[Path]]
#: Before a worker starts: it ends one more fit and never the next once there is a file `hold` in its folder. So no
#: study is at its end before a test has killed something, however late the test's own process wakes up.
HOLD = """
import time
from pathlib import Path
from identification.study import job

folder, fit = Path({!r}), job.run

def run(work):
    if (folder / "held").exists():
        time.sleep(3600)
    if (folder / "hold").exists():
        (folder / "hold").rename(folder / "held")
    return fit(work)

job.run = run
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cluster")
    return small(folder / "study", subjects=2)


@pytest.fixture(scope="module")
def serial(study: Path) -> dict[str, dict[str, object]]:
    out = study.parent / "serial"
    fitted(study, out, "--workers", "1")
    return documents(out)


def _dask(program: str, *words: str, before: str = "") -> "subprocess.Popen[str]":
    code = f"{before}\nimport sys; from distributed.cli import {program}; sys.exit({program}.main())"
    return subprocess.Popen(
        [sys.executable, "-c", code, *words], env=ENVIRONMENT, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        text=True, start_new_session=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """One for both tests, as each process takes seconds to start: the first leaves a worker, the last kills it all."""
    folder = tmp_path_factory.mktemp("scheduler")
    process, address = _scheduler(folder)
    folders = [folder / str(i) for i in range(2)]
    workers = [_worker(address, each) for each in folders]
    with distributed.Client(address, timeout=300) as client:
        client.wait_for_workers(2, timeout=300)
    yield process, address, workers, folders
    for each in (*workers, process):
        each.kill()
        each.wait()


def _scheduler(folder: Path) -> "tuple[subprocess.Popen[str], str]":
    file = folder / "address.json"
    process = _dask(
        "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)
    )
    while not file.exists() or not file.read_text().endswith("}"):
        assert process.poll() is None, "the scheduler did not start"
        time.sleep(0.05)
    return process, str(json.loads(file.read_text())["address"])


def _worker(scheduler: str, folder: Path) -> "subprocess.Popen[str]":
    folder.mkdir()
    more = ("--nthreads", "1", "--no-dashboard", "--no-nanny", "--local-directory", str(folder))
    return _dask("dask_worker", scheduler, "--host", "127.0.0.1", *more, before=HOLD.format(str(folder)))


@pytest.mark.long
def test_a_killed_worker_loses_nothing(
    study: Path, serial: dict[str, dict[str, object]], scheduler: Cluster, tmp_path: Path
) -> None:
    """The workers see no file of the study: their working folder is elsewhere, and the study is moved meanwhile."""
    _, address, workers, folders = scheduler
    out = tmp_path / "out"
    (folders[0] / "hold").touch()
    run = subprocess.Popen(
        arguments(study, out, "--scheduler", address), env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    while len(list((out / "fits").glob("*.json"))) < 2 or not (folders[0] / "held").exists():
        assert run.poll() is None, run.communicate()[1]
        time.sleep(0.01)
    os.killpg(workers[0].pid, signal.SIGKILL)
    _, said = run.communicate()
    assert run.returncode == 0, said
    assert documents(out) == serial
    again = fitted(study, out, "--workers", "1")  # in this process, which finds them all
    assert (again["computed"], done(again)) == (0, 8)


@pytest.mark.long
def test_a_lost_scheduler_is_one_sentence(study: Path, scheduler: Cluster, tmp_path: Path) -> None:
    """Killed midway: no traceback of Dask's above the sentence, and what was done is kept."""
    process, address, _, folders = scheduler
    out = tmp_path / "out"
    for folder in folders:
        (folder / "hold").touch()
    run = subprocess.Popen(
        arguments(study, out, "--scheduler", address, "--starts", "6"), env=ENVIRONMENT, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not list((out / "fits").glob("[!.]*.json")):
        assert run.poll() is None, run.communicate()[1]
        time.sleep(0.01)
    process.kill()
    _, said = run.communicate()
    assert run.returncode == 2, said
    assert said == "error: the connection to the scheduler is lost; the same command goes on from here.\n"
    assert list((out / "fits").glob("*.json"))


def test_a_scheduler_lost_while_workers_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The moment of the loss decides which of Dask's calls meets it: this one failed with a traceback."""
    from distributed.comm.core import CommClosedError

    class Lost:
        def nthreads(self) -> dict[str, int]:
            raise CommClosedError("reset by peer")

    monkeypatch.setattr("distributed.as_completed", list)
    with pytest.raises(FasError, match="the connection to the scheduler is lost"):
        next(cluster._on(Lost(), []))


@pytest.mark.long
def test_local_processes_give_the_same(study: Path, serial: dict, tmp_path: Path) -> None:  # type: ignore[type-arg]
    elsewhere(study, tmp_path, "--workers", "2", "--frequency", "20")
    made = documents(tmp_path)
    assert len(made) == 4 and made.items() <= serial.items()


def test_no_scheduler(study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_PATIENCE_S", 1)
    monkeypatch.setitem(cluster._QUIET, "distributed.comm.timeouts.connect", "1s")
    said = fitted(study, tmp_path, "--scheduler", "tcp://127.0.0.1:9", expect=2)["said"]
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in said and "Traceback" not in said
    assert not list(tmp_path.iterdir())


def test_missing_package(study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty package in the way of the real one, as where the extra is not installed."""
    (tmp_path / "distributed.py").write_text("raise ImportError('hidden')\n")
    monkeypatch.delitem(sys.modules, "distributed", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    said = fitted(study, tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9", expect=2)["said"]
    assert "pip install 'fasbody[study]'" in said and "Traceback" not in said
