"""The fit of every sample, for transients, sweeps and random input: explore, follow both branches, converge in MuJoCo.

Steady recordings are explored on their harmonics, where the same foot is found a hundred times sooner, unless it
touches, stops or slips.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.exceptions import PeriodicMotionError, SimulationError
from fasbody.progress import Advance, Work
from fasbody.sentences import Sentence, called
from identification import branches, multistart, steady
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.certification import Certified, certify_first, standard_errors
from identification.engines.engine import stated
from identification.estimates import Estimate, identifiability
from identification.intervals import size_that_matters
from identification.multistart import ZERO, Descent
from identification.parameters import Space
from identification.result import Branch
from identification.setup import Setup, is_steady
from identification.time_domain import TimeDomain
from identification.time_problem import TimeProblem

#: Ends of a branch whose mirror images are entered, and by which share of the cost they must differ.
_IMAGES, _APART = 4, 1e-2
#: Share of a fit that comes after the exploration.
_AFTER = 0.5
#: One of so many random places is descended from.
_SCREENED = 3
_PASSED_OVER = "The best end of the {name} branch was passed over: its motion does not last in MuJoCo."

Place = tuple[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit in the time domain.

    Attributes:
        branches: converged in MuJoCo, likeliest first.
        left_out: names of those that do not last.
        starts: a row for each descent.
        warnings: so far.
    """

    branches: tuple[Certified, ...]
    left_out: tuple[str, ...]
    starts: tuple[dict[str, object], ...]
    warnings: tuple[str, ...]


def fit(
    setup: Setup,
    starts: int,
    seed: int,
    threads: int,
    replay: int | None,
    advance: Advance,
    interruptible: bool,
) -> Fitted:
    """Fit every sample.

    Args:
        setup: recordings and model.
        starts: how many.
        seed: of the random ones.
        threads: 0 for all cores.
        replay: as `setup.Settings`.
        advance: called with the stage, the steps done and about how many there are.
        interruptible: Ctrl-C ends the exploration only, and the result rests on the starts done.

    Raises:
        SimulationError: no start led anywhere.
    """
    space = setup.space
    domain = TimeDomain(setup.foot, setup.recordings, space, setup.two_mass, threads, setup.sensors, replay)
    ratio = None
    if not setup.why_not:
        masses = [recording.condition.masses for recording in setup.recordings]
        ratio = branches.ratio(masses, setup.foot.values())
    work = Work(advance, _AFTER)
    descents, interrupted = _explored(setup, domain, ratio, starts, seed, work)
    if interrupted and not interruptible:
        raise KeyboardInterrupt
    warnings: list[str] = []
    if interrupted:
        warnings.append(f"Interrupted after {len(descents)} of {starts} starts; the result rests on those.")
    if descents[0].unstable:
        raise multistart.lost(setup.foot, space, descents, setup.recordings)
    ends = _of_each_branch(domain, space, ratio, descents)
    certified, left_out = [], []
    for number, (name, descents_of_side) in enumerate(ends.items()):
        work.after("converging in MuJoCo", number / len(ends))
        best, skipped = certify_first(domain, name, descents_of_side)
        if best:
            certified.append(best)
        else:
            left_out.append(name)
        if skipped:
            warnings.append((_PASSED_OVER if best else branches.LEFT_OUT).format(name=name))
    if not certified:
        values = stated(setup.foot, space.values(descents[0].theta))
        text = f"{setup.foot.name}: the best parameter sets are all unstable over the recordings (the best: {values})"
        raise SimulationError(Sentence(f"{text}. Narrow the bounds (", called("bounds"), ")."))
    rows = tuple(_row(descent, space, ratio) for descent in descents)
    certified.sort(key=lambda c: c.deviance)
    return Fitted(tuple(certified), tuple(left_out), rows, tuple(warnings))


Explored = tuple[list[Descent], bool]


def _explored(
    setup: Setup, domain: TimeDomain, ratio: float | None, starts: int, seed: int, work: Work
) -> Explored:
    """Steady recordings on their harmonics where the model has a periodic motion, all others sample by sample."""
    if is_steady(setup.recordings):
        try:
            return _on_harmonics(setup, domain, starts, seed, work)
        except PeriodicMotionError:  # what touches, stops, slips or lifts off has no harmonics that fall
            pass
    return _on_samples(setup, domain, ratio, starts, seed, work)


def _on_harmonics(setup: Setup, domain: TimeDomain, starts: int, seed: int, work: Work) -> Explored:
    """The ends of a steady fit with the nuisances held, as descents in the time domain that have yet to begin."""
    problem, space = setup.problem(), setup.space
    fitted = steady.fit(problem, setup.foot, starts, seed, False, work)
    descents = []
    for solution in fitted.solutions:
        values = solution.foot(0) | {
            key.removesuffix("_s"): e.value for key, e in solution.estimates()[0].items() if key.startswith("delay")
        }
        theta = space.theta(values)
        _, states = problem.motion.states(problem.variables.theta(solution.q))
        z = domain.start(space.to_q(theta), states)
        o = solution.optimum
        descents.append(Descent(solution.branch, theta, theta, z, o.objective, o.starts, o.converged, False))
    return descents, False


def _on_samples(
    setup: Setup, domain: TimeDomain, ratio: float | None, starts: int, seed: int, work: Work
) -> Explored:
    """Descents from the model's values, their mirror image, and the random places that begin lowest on each side."""
    space, values, problem = setup.space, setup.foot.values(), domain.problem()
    rng = np.random.default_rng(seed)
    places = [("model", space.to_q(space.theta(values)))]
    if ratio is not None:
        places.append(("mirror of the model", space.to_q(space.theta(branches.mirrored(values, ratio)))))
    random = [(f"random {i + 1}", space.random(rng)) for i in range(starts - len(places))]
    places += _lowest(problem, random, lambda q: _side(space, ratio, space.to_theta(q)))
    work.stage = "exploring starts"
    return multistart.explore(problem, places[:starts], work)


def _lowest(problem: TimeProblem, places: Sequence[Place], side: Callable[[np.ndarray], str]) -> list[Place]:
    """Of each side, the share of the places whose sum of squares is least."""
    sides: dict[str, list[tuple[float, Place]]] = {}
    for place in places:
        r = problem.residual(problem.start(place[1]))
        sides.setdefault(side(place[1]), []).append((float(r @ r), place))
    kept = []
    for rows in sides.values():
        rows.sort(key=lambda row: row[0])
        kept += [place for _, place in rows[: -(-len(rows) // _SCREENED)]]
    return kept


def _side(space: Space, ratio: float | None, theta: np.ndarray) -> str:
    return "best" if ratio is None else branches.side(space.values(theta), ratio)


def _of_each_branch(
    domain: TimeDomain, space: Space, ratio: float | None, descents: list[Descent]
) -> Mapping[str, list[Descent]]:
    """The descents of each branch, best first; mirror images of the other's best ends are entered, too."""
    if ratio is None:
        return {"best": descents}
    ends: dict[str, list[Descent]] = {}
    for descent in descents:
        ends.setdefault(_side(space, ratio, descent.theta), []).append(descent)
    if len(ends) == 2 and is_steady(domain.recordings):  # both sides were searched
        return ends
    problem = domain.problem()
    entered: dict[str, list[Descent]] = {}
    for name, other in ((STIFF_ANKLE, STIFF_PAD), (STIFF_PAD, STIFF_ANKLE)):
        for end in _distinct(ends.get(other, [])):
            image = branches.mirrored(space.values(end.theta), ratio)
            at = problem.start(space.to_q(space.theta(image)))
            image_descent = multistart.descend(problem, f"mirror of {other}", at)
            if _side(space, ratio, image_descent.theta) == name:
                entered.setdefault(name, []).append(image_descent)
    names = [*ends, *(name for name in entered if name not in ends)]
    return {name: sorted([*ends.get(name, []), *entered.get(name, [])], key=lambda d: d.cost) for name in names}


def _distinct(descents: Sequence[Descent]) -> list[Descent]:
    """The best few that end at different costs."""
    kept: list[Descent] = []
    for descent in descents:
        if len(kept) < _IMAGES and all(abs(descent.cost - k.cost) > _APART * k.cost + ZERO for k in kept):
            kept.append(descent)
    return kept


def _row(descent: Descent, space: Space, ratio: float | None) -> dict[str, object]:
    row: dict[str, object] = {"start": descent.label, "cost": descent.cost, "evaluations": descent.evaluations}
    row |= {"converged": descent.converged, "branch": _side(space, ratio, descent.theta)}
    return row | {item.key: float(value) for item, value in zip(space.free, descent.theta, strict=True)}


def branch_of(certified: Certified, space: Space) -> Branch:
    """Estimates with standard errors from the Jacobian at MuJoCo's optimum."""
    problem, descent, run = certified.problem, certified.descent, certified.run
    dof = max(0, problem.size - descent.z.size)
    std_q, covariance = standard_errors(problem, descent)
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
                float(v),
                float(s),
                float(lo),
                float(hi),
                bool(b),
                identifiability(v, s, size_that_matters(item), bool(b)),
            )
            for item, v, s, lo, hi, b in zip(space.free, theta, std, low, high, at_bound, strict=True)
        },
        correlation=np.nan_to_num(correlation).tolist(),
        chi_square=descent.cost,
        dof=dof,
        p_value=None,
    )
