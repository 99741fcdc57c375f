"""The modes of another cell that correspond to a first one's, by the modal assurance criterion."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from fasbody.cell.modal import CellModel, Modes

#: Modal assurance below which two shapes are not the same mode, and the number of no partner.
SAME, UNMATCHED = 0.5, -1


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
    weight = model.node_masses
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
