"""Modes in words: motions drawn by hand, and the cell of section 5.4. Modes found again: exact where it can be."""

from dataclasses import replace

import numpy as np
import pytest

from fasbody.cell.assembly import FREE, Assembly, assemble
from fasbody.cell.materials import Preset, preset
from fasbody.cell.modal import CellModel, Modes, solve
from fasbody.cell.modeshape import UNMATCHED, Match, describe, mac, track, track_along
from simulator.bodies import block, cell

PRESET = preset("as-reproduced")


def labels(length: float, width: float, count: int = 5) -> list[str]:
    model = CellModel(cell(length, width, size=6.0), PRESET.materials, PRESET.metres_per_um)
    return [d.label for d in describe(model, solve(model, count))]


@pytest.mark.parametrize(
    ("motion", "label"),
    [
        (lambda x, y, z: (0 * x, 0 * x, 1 + 0 * x), "z sway"),
        (lambda x, y, z: (1 + 0 * x, 0 * x, 0 * x), "x sway"),
        (lambda x, y, z: (z, 0 * x, -1.1 * x), "twist about y"),
        (lambda x, y, z: (-x, 0 * x, 0.2 * z), "x compression"),
        (lambda x, y, z: (0 * x, 0 * x, np.cos(np.pi * x)), "z sway, 2 nodes along x"),
        (lambda x, y, z: (0 * x, 0 * x, np.sin(1.4 * np.pi * x)), "twist about y, 3 nodes along x"),
        (lambda x, y, z: (0 * x, x, 0 * x), "rocking"),
        (lambda x, y, z: (0 * x, 1 + 0 * x, 0 * x), "y bounce"),
        (lambda x, y, z: (0 * x, 0 * x, np.exp(2 * x)), "z motion without symmetry"),
    ],
)
def test_drawn_motions(motion, label) -> None:
    assembly = assemble(block((8, 2, 4)))
    model = CellModel(assembly, PRESET.materials, 1e-6)
    u = np.stack(motion(*(assembly.nodes_um - 1).T), axis=1)[assembly.free].reshape(-1, 1)
    u = u / np.sqrt(u.T @ (model.M @ u))
    modes = Modes(np.ones(1), u, np.zeros(1), 0.0, np.zeros((1, 3)), "drawn")
    assert describe(model, modes)[0].label == label


def test_nucleus_share_is_its_part_of_the_energy() -> None:
    """A rigid shift puts kinetic energy where the mass is: the lower half of the cube, minus its clamped layer."""
    assembly = assemble(block((2, 4, 2), nucleus_below=1.0), held=FREE)
    model = CellModel(assembly, (PRESET.cytoplasm, PRESET.cytoplasm), 1e-6)
    u = model.rigid[:, :1] / np.sqrt(model.mass_kg)
    (found,) = describe(model, Modes(np.ones(1), u, np.zeros(1), 0.0, np.zeros((1, 3)), "drawn"))
    assert found.nucleus_share == pytest.approx(0.5)


def test_first_five_modes_are_those_of_the_thesis() -> None:
    expected = ["z sway", "x sway", "twist about y", "x compression", "z sway, 2 nodes along x"]
    found = labels(100.0, 40.0, 7)
    assert found[:5] == expected
    assert found[6] == "twist about y, 3 nodes along x"  # its main component lies along x, unlike that of mode 3


def test_narrowest_cell_compresses_in_mode_five() -> None:
    """Section 5.4 notes that the fourth and fifth mode of 135 x 30 um differ."""
    expected = ["z sway", "x sway", "twist about y", "z sway, 2 nodes along x", "x compression"]
    assert labels(135.0, 30.0) == expected


def solved(assembly: Assembly, chosen: Preset = PRESET, count: int = 5) -> tuple[CellModel, Modes]:
    model = CellModel(assembly, chosen.materials, chosen.metres_per_um)
    return model, solve(model, count)


def test_modes_of_one_cell_are_their_own_partners() -> None:
    pair = solved(cell(size=8.0))
    table = mac(pair, pair)
    assert np.diag(table) == pytest.approx(1.0)
    assert (table - np.diag(np.diag(table))).max() < 0.05
    assert (table <= 1 + 1e-12).all()


def test_a_permutation_is_found() -> None:
    model, modes = solved(cell(size=8.0))
    shuffled = replace(modes, vectors=-3 * modes.vectors[:, [2, 0, 1, 4, 3]])
    match = track((model, modes), (model, shuffled))
    assert match.partner.tolist() == [1, 2, 0, 4, 3]
    assert match.mac == pytest.approx(1.0)
    assert str(match).startswith("1->2 (1.00)")


def test_compression_moves_to_mode_five_in_the_narrowest_cell() -> None:
    match = track(solved(cell()), solved(cell(135.0, 30.0)))
    assert match.partner.tolist() == [0, 1, 2, 4, 3]
    assert match.mac.min() > 0.7


def test_modes_that_are_no_longer_there_are_lost() -> None:
    """Kept among the last three of five, the first two modes have no partner rather than a poor one."""
    model, modes = solved(cell(size=8.0))
    fewer = replace(modes, vectors=modes.vectors[:, 2:], frequencies_hz=modes.frequencies_hz[2:])
    match = track((model, modes), (model, fewer))
    assert match.partner.tolist() == [UNMATCHED, UNMATCHED, 0, 1, 2]
    assert match.document()["partner_of_first"] == [None, None, 1, 2, 3]
    assert str(match).startswith("1->lost, 2->lost, 3->1 (1.00)")


def test_a_chain_follows_its_neighbours() -> None:
    model, modes = solved(cell(size=8.0))
    turned, orders = [(model, modes)], ([1, 0, 2, 3, 4], [2, 0, 1, 4, 3])
    for order in orders:
        turned.append((model, replace(modes, vectors=turned[-1][1].vectors[:, order])))
    assert [m.partner.tolist() for m in track_along(turned)] == [[0, 1, 2, 3, 4], [1, 0, 2, 3, 4], [2, 1, 0, 4, 3]]
    step = Match(np.array([1, UNMATCHED]), np.array([0.9, np.nan])).then(Match(np.array([0, 1]), np.array([0.6, 0.8])))
    assert step.partner.tolist() == [1, UNMATCHED]
    assert step.mac[0] == 0.8
    assert np.isnan(step.mac[1])


def test_order_changes_with_stiffness_are_followed() -> None:
    """At 15 kPa the soft nucleus makes the sway along x the lowest mode."""
    first, stiff = solved(cell()), solved(cell(), PRESET.with_modulus(15000.0))
    assert track(first, stiff).partner[:2].tolist() == [1, 0]
