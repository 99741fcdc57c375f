"""One job, done: recordings and settings in, one plain document out. Nothing is read or written."""

import time
import traceback
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace

import numpy as np
from scipy.signal import resample

from fasbody.exceptions import FasError, RecordingError, SettingError, SimulationError, unknown
from fasbody.foot.hysteresis import Loop, cycle
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification import optimiser
from identification.engines.twin import twin_applies
from identification.fitting import Settings, fit_foot
from identification.harmonics import Line
from identification.intervals import Solution
from identification.parameters import DELAY, Space, space_of
from identification.setup import Setup
from identification.study import KINDS, validation
from identification.study.agreement import agreement
from identification.study.plan import Job, Work
from identification.study.profile import profiles_of
from identification.study.store import Document

#: One fit of the time domain in so many is run by MuJoCo from end to end; which ones, their keys say.
SAMPLE = 20
#: Points of a stored loop.
POINTS = 48


def ensure(mode: str, settings: Settings, foot: Foot, profile: Sequence[str]) -> Space:
    """The search space of a study's fits, its checks validated.

    Raises:
        SettingError: a parameter that is not estimated, or a bound that is none.
    """
    space = space_of(foot, settings.free, settings.bounds, settings.delay is not False)
    free = [item.name for item in space.free]
    for name in profile:
        if name not in free:
            raise SettingError(f"{unknown('parameter to profile', name, free)}.")
    if mode == "per-recording" and DELAY.name in profile:
        raise SettingError("one frequency cannot determine the delay; profile it with --mode pooled.")
    return space


def run(work: Work) -> Document:
    """Do a job: its document, with status "done", or "failed" and a sentence."""
    began = time.perf_counter()
    left_out = list(work.unread)
    outcome: Document = {}
    try:
        if not work.recordings:
            raise RecordingError(" ".join(left_out) or f"{work.job}: there is no recording.")
        outcome = _done(work, left_out)
    except FasError as problem:
        outcome["error"] = str(problem)
    except Exception as bug:  # one recording's must not stop a study of hundreds
        short = f"{type(bug).__name__} ({' '.join(str(bug).split())[:200]})"
        outcome["error"] = f"{work.job}: an unexpected {short}; its document has the traceback."
        outcome["traceback"] = traceback.format_exc()
    return document(work.job, time.perf_counter() - began, left_out, **outcome)


def document(
    job: Job,
    seconds: float = 0.0,
    left_out: Sequence[str] = (),
    *,
    result: Document | None = None,
    cycles: Sequence[Document] = (),
    error: str | None = None,
    traceback: str | None = None,
) -> Document:
    """What every document says of its job, and its outcome: result and cycles, or the error."""
    about = {name: getattr(job, name) for name in ("key", "kind", "parameter", "mode", "subject", "posture")}
    about |= {name: getattr(job, name) for name in ("added_mass_kg", "frequency_hz", "files", "origin")}
    return about | {
        "status": "failed" if error else "done",
        "error": error,
        "traceback": traceback,
        "left_out": list(left_out),
        "seconds": seconds,
        "result": result,
        "cycles": list(cycles),
    }


def _done(work: Work, left_out: list[str]) -> Document:
    """Result and cycles, or what a check gives; of several recordings those that cannot serve are left out."""
    foot, recordings = work.model.foot(), work.recordings
    if len(recordings) > 1:  # one alone is checked by its fit
        recordings = _usable(recordings, left_out)
    if work.job.kind != KINDS[0]:
        return {"result": _check(work, recordings, foot)}
    fitted = fit_foot(recordings, foot, sampled(work), interruptible=False)
    result = fitted.with_source(str(work.job)).document()
    result["warnings"] += [f"Left out: {sentence}" for sentence in left_out]
    periodic = result.get("domain", "periodic") == "periodic"
    data = fitted.evidence.recordings if periodic and fitted.evidence else ()
    return {"result": result, "cycles": _cycles(result, foot, data)}


def sampled(work: Work) -> Settings:
    """The settings of a fit, of which MuJoCo runs every twentieth throughout unless set otherwise."""
    by_key = int(int(work.job.key, 16) % SAMPLE == 0)
    return replace(work.settings, replay=work.settings.replay or by_key)


def _cycles(result: Document, foot: Foot, data: Sequence[Recording]) -> list[Document]:
    """Cycles of all branches, or of the best one where another has none."""
    try:
        return cycles(result, foot, data)
    except SimulationError as problem:
        best = {**result, "branches": result["branches"][:1]}
        name = result["branches"][0]["name"]
        result["warnings"].append(f"Cycles are of the {name} branch only: {problem}")
        return cycles(best, foot, data)


def cycles(result: Document, foot: Foot, recordings: Sequence[Recording | Line]) -> list[Document]:
    """Hysteresis loops and energies of a fit: an entry a periodic recording and branch.

    They are of both branches, as all fits of a subject together may decide for the other one later.

    Args:
        result: `FitResult.document()`.
        foot: the model.
        recordings: those of the fit, checked, or their harmonics.
    """
    two_mass, entries = twin_applies(foot), []
    for recording in recordings:
        if isinstance(recording, Recording) and recording.condition.frequency_hz is None:
            continue
        line = recording if isinstance(recording, Line) else Line.of(recording)
        condition, f, base = line.recording.condition, line.base.frequency_hz, line.base.amplitudes
        about = {"file": line.recording.file, "frequency_hz": f, "added_mass_kg": condition.added_mass_kg}
        for number, branch in enumerate(result["branches"]):
            values = values_of(branch, foot)
            one = cycle(foot, f, base, {**foot.values(), **values, **condition.masses}, two_mass)
            model = one.malleolus_m_s2 * np.exp(-2j * np.pi * f * values.get(DELAY.name, 0.0))
            over_base = {"measured": line.malleolus.amplitudes[0] / base[0], "model": model / base[0]}
            entries.append(about | {
                "branch": branch["name"], "chosen": number == 0,
                "ankle": _loop(one.ankle), "fat_pad": _loop(one.fat_pad),
                **{name: getattr(one, name) for name in ("dissipated_j", "shaker_work_j", "imbalance")},
                "transmissibility": {kind: _short([H.real, H.imag]) for kind, H in over_base.items()},
            })  # fmt: skip
    return entries


def _loop(loop: Loop) -> Document:
    curves = {"displacement_m": loop.displacement_m, "force_n": loop.force_n}
    points = {name: _short(resample(curve, POINTS)) for name, curve in curves.items()}
    return points | {"dissipated_j": loop.dissipated_j}


def _short(values: Iterable[float]) -> list[float]:
    """Numbers of six digits: a thousandth of a line's width, and half the file."""
    return [float(f"{value:.6g}") for value in values]


def values_of(branch: Document, foot: Foot) -> dict[str, float]:
    """Constants and the malleolus' delay by name, those of the exact model: so it moves as recorded.

    Delays of further sensors have no part in the motion.
    """
    name_of = {item.key: name for name, item in {**foot.parameters, DELAY.name: DELAY}.items()}
    known = {name_of[key]: e for key, e in branch["parameters"].items() if key in name_of}
    return {name: (e.get("if_model_true") or e)["value"] for name, e in known.items()}


def _usable(recordings: Sequence[Recording], left_out: list[str]) -> tuple[Recording, ...]:
    usable = []
    for recording in recordings:
        try:
            checked(recording)
            usable.append(recording)
        except RecordingError as problem:
            left_out.append(str(problem))
    if not usable:
        raise RecordingError(" ".join(left_out))
    return tuple(usable)


def _check(work: Work, recordings: Sequence[Recording], foot: Foot) -> Document:
    settings, mode = work.settings, work.job.mode
    if work.job.kind == "profile":
        return _profile(work, recordings, foot)
    if work.job.kind == "agreement":
        return agreement(recordings, foot, settings)
    free = space_of(foot, settings.free, settings.bounds, delay=False).names
    if mode == "pooled" and set(validation.NONLINEAR) & set(free):  # the dampers' law may bend
        damping, errors = validation.compare_damping(recordings, foot, settings)
        return {"held_out": errors, "damping": damping}
    errors = validation.leave_one_frequency_out(recordings, foot, mode, settings)
    return {"held_out": errors, "damping": None}


def _profile(work: Work, recordings: Sequence[Recording], foot: Foot) -> Document:
    """Profile of the chosen branch, the model assumed exact, from where the fit ended."""
    fit: Document = work.basis["result"] if work.basis else {}
    if fit.get("domain") != "periodic":
        raise SettingError(f"{work.job}: a profile needs a fit in the steady state, and there is none.")
    best = fit["branches"][0]
    settings = replace(work.settings, domain="periodic", delay="delay_s" in best["parameters"])
    problem = validation.held(Setup.of(recordings, foot, settings))
    variables = problem.variables
    q = variables.start(values_of(best, foot))
    sign = int(np.sign(q[variables.index["k_F"]])) if variables.ratio is not None else 0
    problem = problem.weighed(q)
    q, objective, converged = optimiser.finished(problem, q, sign)
    optimum = optimiser.Optimum(sign, q, objective, converged, 1, 1)
    (profile,) = profiles_of(Solution(best["name"], problem, optimum), (work.job.parameter,))
    key = work.basis["key"] if work.basis else ""
    return {"fit": key, "branch": best["name"], **asdict(profile)}
