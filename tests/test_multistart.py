"""Descents against a problem whose minimum is known, and what an interruption keeps."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from fasbody.foot.model import Foot
from fasbody.progress import Work
from identification.multistart import descend, explore
from identification.parameters import space_of


class Quadratic:
    """Residual M q - b: the bounded minimum is known from scipy's lsq_linear."""

    log_determinant = 0.0

    def __init__(self, foot: Foot, b: float) -> None:
        self.space = space_of(foot, ["c_12", "c_22"], delay=False)
        self.M, self.b = np.array([[1.0, 0.5], [0.2, 2.0], [0.3, 0.1]]), np.array([b, 1.0, -1.0])
        self.evaluations, self.size, self.tolerance = 0, 3, 0.0

    bounds = property(lambda self: self.space.bounds)

    def start(self, q: np.ndarray) -> np.ndarray:
        return q

    def residual(self, z: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        return self.M @ z - self.b

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        return self.M

    def covariance(self, z: np.ndarray, active: np.ndarray) -> np.ndarray:
        return np.linalg.inv(self.M.T @ self.M)

    def compiled(self) -> None:
        return None


@pytest.mark.parametrize("b", [2.0, 90.0])  # inside, and beyond the bounds
def test_descent_ends_at_the_bounded_minimum(foot: Foot, b: float) -> None:
    problem = Quadratic(foot, b)
    found = descend(problem, "here", np.zeros(2), tight=True)
    want = lsq_linear(problem.M, problem.b, problem.bounds)
    np.testing.assert_allclose(found.z, want.x, atol=1e-4)
    assert found.cost == pytest.approx(2 * want.cost, rel=1e-4)
    np.testing.assert_allclose(found.theta, problem.space.to_theta(found.z))
    assert (found.label, found.converged) == ("here", True)
    assert found.evaluations > 1


def test_exploring_sorts_and_survives_an_interruption(foot: Foot) -> None:
    problem = Quadratic(foot, 2.0)
    steps: list[tuple[str, int, int]] = []

    def advance(*step: str | int) -> None:
        steps.append(step)  # type: ignore[arg-type]
        if len(steps) == most:
            raise KeyboardInterrupt

    starts, most = [(f"{i}", np.full(2, float(i))) for i in range(5)], 0
    explore(problem, starts[:2], Work(advance))
    most, steps = len(steps) + 2, []  # in the third descent
    done, interrupted = explore(problem, starts, Work(advance))
    assert interrupted
    assert len(done) == 2
    done, interrupted = explore(problem, starts)
    assert not interrupted
    assert [d.cost for d in done] == sorted(d.cost for d in done)
    assert len(done) == 5
    assert all(now[1] >= before[1] and now[1] <= now[2] for before, now in pairwise(steps))


def test_an_interruption_before_the_first_result_is_one(foot: Foot) -> None:
    def starts():  # type: ignore[no-untyped-def]
        raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        explore(Quadratic(foot, 2.0), starts())  # type: ignore[arg-type]
