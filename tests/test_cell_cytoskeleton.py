"""The tensegrity: its count, its balance, and what it adds to a cell."""

import numpy as np
import pytest

from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.cytoskeleton import Tensegrity, cytoskeleton_stiffness, expanded_octahedron, place
from fasbody.cell.materials import preset
from fasbody.cell.modal import CellModel, solve
from fasbody.exceptions import SettingError
from simulator.bodies import cell


def test_six_struts_and_twenty_four_cables_meet_in_twelve_nodes() -> None:
    net = expanded_octahedron()
    assert (net.nodes_um.shape, len(net.struts), len(net.cables)) == ((12, 3), 6, 24)
    assert np.bincount(net.struts.ravel()).tolist() == [1] * 12
    assert np.bincount(net.cables.ravel()).tolist() == [4] * 12


def test_prestress_balances_in_the_cell_too() -> None:
    """Force densities 1 in cables, -3/2 in struts: the sum at every node vanishes, also after the affine map."""
    for net in (expanded_octahedron(), place(cell(), Tensegrity())):
        force = np.zeros((12, 3))
        for kind, q in ((net.struts, -1.5), (net.cables, 1.0)):
            for a, b in kind:
                pull = q * (net.nodes_um[b] - net.nodes_um[a])
                force[a] += pull
                force[b] -= pull
        assert np.abs(force).max() < 1e-12 * np.abs(net.nodes_um).max()


def test_it_stands_on_three_nodes_inside_the_cell() -> None:
    nodes = place(cell(), Tensegrity()).nodes_um
    assert (nodes[:, 1] < 1e-9).sum() == 3
    assert (np.linalg.norm(nodes / [50, 9, 20], axis=1) < 1).all()


def test_uniform_stretch_stores_the_bars_energy() -> None:
    """Without prestress, u = a x lengthens every bar by a times its length: energy = sum of E A L a^2 / 2."""
    assembly = assemble(cell().mesh, held=FREE)
    net = Tensegrity(grip_um=3.0, height=0.6, reach=0.6)
    K = cytoskeleton_stiffness(assembly, net, 1e-6)
    inner = place(assembly, net)
    u = assembly.nodes_um.ravel() * 1e-6 * 0.01
    energy = 0.0
    for kind, EA in ((inner.struts, 1.2e9 * 190e-18), (inner.cables, 2.6e9 * 18e-18)):
        length = np.linalg.norm(inner.nodes_um[kind[:, 0]] - inner.nodes_um[kind[:, 1]], axis=1) * 1e-6
        energy += EA * length.sum() * 0.01**2 / 2
    # nodes on the base hold only the half ball above them, whose middle lies higher than the node
    assert u @ (K @ u) / 2 == pytest.approx(energy, rel=0.1)
    shift = np.tile([1.0, -2.0, 0.5], len(assembly.free))
    assert np.abs(K @ shift).max() < 1e-9 * abs(K).max()


def test_it_raises_every_frequency_and_prestress_raises_them_further() -> None:
    chosen = preset("si")
    nets = (None, Tensegrity(), Tensegrity(cable_force_pn=1000.0))
    f = [solve(CellModel(cell(), chosen.materials, 1e-6, cytoskeleton=net), 5).frequencies_hz for net in nets]
    assert (f[1] > 1.005 * f[0]).all()
    assert f[2][0] != pytest.approx(f[1][0], rel=1e-6)


@pytest.mark.parametrize(
    ("name", "value"), [("bundle", 0.0), ("cable_force_pn", -1.0), ("reach", 1.0), ("height", 0.0), ("grip_um", np.nan)]
)
def test_impossible_nets(name: str, value: float) -> None:
    with pytest.raises(SettingError) as refusal:
        Tensegrity(**{name: value})
    assert refusal.value.setting == name


def test_a_node_outside_the_cell_holds_nothing() -> None:
    with pytest.raises(SettingError, match="holds no cytoplasm"):
        cytoskeleton_stiffness(cell(), Tensegrity(reach=0.95, height=0.95, grip_um=1.0), 1e-6)
