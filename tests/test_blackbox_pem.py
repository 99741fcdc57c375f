"""Prediction-error estimates: gradients, errors by hand, recovery of the foot, honest covariance, pooling, ARX."""

import linear_foot as foot
import numpy as np
import pytest
from recorded_foot import record
from scipy.signal import lfilter

from fasbody.exceptions import SettingError
from identification.blackbox import pem
from identification.blackbox.data import Series
from identification.blackbox.polynomial import Orders

N = 7000
BAND = np.linspace(5, 60, 56)
NUM, DEN = foot.transfer()
TRUE_B, TRUE_F = NUM[1:], DEN[1:]
ORDERS = {"oe": (4, 4, 1), "armax": (4, 4, 4, 1), "bj": (4, 2, 2, 4, 1)}


@pytest.mark.parametrize("counts", [(0, 3, 0, 0, 2, 1), (2, 2, 2, 0, 0, 2), (0, 2, 1, 2, 3, 0), (2, 1, 2, 1, 1, 1)])
def test_gradient_equals_differences(counts: tuple[int, ...]) -> None:
    """Projected onto the same nuisance space, central differences agree to their own accuracy."""
    na, nb, nc, nd, nf, nk = counts
    orders = Orders(na=na, nb=nb, nc=nc, nd=nd, nf=nf, nk=nk)
    rng = np.random.default_rng(3)
    series = Series(rng.standard_normal(200), rng.standard_normal(200), 1.0)
    theta = 0.2 * rng.standard_normal(orders.parameters)
    problem = pem.Residuals([series], orders)
    assert problem.admissible(theta)
    at = problem.at(theta, gradient=True)
    slope = at.gradient[0].T @ at.errors[0]  # the errors are orthogonal to the nuisance columns
    for k in range(orders.parameters):
        step = np.zeros(orders.parameters)
        step[k] = 1e-6
        up, down = (np.sum(problem.at(theta + sign * step).errors[0] ** 2) / 2 for sign in (1, -1))
        assert slope[k] == pytest.approx((up - down) / 2e-6, rel=2e-5, abs=1e-5)


def test_errors_equal_the_recursions_written_out() -> None:
    """BJ from rest: F z = B u, C e = D (y - z), with d_nd in the noise recursion."""
    rng = np.random.default_rng(0)
    n, u = 300, rng.standard_normal(300)
    y, e = np.zeros(n), rng.standard_normal(n)
    z, w = np.zeros(n), np.zeros(n)
    for t in range(2, n):
        z[t] = 0.8 * z[t - 1] - 0.2 * z[t - 2] + 0.7 * u[t - 1]
        w[t] = 0.5 * w[t - 1] - 0.3 * w[t - 2] + e[t] + 0.4 * e[t - 1]
    y = z + w
    theta = np.array([0.7, 0.4, -0.5, 0.3, -0.8, 0.2])
    errors = pem.Residuals([Series(u, y, 1.0)], Orders(nb=1, nc=1, nd=2, nf=2, nk=1)).at(theta).errors[0]
    difference = errors - e[-len(errors) :]
    # The difference is what the nuisance columns took: at most their share (6 of 300) of the noise.
    assert difference @ difference < 0.06 * (e @ e)
    np.testing.assert_allclose(np.diff(difference[40:]), 0.0, atol=1e-6)  # after the start: a level


@pytest.mark.parametrize("structure", ["oe", "armax", "bj"])
@pytest.mark.parametrize(
    "excite", [pytest.param(foot.prbs, id="prbs"), pytest.param(foot.multisine, id="multisine", marks=pytest.mark.long)]
)
def test_foot_is_recovered(structure: str, excite) -> None:  # type: ignore[no-untyped-def]
    """Median over three seeds of the largest response error, 5 to 60 Hz: 0.3 % (benchmarks/black_box.py: 60 seeds)."""
    orders = Orders.of(structure, ORDERS[structure])
    errors = []
    for seed in range(3):
        response = pem.estimate(structure, record(excite(N), seed), orders).response(BAND)
        errors.append(np.abs(response.value / foot.response(BAND) - 1).max())
    assert np.median(errors) < 3.5e-3


def test_noise_free_foot_is_recovered_to_rounding() -> None:
    series = record(foot.prbs(2000), 0, noise=0.0)
    model = pem.estimate("oe", series, Orders.of("oe", (4, 4, 1)))
    np.testing.assert_allclose(model.theta, [*TRUE_B, *TRUE_F], atol=2e-6)


def test_coloured_noise_widens_the_intervals_of_output_error() -> None:
    """Strongly coloured noise: the intervals of the response still cover, though the model assumes white noise."""
    response_inside = []
    exact = foot.response(np.array([12.0, 20.0, 30.0]))
    for seed in range(15):
        rng = np.random.default_rng(seed)
        noise = lfilter([1.0], [1.0, -0.95], rng.standard_normal(3000)) * 0.25 * np.sqrt(1 - 0.95**2)
        base = foot.prbs(3000)
        series = Series(base, foot.linear_output(base) + noise, foot.SAMPLE_TIME)
        r = pem.estimate("oe", series, Orders.of("oe", (4, 4, 1))).response(np.array([12.0, 20.0, 30.0]))
        response_inside.append(np.abs(np.abs(r.value) - np.abs(exact)) < 1.96 * r.gain_std)
    assert 0.87 <= np.mean(response_inside) <= 1.0


def test_box_jenkins_finds_the_noise_model() -> None:
    base = foot.prbs(N)
    noise = lfilter([1.0, 0.5], [1.0, -0.8], 0.1 * np.random.default_rng(1).standard_normal(N))
    model = pem.estimate("bj", Series(base, foot.linear_output(base) + noise, 1e-3), Orders.of("bj", (4, 1, 1, 4, 1)))
    _, _, c, d, _ = model.polynomials
    assert c[1] == pytest.approx(0.5, abs=0.04)
    assert d[1] == pytest.approx(-0.8, abs=0.03)
    assert np.sqrt(model.noise_variance) == pytest.approx(0.1, rel=0.04)


def test_nine_pooled_sines_give_the_whole_response() -> None:
    recordings = [record(foot.sine(f, 2000), int(f)) for f in np.arange(10.0, 51.0, 5.0)]
    model = pem.estimate("oe", recordings, Orders.of("oe", (4, 4, 1)))
    band = np.arange(10.0, 50.1, 1.0)
    assert np.abs(model.response(band).value / foot.response(band) - 1).max() < 0.01


def test_what_cannot_be_estimated_is_refused() -> None:
    one = record(foot.prbs(500))
    with pytest.raises(SettingError, match="cannot be pooled"):
        pem.estimate("oe", [one, Series(one.u, one.y, 2e-3)], Orders.of("oe", (2, 2, 1)))
    with pytest.raises(SettingError, match="cannot carry"):
        pem.estimate("oe", record(foot.multisine(60, 25.0, 8)), Orders.of("oe", (15, 15, 1)))


def test_difference_equation_is_recovered_to_rounding() -> None:
    """y(t) = 1.5 y(t-1) - 0.7 y(t-2) + 2 u(t-3) - u(t-4): n_a 2, n_b 2, n_k 3."""
    u = np.random.default_rng(0).standard_normal(300)
    y = np.zeros(300)
    for t in range(4, 300):
        y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + 2.0 * u[t - 3] - u[t - 4]
    model = pem.estimate("arx", Series(u, y, 1.0), Orders(na=2, nb=2, nk=3))
    np.testing.assert_allclose(model.theta, [-1.5, 0.7, 2.0, -1.0], atol=1e-10)


def loss_of(recordings: list[Series], numbers: tuple[int, ...], row: int | None = None) -> float:
    """Mean squared error of an ARX model by NumPy's least squares of all its equations."""
    pairs = [pem.regressors(series, Orders.of("arx", numbers), row) for series in recordings]
    phi, y = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return float(np.mean((y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0]) ** 2))


def test_grid_losses_equal_separate_least_squares() -> None:
    """All of a small grid, corners of the thesis' whole one, and one of pooled recordings."""
    one = record(foot.prbs(3000), 0)
    small, whole = pem.grid(one, 6, 5, 4), pem.grid(one)
    assert whole.loss.shape == (15, 15, 15)
    assert whole.parameters[14, 9, 3] == 25
    every = list(np.ndindex(small.loss.shape))
    corners = ((0, 0, 0), (14, 14, 14), (3, 8, 11), (14, 0, 6))
    for grid, places, row in ((small, every, 8), (whole, corners, 29)):  # from the largest lag of the grid on
        for place in places:
            wanted = loss_of([one], tuple(k + 1 for k in place), row)
            assert grid.loss[place] == pytest.approx(wanted, rel=1e-9)
    pool = [record(foot.prbs(n), n) for n in (800, 900)]
    assert pem.grid(pool, 3, 3, 3).loss[2, 1, 0] == pytest.approx(loss_of(pool, (3, 2, 1), 5), rel=1e-9)


def test_pooled_estimate_stacks_the_equations() -> None:
    pool, orders = [record(foot.prbs(n), n) for n in (800, 900)], Orders(na=3, nb=2, nk=1)
    phi, y = map(np.concatenate, zip(*(pem.regressors(series, orders) for series in pool), strict=True))
    model = pem.estimate("arx", pool, orders)
    np.testing.assert_allclose(model.theta, np.linalg.lstsq(phi, y, rcond=None)[0], rtol=1e-8)
    loss = loss_of(pool, (3, 2, 1))
    assert model.loss == pytest.approx(loss)
    covariance = loss * len(y) / (len(y) - 5) * np.linalg.inv(phi.T @ phi)
    np.testing.assert_allclose(model.covariance, covariance, rtol=1e-6)
