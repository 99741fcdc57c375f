"""The cell of section 5.2: an ellipsoidal dome with an ellipsoidal nucleus inside (Figure 5.2).

Axes as in the thesis: x along the long axis, y up from the base, z along the short axis. Lengths
are in micrometres; what one means in metres is a matter of the preset (fasbody/cell/materials.py).
"""

import math
import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fasbody.exceptions import SettingError, unknown
from fasbody.presentation import Tabled

#: The four base shapes of Figure 5.3, long axis x short axis [um].
SHAPES = ((135.0, 30.0), (100.0, 40.0), (80.0, 50.0), (67.0, 60.0))
PROFILES = ("ellipsoid", "cap")


@dataclass(frozen=True)
class Nucleus(Tabled):
    """Ellipsoid of section 5.2.

    Args:
        length: full axis along x [um].
        width: full axis along z [um].
        height: full axis along y [um].
        centre: height above the base [um].
    """

    length: float = 8.0
    width: float = 5.0
    height: float = 5.0
    centre: float = 4.5

    @property
    def semi_axes(self) -> NDArray[np.float64]:
        """Half axes (3,) along x, y, z [um]."""
        return np.array([self.length, self.height, self.width]) / 2

    @property
    def volume_um3(self) -> float:
        """Volume [um^3]; section 5.2 prints 105."""
        return float(4 / 3 * math.pi * np.prod(self.semi_axes))


@dataclass(frozen=True)
class Dome(Tabled):
    """An adherent cell.

    Args:
        length: full long axis of the base, along x [um].
        width: full short axis of the base, along z [um].
        height: height of the dome [um].
        profile: "ellipsoid" is half an ellipsoid (vertical wall at the rim); "cap" is the cap of a
            sphere of the same height over a base of equal area, stretched to the base axes (a
            wetting angle at the rim).
        nucleus: None leaves it out.

    Raises:
        SettingError: a length is not positive, the profile is unknown, or the nucleus leaves the
            cell.

    Example:
        >>> Dome(67.0, 60.0, nucleus=None).volume_um3
    """

    length: float = 100.0
    width: float = 40.0
    height: float = 9.0
    profile: str = "ellipsoid"
    nucleus: Nucleus | None = field(default_factory=Nucleus)

    def __post_init__(self) -> None:
        for name in ("length", "width", "height"):
            if not 0 < getattr(self, name) < math.inf:
                text = f"the cell's {name} must be a positive number of um, not {getattr(self, name)}."
                raise SettingError(text, name)
        if self.profile not in PROFILES:
            raise SettingError(unknown("profile", self.profile, PROFILES) + ".", "profile")
        if self.nucleus is not None:
            self._check_nucleus(self.nucleus)

    @property
    def semi_axes(self) -> NDArray[np.float64]:
        """Half length, height, half width (3,) along x, y, z [um]."""
        return np.array([self.length / 2, self.height, self.width / 2])

    @property
    def cut(self) -> float:
        """Height above the centre at which the unit sphere is cut that is stretched to the dome."""
        if self.profile == "ellipsoid":
            return 0.0
        r, h = math.sqrt(self.length * self.width) / 2, self.height
        radius = (r**2 + h**2) / (2 * h)
        return (radius - h) / radius

    @property
    def stretch(self) -> NDArray[np.float64]:
        """Factors (3,) that turn the cap of the unit sphere above `cut` into the dome [um]."""
        a, h, b = self.semi_axes
        base = math.sqrt(1 - self.cut**2)
        return np.array([a / base, h / (1 - self.cut), b / base])

    @property
    def volume_um3(self) -> float:
        """Exact volume of the whole dome, nucleus included [um^3]."""
        c = self.cut
        return float(np.prod(self.stretch) * math.pi * (1 - c) ** 2 * (2 + c) / 3)

    def level(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Below 1 inside the dome's curved surface, 1 on it; `points` (n, 3) [um]."""
        unit = points / self.stretch + np.array([0.0, self.cut, 0.0])
        return np.asarray(np.linalg.norm(unit, axis=1))

    def _check_nucleus(self, nucleus: Nucleus) -> None:
        if not (nucleus.semi_axes > 0).all():
            raise SettingError("the nucleus' axes must be positive numbers of um.", "nucleus")
        theta, phi = np.meshgrid(np.linspace(0, np.pi, 61), np.linspace(0, 2 * np.pi, 121))
        unit = [np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)]
        surface = np.stack(unit, axis=-1).reshape(-1, 3) * nucleus.semi_axes
        surface += [0.0, nucleus.centre, 0.0]
        low, high = surface[:, 1].min(), surface[:, 1].max()
        if low <= 0 or self.level(surface).max() >= 1:
            raise SettingError(
                f"the nucleus ({nucleus.length:g} x {nucleus.width:g} um, from {low:g} to {high:g} um "
                f"above the base) leaves the cell ({self.length:g} x {self.width:g} x "
                f"{self.height:g} um): it must lie wholly inside.",
                "nucleus_centre",
            )

    def __str__(self) -> str:
        return f"{self.length:g} x {self.width:g} x {self.height:g} um ({self.profile})"


def shape(text: str) -> tuple[float, float]:
    """Base axes (length, width) [um] from a text such as ``100x40``.

    Raises:
        SettingError: the text does not have that form.
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*[xX×]\s*(\d+(?:\.\d+)?)\s*", text)
    if not match:
        raise SettingError(f"{text!r} is not two lengths in um; write it as 100x40.", "shape")
    length, width = float(match[1]), float(match[2])
    if length < width:
        text = f"{text!r} has its short axis first: write {width:g}x{length:g}."
        raise SettingError(text, "shape")
    return length, width
