"""Which mode of one cell is which mode of another: the modal assurance criterion (MAC) across meshes and materials."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from fasbody.cell.modal import CellModel, Modes


@dataclass(frozen=True)
class Match:
    """Partners of the modes of a first cell among those of a second.

    Args:
        partner: number (c,) in the second set of each mode of the first.
        mac: modal assurance (c,) with the partner, 1 for the same shape.
    """

    partner: NDArray[np.int64]
    mac: NDArray[np.float64]

    def __str__(self) -> str:
        pairs = enumerate(zip(self.partner, self.mac, strict=True), start=1)
        return ", ".join(f"{i}->{p + 1} ({m:.2f})" for i, (p, m) in pairs)


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
    """Pair the modes so that the sum of MAC is greatest."""
    table = mac(first, second)
    rows, columns = linear_sum_assignment(-table)
    return Match(columns[np.argsort(rows)], table[rows, columns][np.argsort(rows)])


def _relative(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    return np.asarray((nodes - low) / (high - low))
