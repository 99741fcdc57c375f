"""Finished meshes on disk: the same dome at the same element sizes is meshed once."""

import hashlib
import io
import os
from dataclasses import astuple
from pathlib import Path

import numpy as np

from fasbody.cell.dome import Dome
from fasbody.cell.meshsize import MeshSize
from fasbody.cell.tetmesh import TetMesh
from fasbody.console import write_whole

FORMAT = 2  # counts up when meshes of old caches must not be used any more


def cache_folder() -> Path:
    """Where finished meshes are kept."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fasbody" / "cell"


def place(dome: Dome, size: MeshSize, folder: Path | None = None) -> Path:
    """The file of a dome's mesh, whether or not it is there."""
    identity = repr((FORMAT, astuple(dome), astuple(size)))
    return (folder or cache_folder()) / f"{hashlib.sha256(identity.encode()).hexdigest()[:24]}.npz"


def read(file: Path) -> TetMesh | None:
    """A stored mesh; None where there is none, or a damaged one."""
    try:
        with np.load(file, allow_pickle=False) as stored:
            return TetMesh(stored["points_um"], stored["tets"], stored["region"])
    except (OSError, ValueError, KeyError, EOFError):
        return None


def write(file: Path, mesh: TetMesh) -> None:
    """Store a mesh, whole or not at all."""
    memory = io.BytesIO()
    np.savez_compressed(memory, points_um=mesh.points_um, tets=mesh.tets, region=mesh.region)
    write_whole(file, memory.getvalue())
