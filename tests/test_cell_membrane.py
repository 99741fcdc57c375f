"""The membrane's energy in closed form."""

import numpy as np
import pytest

from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.membrane import Membrane, membrane_stiffness
from fasbody.cell.mesher import ball_mesh
from fasbody.exceptions import SettingError
from simulator.bodies import cell

MEMBRANE = Membrane(E=2e3, nu=0.3, thickness_nm=10.0)


def test_a_swelling_sphere_stores_the_energy_of_equal_biaxial_strain() -> None:
    """Moved by u = a x on the sphere: energy = E t / (1 - nu) a^2 times the area."""
    ball = assemble(ball_mesh(2.0, 0.8), held=FREE)
    K = membrane_stiffness(ball, MEMBRANE, 1e-6)
    u = ball.nodes_um.ravel() * 1e-6 * 0.01
    expected = 2e3 * 10e-9 / (1 - 0.3) * 0.01**2 * 4 * np.pi * (2e-6) ** 2
    assert u @ (K @ u) / 2 == pytest.approx(expected, rel=2e-3)


def test_rotation_and_inner_nodes_cost_nothing() -> None:
    ball = assemble(ball_mesh(2.0, 0.8), held=FREE)
    K = membrane_stiffness(ball, MEMBRANE, 1e-6)
    x = ball.nodes_um
    turn = np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1).ravel()
    assert np.abs(K @ turn).max() < 1e-9 * abs(K).max()
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()


def test_membrane_of_table_5_1_hardly_stiffens_a_cell() -> None:
    """E t is 6e-6 N/m beside E h = 9e-4 N/m of the cytoplasm."""
    assembly = cell(size=8.0)
    K = membrane_stiffness(assembly, Membrane(), 1e-6)
    bulk = 100 * 1e-6 * assembly.stiffness(0, 0.37)
    assert 0 < K.diagonal().max() < 0.1 * bulk.diagonal().max()


@pytest.mark.parametrize("values", [(0.0, 0.3, 6.0), (1e3, 1.0, 6.0), (1e3, 0.3, -1.0)])
def test_impossible_membranes(values: tuple[float, float, float]) -> None:
    with pytest.raises(SettingError, match="membrane"):
        Membrane(*values)
