"""Cells that several tests share, meshed once a process; nothing is written to the user's cache."""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from skfem import MeshTet

from fasbody.cell.assembly import Assembly, assemble
from fasbody.cell.dome import Dome
from fasbody.cell.mesh import MeshSize, TetMesh, dome_mesh

CACHE = Path(tempfile.mkdtemp(prefix="fasbody-cells-"))
atexit.register(shutil.rmtree, CACHE, ignore_errors=True)


@cache
def cell(length: float = 100.0, width: float = 40.0, height: float = 9.0, size: float = 6.0) -> Assembly:
    return assemble(dome_mesh(Dome(length, width, height), MeshSize.of(size), cache=CACHE))


def block(
    parts: tuple[int, int, int] = (2, 2, 2), nucleus_below: float | None = None, seed: int | None = None
) -> TetMesh:
    """The cube [0, 2]^3 um in straight tetrahedra, optionally with inner nodes shaken and a lower layer of nucleus."""
    mesh = MeshTet.init_tensor(*(np.linspace(0, 2, n + 1) for n in parts))
    points, tets = mesh.p.T.copy(), mesh.t.T.astype(np.int64).copy()
    if seed is not None:
        inner = ((points > 0) & (points < 2)).all(axis=1)
        points[inner] += np.random.default_rng(seed).uniform(-0.1, 0.1, (inner.sum(), 3))
    wrong = np.linalg.det(np.diff(points[tets], axis=1)) < 0
    tets[wrong] = tets[wrong][:, [1, 0, 2, 3]]
    region = np.zeros(len(tets), dtype=np.int64)
    if nucleus_below is not None:
        region[points[tets][:, :, 1].mean(axis=1) < nucleus_below] = 1
    return TetMesh(points, tets, region)
