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

pytest.importorskip("distributed")


#: A scheduler's process, its address, and its workers.
Cluster = tuple["subprocess.Popen[str]", str, "list[subprocess.Popen[str]]"]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cluster")
    return small(folder / "study", subjects=2)


@pytest.fixture(scope="module")
def serial(study: Path) -> dict[str, dict[str, object]]:
    out = study.parent / "serial"
    fitted(study, out, "--workers", "1")
    return documents(out)


def _dask(*words: str) -> "subprocess.Popen[str]":
    code = "import sys; from distributed.cli import {0}; sys.exit({0}.main())"
    return subprocess.Popen(
        [sys.executable, "-c", code.format(words[0]), *words[1:]], env=ENVIRONMENT, stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, text=True, start_new_session=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """One for both tests, as each process takes seconds to start: the first leaves a worker, the last kills it all."""
    folder = tmp_path_factory.mktemp("scheduler")
    process, address = _scheduler(folder)
    workers = [_worker(address, folder / str(i)) for i in range(2)]
    yield process, address, workers
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
    more = ("--nthreads", "1", "--no-dashboard", "--no-nanny", "--local-directory", str(folder))
    return _dask("dask_worker", scheduler, "--host", "127.0.0.1", *more)


def test_a_killed_worker_loses_nothing(
    study: Path, serial: dict[str, dict[str, object]], scheduler: Cluster, tmp_path: Path
) -> None:
    """The workers see no file of the study: their working folder is elsewhere, and the study is moved meanwhile."""
    _, address, workers = scheduler
    out = tmp_path / "out"
    run = subprocess.Popen(
        arguments(study, out, "--scheduler", address), env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    while len(list((out / "fits").glob("*.json"))) < 2 and run.poll() is None:
        time.sleep(0.01)
    early = run.poll() is None
    os.killpg(workers[0].pid, signal.SIGKILL)
    _, said = run.communicate()
    assert early, f"the study ended before a worker could be killed: {said}"
    assert run.returncode == 0, said
    assert documents(out) == serial
    again = fitted(study, out, "--workers", "1")  # in this process, which finds them all
    assert (again["computed"], done(again)) == (0, 8)


def test_a_lost_scheduler_is_one_sentence(study: Path, scheduler: Cluster, tmp_path: Path) -> None:
    """Killed midway: no traceback of Dask's above the sentence, and what was done is kept."""
    process, address, _ = scheduler
    out = tmp_path / "out"
    run = subprocess.Popen(
        arguments(study, out, "--scheduler", address, "--starts", "6"), env=ENVIRONMENT, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not list((out / "fits").glob("[!.]*.json")) and run.poll() is None:
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


def test_local_processes_give_the_same(study: Path, serial: dict, tmp_path: Path) -> None:  # type: ignore[type-arg]
    elsewhere(study, tmp_path, "--workers", "2")
    assert documents(tmp_path) == serial


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
    said = fitted(study, tmp_path / "out", "--workers", "2", expect=2)["said"]
    assert "pip install 'fasbody[study]'" in said and "Traceback" not in said
