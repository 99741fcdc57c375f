"""Element sizes of a cell's mesh, and how many unknowns they make."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fasbody.cell.dome import Dome
from fasbody.exceptions import SettingError

#: Unknowns above which a mesh is refused before it is made: its solution would not fit into some 4 GB.
LIMIT = 500_000
#: Unknowns of quadratic elements of size h in a volume h^3 and on a surface h^2, counted on gmsh's domes.
PER_CUBE, PER_SQUARE = 10.0, 38.0


@dataclass(frozen=True)
class MeshSize:
    """Element sizes [um]: far from anything, at the nucleus, at the clamped rim; and the width of the transition."""

    size: float = 3.5
    nucleus: float = 1.225
    rim: float = 2.1
    transition: float = 8.0

    @classmethod
    def of(cls, size: float) -> "MeshSize":
        """The usual proportions: fine where stiff cytoplasm shakes a soft nucleus and where the clamped rim strains.

        Raises:
            SettingError: the size is not a positive number.
        """
        if not (np.isfinite(size) and size > 0):
            raise SettingError(f"the element size must be a positive number of um, not {size}.")
        return cls(size, 0.35 * size, 0.6 * size)

    def coarser(self, factor: float) -> "MeshSize":
        """All sizes times `factor`; the transition stays."""
        return MeshSize(self.size * factor, self.nucleus * factor, self.rim * factor, self.transition)


def unknowns(dome: Dome, size: MeshSize) -> float:
    """About how many unknowns a mesh will have, by the integral of 1 / h^3 over fixed random points and the surface."""
    low, high = np.array([-1, 0, -1]) * dome.semi_axes, dome.semi_axes
    points = np.random.default_rng(0).uniform(low, high, (40_000, 3))
    points = points[dome.level(points) < 1]
    turn = np.linspace(0, 2 * np.pi, 720)
    rim = np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=1) * dome.semi_axes
    distances = [(cKDTree(rim).query(points)[0], size.rim)]
    if dome.nucleus is not None:
        away = points - np.array([0, dome.nucleus.centre, 0])
        level = np.linalg.norm(away / dome.nucleus.semi_axes, axis=1)
        distances.append((np.abs(1 - 1 / level) * np.linalg.norm(away, axis=1), size.nucleus))
    h = np.min([near + (size.size - near) * np.minimum(d / size.transition, 1) for d, near in distances], axis=0)
    surface = 2 * np.pi * dome.length * dome.width / 4
    return float(PER_CUBE * dome.volume_um3 * np.mean(1 / h**3) + PER_SQUARE * surface / size.size**2)


def refuse_above_limit(count: Callable[[float], float], size: float) -> None:
    """Refuse a mesh of more than `LIMIT` unknowns; `count` gives them at the sizes times a factor.

    Raises:
        SettingError: with the number and an element size that would do.
    """
    wanted = count(1.0)
    if wanted <= LIMIT:
        return
    factor = float(np.cbrt(wanted / LIMIT))  # enough if all of it were volume
    while count(factor) > LIMIT:
        factor *= 1.05
    valid = np.ceil(size * factor * 100) / 100
    raise SettingError(
        f"an element size of {size:g} um needs about {wanted:.2g} unknowns, more than the {LIMIT} that fit into "
        f"some 4 GB of memory: take {valid:g} um or more."
    )
