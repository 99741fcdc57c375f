"""Modes in words: motions drawn by hand, and the cell of section 5.4."""

import numpy as np
import pytest

from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.materials import preset
from fasbody.cell.modal import CellModel, Modes, solve
from fasbody.cell.modeshape import describe
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
