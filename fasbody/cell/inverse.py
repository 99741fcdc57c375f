"""The inverse of a stiffness matrix for shift-invert Lanczos: the fastest factorisation that is installed.

Pardiso (package pypardiso, with Intel's MKL) factors the symmetric half; SuperLU comes with scipy and keeps L and U.
Measured side by side in docs/cell.md.
"""

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from fasbody.exceptions import SettingError, unknown

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def pardiso(K: sp.csr_array) -> Solve:
    """Cholesky-like factorisation by MKL Pardiso (real symmetric indefinite, so that free bodies may be shifted)."""
    from pypardiso import PyPardisoSolver

    solver = PyPardisoSolver(mtype=-2)
    upper = sp.csr_matrix(sp.triu(K, format="csr"))
    solver.factorize(upper)
    return lambda b: np.asarray(solver.solve(upper, np.asarray(b, dtype=np.float64)))


def superlu(K: sp.csr_array) -> Solve:
    """Sparse LU without pivoting over a symmetric minimum-degree ordering: half the fill of scipy's default."""
    factors = spla.splu(
        sp.csc_array(K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return lambda b: np.asarray(factors.solve(np.asarray(b, dtype=np.float64)))


WAYS: dict[str, Callable[[sp.csr_array], Solve]] = {"pardiso": pardiso, "superlu": superlu}


def fastest() -> str:
    """The fastest way that is installed."""
    return "pardiso" if find_spec("pypardiso") else "superlu"


def inverse(K: sp.csr_array, way: str) -> Solve:
    """A function that applies the inverse of `K`.

    Raises:
        SettingError: there is no such way, or its package is not installed.
    """
    if way not in WAYS:
        raise SettingError(unknown("solver", way, (*WAYS, "multigrid")) + ".")
    try:
        return WAYS[way](K)
    except ImportError as error:
        raise SettingError(f"the solver {way} needs the package pypardiso: pip install pypardiso.") from error
