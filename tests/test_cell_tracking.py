"""The modal assurance criterion: exact where it can be, and able to see modes change places."""

from dataclasses import replace

import numpy as np
import pytest
from cell_cases import cell

from fasbody.cell.assembly import Assembly
from fasbody.cell.materials import Preset, preset
from fasbody.cell.modal import CellModel, Modes, solve
from fasbody.cell.tracking import mac, track

PRESET = preset("as-reproduced")


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
    match = track(solved(cell(size=5.0)), solved(cell(135.0, 30.0, size=5.0)))
    assert match.partner.tolist() == [0, 1, 2, 4, 3]
    assert match.mac.min() > 0.7


def test_order_changes_with_stiffness_are_followed() -> None:
    """At 15 kPa the soft nucleus makes the sway along x the lowest mode."""
    first, stiff = solved(cell()), solved(cell(), PRESET.with_modulus(15000.0))
    assert track(first, stiff).partner[:2].tolist() == [1, 0]
