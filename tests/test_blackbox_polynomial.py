"""Polynomial models: response, prediction, simulation and conversions against direct recursions."""

import linear_foot as foot
import numpy as np
import pytest
from scipy import signal

from fasbody.exceptions import SettingError
from identification.blackbox.data import Series
from identification.blackbox.filters import free_run, stabilise
from identification.blackbox.polynomial import Orders, PolynomialModel

RNG = np.random.default_rng(5)
BJ = Orders.of("bj", (2, 1, 1, 2, 3))
THETA = np.array([0.5, 0.2, 0.4, -0.6, -1.2, 0.5])  # b, c, d, f


def model(structure: str = "bj", orders: Orders = BJ, theta: np.ndarray = THETA) -> PolynomialModel:
    return PolynomialModel(structure, orders, theta, 1e-3 * np.eye(len(theta)), 1.0, 100, 0.01)


def recorded(n: int = 400) -> tuple[Series, np.ndarray]:
    """Data of the BJ model by its recursions, and the innovations."""
    u, e = RNG.standard_normal(n), RNG.standard_normal(n)
    z, w = np.zeros(n), np.zeros(n)
    for t in range(n):
        z[t] = 1.2 * z[t - 1] * (t > 0) - 0.5 * z[t - 2] * (t > 1)
        z[t] += 0.5 * u[t - 3] * (t > 2) + 0.2 * u[t - 4] * (t > 3)
        w[t] = 0.6 * w[t - 1] * (t > 0) + e[t] + 0.4 * e[t - 1] * (t > 0)
    return Series(u, z + w, 0.01), e


def test_prediction_error_is_the_innovation_of_the_recursions() -> None:
    series, e = recorded()
    errors = model().residuals(series)
    assert np.std(errors[30:] - e[-len(errors) :][30:]) < 0.1  # initial state and level are fitted, no more
    assert np.corrcoef(errors[30:], e[-len(errors) :][30:])[0, 1] > 0.995


def test_prediction_uses_only_the_past() -> None:
    """Changing the last output leaves its own prediction as it was (the filters' part: the fitted level moves 1/N)."""
    series, _ = recorded()
    y = series.y.copy()
    y[-1] += 100.0
    changed = Series(series.u, y, series.sample_time)
    assert abs(model().predict(changed)[-1] - model().predict(series)[-1]) < 2.0


def test_response_equals_that_of_the_transfer_function() -> None:
    frequency = np.array([0.5, 3.0, 20.0])
    num, den = model().plant
    _, expected = signal.freqz(num, den, worN=frequency, fs=100.0)
    np.testing.assert_allclose(model().response(frequency).value, expected, rtol=1e-12)
    transfer = model().to_transfer_function()
    z = np.exp(2j * np.pi * frequency * 0.01)
    np.testing.assert_allclose(np.polyval(transfer.num, z) / np.polyval(transfer.den, z), expected, rtol=1e-12)


def test_response_uncertainty_equals_that_of_random_parameters() -> None:
    chosen, frequency = model(), np.array([2.0, 10.0])
    draws = THETA + np.sqrt(1e-3) * 0.05 * np.random.default_rng(1).standard_normal((4000, 6))
    small = PolynomialModel("bj", BJ, THETA, np.sqrt(1e-3) * 0.05 * np.eye(6), 1.0, 100, 0.01)
    values = np.array([model(theta=theta).response(frequency).value for theta in draws])
    np.testing.assert_allclose(np.abs(values).std(axis=0), small.response(frequency).gain_std, rtol=0.06)
    phase = np.rad2deg(np.angle(values / chosen.response(frequency).value)).std(axis=0)
    np.testing.assert_allclose(phase, small.response(frequency).phase_std_deg, rtol=0.06)


def test_free_simulation_recovers_a_start_in_motion() -> None:
    num, den = foot.transfer()
    u = foot.prbs(3000)
    y = foot.linear_output(u)[1000:]
    np.testing.assert_allclose(free_run(num, den, u[1000:], y), y, atol=1e-6)


def test_unstable_model_does_not_simulate() -> None:
    assert np.isinf(free_run(np.array([0.0, 1.0]), np.array([1.0, -1.01]), np.ones(50), np.ones(50))).all()


def test_stabilise_mirrors_roots_and_keeps_stable_ones() -> None:
    np.testing.assert_allclose(np.sort(np.roots(stabilise(np.poly([2.0, 0.5])))), [0.5, 0.5], atol=1e-7)
    kept = np.poly([0.9, 0.3 + 0.2j, 0.3 - 0.2j]).real
    np.testing.assert_allclose(stabilise(kept), kept, atol=1e-12)


def test_conversions_keep_poles_and_steady_gain() -> None:
    chosen = model()
    b, f = chosen.plant
    gain = b.sum() / f.sum()
    space = chosen.to_state_space()
    steady = space.C @ np.linalg.solve(np.eye(len(space.A)) - space.A, space.B) + space.D
    assert steady[0, 0] == pytest.approx(gain)
    poles = chosen.to_transfer_function().to_zpk().poles
    assert min(abs(poles - chosen.poles()[0])) < 1e-9
    control = pytest.importorskip("control")
    made = chosen.to_control()
    assert isinstance(made, control.TransferFunction)
    assert made.dcgain() == pytest.approx(gain)
    assert made.dt == 0.01


@pytest.mark.parametrize(
    ("structure", "numbers", "sentence"),
    [
        ("oe", (4, 4), "takes 3 orders"),
        ("arma", (1, 1, 1, 1), "did you mean 'armax'"),
        ("oe", (-1, 4, 1), "oe=-1,4,1 makes no model; valid: nb 1 or more, nf 0 or more, nk 0 or more"),
        ("oe", (0, 2, 1), "oe=0,2,1 makes no model"),
    ],
)
def test_orders_that_cannot_be_meant(structure: str, numbers: tuple[int, ...], sentence: str) -> None:
    with pytest.raises(SettingError, match=sentence):
        Orders.of(structure, numbers)
    with pytest.raises(SettingError, match="n_b is at least 1"):
        Orders(nb=0)


def test_model_prints_itself() -> None:
    text = str(model())
    assert text.startswith("BJ (2, 1, 1, 2, 3)")
    assert "b3" in text and "f2" in text
