"""The fit of steady recordings: one search with every nuisance, each end once more with the nuisances held, a verdict.

Both sides of the mirror are searched with all that may be true beside the model; these ends make the headline, and are
replayed in MuJoCo. The same problem with the nuisances held says what the intervals would be if masses, instrument and
laws were exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.progress import Work
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording
from identification import branches, optimiser
from identification.branches import STIFF_ANKLE, STIFF_PAD, Recorded, Verdict
from identification.criteria import fit_percent
from identification.estimates import EXACT, Estimate
from identification.harmonics import Line, Measured
from identification.intervals import Solution
from identification.misfit import Misfit, repeats
from identification.motion import EngineMotion, Motion, TwoMassMotion
from identification.nuisances import nuisances
from identification.parameters import MASSES, Space
from identification.replay import Replayed, replay, residual, traces
from identification.residual import Problem, Scatter
from identification.result import Branch, Departures, RecordingFit
from identification.sensors import MALLEOLUS, SensorFit
from identification.variables import Variables

#: Repeatability beyond which the model does not follow the recordings. People repeat to 2 to 5 %; in twenty worlds that
#: no nuisance names, intervals held while the scatter was below this, and a stiffening pad missed beyond it.
FOLLOWS = 0.15
#: Names of the sides of the mirror.
SIDES = {1: STIFF_ANKLE, -1: STIFF_PAD, 0: "best"}


#: The two-mass foot has many ends, and a motion costs 50 us. Other models have one near their own constants, and 10 ms;
#: with many of them free it lies in valleys that hundreds of steps would not follow to their ends.
_TWO_MASS = optimiser.Effort()
_OTHER = optimiser.Effort(starts=1, rounds=1, beside=2, smooth=(0.05,), fall=np.inf, steps=16)
#: Scatter from which the ends are followed down once more with the nuisances held.
_HELD = (0.02,)
#: Change of the sum of squares below which twice the harmonics say the same, and harmonics at most.
_ENOUGH, _MOST_HARMONICS = 0.01, 48
#: Where in what comes after the search its parts begin, of which the intervals take longest.
_EXACT_AFTER, _INTERVALS_AFTER = 0.2, 0.4
#: Beyond its bounds by this factor a spring or damper is as good as rigid or absent.
_FURTHER = 100.0


@dataclass(frozen=True, eq=False)
class Fitted:
    """A steady fit.

    Attributes:
        solutions: the headline, best first.
        exact: the same branches with the nuisances held, by name; none where the headline is that already.
        replays: of the headline's ends, by name.
        left_out: branches whose motion does not last.
    """

    solutions: tuple[Solution, ...]
    exact: dict[str, Solution]
    replays: dict[str, Replayed]
    left_out: tuple[str, ...]


def motion_of(
    foot: Foot, measured: Measured, variables: Variables, carriers: Sequence[bool], harmonics: int = 0
) -> Motion:
    """What moves: the two-mass foot in closed form, or the model itself.

    Args:
        foot: the model.
        measured: what drives it.
        variables: what is searched.
        carriers: of each sensor, whether it sits on the foot's mass.
        harmonics: of a motion at least.
    """
    if variables.two_mass:
        return TwoMassMotion(measured, variables.omega, carriers, harmonics)
    return EngineMotion(foot, measured, variables.omega, variables.motion_names)


def problem_of(
    recordings: Sequence[Recording],
    foot: Foot,
    space: Space,
    known: Known,
    sensors: Sequence[str] = MALLEOLUS,
    carriers: Sequence[bool] | None = (False,),
    delay: bool = True,
) -> Problem:
    """The one problem of steady recordings.

    Args:
        recordings: checked.
        foot: the model.
        space: its free constants.
        known: of what may be true beside it.
        sensors: that are fitted.
        delay: whether the recordings tell a delay from damping.
        carriers: of each sensor, whether it sits on the foot's mass; None for a model that is not
            the two-mass foot.
    """
    values = foot.values()
    masses = [name for name in values if name in MASSES]
    measured = Measured.of([Line.with_sensors(r, tuple(sensors)) for r in recordings], sensors)
    two_mass = carriers is not None
    mirror = two_mass and not branches.has_mirror(space.names, foot.parameters)
    ratio = branches.ratio([r.condition.masses for r in recordings], values) if mirror else None
    items = nuisances(recordings, known, masses, two_mass, sensors, delay)
    variables = Variables(space, items, recordings, values, two_mass, ratio)
    return Problem.of(measured, variables, motion_of(foot, measured, variables, carriers or ()))


def fit(
    problem: Problem, foot: Foot, starts: int, seed: int, allow: bool, work: Work | None = None
) -> Fitted:
    """Search, hold, and replay.

    Args:
        problem: as `problem_of` makes it.
        foot: the model.
        starts: of a side in a round of the search.
        seed: of the starts.
        allow: for what may be true beside the model; else the nuisances are held.
        work: counts the steps.

    Raises:
        SimulationError: no motion lasts.
    """
    work = work or Work()
    work.stage = "searching"
    variables = problem.variables
    signs = (1, -1) if variables.ratio is not None else (0,)
    held = variables.held([item.kind for item in variables.nuisances if item.kind != "delay"])
    exact = problem.with_held(held)
    first = variables.start(variables.model_values)[None]
    effort = replace(_TWO_MASS, starts=starts) if variables.two_mass else _OTHER
    search = optimiser.search(
        problem if allow else exact, signs, effort, seed=seed, estimate=allow, first=first, work=work
    )  # fmt: skip
    solutions = [Solution(SIDES[o.sign], search.problem, o) for o in search.optima]
    solutions = [_with_enough_harmonics(solution) for solution in solutions]
    replays, kept, left_out, reasons = {}, [], [], []
    for number, solution in enumerate(solutions):
        work.after("replaying in MuJoCo", _EXACT_AFTER * number / len(solutions))
        try:
            replays[solution.branch] = replay(foot, solution.problem, solution.q)
            kept.append(solution)
        except SimulationError as error:
            left_out.append(solution.branch)
            reasons.append(error)
    if not kept:
        raise reasons[0]
    work.after("fitting the model assumed exact", _EXACT_AFTER)
    alone = _held_ends(search.problem.with_held(held).with_scatter(Scatter()), kept) if allow else {}
    return Fitted(tuple(kept), alone, replays, tuple(left_out))


def _with_enough_harmonics(solution: Solution) -> Solution:
    """The end with twice the harmonics, as often as that changes it."""
    problem, optimum = solution.problem, solution.optimum
    while isinstance(problem.motion, TwoMassMotion) and 2 * problem.motion.base.shape[1] <= _MOST_HARMONICS:
        more = replace(problem, motion=problem.motion.with_harmonics(2 * problem.motion.base.shape[1]))
        if abs(float(more.evaluate(optimum.q[None]).objective[0]) - optimum.objective) < _ENOUGH:
            break
        problem = more
        q, objective, converged = optimiser.finished(problem, optimum.q, optimum.sign)
        optimum = replace(optimum, q=q, objective=objective, converged=converged)
    return Solution(solution.branch, problem, optimum)


def _held_ends(exact: Problem, solutions: Sequence[Solution]) -> dict[str, Solution]:
    """The best end of each branch with the nuisances held."""
    mean, _ = exact.variables.prior
    signs = tuple(solution.optimum.sign for solution in solutions)
    first = np.stack([np.where(exact.held, mean, solution.q) for solution in solutions])
    effort = replace(_TWO_MASS if exact.variables.two_mass else _OTHER, starts=0, rounds=1, smooth=_HELD)
    search = optimiser.search(exact, signs, effort, estimate=False, first=first)
    return {SIDES[o.sign]: Solution(SIDES[o.sign], search.problem, o) for o in search.optima}


# what is said of it


def branches_of(fitted: Fitted, recordings: Sequence[Recording], work: Work) -> list[Branch]:
    """All branches as a result has them."""
    built: list[Branch] = []
    for solution in fitted.solutions:
        rest = (1 - _INTERVALS_AFTER) * len(built) / len(fitted.solutions)
        work.after("computing intervals", _INTERVALS_AFTER + rest)
        built.append(branch_of(fitted, solution, recordings))
    return built


def branch_of(fitted: Fitted, solution: Solution, recordings: Sequence[Recording]) -> Branch:
    """One branch as a result has it: the headline, beside it the model assumed exact, and what was allowed for."""
    run = fitted.replays[solution.branch]
    read, r = residual(solution.problem, solution.q, run)
    rows = traces(solution.problem, solution.q, run)
    fits = [
        fit_percent(recording.malleolus_m_s2, row[MALLEOLUS[0]])
        for recording, row in zip(recordings, rows, strict=True)
    ]
    parameters, correlation = solution.estimates(profiles=bool(fitted.exact))
    follows = solution.problem.repeatability <= FOLLOWS
    exact = fitted.exact.get(solution.branch)
    alone = exact.estimates()[0] if exact is not None else {}
    parameters = {key: _beside(e, alone.get(key), follows, solution) for key, e in parameters.items()}
    judged = exact or solution
    p_value = float(chdtrc(judged.dof, judged.chi_square)) if judged.dof else None
    departures = None
    if exact is not None:
        departures = Departures(
            float(r @ r), solution.optimum.objective, solution.dof, follows,
            tuple(replace(m, weighed=m.weighed and follows and solution.optimum.converged) for m in solution.masses()),
            solution.allowances(), solution.constant_under_load(), solution.exponents(),
            solution.problem.repeatability, solution.problem.variables.reference_hz, solution.scale_std(),
            solution.optimum.exhausted, Misfit.of(solution.problem, read), repeats(solution.problem.measured),
            solution.problem.scatter.constants,
        )  # fmt: skip
    return Branch(
        solution.branch, judged.optimum.objective, solution.optimum.objective, float(np.mean(fits)), parameters,
        correlation.tolist(), judged.chi_square, judged.dof, p_value, departures,
    )  # fmt: skip


def _beside(e: Estimate, exact: Estimate | None, follows: bool, solution: Solution) -> Estimate:
    """An estimate with the one of the exact model beside it, and words no surer than the fit."""
    if exact is None:
        word = e.identifiability
        if word == "identified" and branches.misses(solution.chi_square, solution.dof):
            word = "weak"  # what is assumed exact is not
        return replace(e, identifiability=word if word == "not identifiable" else word + EXACT)
    if exact.identifiability != "not identifiable":
        exact = replace(exact, identifiability=exact.identifiability + EXACT)
    word = e.identifiability
    if not follows:
        nothing: dict[str, Any] = dict.fromkeys(("std_error", "lower", "upper"), np.nan)
        return replace(e, identifiability="not identifiable", if_model_true=exact, at_rest=None, **nothing)
    if word == "identified" and not solution.optimum.exhausted:
        word = "weak"  # another place may fit better, and say something else
    return replace(e, identifiability=word, if_model_true=exact)


def _beyond(solution: Solution, best: Solution, rests: Sequence[str]) -> float | None:
    """Least sum of squares of a branch where the bounds on which it rests are `_FURTHER` times as far out.

    Args:
        solution: the end that rests on them.
        best: the end of the other branch, whose mirror image may lie there.
        rests: constants.

    Returns:
        the sum; None where the search does not come to its end.
    """
    problem, sign = solution.problem, solution.optimum.sign
    space = problem.variables.space
    further = np.where([item.name in rests for item in space.free], _FURTHER, 1.0)
    space = replace(space, lower=space.lower / further, upper=space.upper * further)
    wider = replace(problem, variables=replace(problem.variables, space=space))
    first = np.concatenate([solution.q[None], wider.variables.image(best.q[None])])
    search = optimiser.search(wider, (sign,), estimate=False, first=first)
    return search.optima[0].objective if search.optima[0].exhausted else None


def verdict_of(fitted: Fitted, built: Sequence[Branch], recorded: Recorded, why_not: str) -> Verdict:
    """Whether the data decide between the branches."""
    solutions = fitted.solutions
    best = solutions[0]
    if why_not or fitted.left_out:
        return Verdict("not compared", 0.0, why_not or branches.LEFT_OUT.format(name=fitted.left_out[0]))
    last = built[-1].parameters
    rests = branches.pinned({key: e.at_bound for key, e in last.items()}, {key: e.value for key, e in last.items()})
    objectives = [solution.optimum.objective for solution in solutions]
    if fitted.exact:
        objectives = [best.deviance(objective) for objective in objectives]
    misfit = (0.0, best.dof) if fitted.exact else (best.chi_square, best.dof)
    names = [b.name for b in built]
    verdict = branches.judge(names, objectives, *misfit, rests, recorded)
    if rests and len(built) > 1 and verdict.log_likelihood_ratio > np.log(branches.DECISIVE_ODDS):
        beyond = _beyond(solutions[-1], best, rests)
        if beyond is not None:
            objectives[-1] = best.deviance(beyond) if fitted.exact else beyond
            free = branches.judge(names, objectives, *misfit, (), recorded)
            verdict = free if free.word == "decided" else verdict
    departures = built[0].departures
    if not fitted.exact and len(built) > 1 and branches.misses(best.chi_square, best.dof):
        text = branches.NOT_EXACT.format(excess=best.chi_square / max(1, best.dof), bound=branches.MISSES)
        return Verdict("undecided", verdict.log_likelihood_ratio, text)
    if departures is not None and not departures.follows and len(built) > 1:
        text = branches.DOES_NOT_FOLLOW.format(percent=100 * best.problem.repeatability, bound=100 * FOLLOWS)
        return Verdict("undecided", verdict.log_likelihood_ratio, text)
    # a better end of the favoured side would favour it more
    if verdict.word == "decided" and not all(other.optimum.exhausted for other in solutions[1:]):
        return Verdict("undecided", verdict.log_likelihood_ratio, branches.NOT_EXHAUSTED)
    return verdict


def recordings_of(fitted: Fitted, solution: Solution, recordings: Sequence[Recording]) -> tuple[RecordingFit, ...]:
    """Each recording beside what MuJoCo's motion makes its sensors read."""
    run = fitted.replays[solution.branch]
    read, _ = residual(solution.problem, solution.q, run)
    rows = []
    for r, (recording, traced) in enumerate(zip(recordings, traces(solution.problem, solution.q, run), strict=True)):
        line = solution.problem.measured.lines[r]
        sensors = []
        for name, model in traced.items():
            s = solution.problem.measured.sensors.index(name)
            measured = recording.sensors[name]
            percent = fit_percent(measured, model)
            sensors.append(SensorFit.of(name, percent, measured, model, line.sensors[name], read[r, s, : line.count]))
        rows.append(RecordingFit.of(recording, sensors[0].fit_percent, traced[MALLEOLUS[0]], tuple(sensors)))
    return tuple(rows)


def start_rows(fitted: Fitted) -> tuple[dict[str, object], ...]:
    """How often the search of each side came to its end."""
    rows = []
    for solution in fitted.solutions:
        o = solution.optimum
        row: dict[str, object] = {"start": solution.branch, "cost": o.objective, "evaluations": o.starts}
        row |= {"converged": o.converged, "branch": solution.branch, "hits": o.hits}
        rows.append(row | {key: e.value for key, e in solution.estimates()[0].items()})
    return tuple(rows)
