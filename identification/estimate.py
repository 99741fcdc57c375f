"""The fit of a foot model to recordings: explore, follow both branches, certify in MuJoCo, judge."""

import functools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from fasbody.exceptions import RecordingError, SettingError, SimulationError, unknown
from fasbody.foot.model import Foot
from fasbody.presentation import Tabled
from fasbody.recording.checks import apart, checked, gathered
from fasbody.recording.known import Known
from fasbody.recording.recording import UNSTATED, Channel, Recording
from fasbody.recording.study import Study
from identification import branches, search, sensors
from identification.advice import advice, excitation_rank
from identification.branches import STIFF_ANKLE, STIFF_PAD, Had, Verdict
from identification.certification import Certified, branch_of, certify_first
from identification.domains import Domain, PeriodicDomain, TimeDomain, choose_domain, steady
from identification.engines.engine import stated
from identification.engines.twin import twin_applies
from identification.evidence import Evidence, provenance
from identification.lifting import contacts
from identification.result import FitResult, RecordingFit
from identification.search import ZERO, Descent
from identification.space import MASSES, Space, space_of
from identification.wide import End, trusting, untold, widened, widest

#: Rounds of as many random starts again, while a recording that the parameters can follow exactly is not followed.
_MORE_ROUNDS = 3
#: Ends of a branch whose mirror images are entered, and by which share of the cost they must differ.
_IMAGES, _APART = 4, 1e-2
_LEFT_OUT = "The {name} branch is left out: the motions at its best ends do not last in MuJoCo."
_LOST = (
    "No branch is decided, as the model does not follow the recordings, whatever else may be true (chi-square "
    "{per:.3g} per degree of freedom)."
)
_UNSETTLED = (
    "No branch is decided, as the fit that allows for whatever else may be true has not come to rest; more starts or "
    "what the laboratory knows ([known] in study.toml) may help."
)
_ELSEWHERE = (
    "The model alone has no end on the {name} branch: on the {other} branch it comes to chi-square {per:.4g} per "
    "degree of freedom. The table rests on whatever else may be true."
)
_TRUSTS = (
    "These intervals and odds trust the model, the stated masses and the instrument: whatever else may be true is "
    "allowed for only where all recordings are settled sines, at several frequencies."
)
_TRUSTS_NOT = (
    "The odds trust the model, the stated masses and the instrument: whatever else may be true is allowed for only "
    "where all recordings are settled sines, at several frequencies."
)
_PEOPLE = "The recordings are of {n} people or feet ({names}), and one set of constants is fitted to all of them."
_PASSED_OVER = "The best end of the {name} branch was passed over: its motion does not last in MuJoCo."

#: Called with what is done, how many, and of how many.
Advance = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Settings(Tabled):
    """How to fit.

    Attributes:
        free: parameters to estimate, None for all the model declares but the masses.
        bounds: name -> (lower, upper), None for the model's own.
        starts: how many starts, the model's values and their mirror image included (default 8).
        seed: of the random starts (default 0).
        domain: "auto" (default), "periodic" or "time".
        delay: estimate the delay between the channels; None for where it can be told.
        threads: of the search, 0 for all cores (default).
        mass_std: relative standard deviation of the segment masses; None for what study.toml says, or 0.1.
        gain_std: that of the malleolus' gain; None for what study.toml says, or 0.01.
        delay_std_s: that of the delay between the channels [s]; None for what study.toml says, or a tenth of a sample.
        exclude: what cannot be beside the model, of `known.DEPARTURES`, or "all"; nothing unless given.
        sensors: accelerometers to fit, None for all that model and recordings have by the same name.
        wide: fit each branch once more with whatever else may be true; without, all words hold if the model is true.
        replay: recordings in a steady state that MuJoCo runs from end to end, None for all; of the others one period,
            where the compiled twin has shown to be the same model, which runs the rest. In the time domain all, or none
            for 0.

    In the time domain, steady recordings are explored on their harmonics, and fitted to every sample from there.
    """

    free: tuple[str, ...] | None = None
    bounds: Mapping[str, tuple[float, float]] | None = None
    starts: int = 8
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
        explored = explore(question, settings, advance, interruptible)
        answer = certify(question, explored, advance)
        ends = widen(question, answer, advance) if settings.wide else []
        result = judge(question, explored, answer, ends)
    if settings.wide and not result.trusting:
        result = replace(result, branches=tuple(map(untold, result.branches)))
    elif settings.wide and result.wide is None:
        result = replace(result, branches=tuple(map(trusting, result.branches)))
    told = result.trusting or result.verdict == "decided"  # else neither interval nor odds are
    if told and settings.wide and result.wide is None and not _can_widen(question):
        result = replace(result, warnings=(*result.warnings, _TRUSTS if result.trusting else _TRUSTS_NOT))
    return replace(
        result,
        source=study.name if isinstance(study, Study) else result.source,
        provenance=provenance(settings, question.space, question.domain.recordings),
        evidence=Evidence(question.domain, question.space, answer.branches, ends),
        seconds=time.perf_counter() - began,
    )


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
    """A fit before it begins.

    Attributes:
        domain: recordings and model. name: of the domain. space: what is searched. ratio: of the mirror image
            (`branches.ratio`), None where there is none. why_not: the reason for that. known: of what else may be
            true. warnings: so far.
    """

    domain: Domain
    name: str
    space: Space
    ratio: float | None
    why_not: str
    known: Known
    warnings: tuple[str, ...]

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
        space = space_of(foot, settings.free, settings.bounds, delay, fitted)
        if any("m_F" not in r.condition.masses for r in data) and set(MASSES) & set(foot.parameters):
            held = ", ".join(f"{n} {v:.3g} kg" for n, v in foot.values().items() if n in MASSES)
            warnings.append(f"The body mass is unknown, so the model's own masses are used ({held}); give --body-mass.")
        kind = PeriodicDomain if name == "periodic" else TimeDomain
        domain = kind(foot, data, space, twin_applies(foot, fitted), settings.threads, fitted, settings.replay)
        why_not = branches.has_mirror(space.names, foot.parameters)
        ratio = None if why_not else branches.ratio([r.condition.masses for r in data], foot.values())
        return cls(domain, name, space, ratio, why_not, known, tuple(warnings))

    def side(self, descent: Descent) -> str:
        """The branch on which a descent ended."""
        return "best" if self.ratio is None else branches.side(self.space.values(descent.theta), self.ratio)


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


@dataclass(frozen=True, eq=False)
class Explored:
    """Where the starts led.

    Attributes:
        descents: of all starts, best first. ends: those of each branch, best first, with what their mirror images led
            to. warnings: if the exploration was interrupted.
    """

    descents: list[Descent]
    ends: Mapping[str, list[Descent]]
    warnings: tuple[str, ...]


def explore(question: Question, settings: Settings, advance: Advance, interruptible: bool) -> Explored:
    """Descend from all starts on the fastest engine, weighed by the noise alone.

    Raises:
        SimulationError: no start has a steady motion.
    """
    space, foot = question.space, question.domain.foot
    scout = _scout(question.domain)
    rng = np.random.default_rng(settings.seed)
    starts = _starts(question, settings, rng)
    problem = scout.problem()
    counter = iter(range(1, len(starts) + 1))
    descents, interrupted = search.explore(
        problem, starts, lambda: advance("exploring starts", next(counter), len(starts))
    )
    if interrupted and not interruptible:
        raise KeyboardInterrupt
    for more in range(_MORE_ROUNDS):
        if interrupted or not _astray(descents[0], problem.size, space):
            break
        again = [(f"random {more + 1}.{i + 1}", space.random(rng)) for i in range(settings.starts)]
        others, interrupted = search.explore(problem, again)
        descents = sorted([*descents, *others], key=lambda d: d.cost)
    warnings: tuple[str, ...] = ()
    if interrupted:
        warnings = (f"Interrupted after {len(descents)} of {len(starts)} starts; the result rests on those.",)
    if descents[0].unstable:
        raise search.lost(foot, space, descents, question.domain.recordings)
    return Explored(descents, _a_branch_each(question, scout, descents), warnings)


def _scout(domain: Domain) -> Domain:
    """Steady recordings are explored on their harmonics: there the same foot is found a hundred times sooner."""
    if isinstance(domain, PeriodicDomain) or steady(domain.recordings):
        made = (domain.foot, domain.recordings, domain.space, domain.twin, domain.threads, domain.sensors)
        return PeriodicDomain(*made, excess=np.inf)
    return domain


def _starts(question: Question, settings: Settings, rng: np.random.Generator) -> list[tuple[str, np.ndarray]]:
    """The model's own values, their mirror image, and random points."""
    space, values = question.space, question.domain.foot.values()
    starts = [("model", space.to_q(space.theta(values)))]
    if question.ratio is not None:
        image = branches.mirrored(values, question.ratio)
        starts.append(("mirror of the model", space.to_q(space.theta(image))))
    starts += [(f"random {i + 1}", space.random(rng)) for i in range(settings.starts)]
    return starts[: settings.starts]


def _astray(best: Descent, numbers: int, space: Space) -> bool:
    """Whether the best end misses by more than the noise, though the parameters can follow so few numbers exactly."""
    return numbers <= space.lower.size and best.cost > numbers


def _a_branch_each(question: Question, scout: Domain, descents: list[Descent]) -> dict[str, list[Descent]]:
    """The descents of each branch, best first; mirror images of the other's best ends are entered, too."""
    if question.ratio is None:
        return {"best": descents}
    space = question.space
    found: dict[str, list[Descent]] = {}
    for descent in descents:
        found.setdefault(question.side(descent), []).append(descent)
    problem = scout.problem()
    entered: dict[str, list[Descent]] = {}
    for name, other in ((STIFF_ANKLE, STIFF_PAD), (STIFF_PAD, STIFF_ANKLE)):
        for end in _distinct(found.get(other, [])):
            image = branches.mirrored(space.values(end.theta), question.ratio)
            there = search.descend(problem, space.to_q(space.theta(image)), f"mirror of {other}")
            if question.side(there) == name:
                entered.setdefault(name, []).append(there)
    names = [*found, *(name for name in entered if name not in found)]
    return {name: sorted([*found.get(name, []), *entered.get(name, [])], key=lambda d: d.cost) for name in names}


def _distinct(descents: Sequence[Descent]) -> list[Descent]:
    """The best few that end at different costs."""
    kept: list[Descent] = []
    for descent in descents:
        if len(kept) < _IMAGES and all(abs(descent.cost - k.cost) > _APART * k.cost + ZERO for k in kept):
            kept.append(descent)
    return kept


@dataclass(frozen=True, eq=False)
class Answer:
    """What MuJoCo confirms.

    Attributes:
        branches: converged there, likeliest first. left_out: names of those that do not last. warnings: on both.
    """

    branches: list[Certified]
    left_out: tuple[str, ...]
    warnings: tuple[str, ...]


def certify(question: Question, explored: Explored, advance: Advance) -> Answer:
    """Converge the best end of each branch on the MuJoCo rollout.

    Raises:
        SimulationError: no motion lasts.
    """
    # both branches beside the same misfit, or their odds would mean nothing
    domain = question.domain.weighed(explored.descents[0].z)
    certified: list[Certified] = []
    left_out: list[str] = []
    warnings: list[str] = []
    for number, (name, ends) in enumerate(explored.ends.items()):
        advance("certifying in MuJoCo", number, len(explored.ends))
        found, skipped = certify_first(domain, name, ends)
        if found:
            certified.append(found)
        else:
            left_out.append(name)
        if skipped:
            warnings.append((_PASSED_OVER if found else _LEFT_OUT).format(name=name))
    if not certified:
        best = stated(domain.foot, domain.space.values(explored.descents[0].theta))
        raise SimulationError(
            f"{domain.foot.name}: the best parameter sets are all unstable over the recordings (the best: {best})."
        )
    return Answer(sorted(certified, key=lambda c: c.deviance), tuple(left_out), tuple(warnings))


def _can_widen(question: Question) -> bool:
    return question.name == "periodic" and _tells_delay(question.domain.recordings)


def widen(question: Question, answer: Answer, advance: Advance) -> list[End]:
    """Each branch once more with whatever else may be true; nothing for one frequency or in the time domain."""
    if not _can_widen(question):
        return []
    advance("allowing for whatever else may be true", 0, 1)
    return widest(question.domain, question.space, question.ratio, answer.branches, question.known, answer.left_out)


def judge(question: Question, explored: Explored, answer: Answer, ends: Sequence[End]) -> FitResult:
    """Compare the branches, and say what the data tell of the foot."""
    data, certified = question.domain.recordings, answer.branches
    built = [branch_of(c, question.space) for c in certified]
    first, deviances, excess = built[0], [b.deviance for b in built], built[0].chi_square
    if ends:
        narrow = {b.name: b for b in built}
        built = [widened(end, narrow.get(end.name), question.space, first.dof) for end in ends]
        deviances, excess = [end.objective for end in ends], 0.0  # what else may be true has explained the misfit
        certified = sorted(certified, key=lambda c: [b.name for b in built].index(c.name))
    last = built[-1].parameters
    rests = branches.pinned({key: e.at_bound for key, e in last.items()}, {key: e.value for key, e in last.items()})
    loads = len({recording.condition.added_mass_kg for recording in data})
    follow = bool(ends) and "load" not in question.known.excluded
    rank = excitation_rank(data)
    enough = bool(ends) or rank >= len(question.space.free)
    had = Had(loads, len(question.domain.sensors), follow, enough)
    verdict = branches.judge([b.name for b in built], deviances, excess, first.dof, rests, had)
    if verdict.tied:
        certified = sorted(certified, key=lambda c: c.name)
        built.sort(key=lambda b: b.name)
    wide = built[0].world
    if wide is not None and not wide.follows and len(built) > 1:
        verdict = Verdict("undecided", verdict.log_likelihood_ratio, _LOST.format(per=wide.per_dof))
    if verdict.word == "decided" and not all(end.converged for end in ends):
        verdict = Verdict("undecided", verdict.log_likelihood_ratio, _UNSETTLED)
    best = certified[0].run
    if question.why_not or answer.left_out:
        why = question.why_not or _LEFT_OUT.format(name=answer.left_out[0])
        verdict = Verdict("not compared", 0.0, why)
    warnings = (*question.warnings, *explored.warnings, *answer.warnings)
    undecided = str(verdict) == "undecided"
    others = [b.world for b in built[1:] if b.world] if undecided else []
    warnings += tuple(advice(built[0], question.space, rank, data, best, others))
    if ends and built[0].name not in narrow:
        warnings += (_ELSEWHERE.format(name=built[0].name, other=first.name, per=first.chi_square / max(1, first.dof)),)
    return FitResult(
        source=data[0].file,
        origin=next((o for o in ("synthetic", UNSTATED) if any(r.origin == o for r in data)), "measured"),
        model=question.domain.foot.name,
        domain=question.name,
        branches=tuple(built),
        recordings=tuple(
            RecordingFit.of(r, f, y, each)
            for r, f, y, each in zip(data, best.fits, best.traces, certified[0].sensors(data), strict=True)
        ),
        verdict=str(verdict),
        reason=verdict.sentence,
        log_likelihood_ratio=verdict.log_likelihood_ratio,
        excitation_rank=rank,
        twin_mujoco_difference=best.twin_difference,
        base_acceleration_error=best.base_error,
        starts=tuple(_start_row(question, descent) for descent in explored.descents),
        warnings=tuple(dict.fromkeys(warnings)),
        contact=contacts(certified[0], question.domain.foot, data) if enough else (),
    )


def _start_row(question: Question, descent: Descent) -> dict[str, object]:
    row: dict[str, object] = {"start": descent.label, "cost": descent.cost, "evaluations": descent.evaluations}
    row |= {"converged": descent.converged, "branch": question.side(descent)}
    return row | {item.key: float(value) for item, value in zip(question.space.free, descent.theta, strict=True)}
