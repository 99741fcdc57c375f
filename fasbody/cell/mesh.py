"""Conforming two-material meshes of 10-node tetrahedra (the SOLID187 of section 5.2), by gmsh."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fasbody.cell.cache import place, read, write
from fasbody.cell.dome import Dome
from fasbody.cell.meshsize import PER_CUBE, PER_SQUARE, MeshSize, refuse_above_limit, unknowns
from fasbody.cell.tetmesh import CYTOPLASM, EDGES, NUCLEUS, TetMesh
from fasbody.exceptions import MeshError, MissingPackageError

if TYPE_CHECKING:
    import trimesh

#: gmsh numbers the last two mid-edge nodes the other way round than VTK.
TO_VTK = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
TET10 = 11  # gmsh's element type
#: Elements whose smallest det J is below this share of their mean are straightened, halfway at most so many times.
SQUASHED, UNBENDING = 0.2, 8


def dome_mesh(dome: Dome, size: MeshSize | None = None, *, cache: Path | None = None) -> TetMesh:
    """Mesh a dome, or read the same mesh from the cache.

    Args:
        dome: the cell.
        size: element sizes.
        cache: folder for finished meshes; None is ``$XDG_CACHE_HOME/fasbody/cell`` (``~/.cache`` without it).

    Raises:
        MeshError: gmsh cannot mesh it, or elements come out inverted, even at sizes up to 14 % finer.
        MissingPackageError: gmsh is not installed.
    """
    size = size or MeshSize()
    file = place(dome, size, cache)
    stored = read(file)
    if stored is not None:
        return stored
    refuse_above_limit(lambda factor: unknowns(dome, size.coarser(factor)), size.size)
    mesh = _mesh_patiently(dome, size)
    write(file, mesh)
    return mesh


def surface_mesh(
    outer: "trimesh.Trimesh", inner: "trimesh.Trimesh | None" = None, size: MeshSize | None = None
) -> TetMesh:
    """Fill a closed surface [um] with tetrahedra on its triangles; `inner` encloses the nucleus.

    With a `size`, coarser triangles are first cut in four until they match it, flat as they are, and the tetrahedra
    inside have that size, or that of finer triangles near them. Without, everything is as fine as the triangles.

    Raises:
        SettingError: the size asks for more than `LIMIT` unknowns.
        MeshError: a surface is open, the inner one is not inside, or gmsh cannot fill it.
    """
    for name, surface in (("cell", outer), ("nucleus", inner)):
        if surface is not None and not surface.is_watertight:
            raise MeshError(f"the {name}'s surface is not closed: {_open_edges(surface)} edges have no second face.")
    if inner is not None and not ((inner.bounds[0] > outer.bounds[0]) & (inner.bounds[1] < outer.bounds[1])).all():
        raise MeshError("the nucleus' surface is not inside the cell's surface.")
    if size is not None:
        volume, area, edge = float(outer.volume), float(outer.area), size.size
        refuse_above_limit(
            lambda factor: PER_CUBE * volume / (edge * factor) ** 3 + PER_SQUARE * area / (edge * factor) ** 2, edge
        )
        outer = _cut(outer, edge)
        inner = None if inner is None else _cut(inner, size.nucleus)
    with _gmsh() as gmsh:
        loops, first = [], 1
        for tag, surface in enumerate([outer] if inner is None else [outer, inner], start=1):
            gmsh.model.addDiscreteEntity(2, tag)
            numbers = np.arange(first, first + len(surface.vertices))
            gmsh.model.mesh.addNodes(2, tag, numbers, np.asarray(surface.vertices).ravel())
            gmsh.model.mesh.addElementsByType(tag, 2, [], numbers[np.asarray(surface.faces)].ravel())
            loops.append(gmsh.model.geo.addSurfaceLoop([tag]))
            first += len(surface.vertices)
        cell = gmsh.model.geo.addVolume(loops)
        nucleus = [gmsh.model.geo.addVolume(loops[1:])] if inner is not None else []
        gmsh.model.geo.synchronize()
        if size is not None:
            field = gmsh.model.mesh.field.add("Constant")
            gmsh.model.mesh.field.setNumbers(field, "VolumesList", nucleus)
            gmsh.model.mesh.field.setNumber(field, "VIn", size.nucleus)
            gmsh.model.mesh.field.setNumber(field, "VOut", size.size)
            gmsh.model.mesh.field.setAsBackgroundMesh(field)
        gmsh.model.mesh.generate(3)
        mesh = _collect(gmsh, [cell], nucleus)
    return mesh.check()


def _cut(surface: "trimesh.Trimesh", size: float) -> "trimesh.Trimesh":
    """Every triangle cut in four, again and again, until the mean edge is nearest to `size` by its logarithm."""
    while surface.edges_unique_length.mean() > np.sqrt(2) * size:
        surface = surface.subdivide()
    return surface


def _unbend(mesh: TetMesh) -> TetMesh:
    """Straighten, step by step, the edges of elements that their curved faces squash or invert.

    gmsh's own high-order optimisation would do it, but aborts the whole process where it does not succeed.
    """
    points, edges = mesh.points_um.copy(), mesh.tets[:, 4:]
    middles = points[mesh.tets[:, np.array(EDGES)]].mean(axis=2)
    for _ in range(UNBENDING):
        det = mesh.det_j
        bad = det.min(axis=1) < SQUASHED * det.mean(axis=1)
        if not bad.any():
            break
        points[edges[bad]] = (points[edges[bad]] + middles[bad]) / 2
        mesh = TetMesh(points.copy(), mesh.tets, mesh.region)
    return mesh


def ball_mesh(radius: float, size: float) -> TetMesh:
    """A ball of one material [um], curved elements: the body whose modes are known exactly."""
    with _gmsh() as gmsh:
        ball = gmsh.model.occ.addSphere(0, 0, 0, radius)
        gmsh.model.occ.synchronize()
        for bound in ("Min", "Max"):
            gmsh.option.setNumber(f"Mesh.MeshSize{bound}", size)
        gmsh.model.mesh.generate(3)
        return _unbend(_collect(gmsh, [ball], [])).check(standing=False)


def _mesh_patiently(dome: Dome, size: MeshSize) -> TetMesh:
    """Mesh; where coarse facets overlap at the dome's sharp ends or elements invert, try a little finer."""
    for finer in (1.0, 0.93, 0.86):
        try:
            return _unbend(_mesh_dome(dome, size.coarser(finer))).check()
        except MeshError as error:
            failure = error
    raise failure


def _mesh_dome(dome: Dome, size: MeshSize) -> TetMesh:
    with _gmsh() as gmsh:
        occ = gmsh.model.occ
        ball = occ.addSphere(0, 0, 0, 1)
        box = occ.addBox(-2, dome.cut, -2, 4, 2, 4)
        cell, _ = occ.intersect([(3, ball)], [(3, box)])
        occ.translate(cell, 0, -dome.cut, 0)
        occ.dilate(cell, 0, 0, 0, *dome.stretch)
        inside: list[int] = []
        if dome.nucleus is not None:
            centre = (0, dome.nucleus.centre, 0)
            ball = occ.addSphere(*centre, 1)
            occ.dilate([(3, ball)], *centre, *dome.nucleus.semi_axes)
            _, pieces = occ.fragment(cell, [(3, ball)])
            inside = [tag for _, tag in pieces[1]]
        occ.synchronize()
        outside = [tag for _, tag in gmsh.model.getEntities(3) if tag not in inside]
        _grade(gmsh, dome, size, inside)
        gmsh.model.mesh.generate(3)
        return _collect(gmsh, outside, inside)


def _grade(gmsh: Any, dome: Dome, size: MeshSize, inside: list[int]) -> None:
    """Small elements at the nucleus and at the rim, growing to `size.size` over `size.transition`."""
    field, thresholds = gmsh.model.mesh.field, []
    skin = [tag for _, tag in gmsh.model.getBoundary([(3, tag) for tag in inside], oriented=False)]
    rim = []
    for _, curve in gmsh.model.getEntities(1):
        low, high = np.array(gmsh.model.getBoundingBox(1, curve)).reshape(2, 3)
        if high[1] < 1e-3 * dome.height and high[0] - low[0] > 0.1 * dome.length:
            rim.append(curve)
    for kind, tags, near in (("SurfacesList", skin, size.nucleus), ("CurvesList", rim, size.rim)):
        if tags:
            distance, threshold = field.add("Distance"), field.add("Threshold")
            field.setNumbers(distance, kind, tags)
            field.setNumber(distance, "Sampling", 100)
            for name, value in (("InField", distance), ("SizeMin", near), ("SizeMax", size.size), ("DistMin", 0),
                                ("DistMax", size.transition)):  # fmt: skip
                field.setNumber(threshold, name, value)
            thresholds.append(threshold)
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", thresholds)
    field.setAsBackgroundMesh(least)
    for name in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{name}", 0)


def _collect(gmsh: Any, outside: list[int], inside: list[int]) -> TetMesh:
    numbers, xyz, _ = gmsh.model.mesh.getNodes()
    position = np.zeros(int(numbers.max()) + 1, dtype=np.int64)
    position[numbers] = np.arange(len(numbers))
    tets, region = [], []
    for number, volumes in ((CYTOPLASM, outside), (NUCLEUS, inside)):
        for volume in volumes:
            _, nodes = gmsh.model.mesh.getElementsByType(TET10, volume)
            tets.append(position[nodes].reshape(-1, 10)[:, TO_VTK])
            region.append(np.full(len(tets[-1]), number))
    used, renumbered = np.unique(np.vstack(tets), return_inverse=True)
    return TetMesh(xyz.reshape(-1, 3)[used], renumbered.reshape(-1, 10), np.concatenate(region))


@contextmanager
def _gmsh() -> Iterator[Any]:
    """One gmsh session; its exceptions become MeshError, and it is always closed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # SWIG's own deprecations
            import gmsh
    except ImportError as error:
        raise MissingPackageError("gmsh", "cell") from error
    except OSError as error:  # the wheel needs libGLU and a few X libraries of the system
        raise MissingPackageError("gmsh", "cell", str(error)) from error
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for name, value in (("General.Terminal", 0), ("General.NumThreads", 1), ("Mesh.ElementOrder", 2),
                            ("Mesh.Algorithm3D", 1)):  # fmt: skip
            gmsh.option.setNumber(name, value)
        yield gmsh
    except MeshError:
        raise
    except Exception as error:  # gmsh raises nothing more specific
        raise MeshError(f"gmsh cannot mesh this cell ({str(error).strip()}): try another element size.") from error
    finally:
        gmsh.finalize()


def _open_edges(surface: "trimesh.Trimesh") -> int:
    _, count = np.unique(surface.edges_sorted, axis=0, return_counts=True)
    return int((count != 2).sum())
