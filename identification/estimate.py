"""The fit of a foot model to recordings: what is asked, steady or sample by sample, and what the answer allows."""

import functools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from fasbody.exceptions import RecordingError, SettingError, unknown
from fasbody.foot.model import Foot
from fasbody.presentation import Tabled
from fasbody.recording.checks import apart, checked, gathered
from fasbody.recording.known import Known
from fasbody.recording.recording import UNSTATED, Channel, Recording
from fasbody.recording.study import Study
from identification import branches, sensors, steady, transient
from identification.advice import advice, excitation_rank
from identification.branches import Had, Verdict
from identification.certification import branch_of
from identification.domains import choose_domain
from identification.engines.twin import FOOT, SHANK, carriers
from identification.evidence import Evidence, provenance
from identification.lifting import contacts
from identification.residual import Problem
from identification.result import FitResult, RecordingFit, trusting, without_exact
from identification.sensors import MALLEOLUS
from identification.space import MASSES, Space, space_of, without_delay

_TRUSTS = (
    "These intervals and odds assume the model, the stated masses and the instrument exact: errors of model and "
    "sensors are included only where all recordings are settled sines, at several frequencies."
)
_TRUSTS_NOT = (
    "The odds assume the model, the stated masses and the instrument exact: errors of model and sensors are included "
    "only where all recordings are settled sines, at several frequencies."
)
_PEOPLE = "The recordings are of {n} people or feet ({names}), and one set of constants is fitted to all of them."
#: Called with what is done, how many, and of how many.
Advance = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Settings(Tabled):
    """How to fit.

    Attributes:
        free: parameters to estimate, None for all the model declares but the masses.
        bounds: name -> (lower, upper), None for the model's own.
        starts: random starts of each side of the mirror in a round of the search (default 12).
        seed: of the random starts (default 0).
        domain: "auto" (default), "periodic" or "time".
        delay: estimate the delay between the channels; None for where it can be told.
        threads: of the search, 0 for all cores (default).
        mass_std: relative standard deviation of the segment masses; None for what study.toml says, or 0.15 and 0.1.
        gain_std: that of the malleolus' gain; None for what study.toml says, or 0.01.
        delay_std_s: that of the delay between the channels [s]; None for what study.toml says, or a tenth of a sample.
        exclude: what cannot be beside the model, of `known.DEPARTURES`, or "all"; nothing unless given.
        sensors: accelerometers to fit, None for all that model and recordings have by the same name.
        wide: include errors of model and sensors; without, the model is assumed exact.
        replay: in the time domain, 0 leaves MuJoCo out where the compiled twin has shown to be the same model.

    In the time domain, steady recordings are explored on their harmonics, and fitted to every sample from there.
    """

    free: tuple[str, ...] | None = None
    bounds: Mapping[str, tuple[float, float]] | None = None
    starts: int = 12
    seed: int = 0
    domain: str = "auto"
    delay: bool | None = None
    threads: int = 0
    mass_std: float | None = None
    gain_std: float | None = None
    delay_std_s: float | None = None
    exclude: tuple[str, ...] = ()
    wide: bool = True
    sensors: tuple[str, ...] | None = None
    replay: int | None = 1


def fit_foot(
    study: Study | Recording | Iterable[Recording],
    foot: Foot,
    settings: Settings | None = None,
    *,
    advance: Advance = lambda what, done, total: None,
    interruptible: bool = True,
    **chosen: Any,
) -> FitResult:
    """Estimate a foot's parameters from recordings, pooled.

        result = fit_foot(study, load("two_dof"), free=["k_T", "k_F"], starts=4)

    Args:
        study: a study, or one or more recordings as read; they are checked here.
        foot: the model.
        settings: how to fit.
        advance: called with what is done, how many of how many, for a progress bar.
        interruptible: Ctrl-C ends the exploration only, and the result rests on the starts done.
        **chosen: fields of `Settings`, in place of those of `settings`.

    Raises:
        RecordingError: a recording cannot serve. SettingError: an option cannot be meant.
        SimulationError: no start led anywhere.
    """
    began = time.perf_counter()
    settings = _with(settings or Settings(), chosen)
    if not isinstance(foot, Foot):
        raise SettingError(f"the foot is {foot!r}; give a loaded model, load('two_dof') for example.")
    recordings = [study] if isinstance(study, Recording) else list(study)
    for each in recordings:
        if not isinstance(each, Recording):
            raise SettingError(
                f"one of the recordings is a {type(each).__name__}; give a Study or recordings: Recording.from_table "
                "makes one of a table, Recording.from_arrays of arrays."
            )
    with _blas().limit(limits=1):
        question = Question.of(recordings, foot, settings)
        if question.name == "periodic":
            result = _steady(question, settings, advance)
        else:
            result = _transient(question, settings, advance, interruptible)
    return replace(
        result,
        source=study.name if isinstance(study, Study) else result.source,
        provenance=provenance(settings, question.space, question.recordings),
        seconds=time.perf_counter() - began,
    )


def _steady(question: "Question", settings: Settings, advance: Advance) -> FitResult:
    """The fit of steady recordings: see steady.py."""
    problem = question.problem()
    tells = _tells_delay(question.recordings)
    allow = settings.wide and tells and any(item.kind != "delay" for item in problem.variables.nuisances)
    fitted = steady.fit(problem, question.foot, settings.starts, settings.seed, allow, advance)
    data = question.recordings
    built = [steady.branch_of(fitted, solution, data, question.foot) for solution in fitted.solutions]
    rank = excitation_rank(data)
    enough = allow or rank >= len(question.space.free)
    loads = len({recording.condition.added_mass_kg for recording in data})
    follow = allow and "load" not in question.known.excluded
    had = Had(loads, len(question.sensors), follow, enough)
    verdict = steady.verdict_of(fitted, built, had, question.why_not)
    solutions = list(fitted.solutions)
    if verdict.tied:
        solutions.sort(key=lambda solution: solution.branch)
        built.sort(key=lambda branch: branch.name)
    best = solutions[0]
    run = fitted.replays[best.branch]
    fits = steady.recordings_of(fitted, best, data)
    others = [b.world for b in built[1:] if b.world] if str(verdict) == "undecided" else []
    told = advice(built[0], question.space, rank, data, [f.fit_percent for f in fits], run.base_error, others)
    warnings = (*question.warnings, *told)
    result = FitResult(
        source=data[0].file,
        origin=_origin(data),
        model=question.foot.name,
        domain="periodic",
        branches=tuple(built),
        recordings=fits,
        verdict=str(verdict),
        reason=verdict.sentence,
        log_likelihood_ratio=verdict.log_likelihood_ratio,
        excitation_rank=rank,
        twin_mujoco_difference=run.difference,
        base_acceleration_error=run.base_error,
        starts=steady.start_rows(fitted),
        warnings=tuple(dict.fromkeys(warnings)),
        contact=contacts(best, data) if enough else (),
        evidence=Evidence(question.foot, data, question.two_mass, tuple(solutions), fitted.exact, fitted.replays),
    )
    return _only_what_holds(result, settings.wide and not allow)


def _only_what_holds(result: FitResult, trusts: bool) -> FitResult:
    """No interval that the sines hold too few numbers for; a warning where nothing beside the model was allowed for."""
    if not result.trusting:
        result = replace(result, branches=tuple(map(without_exact, result.branches)))
    if trusts and (result.trusting or result.verdict == "decided"):  # else neither interval nor odds are offered
        text = _TRUSTS if result.trusting else _TRUSTS_NOT
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


def _with(settings: Settings, chosen: Mapping[str, Any]) -> Settings:
    """Settings with some fields given as keywords."""
    known = [field.name for field in fields(Settings)]
    for name in chosen:
        if name not in known:
            raise SettingError(f"{unknown('setting', name, known)}.")
    free = chosen.get("free", settings.free)
    if isinstance(free, str):
        raise SettingError(f'free is {free!r}; give a list of names, for example free=["{free}"].')
    settings = replace(settings, **{**chosen, "free": None if free is None else tuple(free)})
    if isinstance(settings.sensors, str):
        raise SettingError(f'sensors is {settings.sensors!r}; give a list of names, ["malleolus", "foot"] for example.')
    if isinstance(settings.exclude, str):
        raise SettingError(f'exclude is {settings.exclude!r}; give a list of names, for example exclude=["mount"].')
    for name, what, least in (
        ("starts", "number of starts", 1),
        ("seed", "seed", 0),
        ("threads", "number of threads", 0),
        ("replay", "number of recordings to replay", 0),
    ):
        value = getattr(settings, name)
        if name == "replay" and value is None:
            continue
        if not isinstance(value, int | np.integer) or value < least:
            raise SettingError(f"the {what} is {value!r}; give a whole number, {least} or more.")
    return settings


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked, before anything is fitted.

    Attributes:
        foot: the model. recordings: checked. sensors: that are fitted, the malleolus first.
        carriers: which mass each sensor of the two-mass foot reads, nothing for other models.
        name: of the domain, "periodic" or "time". space: the free constants; in the time domain the delay is one.
        delay: whether a delay is estimated. why_not: why there is no mirror image, or nothing.
        known: of what else may be true. warnings: so far.
    """

    foot: Foot
    recordings: list[Recording]
    sensors: tuple[str, ...]
    carriers: Mapping[str, str]
    name: str
    space: Space
    delay: bool
    why_not: str
    known: Known
    warnings: tuple[str, ...]

    @property
    def two_mass(self) -> bool:
        """Whether the model is the two-mass foot with its sensors on the two masses."""
        return self.carriers.get(MALLEOLUS[0]) == SHANK and all(name in self.carriers for name in self.sensors)

    @classmethod
    def of(cls, recordings: Sequence[Recording], foot: Foot, settings: Settings) -> "Question":
        """Check the recordings, choose the domain, and open the space.

        Raises:
            RecordingError, SettingError: see `fit_foot`.
        """
        if not recordings:
            raise RecordingError("there is no recording to fit.")
        told = {name: getattr(settings, name) for name in ("mass_std", "gain_std", "delay_std_s", "exclude")}
        known = Known.of_all([recording.known for recording in recordings]).told(**told)
        apart(recordings)
        data = [_calibrated(checked(recording), known) for recording in recordings]
        warnings = gathered([text for recording in data for text in recording.warnings])
        people = list(dict.fromkeys(r.condition.subject for r in data))
        if len(people) > 1:
            names = ", ".join(person or "unnamed" for person in people)
            warnings.append(_PEOPLE.format(n=len(people), names=names))
        name, why = choose_domain(data, settings.domain)
        warnings += why
        none = known.delay_std_s == 0.0  # known exactly, so there is nothing to estimate
        delay = _tells_delay(data) and not none if settings.delay is None else settings.delay
        if not delay and not none and settings.delay is None:
            warnings.append("One frequency cannot tell a delay between the channels from damping: it is held at zero.")
        fitted, passed_over = sensors.chosen(data, foot, settings.sensors)
        warnings += passed_over
        space = space_of(foot, settings.free, settings.bounds, delay and name == "time", fitted)
        if any("m_F" not in r.condition.masses for r in data) and set(MASSES) & set(foot.parameters):
            held = ", ".join(f"{n} {v:.3g} kg" for n, v in foot.values().items() if n in MASSES)
            warnings.append(f"The body mass is unknown, so the model's own masses are used ({held}); give --body-mass.")
        why_not = branches.has_mirror(space.names, foot.parameters)
        return cls(foot, data, fitted, carriers(foot), name, space, delay, why_not, known, tuple(warnings))

    def problem(self) -> Problem:
        """The one problem of its recordings, which are steady."""
        on = [self.carriers.get(sensor) == FOOT for sensor in self.sensors] if self.two_mass else None
        space = self.space if self.name == "periodic" else without_delay(self.space)
        return steady.problem_of(self.recordings, self.foot, space, self.known, self.sensors, on, self.delay)


def _calibrated(recording: Recording, known: Known) -> Recording:
    """A recording whose channels are as alike as a laboratory or a user says, in place of what each channel states."""
    told: dict[str, Any] = {
        name: value
        for name, value in (("gain_std", known.gain_std), ("delay_std_s", known.delay_std_s))
        if value is not None
    }
    if not told:
        return recording
    base, malleolus = (recording.calibration.get(name, Channel()) for name in ("base", "malleolus"))
    none: dict[str, Any] = dict.fromkeys(told, 0.0)
    exact = replace(base, **none)
    channels = {**recording.calibration, "base": exact, "malleolus": replace(malleolus, **told)}
    return replace(recording, calibration=channels)


def _tells_delay(data: Sequence[Recording]) -> bool:
    """Several frequencies, or broadband excitation, tell a delay from damping."""
    found = {round(r.condition.frequency_hz, 1) if r.condition.frequency_hz else None for r in data}
    return len(found) > 1 or None in found


def _transient(question: Question, settings: Settings, advance: Advance, interruptible: bool) -> FitResult:
    """The fit of every sample: see transient.py."""
    found = transient.fit(
        question, settings.starts, settings.seed, settings.threads, settings.replay, advance, interruptible
    )
    data, space = question.recordings, question.space
    built = [branch_of(c, space) for c in found.branches]
    first, run = built[0], found.branches[0].run
    last = built[-1].parameters
    rests = branches.pinned({key: e.at_bound for key, e in last.items()}, {key: e.value for key, e in last.items()})
    rank = excitation_rank(data)
    loads = len({recording.condition.added_mass_kg for recording in data})
    had = Had(loads, len(question.sensors), False, rank >= len(space.free))
    names, deviances = [b.name for b in built], [b.deviance for b in built]
    verdict = branches.judge(names, deviances, first.chi_square, first.dof, rests, had)
    if question.why_not or found.left_out:
        why = question.why_not or branches.LEFT_OUT.format(name=found.left_out[0])
        verdict = Verdict("not compared", 0.0, why)
    certified = list(found.branches)
    if verdict.tied:
        certified.sort(key=lambda c: c.name)
        built.sort(key=lambda b: b.name)
    told = advice(built[0], space, rank, data, run.fits, run.base_error)
    result = FitResult(
        source=data[0].file,
        origin=_origin(data),
        model=question.foot.name,
        domain="time",
        branches=tuple(map(trusting, built)),
        recordings=tuple(
            RecordingFit.of(r, f, y, each)
            for r, f, y, each in zip(data, run.fits, run.traces, certified[0].sensors(data), strict=True)
        ),
        verdict=str(verdict),
        reason=verdict.sentence,
        log_likelihood_ratio=verdict.log_likelihood_ratio,
        excitation_rank=rank,
        twin_mujoco_difference=run.twin_difference,
        base_acceleration_error=run.base_error,
        starts=found.starts,
        warnings=tuple(dict.fromkeys((*question.warnings, *found.warnings, *told))),
        evidence=Evidence(question.foot, data, question.two_mass, (), {}, {}, space, tuple(certified)),
    )
    return _only_what_holds(result, settings.wide)
