"""Closed surfaces of triangles, which a body is filled from: sound or not, volume, and how round they are."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fasbody.exceptions import MeshError
from fasbody.presentation import counted

if TYPE_CHECKING:
    import trimesh

#: Angle up to which an edge counts as round [degrees].
ROUND = 40.0


def volume(surface: "trimesh.Trimesh") -> float:
    """Volume that is enclosed, without the cavities [um^3]."""
    parts = sorted(abs(float(part.volume)) for part in surface.split(only_watertight=False))
    return parts[-1] - sum(parts[:-1])


def rounded(surface: "trimesh.Trimesh") -> float:
    """Share of its volume between flat triangles and a smooth surface through their corners.

    Edges up to `ROUND` count as round: one that turns by phi between triangles
    of areas A and B has phi (A^2 + B^2) / (6 L) beside it, exactly so on evenly cut cylinders and
    spheres.
    """
    turn = surface.face_adjacency_angles
    turn = np.where(turn < np.radians(ROUND), turn, 0.0)
    squares = (surface.area_faces[surface.face_adjacency] ** 2).sum(axis=1)
    ends = np.diff(surface.vertices[surface.face_adjacency_edges], axis=1)[:, 0]
    length = np.linalg.norm(ends, axis=1)
    return float((turn * squares / (6 * length)).sum()) / volume(surface)


def check_closed(whose: str, surface: "trimesh.Trimesh", remedy: str = "mend it there, as with MeshLab") -> None:
    """Every edge must belong to two triangles, which face the same side.

    Args:
        whose: surface, before the word; empty for the body's.
        surface: to check.
        remedy: what to do about it.

    Raises:
        MeshError: it branches, is open, or is inside out in places.
    """
    edges, count = np.unique(surface.edges_sorted, axis=0, return_counts=True)
    for bad, what, owners in ((count > 2, "branches", "more than two triangles"),
                              (count == 1, "is not closed", "one triangle only")):  # fmt: skip
        if bad.any():
            many = counted(int(bad.sum()), "edge belongs", "edges belong")
            ends = " to ".join(_place(point) for point in surface.vertices[edges[np.argmax(bad)]])
            raise MeshError(f"the {whose}surface {what}: {many} to {owners} (the first from {ends} um): {remedy}.")
    if not surface.is_winding_consistent:
        text = "neighbouring triangles face opposite sides"
        raise MeshError(f"the {whose}surface is inside out in places: {text}.")


def _place(point: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in point) + ")"


def check_pieces(surface: "trimesh.Trimesh") -> None:
    """Every piece beside the largest must be a cavity of it: inside, and inside no other.

    Raises:
        MeshError: there are several bodies.
    """
    pieces = sorted(surface.split(only_watertight=False), key=lambda piece: -abs(piece.volume))
    depth = [sum(_inside(other, piece.vertices[0]) for other in pieces if other is not piece) for piece in pieces]
    if depth != [0] + [1] * (len(pieces) - 1):
        raise MeshError(
            f"the surface has {len(pieces)} separate pieces that are not one body with cavities: give one body."
        )


def _inside(surface: "trimesh.Trimesh", point: NDArray[np.float64]) -> bool:
    """Whether a closed surface goes round a point: its solid angle (Van Oosterom, Strackee 1983)."""
    a, b, c = np.moveaxis(surface.triangles - point, 1, 0)
    x, y, z = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    above = (a * np.cross(b, c)).sum(axis=1)
    sides = ((a, b, z), (b, c, x), (c, a, y))
    below = x * y * z + sum((p * q).sum(axis=1) * r for p, q, r in sides)
    return bool(abs(np.arctan2(above, below).sum()) > np.pi)
