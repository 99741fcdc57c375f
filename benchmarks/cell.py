"""Ten modes of the cell beside plain scipy on the same matrices, and a large cell: time and memory of each.

Every solver runs in a separate process, so that its peak memory is measured alone. Times are CPU seconds, which other
work on the machine hardly disturbs. `OMP_NUM_THREADS=1` keeps them on one thread.
"""

import json
import resource
import subprocess
import sys
import time
from importlib.util import find_spec
from typing import Annotated

import numpy as np
import scipy.sparse.linalg as spla
import typer

from benchmarks.table import JsonOption, report
from fasbody.cell.assembly import assemble
from fasbody.cell.dome import Dome
from fasbody.cell.materials import preset
from fasbody.cell.mesh import MeshSize
from fasbody.cell.mesher import dome_mesh
from fasbody.cell.modal import CellModel, fastest, solve
from fasbody.console import command_line, print_json
from reproduction.check import Check, told

#: Element sizes [um] of about 5,000, 25,000 and 100,000 unknowns, and of 250,000.
SMALL, SIZE, MIDDLE, LARGE = 6.0, 3.2, 1.95, 1.4
PLAIN = "plain scipy"


def run(way: str, size: float) -> dict[str, float]:
    """Mesh from the cache, assemble, solve ten modes: unknowns, CPU seconds, GiB, first and tenth frequency [Hz]."""
    chosen = preset("si")
    mesh = dome_mesh(Dome(), MeshSize.of(size))
    start = time.process_time()
    model = CellModel(assemble(mesh), chosen.materials, chosen.metres_per_um)
    K, M = model.K, model.M
    assembled = time.process_time()
    if way == PLAIN:
        squares = spla.eigsh(K.tocsc(), 10, M.tocsc(), sigma=0, return_eigenvectors=True)[0]
        f = np.sqrt(np.sort(squares)) / (2 * np.pi)
    else:
        f = solve(model, 10, way=way).frequencies_hz
    return {
        "unknowns": model.assembly.dof, "assembly_s": assembled - start, "solution_s": time.process_time() - assembled,
        "memory_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, "f1_hz": f[0], "f10_hz": f[9],
    }  # fmt: skip


def apart(way: str, size: float) -> dict[str, float]:
    """The same in a separate process."""
    command = [sys.executable, "-m", "benchmarks.cell", "--way", way, "--size", str(size)]
    return dict(json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout))


def measure(large: bool = False) -> list[Check]:
    """Rows of each way at each size, the usual cell beside plain scipy."""
    ways = ["superlu", "multigrid", *(["pardiso"] if find_spec("pypardiso") else [])]
    jobs = [(way, size) for size in (SMALL, SIZE, MIDDLE) for way in ways]
    jobs += [(way, LARGE) for way in ways[1:] if large]
    for size in sorted({size for _, size in jobs}):
        dome_mesh(Dome(), MeshSize.of(size))  # meshing is not what is measured
    plain, rows = apart(PLAIN, SIZE), []
    for way, size in jobs:
        result = apart(way, size)
        default = ", the default" if way == fastest(int(result["unknowns"])) else ""
        what = f"ten modes of the cell, {result['unknowns']:.0f} unknowns, {way}{default}, {_ends(result)}"
        beside = f"{PLAIN}, {_ends(plain)}: {_cost(plain)}" if size == SIZE else ""
        rows.append(told(what, _cost(result), beside, plain["solution_s"] / result["solution_s"] if beside else None))
    rows.append(told(f"the same, assembly of {plain['unknowns']:.0f} unknowns", f"{plain['assembly_s']:.1f} s"))
    return rows


def _ends(result: dict[str, float]) -> str:
    return f"f1 {result['f1_hz']:.3f} and f10 {result['f10_hz']:.3f} Hz"


def _cost(result: dict[str, float]) -> str:
    return f"{result['solution_s']:.1f} s, {result['memory_gib']:.2f} GiB"


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    large: Annotated[bool, typer.Option("--large", help="about 250,000 unknowns, too; several minutes")] = False,
    way: Annotated[str, typer.Option(hidden=True)] = "",
    size: Annotated[float, typer.Option(hidden=True)] = SIZE,
    json_: JsonOption = False,
) -> None:
    """Time and memory of the cell's modes, solver by solver.

    Examples:
      OMP_NUM_THREADS=1 python -m benchmarks.cell --large
    """
    if way:
        print_json(run(way, size))
    else:
        report("cell", measure(large), json_)


if __name__ == "__main__":
    command_line(app)
