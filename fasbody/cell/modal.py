"""Natural frequencies and mode shapes: Eq. (5.3), with checks of their accuracy.

SuperLU, which comes with scipy, is the fastest inverse of a small body. Above 15,000 unknowns
LOBPCG is faster, over a two-level preconditioner: only the problem of the corner nodes (linear
elements, an eighth of the unknowns, which hold the rigid motions exactly) is factored, and
Chebyshev steps smooth what it cannot represent. Where it does not converge, a factorisation
follows by itself. Measured side by side in docs/cell.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from fasbody.cell.assembly import Assembly
from fasbody.cell.cytoskeleton import Tensegrity, cytoskeleton_stiffness
from fasbody.cell.materials import Material
from fasbody.cell.membrane import Membrane, membrane_stiffness
from fasbody.exceptions import SettingError, SimulationError, required, unknown
from fasbody.presentation import Tabled

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Block = NDArray[np.float64]
#: Unknowns up to which SuperLU is the fastest (docs/cell.md).
SUPERLU_TO = 15_000
NOT_POSITIVE = "the stiffness is not positive: its prestress exceeds what it can carry."
#: Squares of a free body's first mode, relative to the lift, below which it is no mode but a hinge.
LOOSE = 1e-8
#: Relative error of the squares at which an iteration ends.
CONVERGED = 1e-10
#: Chebyshev steps before and after the coarse correction; they damp the upper 3/4 of the spectrum.
SMOOTHING, BAND = 2, 4.0
#: Vectors carried beyond those requested, for the convergence of the last of them.
GUARD = 4
ITERATIONS = 60


@dataclass(frozen=True)
class CellModel(Tabled):
    """A discretised cell, or any other body, made of materials.

    Args:
        assembly: unit matrices of the mesh.
        materials: by region number.
        metres_per_um: size of the mesh's micrometre [m] (see Preset).
        membrane: further stiffness, None leaves it out as the thesis does.
        cytoskeleton: likewise.

    Example:
        >>> solve(CellModel(assemble(dome_mesh(Dome())), preset("si").materials)).frequencies_hz
    """

    assembly: Assembly
    materials: tuple[Material, ...]
    metres_per_um: float = 1e-6
    membrane: Membrane | None = None
    cytoskeleton: Tensegrity | None = None

    def stiffness(self, region: int) -> sp.csr_array:
        """K of one region alone [N/m]."""
        material = self.materials[region]
        return self.metres_per_um * material.E * self.assembly.stiffness(region, material.nu)

    def mass(self, region: int) -> sp.csr_array:
        """M of one region alone [kg]; their sum is M."""
        return self.metres_per_um**3 * self.materials[region].rho * self.assembly.mass(region)

    @cached_property
    def K(self) -> sp.csr_array:
        """Stiffness matrix [N/m], [K] of Eq. (5.2)."""
        return sum(map(self.stiffness, range(len(self.materials))), self.additions)

    @cached_property
    def additions(self) -> sp.csr_array:
        """Stiffness of membrane and cytoskeleton [N/m]."""
        K, size = sp.csr_array((self.assembly.dof, self.assembly.dof)), self.metres_per_um
        if self.membrane is not None:
            K = K + membrane_stiffness(self.assembly, self.membrane, size)
        if self.cytoskeleton is not None:
            K = K + cytoskeleton_stiffness(self.assembly, self.cytoskeleton, size)
        return K

    @cached_property
    def M(self) -> sp.csr_array:
        """Mass matrix [kg], [M] of Eq. (5.2)."""
        return sum(map(self.mass, range(1, len(self.materials))), self.mass(0))

    @cached_property
    def rigid(self) -> NDArray[np.float64]:
        """Unit translations (dof, 3) along x, y, z over the free unknowns."""
        return np.tile(np.eye(3), (len(self.assembly.free), 1))

    @cached_property
    def flight(self) -> NDArray[np.float64]:
        """Rigid motions, mass-orthonormal: six (dof, 6) of a free body, none (dof, 0) if held."""
        if not self.assembly.flies:
            return np.zeros((self.assembly.dof, 0))
        x = self.assembly.nodes_um - self.assembly.nodes_um.mean(axis=0)
        turns = [np.cross(axis, x / np.abs(x).max()).ravel() for axis in np.eye(3)]
        motions = np.column_stack([self.rigid, *turns])
        gram = np.linalg.cholesky(motions.T @ (self.M @ motions))
        return np.asarray(np.linalg.solve(gram, motions.T).T)

    @property
    def lift(self) -> float:
        """What makes a free body's stiffness invertible: added to its squares [rad^2/s^2].

        A hundredth of the first square of a free rod as long as the body.
        """
        length = float(np.ptp(self.assembly.nodes_um, axis=0).max()) * self.metres_per_um
        speed2 = max(m.E / m.rho for m in self.materials)
        return 0.01 * np.pi**2 * speed2 / length**2 if self.assembly.flies else 0.0

    @property
    def mass_kg(self) -> float:
        """Mass of the whole body, held nodes included [kg]."""
        regions = zip(self.materials, self.assembly.regions, strict=False)
        return self.metres_per_um**3 * sum(m.rho * region.volume_um3 for m, region in regions)

    @property
    def node_masses(self) -> NDArray[np.float64]:
        """What weighs the nodes (n,) when shapes are compared [kg/m^3 um^3]."""
        regions = zip(self.materials, self.assembly.regions, strict=True)
        return np.asarray(sum(m.rho * region.m.diagonal() for m, region in regions))


@dataclass(frozen=True)
class Modes(Tabled):
    """Modes in rising order.

    Args:
        frequencies_hz: natural frequencies (c,) [Hz].
        vectors: mass-normalised shapes over the free unknowns (dof, c) [1/sqrt(kg)].
        residuals: |K phi - omega^2 M phi| / |K phi| (c,).
        orthogonality: largest off-diagonal entry of phi^T M phi.
        participation: share (c, 3) of the body's mass that each mode moves along x, y, z
            (effective modal mass).
        way: how the problem was solved.
        rigid_hz: frequencies (6,) of a free body's rigid motions, which are skipped; none for a
            held body. They are zero but for rounding [Hz].
    """

    frequencies_hz: NDArray[np.float64]
    vectors: NDArray[np.float64]
    residuals: NDArray[np.float64]
    orthogonality: float
    participation: NDArray[np.float64]
    way: str
    rigid_hz: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @property
    def omega(self) -> NDArray[np.float64]:
        """Angular frequencies (c,) [rad/s]."""
        return 2 * np.pi * self.frequencies_hz

    def __str__(self) -> str:
        return (
            f"{len(self.frequencies_hz)} modes by {self.way}: largest residual "
            f"{self.residuals.max():.1e}, orthogonal to {self.orthogonality:.1e}"
        )


def solve(model: CellModel, count: int = 10, *, way: str | None = None) -> Modes:
    """The lowest modes; of a body that nothing holds, those above the six rigid motions.

    Args:
        model: matrices.
        count: number of modes.
        way: "pardiso", "superlu" or "multigrid"; None takes the `fastest`.

    Raises:
        SettingError: more modes than unknowns.
        SimulationError: the iteration did not converge, the stiffness is not positive (a
            prestress that buckles), or a free body is loose.
    """
    K, M, flight = model.K, model.M, model.flight
    most = K.shape[0] - 2 - flight.shape[1]
    if not 0 < count <= most:
        raise SettingError(
            f"{count} modes cannot be computed from {K.shape[0]} unknowns: ask for 1 to {most}.",
            "modes",
        )
    lifted = K + model.lift * M if flight.shape[1] else K

    def lowest(way: str) -> tuple[Block, Block]:
        if way == "multigrid":
            return lowest_by_multigrid(lifted, M, model.assembly, count, flight)
        return _lanczos(lifted, M, count, way, flight)

    chosen = way or fastest(K.shape[0])
    try:
        squares, vectors = lowest(chosen)
    except (SimulationError, RuntimeError, np.linalg.LinAlgError):  # of ARPACK and SuperLU, too
        if way or chosen == direct():
            raise
        chosen = direct()
        squares, vectors = lowest(chosen)
    order = np.argsort(squares)
    squares, vectors = squares[order] - model.lift, vectors[:, order]
    if squares[0] <= LOOSE * model.lift:
        hinged = "parts of the body hang together by a hinge only: they must share faces."
        raise SimulationError(hinged if model.assembly.flies else NOT_POSITIVE)
    M_phi = M @ vectors
    scale = 1 / np.sqrt((vectors * M_phi).sum(axis=0))
    vectors, M_phi = vectors * scale, M_phi * scale
    K_phi = K @ vectors
    gram = vectors.T @ M_phi
    return Modes(
        np.sqrt(squares) / (2 * np.pi),
        vectors,
        np.linalg.norm(K_phi - M_phi * squares, axis=0) / np.linalg.norm(K_phi, axis=0),
        float(np.abs(gram - np.diag(np.diag(gram))).max()),
        (M_phi.T @ model.rigid) ** 2 / model.mass_kg,
        chosen,
        np.sqrt(np.abs((flight * (K @ flight)).sum(axis=0))) / (2 * np.pi),
    )


def _lanczos(K: sp.csr_array, M: sp.csr_array, count: int, way: str, flight: Block) -> tuple[Block, Block]:
    """([K] - omega^2 [M]) {Phi} = 0, Eq. (5.3), by Lanczos on K^-1 M, beside the rigid motions."""
    invert, weights = inverse(K, way), M @ flight

    def apply(b: NDArray[np.float64]) -> NDArray[np.float64]:
        x = invert(b)
        return x - flight @ (weights.T @ x)

    operator = spla.LinearOperator(K.shape, apply, dtype=np.float64)
    start = np.random.default_rng(5).standard_normal(K.shape[0])  # the same run, the same digits
    start -= flight @ (weights.T @ start)
    # Lanczos may miss one of two close modes at its end
    many = min(count + GUARD, K.shape[0] - 2 - flight.shape[1])
    space = min(K.shape[0] - 1, 2 * many + 4)
    try:
        squares, vectors = spla.eigsh(K, many, M, sigma=0, OPinv=operator, v0=start, ncv=space, tol=CONVERGED)
    except spla.ArpackError as error:
        text = f"the modes did not converge ({error}): ask for fewer or refine the mesh."
        raise SimulationError(text) from error
    lowest = np.argsort(squares)[:count]
    return squares[lowest], vectors[:, lowest]


def pardiso(K: sp.csr_array) -> Solve:
    """Cholesky factorisation by MKL Pardiso.

    Raises:
        SimulationError: the stiffness is not positive.
    """
    from pypardiso import PyPardisoSolver
    from pypardiso.pardiso_wrapper import PyPardisoError

    solver = PyPardisoSolver(mtype=2)
    upper = sp.csr_matrix(sp.triu(K, format="csr"))
    try:
        solver.factorize(upper)
    except PyPardisoError as error:
        raise SimulationError(NOT_POSITIVE) from error
    solver.factorized_A = upper  # and not its copy of it
    return lambda b: np.asarray(solver.solve(upper, np.asarray(b, dtype=np.float64)))


def superlu(K: sp.csr_array) -> Solve:
    """Sparse LU without pivoting, symmetric minimum degree: half the fill of scipy's default."""
    symmetric = {"SymmetricMode": True}
    factors = spla.splu(sp.csc_array(K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)
    return lambda b: np.asarray(factors.solve(np.asarray(b, dtype=np.float64)))


WAYS: dict[str, Callable[[sp.csr_array], Solve]] = {"pardiso": pardiso, "superlu": superlu}


def direct() -> str:
    """The best factorisation that is installed."""
    return "pardiso" if find_spec("pypardiso") else "superlu"


def fastest(unknowns: int) -> str:
    """The fastest way without further packages, as measured at that number of unknowns."""
    return "superlu" if unknowns <= SUPERLU_TO else "multigrid"


def inverse(K: sp.csr_array, way: str) -> Solve:
    """A function that applies the inverse of `K`.

    Raises:
        SettingError: there is no such way.
        MissingPackageError: its package is not installed.
    """
    if way not in WAYS:
        raise SettingError(unknown("solver", way, (*WAYS, "multigrid")) + ".", "solver")
    with required("pypardiso", "pardiso"):
        return WAYS[way](K)


def lowest_by_multigrid(
    K: sp.csr_array, M: sp.csr_array, assembly: Assembly, count: int, flight: Block
) -> tuple[Block, Block]:
    """Eigenvalues (count,) and vectors (dof, count) of K x = lambda M x beside the rigid motions.

    LOBPCG (Knyazev 2001), which ends by r B r / lambda for the residual r and the preconditioner
    B: the relative error of an eigenvalue, as far as B inverts K. The norm of r, by which scipy's
    ends, never falls far in a slender body.

    Raises:
        SimulationError: it did not converge within `ITERATIONS`.
    """
    P = prolongation(assembly)
    R = P.T.tocsr()
    coarse = superlu(R @ K @ P)
    precondition, M_flight = two_level(K, P, coarse), M @ flight

    def deforming(x: Block) -> Block:
        return x - flight @ (M_flight.T @ x)

    size = count + GUARD
    start = _coarse_modes(sp.csr_array(R @ M @ P), coarse, size + flight.shape[1])
    squares, x = _ritz(K, M, deforming(precondition(M @ (P @ start))), size)
    step = x[:, :0]
    for _ in range(ITERATIONS):
        r = K @ x - (M @ x) * squares
        towards = deforming(precondition(r))
        errors = np.abs((r * towards).sum(axis=0) / squares)
        if errors[:count].max() < CONVERGED:
            return squares[:count], x[:, :count]
        before = x
        open_ones = towards[:, errors > CONVERGED]
        squares, x = _ritz(K, M, np.column_stack([x, open_ones, step]), size)
        step = x - before @ (before.T @ (M @ x))
    text = f"the modes did not converge in {ITERATIONS} iterations: take --solver superlu."
    raise SimulationError(text)


def _ritz(K: sp.csr_array, M: sp.csr_array, vectors: Block, count: int) -> tuple[Block, Block]:
    """Lowest eigenvalues (count,) and vectors (dof, count) within the columns' span."""
    basis = orthonormal(vectors, M)
    squares, turn = np.linalg.eigh(basis.T @ (K @ basis))
    return squares[:count], basis @ turn[:, :count]


def orthonormal(vectors: Block, M: sp.csr_array) -> Block:
    """M-orthonormal basis of the columns' span; directions that add nothing are dropped."""
    vectors = vectors / np.sqrt((vectors * (M @ vectors)).sum(axis=0))
    for _ in range(2):  # the second pass removes what rounding left of the first
        values, turn = np.linalg.eigh(vectors.T @ (M @ vectors))
        keep = values > 1e-10 * values[-1]
        vectors = vectors @ (turn[:, keep] / np.sqrt(values[keep]))
    return vectors


def prolongation(assembly: Assembly) -> sp.csr_array:
    """Interpolation (dof, coarse) from the free corners; a mid-edge node is its ends' mean."""
    corners, edges = assembly.basis.nodal_dofs[0], assembly.basis.edge_dofs[0]
    ends = assembly.basis.mesh.edges
    rows = np.concatenate([corners, edges, edges])
    columns = np.concatenate([np.arange(len(corners)), *ends])
    values = np.repeat([1.0, 0.5], [len(corners), 2 * len(edges)])
    shape = len(assembly.nodes_um), len(corners)
    scalar = sp.csr_array((values, (rows, columns)), shape=shape)
    free_corners = np.flatnonzero(np.isin(corners, assembly.free))
    return sp.kron(scalar[assembly.free][:, free_corners], sp.eye_array(3), format="csr")


def _coarse_modes(M: sp.csr_array, apply: Solve, count: int) -> Block:
    """Roughly the lowest modes (n, count) of the corners' problem; `apply` inverts its K."""
    n = M.shape[0]
    start = np.random.default_rng(5).standard_normal((n, count))
    if n <= 2 * count:
        return start
    inverted = spla.LinearOperator(M.shape, apply, dtype=np.float64)
    # eigsh takes the stiffness for its shape alone, as the inverse is given
    squares, vectors = spla.eigsh(M, count, M, sigma=0, OPinv=inverted, v0=start[:, 0], tol=1e-3, ncv=2 * count)
    return np.asarray(vectors[:, np.argsort(squares)])


def two_level(K: sp.csr_array, P: sp.csr_array, coarse: Solve) -> Solve:
    """A symmetric positive approximation of K^-1 for blocks (dof, c); `coarse` inverts P^T K P."""
    R = P.T.tocsr()
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
        return smooth(b, x + P @ coarse(R @ (b - K @ x)))

    return precondition
