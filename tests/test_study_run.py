"""Running a study: failures, resumption after kill -9, broken documents, one sentence on bad input."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from study_runs import ENVIRONMENT, arguments, documents, done, fitted, small

from fasbody import console as interrupt
from fasbody.console import to_json
from fasbody.foot.model import load
from fasbody.recording.study import StudyFolder
from identification.fitting import Settings, fit_foot
from identification.study import cluster, job
from identification.study.plan import Model, Plan


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small(tmp_path_factory.mktemp("run") / "study", frequencies=(20.0, 25.0, 30.0))


def test_a_job_is_the_fit(study: Path) -> None:
    """What the document says is what fit() says of the same recordings."""
    opened, settings = StudyFolder.open(study), Settings(departures=False, starts=1, threads=1)
    plan = Plan(opened, opened.trials, settings, Model.of(load("two_dof")))
    one = plan.jobs("pooled")[0]
    found = job.run(plan.work(one))
    want = fit_foot([opened.read(trial) for trial in one.trials], load("two_dof"), settings).document()
    assert found["status"] == "done" and found["files"] == one.files
    for name in ("parameters", "branches", "verdict", "starts", "goodness_of_fit", "recordings"):
        assert to_json(found["result"][name]) == to_json(want[name]), name


def test_interrupt_within_compiled_code_is_no_failed_fit(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What compiled code makes of Ctrl-C, a SystemError, is no document; other bugs are one, with their traceback."""
    opened = StudyFolder.open(study)
    plan = Plan(opened, opened.trials, Settings(departures=False, starts=1, threads=1), Model.of(load("two_dof")))
    work = plan.work(plan.jobs("per-recording")[0])
    monkeypatch.setattr(interrupt, "_pressed", [])

    def compiled(pressed: bool) -> None:
        try:
            if pressed:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(1.0)
        finally:
            raise SystemError("returned a result with an exception set")

    monkeypatch.setattr(job, "_done", lambda *_: compiled(pressed=True))
    with cluster.crew(1, None, 1) as do, pytest.raises(KeyboardInterrupt):
        list(do([work]))
    monkeypatch.setattr(job, "_done", lambda *_: compiled(pressed=False))
    with cluster.crew(1, None, 1) as do:
        (found,) = do([work])
    assert found["status"] == "failed" and found["result"] is None and found["cycles"] == []
    assert "SystemError" in found["error"] and "\n" not in found["error"]
    assert "in compiled" in found["traceback"] and found["traceback"].count("\n") > 3


def test_failures_are_kept_and_tried_again(tmp_path: Path) -> None:
    study, out = small(tmp_path / "study"), tmp_path / "out"
    quick = ("--workers", "1", "--starts", "1")
    dead = study / "recordings" / "s01_midstance_0kg_20hz.csv"
    healthy = dead.read_bytes()
    lines = healthy.decode().splitlines()
    dead.write_text("\n".join([lines[0], *(f"{line.rsplit(',', 2)[0]},0.0,0.0" for line in lines[1:])]) + "\n")
    gone = study / "recordings" / "s01_midstance_2.3kg_30hz.csv"
    kept = gone.read_bytes()
    gone.unlink()
    first = fitted(study, out, *quick)
    assert (first["modes"][0]["fits"], done(first), first["computed"]) == (4, 2, 4)
    errors = {d["files"][0]: d["error"] for d in first["failed"]}
    assert "is dead" in errors["recordings/s01_midstance_0kg_20hz.csv"]
    assert "no such file" in errors["recordings/s01_midstance_2.3kg_30hz.csv"]
    assert all(error.count("\n") == 0 for error in errors.values())
    assert sum(d["status"] == "failed" and d["result"] is None for d in documents(out).values()) == 2
    assert "is dead" in first["said"]

    pooled = fitted(study, out, *quick, "--mode", "pooled")
    assert done(pooled, "pooled") == 2  # from what is left of each load
    assert "left out" in pooled["said"]

    gone.write_bytes(kept)
    again = fitted(study, out, *quick)
    assert (again["computed"], done(again)) == (2, 3)  # the dead one anew, and the one that is back
    dead.write_bytes(healthy)
    assert done(fitted(study, out, *quick)) == 4


@pytest.mark.long
def test_killed_and_resumed(study: Path, tmp_path: Path) -> None:
    """Kill -9 in the middle; afterwards nothing is done twice, and the result is that of an undisturbed run."""
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert fitted(study, whole, "--workers", "1")["computed"] == 6
    process = subprocess.Popen(
        arguments(study, out, "--workers", "1"), env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    while len(list((out / "fits").glob("*.json"))) < 2 and process.poll() is None:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    left = {file: file.stat().st_mtime_ns for file in (out / "fits").glob("*.json")}
    assert 2 <= len(left) <= 6
    assert all(json.loads(file.read_text())["status"] == "done" for file in left)
    resumed = fitted(study, out, "--workers", "1")
    assert resumed["computed"] == 6 - len(left)
    assert {file: file.stat().st_mtime_ns for file in left} == left
    assert documents(out) == documents(whole)
    assert fitted(study, out, "--workers", "1")["computed"] == 0


@pytest.mark.long
@pytest.mark.parametrize(("workers", "presses"), [("1", 1), ("2", 2)])
def test_interrupted(study: Path, tmp_path: Path, workers: str, presses: int) -> None:
    """As a terminal does it, to the whole group; `timeout` signals twice."""
    process = subprocess.Popen(
        arguments(study, tmp_path, "--workers", workers, "--starts", "20"), env=ENVIRONMENT, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    while not list((tmp_path / "fits").glob("*.json")) and process.poll() is None:
        time.sleep(0.005)
    for _ in range(presses):
        os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=300)
    if process.returncode == 0:
        pytest.skip("it had ended before")
    assert process.returncode == 130
    assert "the same command goes on from there" in said and said.count("\n") == 1, said
    assert not list((tmp_path / "fits").glob(".*"))
    for document in documents(tmp_path).values():
        assert document["status"] == "done"
        assert not [text for text in document["result"]["warnings"] if "Interrupted" in text]


@pytest.mark.long
def test_broken_and_foreign_documents_are_computed_again(study: Path, tmp_path: Path) -> None:
    narrow = ("--workers", "1", "--frequency", "20")
    fitted(study, tmp_path, *narrow)
    good = documents(tmp_path)
    one, other = sorted((tmp_path / "fits").glob("*.json"))
    one.write_text(one.read_text()[:-100])
    other.write_text(json.dumps({"key": "something else"}))
    stray = tmp_path / "fits" / "notes.json"
    stray.write_text("not ours")
    said = fitted(study, tmp_path, *narrow)
    assert said["computed"] == 2
    assert f"{one.name}: is broken" in said["said"] and f"{other.name}: is not the fit" in said["said"]
    stray.unlink()
    assert documents(tmp_path) == good
    flattered = json.loads(one.read_text())
    flattered["result"]["branches"][0]["fit_percent"] = 99.9
    one.write_text(json.dumps(flattered))
    other.write_text(json.dumps({**json.loads(other.read_text()), "result": {}}))
    said = fitted(study, tmp_path, *narrow)
    assert said["computed"] == 2 and said["said"].count("was changed after it was written") == 2
    assert documents(tmp_path) == good


@pytest.mark.long
def test_aperiodic_recordings_are_fitted_in_the_time_domain(tmp_path: Path) -> None:
    """A sweep has no frequency in the table."""
    from fasbody.laboratory.study import Plan as Virtual
    from fasbody.laboratory.study import make

    study = make(
        tmp_path / "study",
        Virtual(subjects=1, conditions=(("midstance", 0.0),), excitation="sweep", seconds=2.0),
        processes=1,
    )
    fitted(study, tmp_path / "out", "--workers", "1")
    (document,) = documents(tmp_path / "out").values()
    assert document["frequency_hz"] is None and document["result"]["domain"] == "time"
    assert np.isfinite(document["result"]["fit_percent"])


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--mode", "polled"), "unknown mode 'polled'"),
        (("--domain", "frequency"), "unknown domain 'frequency'"),
        (("--subject", "77"), "unknown subject '77'"),
        (("--model", "three_dof"), "no such model"),
        (("--starts", "0"), "the number of starts is 0"),
        (("--profile", "k_X"), "unknown parameter to profile 'k_X'"),
        (("--free", "k_T", "--profile", "k_F"), "unknown parameter to profile 'k_F'"),
        (("--bounds", "k_T=1e4"), "is not NAME=LOWER:UPPER"),
        (("--bounds", "k_X=1:2"), "k_X"),
        (("--prior", "k_T>k_F", "--prior", "k_T<k_F"), "orders k_T and k_F 2 times (k_T>k_F, k_T<k_F); give one order"),
        (("--scheduler", "foo"), "--scheduler foo is not tcp://HOST:PORT"),
        (("--scheduler", "tcp://127.0.0.1:seven"), "is not tcp://HOST:PORT"),
        (("--prior", "k_T>k_Q"), "is not NAME=LOWER:UPPER, for example k_F=3e3:1e6, nor an order: k_T>k_F or k_T<k_F."),
        (("--profile", "delay"), "one frequency cannot determine the delay"),
    ],
)
def test_bad_input_is_one_sentence(study: Path, tmp_path: Path, more: tuple[str, ...], said: str) -> None:
    out = tmp_path / "out"
    document = fitted(study, out, *more, expect=2)
    assert not out.exists()
    assert said in document["said"] and document["said"].count("error:") == 1 and "Traceback" not in document["said"]


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_what_other_settings_left_is_said_and_its_figures_go(study: Path, tmp_path: Path) -> None:
    narrow = ("--workers", "1", "--frequency", "20")
    first = fitted(study, tmp_path, *narrow, "--report")
    assert (first["unshown"], "not shown" in first["said"]) == (0, False)
    figures = tmp_path / "figures"
    (figures / "mine.png").write_bytes(b"a user's own")
    (tmp_path / "fits" / "notes.json").write_text("not ours")
    assert (figures / "loops_per-recording.svg").is_file()
    other = fitted(study, tmp_path, *narrow, "--bounds", "k_T=1e4:1e7", "--mode", "pooled", "--report")
    assert other["unshown"] == 2
    assert other["unshown_by_mode"] == {"per-recording": 2}
    said = "2 per-recording documents in this folder, a mode that was not asked for, were made with other settings, "
    said += "recordings or program, and are not shown."
    assert said in other["said"] and said in (tmp_path / "report.html").read_text()
    assert not list(figures.glob("*_per-recording*"))
    again = fitted(study, tmp_path, *narrow, "--starts", "3")["said"]
    assert "2 per-recording documents in this folder were made with other settings, recordings or program" in again
    assert "2 pooled documents in this folder, a mode that was not asked for, were made" in again
    assert (figures / "mine.png").is_file() and (figures / "loops_pooled.png").is_file()
