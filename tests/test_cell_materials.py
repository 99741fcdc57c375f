"""Presets and impossible materials."""

import pytest

from fasbody.cell.materials import PRESETS, Material, preset
from fasbody.exceptions import SettingError


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
