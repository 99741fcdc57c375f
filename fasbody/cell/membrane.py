"""A thin elastic membrane on the free surface of the cell (Table 5.1 prints its moduli; the thesis leaves it out)."""

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from fasbody.cell.assembly import Assembly
from fasbody.cell.tetmesh import QUADRATURE
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
        if not (math.isfinite(self.E * self.thickness_nm) and self.E > 0 and self.thickness_nm > 0):
            raise SettingError("the membrane's modulus [Pa] and thickness [nm] must be positive numbers.")
        if not -1 < self.nu < 1:
            raise SettingError(f"the membrane's Poisson's ratio must lie between -1 and 1, not {self.nu}.")


def membrane_stiffness(assembly: Assembly, membrane: Membrane, metres_per_um: float) -> sp.csr_array:
    """Stiffness [N/m] of a membrane over the whole surface, on the free unknowns.

    Surface strain e = P sym(grad u) P with P = 1 - n n^T; energy t/2 int (lambda' tr(e)^2 + 2 mu e:e) dA for plane
    stress.
    """
    from skfem import BilinearForm, ElementTetP2, ElementVector, FacetBasis

    basis = FacetBasis(assembly.mesh.skfem, ElementVector(ElementTetP2()), intorder=QUADRATURE)
    lam, mu = membrane.nu / (1 - membrane.nu**2), 1 / (2 * (1 + membrane.nu))

    @BilinearForm
    def energy(u, v, w):  # type: ignore[no-untyped-def]
        P = np.eye(3)[:, :, None, None] - w.n[:, None] * w.n[None]

        def strain(a):  # type: ignore[no-untyped-def]
            symmetric = (a.grad + np.swapaxes(a.grad, 0, 1)) / 2
            return np.einsum("ijab,jkab,klab->ilab", P, symmetric, P, optimize=True)

        e, d = strain(u), strain(v)
        return lam * np.einsum("iiab,jjab->ab", e, d) + 2 * mu * np.einsum("ijab,ijab->ab", e, d)

    rows = (3 * assembly.free[:, None] + np.arange(3)).ravel()
    thickness_um = membrane.thickness_nm * 1e-3
    return metres_per_um * membrane.E * thickness_um * sp.csr_array(energy.assemble(basis))[rows][:, rows]
