"""ARX: exact recovery, and the grid against one least-squares problem a model."""

import linear_foot as foot
import numpy as np
import pytest

from identification.blackbox import pem
from identification.blackbox.data import Series
from identification.blackbox.polynomial import Orders


def foot_record(n: int = 1500, seed: int = 0) -> Series:
    u = foot.prbs(n)
    y = foot.linear_output(u) + 0.25 * np.random.default_rng(seed).standard_normal(n)
    return Series(u, y, foot.SAMPLE_TIME)


def test_difference_equation_is_recovered_to_rounding() -> None:
    """y(t) = 1.5 y(t-1) - 0.7 y(t-2) + 2 u(t-3) - u(t-4): n_a 2, n_b 2, n_k 3."""
    u = np.random.default_rng(0).standard_normal(300)
    y = np.zeros(300)
    for t in range(4, 300):
        y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + 2.0 * u[t - 3] - u[t - 4]
    model = pem.estimate("arx", Series(u, y, 1.0), Orders(na=2, nb=2, nk=3))
    np.testing.assert_allclose(model.theta, [-1.5, 0.7, 2.0, -1.0], atol=1e-10)


def test_grid_losses_equal_separate_least_squares() -> None:
    series = foot_record()
    grid = pem.grid(series, 6, 5, 4)
    row = 8  # lags up to n_b + n_k - 1
    for na in range(1, 7):
        for nb in range(1, 6):
            for nk in range(1, 5):
                phi, y = pem.regressors(series, Orders(na=na, nb=nb, nk=nk), row)
                theta = np.linalg.lstsq(phi, y, rcond=None)[0]
                loss = np.mean((y - phi @ theta) ** 2)
                assert grid.loss[na - 1, nb - 1, nk - 1] == pytest.approx(loss, rel=1e-9)


def test_full_grid_corners_and_parameter_counts() -> None:
    series = foot_record(3000)
    grid = pem.grid(series)
    assert grid.loss.shape == (15, 15, 15)
    assert grid.parameters[14, 9, 3] == 25
    for na, nb, nk in ((1, 1, 1), (15, 15, 15), (4, 9, 12), (15, 1, 7)):
        phi, y = pem.regressors(series, Orders(na=na, nb=nb, nk=nk), 29)
        loss = np.mean((y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0]) ** 2)
        assert grid.loss[na - 1, nb - 1, nk - 1] == pytest.approx(loss, rel=1e-9)


def test_pooled_estimate_stacks_the_equations() -> None:
    first, second = foot_record(800, 1), foot_record(900, 2)
    orders = Orders(na=3, nb=2, nk=1)
    pairs = [pem.regressors(series, orders) for series in (first, second)]
    phi, y = np.vstack([p for p, _ in pairs]), np.concatenate([y for _, y in pairs])
    expected = np.linalg.lstsq(phi, y, rcond=None)[0]
    np.testing.assert_allclose(pem.estimate("arx", [first, second], orders).theta, expected, rtol=1e-8)
    loss = np.mean((y - phi @ expected) ** 2)
    model = pem.estimate("arx", [first, second], orders)
    assert model.loss == pytest.approx(loss)
    np.testing.assert_allclose(
        model.covariance, loss * len(y) / (len(y) - 5) * np.linalg.inv(phi.T @ phi), rtol=1e-6
    )  # fmt: skip
    grid = pem.grid([first, second], 3, 3, 3)
    phi, y = map(np.concatenate, zip(*(pem.regressors(s, orders, 5) for s in (first, second)), strict=True))
    loss = np.mean((y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0]) ** 2)
    assert grid.loss[2, 1, 0] == pytest.approx(loss, rel=1e-9)
