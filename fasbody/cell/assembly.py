"""Quadratic elements on the cell: stiffness and mass of each region for unit material, clamped at the base.

The matrices are affine in the materials, K = sum of E_r K_r(nu_r) and M = sum of rho_r M_r, so one assembly serves
every modulus of a sweep. K_r is composed from the six scalar matrices G_ij = int d_i N_a d_j N_b, which is an order of
magnitude faster than assembling the vector-valued form and equal to it (tests/test_cell_modal.py).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fasbody.cell.mesh import QUADRATURE, REGIONS, TetMesh
from fasbody.exceptions import MeshError, MissingPackageError

#: Held faces of a body that is free to fly.
FREE: NDArray[np.int64] = np.empty((0, 3), dtype=np.int64)


@dataclass(frozen=True)
class Region:
    """Scalar matrices of one region over all its nodes: `G[i, j]` for i <= j [um] and the mass matrix `m` [um^3]."""

    G: dict[tuple[int, int], sp.csr_array]
    m: sp.csr_array
    volume_um3: float


@dataclass(frozen=True)
class Assembly:
    """Unit matrices of a mesh.

    Args:
        mesh: the tetrahedra.
        nodes_um: positions (n, 3) of all displacement nodes [um].
        free: node numbers (k,) that are not held.
        regions: scalar matrices by region number.
        basis: scikit-fem's scalar quadratic basis over the whole mesh, for its numbering.

    Vectors over the free degrees of freedom run x, y, z of the first free node, then of the next.
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

        K_ij = lambda G_ij + mu G_ij^T + delta_ij mu tr(G), the Galerkin form of isotropic linear elasticity.
        """
        lam, mu = nu / ((1 + nu) * (1 - 2 * nu)), 1 / (2 * (1 + nu))
        G = {ij: self._free(matrix) for ij, matrix in self.regions[region].G.items()}
        trace = G[0, 0] + G[1, 1] + G[2, 2]
        K = sp.csr_array((self.dof, self.dof))
        for i in range(3):
            for j in range(3):
                G_ij = G[i, j] if i <= j else G[j, i].T
                block = lam * G_ij + mu * G_ij.T + (mu * trace if i == j else 0 * trace)
                place = sp.coo_array(([1.0], ([i], [j])), shape=(3, 3))
                K = K + sp.kron(block, place, format="csr")
        return K

    def mass(self, region: int) -> sp.csr_array:
        """M_r for a density of 1 kg/m^3 on the free unknowns [um^3]."""
        return sp.kron(self._free(self.regions[region].m), sp.eye_array(3), format="csr")

    def expand(self, vectors: NDArray[Any]) -> NDArray[Any]:
        """Free unknowns (3 k, c) as displacements (c, n, 3) of all nodes; clamped ones stand still."""
        full = np.zeros((vectors.shape[1], len(self.nodes_um), 3), dtype=vectors.dtype)
        full[:, self.free] = vectors.T.reshape(vectors.shape[1], -1, 3)
        return full

    @cached_property
    def mesh_to_node(self) -> NDArray[np.int64]:
        """Displacement node (p,) at each point of the mesh file, corners and mid-edges alike."""
        nodes = np.empty(len(self.mesh.points_um), dtype=np.int64)
        nodes[self.mesh.tets] = self.basis.element_dofs[: self.mesh.tets.shape[1]].T
        return nodes

    def _free(self, matrix: sp.csr_array) -> sp.csr_array:
        return matrix[self.free][:, self.free]


def assemble(mesh: TetMesh, *, held: NDArray[np.int64] | None = None) -> Assembly:
    """Assemble the unit matrices.

    Args:
        mesh: the tetrahedra.
        held: corners (f, 3) of the faces that stand still in x, y and z; None is the base (section 5.3), `FREE` none.

    Raises:
        MeshError: nothing flat stands on the ground, or a held face is none of the mesh.
        MissingPackageError: scikit-fem is not installed.
    """
    try:
        from skfem import Basis, BilinearForm, ElementTetP2
    except ImportError as error:
        raise MissingPackageError("scikit-fem", "cell") from error
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    forms = {(i, j): BilinearForm(lambda u, v, w, i=i, j=j: v.grad[i] * u.grad[j]) for i, j in pairs}
    mass = BilinearForm(lambda u, v, w: u * v)
    regions = []
    for number in range(max(len(REGIONS), int(mesh.region.max()) + 1)):
        elements = np.flatnonzero(mesh.region == number)
        basis = Basis(mesh.skfem, ElementTetP2(), elements=elements, intorder=QUADRATURE)
        G = {ij: sp.csr_array(form.assemble(basis)) for ij, form in forms.items()}
        regions.append(Region(G, sp.csr_array(mass.assemble(basis)), float(basis.dx.sum())))
    whole = Basis(mesh.skfem, ElementTetP2(), intorder=1)  # for its numbering; more points would fill the memory
    nodes = np.ascontiguousarray(whole.doflocs.T)
    still = whole.get_dofs(_facets(mesh, mesh.base if held is None else held)).all()
    return Assembly(mesh, nodes, np.setdiff1d(np.arange(len(nodes)), still), tuple(regions), whole)


def _facets(mesh: TetMesh, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers (f,) in scikit-fem's mesh of the faces with these corners (f, 3)."""
    vertex = np.zeros(len(mesh.points_um), dtype=np.int64)
    vertex[mesh.tets[:, :4]] = mesh.skfem.t.T
    count = len(mesh.points_um)

    def number(corners: NDArray[np.int64]) -> NDArray[np.int64]:
        a, b, c = np.sort(corners.astype(np.int64), axis=0)
        return np.asarray((a * count + b) * count + c)

    known, held = number(mesh.skfem.facets), number(vertex[faces].T)
    missing = int((~np.isin(held, known) | (faces < 0).any(axis=1)).sum())
    if missing:
        raise MeshError(f"{missing} of the {len(faces)} triangles to hold are not faces of its tetrahedra.")
    order = np.argsort(known)
    return np.asarray(order[np.searchsorted(known, held, sorter=order)])
