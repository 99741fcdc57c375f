"""How long a whole study takes, beside scipy on the same recordings, two workers beside one, and in the time domain.

The virtual study (`python -m fasbody.laboratory FOLDER --subjects 20 --posture midstance`: 540 recordings of 10 s at
1 kHz), each recording fitted alone from ten starts, both branches, certified in MuJoCo. Wall times, so the cores must
be idle; what is extrapolated says from how many recordings.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks import plain_scipy
from benchmarks.table import JsonOption, faster, judged_if_idle, report
from fasbody.console import command_line, console
from fasbody.foot.model import load
from fasbody.laboratory.study import Plan as Virtual
from fasbody.laboratory.study import make
from fasbody.recording.checks import checked
from fasbody.recording.study import StudyFolder
from identification.fitting import Settings
from identification.multistart import descend
from identification.parameters import space_of
from identification.study import cluster
from identification.study.plan import Job, Model, Plan
from identification.study.store import Document
from identification.time_domain import TimeDomain
from reproduction.check import Check, at_least, at_most

_LOADS = (("midstance", 0.0), ("midstance", 2.3), ("midstance", 4.5))
#: Recordings of a subject: three loads at nine frequencies.
_PER_SUBJECT = 27
#: A study of 540 recordings in steady state and in the time domain on two cores [min].
_REQUIRED_MIN, _REQUIRED_TIME_MIN, _MEANT = 1.0, 10.0, 540


def spread(items: Sequence[Any], count: int) -> list[Any]:
    """So many of them, evenly."""
    return [items[i] for i in np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)]


def whole(folder: Path, starts: int) -> tuple[float, dict[str, Any]]:
    """Wall time [s] of the command on a study, without its page, and the line of its JSON document about the fits."""
    out = folder.with_name("results")
    how = ["--starts", str(starts), "--workers", str(_cores()), "--no-report", "--json", "--out", str(out)]
    command = [sys.executable, "-m", "identification.study", str(folder), *how]
    began = time.perf_counter()
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return time.perf_counter() - began, json.loads(done.stdout)["modes"][0]


def on_workers(plan: Plan, jobs: Sequence[Job], workers: int) -> float:
    """Wall time [s] of jobs on so many local processes, whose start and first jobs are not counted."""
    first = 2 * workers
    fits = cluster.local(workers)(plan.work(job) for job in [*jobs[:first], *jobs])
    _all_done(islice(fits, first))
    began = time.perf_counter()
    _all_done(fits)
    return time.perf_counter() - began


def _all_done(documents: Any) -> None:
    failed: list[Document] = [document for document in documents if document["status"] != "done"]
    assert not failed, failed[0]["error"]


def by_scipy(study: StudyFolder, count: int, evaluations: int) -> tuple[float, float]:
    """CPU time [s] of one start by `solve_ivp` and `least_squares`, and the trial points taken for it, means.

    So many trial points are timed on each recording and scaled to those that our descent takes on the same
    problem from the same start, as scipy needs minutes to converge.
    """
    foot, seconds, points = load("two_dof"), [], []
    space = space_of(foot, delay=False)
    for trial in spread(study.trials, count):
        problem = TimeDomain(foot, [checked(study.read(trial))], space, twin=True, threads=1).problem()
        q0 = space.to_q(space.theta(foot.values()))
        ours = descend(problem, "model", problem.start(q0)).evaluations
        began = time.process_time()
        plain_scipy.fit(problem, problem.start(q0), evaluations)
        seconds.append((time.process_time() - began) / evaluations * ours)
        points.append(ours)
    return float(np.mean(seconds)), float(np.mean(points))


def measure(
    subjects: int = 20, subset: int = 81, count_time: int = 36, scipy_recordings: int = 5, evaluations: int = 2,
    starts: int = 10,
) -> list[Check]:  # fmt: skip
    """All rows; the defaults are those of `make bench`."""
    busy, rows = os.getloadavg()[0], []
    recordings, cores = subjects * _PER_SUBJECT, _cores()

    def say(what: str) -> None:
        console.print(f"  {time.strftime('%H:%M:%S')} {what}", markup=False, soft_wrap=True)

    def judged(row: Check) -> None:
        rows.append(judged_if_idle(row, busy))

    with tempfile.TemporaryDirectory() as place:
        say(f"making {recordings} recordings")
        folder = make(Path(place) / "study", Virtual(subjects=subjects, conditions=_LOADS))
        study, model = StudyFolder.open(folder), Model.of(load("two_dof"))
        steady = Plan(study, study.trials, Settings(starts=starts, threads=1, replay=0), model)
        timed = Plan(study, study.trials, Settings(starts=starts, domain="time", threads=1, replay=0), model)

        say(f"fitting all of them on {cores} processes")
        wall, fits = whole(folder, starts)
        per_fit = fits["seconds"] / fits["fits"]
        what = f"study of {recordings}, {starts} starts, both branches in MuJoCo, {cores} processes, wall time"
        judged(at_most(what, wall / 60, _REQUIRED_MIN * recordings / _MEANT, "min"))
        judged(at_least("its fits a second", fits["fits"] / wall, _MEANT / _REQUIRED_MIN / 60))
        rows.append(at_least("its recordings that are fitted", 100 * fits["done"] / fits["fits"], 100.0, "%"))

        say(f"scipy: {evaluations} trial points on each of {scipy_recordings} recordings")
        start, points = by_scipy(study, scipy_recordings, evaluations)
        other = (
            f"scipy solve_ivp and least_squares, {starts} starts of {points:.3g} trial points (as many as our descent "
            f"takes), from {evaluations} timed on each of {scipy_recordings} recordings"
        )
        rows.append(faster(f"one of its fits, {starts} starts, time of one process", per_fit, starts * start, other))

        jobs = spread(steady.jobs("per-recording"), subset)
        say(f"{len(jobs)} recordings on one process, then on two")
        one, two = (on_workers(steady, jobs, workers) for workers in (1, 2))
        what = f"two local processes beside one, {len(jobs)} recordings, wall time"
        judged(at_least(what, one / two, 1.8, "times"))

        jobs = spread(timed.jobs("per-recording"), count_time)
        say(f"{len(jobs)} recordings in the time domain on {cores} processes")
        in_time = on_workers(timed, jobs, cores) / len(jobs)
        what = f"study of {recordings} in the time domain, {cores} processes, wall time, extrapolated from {len(jobs)}"
        judged(at_most(what, recordings * in_time / 60, _REQUIRED_TIME_MIN * recordings / _MEANT, "min"))
    return rows


def _cores() -> int:
    return len(os.sched_getaffinity(0))


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    subjects: Annotated[
        int, typer.Option(min=1, help=f"subjects of the whole study, {_PER_SUBJECT} recordings each")
    ] = 20,
    subset: Annotated[int, typer.Option(min=2, help="recordings on one and on two workers")] = 81,
    count_time: Annotated[int, typer.Option(min=1, help="recordings fitted in the time domain")] = 36,
    scipy_recordings: Annotated[int, typer.Option(min=1, help="recordings fitted by scipy")] = 5,
    scipy_points: Annotated[int, typer.Option(min=1, help="trial points of scipy on each")] = 2,
    json_: JsonOption = False,
) -> None:
    """Speed of a study from its first to its last fit. Takes about ten minutes on two idle cores.

    Examples:
      python -m benchmarks.study --subjects 1 --count-time 4 --scipy-points 1
    """
    report("study", measure(subjects, subset, count_time, scipy_recordings, scipy_points), json_)


if __name__ == "__main__":
    command_line(app)
