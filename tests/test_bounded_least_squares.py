"""The descent between bounds, beside scipy's bounded least squares."""

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from identification.bounded_least_squares import PROMISED, between, minimise


@pytest.mark.parametrize("seed", range(10))
def test_the_quadratic_between_bounds_is_that_of_bounded_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    J, r = rng.normal(size=(30, 12)) * np.exp(rng.normal(0, 2, 12)), rng.normal(0, 10, 30)
    low, high = -np.abs(rng.normal(size=12)), np.abs(rng.normal(size=12))
    low[:4] = 0.0  # what is half normal starts on its bound
    low[11] = high[11] = 0.0  # and what is held stays
    p = between(J.T @ J, J.T @ r, low, high)
    want = lsq_linear(J, -r, (low - 1e-12, high + 1e-12), method="bvls", tol=1e-14).x
    assert ((low <= p) & (p <= high)).all()
    assert np.sum((J @ p + r) ** 2) == pytest.approx(np.sum((J @ want + r) ** 2), rel=1e-9)


class Bent:
    """Residuals (10 s (y - x^2), 1 - x) of Rosenbrock's valley, least at (1, 1)."""

    def __init__(self, steep: float) -> None:
        self.steep = steep

    def residual(self, q: np.ndarray) -> np.ndarray:
        return np.array([self.steep * (q[1] - q[0] ** 2), 1 - q[0]])

    values = residual

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        return np.array([[-2 * self.steep * q[0], self.steep], [-1.0, 0.0]])

    def derivatives(self, q: np.ndarray) -> None:
        self.J = self.jacobian(q)

    def gram(self) -> np.ndarray:
        return self.J.T @ self.J

    def back(self, r: np.ndarray) -> np.ndarray:
        return self.J.T @ r


@pytest.mark.parametrize("high", [(10.0, 10.0), (0.5, 2.0), (2.0, 0.3)])
@pytest.mark.parametrize("steep", [10.0, 1000.0])
def test_a_descent_ends_where_scipy_does(steep: float, high: tuple[float, float]) -> None:
    valley, low, start = Bent(steep), np.full(2, -2.0), np.array([-1.2, 0.25])
    found = minimise(valley, start, low, np.array(high), 500, 1e-16)
    want = least_squares(valley.residual, start, valley.jacobian, (low, high), xtol=1e-15, ftol=1e-15, max_nfev=10_000)
    assert found.converged and found.q == pytest.approx(want.x, abs=1e-5)


def test_it_stops_where_nothing_more_is_promised_and_says_how_much_was_left() -> None:
    low, high = np.full(2, -2.0), np.full(2, 2.0)
    short = minimise(Bent(10.0), np.array([-1.2, 1.0]), low, high, 3)
    assert not short.converged and short.evaluations == 3 and short.left > PROMISED
    near = minimise(Bent(10.0), np.array([1.01, 1.02]), low, high, 100)
    assert near.converged and near.evaluations == 1 and near.left < PROMISED
