"""The fit of a foot model to recordings: explore, follow both branches, certify in MuJoCo, judge."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import UNSTATED, Recording
from identification.advice import advice
from identification.branches import STIFF_ANKLE, STIFF_PAD, Verdict, has_mirror, judge, mirrored, pinned, ratio, side
from identification.certification import branch_of, certify_first
from identification.domains import PeriodicRoute, Route, TimeRoute, choose_domain, steady
from identification.engines.orbits import twin_applies
from identification.excitation import excitation_rank
from identification.result import FitResult, RecordingFit
from identification.search import ZERO, Descent, descend, explore
from identification.space import MASSES, Space, space_of

#: Rounds of as many random starts again, while a recording that the parameters can follow exactly is not followed.
_MORE_ROUNDS = 3
#: Ends of a branch whose mirror images are entered, and by which share of the cost they must differ.
_IMAGES, _APART = 4, 1e-2
_LEFT_OUT = "The {name} branch is left out: the motions at its best ends do not last in MuJoCo."
_PASSED_OVER = "The best end of the {name} branch was passed over: its motion does not last in MuJoCo."


@dataclass(frozen=True)
class Settings:
    """How to fit.

    Attributes:
        free: parameters to estimate, None for all the model declares but the masses. bounds: name -> (lower, upper).
        starts: how many starts, the model's values and their mirror image included. seed: of the random ones.
        domain: "auto", "periodic" or "time". delay: estimate the delay between the channels. threads: 0 for all cores.

    In the time domain, steady recordings are explored on their harmonics, and fitted to every sample from there.
    """

    free: tuple[str, ...] | None = None
    bounds: Mapping[str, tuple[float, float]] | None = None
    starts: int = 8
    seed: int = 0
    domain: str = "auto"
    delay: bool | None = None
    threads: int = 0


def fit(
    recordings: Sequence[Recording],
    foot: Foot,
    settings: Settings | None = None,
    *,
    source: str = "",
    truth: Mapping[str, float] | None = None,
    advance: Callable[[str, int, int], None] = lambda what, done, total: None,
    interruptible: bool = True,
) -> FitResult:
    """Estimate a foot's parameters from recordings, pooled.

    Args:
        recordings: as read; they are checked here. foot: the model. settings: how.
        source: what to call the data. truth: known parameters of synthetic data, reported beside the estimate.
        advance: called with what is done, how many of how many, for a progress bar.
        interruptible: Ctrl-C ends the exploration only, and the result rests on the starts done.

    Raises:
        RecordingError: a recording cannot serve. SettingError: an option cannot be meant.
        SimulationError: no start led anywhere.
    """
    began = time.perf_counter()
    settings = settings or Settings()
    if settings.starts < 1:
        raise SettingError(f"the number of starts is {settings.starts}; at least one is needed.")
    data = [checked(recording) for recording in recordings]
    warnings = [text for recording in data for text in recording.warnings]
    domain, why = choose_domain(data, settings.domain)
    warnings += why
    twin = twin_applies(foot)
    delay = _tells_delay(data) if settings.delay is None else settings.delay
    if not delay:
        warnings.append("One frequency cannot tell a delay between the channels from damping: it is held at zero.")
    space = space_of(foot, settings.free, settings.bounds, delay)
    if any(not r.condition.masses for r in data) and set(MASSES) & set(foot.parameters):
        held = ", ".join(f"{n} {v:.3g} kg" for n, v in foot.values().items() if n in MASSES)
        warnings.append(f"The body mass is unknown, so the model's own masses are used ({held}); give --body-mass.")
    route: Route = (PeriodicRoute if domain == "periodic" else TimeRoute)(foot, data, space, twin, settings.threads)

    masses = [recording.condition.masses for recording in data]
    why_not = has_mirror(space.names, foot.parameters)
    mirror = not why_not
    a = ratio(masses, foot.values()) if mirror else 1.0
    rng = np.random.default_rng(settings.seed)
    starts = _starts(space, foot, settings, a if mirror else None, rng)
    scout = route
    if domain == "time" and steady(data):  # the same foot is found a hundred times sooner on the harmonics
        scout = PeriodicRoute(foot, data, space, twin, settings.threads)
    scout = scout.exploring()
    problem = scout.explorer()
    counter = iter(range(1, len(starts) + 1))
    descents, interrupted = explore(problem, starts, lambda: advance("exploring starts", next(counter), len(starts)))
    if interrupted and not interruptible:
        raise KeyboardInterrupt
    for more in range(_MORE_ROUNDS):
        if interrupted or not _astray(descents[0], problem.size, space):
            break
        again = [(f"random {more + 1}.{i + 1}", space.random(rng)) for i in range(settings.starts)]
        others, interrupted = explore(problem, again)
        descents = sorted([*descents, *others], key=lambda d: d.cost)
    if interrupted:
        warnings.append(f"Interrupted after {len(descents)} of {len(starts)} starts; the result rests on those.")
    if descents[0].unstable:
        raise SimulationError(f"{foot.name}: every start was unstable; check the bounds and the model's parameters.")

    route = route.weighed(descents[0].z)  # both branches beside the same misfit, or their odds would mean nothing
    chosen = _a_branch_each(scout, descents, space, a) if mirror else {"best": descents}
    certified = []
    for number, (name, candidates) in enumerate(chosen.items()):
        advance("certifying in MuJoCo", number, len(chosen))
        found, skipped = certify_first(route, name, candidates)
        if found:
            certified.append(found)
        if skipped:
            warnings.append((_PASSED_OVER if found else _LEFT_OUT).format(name=name))
    if not certified:
        raise SimulationError(f"{foot.name}: the best parameter sets are all unstable over the recordings.")
    certified.sort(key=lambda c: c.deviance)
    built = [branch_of(route, c, space) for c in certified]
    rests = pinned({key: e.at_bound for key, e in built[-1].parameters.items()})
    verdict = judge([b.name for b in built], [b.deviance for b in built], built[0].chi_square, built[0].dof, rests)
    if verdict.tied:
        certified.sort(key=lambda c: c.name)
        built.sort(key=lambda b: b.name)
    best = certified[0].run
    left_out = [name for name in chosen if name not in {c.name for c in certified}]
    if not mirror or left_out:
        verdict = Verdict("not compared", 0.0, why_not or _LEFT_OUT.format(name=left_out[0]))
    rank = excitation_rank(data)
    warnings += advice(built[0], space, rank, data, best, verdict)
    return FitResult(
        source=source or data[0].file,
        origin=next((o for o in ("synthetic", UNSTATED) if any(r.origin == o for r in data)), "measured"),
        model=foot.name,
        domain=domain,
        branches=tuple(built),
        recordings=tuple(RecordingFit.of(r, f, y) for r, f, y in zip(data, best.fits, best.traces, strict=True)),
        verdict=str(verdict),
        reason=verdict.sentence,
        log_likelihood_ratio=verdict.log_likelihood_ratio,
        excitation_rank=rank,
        twin_mujoco_difference=best.twin_difference,
        base_acceleration_error=best.base_error,
        starts=tuple(_start_row(d, space, a if mirror else None) for d in descents),
        warnings=tuple(dict.fromkeys(warnings)),
        truth=dict(truth or {}),
        seconds=time.perf_counter() - began,
    )


def _tells_delay(data: Sequence[Recording]) -> bool:
    """Several frequencies, or broadband excitation, tell a delay from damping."""
    found = {round(r.condition.frequency_hz, 1) if r.condition.frequency_hz else None for r in data}
    return len(found) > 1 or None in found


def _astray(best: Descent, numbers: int, space: Space) -> bool:
    """Whether the best end misses by more than the noise, though the parameters can follow so few numbers exactly."""
    return numbers <= space.lower.size and best.cost > numbers


def _starts(
    space: Space, foot: Foot, settings: Settings, a: float | None, rng: np.random.Generator
) -> list[tuple[str, np.ndarray]]:
    """The model's own values, their mirror image, and random points."""
    values = foot.values()
    starts = [("model", space.to_q(space.theta(values)))]
    if a is not None:
        starts.append(("mirror of the model", space.to_q(space.theta(mirrored(values, a)))))
    starts += [(f"random {i + 1}", space.random(rng)) for i in range(settings.starts)]
    return starts[: max(settings.starts, 1)]


def _a_branch_each(route: Route, descents: Sequence[Descent], space: Space, a: float) -> dict[str, list[Descent]]:
    """The descents of each branch, best first; mirror images of the other's best ends are entered, too."""
    found: dict[str, list[Descent]] = {}
    for descent in descents:
        found.setdefault(side(space.values(descent.theta), a), []).append(descent)
    problem = route.explorer()
    entered: dict[str, list[Descent]] = {}
    for name, other in ((STIFF_ANKLE, STIFF_PAD), (STIFF_PAD, STIFF_ANKLE)):
        for end in _distinct(found.get(other, [])):
            image = mirrored(space.values(end.theta), a)
            there = descend(problem, space.to_q(space.theta(image)), f"mirror of {other}")
            if side(space.values(there.theta), a) == name:
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


def _start_row(descent: Descent, space: Space, a: float | None) -> dict[str, object]:
    values = space.values(descent.theta)
    row: dict[str, object] = {"start": descent.label, "cost": descent.cost, "evaluations": descent.evaluations}
    row |= {"converged": descent.converged, "branch": side(values, a) if a is not None else "best"}
    return row | {item.key: float(value) for item, value in zip(space.free, descent.theta, strict=True)}


def fit_foot(study: Iterable[Recording], foot: Foot, settings: Settings | None = None, **fields: object) -> FitResult:
    """Estimate a foot's parameters from a study, or from recordings, pooled.

    Args:
        study: a study or recordings. foot: the model.
        settings: how. fields: of the settings, by name, in place of theirs.

    Raises:
        as `fit` does.
    """
    recordings = list(study)
    given = {name: tuple(value) if name == "free" and value is not None else value for name, value in fields.items()}  # type: ignore[arg-type]
    chosen = replace(settings or Settings(), **given)  # type: ignore[arg-type]
    return fit(recordings, foot, chosen, source=getattr(study, "name", ""), truth=getattr(study, "truth", {}))
