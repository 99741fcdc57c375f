"""Multi-start search: descents of a problem from many starts by the trust-region-reflective method."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.progress import Work
from fasbody.recording.checks import UNIT_IN_DOUBT, unit_in_doubt
from fasbody.recording.recording import Recording
from fasbody.recording.sources import together
from fasbody.sentences import Sentence
from identification.engines.engine import stated
from identification.parameters import Space
from identification.time_problem import UNSTABLE, TimeProblem

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

#: A sum of squares below this share of the number of residuals is zero to any noise.
ZERO = 1e-9
#: Evaluations after which a descent is given up.
_MOST = 200
#: Steps that a descent is expected to take before one has been made.
_USUAL = 30
#: So many samples have a cost as large, of which 1e-7 is a thousandth of what a standard error changes.
_LONG = 5000


@dataclass(frozen=True, eq=False)
class Descent:
    """One descent.

    Attributes:
        label: which start.
        theta0, theta: parameters at start and end.
        z: full search variable at the end.
        cost: weighted sum of squares at the end.
        evaluations: of residual and Jacobian.
        converged: by its tolerances.
        unstable: it never left the parameter sets whose motion is unstable.
    """

    label: str
    theta0: np.ndarray
    theta: np.ndarray
    z: np.ndarray
    cost: float
    evaluations: int
    converged: bool
    unstable: bool


def descend(problem: TimeProblem, label: str, z: np.ndarray, tight: bool = False, work: Work | None = None) -> Descent:
    """Minimise the cost, Eqs. (4.35) to (4.41), from one start.

    Args:
        problem: residual and Jacobian.
        label: name of the start.
        z: (n,) full search variable there.
        tight: converge well below the standard errors, for a result to report.
        work: counts the steps.
    """
    p, work = problem.space.lower.size, work or Work()
    low, high = problem.bounds
    inside = np.clip(z, low + 1e-9 * (high - low), high - 1e-9 * (high - low))  # the method starts inside its bounds
    tolerance = 1e-7 if problem.size > _LONG else 1e-10 if tight else 1e-8  # of the cost: far below a standard error
    from scipy.optimize import least_squares  # a quarter of a second that models with a twin need not wait

    before = problem.evaluations

    def ended(intermediate_result: "OptimizeResult") -> None:  # a valley of zeros is as flat as it is long
        work.did()
        if 2 * intermediate_result.cost <= ZERO * problem.size:
            raise StopIteration

    solution = least_squares(
        problem.residual, inside, problem.jacobian, bounds=(low, high), method="trf", x_scale="jac",
        ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=_MOST, callback=ended,
    )  # fmt: skip
    z, cost, evaluations = solution.x, 2 * float(solution.cost), problem.evaluations - before
    converged = bool(solution.success) or cost <= ZERO * problem.size
    unstable = bool((solution.fun == UNSTABLE).all())
    return Descent(
        label=label,
        theta0=problem.space.to_theta(inside[:p]),
        theta=problem.space.to_theta(z[:p]),
        z=z,
        cost=cost,
        evaluations=evaluations,
        converged=converged,
        unstable=unstable,
    )


def lost(foot: Foot, space: Space, descents: Sequence[Descent], recordings: Sequence[Recording]) -> SimulationError:
    """What to raise where no start came to a steady motion: a unit in doubt is the likeliest reason."""
    if doubt := unit_in_doubt(r.warnings for r in recordings):
        text = f" As it is, none of {len(descents)} starts of {foot.name} has a steady motion."
        return SimulationError(Sentence(doubt, text), code=UNIT_IN_DOUBT)
    first = descents[0]
    values = dict(zip(space.names, first.theta0, strict=False))  # a delay comes last
    return SimulationError(
        f"{foot.name}: none of {len(descents)} starts has a steady motion under "
        f"{together([r.file for r in recordings])} (the start {first.label!r}: {stated(foot, values)}); check the "
        "bounds and the model's parameters."
    )


def explore(
    problem: TimeProblem, starts: Sequence[tuple[str, np.ndarray]], work: Work | None = None
) -> tuple[list[Descent], bool]:
    """Descend from every start; Ctrl-C keeps what is done.

    Args:
        problem: what to minimise.
        starts: (label, q0).
        work: counts the steps, and about how many may still come.

    Returns:
        The descents, best first, and whether they were interrupted.
    """
    done: list[Descent] = []
    interrupted, work = False, work or Work()
    try:
        for number, (label, q0) in enumerate(starts):
            work.expect(_USUAL * (len(starts) - number))
            work.might(_USUAL)
            done.append(descend(problem, label, problem.start(q0), work=work))
    except KeyboardInterrupt:
        if not done:
            raise
        interrupted = True
    return sorted(done, key=lambda d: d.cost), interrupted
