"""Natural frequencies and mode shapes: Eq. (5.3) by shift-invert Lanczos, with what tells whether to believe them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from fasbody.cell.assembly import Assembly
from fasbody.cell.cytoskeleton import Tensegrity, cytoskeleton_stiffness
from fasbody.cell.inverse import fastest, inverse
from fasbody.cell.materials import Material
from fasbody.cell.membrane import Membrane, membrane_stiffness
from fasbody.cell.multigrid import lowest_by_multigrid
from fasbody.cell.tetmesh import CYTOPLASM, NUCLEUS
from fasbody.exceptions import SettingError, SimulationError

#: Unknowns above which SuperLU's factors outgrow the two-level iteration in memory (docs/cell.md).
DIRECT_LIMIT = 120_000


@dataclass(frozen=True)
class CellModel:
    """A discretised cell made of materials.

    Args:
        assembly: unit matrices of the mesh.
        materials: by region number.
        metres_per_um: size of the mesh's micrometre [m] (see Preset).
        membrane, cytoskeleton: further stiffness, None leaves it out as the thesis does.
    """

    assembly: Assembly
    materials: tuple[Material, Material]
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
        return self.stiffness(CYTOPLASM) + self.stiffness(NUCLEUS) + self.additions

    @cached_property
    def additions(self) -> sp.csr_array:
        """Stiffness of membrane and cytoskeleton [N/m]."""
        K = sp.csr_array((self.assembly.dof, self.assembly.dof))
        if self.membrane is not None:
            K = K + membrane_stiffness(self.assembly, self.membrane, self.metres_per_um)
        if self.cytoskeleton is not None:
            K = K + cytoskeleton_stiffness(self.assembly, self.cytoskeleton, self.metres_per_um)
        return K

    @cached_property
    def M(self) -> sp.csr_array:
        """Mass matrix [kg], [M] of Eq. (5.2)."""
        return self.mass(CYTOPLASM) + self.mass(NUCLEUS)

    @cached_property
    def rigid(self) -> NDArray[np.float64]:
        """Unit translations (dof, 3) along x, y, z over the free unknowns."""
        return np.tile(np.eye(3), (len(self.assembly.free), 1))

    @property
    def mass_kg(self) -> float:
        """Mass of the whole cell, clamped layer included [kg]."""
        volumes = (region.volume_um3 for region in self.assembly.regions)
        return self.metres_per_um**3 * sum(m.rho * v for m, v in zip(self.materials, volumes, strict=True))


@dataclass(frozen=True)
class Modes:
    """Modes in rising order.

    Args:
        frequencies_hz: natural frequencies (c,) [Hz].
        vectors: mass-normalised shapes over the free unknowns (dof, c) [1/sqrt(kg)].
        residuals: |K phi - omega^2 M phi| / |K phi| (c,).
        orthogonality: largest off-diagonal entry of phi^T M phi.
        participation: share (c, 3) of the cell's mass that each mode moves along x, y, z (effective modal mass).
        way: how the problem was solved.
    """

    frequencies_hz: NDArray[np.float64]
    vectors: NDArray[np.float64]
    residuals: NDArray[np.float64]
    orthogonality: float
    participation: NDArray[np.float64]
    way: str

    @property
    def omega(self) -> NDArray[np.float64]:
        """Angular frequencies (c,) [rad/s]."""
        return 2 * np.pi * self.frequencies_hz

    def __str__(self) -> str:
        return (
            f"{len(self.frequencies_hz)} modes by {self.way}: largest residual {self.residuals.max():.1e}, "
            f"orthogonal to {self.orthogonality:.1e}"
        )


def solve(model: CellModel, count: int = 10, *, way: str | None = None, shift_hz2: float = 0.0) -> Modes:
    """The lowest modes of a cell.

    Args:
        model: matrices.
        count: number of modes.
        way: "pardiso", "superlu" or "multigrid"; None takes the fastest that fits in memory.
        shift_hz2: frequencies are searched around the root of this [Hz^2]; negative for a body that is free to fly.

    Raises:
        SettingError: more modes are asked for than there are unknowns.
        SimulationError: the iteration did not converge, or the stiffness is not positive (a prestress that buckles).
    """
    K, M = model.K, model.M
    if not 0 < count < K.shape[0] - 1:
        raise SettingError(f"{count} modes cannot be had from {K.shape[0]} unknowns: ask for 1 to {K.shape[0] - 2}.")
    way = way or (fastest() if fastest() != "superlu" or K.shape[0] <= DIRECT_LIMIT else "multigrid")
    try:
        if way == "multigrid":
            squares, vectors = lowest_by_multigrid(K, M, model.assembly, count)
        else:
            squares, vectors = _lanczos(K, M, count, way, (2 * np.pi) ** 2 * shift_hz2)
    except spla.ArpackError as error:
        raise SimulationError(f"the modes did not converge ({error}): ask for fewer or refine the mesh.") from error
    order = np.argsort(squares)
    squares, vectors = squares[order], vectors[:, order]
    if shift_hz2 >= 0 and squares[0] <= 0:
        raise SimulationError("the cell's stiffness is not positive: its prestress exceeds what it can carry.")
    return _assess(model, K, squares, vectors, way)


def _lanczos(
    K: sp.csr_array, M: sp.csr_array, count: int, way: str, shift: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """([K] - omega^2 [M]) {Phi} = 0, Eq. (5.3), by Lanczos on (K - shift M)^-1 M."""
    apply = spla.LinearOperator(K.shape, inverse(K - shift * M if shift else K, way), dtype=np.float64)
    start = np.random.default_rng(5).standard_normal(K.shape[0])  # fixed: the same run gives the same digits
    return spla.eigsh(K, count, M, sigma=shift, OPinv=apply, v0=start, ncv=min(K.shape[0] - 1, 2 * count + 10))


def _assess(
    model: CellModel, K: sp.csr_array, squares: NDArray[np.float64], vectors: NDArray[np.float64], way: str
) -> Modes:
    M_phi = model.M @ vectors
    scale = 1 / np.sqrt(np.einsum("ij,ij->j", vectors, M_phi))
    vectors, M_phi = vectors * scale, M_phi * scale
    K_phi = K @ vectors
    residuals = np.linalg.norm(K_phi - M_phi * squares, axis=0) / np.linalg.norm(K_phi, axis=0)
    gram = vectors.T @ M_phi
    moved = (M_phi.T @ model.rigid) ** 2 / model.mass_kg
    return Modes(
        frequencies_hz=np.sqrt(np.maximum(squares, 0)) / (2 * np.pi),
        vectors=vectors,
        residuals=residuals,
        orthogonality=float(np.abs(gram - np.diag(np.diag(gram))).max()) if len(gram) > 1 else 0.0,
        participation=moved,
        way=way,
    )
