"""Ten modes of the cell beside plain scipy on the same matrices, and a large cell: time and memory of each.

    OMP_NUM_THREADS=1 python -m benchmarks.cell            about 25,000 unknowns, a minute
    OMP_NUM_THREADS=1 python -m benchmarks.cell --large    and about 250,000 unknowns, several minutes

Every row runs in a process of its own, so that its peak memory is its own; times are CPU seconds, which other
work on the machine hardly disturbs.
"""

import argparse
import resource
import subprocess
import sys
import time
from importlib.util import find_spec

import numpy as np
import scipy.sparse.linalg as spla

from fasbody.cell.assembly import assemble
from fasbody.cell.dome import Dome
from fasbody.cell.materials import preset
from fasbody.cell.mesh import MeshSize, dome_mesh
from fasbody.cell.modal import CellModel, solve

SIZE, LARGE = 3.2, 1.4


def run(way: str, size: float) -> None:
    """Mesh from the cache, assemble, solve ten modes; print one row."""
    chosen = preset("si")
    mesh = dome_mesh(Dome(), MeshSize.of(size))
    start = time.process_time()
    model = CellModel(assemble(mesh), chosen.materials, chosen.metres_per_um)
    K, M = model.K, model.M
    assembled = time.process_time()
    if way == "plain scipy":
        squares = spla.eigsh(K.tocsc(), 10, M.tocsc(), sigma=0, return_eigenvectors=True)[0]
        f = np.sqrt(np.sort(squares)) / (2 * np.pi)
    elif way == "assembly only":
        f = np.full(10, np.nan)
    else:
        f = solve(model, 10, way=way).frequencies_hz
    done = time.process_time()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"| {way} | {model.assembly.dof} | {assembled - start:.1f} | {done - assembled:.1f} | {memory:.2f} "
        f"| {f[0]:.3f} | {f[9]:.3f} |",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--large", action="store_true", help="about 250,000 unknowns, too")
    parser.add_argument("--row", nargs=2, metavar=("WAY", "SIZE"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.row:
        run(options.row[0], float(options.row[1]))
        return
    installed = ["pardiso"] if find_spec("pypardiso") else []
    rows = [(way, SIZE) for way in ("assembly only", "plain scipy", "superlu", "multigrid", *installed)]
    if options.large:
        rows += [(way, LARGE) for way in ("multigrid", *installed)]
    for size in sorted({size for _, size in rows}):
        dome_mesh(Dome(), MeshSize.of(size))  # meshing is not what is measured
    print("| way | unknowns | assembly [CPU s] | solution [CPU s] | peak memory [GiB] | f1 [Hz] | f10 [Hz] |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for way, size in rows:
        subprocess.run([sys.executable, "-m", "benchmarks.cell", "--row", way, str(size)], check=True)


if __name__ == "__main__":
    main()
