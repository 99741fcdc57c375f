"""Rival models on the same recordings, ranked by BIC and by what they predict."""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from fasbody.exceptions import ModelError, RecordingError, SettingError, unknown
from fasbody.foot.model import Foot, load
from fasbody.foot.parameters import symbol_and_unit
from fasbody.progress import Advance, silent
from fasbody.recording.checks import apart, checked
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study
from fasbody.sentences import Sentence
from identification.engines.twin import twin_applies
from identification.estimates import Estimate
from identification.harmonics import Line
from identification.intervals import Solution
from identification.rivals.ladder import (
    LADDER,
    LINEAR,
    Candidate,
    Rung,
    RungVariables,
    edited,
    rungs_of,
)
from identification.rivals.result import MODEL, Point, Rival, RivalConstant, Rivals, preferred
from identification.rivals.search import Contender, climb, held_out
from identification.setup import is_steady


def compare_rivals(
    study: Study | Recording | Iterable[Recording],
    foot: Foot | None = None,
    *,
    models: Sequence[str] | None = None,
    files: Sequence[Path | str] = (),
    mass_std: float | None = None,
    gain_std: float | None = None,
    delay_std_s: float | None = None,
    source: str = "",
    advance: Advance = silent,
) -> Rivals:
    """Compare rival models on recordings of one foot in steady vibration.

        compare_rivals(study).first

    Args:
        study: a study, or one or more recordings of one person, at one or more frequencies and
            loads.
        foot: the two-mass model, default the shipped one; its bounds hold for all rivals.
        models: names of rivals to compare beside the linear foot and the model, default all
            (`ladder.LADDER`).
        files: edited MJCF models to compare as well.
        mass_std, gain_std, delay_std_s: what masses, gain and delay may be off, as in `fit_foot`.
        source: name of the data, if not that of the study.
        advance: called with the stage, the number done and the total.

    Raises:
        RecordingError: a recording is not steady, or they are of several persons. ModelError: the model is not the
            two-mass foot. SettingError: an unknown model.
    """
    began = time.perf_counter()
    foot = foot or load("two_dof")
    chosen = _rungs(models)
    if not twin_applies(foot):
        raise ModelError(
            file=foot.name,
            problem="rival models exist for the two-mass foot only",
            remedy=Sentence("leave --model out and give this file as --rival", on_page="choose two_dof"),
        )
    edits = [load(file) for file in files]
    recordings = [study] if isinstance(study, Recording) else list(study)
    data = _checked(recordings)
    stated = Known.of_all([r.known for r in data])
    known = stated.overruled_by(mass_std=mass_std, gain_std=gain_std, delay_std_s=delay_std_s)
    ladder, others = rungs_of(foot, data, known, chosen), [edited(model, data, known) for model in edits]
    contenders = climb([*ladder, *others], advance)
    best = min((c.solutions[0] for c in contenders), key=lambda end: end.optimum.objective)
    lines = [Line.of(r) for r in data]
    return Rivals(
        source=source or (study.name if isinstance(study, Study) else data[0].file),
        model=foot.name,
        rivals=tuple(preferred([_rival(contender, best) for contender in contenders])),
        points=tuple(
            Point(line.recording.file, line.base.frequency_hz, line.recording.condition.added_mass_kg,
                  line.base.amplitudes, line.malleolus.amplitudes, line.malleolus.std)
            for line in lines
        ),
        repeatability=best.problem.repeatability,
        warnings=tuple(dict.fromkeys(text for r in data for text in r.warnings)),
        seconds=time.perf_counter() - began,
    )  # fmt: skip


def _rungs(names: Sequence[str] | None) -> list[Rung]:
    known = [rung.name for rung in LADDER]
    for name in names or ():
        if name not in known:
            raise SettingError(f"{unknown('rival model', name, known)}.")
    return [rung for rung in LADDER if names is None or rung.name in (LINEAR, MODEL, *names)]


def _checked(recordings: Sequence[Recording]) -> list[Recording]:
    if not recordings:
        raise RecordingError("there is no recording to compare rivals on.")
    apart(recordings)
    data = [checked(recording) for recording in recordings]
    for r in data:
        if r.condition.frequency_hz is None:
            raise RecordingError(f"{r.file}: is not periodic; rival models need steady recordings of one sine each.")
    if not is_steady(data):
        raise RecordingError(
            f"{data[0].file} or another recording is not steady (its amplitude drifts or beats); rival models need "
            "steady recordings."
        )
    people = {(r.condition.subject, r.condition.body_mass_kg) for r in data}
    if len(people) > 1:
        named = ", ".join(sorted(f"{who or 'unnamed'} {mass or '?'} kg" for who, mass in people)[:4])
        raise RecordingError(f"the recordings are of several persons ({named}); compare rivals for one at a time.")
    if len({r.condition.frequency_hz and round(r.condition.frequency_hz, 1) for r in data}) < 3:
        raise RecordingError(
            f"{data[0].file}: rival models differ in how they depend on frequency; give recordings at three or more "
            "frequencies."
        )
    return data


def _rival(contender: Contender, best: Solution) -> Rival:
    candidate, (end, *others) = contender.candidate, contender.solutions
    rung, problem, v = candidate.rung, end.problem, end.problem.variables
    deviances = [best.deviance(e.optimum.objective) for e in contender.solutions]
    scores, error = held_out(end)
    (k_T, k_F), across = _springs(end), _springs(others[0]) if others else (None, None)
    penalty = candidate.free * float(np.log(problem.size))
    Y, valid = problem.predicted(end.q)[:, 0], problem.measured.valid[:, 0]
    return Rival(
        name=rung.name, title=rung.title, free=candidate.free, chi_square=end.chi_square, dof=end.dof,
        bic=deviances[0] + penalty, held_out=scores, error=error,
        branch=end.branch, log_odds=0.5 * (deviances[1] - deviances[0]) if others else None,
        k_T=k_T, k_F=k_F, log_ratio=_log_ratio(end) if k_T and k_F else None,
        other=(across[0], across[1]) if across[0] and across[1] else None, constants=_constants(candidate, end),
        values=v.named(end.q) if isinstance(v, RungVariables) else {},
        predicted=tuple(y[ok] for y, ok in zip(Y, valid, strict=True)), converged=end.optimum.converged,
        extra=candidate.extra, repeatability=contender.repeatability, penalty=penalty,
    )  # fmt: skip


def _springs(end: Solution) -> tuple[Estimate | None, Estimate | None]:
    estimates = {symbol_and_unit(key)[0]: e for key, e in end.estimates()[0].items()}
    return estimates.get("k_T"), estimates.get("k_F")


def _log_ratio(end: Solution) -> tuple[float, float]:
    def value(q: np.ndarray) -> np.ndarray:
        springs = end.problem.variables.dynamic(q)
        return np.log([springs["k_T"] / springs["k_F"]])

    return float(value(end.q)[0]), float(end.spread(end.slopes(value))[0])


def _constants(candidate: Candidate, end: Solution) -> tuple[RivalConstant, ...]:
    """The constants that only this rival has; 1 / f^2 of a mount is reported as its frequency."""
    rows, items = dict(zip(end.problem.variables.nuisances, end.allowances(), strict=True)), []
    for symbol, item in candidate.rung.constants.items():
        name, does, unit, row = symbol, item.does, item.unit, rows[item]
        numbers = (row.value, row.lower, row.upper)
        if symbol == "u":
            name, does, unit = "f_u", "frequency of the sensor on its tissue", "Hz"
            value, upper, lower = (x**-0.5 if x > 0 else np.inf for x in numbers)
            numbers = (value, lower, upper)
        items.append(RivalConstant(name, does, unit, *numbers, item.source))
    return tuple(items)
