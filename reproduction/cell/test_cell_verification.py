"""Known bodies, and the error estimate against a finer mesh."""

import numpy as np
import pytest
from scipy.linalg import eigh

from fasbody.cell.analysis import analyse, assemblies
from fasbody.cell.dome import Dome
from fasbody.cell.materials import preset
from fasbody.cell.mesh import MeshSize
from fasbody.cell.modal import CellModel, solve
from reproduction.cell.verification import (
    CANTILEVER_PLATE,
    FREE_PLATE,
    Convergence,
    check_beams,
    check_plates,
    check_scaling,
    check_sphere,
)  # fmt: skip
from simulator.bodies import CACHE, cell, lamb_spheroidal, lamb_torsional, timoshenko


def test_lamb_roots_are_the_published_ones() -> None:
    """Eringen and Suhubi; the spheroidal root for nu = 0.25 is Lamb's 2.640 (0.840 pi)."""
    assert lamb_torsional(2) == pytest.approx(2.50113, abs=1e-5)
    assert lamb_spheroidal(2, 0.37) == pytest.approx(2.65396, abs=1e-5)
    assert lamb_spheroidal(2, 0.25) / np.pi == pytest.approx(0.840, abs=1e-3)


@pytest.mark.parametrize(("held", "root"), [(True, 1.875104), (False, 4.730041)])
def test_slender_beam_is_euler_and_bernoulli(held: bool, root: float) -> None:
    E, rho, length, side = 100.0, 1000.0, 1.0, 0.002
    slender = root**2 / (2 * np.pi) * np.sqrt(E * side**2 / 12 / rho) / length**2
    assert timoshenko(E, rho, length, side, held=held) == pytest.approx(slender, rel=1e-4)


@pytest.mark.parametrize(("clamped", "known", "skip"), [(0, FREE_PLATE, 3), (2, CANTILEVER_PLATE, 0)])
def test_plates_by_ritz(clamped: int, known: tuple[float, ...], skip: int, nu: float = 0.3, n: int = 12) -> None:
    """Thin square plates by Legendre's polynomials, times (1 + x)^2 where the edge x = -1 is clamped."""
    x, weights = np.polynomial.legendre.leggauss(30)

    def derivatives(power: int) -> list[np.ndarray]:
        wall = np.polynomial.Polynomial([1, 1]) ** power
        shapes = [wall * np.polynomial.Legendre.basis(i).convert(kind=np.polynomial.Polynomial) for i in range(n)]
        return [np.array([shape.deriv(d)(x) for shape in shapes]) for d in range(3)]

    X, Y = derivatives(clamped), derivatives(0)

    def product(a: int, b: int, c: int, d: int) -> np.ndarray:
        """Integral of X^(a) Y^(b) times X^(c) Y^(d) over the plate of side 2."""
        return np.kron((X[a] * weights) @ X[c].T, (Y[b] * weights) @ Y[d].T)

    K = product(2, 0, 2, 0) + product(0, 2, 0, 2) + 2 * (1 - nu) * product(1, 1, 1, 1)
    K += nu * (product(2, 0, 0, 2) + product(0, 2, 2, 0))
    squares = eigh(K, product(0, 0, 0, 0), eigvals_only=True)
    assert 4 * np.sqrt(np.abs(squares[skip:][: len(known)])) == pytest.approx(known, rel=2e-4)


def test_known_bodies() -> None:
    checks = [*check_sphere(0.25), *check_beams(), *check_plates()]
    checks += check_scaling(preset("si"), Dome(), MeshSize.of(8.0), CACHE)
    assert [str(check) for check in checks if not check.passed] == []
    assert all(check.dof <= 15_000 for check in checks)


def test_convergence_recovers_order_and_limit() -> None:
    h = np.array([4.0, 3.0, 2.0, 1.0])
    study = Convergence.fit(h, np.array([1, 2, 3, 4]), np.outer(h**3.5, [1e-4, 3e-4]) + np.array([10.0, 20.0]))
    assert study.order == pytest.approx(3.5, abs=1e-3)
    assert study.limit_hz == pytest.approx([10.0, 20.0], rel=1e-7)


def test_error_estimate_is_of_the_size_of_the_error() -> None:
    chosen = preset("si")
    rough = analyse(*assemblies(Dome(), MeshSize.of(6.0), CACHE), chosen, count=5, dome=Dome())
    fine = solve(CellModel(cell(size=4.0), chosen.materials, chosen.metres_per_um), 5).frequencies_hz
    assert rough.errors is not None
    true = np.abs(rough.frequencies_hz / fine - 1)
    assert (rough.errors > 0.5 * true).all()
    assert (rough.errors < 5 * true).all()
