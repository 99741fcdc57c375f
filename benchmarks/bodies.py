"""Twelve bodies, by surface and by tetrahedra, without any option: first five modes beside theory or a fine mesh.

Beams, plates and the insole stand beside structured meshes of theirs, the sphere beside Lamb's, the others beside the
same surface in finer elements.
"""

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import meshio
import numpy as np
import trimesh
import typer

from benchmarks.table import JsonOption, report
from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.body import BodyModes, body_modes, read_body
from fasbody.cell.companion import refined
from fasbody.cell.dome import Dome
from fasbody.cell.materials import Material
from fasbody.cell.mesh import MeshSize, default_size, dome_mesh, fill
from fasbody.cell.modal import CellModel, solve
from fasbody.console import command_line
from reproduction.check import Check, told
from simulator.bodies import box, lamb_torsional

MATERIAL = Material(2e9, 0.3, 1000.0)
#: Length, height and width [mm], which end stands still, and the parts of the structured mesh.
BOXES = {
    "slender beam, free": ((200, 10, 10), "free", (60, 6, 6)),
    "slender beam, on its end": ((10, 200, 10), "base", (6, 60, 6)),
    "stubby beam, on its end": ((20, 40, 20), "base", (10, 20, 10)),
    "plate, free": ((100, 2, 80), "free", (50, 2, 40)),
    "plate, on its edge": ((100, 80, 3), "base", (50, 40, 2)),
    "insole, free": ((260, 5, 90), "free", (65, 2, 22)),
}
COUNT, FINER = 5, 0.6


def surfaces() -> Iterator[tuple[str, str, trimesh.Trimesh]]:
    """Name, support and surface [mm] of each body but the boxes."""
    hollow = trimesh.creation.icosphere(3, 7.0)
    hollow.invert()
    ball, rod = trimesh.creation.icosphere(4, 10.0), trimesh.creation.cylinder(5.0, 40.0, sections=64)
    yield "shell with a cavity, free", "free", trimesh.util.concatenate([ball, hollow])
    yield "sphere, free", "free", ball
    yield "cylinder, free", "free", rod
    bone = read_body("metatarsal_2").mesh
    yield "bone, free", "free", trimesh.Trimesh(bone.points_um / 1e3, bone.surface.faces)
    yield (
        "drum with a chamber, free",
        "free",
        trimesh.util.concatenate(
            [trimesh.creation.cylinder(20.0, 16.0, sections=64), trimesh.creation.box((14, 14, 8))]
        ),
    )
    cell = dome_mesh(Dome(nucleus=None), MeshSize.of(2.5))
    yield "cell, on its base", "base", trimesh.Trimesh(cell.points_um / 1e3, cell.surface.faces)


def fine_modes(surface: trimesh.Trimesh, support: str) -> np.ndarray:
    """Frequencies of a surface [mm] in finer elements than the default's [Hz]."""
    um = surface.copy().apply_scale(1e3)
    mesh = fill(um, default_size(um).coarser(FINER))
    model = CellModel(assemble(mesh, held=FREE if support == "free" else None), (MATERIAL,))
    return solve(model, COUNT).frequencies_hz


def finest(modes: BodyModes, support: str) -> np.ndarray:
    """Frequencies of the tetrahedra that were solved, cut in eight once more [Hz]."""
    mesh = refined(modes.body.mesh)
    return solve(CellModel(assemble(mesh, held=FREE if support == "free" else None), (MATERIAL,)), COUNT).frequencies_hz


def modes_by_format(surface: trimesh.Trimesh, support: str, folder: Path) -> Iterator[tuple[str, BodyModes, float]]:
    """Modes by .stl and by .vtu, and CPU seconds."""
    um = surface.copy().apply_scale(1e3)
    coarse = fill(um, default_size(um).coarser(1.8))
    meshio.Mesh(coarse.points_um / 1e3, [("tetra10", coarse.tets)]).write(folder / "body.vtu")
    surface.export(folder / "body.stl")
    for name in ("body.stl", "body.vtu"):
        start = time.process_time()
        yield (
            name[-3:],
            body_modes(read_body(folder / name), {None: MATERIAL}, support, count=COUNT),
            (time.process_time() - start),
        )


def compared(name: str, way: str, modes: BodyModes, reference: np.ndarray, seconds: float) -> Check:
    """The row of one body."""
    errors = np.abs(modes.frequencies_hz / reference - 1)
    inside = int((errors <= modes.errors).sum())
    printed = f"{100 * modes.errors.max():.2g} % printed, holds in {inside} of {COUNT}"
    what = f"{name}, {way}, {modes.model.assembly.dof} unknowns, {seconds:.0f} s"
    return told(what, f"{100 * errors.max():.2g} % off at most", printed)


def measure() -> list[Check]:
    """A row a body and way."""
    rows = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, (sides, support, parts) in BOXES.items():
            mesh = box(*(np.linspace(0, 1e3 * side, n + 1) for side, n in zip(sides, parts, strict=True)))
            model = CellModel(assemble(mesh, held=FREE if support == "free" else None), (MATERIAL,))
            reference = solve(model, COUNT).frequencies_hz
            for way, modes, seconds in modes_by_format(trimesh.creation.box(sides), support, folder):
                rows.append(compared(name, way, modes, reference, seconds))
        for name, support, surface in surfaces():
            reference = fine_modes(surface, support)
            if name.startswith("sphere"):
                c_s = np.sqrt(MATERIAL.E / (2 * (1 + MATERIAL.nu) * MATERIAL.rho))
                reference = np.full(COUNT, lamb_torsional(2) * c_s / (2 * np.pi * 0.01))
            for way, modes, seconds in modes_by_format(surface, support, folder):
                if way == "vtu":  # its straight or curved elements are the shape
                    reference = finest(modes, support)
                rows.append(compared(name, way, modes, reference, seconds))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(json_: JsonOption = False) -> None:
    """Bodies of every kind by themselves: how far off, how long.

    Examples:
      OMP_NUM_THREADS=1 python -m benchmarks.bodies
    """
    report("bodies", measure(), json_)


if __name__ == "__main__":
    command_line(app)
