"""How long a whole study takes: fits a second, beside scipy on the same recordings, and two workers beside one.

Recordings of the virtual study (`python -m fasbody.laboratory FOLDER --subjects 20 --posture midstance`: 540 of 10 s at
1 kHz), each fitted alone from ten starts, both branches, certified in MuJoCo. A few subjects are fitted and the CPU
time of a fit extrapolated; CPU times, as other programs disturb them little.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks import plain_scipy
from benchmarks.rows import Row, at_least, at_most, faster, report
from fasbody.checks import checked
from fasbody.console import command_line, progress_bar
from fasbody.model import load
from fasbody.recording import StudyFolder
from fasbody.virtual_study import Plan as Virtual
from fasbody.virtual_study import make
from identification.estimate import Settings
from identification.routes import TimeRoute
from identification.space import space_of
from identification.study import job
from identification.study.plan import Model, Plan

#: The study that is meant, and a load average beyond which two processes cannot show what they do.
_RECORDINGS, _IDLE = 540, 0.5
_LOADS = (("midstance", 0.0), ("midstance", 2.3), ("midstance", 4.5))


def fits(study: StudyFolder, count: int, domain: str, starts: int) -> float:
    """CPU time of one fit [s]: reading, fitting, both branches in MuJoCo, cycles; mean of recordings spread evenly."""
    plan = Plan(study, study.trials, Settings(starts=starts, domain=domain, threads=1), Model.of(load("two_dof")))
    jobs = plan.jobs("per-recording")
    chosen = [jobs[i] for i in np.linspace(0, len(jobs) - 1, count).round().astype(int)]
    job.run(plan.work(jobs[0]))  # compiles
    began = time.process_time()
    for one in chosen:
        assert job.run(plan.work(one))["status"] == "done"
    return (time.process_time() - began) / len(chosen)


def by_scipy(study: StudyFolder, count: int, evaluations: int) -> float:
    """CPU time of one fit of a recording from one start by `solve_ivp` and `least_squares` [s]."""
    foot, times = load("two_dof"), []
    space = space_of(foot, delay=False)
    with progress_bar() as progress:
        for i in progress.track(np.linspace(0, len(study.trials) - 1, count).round().astype(int), description="scipy"):
            recording = checked(study.read(study.trials[i]))
            problem = TimeRoute(foot, [recording], space, twin=True, threads=1).explorer()
            began = time.process_time()
            plain_scipy.fit(problem, problem.start(space.to_q(space.theta(foot.values()))), evaluations)
            times.append(time.process_time() - began)
    return float(np.mean(times))


def scaling(folder: Path) -> tuple[float, float]:
    """Wall times [s] of the fits of a study by one local Dask worker and by two, starting them not included."""
    times = []
    for workers in (1, 2):
        code = (
            "import sys, time; from pathlib import Path; from fasbody.model import load;"
            "from fasbody.recording import StudyFolder; from identification.estimate import Settings;"
            "from identification.study import cluster; from identification.study.plan import Model, Plan\n"
            "if __name__ == '__main__':\n"
            "    study = StudyFolder.open(sys.argv[1])\n"
            "    plan = Plan(study, study.trials, Settings(starts=10, threads=1), Model.of(load('two_dof')))\n"
            "    jobs = plan.jobs('per-recording')\n"
            "    with cluster.local(int(sys.argv[2])) as do:\n"
            "        list(do(plan.work(job) for job in jobs[:4]))\n"
            "        began = time.perf_counter()\n"
            "        list(do(plan.work(job) for job in jobs))\n"
            "        print(time.perf_counter() - began)\n"
        )
        with tempfile.TemporaryDirectory() as place:
            script = Path(place) / "scaling.py"  # a file, as its worker processes import it again
            script.write_text(code)
            environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent)}
            done = subprocess.run(
                [sys.executable, str(script), str(folder), str(workers)], capture_output=True, text=True, check=True,
                env=environment,
            )  # fmt: skip
        times.append(float(done.stdout))
    return times[0], times[1]


def measure(
    subjects: int = 1, count: int = 27, count_time: int = 9, scipy_recordings: int = 5, scipy_limit: int = 200,
    starts: int = 10, workers: bool = True,
) -> list[Row]:  # fmt: skip
    """All rows; the defaults are those of `make bench`."""
    with tempfile.TemporaryDirectory() as place:
        folder = make(Path(place) / "study", Virtual(subjects=subjects, conditions=_LOADS))
        study = StudyFolder.open(folder)
        steady = fits(study, count, "auto", starts)
        timed = fits(study, count_time, "time", starts)
        scipy = by_scipy(study, scipy_recordings, scipy_limit)
        rows = [
            at_most(f"steady-state fit, {starts} starts, both branches in MuJoCo, mean of {count}", steady, 0.44, "s"),
            at_most(f"study of {_RECORDINGS}, two idle cores, extrapolated", _RECORDINGS * steady / 120, 2.0, "min"),
            at_least("fits a second on one idle core", 1 / steady, 540 / 240),
            at_most(f"the same in the time domain, mean of {count_time}", _RECORDINGS * timed / 120, 10.0, "min"),
            faster("steady-state fit, ten starts", steady, scipy,
                   f"scipy, one start, {scipy_limit} trial points allowed, mean of {scipy_recordings} recordings"),
            faster("time-domain fit, ten starts", timed, scipy, "the same"),
        ]  # fmt: skip
        if workers:
            rows.append(two_workers(folder))
    return rows


def two_workers(folder: Path) -> Row:
    """Two local Dask workers beside one; not judged on a busy machine."""
    load_before = os.getloadavg()[0]
    one, two = scaling(folder)
    row = at_least("two local Dask workers beside one, wall time", one / two, 1.8, "times")
    if load_before > _IDLE or len(os.sched_getaffinity(0)) < 2:
        row = replace(row, against=f"{row.against} on idle cores; not judged, load was {load_before:.1f}", holds=None)
    return row


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    count: Annotated[int, typer.Option(min=1, help="recordings fitted in steady state")] = 27,
    count_time: Annotated[int, typer.Option(min=1, help="recordings fitted in the time domain")] = 9,
    scipy_recordings: Annotated[int, typer.Option(min=1, help="recordings fitted by scipy")] = 5,
    scipy_limit: Annotated[int, typer.Option(min=1, help="trial points allowed to scipy")] = 200,
    json_: Annotated[bool, typer.Option("--json", help="print the rows on stdout")] = False,
) -> None:
    """Speed of a study; scipy takes minutes.

    Examples:
      python -m benchmarks.study --scipy-limit 3
    """
    report("study", measure(1, count, count_time, scipy_recordings, scipy_limit), json_)


if __name__ == "__main__":
    command_line(app)
