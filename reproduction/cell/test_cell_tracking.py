"""Modes known again in another cell: exact where it can be, and the order that changes with the shape."""

from dataclasses import replace

import numpy as np
import pytest

from fasbody.cell.assembly import Assembly
from fasbody.cell.materials import Preset, preset
from fasbody.cell.modal import CellModel, Modes, solve
from reproduction.cell.tracking import UNMATCHED, Match, mac, track, track_along
from simulator.bodies import cell

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
