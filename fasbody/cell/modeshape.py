"""Names of modes: sway, twist, compression, nucleus.

The words follow section 5.4: mode 1 sways along z, mode 2 along x, mode 3 twists about y, mode 4
compresses along x. They come from numbers: which direction carries the kinetic energy, whether
that component is even or odd under the cell's two mirror planes, and how often it changes sign
along each axis.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fasbody.cell.mesh import NUCLEUS
from fasbody.cell.modal import CellModel, Modes

AXES = "xyz"
X, Y, Z = range(3)
#: Mirror correlation above which a component counts as even, and below minus which as odd.
EVEN = 0.5
#: Share of the kinetic energy above which the mode belongs to the nucleus.
NUCLEUS_MODE = 0.5
#: Share of the kinetic energy above which the nodes of a second component count.
SEEN = 0.1
SLICES = 24


@dataclass(frozen=True)
class ModeDescription:
    """One mode in words and the numbers behind them.

    Args:
        label: such as "z sway", "twist about y" or "z sway, 2 nodes along x".
        energy: share (3,) of the kinetic energy in motion along x, y, z.
        nucleus_share: share of the kinetic energy that is in the nucleus.
        nucleus_strain_share: share of the strain energy that is in the nucleus.
    """

    label: str
    energy: tuple[float, ...]
    nucleus_share: float
    nucleus_strain_share: float

    @property
    def cells(self) -> tuple[str, str]:
        """The label and the nucleus' share, for a table."""
        return self.label, f"{self.nucleus_share:.1%}"

    def document(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "label": self.label,
            "nucleus_share": self.nucleus_share,
            "nucleus_strain_share": self.nucleus_strain_share,
            "energy_xyz": self.energy,
        }


def describe(model: CellModel, modes: Modes) -> tuple[ModeDescription, ...]:
    """Describe every mode; the mirror image of a node is the one nearest to its place."""
    nodes, phi = model.assembly.nodes_um, modes.vectors
    xyz = nodes - (nodes.max(axis=0) + nodes.min(axis=0)) / 2
    tree = cKDTree(xyz)
    mirror = {a: tree.query(xyz * np.where(np.arange(3) == a, -1, 1))[1] for a in (X, Z)}
    weight = model.node_masses
    moving = model.M @ phi
    by_axis = np.stack([(phi[a::3] * moving[a::3]).sum(axis=0) for a in range(3)], axis=1)
    kinetic = (phi * (model.mass(NUCLEUS) @ phi)).sum(axis=0)
    strain = (phi * (model.stiffness(NUCLEUS) @ phi)).sum(axis=0) / modes.omega**2
    descriptions = []
    for c, u in enumerate(model.assembly.expand(phi)):
        main = int(np.argmax(by_axis[c]))
        v = u[:, main]
        even = {a: float(weight @ (v * v[mirror[a]]) / (weight @ v**2)) for a in (X, Z)}
        nodes_along = {
            axis: _sign_changes(xyz, v, weight, axis, other, even[other]) for axis, other in ((X, Z), (Z, X))
        }
        if main == X and even[Z] < -EVEN < EVEN < even[X] and by_axis[c, Z] > SEEN:
            # a twist's nodes are those of its sway along z
            nodes_along[X] = _sign_changes(xyz, u[:, Z], weight, X, Z, 1.0)
        in_nucleus = kinetic[c] > NUCLEUS_MODE
        label = "nucleus mode" if in_nucleus else _label(main, even, nodes_along)
        energy = tuple(by_axis[c].tolist())
        descriptions.append(ModeDescription(label, energy, float(kinetic[c]), float(strain[c])))
    return tuple(descriptions)


def _label(main: int, even: dict[int, float], nodes: dict[int, int]) -> str:
    odd = {axis: value < -EVEN for axis, value in even.items()}
    if any(abs(value) <= EVEN for value in even.values()):
        return f"{AXES[main]} motion without symmetry"
    across = Z if main == X else X
    if main == Y:
        base = "rocking" if odd[X] or odd[Z] else "y bounce"
        least = {X: int(odd[X]), Z: int(odd[Z])}
    elif odd[main] and odd[across]:
        base = f"{AXES[main]} compression, odd along {AXES[across]}"
        least = {main: 1, across: 1}
    elif odd[main]:
        base, least = f"{AXES[main]} compression", {main: 1, across: 0}
    elif odd[across]:
        base, least = "twist about y", {X: 1, Z: int(across == Z)}
    else:
        base, least = f"{AXES[main]} sway", {main: 0, across: 0}
    more = [
        f"{nodes[axis]} node{'s' if nodes[axis] > 1 else ''} along {AXES[axis]}"
        for axis in (X, Z)
        if nodes[axis] > least[axis]
    ]
    return ", ".join([base, *more])


def _sign_changes(
    xyz: NDArray[np.float64], v: NDArray[np.float64], weight: NDArray[np.float64],
    axis: int, other: int, even: float,
) -> int:  # fmt: skip
    """How often a component changes sign along `axis`, where `other` is positive."""
    fold = np.sign(xyz[:, other]) if even < 0 else 1.0
    half = xyz[:, axis].max() * 1.0001
    place = ((xyz[:, axis] / half + 1) / 2 * SLICES).astype(int).clip(0, SLICES - 1)
    profile = np.bincount(place, weight * v * fold, SLICES)
    strong = profile[np.abs(profile) > 0.1 * np.abs(profile).max()]
    return int((np.diff(np.sign(strong)) != 0).sum())
