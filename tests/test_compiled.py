"""Compiled descents: scipy's own method as the oracle, step by step and at the end; the residual against Python's."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from fasbody.foot.model import Foot
from fasbody.laboratory.foot import TRUTH
from fasbody.recording.checks import checked
from identification.domains import PeriodicDomain
from identification.engines import compiled
from identification.periodic import PeriodicProblem
from identification.space import space_of


@pytest.fixture(scope="module")
def problem(foot: Foot, trial: Callable) -> PeriodicProblem:  # type: ignore[type-arg]
    recordings = [checked(trial(TRUTH, f, seconds=2.0)) for f in (15.0, 30.0, 40.0)]
    return PeriodicDomain(foot, recordings, space_of(foot), twin=True, threads=1).problem()


def _wild(problem: PeriodicProblem, number: int) -> np.ndarray:
    low, high = problem.bounds
    q = problem.space.random(np.random.default_rng(number))
    return np.clip(q, low + 1e-9 * (high - low), high - 1e-9 * (high - low))


def _scipy(problem: PeriodicProblem, q0: np.ndarray, most: int):  # type: ignore[no-untyped-def]
    problem.start(q0)
    return least_squares(
        problem.residual, q0, problem.jacobian, bounds=problem.bounds, x_scale="jac", max_nfev=most, ftol=1e-8,
        xtol=1e-8, gtol=1e-8,
    )  # fmt: skip


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize("most", [1, 6])
def test_the_first_steps_are_those_of_scipy(problem: PeriodicProblem, number: int, most: int) -> None:
    """One evaluation is the residual itself; after some the paths differ by rounding and the orbits' tolerance only."""
    problem.tolerance, before = 1e-9, problem.tolerance
    q0 = _wild(problem, number)
    quick = problem.compiled()
    assert quick is not None
    q, cost, evaluations, _ = quick.descend(q0, 1e-8, 1e-9, most)
    found = _scipy(problem, q0, most)
    problem.tolerance = before
    assert evaluations == most
    assert cost == pytest.approx(2 * found.cost, rel=1e-4 if most > 1 else 1e-9)
    assert q == pytest.approx(found.x, abs=1e-4 if most > 1 else 0)


def test_descents_end_as_well_as_those_of_scipy(problem: PeriodicProblem) -> None:
    quick = problem.compiled()
    assert quick is not None
    ours, theirs = [], []
    for number in range(12):
        q0 = _wild(problem, number)
        ours.append(quick.descend(q0, 1e-8, 1e-3, 200)[1])
        theirs.append(2 * _scipy(problem, q0, 200).cost)
    assert min(ours) == pytest.approx(min(theirs), rel=1e-6)
    same = np.isclose(ours, theirs, rtol=1e-3)
    better = np.array(ours) < np.array(theirs)
    assert (same | better).sum() >= 10  # a wild path may tip into another valley by rounding


def test_no_orbit_at_the_start_is_said(problem: PeriodicProblem) -> None:
    quick = problem.compiled()
    assert quick is not None
    theta = problem.space.theta({**TRUTH, "c_12": 500.0, "c_22": 500.0, "k_T": 1e3, "k_F": 1e3})
    _, high = problem.bounds
    q0 = np.minimum(problem.space.to_q(theta), high)
    q, cost, evaluations, converged = quick.descend(q0, 1e-8, 1e-3, 200)
    if np.isinf(cost):
        assert evaluations == 1 and not converged and (q == q0).all()
        assert (problem.residual(q0) == 1e6).all()
    else:
        assert np.isfinite(problem.residual(q0)).all()


def test_a_search_on_disk_is_not_cold(
    problem: PeriodicProblem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What numba left is counted if it is of these very sources, in the folder that numba names."""
    quick = problem.compiled()
    assert quick is not None
    quick.descend(_wild(problem, 0), 1e-8, 1e-3, 2)
    assert not compiled.cold()
    with monkeypatch.context() as patch:
        (tmp_path / "two_dof.py").write_text("another model")
        patch.setattr(compiled, "_FILES", (tmp_path / "two_dof.py",))
        compiled._sources.cache_clear()
        assert compiled.cold()
    compiled._sources.cache_clear()
    assert not compiled.cold()
    stats = SimpleNamespace(stats=SimpleNamespace(cache_path=str(tmp_path)))
    monkeypatch.setattr(compiled, "_stamped", lambda _: stats)
    assert compiled.cold()
