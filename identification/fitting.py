"""The fit of a foot model to recordings: what is asked, steady or sample by sample, and what the answer allows."""

import functools
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from fasbody.exceptions import SettingError
from fasbody.foot.model import Foot
from fasbody.progress import Advance, Work, silent
from fasbody.recording.recording import UNSTATED, Recording
from fasbody.recording.study import Study
from identification import branches, steady
from identification.branches import Recorded, Verdict
from identification.evidence import Evidence
from identification.lifting import contacts
from identification.recommendations import LEAST_FIT, advice, excitation_rank, follows
from identification.result import FitResult, RecordingFit, trusting, without_exact
from identification.setup import Settings, Setup, provenance, tells_delay, with_settings

_TRUSTS = (
    "These intervals and odds assume the model, the stated masses and the instrument exact: errors of model and "
    "sensors are included only where all recordings are settled sines, at several frequencies."
)
_TRUSTS_NOT = (
    "The odds assume the model, the stated masses and the instrument exact: errors of model and sensors are included "
    "only where all recordings are settled sines, at several frequencies."
)

#: What a fit of steady recordings takes after the search: replays, intervals.
_AFTER = 0.3


def fit_foot(
    study: Study | Recording | Iterable[Recording],
    foot: Foot,
    settings: Settings | None = None,
    *,
    advance: Advance = silent,
    interruptible: bool = True,
    **chosen: Any,
) -> FitResult:
    """Estimate a foot's parameters from recordings, pooled.

        result = fit_foot(study, load("two_dof"), free=["k_T", "k_F"], starts=4)

    Args:
        study: a study, or one or more recordings as read; they are checked here.
        foot: the model.
        settings: how to fit.
        advance: called with the stage, the steps done and about how many there are in all stages; see
            `fasbody.progress.Pace`.
        interruptible: Ctrl-C ends the exploration only, and the result rests on the starts done.
        **chosen: fields of `Settings`, in place of those of `settings`.

    Raises:
        RecordingError: a recording cannot serve. SettingError: an option cannot be meant.
        SimulationError: no start led anywhere.
    """
    began = time.perf_counter()
    settings = with_settings(settings or Settings(), chosen)
    if not isinstance(foot, Foot):
        raise SettingError(f"the foot is {foot!r}; give a loaded model, load('two_dof') for example.")
    recordings = [study] if isinstance(study, Recording) else list(study)
    for item in recordings:
        if not isinstance(item, Recording):
            raise SettingError(
                f"one of the recordings is a {type(item).__name__}; give a Study or recordings: Recording.from_table "
                "makes one of a table, Recording.from_arrays of arrays."
            )
    with _blas().limit(limits=1):
        setup = Setup.of(recordings, foot, settings)
        if setup.name == "periodic":
            result = _steady(setup, settings, advance)
        else:
            result = _transient(setup, settings, advance, interruptible)
    return replace(
        result,
        source=study.name if isinstance(study, Study) else result.source,
        provenance=provenance(settings, setup.space, setup.recordings),
        seconds=time.perf_counter() - began,
    )


def _steady(setup: Setup, settings: Settings, advance: Advance) -> FitResult:
    """The fit of steady recordings: see steady.py."""
    problem, work = setup.problem(), Work(advance, _AFTER)
    tells = tells_delay(setup.recordings)
    allow = settings.departures and tells and any(item.kind != "delay" for item in problem.variables.nuisances)
    fitted = steady.fit(problem, setup.foot, settings.starts, settings.seed, allow, work)
    data = setup.recordings
    built = steady.branches_of(fitted, data, work)
    rank = excitation_rank(data)
    enough = allow or rank >= len(setup.space.free)
    loads = len({recording.condition.added_mass_kg for recording in data})
    follow = allow and "load" not in setup.known.excluded
    recorded = Recorded(loads, len(setup.sensors), follow)
    verdict = steady.verdict_of(fitted, built, recorded, setup.why_not)
    solutions = list(fitted.solutions)
    if verdict.tied:
        solutions.sort(key=lambda solution: solution.branch)
        built.sort(key=lambda branch: branch.name)
    best = solutions[0]
    run = fitted.replays[best.branch]
    fits = steady.recordings_of(fitted, best, data)
    others = [b.departures for b in built[1:] if b.departures] if verdict.word == "undecided" else []
    recommended = advice(built[0], setup.space, rank, data, [f.fit_percent for f in fits], run.base_error, others)
    warnings = (*setup.warnings, *recommended)
    result = FitResult(
        source=data[0].file,
        origin=_origin(data),
        model=setup.foot.name,
        domain="periodic",
        branches=tuple(built),
        recordings=fits,
        verdict=verdict.word,
        reason=verdict.sentence,
        log_likelihood_ratio=verdict.log_likelihood_ratio,
        excitation_rank=rank,
        twin_mujoco_difference=run.difference,
        base_acceleration_error=run.base_error,
        starts=steady.start_rows(fitted),
        warnings=tuple(dict.fromkeys(warnings)),
        contact=contacts(best, data) if enough else (),
        evidence=Evidence(setup.foot, data, setup.two_mass, tuple(solutions), fitted.exact, fitted.replays),
    )
    return _only_what_holds(result, result.trusting, settings.departures and not allow)


def _only_what_holds(result: FitResult, exact: bool, trusts: bool) -> FitResult:
    """A result without what its recordings do not bear out, and a warning of what the rest assumes.

    Args:
        result: as fitted.
        exact: whether intervals of the model assumed exact may be offered.
        trusts: whether nothing beside the model was allowed for.
    """
    if not exact:
        result = replace(result, branches=tuple(map(without_exact, result.branches)))
    if trusts and (exact or result.verdict == "decided"):  # else neither interval nor odds are offered
        text = _TRUSTS if exact else _TRUSTS_NOT
        result = replace(result, warnings=(*result.warnings, text))
    return result


def _origin(data: Sequence[Recording]) -> str:
    """Where the recordings come from: synthetic if one of them is."""
    return next((o for o in ("synthetic", UNSTATED) if any(r.origin == o for r in data)), "measured")


@functools.cache
def _blas() -> ThreadpoolController:
    """The threads of BLAS: matrices of a fit are small, and on busy cores more than one thread only waits, up to ten
    times as long as the work takes.
    """
    return ThreadpoolController().select(user_api="blas")


def _transient(setup: Setup, settings: Settings, advance: Advance, interruptible: bool) -> FitResult:
    """The fit of every sample: see transient.py."""
    from identification import transient  # recordings of sines need none of it

    search = transient.fit(
        setup, settings.starts, settings.seed, settings.threads, settings.replay, advance, interruptible
    )
    data, space = setup.recordings, setup.space
    built = [transient.branch_of(c, space) for c in search.branches]
    first, run = built[0], search.branches[0].run
    last = built[-1].parameters
    rests = branches.pinned({key: e.at_bound for key, e in last.items()}, {key: e.value for key, e in last.items()})
    rank = excitation_rank(data)
    loads = len({recording.condition.added_mass_kg for recording in data})
    recorded = Recorded(loads, len(setup.sensors))
    names, deviances = [b.name for b in built], [b.deviance for b in built]
    verdict = branches.judge(names, deviances, first.chi_square, first.dof, rests, recorded)
    if setup.why_not or search.left_out:
        why = setup.why_not or branches.LEFT_OUT.format(name=search.left_out[0])
        verdict = Verdict("not compared", 0.0, why)
    follow = bool(follows(np.mean(run.fits))) or not branches.misses(first.chi_square, first.dof)
    if not follow and verdict.word != "not compared":
        text = branches.FOLLOWS_LITTLE.format(percent=np.mean(run.fits), least=LEAST_FIT)
        verdict = Verdict("undecided", verdict.log_likelihood_ratio, text)
    certified = list(search.branches)
    if verdict.tied:
        certified.sort(key=lambda c: c.name)
        built.sort(key=lambda b: b.name)
    recommended = advice(built[0], space, rank, data, run.fits, run.base_error)
    result = FitResult(
        source=data[0].file,
        origin=_origin(data),
        model=setup.foot.name,
        domain="time",
        branches=tuple(map(trusting, built)),
        recordings=tuple(
            RecordingFit.of(r, f, y, sensors)
            for r, f, y, sensors in zip(data, run.fits, run.traces, certified[0].sensors(data), strict=True)
        ),
        verdict=verdict.word,
        reason=verdict.sentence,
        log_likelihood_ratio=verdict.log_likelihood_ratio,
        excitation_rank=rank,
        twin_mujoco_difference=run.twin_difference,
        base_acceleration_error=run.base_error,
        starts=search.starts,
        warnings=tuple(dict.fromkeys((*setup.warnings, *search.warnings, *recommended))),
        evidence=Evidence(setup.foot, data, setup.two_mass, (), {}, {}, space, tuple(certified)),
    )
    return _only_what_holds(result, result.trusting and follow, settings.departures)
