"""The trend: all recordings of one subject and posture as smooth functions of frequency and load, estimated jointly."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.branches import EXCHANGED, Verdict, has_mirror, judge
from identification.certification import Replay, replay
from identification.domains import choose_domain
from identification.engines.twin import twin_applies
from identification.estimate import Settings
from identification.result import RecordingFit
from identification.space import space_of
from identification.study.curves import CurveSpace, Order
from identification.study.levenberg import descend_fast
from identification.study.orders import choose
from identification.study.trend_result import TrendBranch, TrendResult
from identification.study.trend_search import Candidate, Frame, both_ways, explore_trend, grown, settled

#: Parameters that are functions of frequency and load; the others are constants of the subject.
CURVES = EXCHANGED
_ROUNDS = 3
#: Scatter about a curve (of the logarithm) beyond which it does not describe the recordings.
_POOR = 0.3
#: Evaluations in MuJoCo at most: the twin is already there, and differs by rounding.
_CERTIFYING = 8


def fit_trend(
    recordings: Sequence[Recording],
    foot: Foot,
    settings: Settings | None = None,
    *,
    order: Order | None = None,
    curves: Sequence[str] = CURVES,
    scatter: bool = True,
    criterion: str = "bic",
    certify: bool = True,
    source: str = "",
    advance: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> TrendResult:
    """Estimate smooth curves over frequency and load from all recordings of one subject in one posture.

    Args:
        recordings: steady ones, at two frequencies or more. foot: the model. settings: as for a fit; the domain is
            always the steady state. order: how many coefficients; None lets the criterion choose.
        curves: parameters that are functions; the other free ones are constants. scatter: recordings lie off them.
        criterion: "bic" or "aic". certify: converge on the MuJoCo rollout.
        source: what to call the data. advance: called with what is done, how many of how many.

    Raises:
        RecordingError: a recording cannot serve. SettingError: an option cannot be meant, or there is one frequency.
        SimulationError: no start led anywhere.
    """
    began = time.perf_counter()
    settings = settings or Settings()
    data = [checked(recording) for recording in recordings]
    warnings = [text for recording in data for text in recording.warnings]
    warnings += choose_domain(data, "periodic")[1]
    feet = space_of(foot, settings.free, settings.bounds, settings.delay is not False)
    twin = twin_applies(foot)
    frame = Frame(foot, data, feet, tuple(n for n in curves if n in feet.names), scatter, twin, settings.threads)
    if frame.frequencies < 2:
        raise SettingError("a trend needs recordings at two or more frequencies; use per-recording fits.")
    why_not = has_mirror(feet.names, foot.parameters)
    states, starts = explore_trend(frame, settings, not why_not, advance)
    tried: list[dict[str, Any]] = []
    if order is None:
        for _ in range(_ROUNDS):
            best = min(states.values(), key=lambda s: s.deviance)
            wanted, tried = choose(best.problem, best.descent.z, criterion)
            if wanted == best.space.order:
                break
            states = grown(frame, states, wanted, advance)
    else:
        states = grown(frame, states, order, advance)
    if not why_not:
        states = both_ways(frame, states)
    certified = []
    unstable: dict[str, SimulationError] = {}
    for number, (name, state) in enumerate(sorted(states.items(), key=lambda item: item[1].deviance)):
        advance("certifying in MuJoCo", number, len(states))
        try:
            certified.append(_certify(frame, name, state, certify))
        except SimulationError as problem:
            unstable[name] = problem
    if not certified:
        raise next(iter(unstable.values()))
    warnings += [f"The {n} branch ends where the foot is unstable in MuJoCo; it is not reported." for n in unstable]
    certified.sort(key=lambda pair: pair[0].deviance)
    branches, runs = [c[0] for c in certified], [c[1] for c in certified]
    best_branch = branches[0]
    verdict = judge([b.name for b in branches], [b.deviance for b in branches], best_branch.chi_square, best_branch.dof)
    if why_not:
        verdict = Verdict("not compared", 0.0, why_not)
    elif unstable:
        verdict = Verdict("not compared", 0.0, _lost(next(iter(unstable)), branches[0].name))
    elif verdict.word == "decided" and poor(best_branch.scatter):
        verdict = Verdict("undecided", verdict.log_likelihood_ratio, _meaningless(best_branch.scatter))
    warnings += _advice(best_branch, frame)
    return TrendResult(
        source=source or data[0].file,
        origin=next((r.origin for r in data if r.origin != "measured"), "measured"),
        model=foot.name,
        order=best_branch.space.order,
        orders=tuple(tried),
        branches=tuple(branches),
        recordings=tuple(RecordingFit.of(r, f, y) for r, f, y in zip(data, runs[0].fits, runs[0].traces, strict=True)),
        verdict=str(verdict),
        reason=verdict.sentence,
        log_likelihood_ratio=verdict.log_likelihood_ratio,
        twin_mujoco_difference=runs[0].twin_difference,
        base_acceleration_error=runs[0].base_error,
        starts=tuple(starts),
        warnings=tuple(dict.fromkeys(warnings)),
        seconds=time.perf_counter() - began,
    )


def _lost(name: str, kept: str) -> str:
    return f"The {name} branch ends where the foot is unstable in MuJoCo, so {kept} was compared with nothing."


def _certify(frame: Frame, name: str, state: Candidate, certify: bool) -> tuple[TrendBranch, Replay]:
    """Converge on the MuJoCo rollout, run the recordings, and gather what is reported."""
    domain, problem, descent = state.domain, state.problem, state.descent
    final = problem
    if certify:
        final = domain.certified(problem)
        descent = descend_fast(final, descent.z, descent.label, 1e-7, _CERTIFYING)
    space, z = state.space, descent.z
    if certify:
        states = [final.states(descent.z, i) for i in range(len(frame.data))]
        run = replay(domain.foot, frame.data, space.feet_of(z), states, frame.twin)
    else:
        run = Replay([r.malleolus_m_s2 for r in frame.data], [float("nan")] * len(frame.data), float("nan"), None)
    harmonics = sum(2 * line.count for line in problem.lines)
    dof = max(0, harmonics - space.size)
    free = ~space.at_bound(z)
    excess = max(1.0, descent.cost / max(1, dof))
    covariance = excess * final.covariance(z, free)[: space.size, : space.size]
    deviance = final.deviance(z)
    count = space.size + (len(space.places) if space.scatter else 0)
    return TrendBranch(
        name=name,
        deviance=deviance,
        aic=deviance + 2 * count,
        bic=deviance + float(np.log(harmonics)) * count,
        chi_square=descent.cost,
        dof=dof,
        fit_percent=float(np.mean(run.fits)),
        z=z,
        covariance=covariance,
        scatter={n: float(t) for n, t in zip(space.curves, final.tau, strict=True)} if space.scatter else {},
        space=space,
        crosses=bool(np.ptp(np.sign(frame.margins(space, z))) > 0) if name != "best" else False,
    ), run


def _advice(best: TrendBranch, frame: Frame) -> list[str]:
    texts = []
    if frame.loads == 1:
        texts.append(
            "One load: the mirror image of all curves is again smooth, so that only nonlinear damping tells the "
            "branches apart; record a second load."
        )
    elif best.space.order.load >= frame.loads - 1:
        texts.append(
            f"Curves with {best.space.order.load + 1} coefficients over {frame.loads} loads go through any change with "
            "load, the mirror image's too: the loads do not tell the branches apart, only nonlinear damping does."
        )
    if best.crosses:
        texts.append("k_T crosses its mirror image a k_F: near there the two branches cannot be told apart.")
    if poor(best.scatter):
        texts.append(f"{_off(best.scatter)}: the curves describe them poorly.")
    return texts


def poor(scatter: Mapping[str, float]) -> dict[str, float]:
    """Those curves that recordings lie off by more than a placement of the foot would explain."""
    return {name: tau for name, tau in scatter.items() if tau > _POOR}


def _off(scatter: Mapping[str, float]) -> str:
    by = ", ".join(f"{100 * tau:.0f} % in {name}" for name, tau in poor(scatter).items())
    return f"The recordings lie off the curves by {by}"


def _meaningless(scatter: Mapping[str, float]) -> str:
    return f"{_off(scatter)}: odds between curves that do not describe the recordings mean nothing, so it is undecided."


@dataclass(frozen=True, eq=False)
class Refit:
    """The curves of a branch fitted anew to other recordings: what `at` needs of a TrendBranch."""

    space: CurveSpace
    z: np.ndarray
    covariance: np.ndarray
    tau: np.ndarray


def refit(branch: TrendBranch, recordings: Sequence[Recording], foot: Foot, threads: int = 0) -> Refit:
    """Fit a branch's curves to other recordings of the same foot, from where it ended, on the fastest engine.

    Args:
        branch: whose order, curves and bounds are kept. recordings: checked ones. foot: the model.

    Raises:
        SimulationError: no stable motion there.
    """
    old = branch.space
    frame = Frame(foot, list(recordings), old.feet, old.curves, old.scatter, twin_applies(foot), threads)
    tau = np.array([max(branch.scatter[n], 1e-3) for n in old.curves]) if old.scatter else None
    domain = frame.domain(old.order, tau)
    space = domain.problem().curves
    B = old.design(space.frequencies_hz, space.loads_kg)
    state = settled(domain, space.project(list(B @ branch.beta)))
    if state is None:
        raise SimulationError(f"{foot.name}: the curves have no stable motion for {len(recordings)} recordings.")
    z, problem = state.descent.z, state.problem
    covariance = problem.covariance(z, ~space.at_bound(z))[: space.size, : space.size]
    return Refit(space, z, covariance, problem.tau if space.scatter else np.zeros(len(space.places)))
