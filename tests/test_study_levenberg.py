"""The trend's descent: the least squares of scipy, bounds held, and answers beyond all numbers refused."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from identification.study.levenberg import descend_fast


class Banana:
    """Rosenbrock's residual within bounds; beyond x = 2 what `wild` makes of it."""

    space = SimpleNamespace(to_theta=lambda z: z)

    def __init__(self, high: float = 5.0, wild: float = 0.0, steep: float = 0.0) -> None:
        self.bounds, self.wild, self.steep = (np.array([-5.0, -5.0]), np.array([high, 5.0])), wild, steep

    def residual(self, z: np.ndarray) -> np.ndarray:
        if self.wild and z[0] > 2:
            return np.full(2, self.wild)
        return np.array([10 * (z[1] - z[0] ** 2), 1 - z[0]])

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        J = np.array([[-20 * z[0], 10.0], [-1.0, 0.0]])
        return np.full((2, 2), self.steep) if self.steep and z[0] > 0 else J


def ended(problem: Any, *start: float) -> Any:
    return descend_fast(problem, np.array(start))


@pytest.mark.parametrize("high", [5.0, 0.5])
def test_it_ends_where_scipy_does(high: float) -> None:
    problem = Banana(high)
    found = ended(problem, -1.2, 1.0)
    want = least_squares(problem.residual, [-1.2, 1.0], problem.jacobian, bounds=problem.bounds, xtol=1e-12, ftol=1e-12)
    np.testing.assert_allclose(found.z, want.x, atol=1e-6)
    assert found.cost == pytest.approx(2 * want.cost, abs=1e-10)
    assert found.converged and not found.unstable


@pytest.mark.parametrize("wild", [1e200, np.inf, np.nan])
def test_a_step_beyond_all_numbers_is_refused_silently(wild: float) -> None:
    """Warnings are errors in these tests; the first step from here goes to x = 3 at least."""
    found = ended(Banana(wild=wild), 1.99, -5.0)
    np.testing.assert_allclose(found.z, [1.0, 1.0], atol=1e-6)


def test_a_start_beyond_all_numbers_is_unstable() -> None:
    found = ended(Banana(wild=1e200), 3.0, 1.0)
    assert found.unstable and not found.converged
    assert found.z == pytest.approx([3.0, 1.0])


def test_sensitivities_beyond_all_numbers_end_the_descent_where_it_is() -> None:
    found = ended(Banana(steep=1e200), -1.2, 1.0)
    assert np.isfinite(found.cost)
    assert found.cost < 1.0 + (1 + 1.2) ** 2
    assert not found.converged
