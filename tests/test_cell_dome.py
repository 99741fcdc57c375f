"""The dome's closed forms against counting points, presets, and every way a cell cannot be meant."""

import numpy as np
import pytest

from fasbody.cell.dome import SHAPES, Dome, Nucleus, shape
from fasbody.cell.materials import PRESETS, Material, preset
from fasbody.exceptions import SettingError


@pytest.mark.parametrize("profile", ["ellipsoid", "cap"])
def test_volume_agrees_with_counted_points(profile: str) -> None:
    dome = Dome(profile=profile, nucleus=None)
    low, high = np.array([-50, 0, -20]), np.array([50, 9, 20])
    points = np.random.default_rng(1).uniform(low, high, (400_000, 3))
    assert dome.volume_um3 == pytest.approx((dome.level(points) < 1).mean() * np.prod(high - low), rel=0.005)


def test_both_profiles_touch_rim_and_top() -> None:
    for profile in ("ellipsoid", "cap"):
        on_surface = np.array([[50.0, 0, 0], [0, 0, 20.0], [0, 9.0, 0]])
        assert Dome(profile=profile).level(on_surface) == pytest.approx(1.0)


def test_printed_volume_needs_a_height_of_nine() -> None:
    """Section 5.2 prints 1.9e-14 m^3 for all shapes; a height of 10 gives 2.1e-14."""
    nine = [Dome(*axes, 9.0).volume_um3 * 1e-18 for axes in SHAPES]
    assert max(nine) < 1.95e-14
    assert min(nine) > 1.85e-14
    assert min(Dome(*axes, 10.0).volume_um3 for axes in SHAPES) * 1e-18 > 2.05e-14
    assert Nucleus().volume_um3 == pytest.approx(105, rel=0.005)


def test_shape_text() -> None:
    assert shape("100x40") == (100.0, 40.0)
    assert shape(" 67.5 X 60 ") == (67.5, 60.0)
    with pytest.raises(SettingError, match="100x40"):
        shape("100")
    with pytest.raises(SettingError, match="write 100x40"):
        shape("40x100")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"height": 0.0}, "height must be a positive number"),
        ({"width": float("nan")}, "width must be a positive number"),
        ({"profile": "cone"}, "valid: ellipsoid, cap"),
        ({"nucleus": Nucleus(centre=7.0)}, "leaves the cell"),
        ({"nucleus": Nucleus(centre=2.0)}, "leaves the cell"),
        ({"nucleus": Nucleus(length=120.0)}, "leaves the cell"),
        ({"nucleus": Nucleus(width=0.0)}, "positive"),
    ],
)
def test_impossible_cells(change: dict, says: str) -> None:
    with pytest.raises(SettingError, match=says):
        Dome(**change)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ((0.0, 0.37, 1000.0), "positive number of Pa, not 0.0"),
        ((-5.0, 0.37, 1000.0), "positive number of Pa"),
        ((100.0, 0.5, 1000.0), "between -1 and 0.5.*incompressible"),
        ((100.0, float("nan"), 1000.0), "between -1 and 0.5"),
        ((100.0, 0.37, 0.0), "density must be a positive"),
    ],
)
def test_impossible_materials(values: tuple[float, float, float], says: str) -> None:
    with pytest.raises(SettingError, match=says):
        Material(*values)


def test_presets_are_table_5_2_in_three_readings() -> None:
    assert list(PRESETS) == ["as-printed", "as-reproduced", "si"]
    for chosen in PRESETS.values():
        assert (chosen.cytoplasm.E, chosen.nucleus.E) == (100.0, 400.0)
        assert {m.nu for m in chosen.materials} == {0.37}
    # 1.25e-7 kg/mm^3 is 125 kg/m^3
    assert preset("as-printed").cytoplasm.rho == pytest.approx(1.25e-7 / 1e-9)
    assert preset("si").with_modulus(30.0).materials[0].E == 30.0
    with pytest.raises(SettingError, match="did you mean 'si'"):
        preset("sii")
