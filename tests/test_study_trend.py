"""Curves over frequency and load: splines and Jacobian against SciPy and differences, known curves recovered."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.stats import multivariate_normal
from study_cases import NONLINEAR, power_laws, record, study

from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot.model import Foot
from identification.engines.twin import Twin
from identification.estimate import Settings
from identification.periodic import Line
from identification.space import space_of
from identification.study import trend
from identification.study.curves import CurveSpace, Order, natural_spline
from identification.study.orders import linear_deviance, orders_for
from identification.study.scatter import TrendProblem
from identification.study.trend import CURVES, TrendResult, fit_trend, refit

F = (10.0, 15.0, 25.0, 40.0)


def curve_space(foot: Foot, order: Order, loads: tuple[float, ...] = (0.0, 4.5), scatter: bool = False) -> CurveSpace:
    f, m = np.meshgrid(F, loads)
    return CurveSpace(space_of(foot), CURVES, order, f.ravel(), m.ravel(), scatter)


@pytest.mark.parametrize("knots", [1, 2, 3, 5])
def test_spline_is_scipys_between_knots_and_straight_beyond(knots: int) -> None:
    values = np.random.default_rng(knots).normal(size=knots)
    f = np.geomspace(10, 50, 23)
    have = natural_spline(f, knots, 10, 50) @ values
    at = np.linspace(np.log(10), np.log(50), knots)
    want = values[0] + 0 * f if knots == 1 else np.interp(np.log(f), at, values)
    if knots > 2:
        want = CubicSpline(at, values, bc_type="natural")(np.log(f))
    np.testing.assert_allclose(have, want, atol=1e-12)
    beyond = natural_spline(np.geomspace(60, 240, 5), knots, 10, 50) @ values  # evenly spaced in log f
    np.testing.assert_allclose(np.diff(beyond, 2), 0, atol=1e-12)


def test_power_laws_are_in_the_space_and_have_the_coefficients_that_they_should(foot: Foot) -> None:
    space = curve_space(foot, Order(2, 1, 1))
    feet = [power_laws(f, m) for f, m in zip(space.frequencies_hz, space.loads_kg, strict=True)]
    beta = space.project([space.feet.to_q(space.feet.theta(v)) for v in feet])
    for have, want in zip(space.feet_of(beta), feet, strict=True):
        assert {n: have[n] for n in want} == pytest.approx(want)
    named = dict(zip(space.labels, beta, strict=True))
    assert named["log k_T at 10 Hz"] == pytest.approx(np.log(power_laws(10.0, 0.0)["k_T"]))
    assert named["log k_T per (load/4.5 kg)"] == pytest.approx(0.3)


def test_jacobian_by_the_chain_rule_against_differences(foot: Foot) -> None:
    recordings = study(power_laws, F, (0.0, 4.5))
    space = curve_space(foot, Order(3, 1, 2), scatter=True)
    lines = [Line.of(r) for r in recordings]
    problem = TrendProblem(
        lines, Twin(foot, [line.excitation for line in lines]), space, np.array([0.1, 0.2, 0.3, 0.1])
    )
    problem.tolerance = 1e-11
    rng = np.random.default_rng(0)
    feet = [power_laws(f, m) for f, m in zip(space.frequencies_hz, space.loads_kg, strict=True)]
    z = space.project([space.feet.to_q(space.feet.theta(v)) for v in feet])
    z[space.size :] = rng.normal(0, 0.05, z.size - space.size)
    z[space.size + 1] = 4.0  # this foot lies beyond the bounds: the wall's rows take part
    J = problem.jacobian(z).copy()
    assert (problem.residual(z)[-32:] != 0).sum() == 1
    for j in range(z.size):
        d = 1e-5 * np.eye(z.size)[j]
        want = (problem.residual(z + d) - problem.residual(z - d)) / 2e-5
        assert np.abs(J[:, j] - want).max() < 2e-4 * np.abs(want).max(), j


def test_marginal_deviance_of_the_linear_model_is_the_gaussian_one(foot: Foot) -> None:
    """Offsets and shared errors integrated out: r ~ N(-G B beta, I + G T^2 G' + V V'), by scipy's density of it all."""
    rng = np.random.default_rng(3)
    space = curve_space(foot, Order(2, 1, 1))
    sizes = (12, len(space.feet.free)), (12, 2)
    local = [(rng.normal(size=12), *(rng.normal(size=size) for size in sizes)) for _ in space.loads_kg]
    have, tau = linear_deviance(local, space, np.full(4, 0.5))
    G = [g[:, space.places] * tau for _, g, _ in local]
    X = np.vstack([g @ B for (_, g, _), B in zip(local, space.weights, strict=True)])
    r, V = np.concatenate([r for r, *_ in local]), np.vstack([v for *_, v in local])
    S = V @ V.T
    for i, g in enumerate(G):
        S[12 * i : 12 * i + 12, 12 * i : 12 * i + 12] += np.eye(12) + g @ g.T
    beta = -np.linalg.lstsq(np.linalg.solve(L := np.linalg.cholesky(S), X), np.linalg.solve(L, r), rcond=None)[0]
    want = -2 * multivariate_normal(cov=S).logpdf(r + X @ beta) - r.size * np.log(2 * np.pi)
    assert have == pytest.approx(want, rel=1e-9)


def test_linearised_criteria_find_the_order_and_the_scatter(foot: Foot) -> None:
    rng = np.random.default_rng(1)
    f, m = np.meshgrid(np.arange(10.0, 55.0, 5.0), (0.0, 2.3, 4.5))
    true = CurveSpace(space_of(foot), CURVES, Order(3, 1, 1), f.ravel(), m.ravel())
    beta, local = 0.5 * rng.normal(size=true.size), []
    for B in true.weights:
        G = 50 * rng.normal(size=(8, len(true.feet.free)))
        q = B @ beta
        q[true.places] += 0.1 * rng.normal(size=4)
        local.append((rng.normal(size=8) - G @ q, G, np.zeros((8, 0))))
    bic = {}
    for order in orders_for(true):
        space = CurveSpace(true.feet, CURVES, order, f.ravel(), m.ravel())
        deviance, tau = linear_deviance(local, space, np.full(4, 0.3))
        bic[order] = (deviance + np.log(8 * 27) * (space.size + 4), tau)
    best = min(bic, key=lambda order: bic[order][0])
    assert best == Order(3, 1, 1)
    np.testing.assert_allclose(bic[best][1], 0.1, rtol=0.4)  # 27 offsets each: 14 % standard error


@pytest.fixture(scope="module")
def known(foot: Foot) -> TrendResult:
    return fit_trend(
        study(power_laws, F, (0.0, 4.5), seed=5, seconds=2.0), foot, Settings(wide=False, starts=1, threads=1),
        order=Order(2, 1, 1), scatter=False,
    )  # fmt: skip


def test_known_curves_are_recovered_in_mujoco(known: TrendResult) -> None:
    z = []
    for f, load in ((10.0, 0.0), (20.0, 0.0), (40.0, 4.5), (25.0, 2.0)):  # 20 Hz and 2 kg were never recorded
        for key, e in known.best.at(f, load).items():
            if key != "delay_s":
                want = power_laws(f, load)[key.split("_n_")[0].removesuffix("_per_m")]
                z.append((e.value - want) / e.std_error)
                assert e.lower < e.value < e.upper
    assert np.abs(z).max() < 4
    assert np.mean(np.square(z)) < 4
    best = known.best
    assert 0.5 < best.chi_square / best.dof < 1.6
    assert best.name == "stiff ankle"
    assert known.twin_mujoco_difference is not None
    assert known.twin_mujoco_difference < 1e-6
    assert best.fit_percent > 97


def test_loads_and_nonlinear_damping_decide_the_branch(known: TrendResult) -> None:
    assert [b.name for b in known.branches] == ["stiff ankle", "stiff pad"]
    assert known.verdict == "decided"
    assert any("2 coefficients over 2 loads go through any change" in text for text in known.warnings)
    assert known.branches[1].deviance - known.branches[0].deviance > 20


def test_standard_errors_of_a_curve_follow_from_the_coefficients(known: TrendResult) -> None:
    """Var log k = b' C b by differences of the curve to each coefficient."""
    best, space = known.best, known.best.space
    B = space.design(np.array([17.0]), np.array([1.0]))[0]
    place = [i.name for i in space.feet.free].index("k_F")

    def log_k(beta: np.ndarray) -> float:
        return float(np.log(space.foot(B, beta)[0][place]))

    slope = np.array([(log_k(best.beta + d) - log_k(best.beta - d)) / 2e-6 for d in 1e-6 * np.eye(space.size)])
    e = best.at(17.0, 1.0)["k_F_n_per_m"]
    assert e.std_error / e.value == pytest.approx(np.sqrt(slope @ best.covariance @ slope), rel=1e-6)


def test_document_is_plain_and_keeps_the_contract(known: TrendResult) -> None:
    document = json.loads(json.dumps(known.document()))
    assert {"fit_percent", "chi_square", "dof", "p_value", "aic", "bic", "verdict", "verdict_reason"} <= set(document)
    assert len(document["recordings"]) == 8
    branch = document["branches"][0]
    assert {"name", "deviance", "fit_percent", "coefficients", "points"} <= set(branch)
    assert len(branch["points"]) == 8
    point = branch["points"][0]
    assert {"value", "std_error", "lower", "upper", "identifiability"} <= set(point["parameters"]["k_T_n_per_m"])
    assert branch["aic"] == pytest.approx(branch["deviance"] + 2 * 17)
    assert str(known).startswith("stiff ankle, 2 knots, load 1")


def test_scatter_between_recordings_is_learnt(foot: Foot, known: TrendResult) -> None:
    """Constants off their curves by 5 %: the learnt scatter says so, and standard errors grow from 0.4 to percents."""
    recordings = study(power_laws, (10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0), (0.0, 4.5), seed=2, scatter=0.05)
    space = replace(known.best.space, scatter=True)
    start = replace(known.best, space=space, scatter=dict.fromkeys(CURVES, 0.1))
    found = refit(start, recordings, foot, threads=1)
    assert 0.02 < np.median(found.tau) < 0.09
    e, wide = known.best.at(20.0, 0.0), replace(start, space=found.space, z=found.z, covariance=found.covariance)
    for key in ("k_T_n_per_m", "k_F_n_per_m", "c_21_n_s_per_m"):
        v = wide.at(20.0, 0.0)[key]
        assert v.std_error > 2 * e[key].std_error
        assert abs(v.value - power_laws(20.0, 0.0)[key.split("_n_")[0]]) < 4 * v.std_error


def test_what_cannot_be_a_trend(foot: Foot) -> None:
    with pytest.raises(SettingError, match="two or more frequencies"):
        fit_trend([record(power_laws, 20.0), record(power_laws, 20.0, 4.5)], foot)
    with pytest.raises(SettingError, match="4 frequencies, 2 loads allow 1 to 4 knots, powers of the load up to 1"):
        curve_space(foot, Order(5, 1, 1))
    assert NONLINEAR["c_12"] == power_laws(10.0, 0.0)["c_12"]


def test_an_unstable_branch_is_said_to_be_unstable(foot: Foot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever branch MuJoCo refuses, the other is reported with the true reason; if both, the fit fails."""
    whole, refused = trend._certify, ["stiff ankle"]

    def certify(frame: Any, name: str, state: Any, really: bool) -> Any:
        if name in refused:
            raise SimulationError(f"two_dof: {name} became unstable")
        return whole(frame, name, state, really)

    explored, search, ways = list[Any](), trend.explore_trend, trend.both_ways

    def explore(*arguments: Any) -> Any:
        if not explored:
            explored.append(search(*arguments))
        return explored[0]

    monkeypatch.setattr(trend, "_certify", certify)
    monkeypatch.setattr(trend, "explore_trend", explore)
    monkeypatch.setattr(trend, "grown", lambda frame, states, *_: states)
    monkeypatch.setattr(trend, "both_ways", lambda frame, states: states if explored else ways(frame, states))
    recordings = study(power_laws, (15.0, 30.0), (0.0,), seconds=1.0)
    settings = Settings(wide=False, starts=1, threads=1)
    found = fit_trend(recordings, foot, settings, order=Order(2, 0, 1), scatter=False, certify=False)
    assert [b.name for b in found.branches] == ["stiff pad"]
    assert found.verdict == "not compared"
    assert found.reason.startswith("The stiff ankle branch ends where the foot is unstable in MuJoCo")
    assert "bounds" not in found.reason
    assert any(text.startswith("The stiff ankle branch ends") for text in found.warnings)
    refused.append("stiff pad")
    with pytest.raises(SimulationError, match="became unstable"):
        fit_trend(recordings, foot, settings, order=Order(2, 0, 1), scatter=False, certify=False)


def test_curves_that_misfit_decide_nothing(foot: Foot) -> None:
    """k_F that jumps between frequencies by a factor of four: odds of such curves exceed 1000 to 1 and mean nothing."""

    def jumping(f: float, load: float) -> dict[str, float]:
        values = power_laws(f, load)
        return values | {"k_F": values["k_F"] * {10.0: 2.2, 15.0: 0.5, 20.0: 1.6, 30.0: 0.5}[f]}

    recordings = study(jumping, (10.0, 15.0, 20.0, 30.0), (0.0,))
    found = fit_trend(recordings, foot, Settings(wide=False, starts=1, threads=1), order=Order(2, 0, 1), certify=False)
    assert max(found.best.scatter.values()) > 0.3
    assert found.log_likelihood_ratio > np.log(1000)  # what would have been called decided
    assert found.verdict == "undecided"
    assert found.reason.startswith("The recordings lie off the curves by")
    assert "mean nothing" in found.reason
    assert any(text.endswith("the curves describe them poorly.") for text in found.warnings)
