"""The fit of a foot model to recordings: explore, follow both branches, certify in MuJoCo, judge."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from fasbody.checks import checked
from fasbody.exceptions import SettingError, SimulationError
from fasbody.model import Foot
from fasbody.parameters import Parameter
from fasbody.recording import UNSTATED, Recording
from identification.branches import STIFF_ANKLE, STIFF_PAD, Verdict, has_mirror, judge, mirrored, ratio, side
from identification.excitation import excitation_rank
from identification.orbits import twin_applies
from identification.replay import Replay, replay
from identification.result import Branch, Estimate, FitResult, RecordingFit, identifiability
from identification.routes import PeriodicRoute, Route, TimeRoute, choose_domain, steady
from identification.search import Descent, descend, explore
from identification.space import MASSES, Space, space_of

#: Fit below which something is wrong [%], and error of the base above which the shaker is.
_POOR_FIT, _BASE_ERROR = 85.0, 1e-4
#: Rounds of reweighing: the weights depend on the model, and settle at once.
_REWEIGH = 2


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
    starts = _starts(space, foot, settings, a if mirror else None)
    scout = route
    if domain == "time" and steady(data):  # the same foot is found a hundred times sooner on the harmonics
        scout = PeriodicRoute(foot, data, space, twin, settings.threads)
    problem = scout.explorer()
    counter = iter(range(1, len(starts) + 1))
    descents, interrupted = explore(problem, starts, lambda: advance("exploring starts", next(counter), len(starts)))
    if interrupted and not interruptible:
        raise KeyboardInterrupt
    if interrupted:
        warnings.append(f"Interrupted after {len(descents)} of {len(starts)} starts; the result rests on those.")
    if descents[0].unstable:
        raise SimulationError(f"{foot.name}: every start was unstable; check the bounds and the model's parameters.")

    chosen = _one_a_branch(scout, descents, space, a) if mirror else {"best": descents[0]}
    certified = []
    for number, (name, descent) in enumerate(chosen.items()):
        advance("certifying in MuJoCo", number, len(chosen))
        certified.append(_certify(route, name, descent))
    certified.sort(key=lambda c: c.deviance)
    built = [_branch(route, c, space) for c in certified]
    best = certified[0].run
    verdict = judge([b.name for b in built], [b.deviance for b in built], built[0].chi_square, built[0].dof)
    if not mirror:
        verdict = Verdict("not compared", 0.0, why_not)
    rank = excitation_rank(data)
    warnings += _advice(built[0], space, rank, data, best, verdict)
    return FitResult(
        source=source or data[0].file,
        origin=next((o for o in ("synthetic", UNSTATED) if any(r.origin == o for r in data)), "measured"),
        model=foot.name,
        domain=domain,
        branches=tuple(built),
        recordings=tuple(
            RecordingFit(r.file, r.condition.frequency_hz, r.condition.added_mass_kg, f, r.time_s, r.malleolus_m_s2, y)
            for r, f, y in zip(data, best.fits, best.traces, strict=True)
        ),
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


def _starts(space: Space, foot: Foot, settings: Settings, a: float | None) -> list[tuple[str, np.ndarray]]:
    """The model's own values, their mirror image, and random points."""
    values = foot.values()
    starts = [("model", space.to_q(space.theta(values)))]
    if a is not None:
        starts.append(("mirror of the model", space.to_q(space.theta(mirrored(values, a)))))
    rng = np.random.default_rng(settings.seed)
    starts += [(f"random {i + 1}", space.random(rng)) for i in range(settings.starts)]
    return starts[: max(settings.starts, 1)]


def _one_a_branch(route: Route, descents: Sequence[Descent], space: Space, a: float) -> dict[str, Descent]:
    """The best descent of each branch; a branch without one is entered from the mirror image of the other."""
    found: dict[str, Descent] = {}
    for descent in descents:
        found.setdefault(side(space.values(descent.theta), a), descent)
    problem = route.explorer()
    for name, other in ((STIFF_ANKLE, STIFF_PAD), (STIFF_PAD, STIFF_ANKLE)):
        if other in found:
            image = mirrored(space.values(found[other].theta), a)
            entered = descend(problem, space.to_q(space.theta(image)), f"mirror of {other}")
            if side(space.values(entered.theta), a) == name and entered.cost < found.get(name, entered).cost * (
                1 + 1e-9
            ):
                found[name] = entered
    return found


@dataclass(frozen=True, eq=False)
class _Certified:
    """A branch converged on the MuJoCo rollout."""

    name: str
    problem: Any
    descent: Descent
    deviance: float
    run: Replay


def settle(route: Route, descent: Descent) -> tuple[Any, Descent]:
    """Bring the weights up to date at a descent's end and go on from there: the problem so weighted, and the end."""
    problem = route.explorer()
    q = route.space.to_q(descent.theta)
    z = descent.z if descent.z.size == problem.bounds[0].size else problem.start(q)  # explored in the other domain
    for _ in range(_REWEIGH if route.chi_square else 1):  # without chi-square the weights stay
        route.reweigh(problem, descent)
        descent = descend(problem, route.space.to_q(descent.theta), descent.label, z0=z, tight=True)
        z = descent.z
    return problem, descent


def standard_errors(problem: Any, descent: Descent, dof: int, chi_square: bool) -> tuple[np.ndarray, np.ndarray]:
    """Standard errors (p,) and covariance (p, p) of q; a misfit beyond the noise widens the former, NaN at a bound."""
    covariance = problem.covariance(descent.z, ~problem.space.at_bound(descent.theta))
    excess = max(1.0, descent.cost / dof) if chi_square and dof else 1.0
    return np.sqrt(np.diag(covariance) * excess), covariance


def _certify(route: Route, name: str, descent: Descent) -> _Certified:
    """Settle the weights, converge on the MuJoCo rollout, and run the recordings."""
    problem, descent = settle(route, descent)
    final = route.certifier(problem)
    descent = descend(final, route.space.to_q(descent.theta), descent.label, z0=descent.z, tight=True)
    starts = [route.initial_states(final, descent, number) for number in range(len(route.recordings))]
    run = replay(route.foot, route.recordings, route.space.values(descent.theta), starts, route.twin, route.threads)
    return _Certified(name, final, descent, descent.cost + final.log_determinant, run)


def _branch(route: Route, certified: _Certified, space: Space) -> Branch:
    """Estimates with standard errors from the Jacobian at MuJoCo's optimum."""
    problem, descent, run = certified.problem, certified.descent, certified.run
    dof = max(0, problem.size - descent.z.size)
    std_q, covariance = standard_errors(problem, descent, dof, route.chi_square)
    at_bound = space.at_bound(descent.theta)
    theta = space.snapped(descent.theta)
    low, high = space.interval(theta, std_q)
    std = std_q * space.slope(theta)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    return Branch(
        name=certified.name,
        cost=descent.cost,
        deviance=certified.deviance,
        fit_percent=float(np.mean(run.fits)),
        parameters={
            item.key: Estimate(
                float(v), float(s), float(lo), float(hi), bool(b), identifiability(v, s, _size(item), bool(b))
            )
            for item, v, s, lo, hi, b in zip(space.free, theta, std, low, high, at_bound, strict=True)
        },
        correlation=np.nan_to_num(correlation).tolist(),
        chi_square=descent.cost,
        dof=dof,
        p_value=float(chi2.sf(descent.cost, dof)) if route.chi_square and dof else None,
    )


def _size(item: Parameter) -> float:
    """A value that matters of a parameter that may be zero: a tenth of the way to its bound."""
    return 0.0 if item.logarithmic else 0.1 * max(abs(item.lower), abs(item.upper))


def _advice(
    best: Branch, space: Space, rank: int, data: Sequence[Recording], run: Replay, verdict: Verdict
) -> list[str]:
    """Warnings that a careful colleague would give."""
    texts = []
    poor = [(fit, r.file) for fit, r in zip(run.fits, data, strict=True) if fit < _POOR_FIT]
    if poor:
        fit, file = min(poor)
        texts.append(
            f"The model follows {file} only to {fit:.0f} %: check that its channels are aligned and in the right unit, "
            "that it is this foot, and that the bounds hold the answer."
        )
    if run.base_error > _BASE_ERROR:
        texts.append(f"The model's base misses the prescribed acceleration by {run.base_error:.1e} of its peak.")
    if best.dof == 0:
        texts.append(
            f"The recordings hold no more numbers than the {len(space.free)} free parameters: they are fitted exactly "
            "whatever the truth, so goodness of fit says nothing. Pool several frequencies or free fewer (--free)."
        )
    if rank < len(space.free):
        texts.append(
            f"The excitation has rank {rank}, fewer than the {len(space.free)} free parameters: only distortion by the "
            "nonlinear dampers tells more. Pool several frequencies."
        )
    bound = [key for key, e in best.parameters.items() if e.at_bound]
    zero = [key for key in bound if best.parameters[key].value == 0.0]
    if zero:
        texts.append(f"At zero: {', '.join(zero)}. The recordings show no such bend of the damper's law.")
    if set(bound) - set(zero):
        rest = ", ".join(key for key in bound if key not in zero)
        texts.append(f"At its bound: {rest}. The value says where the bound is, not where the foot is.")
    weak = [key for key, e in best.parameters.items() if e.identifiability == "not identifiable" and not e.at_bound]
    if weak:
        texts.append(f"Not identifiable from these recordings: {', '.join(weak)} (standard error too large).")
    if best.p_value is not None and best.p_value < 1e-3:
        texts.append(
            f"The model does not describe the recordings to their noise (chi-square {best.chi_square:.4g} for "
            f"{best.dof} degrees of freedom); the standard errors are widened accordingly."
        )
    loads = {recording.condition.added_mass_kg for recording in data}
    if len(loads) == 1 and str(verdict) == "undecided":
        texts.append("All recordings carry one load; a second load separates the mirror solutions.")
    return texts


def _start_row(descent: Descent, space: Space, a: float | None) -> dict[str, object]:
    values = space.values(descent.theta)
    row: dict[str, object] = {"start": descent.label, "cost": descent.cost, "evaluations": descent.evaluations}
    row |= {"converged": descent.converged, "branch": side(values, a) if a is not None else "best"}
    return row | {item.key: float(value) for item, value in zip(space.free, descent.theta, strict=True)}
