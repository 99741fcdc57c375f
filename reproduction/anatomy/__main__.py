"""The foot's meshes, made from the shapes and written as assets: `fasbody anatomy`.

Bones carry baked colours, soft parts the weights by which they follow the segments. `files.py` writes them.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import mjcf
from fasbody.console import command_line, console, print_json, progress_bar
from fasbody.exceptions import FasError, required
from reproduction.anatomy import bones, tissue
from reproduction.anatomy.field import Array, Mesh, Shape, mesh
from reproduction.anatomy.files import write
from viz.anatomy.assets import Part, colour
from viz.anatomy.rest import SEGMENTS, TABLE

#: Edge length of each mesh [mm]; bones not named here have `FINE`.
SPACING = {"tibia": 3.2, "fibula": 2.6, "heel_pad": 2.8, "forefoot_pad": 2.8, "aponeurosis": 2.4, "skin": 4.2}
FINE, SMALL = 2.3, 1.5
#: Colours (sRGB): bone by segment, cartilage, soft parts.
BONE = ("#e8d8b4", "#e0c998", "#e9dcbd", "#e8d8b4", "#e8d8b4", "#e6d6b2")
CARTILAGE = "#b9d0da"
SOFT_COLOUR = {"heel_pad": "#f0c45c", "forefoot_pad": "#f0c45c", "aponeurosis": "#dfe4ea", "skin": "#d8a58a"}


class AnatomyError(FasError):
    """A mesh is not closed."""


def build() -> list[Part]:
    """Mesh, colour and weigh every part.

    Raises:
        AnatomyError: a mesh is not closed.
    """
    hard = bones.bones()
    shapes = {name: shape for name, (_, shape) in hard.items()}
    soft = {
        "heel_pad": tissue.heel_pad(shapes["calcaneus"]), "forefoot_pad": tissue.forefoot_pad(),
        "aponeurosis": tissue.aponeurosis(), "skin": tissue.skin(),
    }  # fmt: skip
    groups = [[shape for segment, shape in hard.values() if segment == name] for name in SEGMENTS[:-1]]
    parts = []
    with progress_bar() as progress:
        task = progress.add_task("meshing", total=len(hard) + len(soft))
        for name, (segment, shape) in hard.items():
            small = "phalanx" in name or "sesamoid" in name
            made = closed_mesh(shape, SPACING.get(name, SMALL if small else FINE), name)
            index = SEGMENTS.index(segment)
            weights = np.tile(np.eye(len(SEGMENTS))[index], (len(made.vertices), 1))
            others = [other for other_name, other in shapes.items() if other_name != name]
            parts.append(_part(name, made, _shade(made, others, BONE[index]), weights))
            progress.advance(task)
        for name, shape in soft.items():
            made = closed_mesh(shape, SPACING[name], name)
            if name == "aponeurosis":
                made = _flattened(made)
            paint = np.tile(colour(SOFT_COLOUR[name]), (len(made.vertices), 1))
            parts.append(_part(name, made, paint, _weights(name, made.vertices, groups)))
            progress.advance(task)
    return parts


def closed_mesh(shape: Shape, spacing: float, name: str) -> Mesh:
    """Mesh of a shape; where two sheets meet in one cell the surface net is not closed, so another grid is tried.

    Raises:
        AnatomyError: no grid near this spacing gives a closed mesh.
    """
    import trimesh

    for factor in 1 - 0.02 * np.arange(12):
        made = mesh(shape, factor * spacing)
        if trimesh.Trimesh(made.vertices, made.faces, process=False).is_watertight:
            return made
    raise AnatomyError(f"the mesh of {name} is not closed at any spacing near {spacing:g} mm; smooth its shape.")


def _flattened(thick: Mesh) -> Mesh:
    vertices = thick.vertices / (1, 1, tissue.FLATNESS)
    normals = thick.normals * (1, 1, tissue.FLATNESS)
    return Mesh(vertices, thick.faces, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _part(name: str, made: Mesh, paint: Array, weights: Array) -> Part:
    def turn(v: Array) -> Array:
        return v[:, [0, 2, 1]] * (1, 1, -1)

    return Part(name, 1e-3 * turn(made.vertices), made.faces, turn(made.normals), paint, weights)


def _shade(made: Mesh, others: list[Shape], tint: str) -> Array:
    """Bone colour, darker where other bones block the light, bluish where they touch."""

    def nearest(p: Array) -> Array:
        value = np.full(len(p), 30.0)
        for other in others:
            near = np.all((p > other.low - 14) & (p < other.high + 14), axis=1)
            if near.any():
                value[near] = np.minimum(value[near], other.distance(p[near]))
        return value

    steps = ((2.5, 0.3), (5.0, 0.3), (10.0, 0.4))
    shares = [w * (1 - np.clip(nearest(made.vertices + d * made.normals) / d, 0, 1)) for d, w in steps]
    blocked = np.sum(shares, axis=0)
    cartilage = 0.8 * np.exp(-((np.clip(nearest(made.vertices), 0, None) / 2.4) ** 2))[:, None]
    bone = colour(tint) * (1 - 0.38 * blocked[:, None] * np.array([0.75, 0.92, 1.0]))
    covered = colour(CARTILAGE) * (1 - 0.3 * blocked[:, None])
    return np.clip(bone + (covered - bone) * cartilage, 0, 1)


def _weights(name: str, p: Array, groups: list[list[Shape]]) -> Array:
    """How much each segment and the table move the vertices of a soft part."""
    distance = np.stack([np.min([shape.distance(p) for shape in group], 0) for group in groups], 1)
    height = p[:, 2] - TABLE
    share = np.zeros((len(p), len(SEGMENTS)))
    hind, heads = SEGMENTS.index("calcaneus_talus"), SEGMENTS.index("metatarsals")
    if name in ("heel_pad", "forefoot_pad"):  # uniform strain between the bone and the table
        bone = hind if name == "heel_pad" else heads
        depth = np.clip(distance[:, bone], 0, None)
        share[:, -1] = np.clip(depth / np.maximum(depth + height, 1e-9), 0, 1)
        share[:, bone] = 1 - share[:, -1]
    elif name == "aponeurosis":  # uniform stretch between its insertions
        t = np.clip((p[:, 0] + 62) / (98 + 62), 0, 1)
        share[:, hind], share[:, heads] = 1 - t, t
    else:
        away = np.column_stack([np.clip(distance, 0, None), height + 5])
        share = np.exp(-(away - away.min(1, keepdims=True)) / 9)
    return share / share.sum(1, keepdims=True)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    folder: Annotated[Path, typer.Option(help="folder for the assets", show_default="mjcf/assets")] = mjcf.asset(""),
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Make the meshes of the foot from their shapes, check that they are closed, and write them as assets.

    Examples:
      fasbody anatomy --folder mjcf/assets
    """
    from rich.table import Table

    with required("trimesh", "cell"):
        import trimesh
    parts = build()
    table = Table(title="Meshes of the foot")
    for heading in ("part", "segment", "triangles", "volume [cm3]"):
        table.add_column(heading, justify="left" if heading in ("part", "segment") else "right")
    rows = []
    for part in parts:
        volume = 1e6 * trimesh.Trimesh(part.vertices, part.faces, process=False).volume
        row = {"part": part.name, "segment": part.segment or "soft", "triangles": len(part.faces), "volume_cm3": volume}
        rows.append(row)
        table.add_row(part.name, str(row["segment"]), str(len(part.faces)), f"{volume:.2f}")
    console.print(table)
    written = write(parts, folder)
    for file in written:
        console.print(f"written: {file} ({file.stat().st_size / 1e3:.0f} kB)")
    if json:
        print_json({"parts": rows, "files": [str(file) for file in written]})


if __name__ == "__main__":
    command_line(app)
