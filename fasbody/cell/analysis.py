"""One modal analysis from dome or mesh to numbers with an error estimate."""

from abc import abstractmethod
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
from fasbody.cell.mesh import MeshSize
from fasbody.cell.mesher import dome_mesh
from fasbody.cell.modal import CellModel, Modes, solve
from fasbody.cell.modeshape import describe
from fasbody.presentation import Presented, Sheet, readable


@dataclass(frozen=True, repr=False)
class ModalAnalysis(Presented):
    """Modes of a cell or of another body, with errors and descriptions.

    Args:
        model: matrices, with the mesh.
        modes: frequencies and shapes.
        descriptions: one for each mode.
        errors: estimated relative error (c,) of each frequency, None without a second mesh.
        title: the body.
        remark: what is to be said of all modes, empty where that is nothing.
        unit: the length unit of figures, and its micrometres.
    """

    model: CellModel
    modes: Modes
    descriptions: tuple[Any, ...]
    errors: NDArray[np.float64] | None
    title: str
    remark: str
    unit: tuple[str, float]

    figures: ClassVar[str] = "fasbody.cell.figures"
    plots: ClassVar[tuple[str, ...]] = ("mode_shapes",)
    #: Headings of the columns beside frequency and error, and digits of a frequency.
    columns: ClassVar[tuple[str, ...]] = ("shape", "kinetic energy in the nucleus")
    digits: ClassVar[int] = 4

    @property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Natural frequencies (c,), of a free body above its rigid motions [Hz]."""
        return self.modes.frequencies_hz

    def records(self) -> list[dict[str, Any]]:
        """One row a mode."""
        modes = self.document()["modes"]
        return [{"frequency_hz": f} | m for f, m in zip(self.frequencies_hz, modes, strict=True)]

    def document(self) -> dict[str, Any]:
        """Everything but the shapes, ready for JSON."""
        numbers = zip(self.modes.participation, self.modes.residuals, strict=True)
        return {
            "dof": self.model.assembly.dof,
            "frequencies_hz": self.frequencies_hz,
            "estimated_error": self.errors,
            "modes": [
                d.document() | {"participation_xyz": moved, "residual": residual}
                for d, (moved, residual) in zip(self.descriptions, numbers, strict=True)
            ],
            "orthogonality": self.modes.orthogonality,
            "solver": self.modes.way,
        }

    def sheet(self) -> Sheet:
        """Frequency, error and description of each mode."""
        rows = []
        for i, (f, d) in enumerate(zip(self.frequencies_hz, self.descriptions, strict=True)):
            error = "" if self.errors is None else f"{100 * self.errors[i]:.2g}"
            rows.append((str(i + 1), readable(f, self.digits), error, *d.cells))
        title, notes = self.heading()
        described = self.columns[: len(self.descriptions[0].cells)]
        columns = ("mode", "frequency [Hz]", "estimated error [%]", *described)
        return Sheet(title, columns, rows, notes)

    @abstractmethod
    def heading(self) -> tuple[str, list[str]]:
        """Title of the sheet, and notes below it."""

    def __str__(self) -> str:
        return self.sheet().whole


@dataclass(frozen=True, repr=False)
class Analysis(ModalAnalysis):
    """What ``fasbody cell`` reports.

    Args:
        preset: materials and units.
        dome: the dome that was meshed, None for a user's mesh.

    Example:
        >>> analyse(*assemblies(Dome()), preset("si"), count=5).to_dataframe()
    """

    preset: Preset
    dome: Dome | None

    plots: ClassVar[tuple[str, ...]] = ("mode_shapes", "mesh_views")

    @property
    def volume_m3(self) -> float:
        """Volume at real size [m^3]: of the mesh's micrometres, whatever the preset's slip."""
        return self.model.assembly.volume_um3 * 1e-18

    def heading(self) -> tuple[str, list[str]]:
        """Cell, preset and size."""
        unknowns = f"{self.model.assembly.dof} unknowns, {self.volume_m3:.4g} m^3"
        return f"{self.title}, preset {self.preset.name}: {unknowns}", []

    def document(self) -> dict[str, Any]:
        """Everything but the shapes, ready for JSON."""
        mesh, dome = self.model.assembly.mesh, self.dome
        return super().document() | {
            "preset": self.preset.name,
            "meaning": self.preset.meaning,
            "shape_um": [dome.length, dome.width, dome.height] if dome else None,
            "profile": dome.profile if dome else None,
            "modulus_pa": self.model.materials[0].E,
            "metres_per_um": self.model.metres_per_um,
            "volume_m3": self.volume_m3,
            "mesh": {
                "elements": len(mesh.tets),
                "mean_ratio_min": mesh.quality.mean_ratio_min,
                "mean_ratio_mean": mesh.quality.mean_ratio_mean,
                "det_j_min_over_mean": mesh.quality.det_j_min,
            },
        }


def assemblies(dome: Dome, size: MeshSize | None = None, cache: Path | None = None) -> tuple[Assembly, Assembly]:
    """The assembled mesh of a dome and a coarser one for the error estimate."""
    size = size or MeshSize()
    coarse = dome_mesh(dome, size.coarser(COARSER), cache=cache)
    return assemble(dome_mesh(dome, size, cache=cache)), assemble(coarse)


def analyse(
    fine: Assembly, coarse: Assembly | None, preset: Preset, *, count: int = 10,
    way: str | None = None, dome: Dome | None = None, membrane: Membrane | None = None,
    cytoskeleton: Tensegrity | None = None,
) -> Analysis:  # fmt: skip
    """Modes, their description, and their error if there is a coarser mesh.

    Args:
        fine: of the mesh whose modes are reported.
        coarse: of another one for the error; None gives no error.
        preset: materials and units.
        count: number of modes.
        way: solver, None is the fastest.
        dome: that was meshed, None for a user's mesh.
        membrane: on its surface, if any.
        cytoskeleton: in it, if any.
    """
    model = CellModel(fine, preset.materials, preset.metres_per_um, membrane, cytoskeleton)
    modes, errors = solve(model, count, way=way), None
    if coarse is not None:
        rough = solve(replace(model, assembly=coarse), count)
        errors = richardson(rough.frequencies_hz, modes.frequencies_hz, coarse.dof, fine.dof)
    title, remark = f"{dome or 'own mesh'}, {model.materials[0].E:g} Pa", f"preset {preset.name}: {preset.meaning}"
    described = describe(model, modes)
    return Analysis(model, modes, described, errors, title, remark, ("um", 1.0), preset, dome)
