"""A thin elastic membrane on the free surface of the cell.

Table 5.1 prints its moduli; the thesis leaves it out.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fasbody.cell.assembly import Assembly
from fasbody.cell.mesh import EDGES, FACES, QUADRATURE
from fasbody.exceptions import SettingError


@dataclass(frozen=True)
class Membrane:
    """Isotropic membrane in plane stress, without bending stiffness.

    Args:
        E: Young's modulus [Pa]; Table 5.1 prints 10^3.
        nu: Poisson's ratio; Table 5.1 prints 0.3.
        thickness_nm: 6 nm is the usual thickness of a lipid bilayer with its proteins.

    Raises:
        SettingError: a value that no membrane has.
    """

    E: float = 1e3
    nu: float = 0.3
    thickness_nm: float = 6.0

    def __post_init__(self) -> None:
        for name in ("E", "thickness_nm"):
            if not 0 < getattr(self, name) < math.inf:
                raise SettingError(f"the membrane's {name} must be a positive number.", name)
        if not -1 < self.nu < 1:
            text = f"the membrane's Poisson's ratio must lie between -1 and 1, not {self.nu}."
            raise SettingError(text, "nu")


def membrane_stiffness(assembly: Assembly, membrane: Membrane, metres_per_um: float) -> sp.csr_array:
    """Stiffness [N/m] of a membrane over the whole surface, on the free unknowns.

    Surface strain e = P sym(grad u) P with P = 1 - n n^T; energy
    t/2 int (lambda' tr(e)^2 + 2 mu e:e) dA for plane stress, over curved six-node triangles.
    (scikit-fem's FacetBasis inverts the map of each element, which fails at the bent rim.)
    """
    from skfem import ElementTriP2
    from skfem.quadrature import get_quadrature
    from skfem.refdom import RefTri

    triangles = _surface_triangles(assembly)
    lam, mu = membrane.nu / (1 - membrane.nu**2), 1 / (2 * (1 + membrane.nu))
    shape, (points, weights) = ElementTriP2(), get_quadrature(RefTri, QUADRATURE)
    local = np.zeros((len(triangles), 6, 3, 6, 3))
    for point, weight in zip(points.T, weights, strict=True):
        slopes = np.array([shape.lbasis(point, i)[1] for i in range(6)])  # (6, 2)
        tangents = np.einsum("tai,ak->tki", assembly.nodes_um[triangles], slopes)
        metric = tangents @ tangents.transpose(0, 2, 1)
        dual = np.linalg.solve(metric, tangents)
        G = np.einsum("ak,tki->tai", slopes, dual)  # surface gradients of the shape functions
        P = tangents.transpose(0, 2, 1) @ dual
        area = weight * np.sqrt(np.linalg.det(metric))
        local += lam * np.einsum("t,tai,tbj->taibj", area, G, G, optimize=True)
        local += mu * np.einsum("t,tij,tak,tbk->taibj", area, P, G, G, optimize=True)
        local += mu * np.einsum("t,tbi,taj->taibj", area, G, G, optimize=True)
    unknowns = (3 * triangles[:, :, None] + np.arange(3)).reshape(len(triangles), 18)
    rows, columns = np.broadcast_arrays(unknowns[:, :, None], unknowns[:, None, :])
    size = 3 * len(assembly.nodes_um)
    K = sp.coo_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsr()
    free = (3 * assembly.free[:, None] + np.arange(3)).ravel()
    return metres_per_um * membrane.E * membrane.thickness_nm * 1e-3 * K[free][:, free]


def _surface_triangles(assembly: Assembly) -> NDArray[np.int64]:
    """Nodes (f, 6) of the outer faces: three corners, then the middles of edges 01, 12, 20."""
    middle = {frozenset(edge): 4 + i for i, edge in enumerate(EDGES)}
    sides = [[*face, *(middle[frozenset((face[i], face[i - 2]))] for i in range(3))] for face in FACES]
    faces = assembly.basis.element_dofs.T[:, np.array(sides)].reshape(-1, 6)
    corners = np.sort(faces[:, :3], axis=1)
    _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
    return np.asarray(faces[first[count == 1]], dtype=np.int64)
