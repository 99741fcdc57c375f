"""A cell as tetrahedra: what every mesh, ours or a user's, becomes before the analysis."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fasbody.exceptions import MeshError

if TYPE_CHECKING:
    import trimesh

#: Region numbers; the names are those of Table 5.2.
CYTOPLASM, NUCLEUS = 0, 1
REGIONS = ("cytoplasm", "nucleus")
#: Degree that the quadrature integrates exactly on straight elements: products of two quadratic shape functions.
QUADRATURE = 4
#: Corner pairs of the six mid-edge nodes 4..9 of a 10-node tetrahedron, in the order of VTK.
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
#: Corners of the four faces, normals outwards.
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))


@dataclass(frozen=True)
class Quality:
    """Shape of the elements: mean ratio is 1 for a regular tetrahedron, 0 for a flat one; det J is relative.

    Args:
        mean_ratio_min, mean_ratio_mean: 12 (3 V)^(2/3) / sum of squared edge lengths, of the corners' tetrahedra.
        det_j_min: smallest det J of any element at the quadrature points, relative to that element's mean.
    """

    mean_ratio_min: float
    mean_ratio_mean: float
    det_j_min: float

    def __str__(self) -> str:
        return (
            f"mean ratio {self.mean_ratio_min:.3f} at worst, {self.mean_ratio_mean:.3f} on average; "
            f"det J / mean {self.det_j_min:.3f} at worst"
        )


@dataclass(frozen=True)
class TetMesh:
    """Tetrahedra with 4 or 10 nodes, in the node order of VTK.

    Args:
        points_um: node positions (n, 3) [um], y up.
        tets: node numbers (m, 4) or (m, 10).
        region: region number (m,), see `REGIONS`.
    """

    points_um: NDArray[np.float64]
    tets: NDArray[np.int64]
    region: NDArray[np.int64]

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corner positions (m, 4, 3) [um]."""
        return self.points_um[self.tets[:, :4]]

    @cached_property
    def surface(self) -> "trimesh.Trimesh":
        """Outer boundary as flat triangles over the corners; `points_um` numbers its vertices."""
        import trimesh

        faces = self.tets[:, :4][:, FACES].reshape(-1, 3)
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        return trimesh.Trimesh(self.points_um, faces[first[count == 1]], process=False)

    @cached_property
    def skfem(self) -> Any:
        """The same mesh for scikit-fem; curved elements stay curved."""
        from skfem import MeshTet, MeshTet2

        kind = MeshTet if self.tets.shape[1] == 4 else MeshTet2
        return kind(np.ascontiguousarray(self.points_um.T), np.ascontiguousarray(self.tets.T))

    @cached_property
    def det_j(self) -> NDArray[np.float64]:
        """Determinant of the Jacobian (m, q) of each element at the quadrature points of the analysis [um^3]."""
        from skfem import Basis, ElementTetP0

        points = Basis(self.skfem, ElementTetP0(), intorder=QUADRATURE).X
        sign = self.skfem.mapping().detDF(points)
        return np.asarray(np.broadcast_to(sign, (len(self.tets), points.shape[1])))

    @property
    def base_tolerance(self) -> float:
        """How far above the lowest node a node still belongs to the base [um]."""
        return 1e-5 * float(np.ptp(self.points_um[:, 1]))

    @property
    def base_um(self) -> float:
        """Height of the base plane [um]."""
        return float(self.points_um[:, 1].min())

    def check(self, *, standing: bool = True) -> "TetMesh":
        """Return the mesh if its elements and its surface are sound; `standing` asks for a base to clamp.

        Raises:
            MeshError: elements are inverted or flat, the surface is open, or nothing flat stands on the ground.
        """
        bad = np.any(self.det_j <= 0, axis=1)
        if bad.any():
            raise MeshError(
                f"{int(bad.sum())} of the {len(bad)} tetrahedra are inverted or flat (the first is number "
                f"{int(np.argmax(bad))}): mesh with another element size or repair the file."
            )
        if not self.surface.is_watertight:
            raise MeshError("the mesh's outer surface is open or branched: neighbouring elements must share faces.")
        on_base = self.points_um[:, 1] <= self.base_um + self.base_tolerance
        if standing and not on_base[self.surface.faces].all(axis=1).any():
            raise MeshError("no face lies flat on the lowest plane: the cell stands on its base with y pointing up.")
        return self

    @cached_property
    def quality(self) -> Quality:
        """Shapes of the elements."""
        x = self.corners
        volume = np.maximum(np.linalg.det(x[:, 1:] - x[:, :1]), 0) / 6
        length2 = sum(((x[:, i] - x[:, j]) ** 2).sum(axis=1) for i, j in EDGES)
        ratio = 12 * np.cbrt(3 * volume) ** 2 / length2
        relative = self.det_j.min(axis=1) / self.det_j.mean(axis=1)
        return Quality(float(ratio.min()), float(ratio.mean()), float(relative.min()))
