"""Complex frequencies against the exact cubic of one solid and the unreduced problem of two; a shaken base against
direct solves.
"""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg as spla

from fasbody.cell.assembly import assemble
from fasbody.cell.materials import preset
from fasbody.cell.membrane import Membrane
from fasbody.cell.modal import CellModel, solve
from fasbody.cell.viscoelastic import DampedModes, ReducedCell, StandardLinearSolid, base_response, damped_modes
from fasbody.exceptions import SettingError
from simulator.bodies import block


@pytest.fixture(scope="module")
def model() -> CellModel:
    return CellModel(assemble(block((1, 2, 1), nucleus_below=1.0)), preset("si").materials, 1e-6)


def test_one_solid_gives_the_roots_of_its_cubic(model: CellModel) -> None:
    """Roots of tau s^3 + s^2 + omega^2 tau (1 + g) s + omega^2 = 0 for each elastic omega."""
    solid = StandardLinearSolid(1.0, 3e-6)
    damped = damped_modes(ReducedCell.of(model, 12), (solid, solid), 5)
    expected = []
    for omega in solve(model, 12).omega:
        roots = np.roots([solid.tau, 1, omega**2 * solid.tau * (1 + solid.g), omega**2])
        expected.append(roots[roots.imag > 0][0])
    expected = sorted(expected, key=lambda s: s.imag)[:5]
    assert np.sort_complex(damped.s) == pytest.approx(np.sort_complex(np.array(expected)), rel=1e-8)
    assert damped.residuals.max() < 1e-8


def test_two_solids_agree_with_the_unreduced_problem(model: CellModel) -> None:
    solids = StandardLinearSolid(0.6, 2e-6), StandardLinearSolid(1.5, 8e-6)
    damped = damped_modes(ReducedCell.of(model, 30), solids, 3)
    K_1, K_2, M = (matrix.toarray() for matrix in (model.stiffness(0), model.stiffness(1), model.M))
    n, one = len(M), np.eye(len(M))
    # s^2 M u + K(s) u = 0 multiplied by both (1 + s tau): a polynomial of degree 4, linearised by its companion matrix
    (g_1, t_1), (g_2, t_2) = ((s.g, s.tau) for s in solids)
    coefficients = [
        K_1 + K_2,
        (t_1 * (1 + g_1) + t_2) * K_1 + (t_2 * (1 + g_2) + t_1) * K_2,
        M + t_1 * t_2 * ((1 + g_1) * K_1 + (1 + g_2) * K_2),
        (t_1 + t_2) * M,
        t_1 * t_2 * M,
    ]
    unit = 1e6  # rad/s, keeps the companion matrix balanced
    scaled = [np.linalg.solve(coefficients[4] * unit**4, c * unit**k) for k, c in enumerate(coefficients[:4])]
    companion = np.zeros((4 * n, 4 * n))
    companion[: 3 * n, n:] = np.kron(np.eye(3), one)
    companion[3 * n :] = -np.hstack(scaled)
    s = scipy.linalg.eigvals(companion) * unit
    s = s[s.imag > 1e-6 * np.abs(s)]
    s = s[np.argsort(s.imag)][:3]
    assert damped.s == pytest.approx(s, rel=2e-3)
    assert len(damped_modes(ReducedCell.of(model, 4), solids, 10).s) == 4


@pytest.mark.parametrize("modes", [1, 4])
def test_no_mode_is_invented_above_the_reach_of_the_basis(model: CellModel, modes: int) -> None:
    solid = StandardLinearSolid(0.5, 1e-7)
    damped = damped_modes(ReducedCell.of(model, modes), (solid, solid), 10)
    assert damped.elastic_hz == pytest.approx(solve(model, modes).frequencies_hz, rel=1e-6)
    assert damped.residuals.max() < 1e-6
    assert str(damped).count("residual") == modes


def test_modes_that_do_not_converge_are_refused(model: CellModel) -> None:
    """A nucleus that is a hundred times as stiff when fast bends the modes beyond what two of them can follow."""
    hard = StandardLinearSolid(1e4, 1.0)
    with pytest.raises(SettingError, match="take more modes"):
        damped_modes(ReducedCell.of(model, 1), (StandardLinearSolid(0.0, 1.0), hard), 10)


def test_no_damping_prints_as_zero() -> None:
    damped = DampedModes(np.array([1e-9 + 5j]), np.zeros(1), np.ones(1))
    assert "damping 0.000%" in str(damped)


def test_no_relaxation_is_elastic_and_very_fast_is_stiff(model: CellModel) -> None:
    cell = ReducedCell.of(model, 10)
    elastic = solve(model, 4).frequencies_hz
    still = StandardLinearSolid(0.0, 1e-3)
    assert damped_modes(cell, (still, still), 4).frequencies_hz == pytest.approx(elastic, rel=1e-9)
    slow = StandardLinearSolid(3.0, 1e3)
    damped = damped_modes(cell, (slow, slow), 4)
    assert damped.frequencies_hz == pytest.approx(2 * elastic, rel=1e-6)
    assert damped.damping.max() < 1e-6
    assert damped.elastic_hz == pytest.approx(elastic, rel=1e-9)


def test_an_elastic_membrane_stays_out_of_the_relaxation(model: CellModel) -> None:
    stiff = CellModel(model.assembly, model.materials, 1e-6, membrane=Membrane(E=1e5))
    still = StandardLinearSolid(0.0, 1e-3)
    damped = damped_modes(ReducedCell.of(stiff, 10), (still, still), 3)
    assert damped.frequencies_hz == pytest.approx(solve(stiff, 3).frequencies_hz, rel=1e-9)
    assert (damped.frequencies_hz > 1.01 * solve(model, 3).frequencies_hz).all()


@pytest.mark.parametrize("values", [(-0.1, 1.0), (1.0, 0.0), (float("nan"), 1.0)])
def test_impossible_solids(values: tuple[float, float]) -> None:
    with pytest.raises(SettingError, match="must be"):
        StandardLinearSolid(*values)


SOLID = StandardLinearSolid(0.5, 2e-6)


@pytest.fixture(scope="module")
def tall() -> CellModel:
    return CellModel(assemble(block((1, 3, 1), nucleus_below=0.7)), preset("si").materials, 1e-6)


def test_slow_shaking_deflects_as_a_steady_acceleration_does(tall: CellModel) -> None:
    response = base_response(ReducedCell.of(tall, 8), (SOLID, SOLID), np.array([1.0]))
    u = spla.spsolve(tall.K.tocsc(), tall.M @ tall.rigid)
    top = int(tall.assembly.nodes_um[:, 1].argmax())
    at_top = u.reshape(-1, 3, 3)[np.flatnonzero(tall.assembly.free == top)[0]]
    assert response.relative_m[:, 0] == pytest.approx(np.abs(np.diag(at_top)), rel=1e-6)
    assert np.abs(response.top[:, 0]) == pytest.approx(1.0, abs=1e-6)


def test_response_agrees_with_the_full_matrices(tall: CellModel) -> None:
    f = 0.8 * solve(tall, 1).frequencies_hz[0]
    w = 2 * np.pi * f
    response = base_response(ReducedCell.of(tall, 60), (SOLID, SOLID), np.array([f]))
    K = SOLID(1j * w) * tall.K
    u = spla.spsolve((K - w**2 * tall.M).tocsc(), w**2 * (tall.M @ tall.rigid))
    top = np.flatnonzero(tall.assembly.free == int(tall.assembly.nodes_um[:, 1].argmax()))[0]
    assert response.top[:, 0] == pytest.approx(1 + np.diag(u.reshape(-1, 3, 3)[top]), rel=1e-3)


def test_reach_is_the_last_mode_of_the_basis(tall: CellModel) -> None:
    assert ReducedCell.of(tall, 8).reach_hz == pytest.approx(solve(tall, 8).frequencies_hz[-1])


def test_resonance_lies_at_the_first_mode(tall: CellModel) -> None:
    first = solve(tall, 1).frequencies_hz[0]
    light = StandardLinearSolid(0.02, 1 / (2 * np.pi * first))
    response = base_response(ReducedCell.of(tall, 20), (light, light), np.linspace(0.5, 1.5, 401) * first)
    assert response.resonance_hz[[0, 2]] == pytest.approx(first, rel=0.02)
    assert "per base displacement" in str(response)


def test_the_end_of_the_range_is_no_resonance(tall: CellModel) -> None:
    first = solve(tall, 1).frequencies_hz[0]
    rising = base_response(ReducedCell.of(tall, 8), (SOLID, SOLID), np.linspace(0.1, 0.6, 30) * first)
    assert np.isnan(rising.resonance_hz).all()
    assert f"x none below {0.6 * first:.4g} Hz" in str(rising)
