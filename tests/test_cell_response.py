"""Base excitation: the static limit by a direct solve, high frequency, and an oscillator of one mode."""

import numpy as np
import pytest
import scipy.sparse.linalg as spla
from cell_cases import block

from fasbody.cell.assembly import assemble
from fasbody.cell.materials import preset
from fasbody.cell.modal import CellModel, solve
from fasbody.cell.viscoelastic import ReducedCell, StandardLinearSolid, base_response

SOLID = StandardLinearSolid(0.5, 2e-6)


@pytest.fixture(scope="module")
def model() -> CellModel:
    return CellModel(assemble(block((1, 3, 1), nucleus_below=0.7)), preset("si").materials, 1e-6)


def test_slow_shaking_deflects_as_a_steady_acceleration_does(model: CellModel) -> None:
    response = base_response(ReducedCell.of(model, 8), (SOLID, SOLID), np.array([1.0]))
    u = spla.spsolve(model.K.tocsc(), model.M @ model.rigid)
    top = int(model.assembly.nodes_um[:, 1].argmax())
    at_top = u.reshape(-1, 3, 3)[np.flatnonzero(model.assembly.free == top)[0]]
    assert response.relative_m[:, 0] == pytest.approx(np.abs(np.diag(at_top)), rel=1e-6)
    assert np.abs(response.top[:, 0]) == pytest.approx(1.0, abs=1e-6)


def test_response_agrees_with_the_full_matrices(model: CellModel) -> None:
    f = 0.8 * solve(model, 1).frequencies_hz[0]
    w = 2 * np.pi * f
    response = base_response(ReducedCell.of(model, 60), (SOLID, SOLID), np.array([f]))
    K = SOLID(1j * w) * model.K
    u = spla.spsolve((K - w**2 * model.M).tocsc(), w**2 * (model.M @ model.rigid))
    top = np.flatnonzero(model.assembly.free == int(model.assembly.nodes_um[:, 1].argmax()))[0]
    assert response.top[:, 0] == pytest.approx(1 + np.diag(u.reshape(-1, 3, 3)[top]), rel=1e-3)


def test_reach_is_the_last_mode_of_the_basis(model: CellModel) -> None:
    assert ReducedCell.of(model, 8).reach_hz == pytest.approx(solve(model, 8).frequencies_hz[-1])


def test_resonance_lies_at_the_first_mode(model: CellModel) -> None:
    first = solve(model, 1).frequencies_hz[0]
    light = StandardLinearSolid(0.02, 1 / (2 * np.pi * first))
    response = base_response(ReducedCell.of(model, 20), (light, light), np.linspace(0.5, 1.5, 401) * first)
    assert response.resonance_hz[[0, 2]] == pytest.approx(first, rel=0.02)
    assert "per base displacement" in str(response)


def test_the_end_of_the_range_is_no_resonance(model: CellModel) -> None:
    first = solve(model, 1).frequencies_hz[0]
    rising = base_response(ReducedCell.of(model, 8), (SOLID, SOLID), np.linspace(0.1, 0.6, 30) * first)
    assert np.isnan(rising.resonance_hz).all()
    assert f"x none below {0.6 * first:.4g} Hz" in str(rising)
