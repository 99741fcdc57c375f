"""Optima of rivals on each branch, repeatability of recordings, held-out predictions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fasbody.progress import Advance
from identification import optimiser
from identification.intervals import Solution
from identification.optimiser import Optimum
from identification.residual import Problem
from identification.rivals.ladder import Candidate, RungVariables
from identification.steady import SIDES

#: Random starts of a side beside simpler rungs' ends, ends to go on from, and steps of a refit.
_STARTS, _NEAREST, _REFIT = 2, 3, 15
#: Prior of variables that neither a prior nor the recordings determine, too weak to matter.
_FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class Contender:
    """A candidate at its best.

    Attributes:
        candidate: which.
        solutions: its ends, the best first, with the weights that all rivals share.
        repeatability: what recordings would have to repeat to if it were right.
    """

    candidate: Candidate
    solutions: tuple[Solution, ...]
    repeatability: float


def climb(candidates: Sequence[Candidate], advance: Advance) -> list[Contender]:
    """The optima of every rival, with the same weights of the recordings.

    Each rival gives an estimate of the repeatability. The smallest one is used for all, and with it
    the covariance of the base's noise.

    Args:
        candidates: simpler ones first.
        advance: called with the stage, the number done and the total.
    """
    searched: list[optimiser.Searched] = []
    for number, candidate in enumerate(candidates):
        advance(candidate.rung.title, number, len(candidates))
        searched.append(_search(candidate.problem, searched[:2]))
    best = min(searched, key=lambda s: (s.problem.repeatability, s.optima[0].objective)).problem
    contenders = []
    for candidate, search in zip(candidates, searched, strict=True):
        problem = replace(candidate.problem, noise=best.noise, seats=best.seats, scatter=best.scatter)
        ends = _ends(problem, search.optima, searched)
        contenders.append(Contender(candidate, ends, search.problem.repeatability))
    return contenders


def _search(problem: Problem, simpler: Sequence[optimiser.Searched]) -> optimiser.Searched:
    """From random starts, from the constants of the model, and from the optima of simpler rungs."""
    v = problem.variables
    first = [v.start(v.model_values)]
    if not isinstance(v, RungVariables):
        return optimiser.search(problem, (0,), optimiser.Effort(starts=1, rounds=1), first=np.stack(first))
    first += _over(v, simpler)
    return optimiser.search(problem, (1, -1), optimiser.Effort(starts=_STARTS, rounds=1), first=np.stack(first))


def _over(v: RungVariables, others: Sequence[optimiser.Searched]) -> list[np.ndarray]:
    """Ends of other rungs in the variables of one."""
    rungs = [s for s in others if isinstance(s.problem.variables, RungVariables)]
    return [v.carried_over(o.q, s.problem.variables) for s in rungs for o in s.optima]


def _ends(
    problem: Problem, optima: Sequence[Optimum], every: Sequence[optimiser.Searched]
) -> tuple[Solution, ...]:  # fmt: skip
    """The best end of each side, from all rivals' ends and the images of its two."""
    v, Q = problem.variables, np.stack([o.q for o in optima])
    if isinstance(v, RungVariables):
        Q = np.concatenate([Q, v.image(Q), _over(v, every)])
    ends = []
    for o in optima:
        starts = np.clip(Q, *problem.bounds(o.sign))
        nearest = starts[np.argsort(problem.evaluate(starts).objective)[:_NEAREST]]
        down = optimiser.descend(problem, nearest, np.full(len(nearest), o.sign))
        q, objective, rests = optimiser.finished(problem, down.Q[np.argmin(down.objective)], o.sign)
        end = replace(o, q=q, objective=objective, converged=rests)
        ends.append(Solution(SIDES[o.sign], problem, end))
    return tuple(sorted(ends, key=lambda end: end.optimum.objective))


# what is predicted


def folds(problem: Problem) -> list[tuple[str, np.ndarray]]:
    """What is left out in turn, every third frequency and each of several loads: masks (R,)."""
    hz, loads = np.round(problem.variables.omega / (2 * np.pi), 1), problem.variables.loads
    place, count = np.searchsorted(np.unique(hz), hz), min(3, np.unique(hz).size)
    out = [("frequency", place % count == i) for i in range(count if count > 1 else 0)]
    several = np.unique(loads)
    return out + [("load", loads == load) for load in several if several.size > 1]


def only(problem: Problem, kept: np.ndarray) -> Problem:
    """The problem of some recordings, a mask (R,)."""
    measured = problem.measured
    return replace(problem, measured=replace(measured, valid=measured.valid & kept[:, None, None]))


def held_out(end: Solution) -> tuple[dict[str, float], float]:
    """What a rival predicts of recordings left out.

    The predictive density is the evidence of all recordings over that of the others, each by Laplace
    at its best place, as a linear prediction from the others is too coarse where they leave a
    constant open.

    Returns:
        -2 log of the predictive density by what was left out, up to a constant of the data; and the
        error of the predictions as a share of what was recorded.
    """
    scores: dict[str, float] = {}
    missed = total = 0.0
    for kind, out in folds(end.problem):
        kept, left = only(end.problem, ~out), only(end.problem, out)
        q = optimiser.descend(kept, end.q[None], np.array([end.optimum.sign]), _REFIT).Q[0]
        scores[kind] = scores.get(kind, 0.0) + evidence(end.problem, end.q) - evidence(kept, q)
        valid, Y = left.measured.valid, left.measured.output
        missed += float(np.sum(np.abs(left.predicted(q) - Y)[valid] ** 2))
        total += float(np.sum(np.abs(Y)[valid] ** 2))
    return scores, float(np.sqrt(missed / total)) if total else 0.0


def evidence(problem: Problem, q: np.ndarray) -> float:
    """-2 log of the evidence by Laplace at the best place q (n,), up to a constant."""
    now = problem.evaluate(q[None])
    J = now.jacobian[0]
    return float(now.objective[0] + np.linalg.slogdet(J.T @ J + _FLAT * np.eye(q.size))[1])
