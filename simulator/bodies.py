"""Elastic bodies with known frequencies, and cells that several tests share, meshed once a process.

Nothing is written to the user's cache.
"""

import atexit
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import spherical_jn
from skfem import MeshTet

from fasbody.cell.assembly import Assembly, assemble
from fasbody.cell.dome import Dome
from fasbody.cell.materials import Material
from fasbody.cell.mesh import MeshSize, TetMesh
from fasbody.cell.mesher import dome_mesh

CACHE = Path(tempfile.mkdtemp(prefix="fasbody-cells-"))
atexit.register(shutil.rmtree, CACHE, ignore_errors=True)


@cache
def cell(length: float = 100.0, width: float = 40.0, height: float = 9.0, size: float = 6.0) -> Assembly:
    """A dome of the nominal cell [um]."""
    return assemble(dome_mesh(Dome(length, width, height), MeshSize.of(size), cache=CACHE))


def block(
    parts: tuple[int, int, int] = (2, 2, 2),
    nucleus_below: float | None = None,
    seed: int | None = None,
) -> TetMesh:
    """The cube [0, 2]^3 um in straight tetrahedra, optionally with inner nodes shaken and a lower layer of nucleus."""
    mesh = box(*(np.linspace(0, 2, n + 1) for n in parts))
    points, tets, region = mesh.points_um, mesh.tets, mesh.region
    if seed is not None:
        inner = ((points > 0) & (points < 2)).all(axis=1)
        points[inner] += np.random.default_rng(seed).uniform(-0.1, 0.1, (inner.sum(), 3))
    if nucleus_below is not None:
        region[points[tets][:, :, 1].mean(axis=1) < nucleus_below] = 1
    return TetMesh(points, tets, region)


def lamb_torsional(n: int) -> float:
    """Lowest x = omega R / c_s of the torsional modes of degree n >= 2 of a free sphere (Lamb 1881)."""
    return _first_root(lambda x: (n - 1) * spherical_jn(n, x) - x * spherical_jn(n + 1, x))


def lamb_spheroidal(n: int, nu: float) -> float:
    """Lowest x = omega R / c_s of the spheroidal modes of degree n >= 2 of a free sphere (Lamb 1881)."""
    slow = np.sqrt((1 - 2 * nu) / (2 * (1 - nu)))  # c_s / c_p

    def determinant(x: float) -> float:
        y = slow * x
        j_x, j_y, k_x, k_y = (spherical_jn(m, z) for m in (n, n + 1) for z in (x, y))
        t_11 = (n**2 - n - x**2 / 2) * j_y + 2 * y * k_y
        t_13 = n * (n + 1) * ((n - 1) * j_x - x * k_x)
        t_41 = (n - 1) * j_y - y * k_y
        t_43 = (n**2 - 1 - x**2 / 2) * j_x + x * k_x
        return float(t_11 * t_43 - t_13 * t_41)

    return _first_root(determinant)


def timoshenko(E: float, rho: float, length: float, side: float, *, held: bool) -> float:
    """Lowest bending frequency [Hz] of a square beam with nu = 0 (shear coefficient 5/6), lengths in m.

    Args:
        E: Young's modulus [Pa]. rho: density [kg/m^3]. length: of the beam. side: of its section.
        held: one end is clamped, the other free; otherwise both are free.
    """
    A, inertia, shear = side**2, side**4 / 12, 5 / 6 * E / 2

    def far_end(omega: float) -> float:
        # along the beam: deflection, rotation, moment, shear force
        along = np.array(
            [
                [0, 1, 0, 1 / (shear * A)],
                [0, 0, 1 / (E * inertia), 0],
                [0, -rho * inertia * omega**2, 0, -1],
                [-rho * A * omega**2, 0, 0, 0],
            ]
        )
        near = slice(2, 4) if held else slice(0, 2)
        return float(np.linalg.det(expm(along * length)[2:, near]))

    # Euler and Bernoulli: an upper bound
    slender = (1.8751 if held else 4.7300) ** 2 * np.sqrt(E * inertia / (rho * A)) / length**2
    return brentq(far_end, 0.5 * slender, 1.05 * slender) / (2 * np.pi)


def two_part_rod(materials: tuple[Material, Material], lengths: tuple[float, float]) -> float:
    """Lowest axial frequency [Hz] of a rod held at the end of its first part, nu = 0, lengths in m.

    tan(k1 l1) tan(k2 l2) = Z1 / Z2 with the wave numbers k = omega / c and the impedances Z = sqrt(E rho).
    """
    l1, l2 = lengths
    c1, c2 = (np.sqrt(m.E / m.rho) for m in materials)
    Z1, Z2 = (np.sqrt(m.E * m.rho) for m in materials)
    ends = min(np.pi / 2 * c1 / l1, np.pi / 2 * c2 / l2)  # where one of the tangents is infinite
    root = brentq(
        lambda w: np.tan(w * l1 / c1) * np.tan(w * l2 / c2) - Z1 / Z2,
        1e-9 * ends,
        (1 - 1e-9) * ends,
    )
    return float(root / (2 * np.pi))


def box(*grids: NDArray[np.float64], up: int = 1) -> TetMesh:
    """A cuboid in straight tetrahedra with these coordinates of the corners along x, y, z [um]."""
    mesh = MeshTet.init_tensor(*grids)
    points, tets = mesh.p.T.copy(), mesh.t.T.astype(np.int64)
    inverted = np.linalg.det(np.diff(points[tets], axis=1)) < 0
    tets[inverted] = tets[inverted][:, [1, 0, 2, 3]]
    return TetMesh(points, tets, np.zeros(len(tets), dtype=np.int64), up).check()


def _first_root(f: Callable[[float], float], start: float = 0.5, stop: float = 30.0, steps: int = 3000) -> float:
    x = np.linspace(start, stop, steps)
    y = np.array([f(value) for value in x])
    first = int(np.flatnonzero(y[:-1] * y[1:] < 0)[0])
    return float(brentq(f, x[first], x[first + 1], xtol=1e-14))
