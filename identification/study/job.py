"""One job, done: recordings and settings in, one plain document out. Nothing is read, written or remembered."""

import time
import traceback
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from fasbody.exceptions import FasError, RecordingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.fitting import Settings, fit_foot
from identification.study.checks import check
from identification.study.filters import KINDS
from identification.study.loops import cycles
from identification.study.plan import Job, Work

Document = dict[str, Any]
#: One fit of the time domain in so many is run by MuJoCo from end to end; which ones follows from their keys.
SAMPLE = 20


def run(work: Work) -> Document:
    """Do a job: its document, with status "done", or "failed" and a sentence."""
    began = time.perf_counter()
    left_out = list(work.unread)
    outcome: Document = {"status": "failed"}
    try:
        if not work.recordings:
            raise RecordingError(" ".join(left_out) or f"{work.job}: there is no recording.")
        outcome = {"status": "done", **_done(work, left_out)}
    except FasError as problem:
        outcome["error"] = str(problem)
    except Exception as bug:  # a bug met by one recording must not stop a study of hundreds
        short = " ".join(str(bug).split())[:200]
        outcome["error"] = f"{work.job}: an unexpected {type(bug).__name__} ({short}); its document has the traceback."
        outcome["traceback"] = traceback.format_exc()
    return document(work.job, outcome, time.perf_counter() - began, left_out)


def document(job: Job, outcome: Document, seconds: float = 0.0, left_out: Sequence[str] = ()) -> Document:
    """What every document says of its job, and what was found: its status, and result and cycles or the error."""
    return {
        "key": job.key, "kind": job.kind, "parameter": job.parameter,
        "mode": job.mode, "subject": job.subject, "posture": job.posture,
        "added_mass_kg": job.added_mass_kg, "frequency_hz": job.frequency_hz, "files": job.files, "origin": job.origin,
        "status": outcome["status"], "error": outcome.get("error"), "traceback": outcome.get("traceback"),
        "left_out": list(left_out), "seconds": seconds,
        "result": outcome.get("result"), "cycles": outcome.get("cycles", []),
    }  # fmt: skip


def _done(work: Work, left_out: list[str]) -> Document:
    """Result and cycles, or what a check found; of several recordings those that cannot serve are left out."""
    foot = work.model.foot()
    recordings, data = _usable(work.recordings, left_out)
    if work.job.kind != KINDS[0]:
        return {"result": check(work, recordings, foot)}
    fitted = fit_foot(recordings, foot, sampled(work), interruptible=False)
    result = fitted.with_source(str(work.job)).document()
    result["warnings"] += [f"Left out: {sentence}" for sentence in left_out]
    periodic = result.get("domain", "periodic") == "periodic"
    return {"result": result, "cycles": _cycles(result, foot, data) if periodic else []}


def sampled(work: Work) -> Settings:
    """The settings of a fit: in the time domain MuJoCo runs every twentieth fit throughout, unless set otherwise."""
    by_key = int(int(work.job.key, 16) % SAMPLE == 0)
    return replace(work.settings, replay=work.settings.replay or by_key)


def _cycles(result: Document, foot: Foot, data: Sequence[Recording]) -> list[Document]:
    """Cycles of all branches, or of the best one where another has none."""
    try:
        return cycles(result, foot, data)
    except SimulationError as problem:
        best = {**result, "branches": result["branches"][:1]}
        result["warnings"].append(f"Cycles are of the {result['branches'][0]['name']} branch only: {problem}")
        return cycles(best, foot, data)


def _usable(recordings: Sequence[Recording], left_out: list[str]) -> tuple[list[Recording], list[Recording]]:
    """Those that can serve, as they are and checked; of a single one that cannot the sentence is the job's."""
    usable, data = [], []
    for recording in recordings:
        try:
            data.append(checked(recording))
            usable.append(recording)
        except RecordingError as problem:
            if len(recordings) == 1:
                raise
            left_out.append(str(problem))
    if not usable:
        raise RecordingError(" ".join(left_out))
    return usable, data
