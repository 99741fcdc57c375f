"""Mode shapes of an adherent bone cell: `python examples/cell_modes.py [FIGURE.png]`.

Half an ellipsoid of 100 x 40 um with a nucleus, clamped at its base, at its real size and with the density of water.
Needs `pip install 'fasbody[cell]'`. The mesh is coarse; the printed errors say how coarse.
"""

import sys
from pathlib import Path

from fasbody.cell.analysis import Analysis, analyse, assemblies
from fasbody.cell.dome import Dome
from fasbody.cell.materials import preset
from fasbody.cell.mesh import MeshSize
from fasbody.presentation import write_figure


def main(picture: Path = Path("cell_modes.png"), size_um: float = 6.0) -> Analysis:
    """Mesh, solve, draw the first five modes; return the analysis."""
    si = preset("si")
    dome = Dome(height=si.height_um)
    analysis = analyse(*assemblies(dome, MeshSize.of(size_um)), si, count=5, dome=dome)
    write_figure(analysis.plot("mode_shapes"), picture)
    return analysis


if __name__ == "__main__":
    print(main(*map(Path, sys.argv[1:2])))
