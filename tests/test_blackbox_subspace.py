"""Subspace models: exact on noise-free data, accurate on the foot, consistent in all their forms."""

import linear_foot as foot
import numpy as np
import pytest
from recorded_foot import record

from fasbody.exceptions import SettingError
from identification.blackbox import subspace
from identification.blackbox.data import Series

BAND = np.linspace(5, 60, 56)


def test_noise_free_order_and_poles() -> None:
    found = subspace.decompose(record(foot.prbs(3000), noise=0.0))
    assert found.singular_values[4] < 1e-8 * found.singular_values[0]
    model = found.model(4)
    exact = np.roots(foot.transfer()[1])
    np.testing.assert_allclose(np.sort_complex(model.poles()), np.sort_complex(exact), atol=1e-6)
    np.testing.assert_allclose(model.response(BAND).value, foot.response(BAND), rtol=1e-6)


def test_foot_with_noise() -> None:
    """At most 1 % with PRBS, order found, no worse after refinement."""
    series = record(foot.prbs(7000))
    found = subspace.decompose(series)
    assert found.order() == 4
    plain, refined = found.model(4), found.model(4, refine=True)
    for model in (plain, refined):
        assert np.abs(model.response(BAND).value / foot.response(BAND) - 1).max() < 0.01
    assert refined.transfer.loss <= plain.transfer.loss * (1 + 1e-12)


def test_simulation_and_prediction_equal_the_state_recursion() -> None:
    model, series = subspace.estimate(record(foot.prbs(3000)), 4), record(foot.prbs(500), 3)
    forced = np.zeros(500)
    x = np.zeros(4)
    for t in range(500):
        forced[t] = model.C @ x + model.D * series.u[t]
        x = model.A @ x + model.B * series.u[t]
    rest = model.simulate(series) - forced  # a free motion and a level
    powers = [np.array([model.C @ np.linalg.matrix_power(model.A, t) for t in range(500)]), np.ones((500, 1))]
    columns = np.hstack(powers)
    left = rest - columns @ np.linalg.lstsq(columns, rest, rcond=None)[0]
    assert np.abs(left).max() < 1e-7
    assert np.std(series.y - model.predict(series)) == pytest.approx(0.25, rel=0.1)


def test_kalman_gain_whitens_the_residuals() -> None:
    """Data of an innovations model of order two with a slow disturbance: K shortens the errors to the innovation."""
    rng = np.random.default_rng(4)
    A, B, C, K = np.array([[0.9, 0.2], [-0.1, 0.8]]), np.array([1.0, 0.5]), np.array([1.0, 0.0]), np.array([0.6, 0.2])
    n, u, e = 6000, rng.standard_normal(6000), rng.standard_normal(6000)
    x, y = np.zeros(2), np.zeros(6000)
    for t in range(n):
        y[t] = C @ x + e[t]
        x = A @ x + B * u[t] + K * e[t]
    model = subspace.estimate(Series(u, y, 1.0), 2)
    assert np.sqrt(model.loss) == pytest.approx(1.0, rel=0.04)
    errors = model.residuals(Series(u, y, 1.0))[50:]
    assert abs(errors[1:] @ errors[:-1] / (errors @ errors)) < 0.06
    shared = np.linalg.eigvals(model.A - np.outer(model.K, model.C))
    np.testing.assert_allclose(sorted(shared.real), sorted(np.linalg.eigvals(A - np.outer(K, C)).real), atol=0.12)


def test_polynomial_form_has_the_same_response() -> None:
    model = subspace.estimate(record(foot.prbs(3000)), 5)
    np.testing.assert_allclose(model.response(BAND).value, model.transfer.response(BAND).value, rtol=1e-6)
    space = model.to_state_space()
    assert space.A.shape == (5, 5)


def test_orders_and_lengths_that_cannot_be() -> None:
    with pytest.raises(SettingError, match="not between 1 and 15"):
        subspace.decompose(record(foot.prbs(1000))).model(16)
    with pytest.raises(SettingError, match="more than"):
        subspace.estimate(record(foot.prbs(90)), 4)


def test_only_refined_models_have_intervals_and_they_cover() -> None:
    """Multisine, 6 records: the plain estimate errs by many formal deviations, the refined interval holds the gain."""
    inside, exact = [], np.abs(foot.response(BAND))
    for seed in range(6):
        found = subspace.decompose(record(foot.multisine(2000), seed))
        response = found.model(4, refine=True).response(BAND)
        inside.append(np.mean(np.abs(np.abs(response.value) - exact) < 1.96 * response.gain_std))
    assert 0.85 <= np.mean(inside) <= 1.0
    plain = found.model(4)
    assert plain.warnings == (subspace.UNREFINED,)
    assert np.isnan(plain.response(BAND).gain_std).all()


def test_a_moved_pole_is_named_and_leaves_no_intervals() -> None:
    """An integrator's pole at one is drawn in: the estimate is another plant, and says so."""
    rng = np.random.default_rng(3)
    u = rng.standard_normal(1500)
    u -= u.mean()
    y = np.concatenate([[0.0], np.cumsum(u)[:-1]])
    model = subspace.decompose(Series(u, y, 1.0)).model(1)
    assert "pole 1.0000 moved to modulus 0.999" in model.warnings[0]
    assert np.isnan(model.transfer.std_error).all()
    assert np.abs(model.poles()) == pytest.approx([0.999])
