"""Meshes from and to files: VTU, MSH, STL and OBJ in, VTU and the browser's compact file out."""

import io
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fasbody.cell.mesh import NUCLEUS, MeshSize, TetMesh
from fasbody.cell.mesher import sized_mesh
from fasbody.console import console, to_json, write_whole
from fasbody.exceptions import InputFileError, MeshError, SettingError, required
from fasbody.presentation import counted

if TYPE_CHECKING:
    from fasbody.cell.analysis import ModalAnalysis

#: Micrometres that a length unit of a file may be: from a tenth of a nanometre to ten metres.
UNITS = (1e-4, 1e7)
#: Volumes between that of a bacterium and that of an egg [um^3].
CELLS_UM3 = (1.0, 1e7)
#: Shares of its volume that a cell's nucleus has: 0.6 % in section 5.2, a third in small round ones.
NUCLEI = (0.002, 0.4)
#: Share of its surface beyond which a part that reaches the cell's outside lies not inside.
_OUTSIDE = 0.5
#: What a file's groups consist of, by the dimension that gmsh writes.
TRIANGLES, TETRAHEDRA = "triangles", "tetrahedra"
_KINDS = {"2": TRIANGLES, "3": TETRAHEDRA}
#: Names under which programs store region numbers.
_TAGS = ("region", "gmsh:physical", "medit:ref", "gmsh:geometrical")


@dataclass(frozen=True)
class Group:
    """Triangles or tetrahedra of a file under one number.

    Args:
        number: in the file; the same number may stand for a group of either kind.
        name: of a .msh file, empty without.
        kind: `TRIANGLES` or `TETRAHEDRA`.
    """

    number: int
    name: str = ""
    kind: str = TETRAHEDRA

    @property
    def labels(self) -> set[str]:
        """What it may be called: number or name, alone or after its kind and a colon."""
        labels = {str(self.number), f"{self.kind}:{self.number}"}
        if self.name:
            labels.add(self.name)
        if self.name and not self.name.isdigit():  # behind a kind, digits are a number
            labels.add(f"{self.kind}:{self.name}")
        return labels

    def __str__(self) -> str:
        return f"{self.kind} {self.number}" + (f" ({self.name})" if self.name else "")


@contextmanager
def naming(file: Path | str) -> Iterator[None]:
    """What is wrong with a mesh becomes an error of its file."""
    try:
        yield
    except MeshError as error:
        raise InputFileError(Path(file), str(error).rstrip(".")) from error


def mesh_format(file: Path, valid: Sequence[str], otherwise: str) -> str:
    """The ending of a mesh file that exists.

    Raises:
        InputFileError: it does not, is a folder, or has another ending than those that are valid.
    """
    if file.is_dir():
        inside = sorted(one for one in file.iterdir() if one.suffix.lower() in valid)
        hint = f"such as {inside[0]}" if inside else f"it holds none that ends in {', '.join(valid)}"
        raise InputFileError(file, "is a folder", f"name a file, {hint}" if inside else hint)
    if not file.is_file():
        raise InputFileError(file, "there is no such file", otherwise)
    if (suffix := file.suffix.lower()) not in valid:
        raise InputFileError(file, "is not a mesh format known here", f"valid: {', '.join(valid)}")
    return suffix


def read_mesh(
    file: Path, *, um_per_unit: float = 1.0, nucleus_tag: int | None = None,
    nucleus: Path | None = None, size: MeshSize | None = None,
) -> TetMesh:  # fmt: skip
    """A cell from a file, y pointing up, standing on its lowest plane.

    Args:
        file: VTU or MSH with tetrahedra of 4 or 10 nodes, or a closed STL surface to be filled.
        um_per_unit: micrometres in one length unit of the file.
        nucleus_tag: region number of the nucleus in the file's cell data `region`,
            `gmsh:physical` or `medit:ref`. None is 1 where the file has several regions, and no
            nucleus where it has one.
        nucleus: closed STL surface of the nucleus, for an STL cell.
        size: element sizes for an STL cell; None is two through its thickness.

    Raises:
        SettingError: the unit is invalid, or the size needs too many unknowns.
        InputFileError: the file cannot be read or is not a sound mesh.
    """
    if not UNITS[0] <= um_per_unit <= UNITS[1]:
        raise SettingError(
            f"one length unit of {file} cannot be {um_per_unit:g} um: it lies between "
            f"{UNITS[0]:g} and {UNITS[1]:g}, 0.001 for nm, 1 for um, 1000 for mm, 1e6 for m.",
            "um_per_unit",
        )
    suffix = mesh_format(file, (".vtu", ".msh", ".stl"), "name a .vtu, .msh or .stl file")
    with naming(file):
        if suffix == ".stl":
            inner = None if nucleus is None else read_surface(nucleus, um_per_unit)
            mesh = sized_mesh(read_surface(file, um_per_unit), inner, size)[0]
            tags = np.where(mesh.region == NUCLEUS, "nucleus", "cytoplasm")
            inside = np.asarray(mesh.region == NUCLEUS)
            if inside.any():
                _say(f"note: {file}: {_listed(_parts(mesh, tags))}")
        else:
            mesh, groups = read_tetrahedra(file, um_per_unit)
            mesh = mesh.check()
            numbers = [group.number for group in groups if group.kind == TETRAHEDRA]
            inside = _nucleus(file, mesh, np.array(numbers)[mesh.region], nucleus_tag)
            mesh = replace(mesh, region=inside.astype(np.int64), faces={})
        if inside.any():
            _like_a_nucleus(file, mesh, inside)
        return _like_a_cell(file, mesh, um_per_unit)


def read_tetrahedra(file: Path, um_per_unit: float) -> tuple[TetMesh, tuple[Group, ...]]:
    """Tetrahedra of a VTU or MSH file, its marked triangles, and the groups of both.

    The regions of the mesh are numbered in the order of the groups of tetrahedra.

    Raises:
        InputFileError: it cannot be read, or has no tetrahedra of one kind.
    """
    meshio = _meshio()
    try:  # meshio raises whatever its parsers raise, exits on some formats, and prints its errors
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            content = meshio.read(file)
    except (Exception, SystemExit) as error:
        text = f"is not a {file.suffix[1:].upper()} file that meshio can read"
        raise InputFileError(file, text) from error
    tags = content.cell_data.get(next((name for name in _TAGS if name in content.cell_data), ""))
    cells: dict[str, list[Any]] = {TRIANGLES: [], TETRAHEDRA: []}
    numbers: dict[str, list[Any]] = {TRIANGLES: [np.empty(0)], TETRAHEDRA: []}
    kinds = {"triangle": TRIANGLES, "tetra": TETRAHEDRA}
    for i, block in enumerate(content.cells):
        if kind := kinds.get(block.type.removesuffix("6").removesuffix("10")):
            cells[kind].append(block.data.astype(np.int64))
            numbers[kind].append(np.zeros(len(block.data)) if tags is None else tags[i])
    if len({block.shape[1] for block in cells[TETRAHEDRA]}) != 1:
        have = ", ".join(sorted({block.type for block in content.cells})) or "nothing"
        valid = "tetrahedra of one kind are needed, 4 or 10 nodes each"
        raise InputFileError(file, f"holds {have}", valid)
    tets = np.concatenate(cells[TETRAHEDRA])
    used, renumbered = np.unique(tets, return_inverse=True)
    points = np.asarray(content.points[used], dtype=np.float64) * um_per_unit
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        problem = f"has {counted(bad.size, 'point')} whose coordinates are not finite numbers"
        raise InputFileError(file, f"{problem} (the first is number {used[bad[0]]} from 0)", "correct or remesh it")
    number = np.full(len(content.points), -1)
    number[used] = np.arange(len(used))
    corners = np.concatenate([np.empty((0, 3), dtype=np.int64), *(number[cell[:, :3]] for cell in cells[TRIANGLES])])
    mark = np.concatenate(numbers[TRIANGLES]).astype(np.int64)
    faces = {int(value): corners[mark == value] for value in np.unique(mark)}
    regions, region = np.unique(np.concatenate(numbers[TETRAHEDRA]).astype(np.int64), return_inverse=True)
    names = _names(file)
    groups = [Group(value, names.get((TRIANGLES, value), ""), TRIANGLES) for value in faces]
    groups += [Group(value, names.get((TETRAHEDRA, value), "")) for value in regions.tolist()]
    tets = upward(points, renumbered.reshape(tets.shape))
    return TetMesh(points, tets, region.astype(np.int64), faces=faces), tuple(groups)


def upward(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Tetrahedra (m, 4) or (m, 10), the fourth corner above the others however it was numbered."""
    x = points[tets[:, :4]]
    below = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    turned = [1, 0, 2, 3, 4, 6, 5, 8, 7, 9][: tets.shape[1]]
    return np.where(below[:, None], tets[:, turned], tets)


def _names(file: Path) -> dict[tuple[str, int], str]:
    """Names of a .msh file's groups by kind and number; meshio keeps one of those that share one."""
    if file.suffix.lower() != ".msh":
        return {}
    section = file.read_bytes().partition(b"$PhysicalNames")[2].partition(b"$EndPhysicalNames")[0]
    names = {}
    for line in section.decode(errors="replace").splitlines():
        place, _, rest = line.partition('"')
        dimension, _, number = place.strip().partition(" ")
        if dimension in _KINDS and number.strip().isdigit():
            names[_KINDS[dimension], int(number)] = rest.rpartition('"')[0]
    return names


def read_surface(file: Path, um_per_unit: float) -> Any:
    """A trimesh of an STL or OBJ file, its vertices merged [um].

    Raises:
        InputFileError: it cannot be read, or holds no triangles.
    """
    with required("trimesh", "cell"):
        import trimesh
    try:
        surface = trimesh.load_mesh(file, process=False)
        faces = len(surface.faces)
    except Exception as error:  # trimesh raises whatever its parsers raise
        text = f"cannot be read as {file.suffix[1:].upper()} ({error})"
        raise InputFileError(file, text) from error
    if faces == 0:
        raise InputFileError(file, _no_triangles(file), "export it again as STL or OBJ")
    bad = np.flatnonzero(~np.isfinite(surface.triangles).all(axis=(1, 2)))
    if bad.size:
        text = f"has {counted(bad.size, 'triangle')} with corners that are not finite numbers"
        raise InputFileError(file, f"{text} (the first is triangle {bad[0]})")
    surface.merge_vertices(merge_tex=True, merge_norm=True)
    a, b, c = surface.faces.T
    surface.update_faces((a != b) & (b != c) & (c != a))
    surface.apply_scale(um_per_unit)
    return surface


def _no_triangles(file: Path) -> str:
    """What a file is from which no triangle was read, as a clause."""
    data = file.read_bytes()
    if file.suffix.lower() != ".stl" or not data.strip():
        return "holds no triangles"
    if data.isascii() and b"\0" not in data:
        return "is text that holds no whole triangle" if data.lstrip().startswith(b"solid") else "is text, but no STL"
    whole = 84 + 50 * int.from_bytes(data[80:84], "little")  # header, count, triangles
    cut = f"is cut off: {len(data)} bytes, where its {(whole - 84) // 50} triangles need {whole}"
    return cut if len(data) < whole else "holds no triangles"


def write_vtu(file: Path, analysis: "ModalAnalysis", tags: Sequence[int] = (0, 1), unit_um: float = 1) -> Path:
    """Write the mesh with region numbers and every mode as a point vector, largest motion 1.

    Args:
        file: to write.
        analysis: mesh and modes.
        tags: number of each region in the file.
        unit_um: length unit of the file [um].
    """
    mesh = analysis.model.assembly.mesh
    content = _meshio().Mesh(
        mesh.points_um / unit_um,
        [("tetra10" if mesh.tets.shape[1] == 10 else "tetra", mesh.tets)],
        point_data={f"mode_{i:02d}": np.ascontiguousarray(mode)
                    for i, mode in enumerate(displacements(analysis), start=1)},
        cell_data={"region": [np.asarray(tags, dtype=np.int32)[mesh.region]]},
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:  # meshio takes a file's name, not its content
        part = Path(folder) / "cell.vtu"
        content.write(part)
        return write_whole(file, part.read_bytes())


def displacements(analysis: "ModalAnalysis") -> np.ndarray:
    """Mode shapes (c, points, 3) at the mesh's points, largest displacement 1."""
    assembly = analysis.model.assembly
    u = assembly.expand(analysis.modes.vectors)[:, assembly.mesh_to_node]
    return np.asarray(u / np.linalg.norm(u, axis=2).max(axis=1)[:, None, None])


def upright(vectors: np.ndarray, up: int) -> np.ndarray:
    """Vectors (..., 3) with the axis `up` as y, turned and not mirrored."""
    return np.roll(vectors, 1 - up, axis=-1)


def write_browser(file: Path, analysis: "ModalAnalysis", inner: int | None = NUCLEUS) -> Path:
    """Write what a page needs to show the modes: a .npz of

    - `vertices_um` (v, 3) float32: corners of the outer and the nucleus' surface, y up [um];
    - `faces` (f, 3) int32: triangles of the outer surface, normals outwards;
    - `nucleus_faces` (g, 3) int32: triangles of the surface of the region `inner`;
    - `modes` (c, v, 3) float32: displacement at each vertex, largest over the whole cell 1;
    - `frequencies_hz` (c,) float64;
    - `document`: the JSON text of ``--json`` (labels, nucleus shares, errors, preset).
    """
    mesh = analysis.model.assembly.mesh
    outer = np.asarray(mesh.surface.faces)
    core = np.asarray(mesh.part(mesh.region == (-1 if inner is None else inner)).surface.faces)
    used, renumbered = np.unique(np.vstack([outer, core.reshape(-1, 3)]), return_inverse=True)
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


def _parts(mesh: TetMesh, tags: np.ndarray) -> dict[Any, float]:
    return {tag.item(): float(mesh.volumes[tags == tag].sum()) for tag in np.unique(tags)}


def _listed(parts: dict[Any, float]) -> str:
    whole = sum(parts.values())
    return ", ".join(f"{part} ({v:.4g} um^3, {100 * v / whole:.2g} %)" for part, v in parts.items())


def _nucleus(file: Path, mesh: TetMesh, tags: np.ndarray, tag: int | None) -> np.ndarray:
    """Which tetrahedra (m,) are the nucleus'; the file's regions and their volumes are printed."""
    parts = _parts(mesh, tags)
    have = _listed(parts)
    if tag is None and len(parts) == 1:
        _say(f"note: {file} has one region, {have}: a cell without a nucleus")
        return np.zeros(len(tags), bool)
    tag = NUCLEUS if tag is None else tag
    if tag not in parts:
        valid = f"--nucleus-tag is one of its regions: {have}"
        raise InputFileError(file, f"has no region {tag}", valid)
    inside = np.asarray(tags == tag)
    wrong = ""
    if parts[tag] > 0.51 * sum(parts.values()):
        wrong = "which is larger than all the rest"
    elif (outside := _outside(mesh, inside)) > _OUTSIDE:
        wrong = f"and {100 * outside:.0f} % of that region's surface is the cell's own"
    if wrong:
        valid = f"name the region inside by --nucleus-tag: {have}"
        raise InputFileError(file, f"has its nucleus in region {tag}, {wrong}", valid)
    _say(f"note: regions of {file}: {have}; nucleus: {tag}")
    return inside


def _outside(mesh: TetMesh, inside: np.ndarray) -> float:
    """Share of the surface of some tetrahedra (m,) that is the surface of the whole."""
    core = mesh.part(inside).surface
    skin = {tuple(face) for face in np.sort(mesh.surface.faces, axis=1).tolist()}
    on_skin = [tuple(face) in skin for face in np.sort(core.faces, axis=1).tolist()]
    return float(core.area_faces[on_skin].sum() / core.area)


def _like_a_nucleus(file: Path, mesh: TetMesh, inside: np.ndarray) -> None:
    """Warn of a nucleus with a share of the volume that no nucleus has, or on the outside."""
    share, outside = mesh.volumes[inside].sum() / mesh.volumes.sum(), _outside(mesh, inside)
    if not NUCLEI[0] <= share <= NUCLEI[1]:
        _say(
            f"warning: {file}: its nucleus is {100 * share:.2g} % of the cell's volume, and nuclei "
            f"are {100 * NUCLEI[0]:g} to {100 * NUCLEI[1]:g} %; is it that part?"
        )
    if outside:
        _say(
            f"warning: {file}: {100 * outside:.2g} % of the nucleus' surface is the cell's own, "
            "and a nucleus lies inside"
        )


def _like_a_cell(file: Path, mesh: TetMesh, um_per_unit: float) -> TetMesh:
    """The mesh, which must have a base; with a warning where its size is that of no cell."""
    mesh.base  # noqa: B018  raises where there is none
    volume = float(mesh.volumes.sum())
    if not CELLS_UM3[0] <= volume <= CELLS_UM3[1]:
        fitting = [
            f"{unit:g} ({name})"
            for unit, name in ((1e-3, "nm"), (1.0, "um"), (1e3, "mm"), (1e6, "m"))
            if CELLS_UM3[0] <= volume * (unit / um_per_unit) ** 3 <= CELLS_UM3[1]
        ]
        hint = f"; --um-per-unit {' or '.join(fitting)} would make it one" if fitting else ""
        _say(
            f"warning: {file} has a volume of {volume:.3g} um^3, and cells have "
            f"{CELLS_UM3[0]:g} to {CELLS_UM3[1]:g}{hint}"
        )
    return mesh


def _say(text: str) -> None:
    console.print(text, soft_wrap=True, markup=False)


def _meshio() -> Any:
    with required("meshio", "cell"):
        import meshio
    return meshio
