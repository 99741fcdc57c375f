"""A process beside the server that fits: one job a line of JSON on stdin, progress and results a line on stdout.

It calls what a script would call. Stopping a fit is ending this process; the server starts another.
"""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TextIO

from fasbody.recording.sources import together
from fasbody.runner import ONE_THREAD
from fasbody.sentences import for_page
from viz.job import Job
from viz.source import Source, on_page

#: Called with each document of the worker, in another thread.
Send = Callable[[dict[str, Any]], None]
#: Points of a trace that the page gets, and the periods of it.
POINTS, PERIODS = 400, 3
#: Seconds between reports of progress at least.
_OFTEN = 0.2


class Worker:
    """The fitting process, from the server's side; it is made ready before the first job."""

    def __init__(self, send: Send) -> None:
        self._send = send
        paths = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
        self._process = subprocess.Popen(
            [sys.executable, "-m", "viz.worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env=ONE_THREAD | os.environ | {"PYTHONPATH": paths},
        )  # fmt: skip
        self._listener = threading.Thread(target=self._listen, name="worker", daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._send(json.loads(line))
        self._process.wait()
        self._send({"type": "ended"})

    @property
    def alive(self) -> bool:
        """Whether it can take a job."""
        return self._process.poll() is None

    def ask(self, job: Mapping[str, Any]) -> None:
        """Begin a job; `send` gets its documents."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        self._listener.join()
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):  # what was still to be written to it
                if pipe is not None:
                    pipe.close()


def serve(jobs: TextIO, answers: TextIO) -> None:
    """The process: import what a fit needs, then do the job of each line; a job that waits comes first."""
    waiting: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_take_in, args=(jobs, waiting), name="jobs", daemon=True).start()
    from fasbody.console import to_json
    from fasbody.exceptions import FasError

    def tell(document: Mapping[str, Any]) -> None:
        answers.write(json.dumps(json.loads(to_json(document))) + "\n")
        answers.flush()

    import identification.fitting

    if waiting.empty():
        _rehearse()
    tell({"type": "ready"})
    if waiting.empty():
        import identification.report  # noqa: F401  # with the figures, which no fit waits for
    done: tuple[Job, Any] | None = None  # the last fit
    while line := waiting.get():
        asked = json.loads(line)
        try:
            job = Job.of(asked["job"])
            if asked["do"] == "rivals":
                _rivals(job, tell)
            elif asked["do"] == "report":
                from identification.report import write

                if done is None or done[0] != job:  # it ended with an earlier process, or is of a session's file
                    done = job, _fit(job, lambda document: None)
                write(done[1], Path(asked["folder"]), Path("results"))
                tell({"type": "reported"})
            else:
                done = job, _fit(job, tell)
        except FasError as error:
            text = on_page(error, {source.folder for source in job.sources.values()})
            tell({"type": "problem", "of": asked["do"], "text": text, "code": error.code})
        except Exception as error:
            what = {"report": "report", "rivals": "comparison"}.get(asked["do"], "fit")
            text = f"the {what} failed ({type(error).__name__}: {error})."
            tell({"type": "problem", "of": asked["do"], "text": text})


def _take_in(jobs: TextIO, waiting: "SimpleQueue[str]") -> None:
    """Read jobs in another thread; an empty line ends the process."""
    for line in jobs:
        waiting.put(line)
    waiting.put("")


def _rehearse() -> None:
    """Do a small fit, so that the first one finds everything imported and compiled."""
    from fasbody.recording.study import BUNDLED

    source = Source("20hz_0kg.csv", str(BUNDLED / "recordings"))
    _fit(Job({0: source}, "two_dof", settings={"starts": 1}), lambda document: None)


def _fit(job: Job, tell: Callable[[Mapping[str, Any]], None]) -> Any:
    from identification.derived_quantities import at_a_glance, traces
    from identification.fitting import fit_foot
    from viz.load import load_foot

    recordings = [source.read() for source in job.sources.values()]
    foot = load_foot(job.model).with_values(job.values)
    result = fit_foot(recordings, foot, advance=_advance(tell), **job.settings)
    result = result.with_source(together([r.file for r in recordings]))
    result = replace(result, provenance={**result.provenance, "model": job.model})
    data, curves, chi_square = at_a_glance(result)
    models = traces(result.evidence) if result.evidence else {}
    document = result.document() | {
        "verdict_reason": for_page(result.reason), "warnings": list(map(for_page, result.warnings)),
    }  # fmt: skip
    tell({
        "type": "fitted", "document": document, "sentence": for_page(result.sentence()), "seconds": result.seconds,
        "data": data, "curves": curves, "chi_square": chi_square,
        "traces": [
            _trace(recording, {name: rows[k] for name, rows in models.items()})
            for k, recording in enumerate(result.recordings)
        ],
    })  # fmt: skip
    return result


def _rivals(job: Job, tell: Callable[[Mapping[str, Any]], None]) -> None:
    from identification.rivals.compare import compare_rivals
    from viz.load import load_foot

    recordings = [source.read() for source in job.sources.values()]
    foot = load_foot(job.model).with_values(job.values)
    result = compare_rivals(recordings, foot, source=together([r.file for r in recordings]), advance=_advance(tell))
    sheet = result.sheet()
    tell({
        "type": "rivals", "title": sheet.title, "columns": sheet.columns, "rows": sheet.rows,
        "notes": list(map(for_page, sheet.notes)),
        "adequate": [rival in result.adequate for rival in result.rivals], "seconds": result.seconds,
    })  # fmt: skip


def _advance(tell: Callable[[Mapping[str, Any]], None]) -> Callable[[str, int, int], None]:
    last = -1.0, ""

    def advance(what: str, done: int, total: int) -> None:
        nonlocal last
        if what != last[1] or time.monotonic() - last[0] > _OFTEN:
            last = time.monotonic(), what
            tell({"type": "progress", "what": what, "done": done, "total": total})

    return advance


def _trace(recording: Any, models: Mapping[str, tuple[Any, float]]) -> dict[str, Any]:
    """A few periods of a recording and its model, by branch with its fit; seconds from the start and m/s^2."""
    time = recording.time_s - recording.time_s[0]
    last = 1.0 if recording.frequency_hz is None else PERIODS / recording.frequency_hz
    in_window = time <= last
    every = max(1, int(in_window.sum() // POINTS))
    pick = in_window.nonzero()[0][::every]
    measured = recording.measured[pick] - recording.measured.mean()
    return {
        "file": recording.file, "time_s": time[pick].tolist(), "measured": measured.round(4).tolist(),
        "models": {
            name: {"model": model[pick].round(4).tolist(), "fit_percent": fit} for name, (model, fit) in models.items()
        },
    }  # fmt: skip


if __name__ == "__main__":
    with os.fdopen(os.dup(1), "w") as private:  # what a library prints must not mix with the documents
        os.dup2(2, 1)
        serve(sys.stdin, private)
