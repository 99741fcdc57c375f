"""The printed numbers of Chapter 5 and what becomes of its extrapolation (coarse meshes; docs/cell.md has the fine)."""

import numpy as np
import pytest

from fasbody.cell.dome import SHAPES, Dome
from fasbody.cell.materials import MODULI_PA, preset
from fasbody.cell.mesh import MeshSize
from fasbody.cell.modal import CellModel, solve
from fasbody.exceptions import SettingError
from reproduction.cell.sweep import (
    YEAST_PA,
    PowerLaw,
    Sweep,
    power_laws,
    summarise,
    sweep_moduli,
    sweep_shapes,
)
from simulator.bodies import CACHE, cell

SIZE = MeshSize.of(7.0)


@pytest.fixture(scope="module")
def shapes() -> Sweep:
    return sweep_shapes(preset("as-reproduced"), size=SIZE, count=3, cache=CACHE)


@pytest.fixture(scope="module")
def moduli() -> Sweep:
    return sweep_moduli(
        preset("as-reproduced"),
        Dome(),
        moduli=(*MODULI_PA, YEAST_PA),
        size=SIZE,
        count=3,
        cache=CACHE,
    )


def test_first_frequencies_over_the_shapes_are_the_printed_ones(shapes: Sweep) -> None:
    """Section 5.4 prints 18.07 and 18.15 Hz."""
    mean = shapes.frequencies_hz.mean(axis=0)
    assert mean[0] == pytest.approx(18.07, rel=0.006)
    assert mean[1] == pytest.approx(18.15, rel=0.006)
    assert np.ptp(shapes.frequencies_hz[:, 0]) / mean[0] < 0.015  # "does not depend on the cell shape"


def test_narrower_is_lower_holds_for_twist_but_not_for_the_first_modes(shapes: Sweep) -> None:
    """Section 5.4 claims it above mode 3; SHAPES goes from narrow to wide."""
    assert len(SHAPES) == 4
    assert (np.diff(shapes.frequencies_hz[:, 2]) > 0).all()
    assert not (np.diff(shapes.frequencies_hz[:, 1]) > 0).all()


def test_moduli_give_the_printed_range(moduli: Sweep) -> None:
    """Section 5.5 prints 10 to 211 Hz."""
    first = moduli.frequencies_hz[:, 0]
    assert first[0] == pytest.approx(10.0, rel=0.01)
    assert first[6] == pytest.approx(211.0, rel=0.01)


def test_presets_scale_as_they_must() -> None:
    names = ("as-reproduced", "si", "as-printed")
    first = {}
    for chosen in map(preset, names):
        model = CellModel(cell(height=chosen.height_um, size=SIZE.size), chosen.materials, chosen.metres_per_um)
        first[chosen.name] = float(solve(model, 1).frequencies_hz[0])
    assert first["si"] == pytest.approx(6400.0, rel=0.006)
    assert first["as-printed"] == pytest.approx(16.34, rel=0.012)
    # 1e-3 of the size, 8 times the density (the nucleus' density differs by 1.6 % in the thesis)
    assert first["si"] / first["as-reproduced"] == pytest.approx(1e3 / np.sqrt(8), rel=2e-4)


def test_extrapolation_fails_on_a_soft_nucleus(moduli: Sweep, shapes: Sweep) -> None:
    """Section 5.5 extrapolates to 1.4 kHz at 0.75 MPa; the model's own first mode there is the nucleus'."""
    summary = summarise(shapes, moduli)
    assert all(1200 < law(YEAST_PA) < 1700 for law in summary.laws)
    assert summary.direct_hz < 260
    assert moduli.analyses[-1].descriptions[0].label == "nucleus mode"
    assert "0.75 MPa" in str(summary)


def test_power_laws_recover_their_own_data() -> None:
    E = np.array([30.0, 100.0, 1000.0])
    for law in power_laws(E, 1.8 * E**0.5):
        assert (law.a, law.b) == pytest.approx((1.8, 0.5), rel=1e-6)
    assert PowerLaw(2.0, 0.5, "log")(100.0) == pytest.approx(20.0)
    with pytest.raises(SettingError, match="at least 3"):
        power_laws(E[:2], E[:2])
