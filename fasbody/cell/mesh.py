"""A cell as tetrahedra: what every mesh becomes before the analysis.

Our meshes conform to both materials and have 10-node tetrahedra (the SOLID187 of section 5.2).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fasbody.cell.surface import check_closed
from fasbody.exceptions import MeshError, SettingError
from fasbody.presentation import counted

if TYPE_CHECKING:
    import trimesh

#: Region numbers; the names are those of Table 5.2.
CYTOPLASM, NUCLEUS = 0, 1
REGIONS = ("cytoplasm", "nucleus")
#: Degree that the quadrature integrates exactly on straight elements: two quadratic functions.
QUADRATURE = 4
#: Corner pairs of the six mid-edge nodes 4..9 of a 10-node tetrahedron, in the order of VTK.
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
#: Corners of the four faces, normals outwards.
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
#: How far above the lowest node a node still belongs to the base, relative to the height.
FLAT = 1e-5
#: How near two corners are one place, relative to the body's length.
SAME_PLACE = 1e-7


@dataclass(frozen=True)
class Quality:
    """Shape of the elements.

    Args:
        mean_ratio_min: least 12 (3 V)^(2/3) / sum of squared edge lengths of the corners'
            tetrahedra: 1 for a regular tetrahedron, 0 for a flat one.
        mean_ratio_mean: mean of the same.
        det_j_min: smallest det J at a quadrature point, relative to that element's mean.
    """

    mean_ratio_min: float
    mean_ratio_mean: float
    det_j_min: float


@dataclass(frozen=True)
class TetMesh:
    """Tetrahedra with 4 or 10 nodes, in the node order of VTK.

    Args:
        points_um: node positions (n, 3) [um].
        tets: node numbers (m, 4) or (m, 10).
        region: region number (m,); of a cell, see `REGIONS`.
        up: axis that points up from the base, 0 to 2; y for a cell.
        faces: corners (f, 3) of triangles that a file marks, by their number.

    Example:
        >>> dome_mesh(Dome(), MeshSize.of(5.0)).volume_um3
    """

    points_um: NDArray[np.float64]
    tets: NDArray[np.int64]
    region: NDArray[np.int64]
    up: int = 1
    faces: Mapping[int, NDArray[np.int64]] = field(default_factory=dict)

    def part(self, inside: NDArray[np.bool_]) -> "TetMesh":
        """Some of the tetrahedra (m,), with all points."""
        return TetMesh(self.points_um, self.tets[inside], self.region[inside], self.up)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corner positions (m, 4, 3) [um]."""
        return self.points_um[self.tets[:, :4]]

    @property
    def volumes(self) -> NDArray[np.float64]:
        """Volume between the corners of each tetrahedron (m,) [um^3]."""
        return np.asarray(np.abs(np.linalg.det(np.diff(self.corners, axis=1))) / 6)

    @property
    def volume_um3(self) -> float:
        """Volume [um^3]; of curved elements within some 1e-5."""
        return float(self.det_j.mean(axis=1).sum()) / 6

    @property
    def curved(self) -> bool:
        """Whether mid-edge nodes lie off the middles of their edges."""
        if self.tets.shape[1] == 4:
            return False
        middles = self.corners[:, np.array(EDGES)].mean(axis=2)
        off = np.abs(self.points_um[self.tets[:, 4:]] - middles).max()
        return bool(off > FLAT * float(np.ptp(self.points_um, axis=0).max()))

    @cached_property
    def surface(self) -> "trimesh.Trimesh":
        """Outer boundary as flat triangles over the corners, numbered as `points_um`."""
        import trimesh

        faces = self.tets[:, :4][:, FACES].reshape(-1, 3)
        corners = np.sort(faces, axis=1)
        _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
        return trimesh.Trimesh(self.points_um, faces[first[count == 1]], process=False)

    @cached_property
    def skfem(self) -> Any:
        """The same mesh for scikit-fem; curved elements stay curved."""
        from skfem import MeshTet, MeshTet2

        kind = MeshTet if self.tets.shape[1] == 4 else MeshTet2
        return kind(np.ascontiguousarray(self.points_um.T), np.ascontiguousarray(self.tets.T))

    @cached_property
    def det_j(self) -> NDArray[np.float64]:
        """Determinant of the Jacobian (m, q) at the quadrature points of the analysis [um^3]."""
        from skfem import Basis, ElementTetP0

        points = Basis(self.skfem, ElementTetP0(), intorder=QUADRATURE).X
        sign = self.skfem.mapping().detDF(points)
        return np.asarray(np.broadcast_to(sign, (len(self.tets), points.shape[1])))

    @cached_property
    def base(self) -> NDArray[np.int64]:
        """Corners (f, 3) of the faces that lie flat on the lowest plane.

        Raises:
            MeshError: there is none.
        """
        height = self.points_um[:, self.up]
        on_base = height <= height.min() + FLAT * float(np.ptp(height))
        faces = np.asarray(self.surface.faces)
        flat = faces[on_base[faces].all(axis=1)]
        if not len(flat):
            up = "xyz"[self.up]
            raise MeshError(f"no face lies flat on the lowest plane: it stands on its base with {up} up.")
        return flat

    def check(self) -> "TetMesh":
        """Return the mesh if its elements and its surface are sound and it is one body.

        Raises:
            MeshError: elements are flat, inverted or overlap, nodes not merged, bodies several, or
                the surface is open.
        """
        edges = np.diff(self.corners, axis=1)
        longest = np.linalg.norm(edges, axis=2).max(axis=1)
        flat = np.abs(np.linalg.det(edges)) <= FLAT**2 * longest**3
        bent = np.zeros_like(flat) if flat.any() else np.any(self.det_j <= 0, axis=1)
        for bad, what in ((flat, "flat: they have no volume"), (bent, "inverted or bent too far")):
            if bad.any():
                raise MeshError(
                    f"{int(bad.sum())} of the {len(self.tets)} tetrahedra are {what} (the first is "
                    f"number {int(np.argmax(bad))})."
                )
        if folded := self._folded():
            raise MeshError(f"tetrahedra overlap at {counted(folded, 'face')}: both neighbours lie on the same side.")
        skin = self.points_um[np.unique(self.surface.faces)]
        reach = SAME_PLACE * float(np.ptp(skin, axis=0).max())
        if double := len(cKDTree(skin).query_pairs(reach)):
            raise MeshError(
                f"{double} pairs of corners lie at the same place and are not one, so that nothing "
                "holds the elements together there: merge the nodes (gmsh: "
                "Mesh.removeDuplicateNodes)."
            )
        ends = self.tets[:, np.array(EDGES)].reshape(-1, 2).T
        shape = (len(self.points_um),) * 2
        links = sp.coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=shape)
        _, number = connected_components(links, directed=False)
        if (bodies := len(np.unique(number[self.tets[:, 0]]))) > 1:
            raise MeshError(f"{bodies} bodies share no nodes: analyse one at a time, or join them.")
        check_closed("mesh's outer ", self.surface, "neighbouring elements must share faces")
        return self

    def _folded(self) -> int:
        """Faces whose neighbours lie on the same side."""
        faces = self.tets[:, :4][:, FACES].reshape(-1, 3)
        turned = np.linalg.det(np.eye(3)[np.argsort(faces, axis=1)])  # 1 or -1 by their sense
        corners = np.sort(faces, axis=1)
        _, face, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
        return int(((np.abs(np.bincount(face, turned)) > 0.5) & (count > 1)).sum())

    @cached_property
    def quality(self) -> Quality:
        """Shapes of the elements."""
        ends = self.corners[:, np.array(EDGES)]
        length2 = (np.diff(ends, axis=2) ** 2).sum(axis=(1, 2, 3))
        ratio = 12 * np.cbrt(3 * self.volumes) ** 2 / length2
        relative = self.det_j.min(axis=1) / self.det_j.mean(axis=1)
        return Quality(float(ratio.min()), float(ratio.mean()), float(relative.min()))


@dataclass(frozen=True)
class MeshSize:
    """Element sizes [um].

    Args:
        size: far from anything.
        nucleus: at the nucleus.
        rim: at the clamped rim.
        transition: width over which they grow.
    """

    size: float = 3.5
    nucleus: float = 1.225
    rim: float = 2.1
    transition: float = 8.0

    @classmethod
    def of(cls, size: float) -> "MeshSize":
        """Finer where stiff cytoplasm shakes a soft nucleus and where the clamped rim strains.

        Raises:
            SettingError: the size is not a positive number.
        """
        if not (np.isfinite(size) and size > 0):
            text = f"the element size must be a positive number of um, not {size}."
            raise SettingError(text, "size")
        return cls(size, 0.35 * size, 0.6 * size)

    def coarser(self, factor: float) -> "MeshSize":
        """All sizes times `factor`; the transition stays."""
        return MeshSize(factor * self.size, factor * self.nucleus, factor * self.rim, self.transition)
