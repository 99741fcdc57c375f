"""The second mesh of a body from a file: what it changes in a frequency is the printed error.

Tetrahedra are cut in eight, which also serves the result, or, where that were too many, the body
is meshed anew and coarser within its surface.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fasbody.cell.mesh import EDGES, MeshSize, TetMesh
from fasbody.cell.mesher import UM, fill, sized_mesh

if TYPE_CHECKING:
    import trimesh

#: The error of a frequency falls as h^ORDER. `fasbody cell verify` observes nearly the 4
#: of smooth modes, but a corner where a free wall meets a held base is singular and slows it down;
#: 2 gives the larger, safer estimate.
ORDER = 2.0
#: Element size of the coarser mesh of a cell, relative.
COARSER = 1.35
#: The same of another body: from 1.35 to 1 a shell changed by a tenth of what it changed beyond.
ROUGH = 1.7
#: Unknowns that a refined mesh has at most.
REFINED = 250_000
#: Share of the volume that a coarser mesh may lose: it makes the printed error larger.
VOLUME_CHANGE_ROUGH = 0.2
#: The eight children of a tetrahedron by the numbers of its corners and mid-edge nodes: one at
#: each corner, and the octahedron between them in four around its diagonal 4-9.
CHILDREN = np.array([
    (0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3),
    (4, 5, 6, 9), (4, 6, 7, 9), (4, 7, 8, 9), (4, 8, 5, 9),
])  # fmt: skip


def richardson(
    coarse_hz: NDArray[np.float64], fine_hz: NDArray[np.float64], coarse_dof: int, fine_dof: int,
    order: float = ORDER,
) -> NDArray[np.float64]:  # fmt: skip
    """Relative error (n,) of the fine frequencies, |f_c - f_f| / ((h_c / h_f)^order - 1) / f_f.

    Frequencies are compared in rising order, so that modes which change places need no partner.
    """
    ratio = (fine_dof / coarse_dof) ** (1 / 3)
    return np.asarray(np.abs(coarse_hz - fine_hz) / (ratio**order - 1) / fine_hz)


def pair(mesh: TetMesh) -> tuple[TetMesh, TetMesh]:
    """A finer and a coarser mesh of the body, one of which is the given.

    Raises:
        MeshError: the surface of a mesh too large to be refined cannot be meshed anew.
    """
    edges, _ = _edges(mesh.tets)
    if 8 * 3 * (len(np.unique(mesh.tets[:, :4])) + len(edges)) <= REFINED:
        return refined(mesh), mesh
    length = np.linalg.norm(np.diff(mesh.points_um[edges], axis=1), axis=2).mean()
    return mesh, remeshed(mesh, ROUGH * float(length))


def surface_meshes(
    surface: "trimesh.Trimesh", size: MeshSize | None = None, unit: tuple[str, float] = UM
) -> tuple[TetMesh, TetMesh, float]:
    """A finer and a coarser mesh inside a closed surface, and the size of the finer [um]; see `sized_mesh`."""
    fine, used = sized_mesh(surface, None, size, unit)
    return fine, fill(surface, used.coarser(ROUGH), tolerance=VOLUME_CHANGE_ROUGH), used.size


def refined(mesh: TetMesh) -> TetMesh:
    """Every tetrahedron cut in eight along its middles; those of ten nodes keep their curves."""
    edges, number = _edges(mesh.tets)
    count, curved = len(mesh.points_um), mesh.tets.shape[1] == 10
    middles = mesh.points_um[edges].mean(axis=1)
    if curved:
        middles[number] = mesh.points_um[mesh.tets[:, 4:]]
    points = np.vstack([mesh.points_um, middles])
    tets = np.hstack([mesh.tets[:, :4], count + number])[:, CHILDREN].reshape(-1, 4)
    if curved:
        sides, place = _edges(tets)
        bent = np.empty((len(sides), 3))
        on_curves = np.einsum("cen,tnd->tced", _children(), mesh.points_um[mesh.tets])
        bent[place] = on_curves.reshape(-1, 6, 3)
        tets = np.hstack([tets, len(points) + place])
        points = np.vstack([points, bent])
    used, renumbered = np.unique(tets, return_inverse=True)
    new = np.full(len(points), -1)
    new[used] = np.arange(len(used))
    middle = {(int(a), int(b)): count + i for i, (a, b) in enumerate(edges)}
    faces = {tag: _cut(face, middle, new) for tag, face in mesh.faces.items()}
    region = np.repeat(mesh.region, len(CHILDREN))
    return TetMesh(points[used], renumbered.reshape(tets.shape), region, mesh.up, faces)


def _edges(tets: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """End points (e, 2) of all edges, and the number of each of a tetrahedron's six (m, 6)."""
    ends = np.sort(tets[:, :4][:, np.array(EDGES)].reshape(-1, 2), axis=1)
    edges, number = np.unique(ends, axis=0, return_inverse=True)
    return edges, number.reshape(-1, 6)


def _children() -> NDArray[np.float64]:
    """Shape functions (8, 6, 10) of ten nodes at the middles of the children's edges."""
    corners = np.eye(4)
    nodes = np.vstack([corners, corners[np.array(EDGES)].mean(axis=1)])
    at = nodes[CHILDREN[:, np.array(EDGES)]].mean(axis=2)  # (8, 6, 4) barycentric
    return np.concatenate([at * (2 * at - 1), 4 * at[..., np.array(EDGES)].prod(axis=-1)], axis=-1)


def _cut(faces: NDArray[np.int64], middle: dict[tuple[int, int], int], new: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (f, 3) in four each, by new numbers; -1 where one is no face of the tetrahedra."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2).tolist()
    middles = np.array([middle.get((a, b), -1) for a, b in sides], dtype=np.int64).reshape(-1, 3)
    six = np.hstack([faces, middles])
    cut = six[:, [0, 3, 5, 3, 1, 4, 5, 4, 2, 3, 4, 5]].reshape(-1, 3)
    return np.where(cut < 0, -1, new[cut])


def remeshed(mesh: TetMesh, size: float) -> TetMesh:
    """The body in elements of another size [um]; regions and faces by what is nearest."""
    import trimesh

    surface = trimesh.Trimesh(mesh.points_um, mesh.surface.faces, process=False)
    surface.remove_unreferenced_vertices()
    filled = fill(surface, MeshSize(size, size, size), tolerance=VOLUME_CHANGE_ROUGH)
    inside = cKDTree(mesh.corners.mean(axis=1)).query(filled.corners.mean(axis=1))[1]
    skin = np.asarray(filled.surface.faces)
    places, queries = (  # nearest in place and direction
        np.hstack([one.triangles_center, 4 * size * one.face_normals]) for one in (mesh.surface, filled.surface)
    )
    nearest = cKDTree(places).query(queries)[1]
    known = np.sort(mesh.surface.faces, axis=1).tolist()
    faces = {}
    for tag, triangles in mesh.faces.items():
        marked = {tuple(face) for face in np.sort(triangles, axis=1).tolist()}
        faces[tag] = skin[np.array([tuple(face) in marked for face in known])[nearest]]
    return TetMesh(filled.points_um, filled.tets, mesh.region[inside], mesh.up, faces)
