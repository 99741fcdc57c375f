"""Twelve bodies, by surface and by tetrahedra, without any option: five modes beside theory or a fine mesh.

Beams, plates and the insole stand beside structured meshes of theirs, the sphere beside Lamb's, the
others beside the same surface in finer elements, tetrahedra beside themselves cut once more.
"""

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

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
from fasbody.cell.mesh import MeshSize, TetMesh
from fasbody.cell.mesher import default_size, dome_mesh, fill
from fasbody.cell.modal import CellModel, solve
from fasbody.console import command_line, console
from fasbody.runner import run
from reproduction.check import Check, at_least, at_most
from simulator.bodies import box, lamb_torsional

MATERIAL = Material(2e9, 0.3, 1000.0)
#: Length, height and width [mm], support, and the parts of the structured mesh.
BOXES = {
    "slender beam": ((200, 10, 10), "free", (60, 6, 6)),
    "slender beam on its end": ((10, 200, 10), "base", (6, 60, 6)),
    "stubby beam on its end": ((20, 40, 20), "base", (10, 20, 10)),
    "plate": ((100, 2, 80), "free", (50, 2, 40)),
    "plate on its edge": ((100, 80, 3), "base", (50, 40, 2)),
    "insole": ((260, 5, 90), "free", (65, 2, 22)),
}
ROUND = ("shell with a cavity", "sphere", "cylinder", "bone", "drum with a chamber", "cell on its base")
COUNT = 5
#: Elements of the reference, of the default's; and of the tetrahedra in a file, which are then cut in eight.
FINER, COARSER = 0.7, 2.3
#: What a user may expect without any option [%].
REQUIRED = 1.0


def surface_of(name: str) -> trimesh.Trimesh:
    """The surface of a body [mm]."""
    if name in BOXES:
        return trimesh.creation.box(BOXES[name][0])
    if name == "shell with a cavity":
        hollow = trimesh.creation.icosphere(3, 7.0)
        hollow.invert()
        return trimesh.util.concatenate([trimesh.creation.icosphere(4, 10.0), hollow])
    if name == "sphere":
        return trimesh.creation.icosphere(4, 10.0)
    if name == "cylinder":
        return trimesh.creation.cylinder(5.0, 40.0, sections=64)
    if name == "drum with a chamber":
        drum, room = trimesh.creation.cylinder(20.0, 16.0, sections=64), trimesh.creation.box((14, 14, 8))
        return trimesh.util.concatenate([drum, room])
    mesh = read_body("metatarsal_2").mesh if name == "bone" else dome_mesh(Dome(nucleus=None), MeshSize.of(2.5))
    return trimesh.Trimesh(mesh.points_um / 1e3, mesh.surface.faces)


def frequencies(mesh: TetMesh, support: str) -> np.ndarray:
    """Of the first five modes [Hz]."""
    return solve(CellModel(assemble(mesh, held=FREE if support == "free" else None), (MATERIAL,)), COUNT).frequencies_hz


def reference(name: str, support: str, surface_um: trimesh.Trimesh) -> np.ndarray:
    """Frequencies of a body in a structured or a finer mesh, or by theory [Hz]."""
    if name in BOXES:
        sides, _, parts = BOXES[name]
        grids = (np.linspace(0, 1e3 * side, n + 1) for side, n in zip(sides, parts, strict=True))
        return frequencies(box(*grids), support)
    if name == "sphere":
        c_s = np.sqrt(MATERIAL.E / (2 * (1 + MATERIAL.nu) * MATERIAL.rho))
        return np.full(COUNT, lamb_torsional(2) * c_s / (2 * np.pi * 0.01))
    return frequencies(fill(surface_um, default_size(surface_um).coarser(FINER)), support)


def measured(name: str) -> list[Check]:
    """The rows of one body."""
    support = BOXES[name][1] if name in BOXES else "base" if name.endswith("base") else "free"
    surface = surface_of(name)
    um = surface.copy().apply_scale(1e3)
    beside = reference(name, support, um)
    rows: list[Check] = []
    with tempfile.TemporaryDirectory() as folder:
        stl, vtu = (Path(folder) / f"body.{kind}" for kind in ("stl", "vtu"))
        surface.export(stl)
        coarse = fill(um, default_size(um).coarser(COARSER))
        meshio.Mesh(coarse.points_um / 1e3, [("tetra10", coarse.tets)]).write(vtu)
        for file in (stl, vtu):
            start = time.process_time()
            modes = body_modes(read_body(file), {None: MATERIAL}, support, count=COUNT)
            seconds = time.process_time() - start
            if file is vtu and name not in BOXES:  # its straight or curved elements are the shape
                beside = frequencies(refined(modes.body.mesh), support)
            rows += judged(f"{name}, {file.suffix[1:]}", modes, beside, seconds)
    return rows


def judged(name: str, modes: BodyModes, beside: np.ndarray, seconds: float) -> Iterator[Check]:
    """How far off the modes are, and whether the printed errors hold."""
    off, errors = np.abs(modes.frequencies_hz / beside - 1), np.asarray(modes.errors)
    what = f"{name}, {modes.model.assembly.dof} unknowns, {seconds:.0f} s"
    yield at_most(f"{what}: five modes off by", 100 * off.max(), REQUIRED, "%")
    printed = f"{name}: modes whose printed error ({100 * errors.max():.2g} % at most) holds"
    yield at_least(printed, int((off <= errors).sum()), COUNT)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    only: Annotated[list[str] | None, typer.Option(help="a body, such as plate; repeat for several")] = None,
    jobs: Annotated[int, typer.Option(help="processes; each takes up to 2 GB")] = 1,
    json_: JsonOption = False,
) -> None:
    """Error and time of the modes of twelve bodies with default settings.

    Examples:
      OMP_NUM_THREADS=1 python -m benchmarks.bodies --only plate --only sphere
    """
    names = [name for name in (*BOXES, *ROUND) if not only or name in only]
    rows: dict[int, list[Check]] = {}
    for i, rows[i] in run(measured, names, "bodies", jobs):
        console.print(f"{names[i]}: {', '.join(row.measured for row in rows[i])}")
    report("bodies", [row for i in range(len(names)) for row in rows[i]], json_)


if __name__ == "__main__":
    command_line(app)
