"""The search against SciPy's bounded least squares, and what counts as one end, as found twice, as followed."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear, minimize
from steady_cases import BENT, problem, session

from fasbody.foot.model import Foot
from identification import optimiser, steady
from identification.branches import NOT_EXHAUSTED, Recorded
from identification.optimiser import (
    SAME,
    Effort,
    Optimum,
    Population,
    Searched,
    bounded_step,
    descend,
    finished,
    search,
)
from identification.residual import Evaluation, Problem

Array = np.ndarray
FREQUENCIES = (10.0, 15.0, 20.0, 30.0, 40.0, 50.0)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@dataclass
class Valley:
    """A sum of squares that is written down: residual (m,) and Jacobian (m, n) of q (n,), between bounds."""

    low: Array
    high: Array

    def bounds(self, sign: int = 0) -> tuple[Array, Array]:
        return self.low, self.high

    def residual(self, q: Array) -> Array:
        raise NotImplementedError

    def jacobian(self, q: Array) -> Array:
        raise NotImplementedError

    def evaluate(self, Q: Array, near: object = None) -> Evaluation:
        r, J = (np.stack([of(q) for q in Q]) for of in (self.residual, self.jacobian))
        return Evaluation(r, J, np.ones(len(Q), bool), None)


@dataclass
class Linear(Valley):
    M: Array
    b: Array

    def residual(self, q: Array) -> Array:
        return self.M @ q - self.b

    def jacobian(self, q: Array) -> Array:
        return self.M


class Rosenbrock(Valley):
    def residual(self, q: Array) -> Array:
        return np.array([10 * (q[1] - q[0] ** 2), 1 - q[0]])

    def jacobian(self, q: Array) -> Array:
        return np.array([[-20 * q[0], 10.0], [-1.0, 0.0]])


@pytest.mark.parametrize("seed", range(8))
def test_a_linear_problem_ends_where_bounded_least_squares_does(seed: int) -> None:
    """With columns of unlike size, variables that start on a bound, and one that is held."""
    rng = np.random.default_rng(seed)
    M, b = rng.normal(size=(30, 12)) * np.exp(rng.normal(0, 2, 12)), rng.normal(0, 10, 30)
    low, high = -np.abs(rng.normal(size=12)), np.abs(rng.normal(size=12))
    low[:4] = 0.0
    low[11] = high[11] = 0.0
    q, objective, rests = finished(Linear(low, high, M, b), np.zeros(12), 0)  # type: ignore[arg-type]
    want = lsq_linear(M, b, (low - 1e-12, high + 1e-12), method="bvls", tol=1e-14)
    assert rests and ((low <= q) & (q <= high)).all()
    assert objective == pytest.approx(2 * want.cost, rel=1e-6, abs=1e-4)


@pytest.mark.parametrize("high", [(2.0, 2.0), (0.5, 2.0), (2.0, 0.3)])
def test_a_bent_valley_ends_where_scipy_does(high: tuple[float, float]) -> None:
    valley = Rosenbrock(np.full(2, -2.0), np.array(high))
    down = descend(valley, np.array([[-1.2, 0.25], [0.3, -1.0]]), np.zeros(2, int), 500, 1e-14)  # type: ignore[arg-type]
    want = least_squares(valley.residual, [-1.2, 0.25], valley.jacobian, valley.bounds(), xtol=1e-15, ftol=1e-15)
    assert down.rests.all()
    np.testing.assert_allclose(down.Q, [want.x, want.x], atol=1e-5)
    np.testing.assert_allclose(down.objective, 2 * want.cost, atol=1e-10)


def test_it_says_whether_it_came_to_rest() -> None:
    valley = Rosenbrock(np.full(2, -2.0), np.full(2, 2.0))
    short = descend(valley, np.array([[-1.2, 1.0]]), np.zeros(1, int), 3)  # type: ignore[arg-type]
    assert not short.rests[0] and short.objective[0] > 0.1


@pytest.fixture(scope="module")
def made() -> Problem:
    return problem(session(BENT, FREQUENCIES, (0.0, 2.3)))


@pytest.fixture(scope="module")
def found(made: Problem) -> Searched:
    return search(made, (1, -1), Effort(starts=6))


def _by_scipy(problem: Problem, q: Array, sign: int, most: int) -> tuple[Array, float]:
    low, high = problem.bounds(sign)
    inside = np.clip(q, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
    end = least_squares(
        lambda x: problem.evaluate(x[None]).residual[0], inside, lambda x: problem.evaluate(x[None]).jacobian[0],
        bounds=(low, high), x_scale="jac", max_nfev=most, ftol=1e-12, xtol=1e-12, gtol=1e-12,
    )  # fmt: skip
    return end.x, 2 * end.cost


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 1])
def test_no_start_of_scipy_ends_lower(found: Searched, number: int) -> None:
    """SciPy from other places of its side, where recordings repeat ever better."""
    optimum, rng = found.optima[number], np.random.default_rng(5)
    ends = []
    for q in optimiser.random_starts(found.problem, optimum.sign, 5, rng):
        for scatter, most in ((0.1, 40), (0.02, 40), (0.004, 40), (0.0, 250)):
            q, end = _by_scipy(found.problem.with_repeatability(scatter), q, optimum.sign, most)
        ends.append(end)
    assert optimum.objective - 0.01 < min(ends)


def test_an_end_of_which_nothing_is_drawn_anew_is_no_start(made: Problem, rng: np.random.Generator) -> None:
    """Coming back to it would count as a second find; of a linear foot with the nuisances held nothing is drawn."""
    v = made.variables
    ends = Population(v.start(v.model_values)[None], np.array([1]), np.ones(1, int), np.array([5.0]))
    starts = optimiser._redrawn(made, ends, [1], 200, rng)
    assert 190 < len(starts.Q) < 200  # four in ten draw of several groups, each left as it is with odds of 0.4
    anew = np.abs(starts.Q - ends.Q) > 0
    assert anew.any(axis=1).all()
    groups = np.stack([(anew & kind).any(axis=1) for kind in optimiser._kinds(made)], 1).sum(1)
    assert 100 < np.sum(groups == 1) < 170 and groups.max() > 2
    data = session(BENT, FREQUENCIES)
    linear = problem(data, free=("k_T", "k_F", "c_11", "c_21"))
    linear = linear.with_held(linear.variables.held([item.kind for item in linear.variables.nuisances]))
    q = linear.variables.start(linear.variables.model_values)
    alone = Population(q[None], np.array([1]), np.ones(1, int), np.array([5.0]))
    after, restless = optimiser._improved(linear, alone, [1], Effort(), rng, 10)
    assert restless == [] and after.hits.tolist() == [1]


@pytest.mark.parametrize(("behind", "sides"), [(29.0, {1, -1}), (31.0, {1})])
def test_lattices_surround_the_best_ends_of_a_side_that_may_win(made: Problem, behind: float, sides: set[int]) -> None:
    """Each start differs from its end in the nuisances of one lattice, between the bounds, and in none that is held."""
    v = made.variables
    q = optimiser.random_starts(made, 1, 1, np.random.default_rng(0))[0]
    places = {1: q, -1: v.image(q)}
    signs = np.array([1, 1, 1, -1])
    ends = Population(np.stack([places[s] for s in signs]), signs, np.ones(4, int), np.array([5.0, 6, 7, 5 + behind]))
    starts = optimiser._on_lattices(made, ends, [1, -1])
    assert set(starts.sign) == sides and len(starts.Q) == 2 * 50 + 50 * (len(sides) - 1)
    names = [*v.constants, *(item.kind for item in v.nuisances)]
    pairs = zip(starts.Q, starts.sign.tolist(), strict=True)
    changed = {tuple(names[i] for i in np.flatnonzero(row != places[s])) for row, s in pairs}
    assert {name for row in changed for name in row} == {kind for lattice in optimiser._LATTICES for kind in lattice}
    assert all(any(set(row) <= set(lattice) for lattice in optimiser._LATTICES) for row in changed)
    low, high = made.bounds(0)
    np.testing.assert_array_equal(starts.Q, np.clip(starts.Q, low, high))
    held = made.with_held(v.held(["rocking damping", "mount", "relaxation time"]))
    assert not len(optimiser._on_lattices(held, ends, [1, -1]).Q)


@pytest.mark.parametrize(("margin", "stays"), [(0.1, True), (-0.1, False)])
def test_beside_an_end_only_those_go_on_that_promise_a_lower_one(made: Problem, margin: float, stays: bool) -> None:
    start = Population(optimiser.random_starts(made, 1, 1, np.random.default_rng(1)), *np.array([[1], [1], [9]]))
    down = descend(made, start.Q, start.sign, 1)
    above = {1: float(down.objective[0] - down.left[0]) + SAME + margin}
    assert len(optimiser._promising(made, start, 4, None, above, 1).Q) == stays


def test_those_go_on_that_promise_to_come_farthest_down(made: Problem, rng: np.random.Generator) -> None:
    Q = np.concatenate([optimiser.random_starts(made, side, 12, rng) for side in (1, -1)])
    starts = Population(Q, np.repeat([1, -1], 12), np.ones(24, int), np.full(24, np.inf))
    few = optimiser._promising(made, starts, 4)
    down = descend(made, Q, starts.sign, optimiser._SCREENING)
    now = made.evaluate(down.Q[:12])
    tiny = np.full(12, optimiser.LEAST_DAMPING)
    low, high = (np.tile(limit, (12, 1)) for limit in made.bounds(1))
    promised = now.objective - bounded_step(*now.normal, down.Q[:12], low, high, tiny)[1]
    assert few.sign.tolist() == 4 * [-1] + 4 * [1]
    assert few.objective[4:] == pytest.approx(now.objective[np.argsort(promised)[:4]])


def test_the_true_side_is_first_and_holds_the_truth(found: Searched) -> None:
    first, second = found.optima
    assert first.sign == 1 and second.objective > first.objective + 10
    values = found.problem.variables.dynamic(first.q)
    for name in ("k_T", "k_F", "c_11", "c_21"):
        assert values[name] == pytest.approx(BENT[name], rel=0.15)  # the leg's mass is known to some per cent


def population(Q: list[list[float]], objective: list[float], sign: tuple[int, ...] = (1, 1)) -> Population:
    return Population(np.array(Q), np.array(sign), np.ones(len(Q), int), np.array(objective))


@pytest.mark.parametrize(
    ("apart", "higher", "sign", "hits"),
    [
        (0.99, 0.99 * SAME, 1, [2]),
        (1.01, 0.99 * SAME, 1, [1, 1]),  # another place that fits as well
        (0.99, 1.01 * SAME, 1, [1, 1]),  # on the way there
        (0.0, 0.0, -1, [1, 1]),  # the other side of the mirror
    ],
)
def test_ends_are_one_where_place_and_sum_of_squares_agree(
    apart: float, higher: float, sign: int, hits: list[int]
) -> None:
    ends = population([[0.0, 0.0], [0.0, apart * optimiser._CLOSE]], [10.0, 10.0 + higher], (1, sign))
    kept = ends.distinct()
    assert kept.hits.tolist() == hits and kept.objective[0] == 10.0
    assert ends.best() == 0 and ends.best(sign) == (0 if sign == 1 else 1)


def test_only_the_best_few_of_a_side_are_followed() -> None:
    ends = Population(10.0 * np.arange(6)[:, None], np.ones(6, int), np.ones(6, int), np.arange(6, 0.0, -1))
    assert sorted(ends.distinct(most=3).objective) == [1, 2, 3]


@pytest.mark.parametrize(
    ("hits", "rests", "starts", "behind", "exhausted"),
    [
        (2, True, 8, 0.0, True),
        (1, True, 8, 0.0, False),
        (2, False, 8, 0.0, False),
        (1, True, optimiser._OUT_AFTER, 1.01 * optimiser._OUT, True),  # a side out of the question
        (1, True, optimiser._OUT_AFTER - 1, 1.01 * optimiser._OUT, False),
        (1, True, optimiser._OUT_AFTER, 0.99 * optimiser._OUT, False),
        (1, False, optimiser._OUT_AFTER, 1.01 * optimiser._OUT, False),
    ],
)
def test_a_search_is_exhausted_where_its_end_was_found_twice_and_rests(
    hits: int, rests: bool, starts: int, behind: float, exhausted: bool
) -> None:
    assert Optimum(1, np.zeros(2), 1.0, rests, hits, starts, behind).exhausted is exhausted


@pytest.mark.parametrize(("apart", "kept"), [(0.99, 1), (1.01, 2)])
def test_on_the_way_down_only_places_that_are_one_go_on_as_one(apart: float, kept: int) -> None:
    ends = population([[0.0, 0.0], [0.0, apart * optimiser._ONE]], [10.0, 10.0])
    assert len(ends.distinct(optimiser._ONE).Q) == kept and ends.distinct(optimiser._ONE).hits.sum() == 2


@pytest.fixture(scope="module")
def fitted(found: Searched, foot: Foot) -> Iterator[steady.Fitted]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optimiser, "ROUNDS", 1)
        yield steady.fit(replace(found.problem), foot, 2, 0, True)


@pytest.mark.parametrize(
    ("hits", "verdict", "word"),
    [((2, 2), "decided", "identified"), ((1, 2), "decided", "weak"), ((2, 1), "undecided", "identified")],
)
def test_what_was_found_once_is_weak_and_on_the_other_side_decides_nothing(
    fitted: steady.Fitted, foot: Foot, hits: tuple[int, int], verdict: str, word: str
) -> None:
    """Of a fit that decides, with hits as if the search had found the best end and the other side's so often."""
    ends = [
        replace(s, optimum=replace(s.optimum, hits=n, starts=12)) for s, n in zip(fitted.solutions, hits, strict=True)
    ]
    once = replace(fitted, solutions=tuple(ends))
    data = list(ends[0].problem.variables.recordings)
    built = [steady.branch_of(once, end, data) for end in ends]
    found = steady.verdict_of(once, built, Recorded(2), "")
    assert found.word == verdict and (found.sentence == NOT_EXHAUSTED) is (hits[1] == 1)
    assert built[0]["c_11"].identifiability == word and built[0].departures is not None
    assert built[0].departures.exhausted is (hits[0] == 2)


@pytest.mark.parametrize(("repeats", "follows"), [(0.149, True), (0.151, False)])
def test_beyond_the_bound_of_repeatability_nothing_is_offered(
    fitted: steady.Fitted, foot: Foot, repeats: float, follows: bool
) -> None:
    """What a fit found on either side of 15 %."""
    ends = [replace(s, problem=s.problem.with_repeatability(repeats)) for s in fitted.solutions]
    scattered = replace(fitted, solutions=tuple(ends))
    data = list(ends[0].problem.variables.recordings)
    built = [steady.branch_of(scattered, end, data) for end in ends]
    words = {e.identifiability for branch in built for e in branch.parameters.values()}
    assert (words == {"not identifiable"}) is not follows
    text = steady.verdict_of(scattered, built, Recorded(2), "").sentence
    assert ("does not follow the recordings" in text) is not follows


def quadratics(rng: np.random.Generator, count: int = 40, n: int = 5) -> tuple[Array, ...]:
    """J^T J, J^T r, places and bounds of as many problems, some places at a bound."""
    J, r = rng.normal(size=(count, 9, n)), rng.normal(size=(count, 9))
    Q = rng.normal(size=(count, n))
    low, high = Q - rng.uniform(0, 0.6, Q.shape), Q + rng.uniform(0, 0.6, Q.shape)
    low[:, 0], high[::2, 1] = Q[:, 0], Q[::2, 1]
    return np.swapaxes(J, 1, 2) @ J, np.einsum("cmn,cm->cn", J, r), Q, low, high


def test_a_step_is_the_minimum_between_its_bounds(rng: np.random.Generator) -> None:
    """Against scipy's L-BFGS-B on the quadratic itself."""
    A, g, Q, low, high = quadratics(rng)
    trial, falls = bounded_step(A, g, Q, low, high, np.zeros(len(Q)))
    for c in range(len(Q)):
        end = minimize(
            lambda p, A=A[c], g=g[c]: (2 * g @ p + p @ A @ p, 2 * (g + A @ p)), np.zeros(Q.shape[1]), jac=True,
            bounds=list(zip(low[c] - Q[c], high[c] - Q[c], strict=True)), method="L-BFGS-B",
            options={"ftol": 1e-15, "gtol": 1e-10},
        )  # fmt: skip
        assert falls[c] == pytest.approx(-end.fun, rel=1e-6, abs=1e-9)
        np.testing.assert_allclose(trial[c] - Q[c], end.x, atol=1e-5)


@pytest.mark.parametrize("room", [0.5, 3.0])
def test_a_step_takes_a_quantity_as_far_as_the_sum_of_squares_allows(rng: np.random.Generator, room: float) -> None:
    """Against scipy's SLSQP; with bounds, the sum of squares rises by what there is room for, or all bounds hold."""
    A, g, Q, low, high = quadratics(rng)
    along = rng.normal(size=Q.shape)
    trial, falls = bounded_step(A, g, Q, low, high, np.zeros(len(Q)), along, np.full(len(Q), room))
    for c in range(len(Q)):
        end = minimize(
            lambda p, a=along[c]: (-a @ p, -a), np.zeros(Q.shape[1]), jac=True, method="SLSQP",
            bounds=list(zip(low[c] - Q[c], high[c] - Q[c], strict=True)), options={"ftol": 1e-12, "maxiter": 500},
            constraints={"type": "ineq", "fun": lambda p, A=A[c], g=g[c]: room - (2 * g @ p + p @ A @ p)},
        )  # fmt: skip
        assert falls[c] >= -room - 1e-9
        assert along[c] @ (trial[c] - Q[c]) == pytest.approx(-end.fun, rel=1e-4, abs=1e-6)


@dataclass
class Bent(Valley):
    """Its floor swings from side to side, and its residual does not vanish there."""

    def residual(self, q: Array) -> Array:
        return np.array([3 * np.sin(3 * q[1]) + q[0], 4 + np.cos(3 * q[1]), 0.05 * (q[1] - 2)])

    def jacobian(self, q: Array) -> Array:
        return np.array([[1.0, 9 * np.cos(3 * q[1])], [0.0, -3 * np.sin(3 * q[1])], [0.0, 0.05]])


def test_a_valley_that_bends_is_followed_to_its_end() -> None:
    valley = Bent(np.full(2, -10.0), np.full(2, 10.0))
    down = descend(valley, np.array([[0.5, 0.8], [-1.0, 1.2]]), np.zeros(2, int), 60, 1e-6)  # type: ignore[arg-type]
    for q, objective in zip(down.Q, down.objective, strict=True):
        end = minimize(
            lambda q: float(np.sum(valley.residual(q) ** 2)), q, method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-12},
        )  # fmt: skip
        assert objective == pytest.approx(end.fun, abs=1e-5)


@pytest.mark.long
def test_scipy_does_not_improve_either_end(found: Searched) -> None:
    for optimum in found.optima:
        assert optimum.exhausted
        _, objective = _by_scipy(found.problem, optimum.q, optimum.sign, 60)
        assert objective > optimum.objective - 1e-3
