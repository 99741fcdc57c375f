"""One modal analysis from dome or mesh to numbers with an error estimate."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from fasbody.cell.assembly import Assembly, assemble
from fasbody.cell.companion import COARSER, richardson
from fasbody.cell.cytoskeleton import Tensegrity
from fasbody.cell.dome import Dome
from fasbody.cell.materials import Preset
from fasbody.cell.membrane import Membrane
from fasbody.cell.mesh import MeshSize, dome_mesh
from fasbody.cell.modal import CellModel, Modes, solve
from fasbody.cell.modeshape import ModeDescription, describe
from fasbody.presentation import Presented, Sheet


@dataclass(frozen=True, repr=False)
class Analysis(Presented):
    """What ``python -m fasbody.cell`` reports.

    Args:
        preset: materials and units.
        model: matrices, with the mesh.
        modes: frequencies and shapes.
        descriptions: one for each mode.
        errors: estimated relative error (c,) of each frequency by Richardson extrapolation from a coarser mesh; None
            for a user's mesh, which has no coarser companion.
        dome: the dome that was meshed, None for a user's mesh.
    """

    preset: Preset
    model: CellModel
    modes: Modes
    descriptions: tuple[ModeDescription, ...]
    errors: NDArray[np.float64] | None
    dome: Dome | None

    figures: ClassVar[str] = "fasbody.cell.figures"
    plots: ClassVar[tuple[str, ...]] = ("mode_shapes", "mesh_views")

    @property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Natural frequencies (c,) [Hz]."""
        return self.modes.frequencies_hz

    @property
    def title(self) -> str:
        """The cell and its modulus."""
        return f"{self.dome or 'own mesh'}, {self.model.materials[0].E:g} Pa"

    @property
    def remark(self) -> str:
        """The preset and what it means."""
        return f"preset {self.preset.name}: {self.preset.meaning}"

    @property
    def unit(self) -> tuple[str, float]:
        """The length unit of figures, and its micrometres."""
        return "um", 1.0

    @property
    def volume_m3(self) -> float:
        """Volume at real size [m^3]: a micrometre of the mesh is a micrometre, whatever the preset's slip."""
        return self.model.assembly.volume_um3 * 1e-18

    def sheet(self) -> Sheet:
        """Frequency and shape of each mode."""
        rows = [
            (str(i + 1), f"{f:.4g}", "" if self.errors is None else f"{100 * self.errors[i]:.2g}", d.label)
            for i, (f, d) in enumerate(zip(self.frequencies_hz, self.descriptions, strict=True))
        ]
        columns = ("mode", "frequency [Hz]", "estimated error [%]", "shape")
        return Sheet(f"{self.preset.name}: {self.model.assembly.dof} degrees of freedom", columns, rows)

    def records(self) -> list[dict[str, Any]]:
        """One row a mode."""
        modes = self.document()["modes"]
        return [{"frequency_hz": f, **mode} for f, mode in zip(self.frequencies_hz, modes, strict=True)]

    def document(self) -> dict[str, Any]:
        """Everything but the shapes, ready for JSON."""
        return {
            "preset": self.preset.name,
            "meaning": self.preset.meaning,
            "shape_um": [self.dome.length, self.dome.width, self.dome.height] if self.dome else None,
            "profile": self.dome.profile if self.dome else None,
            "modulus_pa": self.model.materials[0].E,
            "metres_per_um": self.model.metres_per_um,
            "dof": self.model.assembly.dof,
            "volume_m3": self.volume_m3,
            "frequencies_hz": self.frequencies_hz,
            "estimated_error": self.errors,
            "modes": [
                {
                    "label": d.label,
                    "nucleus_share": d.nucleus_share,
                    "nucleus_strain_share": d.nucleus_strain_share,
                    "energy_xyz": d.energy,
                    "participation_xyz": p,
                    "residual": r,
                }
                for d, p, r in zip(self.descriptions, self.modes.participation, self.modes.residuals, strict=True)
            ],
            "orthogonality": self.modes.orthogonality,
            "solver": self.modes.way,
            "mesh": {
                "elements": len(self.model.assembly.mesh.tets),
                "mean_ratio_min": self.model.assembly.mesh.quality.mean_ratio_min,
                "mean_ratio_mean": self.model.assembly.mesh.quality.mean_ratio_mean,
                "det_j_min_over_mean": self.model.assembly.mesh.quality.det_j_min,
            },
        }

    def __str__(self) -> str:
        head = f"{self.title}, preset {self.preset.name}: "
        lines = [f"{head}{self.model.assembly.dof} unknowns, {self.volume_m3:.4g} m^3"]
        for i, (f, d) in enumerate(zip(self.frequencies_hz, self.descriptions, strict=True)):
            error = "" if self.errors is None else f" +-{self.errors[i]:.2%}"
            lines.append(f"  mode {i + 1:2d}  {f:10.4g} Hz{error}  {d}")
        return "\n".join(lines)


def assemblies(dome: Dome, size: MeshSize | None = None, cache: Path | None = None) -> tuple[Assembly, Assembly]:
    """The assembled mesh of a dome and its coarser companion, which serves the error estimate."""
    size = size or MeshSize()
    return (
        assemble(dome_mesh(dome, size, cache=cache)),
        assemble(dome_mesh(dome, size.coarser(COARSER), cache=cache)),
    )


def analyse(
    fine: Assembly, coarse: Assembly | None, preset: Preset, *, count: int = 10, way: str | None = None,
    dome: Dome | None = None, membrane: Membrane | None = None, cytoskeleton: Tensegrity | None = None,
) -> Analysis:  # fmt: skip
    """Modes, their description, and their error if there is a coarser mesh."""
    model = CellModel(fine, preset.materials, preset.metres_per_um, membrane, cytoskeleton)
    modes = solve(model, count, way=way)
    errors = None
    if coarse is not None:
        rough = solve(replace(model, assembly=coarse), count)
        errors = richardson(rough.frequencies_hz, modes.frequencies_hz, coarse.dof, fine.dof)
    return Analysis(preset, model, modes, describe(model, modes), errors, dome)
