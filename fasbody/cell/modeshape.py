"""Names of modes: sway, twist, compression, nucleus; and the mode of another cell that corresponds to one.

The words follow section 5.4: mode 1 sways along z, mode 2 along x, mode 3 twists about y, mode 4 compresses along x.
They come from numbers: which direction carries the kinetic energy, whether that component is even or odd under the
cell's two mirror planes, and how often it changes sign along each axis. Across meshes and materials modes are known
again by the modal assurance criterion (MAC).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from fasbody.cell.mesh import NUCLEUS
from fasbody.cell.modal import CellModel, Modes

AXES = "xyz"
X, Y, Z = range(3)
EVEN = 0.5  # mirror correlation above which a component counts as even, and below minus which as odd
NUCLEUS_MODE = 0.5  # share of the kinetic energy above which the mode belongs to the nucleus
SEEN = 0.1  # share of the kinetic energy above which the nodes of a second component count
SLICES = 24
#: Modal assurance below which two shapes are not the same mode, and the number that stands for no partner.
SAME, UNMATCHED = 0.5, -1


@dataclass(frozen=True)
class ModeDescription:
    """One mode in words and the numbers behind them.

    Args:
        label: such as "z sway", "twist about y" or "z sway, 2 nodes along x".
        energy: share (3,) of the kinetic energy in motion along x, y, z.
        mirror_x: correlation of the main component with its mirror image in x, 1 even, -1 odd.
        mirror_z: the same in z.
        nodes_x: sign changes of the main component along x.
        nodes_z: the same along z.
        nucleus_share: share of the kinetic energy that is in the nucleus.
        nucleus_strain_share: share of the strain energy that is in the nucleus.
    """

    label: str
    energy: tuple[float, float, float]
    mirror_x: float
    mirror_z: float
    nodes_x: int
    nodes_z: int
    nucleus_share: float
    nucleus_strain_share: float

    def __str__(self) -> str:
        return f"{self.label} (nucleus {self.nucleus_share:.1%})"


def describe(model: CellModel, modes: Modes) -> tuple[ModeDescription, ...]:
    """Describe every mode; meshes need not be symmetric, the mirror image is looked up at the nearest node."""
    assembly = model.assembly
    centre = (assembly.nodes_um.max(axis=0) + assembly.nodes_um.min(axis=0)) / 2
    xyz = assembly.nodes_um - centre
    tree = cKDTree(xyz)
    mirror = {axis: tree.query(xyz * np.where(np.arange(3) == axis, -1, 1))[1] for axis in (X, Z)}
    weight = sum(m.rho * r.m.diagonal() for m, r in zip(model.materials, assembly.regions, strict=True))
    phi = modes.vectors
    squares = modes.omega**2
    by_axis = np.stack([np.einsum("ij,ij->j", phi[a::3], (model.M @ phi)[a::3]) for a in range(3)], axis=1)
    kinetic = np.einsum("ij,ij->j", phi, model.mass(NUCLEUS) @ phi)
    strain = np.einsum("ij,ij->j", phi, model.stiffness(NUCLEUS) @ phi) / squares
    descriptions = []
    for c, u in enumerate(assembly.expand(phi)):
        main = int(np.argmax(by_axis[c]))
        v = u[:, main]
        even = {axis: float(weight @ (v * v[mirror[axis]]) / (weight @ v**2)) for axis in (X, Z)}
        nodes = {axis: _sign_changes(xyz, v, weight, axis, other, even[other]) for axis, other in ((X, Z), (Z, X))}
        if main == X and even[Z] < -EVEN < EVEN < even[X] and by_axis[c, Z] > SEEN:
            nodes[X] = _sign_changes(xyz, u[:, Z], weight, X, Z, 1.0)  # a twist's nodes are those of its sway along z
        label = "nucleus mode" if kinetic[c] > NUCLEUS_MODE else _label(main, even, nodes)
        share = (float(by_axis[c, 0]), float(by_axis[c, 1]), float(by_axis[c, 2]))
        descriptions.append(
            ModeDescription(label, share, even[X], even[Z], nodes[X], nodes[Z], float(kinetic[c]), float(strain[c]))
        )
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
        base, least = f"{AXES[main]} compression, odd along {AXES[across]}", {main: 1, across: 1}
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
    xyz: NDArray[np.float64], v: NDArray[np.float64], weight: NDArray[np.float64], axis: int, other: int, even: float
) -> int:
    """How often the component changes sign along `axis`, on the half of the cell where `other` is positive."""
    fold = np.sign(xyz[:, other]) if even < 0 else 1.0
    half = xyz[:, axis].max() * 1.0001
    place = ((xyz[:, axis] / half + 1) / 2 * SLICES).astype(int).clip(0, SLICES - 1)
    profile = np.bincount(place, weight * v * fold, SLICES)
    strong = profile[np.abs(profile) > 0.1 * np.abs(profile).max()]
    return int((np.diff(np.sign(strong)) != 0).sum())


@dataclass(frozen=True)
class Match:
    """Partners of the modes of a first cell among those of a second.

    Args:
        partner: number (c,) in the second set of each mode of the first, `UNMATCHED` without a partner.
        mac: modal assurance (c,) with the partner, 1 for the same shape; NaN without a partner.
    """

    partner: NDArray[np.int64]
    mac: NDArray[np.float64]

    def __str__(self) -> str:
        pairs = enumerate(zip(self.partner, self.mac, strict=True), start=1)
        return ", ".join(f"{i}->lost" if p == UNMATCHED else f"{i}->{p + 1} ({m:.2f})" for i, (p, m) in pairs)

    def then(self, step: "Match") -> "Match":
        """Partners in a third cell, through the second, if there is one in both; `mac` is that of the weakest link."""
        partner = np.where(self.partner == UNMATCHED, UNMATCHED, step.partner[self.partner])
        weakest = np.minimum(self.mac, step.mac[self.partner])
        return Match(partner, np.where(partner == UNMATCHED, np.nan, weakest))

    def document(self) -> dict[str, Any]:
        """Ready for JSON: mode numbers from 1, null for those without a partner."""
        return {"partner_of_first": [None if p == UNMATCHED else int(p) + 1 for p in self.partner], "mac": self.mac}


def mac(first: tuple[CellModel, Modes], second: tuple[CellModel, Modes]) -> NDArray[np.float64]:
    """MAC (c1, c2) of two sets of modes, weighted with the first cell's mass.

    Different shapes are compared at the same place relative to their bounding boxes; displacements are interpolated
    between the four nearest nodes. On one and the same mesh nothing is interpolated.
    """
    (model, modes), (other, other_modes) = first, second
    nodes, others = model.assembly.nodes_um, other.assembly.nodes_um
    a = model.assembly.expand(modes.vectors)
    b = other.assembly.expand(other_modes.vectors)
    if model.assembly is not other.assembly:
        distance, near = cKDTree(_relative(others)).query(_relative(nodes), k=4)
        share = 1 / (distance + 1e-9) ** 2
        share /= share.sum(axis=1, keepdims=True)
        b = np.einsum("cnkd,nk->cnd", b[:, near], share)
    weight = sum(m.rho * r.m.diagonal() for m, r in zip(model.materials, model.assembly.regions, strict=True))
    cross = np.einsum("n,ind,jnd->ij", weight, a, b, optimize=True)
    aa, bb = (np.einsum("n,ind,ind->i", weight, x, x) for x in (a, b))
    return np.asarray(cross**2 / np.outer(aa, bb))


def track(first: tuple[CellModel, Modes], second: tuple[CellModel, Modes]) -> Match:
    """Pair the modes so that the sum of MAC is greatest; pairs below `SAME` are no pairs."""
    table = mac(first, second)
    rows, columns = linear_sum_assignment(-table)
    partner, alike = np.full(len(table), UNMATCHED), np.full(len(table), np.nan)
    partner[rows], alike[rows] = columns, table[rows, columns]
    unmatched = ~(alike >= SAME)
    return Match(np.where(unmatched, UNMATCHED, partner), np.where(unmatched, np.nan, alike))


def track_along(cells: Sequence[tuple[CellModel, Modes]]) -> tuple[Match, ...]:
    """Follow the first cell's modes from neighbour to neighbour: shapes drift, so distant cells are not compared."""
    matches = [track(cells[0], cells[0])]
    for before, after in pairwise(cells):
        matches.append(matches[-1].then(track(before, after)))
    return tuple(matches)


def _relative(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    return np.asarray((nodes - low) / (high - low))
