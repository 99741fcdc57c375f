"""Modes, meshes and responses of a cell or another body, as Figures 5.4 to 5.8."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fasbody.cell.mesh import NUCLEUS, TetMesh
from fasbody.cell.meshfile import displacements, upright
from fasbody.presentation import COLOURS, COLUMN, LINES, PAGE, panels, printed

if TYPE_CHECKING:
    from fasbody.cell.analysis import Analysis
    from fasbody.cell.body import BodyModes
    from fasbody.cell.viscoelastic import BaseResponse, ForceResponse

SWELL = 0.12  # largest drawn displacement, of the cell's length
#: Left and right of a picture of modes [inch].
MARGIN = 0.06
#: Heights in a picture of modes: margin and line of its head, title of a mode, foot, and at most a mode [inch].
HEAD, HEAD_LINE, TITLE, FOOT, TALLEST = 0.12, 0.17, 0.2, 0.75, 2.5
#: Colours of motion one way and the other.
PHASES = "RdBu_r"
#: Angle between faces from which their edge is drawn [rad].
SHARP = 1.2
#: Viewing directions: turn about y and tilt from the horizon [degrees].
OBLIQUE, ABOVE, FRONT = (-15.0, 40.0), (0.0, 90.0), (0.0, 8.0)


@printed
def mode_shapes(analysis: "Analysis | BodyModes", count: int | None = None) -> Figure:
    """The modes (of the cell: Figures 5.5 to 5.8), enlarged over the outline at rest.

    The colour is the motion along the axis that has most of the mode's kinetic energy, with its sign: parts of opposite
    colour move against each other.

    Args:
        analysis: modes of a cell or of another body.
        count: how many modes; None draws all.
    """
    mesh = analysis.model.assembly.mesh
    drawn = displacements(analysis)[:count]
    u = upright(drawn, mesh.up)
    points, surface = upright(mesh.points_um, mesh.up), mesh.surface
    faces = np.asarray(surface.faces)
    length = float(np.ptp(points, axis=0).max())
    per_row = 1 if len(u) <= 5 else 2
    rows = -(-len(u) // per_row)
    figure = Figure()
    grid = np.atleast_2d(figure.subplots(rows, 2 * per_row))
    for axes in grid.flat:
        axes.set_axis_off()
    hertz = _hertz(analysis.frequencies_hz[: len(u)])
    for i, mode in enumerate(u):
        d = analysis.descriptions[i]
        main = int(np.argmax(d.energy))
        along = drawn[i][:, main]
        value = 0.5 + 0.5 * np.sign(along[np.abs(along).argmax()]) * along[faces].mean(axis=1)
        place = grid[i % rows, 2 * (i // rows) :][:2]
        for axes, view in zip(place, (OBLIQUE, ABOVE), strict=True):
            _draw(axes, points + SWELL * length * mode, faces, value, view, colours=PHASES)
            _outline(axes, points, faces, view)
        text = f"mode {i + 1}: {hertz[i]}, {d.label} ({'xyz'[main]})"
        place[0].set_title(text, fontsize=7, loc="left", pad=3)
    seen = [place.flat[: len(u)] for place in (grid[:, 0::2].T, grid[:, 1::2].T)]  # both views of every mode
    ends = np.array([[(*axes.get_xlim(), *axes.get_ylim()) for axes in side] for side in seen])
    low, high = ends[:, :, 0::2].min(axis=1), ends[:, :, 1::2].max(axis=1)
    half_width, half_height = (high - low).max(axis=0) / 2  # one scale for all
    for side, (x, y) in zip((grid[:, 0::2], grid[:, 1::2]), (low + high) / 2, strict=True):
        for axes in side.flat:
            axes.set(xlim=(x - half_width, x + half_width), ylim=(y - half_height, y + half_height))
    name, um = analysis.unit
    size = f"{SWELL * length / um:.3g} {name}".replace("um", "µm")
    views = (
        "left: oblique, right: from above; lines: outline at rest; colour: motion along the axis in brackets, red "
        "against blue"
    )
    lines = [line for line in (analysis.title.replace("um", "µm"), analysis.remark, views) if line]
    width = (PAGE - 2 * MARGIN) / (2 * per_row)
    row = min(width * half_height / half_width, TALLEST)
    top = HEAD + HEAD_LINE * len(lines)
    high = top + rows * (TITLE + row) + FOOT
    figure.set_size_inches(PAGE, high)
    for k, axes in np.ndenumerate(grid):
        low_edge = high - top - (k[0] + 1) * (TITLE + row)
        axes.set_position(((MARGIN + k[1] * width) / PAGE, low_edge / high, width / PAGE, row / high))
    figure.suptitle("\n".join(lines).replace(" x ", " × "), y=1 - 0.5 * HEAD / high, va="top")
    bar = figure.colorbar(
        ScalarMappable(Normalize(-1, 1), PHASES), orientation="horizontal",
        cax=figure.add_axes((0.25, 0.45 / high, 0.5, 0.1 / high)),
    )  # fmt: skip
    bar.set_label(f"displacement along that axis / largest displacement, which is drawn as {size}")
    _scale_bar(figure, length, name, um, min(width / (2 * half_width), row / (2 * half_height)))
    return figure


@printed
def mesh_views(analysis: "Analysis") -> Figure:
    """Figure 5.4: the surface mesh, and the elements behind the plane z = 0 with the nucleus in another colour."""
    mesh = analysis.model.assembly.mesh
    figure, ((upper,), (lower,)) = panels(2, 1, PAGE, 4.2, height_ratios=(3, 2))
    _draw(upper, mesh.points_um, np.asarray(mesh.surface.faces), None, OBLIQUE, line=0.3)
    name = str(analysis.dome).replace("um", "µm") if analysis.dome else "own mesh"
    upper.set_title(f"{name}: {len(mesh.tets)} tetrahedra, quadratic displacements")
    behind = mesh.corners[:, :, 2].mean(axis=1) < float(np.mean(mesh.surface.bounds[:, 2]))
    cut = np.asarray(TetMesh(mesh.points_um, mesh.tets[behind], mesh.region[behind]).surface.faces)
    nucleus = np.isin(cut, np.unique(mesh.tets[mesh.region == NUCLEUS])).all(axis=1)
    _draw(lower, mesh.points_um, cut, np.where(nucleus, 1.0, 0.35), FRONT, line=0.3)
    lower.set_title("cut along the long axis, nucleus in yellow")
    return figure


def response(response: "BaseResponse | ForceResponse") -> Figure:
    """What a shaken base or a force does to a body."""
    from fasbody.cell.viscoelastic import BaseResponse

    return base_response(response) if isinstance(response, BaseResponse) else force_response(response)


@printed
def force_response(response: "ForceResponse") -> Figure:
    """Acceleration of the highest point per force over the frequency, per direction."""
    figure, ((axes,),) = panels(1, 1, 1.3 * COLUMN, 3.2)
    for i, axis in enumerate("xyz"):
        size = np.abs(response.accelerance[i])
        axes.loglog(response.frequencies_hz, size, color=COLOURS[i], ls=LINES[i], label=f"along {axis}")
    axes.set(xlabel="frequency [Hz]", ylabel="acceleration / force [1/kg]")
    axes.legend()
    return figure


@printed
def base_response(response: "BaseResponse") -> Figure:
    """Transmissibility from base to top and nucleus over the frequency of the shaking, per direction."""
    figure, ((upper,), (lower,)) = panels(2, 1, 1.4 * COLUMN, 4.4, sharex=True)
    for i, axis in enumerate("xyz"):
        look: dict[str, Any] = {"color": COLOURS[i], "ls": LINES[i]}
        upper.loglog(
            response.frequencies_hz, np.abs(response.top[i]), lw=1.4, label=f"top, shaken along {axis}", **look
        )
        if not np.isnan(response.nucleus).all():
            upper.loglog(response.frequencies_hz, np.abs(response.nucleus[i]), lw=0.6, label="its nucleus", **look)
        lower.loglog(response.frequencies_hz, 1e9 * np.asarray(response.relative_m[i]), lw=1.4, **look)
    for axes in (upper, lower):
        axes.axvspan(10, 100, color="0.9", lw=0, zorder=0)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=3, columnspacing=1.0)
    upper.set(ylabel="motion / motion of the base")
    lower.set(ylabel="top against base [nm] at 1 m/s²", xlabel="frequency [Hz]; grey: 10 to 100 Hz")
    return figure


def _draw(
    axes: Any, points: np.ndarray, faces: np.ndarray, value: np.ndarray | None, view: tuple[float, float],
    *, line: float = 0.0, colours: str = "viridis",
) -> None:  # fmt: skip
    """Triangles seen from far away, x to the right, y up, lit from the upper left; `value` in 0..1 colours them.

    An orthographic projection, since matplotlib's 3D axes clip a flat body and leave most of the panel empty.
    """
    right, up, toward = _screen(view)
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    light = (toward + 0.5 * up - 0.4 * right) / np.linalg.norm(toward + 0.5 * up - 0.4 * right)
    shade = 0.6 + 0.4 * np.clip(normal @ light, 0, 1)
    colour = np.tile((0.72, 0.80, 0.88, 1.0), (len(faces), 1)) if value is None else colormaps[colours](value)
    colour[:, :3] *= shade[:, None]
    seen = np.flatnonzero(normal @ toward > 0)
    order = seen[np.argsort((corners @ toward).mean(axis=1)[seen])]
    flat = np.stack([corners @ right, corners @ up], axis=-1)[order]
    edge = colour[order] if line == 0 else (0, 0, 0, 0.6)
    axes.add_collection(PolyCollection(list(flat), facecolors=colour[order], edgecolors=edge, linewidths=line or 0.2))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()


def _outline(axes: Any, points: np.ndarray, faces: np.ndarray, view: tuple[float, float]) -> None:
    """Where the surface at rest turns away from the eye, and its sharp edges on the near side."""
    import trimesh

    right, up, toward = _screen(view)
    body = trimesh.Trimesh(points, faces, process=False)
    seen = (body.face_normals @ toward > 0)[body.face_adjacency]
    drawn = (seen[:, 0] != seen[:, 1]) | ((body.face_adjacency_angles > SHARP) & seen.any(axis=1))
    ends = points[body.face_adjacency_edges[drawn]]
    flat = np.stack([ends @ right, ends @ up], axis=-1)
    axes.add_collection(LineCollection(list(flat), colors="0.1", linewidths=0.5))
    axes.autoscale_view()


def _scale_bar(figure: Figure, length: float, name: str, um: float, scale: float) -> None:
    """A bar of a round length, about a quarter of the body's, at the right end of the foot.

    Args:
        figure: to draw on.
        length: of the body [um].
        name: of the unit.
        um: its micrometres.
        scale: of the drawings [inch/um].
    """
    quarter = length / um / 4
    step = 10.0 ** np.floor(np.log10(quarter))
    bar = max(step * n for n in (1, 2, 5) if step * n <= quarter)
    right, y, long = PAGE - 0.15, 0.5, bar * um * scale
    inches = figure.dpi_scale_trans
    figure.add_artist(Line2D((right - long, right), (y, y), color="k", linewidth=1.5, transform=inches))
    label = f"{bar:g} {name}".replace("um", "µm")
    figure.text(right - long / 2, y + 0.05, label, ha="center", va="bottom", fontsize=7, transform=inches)


def _screen(view: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    turn, tilt = np.radians(view)
    right = np.array([np.cos(turn), 0, np.sin(turn)])
    toward = np.array([-np.sin(turn) * np.cos(tilt), np.sin(tilt), np.cos(turn) * np.cos(tilt)])
    return right, np.cross(toward, right), toward


def _hertz(frequencies: np.ndarray) -> list[str]:
    """Frequencies [Hz] as text, with a fourth digit where three would make two of them equal."""

    def texts(digits: int) -> list[str]:
        return [f"{f / 1e3:.{digits}g} kHz" if f >= 1000 else f"{f:.4g} Hz" for f in frequencies]

    short = texts(3)
    return short if len(set(short)) == len(short) else texts(4)
