"""Quadratic elements: stiffness and mass of each region for unit material, some faces held.

K = sum of E_r K_r(nu_r) and M = sum of rho_r M_r, so one assembly serves every modulus of a sweep.
K_r is composed of the scalar matrices G_ij = int d_i N_a d_j N_b, an order of magnitude faster
than assembling the vector-valued form and equal to it (tests/test_cell_modal.py).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement, product
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fasbody.cell.mesh import QUADRATURE, REGIONS, TetMesh
from fasbody.exceptions import MeshError, required

#: Held faces of a body that is free to fly.
FREE: NDArray[np.int64] = np.empty((0, 3), dtype=np.int64)
#: Pairs of directions of a symmetric tensor.
PAIRS = tuple(combinations_with_replacement(range(3), 2))


@dataclass(frozen=True)
class Region:
    """Scalar matrices of one region over all nodes: `G[i, j]`, i <= j [um], and mass `m` [um^3]."""

    G: dict[tuple[int, int], sp.csr_array]
    m: sp.csr_array
    volume_um3: float


@dataclass(frozen=True)
class Assembly:
    """Unit matrices of a mesh; unknowns run x, y, z of the first free node, then of the next.

    Args:
        mesh: the tetrahedra.
        nodes_um: positions (n, 3) of all displacement nodes [um].
        free: node numbers (k,) that are not held.
        regions: scalar matrices by region number.
        basis: scikit-fem's scalar quadratic basis over the whole mesh, for its numbering.

    Example:
        >>> assemble(dome_mesh(Dome())).dof
    """

    mesh: TetMesh
    nodes_um: NDArray[np.float64]
    free: NDArray[np.int64]
    regions: tuple[Region, ...]
    basis: Any

    @property
    def dof(self) -> int:
        """Unknowns of the eigenvalue problem."""
        return 3 * len(self.free)

    @property
    def flies(self) -> bool:
        """Nothing is held: the body has six rigid motions."""
        return len(self.free) == len(self.nodes_um)

    @property
    def volume_um3(self) -> float:
        """Volume by quadrature over the curved elements, nucleus included [um^3]."""
        return sum(region.volume_um3 for region in self.regions)

    def stiffness(self, region: int, nu: float) -> sp.csr_array:
        """K_r for a Young's modulus of 1 Pa on the free unknowns [um].

        K_ij = lambda G_ij + mu G_ij^T + delta_ij mu tr(G): isotropic linear elasticity.
        """
        lam, mu = nu / ((1 + nu) * (1 - 2 * nu)), 1 / (2 * (1 + nu))
        G = {ij: self._free(matrix) for ij, matrix in self.regions[region].G.items()}
        G |= {(j, i): matrix.T for (i, j), matrix in G.items() if i != j}
        trace = G[0, 0] + G[1, 1] + G[2, 2]
        return interleaved(lambda i, j: lam * G[i, j] + mu * G[j, i] + (mu if i == j else 0.0) * trace)

    def mass(self, region: int) -> sp.csr_array:
        """M_r for a density of 1 kg/m^3 on the free unknowns [um^3]."""
        return sp.kron(self._free(self.regions[region].m), sp.eye_array(3), format="csr")

    def expand(self, vectors: NDArray[Any]) -> NDArray[Any]:
        """Free unknowns (3 k, c) as displacements (c, n, 3) of all nodes; held ones stand still."""
        full = np.zeros((vectors.shape[1], len(self.nodes_um), 3), dtype=vectors.dtype)
        full[:, self.free] = vectors.T.reshape(vectors.shape[1], -1, 3)
        return full

    @cached_property
    def mesh_to_node(self) -> NDArray[np.int64]:
        """Displacement node (p,) at each point of the mesh, corners and mid-edges alike."""
        nodes = np.empty(len(self.mesh.points_um), dtype=np.int64)
        nodes[self.mesh.tets] = self.basis.element_dofs[: self.mesh.tets.shape[1]].T
        return nodes

    def _free(self, matrix: sp.csr_array) -> sp.csr_array:
        return matrix[self.free][:, self.free]


def interleaved(block: Callable[[int, int], sp.csr_array]) -> sp.csr_array:
    """A matrix over x, y, z of each node from its nine blocks over nodes."""

    def placed(i: int, j: int) -> sp.csr_array:
        return sp.kron(block(i, j), sp.coo_array(([1.0], ([i], [j])), shape=(3, 3)), format="csr")

    return sum((placed(i, j) for i, j in product(range(3), repeat=2) if i or j), placed(0, 0))


def assemble(mesh: TetMesh, *, held: NDArray[np.int64] | None = None) -> Assembly:
    """Assemble the unit matrices.

    Args:
        mesh: the tetrahedra.
        held: corners (f, 3) of the faces that stand still in x, y and z; None is the base
            (section 5.3), `FREE` none.

    Raises:
        MeshError: nothing flat stands on the ground, or a held face is none of the mesh.
        MissingPackageError: scikit-fem is not installed.
    """
    with required("scikit-fem", "cell"):
        from skfem import Basis, BilinearForm, ElementTetP2
    forms = {(i, j): BilinearForm(lambda u, v, w, i=i, j=j: v.grad[i] * u.grad[j]) for i, j in PAIRS}
    mass = BilinearForm(lambda u, v, w: u * v)
    regions = []
    for number in range(max(len(REGIONS), int(mesh.region.max()) + 1)):
        elements = np.flatnonzero(mesh.region == number)
        basis = Basis(mesh.skfem, ElementTetP2(), elements=elements, intorder=QUADRATURE)
        G = {ij: sp.csr_array(form.assemble(basis)) for ij, form in forms.items()}
        regions.append(Region(G, sp.csr_array(mass.assemble(basis)), float(basis.dx.sum())))
    # for its numbering; more points would fill the memory
    whole = Basis(mesh.skfem, ElementTetP2(), intorder=1)
    nodes = np.ascontiguousarray(whole.doflocs.T)
    still = whole.get_dofs(_facets(mesh, mesh.base if held is None else held)).all()
    free = np.setdiff1d(np.arange(len(nodes)), still)
    return Assembly(mesh, nodes, free, tuple(regions), whole)


def _facets(mesh: TetMesh, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers (f,) in scikit-fem's mesh of the faces with these corners (f, 3)."""
    count = len(mesh.points_um)
    vertex = np.zeros(count, dtype=np.int64)
    vertex[mesh.tets[:, :4]] = mesh.skfem.t.T

    def number(corners: NDArray[np.int64]) -> NDArray[np.int64]:
        a, b, c = np.sort(corners.astype(np.int64), axis=0)
        return np.asarray((a * count + b) * count + c)

    known, held = number(mesh.skfem.facets), number(vertex[faces].T)
    missing = int((~np.isin(held, known) | (faces < 0).any(axis=1)).sum())
    if missing:
        raise MeshError(f"{missing} of the {len(faces)} triangles to hold are not faces of its tetrahedra.")
    order = np.argsort(known)
    return np.asarray(order[np.searchsorted(known, held, sorter=order)])
