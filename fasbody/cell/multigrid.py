"""The lowest modes of a large cell in little memory: LOBPCG over a two-level preconditioner.

A factorisation of 250,000 quadratic unknowns outgrows 4 GB in SuperLU. Here only the problem of the corner nodes
(linear elements, an eighth of the unknowns) is factored; Chebyshev steps smooth what it cannot see.
"""

import warnings
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from fasbody.cell.assembly import Assembly
from fasbody.cell.inverse import superlu
from fasbody.exceptions import SimulationError

Block = NDArray[np.float64]
SMOOTHING = 3  # Chebyshev steps before and after the coarse correction
BAND = 8.0  # the smoother damps the upper 7/8 of the spectrum; the coarse level serves the rest
GUARD = 4  # vectors carried beyond the wanted ones, for the convergence of the last of them
TOLERANCE = 1e-8  # residual relative to |K phi|; the frequencies' error is its square
ITERATIONS = 200


def lowest_by_multigrid(K: sp.csr_array, M: sp.csr_array, assembly: Assembly, count: int) -> tuple[Block, Block]:
    """Eigenvalues (count,) and vectors (dof, count) of K x = lambda M x.

    Raises:
        SimulationError: it did not converge within 200 iterations.
    """
    precondition = two_level(K, prolongation(assembly))
    start = np.random.default_rng(5).standard_normal((K.shape[0], count + GUARD))
    start = precondition(M @ precondition(start))
    vectors = start
    for tolerance in (1e-4, TOLERANCE):  # lobpcg's tolerance is absolute, and its scale is known only near the modes
        vectors = vectors / np.sqrt(np.einsum("ij,ij->j", vectors, M @ vectors))
        scale = float(np.linalg.norm(K @ vectors, axis=0)[:count].min())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # what it warns of is measured below
            squares, vectors = spla.lobpcg(
                K, vectors, M, precondition, tol=tolerance * scale, maxiter=ITERATIONS, largest=False
            )
    order = np.argsort(squares)[:count]
    squares, vectors = squares[order], vectors[:, order]
    residual = np.linalg.norm(K @ vectors - (M @ vectors) * squares, axis=0) / np.linalg.norm(K @ vectors, axis=0)
    if residual.max() > 100 * TOLERANCE:
        raise SimulationError(f"the modes did not converge (residual {residual.max():.0e}): try another element size.")
    return squares, vectors


def prolongation(assembly: Assembly) -> sp.csr_array:
    """Interpolation (dof, coarse) from the free corners to all free nodes: a mid-edge node is the mean of its ends."""
    corners, edges = assembly.basis.nodal_dofs[0], assembly.basis.edge_dofs[0]
    ends = assembly.basis.mesh.edges
    rows = np.concatenate([corners, edges, edges])
    columns = np.concatenate([np.arange(len(corners)), ends[0], ends[1]])
    values = np.concatenate([np.ones(len(corners)), np.full(2 * len(edges), 0.5)])
    scalar = sp.csr_array((values, (rows, columns)), shape=(len(assembly.nodes_um), len(corners)))
    free_corners = np.flatnonzero(np.isin(corners, assembly.free))
    return sp.kron(scalar[assembly.free][:, free_corners], sp.eye_array(3), format="csr")


def two_level(K: sp.csr_array, P: sp.csr_array) -> Callable[[Block], Block]:
    """A symmetric positive approximation of K^-1 acting on blocks (dof, c)."""
    R = P.T.tocsr()
    coarse = superlu(R @ K @ P)
    d = 1 / K.diagonal()[:, None]
    x = np.random.default_rng(0).standard_normal((K.shape[0], 1))
    for _ in range(15):  # power iteration for the largest eigenvalue of D^-1 K
        x = d * (K @ (x / np.linalg.norm(x)))
    top = 1.1 * float(np.linalg.norm(x))
    centre, half = (top + top / BAND) / 2, (top - top / BAND) / 2

    def smooth(b: Block, x: Block) -> Block:
        r = b - K @ x
        rho = half / centre
        step = d * r / centre
        x = x + step
        for _ in range(SMOOTHING - 1):
            r = r - K @ step
            rho_next = 1 / (2 * centre / half - rho)
            step = rho_next * rho * step + 2 * rho_next / half * (d * r)
            rho, x = rho_next, x + step
        return x

    def precondition(b: Block) -> Block:
        b = np.asarray(b, dtype=np.float64)
        x = smooth(b, np.zeros_like(b))
        x = x + P @ coarse(R @ (b - K @ x))
        return smooth(b, x)

    return precondition
