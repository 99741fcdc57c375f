"""Bodies whose frequencies are known without finite elements, and how fast the cell's own converge."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from fasbody.cell.analysis import assemblies
from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.dome import Dome
from fasbody.cell.materials import Material, Preset
from fasbody.cell.mesh import MeshSize
from fasbody.cell.mesher import ball_mesh, dome_mesh
from fasbody.cell.modal import CellModel, solve
from simulator.bodies import box, lamb_spheroidal, lamb_torsional, timoshenko


@dataclass(frozen=True)
class Check:
    """A computed number beside the one it must be.

    Args:
        name: what is compared.
        computed, reference: the two numbers.
        dof: unknowns of the computation.
        allowed: largest relative difference that passes.
    """

    name: str
    computed: float
    reference: float
    dof: int
    allowed: float

    @property
    def error(self) -> float:
        """Relative difference."""
        return abs(self.computed / self.reference - 1)

    @property
    def passed(self) -> bool:
        """The difference is no larger than allowed."""
        return self.error <= self.allowed

    def document(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {key: getattr(self, key) for key in (*self.__dataclass_fields__, "error", "passed")}

    def __str__(self) -> str:
        return (
            f"{'ok  ' if self.passed else 'FAIL'} {self.name}: {self.computed:.6g}, reference {self.reference:.6g}, "
            f"error {self.error:.1e} (allowed {self.allowed:.0e}, {self.dof} unknowns)"
        )


def check_sphere(size: float = 0.3, nu: float = 0.37) -> list[Check]:
    """A free ball: six rigid-body modes, then five torsional and five spheroidal modes of degree 2."""
    model = CellModel(assemble(ball_mesh(1.0, size), held=FREE), (Material(1.0, nu, 1.0),) * 2, 1.0)
    c_s = np.sqrt(1 / (2 * (1 + nu)))
    f_t, f_s = (x * c_s / (2 * np.pi) for x in (lamb_torsional(2), lamb_spheroidal(2, nu)))
    modes = solve(model, 10)
    f, dof = modes.frequencies_hz, model.assembly.dof
    lowest = 1 + modes.rigid_hz.max() / f[0]
    return [
        Check("free sphere, torsional modes of degree 2, mean of 5 [Hz]", f[:5].mean(), f_t, dof, 1e-3),
        Check(
            "free sphere, spheroidal modes of degree 2, mean of 5 [Hz]",
            f[5:].mean(),
            f_s,
            dof,
            1e-3,
        ),
        Check("free sphere, 1 + largest rigid-body frequency / first elastic", lowest, 1.0, dof, 1e-4),
    ]


def check_beams(length: float = 10.0, parts: int = 20) -> list[Check]:
    """A square beam, nu = 0, clamped at its foot and free, against Timoshenko's theory; its axial mode is c / 4 l."""
    across = np.linspace(-0.5, 0.5, 3)
    mesh = box(across, np.linspace(0, length, parts + 1), across)
    E, rho, checks = 100.0, 1000.0, []
    for name, held in (("clamped", None), ("free", FREE)):
        model = CellModel(assemble(mesh, held=held), (Material(E, 0.0, rho),) * 2)
        modes = solve(model, 8)
        f, dof = modes.frequencies_hz, model.assembly.dof
        reference = timoshenko(E, rho, length * 1e-6, 1e-6, held=held is None)
        what = f"{name} square beam, length {length:g} sides, first bending pair [Hz]"
        checks.append(Check(what, f[:2].mean(), reference, dof, 1e-3))
        along = np.einsum("ij,ij->j", modes.vectors[1::3], (model.M @ modes.vectors)[1::3])
        axial = float(f[np.flatnonzero(along > 0.99)[0]])
        quarter = np.sqrt(E / rho) / (length * 1e-6) / (4 if held is None else 2)
        checks.append(Check(f"{name} square beam, first axial mode [Hz]", axial, quarter, dof, 1e-4))
    return checks


#: omega a^2 sqrt(rho h / D) of thin square plates with nu = 0.3, all edges free and one edge clamped: by the method of
#: Ritz with Legendre's polynomials (test_cell_verification.py), as Leissa tables them (NASA SP-160, 1969).
FREE_PLATE, CANTILEVER_PLATE = (13.468, 19.596, 24.270), (3.471, 8.507, 21.285, 27.199, 30.956)


def check_plates(thickness: float = 0.02, parts: int = 14) -> list[Check]:
    """A square plate of side 1, free and clamped at one edge, against the theory of thin plates."""
    E, nu, rho, side = 1e9, 0.3, 1000.0, np.linspace(0, 1e6, parts + 1)
    mesh = box(side, side, np.array([0, thickness * 1e6]), up=0)
    unit = np.sqrt(E * thickness**2 / (12 * (1 - nu**2) * rho)) / (2 * np.pi)
    checks = []
    for name, held, known in (("free", FREE, FREE_PLATE), ("cantilever", None, CANTILEVER_PLATE)):
        model = CellModel(assemble(mesh, held=held), (Material(E, nu, rho),) * 2)
        f = solve(model, len(known)).frequencies_hz
        for i, (computed, value) in enumerate(zip(f, known, strict=True), start=1):
            what = f"{name} square plate, thickness {thickness:g} sides, mode {i} [Hz]"
            checks.append(Check(what, float(computed), value * unit, model.assembly.dof, 2e-2))
    return checks


def check_scaling(preset: Preset, dome: Dome, size: MeshSize, cache: Path | None = None) -> list[Check]:
    """Scaling f ~ 1 / L, sqrt(E), 1 / sqrt(rho): exact on any mesh, so any slip of units in the code would show."""
    assembly = assemblies(dome, size, cache)[1]

    def first(E: float, rho: float, length: float) -> float:
        cytoplasm, nucleus = (replace(m, E=m.E * E, rho=m.rho * rho) for m in preset.materials)
        model = CellModel(assembly, (cytoplasm, nucleus), preset.metres_per_um * length)
        return float(solve(model, 1).frequencies_hz[0])

    f = first(1, 1, 1)
    cases = (
        ("1 / L", first(1, 1, 1e-3), 1e3),
        ("sqrt(E)", first(16, 1, 1), 4.0),
        ("1 / sqrt(rho)", first(1, 4, 1), 0.5),
    )
    return [Check(f"f1 ~ {law}, ratio", value / f, expected, assembly.dof, 1e-9) for law, value, expected in cases]


@dataclass(frozen=True)
class Convergence:
    """Frequencies on ever finer meshes, and the f_inf + C h^p that fits them with one order p for all modes.

    Args:
        sizes_um: element sizes h (n,), falling [um]; nucleus and rim are refined in proportion.
        dof: unknowns (n,), rising.
        frequencies_hz: frequencies (n, c) [Hz].
        order: observed order p.
        limit_hz: Richardson's limit f_inf (c,) [Hz].
    """

    sizes_um: NDArray[np.float64]
    dof: NDArray[np.int64]
    frequencies_hz: NDArray[np.float64]
    order: float
    limit_hz: NDArray[np.float64]

    @classmethod
    def fit(
        cls,
        sizes_um: NDArray[np.float64],
        dof: NDArray[np.int64],
        frequencies_hz: NDArray[np.float64],
    ) -> "Convergence":
        """Observe order and limit [Hz] on three meshes or more, by least squares in relative frequency."""
        relative = frequencies_hz / frequencies_hz[-1]

        def fitted(p: float) -> tuple[NDArray[np.float64], float]:
            columns = np.stack([np.ones(len(dof)), (sizes_um / sizes_um[-1]) ** p], axis=1)
            solution, *_ = np.linalg.lstsq(columns, relative, rcond=None)
            return solution[0] * frequencies_hz[-1], float(((columns @ solution - relative) ** 2).sum())

        best = minimize_scalar(lambda p: fitted(p)[1], bounds=(0.2, 8.0), method="bounded")
        return cls(sizes_um, dof, frequencies_hz, float(best.x), fitted(best.x)[0])

    @property
    def change(self) -> NDArray[np.float64]:
        """Relative change (n - 1, c) from each mesh to the next finer one."""
        return np.asarray(np.abs(self.frequencies_hz[:-1] / self.frequencies_hz[1:] - 1))

    @property
    def errors(self) -> NDArray[np.float64]:
        """Relative error (n, c) against the limit."""
        return np.asarray(np.abs(self.frequencies_hz / self.limit_hz - 1))

    def document(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {key: getattr(self, key) for key in (*self.__dataclass_fields__, "change", "errors")}

    def __str__(self) -> str:
        rows = [
            f"  {n} unknowns: f1 {f[0]:.6g} Hz, largest error of f1..f{len(f)} {e.max():.2%} against the limit"
            for n, f, e in zip(self.dof, self.frequencies_hz, self.errors, strict=True)
        ]
        rows += [
            f"  from {a} to {b} unknowns f1..f{len(self.limit_hz)} change by at most {c.max():.2%}"
            for a, b, c in zip(self.dof, self.dof[1:], self.change, strict=False)
        ]
        return "\n".join([f"mesh convergence: observed order {self.order:.1f}", *rows])


def convergence(
    preset: Preset, dome: Dome, sizes: tuple[float, ...] = (4.4, 3.2, 2.3), count: int = 10,
    cache: Path | None = None, advance: Callable[[], object] = lambda: None,
) -> Convergence:  # fmt: skip
    """Solve on several meshes; about 12,000, 25,000 and 60,000 unknowns on the 100 x 40 um dome."""
    dof, rows = [], []
    for size in sizes:
        assembly = assemble(dome_mesh(dome, MeshSize.of(size), cache=cache))
        dof.append(assembly.dof)
        rows.append(solve(CellModel(assembly, preset.materials, preset.metres_per_um), count).frequencies_hz)
        advance()
    return Convergence.fit(np.array(sizes), np.array(dof), np.array(rows))
