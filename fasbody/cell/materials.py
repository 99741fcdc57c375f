"""Materials of Table 5.2 and the presets that interpret the thesis' numbers (docs/cell.md)."""

import math
from dataclasses import dataclass, replace

from fasbody.exceptions import SettingError, unknown
from fasbody.presentation import Tabled

#: Elastic moduli of the cytoplasm in the sweeps of Figures 5.10 and 5.11 [Pa].
MODULI_PA = (30.0, 100.0, 500.0, 1000.0, 5000.0, 10000.0, 15000.0)


@dataclass(frozen=True)
class Material(Tabled):
    """Isotropic linear elasticity: Young's modulus [Pa], Poisson's ratio, density [kg/m^3].

    Raises:
        SettingError: a value that no elastic solid has.
    """

    E: float
    nu: float
    rho: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.E) and self.E > 0):
            raise SettingError(f"Young's modulus must be a positive number of Pa, not {self.E}.")
        if not -1 < self.nu < 0.5:
            raise SettingError(
                f"Poisson's ratio must lie between -1 and 0.5, both excluded, not {self.nu}"
                + (" (0.5 is incompressible and these elements would lock)." if self.nu == 0.5 else ".")
            )
        if not (math.isfinite(self.rho) and self.rho > 0):
            raise SettingError(f"the density must be a positive number of kg/m^3, not {self.rho}.")


@dataclass(frozen=True)
class Preset(Tabled):
    """One reading of section 5.2.

    Args:
        name: as on the command line.
        cytoplasm: its material.
        nucleus: its material.
        height_um: height of the dome [um].
        metres_per_um: length that the analysis takes for a printed micrometre [m]; 1e-6 is the real size.
        meaning: what this reading is, in a clause.
    """

    name: str
    cytoplasm: Material
    nucleus: Material
    height_um: float
    metres_per_um: float
    meaning: str

    @property
    def materials(self) -> tuple[Material, Material]:
        """By region number: cytoplasm, nucleus."""
        return self.cytoplasm, self.nucleus

    def with_modulus(self, E: float) -> "Preset":
        """The same with another Young's modulus of the cytoplasm [Pa]; that of the nucleus stays (Table 5.2)."""
        return replace(self, cytoplasm=replace(self.cytoplasm, E=E))


# Table 5.2 prints 1.25e-7 and 1.27e-7 "kg/m^3"; the printed frequencies need 1.25e-7 and 1.27e-7 kg/mm^3 over a cell
# whose micrometres were typed as millimetres.
_SLIP = (Material(100.0, 0.37, 125.0), Material(400.0, 0.37, 127.0))
PRESETS = {
    preset.name: preset
    for preset in (
        Preset("as-printed", *_SLIP, 10.0, 1e-3, "the printed height of 10 um with the unit slip"),
        Preset("as-reproduced", *_SLIP, 9.0, 1e-3, "the height that gives the printed volume, with the unit slip"),
        Preset("si", Material(100.0, 0.37, 1000.0), Material(400.0, 0.37, 1000.0), 9.0, 1e-6,
               "the dome of as-reproduced at its real size and the density of water"),
    )
}  # fmt: skip


def preset(name: str) -> Preset:
    """The preset of that name.

    Raises:
        SettingError: there is none.
    """
    if name not in PRESETS:
        raise SettingError(unknown("preset", name, PRESETS) + ".", "preset")
    return PRESETS[name]
