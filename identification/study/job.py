"""One job, done: recordings and settings in, one plain document out. Nothing is read, written or remembered."""

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

from fasbody.checks import checked
from fasbody.exceptions import FasError, RecordingError, SimulationError
from fasbody.model import Foot
from fasbody.recording import Recording
from identification.estimate import fit
from identification.study.checks import check
from identification.study.loops import cycles
from identification.study.plan import KINDS, Job, Work
from identification.study.trend import fit_trend

Document = dict[str, Any]


def run(work: Work) -> Document:
    """Do a job: its document, with status "done", or "failed" and a sentence."""
    began = time.perf_counter()
    left_out = list(work.unread)
    try:
        if not work.recordings:
            raise RecordingError(" ".join(left_out) or f"{work.job}: there is no recording.")
        found = _done(work, left_out)
        status, error = "done", None
    except FasError as problem:
        found, status, error = {"result": None, "cycles": []}, "failed", str(problem)
    except Exception as bug:  # a bug met by one recording must not stop a study of hundreds
        if isinstance(bug.__cause__, KeyboardInterrupt):  # what compiled code makes of Ctrl-C, a SystemError
            raise KeyboardInterrupt from bug
        error = f"{work.job}: an unexpected {type(bug).__name__} ({' '.join(str(bug).split())[:200]})."
        found, status = {"result": None, "cycles": []}, "failed"
    return document(work.job, status, error, time.perf_counter() - began, left_out) | found


def document(job: Job, status: str, error: str | None, seconds: float, left_out: Sequence[str] = ()) -> Document:
    """What every document says of its job."""
    return {
        "key": job.key, "kind": job.kind, "parameter": job.parameter,
        "mode": job.mode, "subject": job.subject, "posture": job.posture,
        "added_mass_kg": job.added_mass_kg, "frequency_hz": job.frequency_hz, "files": job.files, "origin": job.origin,
        "status": status, "error": error, "left_out": list(left_out), "seconds": seconds, "result": None, "cycles": [],
    }  # fmt: skip


def _done(work: Work, left_out: list[str]) -> Document:
    """Result and cycles, or what a check found; of several recordings those that cannot serve are left out."""
    foot = work.model.foot()
    recordings = list(work.recordings)
    if len(recordings) > 1:
        recordings = _usable(recordings, left_out)
    if work.job.kind != KINDS[0]:
        return {"result": check(work, recordings, foot)}
    fitter = fit_trend if work.job.mode == "trend" else partial(fit, interruptible=False)
    result = fitter(recordings, foot, work.settings, source=str(work.job)).document()
    result["warnings"] += [f"Left out: {sentence}" for sentence in left_out]
    periodic = result.get("domain", "periodic") == "periodic"
    return {"result": result, "cycles": cycles(result, foot, [checked(r) for r in recordings]) if periodic else []}


def _usable(recordings: Sequence[Recording], left_out: list[str]) -> list[Recording]:
    usable = []
    for recording in recordings:
        try:
            checked(recording)
        except RecordingError as problem:
            left_out.append(str(problem))
        else:
            usable.append(recording)
    if not usable:
        raise RecordingError(" ".join(left_out))
    return usable
