"""A branch of a fit converged on the MuJoCo rollout, with its standard errors: the numbers that are reported."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from fasbody.exceptions import SimulationError
from fasbody.parameters import Parameter
from fasbody.recording import Recording
from identification.replay import Replay, replay
from identification.result import Branch, Estimate, identifiability
from identification.routes import Route
from identification.search import Descent, descend
from identification.space import Space

#: Rounds of reweighing: the weights depend on the model, and settle at once.
_REWEIGH = 2
#: So many ends of a branch are tried in MuJoCo before it is given up.
_CANDIDATES = 3
#: A steady motion this many times larger than the measured one has left its orbit, which is unstable.
_GROWN = 5.0


@dataclass(frozen=True, eq=False)
class Certified:
    """A branch converged on the MuJoCo rollout."""

    name: str
    problem: Any
    descent: Descent
    deviance: float
    run: Replay


def settle(route: Route, descent: Descent) -> tuple[Any, Descent]:
    """Bring weights and time step up to date at a descent's end and go on: the problem so weighted, and the end."""
    problem = route.explorer()
    q = route.space.to_q(descent.theta)
    z = descent.z if descent.z.size == problem.bounds[0].size else problem.start(q)  # explored in the other domain
    finer = route.refined(z)
    while True:
        problem, route = problem if finer is route else finer.explorer(), finer
        for _ in range(_REWEIGH if route.chi_square else 1):  # without chi-square the weights stay
            route.reweigh(problem, descent)
            descent = descend(problem, route.space.to_q(descent.theta), descent.label, z0=z, tight=True)
            z = descent.z
        finer = route.refined(z)
        if finer is route:
            return problem, descent


def standard_errors(problem: Any, descent: Descent, dof: int, chi_square: bool) -> tuple[np.ndarray, np.ndarray]:
    """Standard errors (p,) and covariance (p, p) of q; a misfit beyond the noise widens the former, NaN at a bound.

    What rests on a bound has no standard error of its own, but is not known to lie there: the others' errors hold for
    any value it may have, not for the bound's alone.
    """
    at_bound = problem.space.at_bound(descent.theta)
    covariance = problem.covariance(descent.z, np.ones(at_bound.size, bool))
    covariance[at_bound] = covariance[:, at_bound] = np.nan
    excess = max(1.0, descent.cost / max(1, dof)) if chi_square else 1.0
    return np.sqrt(np.diag(covariance) * excess), covariance


def _certify(route: Route, name: str, descent: Descent) -> Certified:
    """Settle the weights, converge on the MuJoCo rollout, and run the recordings.

    Raises:
        SimulationError: the motion is unstable over whole recordings.
    """
    problem, descent = settle(route, descent)
    route = route.refined(descent.z)
    final = route.certifier(problem)
    descent = descend(final, route.space.to_q(descent.theta), descent.label, z0=descent.z, tight=True)
    starts = [route.initial_states(final, descent, number) for number in range(len(route.recordings))]
    run = replay(route.foot, route.recordings, route.space.values(descent.theta), starts, route.twin, route.threads)
    if route.chi_square and not _lasts(run, route.recordings):
        raise SimulationError(f"{route.foot.name}: a periodic motion that a foot would not stay on.")
    return Certified(name, final, descent, descent.cost + final.log_determinant, run)


def _lasts(run: Replay, recordings: Sequence[Recording]) -> bool:
    """Whether steady motions stay near what was measured, as a descent's end does over one period."""
    pairs = zip(run.traces, recordings, strict=True)
    return all(np.ptp(trace) <= _GROWN * np.ptp(recording.malleolus_m_s2) for trace, recording in pairs)


def certify_first(route: Route, name: str, candidates: Sequence[Descent]) -> tuple[Certified | None, int]:
    """The best descent of a branch that MuJoCo can follow over whole recordings, and how many it could not.

    A parameter set may have a periodic motion that no foot would stay on. Descents that end at the same place are
    tried once.
    """
    skipped: list[Descent] = []
    for descent in candidates:
        if descent.unstable or any(abs(descent.cost - other.cost) <= 1e-6 * other.cost for other in skipped):
            continue
        try:
            return _certify(route, name, descent), len(skipped)
        except SimulationError:
            skipped.append(descent)
        if len(skipped) == _CANDIDATES:
            break
    return None, len(skipped)


def branch_of(route: Route, certified: Certified, space: Space) -> Branch:
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
        p_value=float(chi2.sf(descent.cost, dof)) if route.chi_square and dof else None,
    )


def size_that_matters(item: Parameter) -> float:
    """A value that matters of a parameter that may be zero: a tenth of the way to its bound."""
    return 0.0 if item.logarithmic else 0.1 * max(abs(item.lower), abs(item.upper))
