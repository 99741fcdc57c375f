"""Hammerstein-Wiener and NARX models: recovery of known ones, and the loaded foot at 10 and 15 Hz."""

import linear_foot as foot
import numpy as np
import pytest
from scipy.signal import lfilter

from fasbody.exceptions import SettingError
from identification.blackbox import narx, nonlinear, pem, selection
from identification.blackbox.data import Series
from identification.blackbox.identify import identify
from identification.blackbox.polynomial import Orders

ORDERS = Orders.of("oe", (2, 2, 1))


def test_hammerstein_wiener_is_recovered() -> None:
    """Y = w + 0.1 w^2 + noise, w = B/F (u + 0.3 u^3), over its scaled parameters."""
    rng = np.random.default_rng(0)
    u = rng.uniform(-2, 2, 4000)
    w = lfilter([0.0, 0.5, 0.2], [1.0, -1.2, 0.6], u + 0.3 * u**3)
    series = Series(u, w + 0.01 * w**2 + 0.02 * rng.standard_normal(4000), 1.0)
    model = nonlinear.estimate(series, ORDERS, (3, 2))
    s_u, s_w = model.input_scale, model.output_scale
    linear, quadratic = 1.0, 0.3 * s_u**2
    np.testing.assert_allclose(model.linear.theta, [0.5 * linear, 0.2, -1.2, 0.6], atol=0.02)
    assert model.input_terms == pytest.approx([0.0, quadratic], abs=0.03)
    assert model.output_terms[1] == pytest.approx(0.01 * s_w, abs=0.003)
    assert np.sqrt(model.loss) == pytest.approx(0.02, rel=0.1)


def test_gradient_equals_differences() -> None:
    rng = np.random.default_rng(1)
    u = rng.standard_normal(300)
    series = Series(u, lfilter([0.0, 0.5], [1.0, -0.7], u) + 0.1 * rng.standard_normal(300), 1.0)
    problem = nonlinear.Errors(ORDERS, (3, 3), 1.0, 1.0, [series])
    theta = np.array([0.4, 0.1, -0.6, 0.05, 0.1, 0.05, 0.02, 0.05, -0.01])
    at = problem.at(theta, gradient=True)
    slope = at.gradient[0].T @ at.errors[0]
    for k in range(len(theta)):
        step = np.zeros(len(theta))
        step[k] = 1e-6
        up, down = (np.sum(problem.at(theta + sign * step).errors[0] ** 2) / 2 for sign in (1, -1))
        assert slope[k] == pytest.approx((up - down) / 2e-6, rel=1e-4, abs=1e-4)


def loaded(frequency: float) -> tuple[Series, Series]:
    """The nonlinear foot with 4.5 kg, sensor noise on both channels."""
    n, rng = 4000, np.random.default_rng(round(frequency))
    u = foot.sine(frequency, n) + 0.03 * rng.standard_normal(n)
    y = foot.nonlinear_output(frequency, n, added_mass=4.5) + 0.05 * rng.standard_normal(n)
    return Series(u, y, foot.SAMPLE_TIME).split()


@pytest.mark.parametrize("frequency", [10.0, 15.0])
def test_nonlinear_models_beat_the_linear_ones_on_the_loaded_foot(frequency: float) -> None:
    estimation, validation = loaded(frequency)
    linear = pem.estimate("oe", estimation, ORDERS)
    bent = nonlinear.estimate(estimation, ORDERS, (3, 3), linear)
    fits = {m.structure: selection.judge(m, [validation]).fit_percent for m in (linear, bent)}
    fits["narx"] = narx.estimate(estimation, [validation]).fit_percent
    missed = {name: 100 - fit for name, fit in fits.items()}
    assert missed["hw"] < 0.4 * missed["oe"]
    assert missed["narx"] < 0.5 * missed["oe"]


def test_narx_recursion_is_found_and_simulated() -> None:
    """y(t) = 0.6 y(t-1) - 0.1 y(t-1) u(t-1) + 0.5 u(t-2): terms, coefficients, free simulation."""
    rng = np.random.default_rng(3)
    u = rng.uniform(-1, 1, 1500)
    y = np.zeros(1500)
    for t in range(2, 1500):
        y[t] = 0.6 * y[t - 1] - 0.1 * y[t - 1] * u[t - 1] + 0.5 * u[t - 2]
    estimation, validation = (Series(u[a:b], y[a:b], 1.0) for a, b in ((0, 1000), (1000, 1500)))
    found = narx.estimate(estimation, [validation], lags=2, degree=2, step=1)
    assert found.fit_percent > 99.99
    model = found.model
    assert isinstance(model, narx.Narx)
    coefficients = dict(zip(model.terms, model.theta, strict=True))
    assert coefficients[(0,)] == pytest.approx(0.6, abs=1e-6)
    assert coefficients[(0, 2)] == pytest.approx(-0.1 * model.u_scale, abs=1e-6)
    assert "y(t-1) u(t-1)" in str(model)


def duffing(n: int = 3000) -> Series:
    """m y'' + d y' + k y + k3 y^3 = u, stepped by RK4 between samples of a smooth random force: y answers u(t) at once.

    The force is a sum of sines, so that it is known between the samples, too.
    """
    rng = np.random.default_rng(2)
    angular, phase = 2 * np.pi * np.arange(1, 41) * 2.5, rng.uniform(0, 2 * np.pi, 40)
    time = np.arange(0, 2 * n + 1) * 0.5e-3
    force = 150.0 * np.cos(np.outer(time, angular) + phase).sum(axis=1)

    def slope(state: np.ndarray, u: float) -> np.ndarray:
        return np.array([state[1], u - 30.0 * state[1] - 9e4 * state[0] - 4e7 * state[0] ** 3])

    state, y, h = np.zeros(2), np.zeros(n), 1e-3
    for t in range(n):
        y[t] = state[0]
        u0, u1, u2 = force[2 * t : 2 * t + 3]
        k1 = slope(state, u0)
        k2 = slope(state + h / 2 * k1, u1)
        k3 = slope(state + h / 2 * k2, u1)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(state + h * k3, u2))
    return Series(force[:-1:2], y + 1e-6 * rng.standard_normal(n), 1e-3).centred()


def test_the_direct_term_and_simulation_serve_a_duffing_circuit() -> None:
    series = duffing()
    fit, check, fresh = series.cut(0, 1400), series.cut(1400, 2000), series.cut(2000, 3000)
    missed = {}
    for nk in (0, 1):
        found = narx.estimate(fit, [check], lags=2, step=1, nk=nk).model
        missed[nk] = 1 - selection.judge(found, [fresh]).fit_percent / 100
        assert isinstance(found, narx.Narx) and ("u(t)" in found.names) == (nk == 0)
    linear = selection.judge(pem.estimate("oe", fit, Orders.of("oe", (3, 2, 0))), [fresh])
    assert missed[0] < 0.02 and missed[0] < 0.5 * missed[1]
    assert missed[0] < 0.1 * (1 - linear.fit_percent / 100)


def test_derivatives_of_the_simulation_error() -> None:
    """Against central differences, with every kind of factor."""
    series = duffing(300)
    terms = ((0,), (1,), (2,), (0, 0, 1), (1, 3), ())
    theta = np.array([1.2, -0.5, 0.1, -0.02, 0.01, 0.003])
    model = narx.Narx(terms, theta, 2, 1, 0, 2e-3, 500.0, 1.0, 1, np.eye(6), 1e-3)
    problem = narx._Simulation([series], model)
    exact = problem.at(theta, gradient=True).gradient[0]
    for k, step in enumerate(1e-6 * np.eye(6)):
        central = (problem.at(theta + step).errors[0] - problem.at(theta - step).errors[0]) / 2e-6
        np.testing.assert_allclose(exact[:, k], central, atol=1e-6 * np.abs(exact).max())


def test_a_diverging_narx_has_no_fit() -> None:
    model = narx.Narx(((0, 0),), np.array([2.0]), 1, 1, 1, 1.0, 1.0, 1.0, 100, np.eye(1), 1e-3)
    series = Series(foot.prbs(100), 9 * foot.sine(20.0, 100) + 3, 1e-3)
    assert selection.judge(model, [series]).fit_percent == -np.inf


def test_degree_below_one() -> None:
    with pytest.raises(SettingError, match="degree 1 or more"):
        nonlinear.estimate(loaded(10.0)[0], ORDERS, (0, 3))


def test_a_binary_input_gets_no_input_polynomial() -> None:
    """On two levels u^3 is proportional to u: the command tries (1, q) only; asked for, it warns."""
    u = foot.prbs(1200)
    rng = np.random.default_rng(0)
    one = Series(u, foot.linear_output(u) + 0.25 * rng.standard_normal(1200), foot.SAMPLE_TIME)
    found = identify(one, ("hw",), {"oe": (2, 2, 1)}).models["hw"]
    assert found.selection.tried == 1
    assert all(c.model.degrees == (1, 3) for c in found.selection.candidates)  # type: ignore[attr-defined]
    assert any("input has 2 levels" in text for text in found.warnings)
    assert "cannot identify" in nonlinear.estimate(one, ORDERS, (3, 1)).warnings[-1]


def test_levels_are_counted_through_noise() -> None:
    rng = np.random.default_rng(0)
    binary, three = rng.integers(0, 2, 900) * 1.0, rng.integers(0, 3, 900) * 1.0
    assert nonlinear.levels(binary) == 2
    assert nonlinear.levels(three + 0.002 * rng.standard_normal(900)) == 3
    for many in (rng.standard_normal(900), np.sin(0.1 * np.arange(900)), rng.uniform(size=900)):
        assert nonlinear.levels(many) == np.inf
