"""The fitting process of a session: one job after another, how far it is, and what came of it."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fasbody.exceptions import SettingError
from fasbody.progress import Pace
from fasbody.recording.checks import UNIT_IN_DOUBT
from viz.job import Job
from viz.worker import Send, Worker

Document = dict[str, Any]
#: Where no job is: nothing is done, of nothing.
_NOTHING: Document = {"running": False, "what": "", "done": 0, "total": 0, "share": 0.0, "left_s": None}
_LOADING = "loading the solver, which is compiled at its first use"


class Fits:
    """Fits and comparisons of rivals, done by a process beside the server.

    Args:
        send: gets documents for every page, in another thread.
        answered: gets each result with its job.
        doubt: says for a job whether the unit of its recordings is in doubt.

    Attributes:
        job: that runs, or ran last.
        reporting: whether a report is being written.
    """

    def __init__(self, send: Send, answered: Callable[[Job, Document], None], doubt: Callable[[Job], str]) -> None:
        self._send, self._answered, self._doubt = send, answered, doubt
        self._worker: Worker | None = None
        self._warm = False  # the worker has compiled what it needs
        self._state: Document = {}
        self._began, self._pace = 0.0, Pace()
        self.job: Job | None = None
        self.reporting = False
        self._idle()

    @property
    def running(self) -> bool:
        """Whether a fit or a comparison runs."""
        return bool(self._state["running"])

    def prepare(self) -> None:
        """Start the process, which loads the solver."""
        if self._worker is None or not self._worker.alive:
            self._warm, self._worker = False, Worker(self.receive)

    def begin(self, job: Job) -> None:
        """Begin a job.

        Raises:
            SettingError: another one runs.
        """
        if self.running:
            raise SettingError("a fit is already running; stop it first.")
        self.job, self._began = job, time.monotonic()
        self._ask({"do": "rivals" if job.rivals else "fit", "job": job.document()})
        what = "reading the recordings" if self._warm else _LOADING
        self._state = _NOTHING | {"running": True, "what": what}

    def report(self, job: Job, folder: Path) -> None:
        """Write the report of a fit."""
        self._ask({"do": "report", "job": job.document(), "folder": str(folder)})
        self.reporting = True

    def _ask(self, document: Document) -> None:
        self.prepare()
        assert self._worker is not None
        self._worker.ask(document)

    def stop(self) -> bool:
        """End the running job; whether a report was being written, which has to be asked for again."""
        if self._worker is None or not self.running:
            return False
        reporting, self.reporting = self.reporting, False
        self._idle("stopped; the report is still being written" if reporting else "stopped")
        self._worker.stop()
        self._warm, self._worker = False, Worker(self.receive)
        return reporting

    def close(self) -> None:
        """End the process."""
        if self._worker is not None:
            self._worker.stop()

    def progress(self) -> Document:
        """How far the job is, and for how many seconds it has run."""
        return {"type": "progress", **self._state, "seconds": time.monotonic() - self._began if self.running else 0}

    def _idle(self, what: str = "") -> None:
        self._state = _NOTHING | {"what": what}

    def receive(self, document: Document) -> None:
        """Handle a document of the process, in the listening thread."""
        kind, of = document.get("type"), document.get("of", "")
        if kind == "ready":
            self._warm = True
            if self.running:
                self._state["what"] = "reading the recordings"
                self._send(self.progress())
        elif kind == "progress":
            if not self._state["total"]:
                self._pace = Pace()  # what was loaded before says nothing of the rest
            self._pace.at(document["done"], document["total"])
            self._state |= {name: document[name] for name in ("what", "done", "total")}
            self._state |= {"share": self._pace.share, "left_s": self._pace.left_s}
            self._send(self.progress())
        elif kind in ("fitted", "rivals"):
            self._idle()
            assert self.job is not None
            self._answered(self.job, document)
            self._send(self.progress())
        elif kind == "reported":
            self.reporting = False
            self._send({"type": "reported"})
        elif kind == "problem":
            known = of == "report" or document.get("code") == UNIT_IN_DOUBT or self.job is None
            doubt = "" if known or self.job is None else self._doubt(self.job)
            self._failed(" ".join(filter(None, (document["text"], doubt))), of)
        elif kind == "ended" and (self.reporting or self.running) and not (self._worker and self._worker.alive):
            self._failed("the system ended the fit; there may be too little memory.")

    def _failed(self, sentence: str, of: str = "") -> None:
        """Report that a fit or a report failed, without `of` both. The other one goes on."""
        if of != "report":
            self._idle()
        if of in ("report", ""):
            self.reporting = False
        self._send({"type": "complaint", "text": sentence, "of": of})
        self._send(self.progress())
