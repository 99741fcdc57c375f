"""Where each rung ends on each branch, and what it predicts of recordings that it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.rivals.ladder import LINEAR, Rung, RungSpace
from identification.rivals.problem import Measured, RungProblem
from identification.rivals.result import MODEL
from identification.search import inverse_of_gram

SIDES = {STIFF_ANKLE: 1, STIFF_PAD: -1}
#: Evaluations of a descent, of the first ones from several starts, and of a refit without some recordings.
_MOST, _FIRST, _REFIT = 80, 15, 15
#: Starts that are descended from.
_BEST = 3
#: Bends of the dampers that the model starts from beside none [1/m].
_BENDS = ((90.0, -90.0), (-90.0, 90.0), (90.0, 90.0), (-90.0, -90.0))


@dataclass(frozen=True, eq=False)
class Side:
    """Where a rung ended on one branch.

    Attributes:
        branch: its name. q: search variable (n,). objective: chi-square and the squares of the priors' rows.
        converged: by the tolerances of the descent.
    """

    branch: str
    q: np.ndarray
    objective: float
    converged: bool


def climb(data: Measured, spaces: Sequence[RungSpace]) -> tuple[Measured, dict[str, list[Side]]]:
    """Both branches of every rung, best first: from the linear foot to the model, and from there to the others.

    Args:
        data: the recordings. spaces: of the rungs; the linear one and the model are among them.

    Returns:
        The recordings as they were weighed at the end, by the model, and the ends by rung.
    """
    by = {space.rung.name: space for space in spaces}
    grid = _grid(data, by[LINEAR])
    bottom = {side: _best(data, by[LINEAR], side, [by[LINEAR].search(v) for v in grid[side]]) for side in SIDES}
    middle = _model(data, by[LINEAR], by[MODEL], bottom)
    best = min(middle.values(), key=lambda end: end.objective)
    data = data.weighed(by[MODEL].constants(best.q)[0])
    ends = {MODEL: _again(data, by[MODEL], middle), LINEAR: _again(data, by[LINEAR], bottom)}
    for name, space in by.items():
        if name in ends:
            continue
        starts = _starts(by, ends, space.rung)
        found = {side: _best(data, space, side, [space.search(*start) for start in starts]) for side in SIDES}
        ends[name] = _again(data, space, found)
    ends[MODEL] = _again(data, by[MODEL], {end.branch: end for end in ends[MODEL]}, ends, by)
    return data, ends


def _starts(by: dict[str, RungSpace], ends: dict[str, list[Side]], rung: Rung) -> list[tuple[dict[str, float], int]]:
    """The ends of the model and of the linear foot, each with each of a rung's own starts."""
    count = max([len(v.start) for v in rung.own], default=1)
    return [
        (by[name].named(end.q), i) for name in (MODEL, LINEAR) for end in ends[name] for i in range(count)
    ]  # fmt: skip


def _model(data: Measured, linear: RungSpace, model: RungSpace, bottom: dict[str, Side]) -> dict[str, Side]:
    found = {}
    for side in SIDES:
        starts = []
        for end in bottom.values():
            values = linear.named(end.q)
            for c_12, c_22 in ((0.0, 0.0), *_BENDS) if end.branch == side else ((0.0, 0.0),):
                bends = {"c_12": c_12, "c_22": c_22, "c_13": 50.0, "c_23": 50.0}
                starts.append(model.search(values | bends))
        found[side] = _best(data, model, side, starts)
    return found


def _best(data: Measured, space: RungSpace, side: str, starts: Sequence[np.ndarray]) -> Side:
    """The best end of a few starts; those of the other branch enter as their mirror images."""
    problem, (low, high) = RungProblem(data, space), space.side(SIDES[side])
    inside = [np.clip(q if q[1] * SIDES[side] >= 0 else image(space, q), low, high) for q in starts]
    costs = [float(np.sum(problem.evaluate(q)[0] ** 2)) for q in inside]
    ends = [
        Side(side, *problem.descend(inside[number], low, high, _FIRST)) for number in np.argsort(costs)[:_BEST]
    ]  # fmt: skip
    best = min(ends, key=lambda end: end.objective)
    return best if best.converged else Side(side, *problem.descend(best.q, low, high, _MOST))


def _again(
    data: Measured,
    space: RungSpace,
    found: dict[str, Side],
    ends: dict[str, list[Side]] | None = None,
    by: dict[str, RungSpace] | None = None,
) -> list[Side]:
    """Each branch once more, from its own end, from the other's mirror image, and from what the others ended at."""
    problem, out = RungProblem(data, space), []
    for side, own in found.items():
        low, high = space.side(SIDES[side])
        starts = [own.q]
        other = next((end for name, end in found.items() if name != side), None)
        if other is not None:
            starts.append(image(space, other.q))
        for name, sides in (ends or {}).items():
            assert by is not None
            starts += [space.search(by[name].named(end.q)) for end in sides if end.branch == side]
        best: Side | None = None
        for i, q in enumerate(starts):
            q = np.clip(q, low, high)
            if best is not None and np.sum(problem.evaluate(q)[0] ** 2) > 3 * best.objective + 200:
                continue
            end = Side(side, *problem.descend(q, low, high, _MOST if i == 0 else _MOST // 2))
            best = end if best is None or end.objective < best.objective else best
        assert best is not None
        out.append(best)
    return sorted(out, key=lambda end: end.objective)


#: What ankle and pad exchange in the mirror image, unscaled.
_PAIRS = (
    ("c_12", "c_22"), ("c_13", "c_23"), ("b_T", "b_F"), ("p_T", "p_F"), ("d_T", "d_F"), ("r_T", "r_F"), ("e_T", "e_F"),
)  # fmt: skip


def image(space: RungSpace, q: np.ndarray) -> np.ndarray:
    """The mirror image (n,) of q: the joints change places."""
    at = {v.name: i for i, v in enumerate(space.variables)}
    q, la = q.copy(), np.log(space.ratio)
    q[1] *= -1
    q[at["c_11"]], q[at["c_21"]] = q[at["c_21"]] + la, q[at["c_11"]] - la
    for one, other in _PAIRS:
        if one in at:
            q[at[one]], q[at[other]] = q[at[other]], q[at[one]]
    return np.clip(q, *space.bounds)


def _grid(data: Measured, space: RungSpace) -> dict[str, list[dict[str, float]]]:
    """The best feet of a coarse grid by the closed form of the linear foot at the fundamentals, by branch."""
    a, m_F = space.ratio, space.m_F
    sizes = np.exp(np.linspace(np.log(3e4), np.log(1e6), 12))
    aparts = np.exp(np.linspace(0.1, 1.8, 6))
    dampers = np.exp(np.linspace(np.log(30), np.log(2000), 6))
    points = np.array([
        (size * np.sqrt(apart * a), size / np.sqrt(apart * a), c_T, c_F)
        for size, apart, c_T, c_F in product(sizes, np.concatenate([aparts, 1 / aparts]), dampers, dampers)
    ])  # fmt: skip
    s = 2j * np.pi * data.hz[:, None]
    p_T, p_F = points[:, 0] + s * points[:, 2], points[:, 1] + s * points[:, 3]
    m_S = (space.m_S + data.loads_kg)[:, None]
    G = p_T * p_F / ((m_S * s**2 + p_T) * (m_F * s**2 + p_T + p_F) - p_T**2)
    gaps = np.abs(G - (data.Y[:, 0] / data.U[:, 0])[:, None]) ** 2
    order = np.argsort(gaps.sum(axis=0))
    names = ("k_T", "k_F", "c_11", "c_21")
    found: dict[str, list[dict[str, float]]] = {side: [] for side in SIDES}
    for i in order:
        side = STIFF_ANKLE if points[i, 0] > a * points[i, 1] else STIFF_PAD
        if len(found[side]) < 2 * _BEST:
            found[side].append(dict(zip(names, map(float, points[i]), strict=True)))
    return found


def folds(data: Measured) -> list[tuple[str, np.ndarray]]:
    """What is left out in turn: every third frequency, and each load where there are several; masks (n,)."""
    out = []
    hz = np.unique(np.round(data.hz, 1))
    if hz.size >= 2:
        thirds = min(3, hz.size)
        place = np.searchsorted(hz, np.round(data.hz, 1))
        out += [("frequency", place % thirds == i) for i in range(thirds)]
    loads = np.unique(data.loads_kg)
    if loads.size >= 2:
        out += [("load", data.loads_kg == load) for load in loads]
    return out


def held_out(data: Measured, space: RungSpace, end: Side) -> tuple[dict[str, float], float]:
    """What a rung foretells of recordings left out.

    The prediction is uncertain by the noise, by the constants and by the nuisances, as the others tell them.

    Returns:
        -2 log of the predictive density by what was left out, up to a constant of the data; and the error of the
        predictions as a share of what was recorded.
    """
    found: dict[str, float] = {}
    low, high = space.side(SIDES[end.branch])
    missed = total = 0.0
    for kind, out in folds(data):
        kept = RungProblem(data.only(~out), space)
        q, _, _ = kept.descend(end.q, low, high, _REFIT)
        C = inverse_of_gram(kept.evaluate(q)[1])
        left = RungProblem(data.only(out), space)
        r, J = left.evaluate(q)
        found[kind] = found.get(kind, 0.0) + surprise(r[: left.data.size], J[: left.data.size], C)
        Y = left.data.Y
        for i, (y, k) in enumerate(zip(left.predict(q), left.data.counts, strict=True)):
            missed += float(np.sum(np.abs(y - Y[i, :k]) ** 2))
            total += float(np.sum(np.abs(Y[i, :k]) ** 2))
    return found, float(np.sqrt(missed / total)) if total else 0.0


def surprise(r: np.ndarray, J: np.ndarray, C: np.ndarray) -> float:
    """-2 log density of whitened residuals r (m,) of a prediction with derivatives J (m, n) and covariance C (n, n)."""
    C = np.where(np.isfinite(C), C, 0.0)
    S = np.eye(r.size) + J @ C @ J.T
    return float(r @ np.linalg.solve(S, r) + np.linalg.slogdet(S)[1])
