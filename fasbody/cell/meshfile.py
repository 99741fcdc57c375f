"""Meshes from and to files: VTU, MSH, STL and OBJ in, VTU and the browser's compact file out."""

import io
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fasbody.cell.mesh import NUCLEUS, MeshSize, TetMesh, surface_mesh
from fasbody.console import console, to_json, write_whole
from fasbody.exceptions import FasError, InputFileError, MeshError, MissingPackageError, SettingError

if TYPE_CHECKING:
    from fasbody.cell.analysis import Analysis
    from fasbody.cell.body import BodyModes

#: Micrometres that a length unit of a file may be: from a tenth of a nanometre to ten metres.
UNITS = (1e-4, 1e7)
#: Volumes between that of a bacterium and that of an egg [um^3].
CELLS_UM3 = (1.0, 1e7)
#: Shares of its volume that the nucleus of a cell has: 0.6 % in section 5.2, a third or more in small round cells.
NUCLEI = (0.002, 0.4)
#: Share of its surface beyond which a part that reaches the cell's outside is none that lies inside.
_OUTSIDE = 0.5
SUFFIXES = (".vtu", ".msh", ".stl")
#: Dimension of a group of triangles, and of one of tetrahedra; a name that both have.
SURFACE, VOLUME, AMBIGUOUS = 2, 3, -1
#: Names under which programs store region numbers.
TAGS = ("region", "gmsh:physical", "medit:ref", "gmsh:geometrical")


def read_mesh(
    file: Path, *, um_per_unit: float = 1.0, nucleus_tag: int | None = None, nucleus: Path | None = None,
    size: MeshSize | None = None,
) -> TetMesh:  # fmt: skip
    """A cell from a file, y pointing up, standing on its lowest plane.

    Args:
        file: VTU or MSH with tetrahedra of 4 or 10 nodes, or a closed STL surface, which gmsh fills.
        um_per_unit: micrometres in one length unit of the file.
        nucleus_tag: region number of the nucleus in the file's cell data `region`, `gmsh:physical` or `medit:ref`.
            None is 1 where the file has several regions, and no nucleus where it has one.
        nucleus: closed STL surface of the nucleus, for an STL cell.
        size: element sizes for an STL cell; None is two through its thickness.

    Raises:
        SettingError: the unit is invalid, or the size needs too many unknowns.
        InputFileError: the file cannot be read or is not a sound mesh.
    """
    if not UNITS[0] <= um_per_unit <= UNITS[1]:
        raise SettingError(
            f"one length unit of {file} cannot be {um_per_unit:g} um: --um-per-unit lies between {UNITS[0]:g} and "
            f"{UNITS[1]:g}, 0.001 for nm, 1 for um, 1000 for mm, 1e6 for m."
        )
    if not file.is_file():
        raise InputFileError(file, "there is no such file", "name a .vtu, .msh or .stl file")
    if file.suffix.lower() not in SUFFIXES:
        raise InputFileError(file, "is not a mesh format known here", "valid: .vtu, .msh, .stl")
    try:
        if file.suffix.lower() == ".stl":
            surfaces = [read_surface(path, um_per_unit) for path in (file, nucleus) if path is not None]
            filled = surface_mesh(surfaces[0], surfaces[1] if nucleus else None, size)
            volumes = tet_volumes(filled.points_um, filled.tets)
            if nucleus is not None:
                core = float(volumes[filled.region == NUCLEUS].sum())
                parts = {"cytoplasm": float(volumes.sum()) - core, "nucleus": core}
                console.print(f"note: {file}: {_listed(parts)}", soft_wrap=True, markup=False)
                _like_a_nucleus(file, core / float(volumes.sum()), 0.0)
            return _like_a_cell(file, filled, um_per_unit)
        tagged = read_tagged(file, um_per_unit)
        mesh = TetMesh(tagged.points_um, tagged.tets, np.zeros(len(tagged.tets), np.int64)).check()
        mesh = replace(mesh, region=_nucleus(file, mesh, tagged.tags, nucleus_tag).astype(np.int64))
        return _like_a_cell(file, mesh, um_per_unit)
    except MeshError as error:
        raise InputFileError(file, str(error).rstrip(".")) from error


def write_vtu(file: Path, analysis: "Analysis | BodyModes", tags: Sequence[int] = (0, 1), unit_um: float = 1) -> Path:
    """Write the mesh with region numbers and every mode as a point vector, largest displacement 1.

    Args:
        file: to write.
        analysis: mesh and modes.
        tags: number of each region in the file.
        unit_um: length unit of the file [um].
    """
    meshio = _meshio()
    mesh = analysis.model.assembly.mesh
    u = displacements(analysis)
    data = {f"mode_{i + 1:02d}": np.ascontiguousarray(mode) for i, mode in enumerate(u)}
    kind = "tetra10" if mesh.tets.shape[1] == 10 else "tetra"
    region = np.asarray(tags, dtype=np.int32)[mesh.region]
    content = meshio.Mesh(
        mesh.points_um / unit_um, [(kind, mesh.tets)], point_data=data, cell_data={"region": [region]}
    )
    with tempfile.TemporaryDirectory() as folder:  # meshio writes files only, and picks the format by the suffix
        part = Path(folder) / "cell.vtu"
        content.write(part)
        return write_whole(file, part.read_bytes())


def displacements(analysis: "Analysis | BodyModes") -> np.ndarray:
    """Mode shapes (c, points, 3) at the mesh's points, largest displacement 1."""
    u = analysis.model.assembly.expand(analysis.modes.vectors)[:, analysis.model.assembly.mesh_to_node]
    return np.asarray(u / np.linalg.norm(u, axis=2).max(axis=1)[:, None, None])


def upright(vectors: np.ndarray, up: int) -> np.ndarray:
    """Vectors (..., 3) with the axis `up` as y, turned and not mirrored."""
    return np.roll(vectors, 1 - up, axis=-1)


def write_browser(file: Path, analysis: "Analysis | BodyModes", inner: int | None = NUCLEUS) -> Path:
    """Write what a page needs to show the modes: a .npz of

    - `vertices_um` (v, 3) float32: corners of the outer surface and of the nucleus' surface, y up [um];
    - `faces` (f, 3) int32: triangles of the outer surface, normals outwards;
    - `nucleus_faces` (g, 3) int32: triangles of the surface of the region `inner` (none without);
    - `modes` (c, v, 3) float32: displacement at each vertex, largest over the whole cell 1;
    - `frequencies_hz` (c,) float64;
    - `document`: the JSON text of ``--json`` (labels, nucleus shares, errors, preset).
    """
    mesh = analysis.model.assembly.mesh
    outer = np.asarray(mesh.surface.faces)
    inside = mesh.region == (-1 if inner is None else inner)
    core = np.asarray(TetMesh(mesh.points_um, mesh.tets[inside], mesh.region[inside]).surface.faces).reshape(-1, 3)
    used, renumbered = np.unique(np.concatenate([outer, core]), return_inverse=True)
    faces = renumbered.reshape(-1, 3).astype(np.int32)
    memory = io.BytesIO()
    np.savez_compressed(
        memory,
        vertices_um=upright(mesh.points_um[used], mesh.up).astype(np.float32),
        faces=faces[: len(outer)],
        nucleus_faces=faces[len(outer) :],
        modes=upright(displacements(analysis)[:, used], mesh.up).astype(np.float32),
        frequencies_hz=analysis.frequencies_hz,
        document=np.array(to_json(analysis.document())),
    )
    return write_whole(file, memory.getvalue())


@dataclass(frozen=True)
class Tagged:
    """What a VTU or MSH file holds.

    Args:
        points_um: (n, 3) [um].
        tets: (m, 4) or (m, 10).
        tags: region number (m,) of each in the file.
        faces: corners (f, 3) of the triangles that the file holds, by their number.
        names: number and dimension (2 or 3) by the names that a .msh file gives to its groups. The
            dimension is `AMBIGUOUS` where triangles and tetrahedra share a name.
    """

    points_um: np.ndarray
    tets: np.ndarray
    tags: np.ndarray
    faces: dict[int, np.ndarray]
    names: dict[str, tuple[int, int]]


def read_tagged(file: Path, um_per_unit: float) -> Tagged:
    """Tetrahedra and triangles of a file with their numbers.

    Raises:
        InputFileError: it cannot be read, or has no tetrahedra of one kind.
    """
    meshio = _meshio()
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):  # meshio also prints its errors
            content = meshio.read(file)
    except FasError:
        raise
    except (Exception, SystemExit) as error:  # meshio raises whatever its parsers raise, and exits on some formats
        raise InputFileError(file, f"is not a {file.suffix[1:].upper()} file that meshio can read") from error
    name = next((name for name in TAGS if name in content.cell_data), None)

    def of(*kinds: str) -> tuple[list[np.ndarray], list[np.ndarray]]:
        blocks = [i for i, block in enumerate(content.cells) if block.type in kinds]
        cells = [content.cells[i].data.astype(np.int64) for i in blocks]
        return cells, [
            content.cell_data[name][i] if name else np.zeros(len(c)) for i, c in zip(blocks, cells, strict=True)
        ]

    blocks, tags = of("tetra", "tetra10")
    if len({block.shape[1] for block in blocks}) != 1:
        have = ", ".join(sorted({block.type for block in content.cells})) or "nothing"
        raise InputFileError(file, f"holds {have}", "tetrahedra of one kind are needed, 4 or 10 nodes each")
    tets = np.concatenate(blocks)
    used, renumbered = np.unique(tets, return_inverse=True)
    points = np.asarray(content.points[used], dtype=np.float64) * um_per_unit
    if not np.isfinite(points).all():
        raise InputFileError(file, "has points that are not finite numbers")
    number = np.full(len(content.points), -1)
    number[used] = np.arange(len(used))
    triangles, marks = of("triangle", "triangle6")
    corners = np.concatenate([np.empty((0, 3), dtype=np.int64), *(number[t[:, :3]] for t in triangles)])
    mark = np.concatenate([np.empty(0), *marks])
    faces = {int(value): corners[mark == value] for value in np.unique(mark)}
    groups = {str(name): (int(group[0]), int(group[1])) for name, group in content.field_data.items()}
    names = {name: group for name, group in groups.items() if group[1] in (SURFACE, VOLUME)}
    names |= dict.fromkeys(_shared_names(file), (0, AMBIGUOUS))
    tets = upward(points, renumbered.reshape(tets.shape))
    return Tagged(points, tets, np.concatenate(tags).astype(np.int64), faces, names)


def upward(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Tetrahedra (m, 4) or (m, 10) with the fourth corner above the other three, whichever way a file numbers them."""
    x = points[tets[:, :4]]
    below = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    turned = [1, 0, 2, 3, 4, 6, 5, 8, 7, 9][: tets.shape[1]]
    return np.where(below[:, None], tets[:, turned], tets)


def _shared_names(file: Path) -> set[str]:
    """Names that a .msh file gives to triangles and to tetrahedra: of these meshio keeps one."""
    if file.suffix.lower() != ".msh":
        return set()
    section = file.read_bytes().partition(b"$PhysicalNames")[2].partition(b"$EndPhysicalNames")[0]
    named: dict[str, set[str]] = {}
    for line in section.decode(errors="replace").splitlines():
        dimension, _, rest = line.strip().partition(" ")
        if '"' in rest:
            named.setdefault(rest.split('"')[1], set()).add(dimension)
    return {name for name, dimensions in named.items() if {f"{SURFACE}", f"{VOLUME}"} <= dimensions}


def tet_volumes(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Volume of each tetrahedron (m,) between its corners [um^3]."""
    x = points[tets[:, :4]]
    return np.asarray(np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6)


def _listed(parts: Mapping[Any, float]) -> str:
    """Parts with their volumes [um^3] and shares."""
    whole = sum(parts.values())
    return ", ".join(f"{part} ({size:.4g} um^3, {100 * size / whole:.2g} %)" for part, size in parts.items())


def _nucleus(file: Path, mesh: TetMesh, tags: np.ndarray, tag: int | None) -> np.ndarray:
    """Which tetrahedra (m,) are of the nucleus; the file's regions and their volumes are printed."""
    volumes = tet_volumes(mesh.points_um, mesh.tets)
    parts = {int(region): float(volumes[tags == region].sum()) for region in np.unique(tags)}
    have = _listed(parts)
    if tag is None and len(parts) == 1:
        console.print(f"note: {file} has one region, {have}: a cell without a nucleus", soft_wrap=True, markup=False)
        return np.zeros(len(tags), bool)
    chosen = NUCLEUS if tag is None else tag
    if chosen not in parts:
        raise InputFileError(file, f"has no region {chosen}", f"--nucleus-tag is one of its regions: {have}")
    if parts[chosen] > 0.51 * sum(parts.values()):
        raise InputFileError(
            file, f"has its nucleus in region {chosen}, which is larger than all the rest",
            f"name the region inside by --nucleus-tag: {have}",
        )  # fmt: skip
    inside = np.asarray(tags == chosen)
    outside = _outside(mesh, inside)
    if outside > _OUTSIDE:
        raise InputFileError(
            file,
            f"has its nucleus in region {chosen}, and {100 * outside:.0f} % of that region's surface is the cell's own",
            f"name the region inside by --nucleus-tag: {have}",
        )  # fmt: skip
    console.print(f"note: regions of {file}: {have}; nucleus: {chosen}", soft_wrap=True, markup=False)
    _like_a_nucleus(file, parts[chosen] / sum(parts.values()), outside)
    return inside


def _outside(mesh: TetMesh, inside: np.ndarray) -> float:
    """Share of the surface of some tetrahedra (m,) that is the surface of the whole."""
    core = TetMesh(mesh.points_um, mesh.tets[inside], mesh.region[inside]).surface
    skin = {tuple(face) for face in np.sort(mesh.surface.faces, axis=1).tolist()}
    on_skin = [tuple(face) in skin for face in np.sort(core.faces, axis=1).tolist()]
    return float(core.area_faces[on_skin].sum() / core.area)


def _like_a_nucleus(file: Path, share: float, outside: float) -> None:
    """Warn of a nucleus whose share of the cell's volume no nucleus has, or that reaches the cell's outside."""
    least, most = (100 * limit for limit in NUCLEI)
    if not least <= 100 * share <= most:
        console.print(f"warning: {file}: its nucleus is {100 * share:.2g} % of the cell's volume, and nuclei are "
                      f"{least:g} to {most:g} %; is it that part?", soft_wrap=True, markup=False)  # fmt: skip
    if outside:
        console.print(f"warning: {file}: {100 * outside:.2g} % of the nucleus' surface is the cell's own, and a "
                      "nucleus lies inside", soft_wrap=True, markup=False)  # fmt: skip


def _like_a_cell(file: Path, mesh: TetMesh, um_per_unit: float) -> TetMesh:
    """The mesh, which must have a base; with a warning where its size is that of no cell, as with a wrong unit."""
    mesh.base  # noqa: B018  raises where there is none
    volume = float(tet_volumes(mesh.points_um, mesh.tets).sum())
    if not CELLS_UM3[0] <= volume <= CELLS_UM3[1]:
        fitting = [f"{unit:g} ({name})" for unit, name in ((1e-3, "nm"), (1.0, "um"), (1e3, "mm"), (1e6, "m"))
                   if CELLS_UM3[0] <= volume * (unit / um_per_unit) ** 3 <= CELLS_UM3[1]]  # fmt: skip
        hint = f"; --um-per-unit {' or '.join(fitting)} would make it one" if fitting else ""
        console.print(f"warning: {file} has a volume of {volume:.3g} um^3, and cells have {CELLS_UM3[0]:g} to "
                      f"{CELLS_UM3[1]:g}{hint}", soft_wrap=True, markup=False)  # fmt: skip
    return mesh


def read_surface(file: Path, um_per_unit: float) -> Any:
    """A trimesh of an STL or OBJ file, its vertices merged [um].

    Raises:
        InputFileError: it cannot be read, or holds no triangles.
    """
    try:
        import trimesh
    except ImportError as error:
        raise MissingPackageError("trimesh", "cell") from error
    try:
        surface = trimesh.load_mesh(file, process=False)
        faces = len(surface.faces)
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise InputFileError(file, f"cannot be read as {file.suffix[1:].upper()} ({error})") from error
    if faces == 0:
        raise InputFileError(file, "holds no triangles")
    bad = ~np.isfinite(surface.triangles).all(axis=(1, 2))
    if bad.any():
        first = f"(the first is triangle {int(np.argmax(bad))})"
        raise InputFileError(file, f"has {int(bad.sum())} triangles with corners that are not finite numbers {first}")
    surface.merge_vertices(merge_tex=True, merge_norm=True)
    a, b, c = surface.faces.T
    surface.update_faces((a != b) & (b != c) & (c != a))
    surface.apply_scale(um_per_unit)
    return surface


def _meshio() -> Any:
    try:
        import meshio
    except ImportError as error:
        raise MissingPackageError("meshio", "cell") from error
    return meshio
