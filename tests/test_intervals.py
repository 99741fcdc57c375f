"""Intervals: coverage by a Monte Carlo, a profile beside the curvature, the scale that all constants share."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares
from scipy.stats import binom, t
from steady_cases import BENT, problem, session

from identification.intervals import Solution, inverse_of_gram
from identification.optimiser import Optimum, finished
from identification.profile import Coordinates, ends
from identification.residual import Evaluation, Problem

Array = np.ndarray
FREQUENCIES = (10.0, 15.0, 20.0, 30.0, 50.0)
COUNTED = ("k_T", "k_F", "c_11", "c_21")


def solved(problem: Problem, q: Array) -> Solution:
    """The end of a descent from q (n,)."""
    q, objective, rests = finished(problem, q, 0)
    return Solution("best", problem, Optimum(0, q, objective, rests, 1, 1))


@pytest.fixture(scope="module")
def made() -> Problem:
    return problem(session(BENT, FREQUENCIES, (0.0, 2.3)))


@pytest.fixture(scope="module")
def solution(made: Problem) -> Solution:
    q = made.variables.start(BENT)
    return solved(made.weighed(q), q)


def test_the_inverse_knows_what_no_residual_sees() -> None:
    J = np.random.default_rng(0).normal(size=(20, 4))
    np.testing.assert_allclose(inverse_of_gram(J), np.linalg.inv(J.T @ J), rtol=1e-10)
    J[:, 2] = 0.0
    C, keep = inverse_of_gram(J), [0, 1, 3]
    assert np.isinf(C[2, 2])
    np.testing.assert_allclose(C[np.ix_(keep, keep)], np.linalg.inv(J[:, keep].T @ J[:, keep]), rtol=1e-10)


def test_the_covariance_is_that_of_the_curvature(solution: Solution) -> None:
    """Priors' rows included, what is held left out; a misfit widens it by its chi-square a degree of freedom."""
    J = solution.evaluation.jacobian[0]
    want = np.linalg.inv(J.T @ J)
    np.testing.assert_allclose(solution.covariance, want * solution.excess, rtol=1e-5, atol=1e-9 * np.abs(want).max())
    held = solution.problem.variables.held(["gain", "mount"])
    part = replace(solution, problem=solution.problem.with_held(held))
    C = part.covariance
    assert not C[held].any() and not C[:, held].any()
    assert (np.diag(C)[~held] / part.excess < 1.001 * np.diag(want)[~held]).all()
    noisy = solution.problem.measured
    coarse = replace(solution.problem, noise=solution.problem.noise / 9.0)
    assert replace(solution, problem=coarse).excess == pytest.approx(9 * solution.chi_square / solution.dof, rel=0.05)
    assert noisy.size - solution.dof == pytest.approx(np.trace(J[: noisy.size] @ want @ J[: noisy.size].T), abs=0.5)


def test_a_profile_is_as_wide_as_the_curvature_says() -> None:
    """k_F with its damper, the mass of the foot and a gain, none at a bound: where the sum of squares rises by 3.84."""
    made = problem(session(BENT, FREQUENCIES[1:4]), free=["k_F", "c_21"], exclude=["all"], delay_std_s=0.0)
    q = made.variables.start(BENT)
    here = solved(made.weighed(q), q)
    at = made.variables.index["k_F"]
    others = np.delete(np.arange(q.size), at)

    def rise(x: float) -> float:
        def now(rest: Array) -> Evaluation:
            return here.problem.evaluate(np.insert(rest, at, x)[None])

        fit = least_squares(
            lambda rest: now(rest).residual[0], here.q[others], lambda rest: now(rest).jacobian[0][:, others],
            xtol=1e-12, ftol=1e-12,
        )  # fmt: skip
        return float(2 * fit.cost - here.optimum.objective - 3.8415)

    std = float(np.sqrt(here.covariance[at, at] / here.excess))
    ends = [brentq(rise, here.q[at], here.q[at] + sign * 4 * std, xtol=1e-3 * std) for sign in (-1, 1)]
    e = replace(here, problem=here.problem).estimates()[0]["k_F_n_per_m"]
    reach = np.sqrt(here.excess)
    np.testing.assert_allclose((np.array(ends) - here.q[at]) / std, [-1.96, 1.96], rtol=0.1)
    assert np.log(e.upper / e.value) == pytest.approx(1.96 * std * reach, rel=1e-3)


@pytest.mark.long
def test_where_a_parabola_does_not_hold_intervals_end_where_the_profile_does() -> None:
    """A spring that may relax, and a soft mount: both rest on zero, and can only change k_F one way."""
    made = problem(session(BENT, FREQUENCIES[1:4]), free=["k_F", "c_21"], exclude=["rocking", "drift"])
    q = made.variables.start(BENT)
    here = solved(made.weighed(q), q)
    at = made.variables.index["k_F"]
    others = np.delete(np.arange(q.size), at)
    low, high = (limit[others] for limit in here.problem.bounds())
    begin = np.clip(here.q[others], low + 1e-6, high - 1e-6)

    def rise(x: float) -> float:
        def at_rest(rest: Array) -> Evaluation:
            return here.problem.evaluate(np.insert(rest, at, x)[None])

        fit = least_squares(
            lambda rest: at_rest(rest).residual[0], begin, lambda rest: at_rest(rest).jacobian[0][:, others],
            bounds=(low, high), xtol=1e-10, ftol=1e-10, gtol=1e-10, max_nfev=400,
        )  # fmt: skip
        return float(2 * fit.cost - here.optimum.objective - here.quantile**2 * here.excess)

    curved, profiled = (here.estimates(profiles)[0]["k_F_n_per_m"] for profiles in (False, True))
    ratios = []
    for end, parabola, sign in ((profiled.lower, curved.lower, -1), (profiled.upper, curved.upper, 1)):
        half = abs(np.log(parabola / curved.value))
        want = brentq(rise, here.q[at], here.q[at] + sign * 3 * half, xtol=1e-2 * half)
        assert np.log(end / curved.value) == pytest.approx(want - here.q[at], rel=0.08)
        ratios.append(abs(want - here.q[at]) / half)
    assert max(ratios + [1 / ratio for ratio in ratios]) > 1.15, "a parabola would do"


def test_every_end_of_a_profile_is_as_unlikely_as_it_should_be() -> None:
    """A leg with two loads, its masses unsure: at each end SciPy's best fit has risen by the quantile's square."""
    made = problem(
        session(BENT, FREQUENCIES[1:4], (0.0, 2.3)), free=list(COUNTED), exclude=["rocking", "drift", "share"]
    )
    q = made.variables.start(BENT)
    here = solved(made.weighed(q), q)
    v, rise = here.problem.variables, here.quantile**2 * here.excess
    low, high = here.problem.bounds(here.optimum.sign)
    free = np.flatnonzero(high > low)
    for name in ("k_T", "c_21"):

        def coordinate(Q: Array, name: str = name) -> Array:
            return np.log(v.dynamic(Q)[name])

        std, at = float(here.spread(here.slopes(lambda q: coordinate(q)[None]))[0]), float(coordinate(here.q))
        for sign, reach in zip((-1, 1), here.profiles[name], strict=True):
            place, stiff = at + sign * reach, 100 / std

            def whole(y: Array) -> Array:
                z = here.q.copy()
                z[free] = y
                return z

            def residual(y: Array, place: float = place, stiff: float = stiff) -> Array:
                z = whole(y)
                return np.append(here.problem.evaluate(z[None]).residual[0], stiff * (coordinate(z) - place))

            def jacobian(y: Array, stiff: float = stiff) -> Array:
                z = whole(y)[None]
                last = stiff * v.slopes(coordinate, z, free)
                return np.concatenate([here.problem.evaluate(z).jacobian[0][:, free], last])

            along = sign * reach / std**2 * (here.covariance @ here.slopes(lambda q: coordinate(q)[None])[0])
            begin = np.clip((here.q + along)[free], low[free] + 1e-6, high[free] - 1e-6)
            fit = least_squares(residual, begin, jacobian, (low[free], high[free]), x_scale="jac", max_nfev=300)
            assert (2 * fit.cost - here.optimum.objective) / rise == pytest.approx(1.0, abs=0.1), (name, sign)


@pytest.mark.parametrize(("tilt", "reaches"), [(0.9, True), (1.1, False)])
def test_an_interval_spans_every_valley_that_is_as_likely(tilt: float, reaches: bool) -> None:
    """Of two valleys with a ridge between them, at 1 and near -1, where the sum of squares is about (2 tilt)^2."""

    def residual(x: Array) -> Array:
        return np.stack([3 * (x * x - 1), tilt * (x - 1)], -1)

    def evaluate(Q: Array, near: object = None) -> Evaluation:
        x = Q[:, 0]
        slope = np.stack([6 * x, np.full(x.size, tilt)], -1)[..., None]
        return Evaluation(residual(x), slope, np.ones(x.size, bool), None)

    ones = SimpleNamespace(slopes=lambda function, Q, of: np.ones((len(Q), 1, 1)))
    two = SimpleNamespace(evaluate=evaluate, variables=ones, held=np.zeros(1, bool),
                          bounds=lambda sign: (np.array([-9.0]), np.array([9.0])))  # fmt: skip
    coordinate = Coordinates(lambda Q: Q, np.array([1.0]), np.array([1 / 6]))
    rise = 1.96**2
    below, above = ends(two, np.array([[1.0], [-0.95]]), 0, coordinate, rise, 1.96)[0]  # type: ignore[arg-type]

    def risen(x: float) -> float:
        return float((residual(np.array(x)) ** 2).sum() - rise)

    assert 1 + above == pytest.approx(brentq(risen, 1.0, 3.0), abs=0.01)
    assert 1 - below == pytest.approx(brentq(risen, -3.0, -1.0) if reaches else brentq(risen, 0.0, 1.0), abs=0.02)


def test_of_exact_masses_the_scale_has_no_profile_and_the_constants_have() -> None:
    made = problem(session(BENT, FREQUENCIES[1:5]), mass_std=0.0, exclude=["share", "rocking", "drift", "mount"])
    q = made.variables.start(BENT)
    here = solved(made.weighed(q), q)
    assert here.scale_std() == 0.0 and set(here.profiles) == set(COUNTED)
    estimates, _ = here.estimates(profiles=True)
    for name in COUNTED:
        e = next(e for key, e in estimates.items() if key.startswith(f"{name}_"))
        assert np.isfinite([e.lower, e.upper]).all() and e.lower < e.value < e.upper


def test_what_repeats_no_better_has_students_quantile(solution: Solution) -> None:
    scattered = replace(solution, problem=solution.problem.with_repeatability(0.02))
    assert solution.quantile == pytest.approx(1.96, abs=1e-3)
    assert scattered.quantile == pytest.approx(t.ppf(0.975, scattered.dof)) and scattered.quantile > solution.quantile


def test_one_scale_is_common_to_all_constants() -> None:
    """Springs, dampers and masses times 1.1 move alike under one load: natural frequencies are known far better."""
    made = problem(session(BENT, FREQUENCIES))
    v, q = made.variables, made.variables.start(BENT)
    heavier = q.copy()
    heavier[v.index["k_T"]] += np.log(1.1)  # sigma, the mean of both springs
    for name in ("c_11", "c_21"):
        heavier[v.index[name]] += np.log(1.1)
    for kind in ("shank mass", "foot mass"):
        i = v.of_kind(kind)
        assert i is not None
        heavier[i] += np.log(1.1) / v.scale[i]
    np.testing.assert_allclose(made.predicted(heavier), made.predicted(q), rtol=1e-9, atol=1e-9)
    for name in COUNTED:
        assert v.dynamic(heavier)[name] == pytest.approx(1.1 * v.dynamic(q)[name])
    found = solved(made.weighed(q), q)
    names = [v.motion_names.index(name) for name in ("k_T", "m_S")]

    def stiffness_and_frequency(q: Array) -> Array:
        k, m = v.theta(q)[0, names]
        return np.log([k, np.sqrt(k / m), 1.0 * m])

    k, w, m = found.spread(found.slopes(stiffness_and_frequency))
    assert k > 0.06 and w < 0.6 * k
    assert found.scale_std() == pytest.approx(m, rel=0.5) and 0.05 < found.scale_std() < 0.15
    known = problem(session(BENT, FREQUENCIES), mass_std=0.0)
    assert solved(known.weighed(known.variables.start(BENT)), known.variables.start(BENT)).scale_std() == 0.0


def test_at_rest_stands_beside_what_is_dynamic() -> None:
    """Springs that relax: each interval holds its own truth; where nothing may relax there is one number."""
    share, tau = 0.5, 5e-3
    relaxing = BENT | {"r_T": share, "r_F": share, "tau": tau}
    made = problem(session(relaxing, FREQUENCIES, noise=0.005), mass_std=0.02)
    q = made.variables.start(BENT)
    found = solved(made.weighed(q), q)
    x = 2 * np.pi * made.variables.reference_hz * tau
    dynamic = {"k_F_n_per_m": BENT["k_F"] * (1 + share * x * x / (1 + x * x)),
               "c_21_n_s_per_m": BENT["c_21"] + BENT["k_F"] * share * tau / (1 + x * x)}  # fmt: skip
    for key, value in dynamic.items():
        e = found.estimates()[0][key]
        assert e.at_rest is not None
        assert e.lower < value < e.upper and e.at_rest.lower < BENT[key.split("_n_")[0]] < e.at_rest.upper
        assert e.at_rest.value < e.value and e.at_rest.lower / e.lower < e.at_rest.upper / e.upper
    plain = problem(session(BENT, FREQUENCIES), exclude=["relaxation"])
    held = made.with_held(made.variables.held(["relaxing", "relaxation time"]))
    for fixed in (plain, held):
        estimates, _ = solved(fixed, fixed.variables.start(BENT)).estimates()
        assert all(e.at_rest is None for e in estimates.values())


@pytest.mark.parametrize(("share", "rests"), [(0.5e-4, True), (2e-4, False)])
def test_a_constant_rests_on_a_bound_within_a_ten_thousandth_of_its_range(share: float, rests: bool) -> None:
    """Of the logarithm of a stiffness, whose bounds lie around what is there."""
    low = BENT["k_T"] * np.exp(-2.0 * share)
    made = problem(session(BENT, FREQUENCIES[:2]), bounds={"k_T": (low, low * np.exp(2.0))})
    q = made.variables.start(BENT)
    estimates, _ = Solution("best", made, Optimum(0, q, 1.0, True, 1, 1)).estimates()
    assert estimates["k_T_n_per_m"].at_bound is rests
    assert (estimates["k_T_n_per_m"].identifiability == "not identifiable") is rests


def test_bends_alone_are_fitted() -> None:
    """No spring or damper is free, so nothing differs by seating, and nothing has a kilogram in it."""
    made = problem(session(BENT, FREQUENCIES[:2]), free=["c_12", "c_22"])
    q = made.variables.start(BENT)
    here = solved(made.weighed(q), q)
    assert here.per_kilogram() == [] and here.problem.seats.shape[-1] == 0
    e = here.estimates(profiles=True)[0]["c_12_per_m"]
    assert e.lower < BENT["c_12"] < e.upper


@pytest.mark.long
def test_intervals_hold_the_truth_as_often_as_they_say(made: Problem) -> None:
    """Twenty legs whose masses, channels, springs and loads are drawn from their priors, with noise."""
    v, rng, trials = made.variables, np.random.default_rng(11), 20
    mean, _ = v.prior
    low, high = v.bounds
    start, count = v.start(BENT), dict.fromkeys(COUNTED, 0)
    drawn = np.arange(v.size) >= len(v.constants)
    made = made.weighed(start)
    for _ in range(trials):
        q = start + drawn * rng.normal(size=v.size)
        while (outside := drawn & ((q < low) | (q > high))).any():
            q[outside] = (mean + rng.normal(size=v.size))[outside]
        noise = np.linalg.cholesky(made.noise) @ rng.normal(size=made.noise.shape[:2])[..., None]
        half = noise.shape[1] // 2
        e = (noise[:, :half, 0] + 1j * noise[:, half:, 0]).reshape(made.measured.output.shape)
        output = np.where(made.measured.valid, made.predicted(q) + e, 0.0)
        found = solved(replace(made, measured=replace(made.measured, output=output)), start)
        estimates, _ = found.estimates()
        truth = v.dynamic(q)
        for name in COUNTED:
            e_ = next(each for key, each in estimates.items() if key.startswith(name))
            count[name] += bool(e_.lower <= truth[name] <= e_.upper)
    least, _ = binom.interval(0.998, trials, 0.95)
    assert min(count.values()) >= least, count
