"""Matrices against scikit-fem's own elasticity, modes against scipy's defaults, and what modes must satisfy."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg as spla
from skfem import Basis, BilinearForm, ElementTetP2, ElementVector
from skfem.models.elasticity import lame_parameters, linear_elasticity

from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.materials import Material, preset
from fasbody.cell.modal import WAYS, CellModel, direct, inverse, solve
from fasbody.exceptions import SettingError, SimulationError
from simulator.bodies import block, cell

SI = preset("si")


def model(**shape: float) -> CellModel:
    return CellModel(cell(**shape), SI.materials, SI.metres_per_um)


def test_matrices_equal_the_vector_valued_forms() -> None:
    assembly = cell(size=8.0)
    rows = (3 * assembly.free[:, None] + np.arange(3)).ravel()
    for region, nu in ((0, 0.37), (1, 0.2)):
        elements = np.flatnonzero(assembly.mesh.region == region)
        basis = Basis(assembly.mesh.skfem, ElementVector(ElementTetP2()), elements=elements, intorder=4)
        K = linear_elasticity(*lame_parameters(1.0, nu)).assemble(basis)[rows][:, rows]
        M = BilinearForm(lambda u, v, w: sum(u[i] * v[i] for i in range(3))).assemble(basis)[rows][:, rows]
        assert abs(assembly.stiffness(region, nu) - K).max() < 1e-12 * abs(K).max()
        assert abs(assembly.mass(region) - M).max() < 1e-12 * abs(M).max()


def test_a_free_body_resists_no_rigid_motion_and_has_its_mass() -> None:
    assembly = assemble(cell(size=8.0).mesh, held=FREE)
    free = CellModel(assembly, SI.materials, SI.metres_per_um)
    x = assembly.nodes_um
    turn = np.stack([x[:, 2], 0 * x[:, 0], -x[:, 0]], axis=1).reshape(-1, 1)
    rigid = np.column_stack([free.rigid, turn])
    assert np.abs(free.K @ rigid).max() < 1e-9 * abs(free.K).max() * np.abs(rigid).max()
    assert free.rigid.T @ (free.M @ free.rigid) == pytest.approx(np.eye(3) * free.mass_kg, abs=1e-9 * free.mass_kg)


def test_uniform_strain_stores_the_closed_form_energy() -> None:
    """Moved by u = a (x, y, z) on one material: energy = 9/2 K_bulk a^2 V with K_bulk = E / (3 (1 - 2 nu))."""
    assembly = assemble(block((3, 3, 3), seed=1), held=FREE)
    u = assembly.nodes_um.ravel()
    assert u @ (assembly.stiffness(0, 0.3) @ u) / 2 == pytest.approx(4.5 / (3 * (1 - 0.6)) * 8.0)


@pytest.mark.parametrize("way", [*WAYS, "multigrid"])
def test_every_way_gives_the_frequencies_of_plain_scipy(way: str) -> None:
    if way == "pardiso":
        pytest.importorskip("pypardiso")
    cytoskeleton = model(size=8.0)
    squares = spla.eigsh(cytoskeleton.K.tocsc(), 6, cytoskeleton.M.tocsc(), sigma=0, return_eigenvectors=False)
    modes = solve(cytoskeleton, 6, way=way)
    assert modes.frequencies_hz == pytest.approx(np.sqrt(np.sort(squares)) / (2 * np.pi), rel=1e-9)
    assert modes.residuals.max() < 1e-4  # the frequencies' error is its square


def test_no_mode_is_missed_between_close_ones() -> None:
    """Asked for three of this block, Lanczos by itself gave the first two and the fourth."""
    free = CellModel(assemble(block((1, 2, 1)), held=FREE), (Material(7.3e9, 0.3, 1500.0),))
    all_squares = scipy.linalg.eigh(free.K.toarray(), free.M.toarray(), eigvals_only=True)[6:]
    for count in (1, 2, 3, 4, 5):
        assert solve(free, count).omega == pytest.approx(np.sqrt(all_squares[:count]), rel=2e-6)


def test_a_factorisation_follows_where_the_iteration_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fasbody.cell.modal.SUPERLU_TO", 0)
    assert solve(model(size=8.0), 4).way == "multigrid"
    monkeypatch.setattr("fasbody.cell.modal.ITERATIONS", 2)
    found = solve(model(size=8.0), 4)
    assert found.way == direct()
    assert found.frequencies_hz == pytest.approx(solve(model(size=8.0), 4, way="superlu").frequencies_hz, rel=1e-9)
    with pytest.raises(SimulationError, match="did not converge in 2 iterations"):
        solve(model(size=8.0), 4, way="multigrid")


def test_modes_are_orthonormal_and_carry_the_mass() -> None:
    small = CellModel(assemble(block((1, 2, 1))), SI.materials, 1e-6)
    modes = solve(small, small.assembly.dof - 2)
    assert modes.orthogonality < 1e-10
    assert modes.residuals.max() < 1e-8
    # all modes together move all the mass that is not tied to clamped nodes
    tied = 1 - np.diag(small.rigid.T @ (small.M @ small.rigid)) / small.mass_kg
    assert modes.participation.sum(axis=0) + tied == pytest.approx(1.0, abs=0.02)
    assert (modes.participation.sum(axis=0) < 1).all()


def test_the_inverse_inverts() -> None:
    K = model(size=8.0).K
    b = np.random.default_rng(2).standard_normal(K.shape[0])
    assert K @ inverse(K, "superlu")(b) == pytest.approx(b, abs=1e-8)


def test_what_cannot_be_solved() -> None:
    small = CellModel(assemble(block((1, 1, 1))), SI.materials, 1e-6)
    with pytest.raises(SettingError, match="cannot be computed from"):
        solve(small, 10_000)
    with pytest.raises(SettingError, match="valid: pardiso, superlu, multigrid"):
        solve(small, 3, way="guess")
    with pytest.raises(SimulationError, match="stiffness is not positive"):
        solve(_with_negative_stiffness(small), 3)


def _with_negative_stiffness(small: CellModel) -> CellModel:
    broken = CellModel(small.assembly, small.materials, small.metres_per_um)
    broken.__dict__["K"] = small.K - 10 * float(small.K.diagonal().max()) * small.M / float(small.M.diagonal().max())
    return broken
