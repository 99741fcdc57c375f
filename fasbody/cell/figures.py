"""Figures 5.3 to 5.11 anew, and those of what lies beyond the thesis."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from fasbody.cell.analysis import Analysis
from fasbody.cell.meshfile import displacements
from fasbody.cell.sweep import YEAST_PA, PowerLaw, Sweep
from fasbody.console import write_whole

if TYPE_CHECKING:
    from fasbody.cell.response import BaseResponse

SWELL = 0.12  # largest drawn displacement, of the cell's length
MARKERS = "osD^v<>pPX*hdH"


def mode_shapes(analysis: Analysis, count: int = 5) -> Figure:
    """Figures 5.5 to 5.8: the first modes on the deformed surface, coloured by displacement, from two sides."""
    mesh = analysis.model.assembly.mesh
    u = displacements(analysis)[:count]
    figure = Figure(figsize=(7.2, 1.85 * len(u)), layout="constrained")
    faces = np.asarray(mesh.surface.faces)
    span = float(np.ptp(mesh.points_um[:, 0]))
    for i, mode in enumerate(u):
        moved = mesh.points_um + SWELL * span * mode
        size = np.linalg.norm(mode, axis=1)[faces].mean(axis=1)
        for column, (elevation, azimuth) in enumerate(((35, -65), (89.9, -90))):
            axes: Any = figure.add_subplot(len(u), 2, 2 * i + column + 1, projection="3d")
            _draw(axes, moved, faces, size, elevation, azimuth)
            if column == 0:
                f, d = analysis.frequencies_hz[i], analysis.descriptions[i]
                axes.set_title(f"mode {i + 1}: {_hertz(f)}, {d.label}", fontsize=9, loc="left", y=1.0)
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(cmap="viridis"), ax=figure.axes, shrink=0.5, aspect=40, location="bottom")
    bar.set_label("displacement / largest displacement", fontsize=9)
    what = f"{analysis.dome or 'own mesh'}, {analysis.model.materials[0].E:g} Pa"
    figure.suptitle(f"{what} (left: oblique, right: from above)", fontsize=10)
    return figure


def mesh_views(analysis: Analysis) -> Figure:
    """Figure 5.4: the surface mesh, and the elements behind the plane z = 0 with the nucleus in another colour."""
    mesh = analysis.model.assembly.mesh
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    behind = mesh.corners[:, :, 2].mean(axis=1) > 0
    cut = type(mesh)(mesh.points_um, mesh.tets[behind], mesh.region[behind])
    inner = type(mesh)(mesh.points_um, mesh.tets[mesh.region == 1], mesh.region[mesh.region == 1])
    panels = (("surface", mesh.surface.faces, 35, -65), ("cut at z = 0", cut.surface.faces, 12, -90))
    nucleus_nodes = np.unique(inner.tets)
    for row, (title, faces, elevation, azimuth) in enumerate(panels):
        axes: Any = figure.add_subplot(2, 1, row + 1, projection="3d")
        faces = np.asarray(faces)
        colour = np.isin(faces, nucleus_nodes).all(axis=1).astype(float)
        _draw(axes, mesh.points_um, faces, 0.35 + 0.5 * colour, elevation, azimuth, edges=True)
        axes.set_title(f"{title} ({len(mesh.tets)} tetrahedra of 10 nodes)" if row == 0 else title, fontsize=9)
    return figure


def shapes(sweep: Sweep) -> Figure:
    """Figure 5.9: frequencies over the mode number for each base shape."""
    figure, axes = _axes()
    numbers = np.arange(1, sweep.frequencies_hz.shape[1] + 1)
    for i, (a, f) in enumerate(zip(sweep.analyses, sweep.frequencies_hz, strict=True)):
        label = f"{a.dome.length:g} × {a.dome.width:g} µm" if a.dome else "own mesh"
        axes.plot(numbers, f, marker=MARKERS[i], label=label)
    axes.set(xlabel="mode number", ylabel="natural frequency [Hz]", xticks=numbers)
    axes.legend(title=f"base axes ({sweep.analyses[0].preset.name})")
    return figure


def moduli(sweep: Sweep) -> Figure:
    """Figure 5.10: frequencies over the mode number for each modulus of the cytoplasm."""
    figure, axes = _axes()
    numbers = np.arange(1, sweep.frequencies_hz.shape[1] + 1)
    for i, (a, f) in enumerate(zip(sweep.analyses, sweep.frequencies_hz, strict=True)):
        axes.semilogy(numbers, f, marker=MARKERS[i], label=f"{a.model.materials[0].E:g} Pa")
    axes.set(xlabel="mode number", ylabel="natural frequency [Hz]", xticks=numbers)
    axes.legend(title="Young's modulus", ncols=2, fontsize=8)
    return figure


def power_law(sweep: Sweep, laws: Sequence[PowerLaw], direct_hz: float) -> Figure:
    """Figure 5.11: first frequency over the modulus, both fits, and what the model itself gives at their far end."""
    figure, axes = _axes()
    E = np.array([a.model.materials[0].E for a in sweep.analyses])
    fine = np.geomspace(E.min(), YEAST_PA, 100)
    for law, style in zip(laws, ("-", "--"), strict=True):
        text = f"$f_1 = {law.a:.3g}\\,E^{{{law.b:.3f}}}$ ({law.way}): {law(YEAST_PA):.0f} Hz at {YEAST_PA / 1e6:g} MPa"
        axes.loglog(fine, law.a * fine**law.b, style, color="0.4", label=text)
    axes.loglog(E, sweep.frequencies_hz[:, 0], "o", label="model, nucleus 400 Pa")
    axes.loglog([YEAST_PA], [direct_hz], "s", color="C3", label=f"model at {YEAST_PA / 1e6:g} MPa: {direct_hz:.0f} Hz")
    axes.set(xlabel="Young's modulus of the cytoplasm [Pa]", ylabel="first natural frequency [Hz]")
    axes.legend(fontsize=8)
    return figure


def base_response(response: "BaseResponse") -> Figure:
    """Transmissibility from base to top and nucleus over the frequency of the shaking, per direction."""
    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for i, axis in enumerate("xyz"):
        upper.loglog(response.frequencies_hz, np.abs(response.top[i]), color=f"C{i}", label=f"top, {axis}")
        upper.loglog(response.frequencies_hz, np.abs(response.nucleus[i]), ":", color=f"C{i}", label=f"nucleus, {axis}")
        lower.loglog(response.frequencies_hz, response.relative_m[i], color=f"C{i}", label=axis)
    for axes in (upper, lower):
        axes.axvspan(10, 100, color="0.9", zorder=0)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, ncols=3)
    upper.set(ylabel="motion / motion of the base")
    lower.set(ylabel="top against base [m] at 1 m/s²", xlabel="frequency of the shaking [Hz] (grey: 10 to 100 Hz)")
    return figure


def save(figure: Figure, file: Path) -> Path:
    """Write a figure as PNG, whole or not at all."""
    memory = io.BytesIO()
    FigureCanvasAgg(figure).print_figure(memory, format="png", dpi=200)
    return write_whole(file, memory.getvalue())


def _axes() -> tuple[Figure, Any]:
    figure = Figure(figsize=(5.6, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.grid(alpha=0.3)
    return figure, axes


def _draw(
    axes: Any, points: np.ndarray, faces: np.ndarray, value: np.ndarray, elevation: float, azimuth: float,
    *, edges: bool = False,
) -> None:  # fmt: skip
    """Shaded triangles with x to the right, z into the picture and y up."""
    from matplotlib import colormaps

    drawn = points[:, [0, 2, 1]]  # matplotlib's third axis is the upright one
    axes.add_collection3d(
        Poly3DCollection(
            drawn[faces], facecolors=colormaps["viridis"](value), edgecolors=(0, 0, 0, 0.55 if edges else 0.12),
            linewidths=0.3 if edges else 0.12,
        )
    )  # fmt: skip
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.5)
    axes.view_init(elevation, azimuth)
    axes.set_axis_off()


def _hertz(f: float) -> str:
    return f"{f / 1e3:.3g} kHz" if f >= 1000 else f"{f:.4g} Hz"
