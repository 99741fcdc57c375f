"""How gmsh fills a dome, a ball or a closed surface with tetrahedra, and how many unknowns that makes."""

import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from fasbody import cache as caches
from fasbody.cell.dome import Dome
from fasbody.cell.mesh import CYTOPLASM, EDGES, NUCLEUS, SAME_PLACE, MeshSize, TetMesh
from fasbody.cell.surface import ROUND, check_closed, check_pieces, volume
from fasbody.exceptions import MeshError, MissingPackageError, SettingError
from fasbody.runner import Store, key, program

if TYPE_CHECKING:
    import trimesh

#: gmsh numbers the last two mid-edge nodes the other way round than VTK.
TO_VTK = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
TET10 = 11  # gmsh's element type
#: What the wheel of gmsh needs of the system, by Debian's names.
SYSTEM = "libglu1-mesa libxcursor1 libxft2 libxinerama1 libgomp1"
#: Elements whose smallest det J is below this share of their mean are straightened, halfway at
#: most so many times.
SQUASHED, UNBENDING = 0.2, 8
#: Unknowns above which a mesh is refused before it is made: some 4 GB of memory.
LIMIT = 500_000
#: Unknowns that the default size of a surface gives, about: some seconds to a minute.
LEAST, DEFAULT = 25_000, 300_000
#: Unit of sizes, and its micrometres.
UM = ("um", 1.0)
#: Angles from which an edge divides a surface into patches [degrees]: of a machine part, of a rough
#: one, none.
PATCHES = (ROUND, 80.0, 180.0)
#: Share of the volume that a new mesh may lose or gain.
VOLUME_CHANGE = 0.02
#: Mean ratio of the worst element with which a mesh is good.
SLIVER = 0.1
#: How far a vertex may lie from a mesh that follows its surface, of the element size: 0.32 to 0.37
#: on balls and bones, 0.98 on a calcaneus that lost a process.
STRAY = 0.5
#: By what a size is multiplied that does not do.
FINER = 0.75
#: Unknowns of quadratic elements of size h in a volume h^3 and on a surface h^2, counted on domes.
PER_CUBE, PER_SQUARE = 10.0, 38.0


def unknowns(dome: Dome, size: MeshSize) -> float:
    """About how many unknowns a mesh will have: 1 / h^3 over fixed random points, and surface."""
    low, high = np.array([-1, 0, -1]) * dome.semi_axes, dome.semi_axes
    points = np.random.default_rng(0).uniform(low, high, (40_000, 3))
    points = points[dome.level(points) < 1]
    turn = np.linspace(0, 2 * np.pi, 720)
    rim = np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=1) * dome.semi_axes
    distances = [(cKDTree(rim).query(points)[0], size.rim)]
    if dome.nucleus is not None:
        away = points - np.array([0, dome.nucleus.centre, 0])
        level = np.linalg.norm(away / dome.nucleus.semi_axes, axis=1)
        distances.append((np.abs(1 - 1 / level) * np.linalg.norm(away, axis=1), size.nucleus))
    h = np.min(
        [near + (size.size - near) * np.minimum(d / size.transition, 1) for d, near in distances],
        axis=0,
    )
    surface = 2 * np.pi * dome.length * dome.width / 4
    cubes = dome.volume_um3 * np.mean(1 / h**3)
    return float(PER_CUBE * cubes + PER_SQUARE * surface / size.size**2)


def filled(surface: "trimesh.Trimesh", size: float) -> float:
    """About how many unknowns elements of a size [um] in a surface have: beams, plates, bones."""
    return 6.2 * volume(surface) / size**3 + 23.5 * float(surface.area) / size**2


def refuse_above_limit(count: Callable[[float], float], size: float, unit: tuple[str, float] = UM) -> None:
    """Refuse a mesh of more than `LIMIT` unknowns.

    Args:
        count: unknowns at a size [um].
        size: that is asked for [um].
        unit: of the user's sizes, and its micrometres.

    Raises:
        SettingError: with the number and an element size that would do.
    """
    if (many := count(size)) > LIMIT:
        name, um = unit
        valid = np.ceil(100 * largest(count, size, LIMIT) / um) / 100
        raise SettingError(
            f"an element size of {size / um:g} {name} needs about {many:.2g} unknowns, more than "
            f"the {LIMIT} that fit into some 4 GB of memory: take {valid:g} {name} or more.",
            "size",
        )


def largest(count: Callable[[float], float], size: float, most: int) -> float:
    """The size, or as much larger that `count` gives at most so many unknowns."""
    size *= max(1.0, float(np.cbrt(count(size) / most)))  # enough if all of it were volume
    while count(size) > most:
        size *= 1.05
    return size


def dome_mesh(dome: Dome, size: MeshSize | None = None, *, cache: Path | None = None) -> TetMesh:
    """Mesh a dome, or read the same mesh from the cache.

    Args:
        dome: the cell.
        size: element sizes.
        cache: folder for meshes; None is ``$XDG_CACHE_HOME/fasbody/cell``, else in ``~/.cache``.

    Raises:
        MeshError: gmsh cannot mesh it, or elements come out inverted, even up to 14 % finer.
        MissingPackageError: gmsh is not installed.
    """
    size = size or MeshSize()
    store = Store(cache or caches.folder("cell"))
    name = f"{key(program(__name__), astuple(dome), astuple(size))}.npz"
    stored, _ = store.load(name, _unpacked)
    if stored is not None:
        return stored
    refuse_above_limit(lambda h: unknowns(dome, size.coarser(h / size.size)), size.size)
    mesh = _mesh_patiently(dome, size)
    memory = io.BytesIO()
    np.savez_compressed(memory, points_um=mesh.points_um, tets=mesh.tets, region=mesh.region)
    store.save(name, memory.getvalue())
    return mesh


def _unpacked(file: bytes) -> TetMesh:
    with np.load(io.BytesIO(file), allow_pickle=False) as stored:
        return TetMesh(stored["points_um"], stored["tets"], stored["region"])


def sized_mesh(
    outer: "trimesh.Trimesh", inner: "trimesh.Trimesh | None" = None, size: MeshSize | None = None,
    unit: tuple[str, float] = UM,
) -> tuple[TetMesh, MeshSize]:  # fmt: skip
    """Fill a closed surface [um], which may have cavities, with tetrahedra.

    The triangles give the geometry only: gmsh divides it into patches at edges sharper than an
    angle of `PATCHES`. The first angle that gives sound elements and the volume is taken.

    Args:
        outer: of the body.
        inner: of the nucleus.
        size: None is `default_size`, or as much smaller as the surface needs.
        unit: of the sizes that errors name, and its micrometres.

    Raises:
        SettingError: the size needs more than `LIMIT` unknowns.
        MeshError: a surface is open or branched, the inner one is not inside, gmsh cannot fill it,
            or elements of this size lose a part of it.
    """
    check_closed("", outer)
    check_pieces(outer)
    if inner is not None:
        check_closed("nucleus' ", inner)
        inside = (inner.bounds[0] > outer.bounds[0]) & (inner.bounds[1] < outer.bounds[1])
        if not inside.all():
            raise MeshError("the nucleus' surface is not inside the other.")
    used = size or default_size(outer)
    while True:
        refuse_above_limit(lambda h: filled(outer, h), used.size, unit)
        mesh = fill(outer, used, inner)
        if strays(outer, mesh) <= STRAY * used.size:
            return mesh, used
        if size is not None:
            text = "elements of this size lose a part of the surface"
            raise MeshError(f"{text}: {_smaller(outer, used.size, unit)}.")
        used = used.coarser(FINER)


def _smaller(surface: "trimesh.Trimesh", size: float, unit: tuple[str, float]) -> str:
    """What size to take instead: half of the mean thickness, 2 V / A, if that is smaller."""
    name, um = unit
    half = volume(surface) / float(surface.area)
    valid = min(half, FINER * size) / um
    digit = 10 ** (np.floor(np.log10(valid)) - 1)
    whose = ", half of its mean thickness" if half <= FINER * size else ""
    return f"use --size {np.floor(valid / digit) * digit:.2g} ({name}) or less{whose}"


def strays(surface: "trimesh.Trimesh", mesh: TetMesh) -> float:
    """Largest distance [um] of a vertex from corners, mid-edges and centres of outer triangles."""
    corners = mesh.surface.triangles
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    points = np.concatenate([corners, middles, corners.mean(axis=1, keepdims=True)], axis=1)
    return float(cKDTree(points.reshape(-1, 3)).query(surface.vertices)[0].max())


def fill(
    outer: "trimesh.Trimesh", size: MeshSize, inner: "trimesh.Trimesh | None" = None,
    tolerance: float = VOLUME_CHANGE,
) -> TetMesh:  # fmt: skip
    """The same for sound surfaces, by the best of the `PATCHES`.

    Args:
        outer: of the body.
        size: of the elements.
        inner: of the nucleus.
        tolerance: share by which the volume may change.
    """
    best: TetMesh | None = None
    failure = MeshError("no element size will do.")
    for angle in PATCHES:
        try:
            mesh = _unbend(_fill([outer] if inner is None else [outer, inner], size, angle)).check()
        except MeshError as error:
            failure = error
            continue
        changed = abs(mesh.volume_um3 / volume(outer) - 1)
        if changed > tolerance:
            text = f"elements of this size change its volume by {changed:.1%}: take smaller ones."
            failure = MeshError(text)
        elif best is None or mesh.quality.mean_ratio_min > best.quality.mean_ratio_min:
            best = mesh
        if best is not None and best.quality.mean_ratio_min > SLIVER:
            return best
    if best is None:
        raise failure
    return best


def default_size(surface: "trimesh.Trimesh") -> MeshSize:
    """Half the thickness of a plate of this volume and area, or `LEAST` to `DEFAULT` unknowns."""
    size = volume(surface) / float(surface.area)
    while filled(surface, size) < LEAST:
        size *= 0.97
    return MeshSize.of(largest(lambda h: filled(surface, h), size, DEFAULT))


def _fill(surfaces: "list[trimesh.Trimesh]", size: MeshSize, angle: float) -> TetMesh:
    with _gmsh() as gmsh:
        mesh, geo, first = gmsh.model.mesh, gmsh.model.geo, 1
        for tag, surface in enumerate(surfaces, start=1):
            gmsh.model.addDiscreteEntity(2, tag)
            numbers = np.arange(first, first + len(surface.vertices))
            mesh.addNodes(2, tag, numbers, np.asarray(surface.vertices).ravel())
            mesh.addElementsByType(tag, 2, [], numbers[np.asarray(surface.faces)].ravel())
            first += len(surface.vertices)
        mesh.classifySurfaces(np.radians(angle), True, True, np.pi)
        mesh.createGeometry()
        patches = [tag for _, tag in gmsh.model.getEntities(2)]
        inside = [tag for tag in patches if len(surfaces) > 1 and _on(gmsh, tag, surfaces[1])]
        loops = [geo.addSurfaceLoop([tag for tag in patches if tag not in inside])]
        loops += [geo.addSurfaceLoop(inside)] if inside else []
        body = geo.addVolume(loops)
        nucleus = [geo.addVolume(loops[1:])] if inside else []
        geo.synchronize()
        constant = mesh.field.add("Constant")
        mesh.field.setNumbers(constant, "VolumesList", nucleus)
        mesh.field.setNumbers(constant, "SurfacesList", inside)
        mesh.field.setNumber(constant, "VIn", size.nucleus)
        mesh.field.setNumber(constant, "VOut", size.size)
        _sizes_by(gmsh, constant)
        mesh.generate(3)
        return _collect(gmsh, [body], nucleus)


def _on(gmsh: Any, patch: int, surface: "trimesh.Trimesh") -> bool:
    _, xyz, _ = gmsh.model.mesh.getNodes(2, patch, includeBoundary=True)
    away = cKDTree(surface.vertices).query(np.asarray(xyz).reshape(-1, 3))[0]
    return bool(away.max() < SAME_PLACE * float(surface.extents.max()))


def _sizes_by(gmsh: Any, field: int) -> None:
    """Element sizes come from this field and nothing else."""
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    for name in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
        gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)


def _unbend(mesh: TetMesh) -> TetMesh:
    """Straighten, step by step, the edges of elements that their curved faces squash or invert.

    gmsh's high-order optimisation aborts the whole process where it does not succeed.
    """
    points, edges = mesh.points_um.copy(), mesh.tets[:, 4:]
    middles = mesh.corners[:, np.array(EDGES)].mean(axis=2)
    for _ in range(UNBENDING):
        bad = mesh.det_j.min(axis=1) < SQUASHED * mesh.det_j.mean(axis=1)
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
        return _unbend(_collect(gmsh, [ball], [])).check()


def _mesh_patiently(dome: Dome, size: MeshSize) -> TetMesh:
    """Mesh; where coarse facets overlap at sharp ends or elements invert, try a little finer."""
    for finer in (1.0, 0.93, 0.86):
        try:
            return _unbend(_mesh_dome(dome, size.coarser(finer))).check()
        except MeshError as error:
            failure = error
    raise failure


def _mesh_dome(dome: Dome, size: MeshSize) -> TetMesh:
    with _gmsh() as gmsh:
        occ = gmsh.model.occ
        ball, box = occ.addSphere(0, 0, 0, 1), occ.addBox(-2, dome.cut, -2, 4, 2, 4)
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
    """Small elements at the nucleus and at the rim, growing to `size.size`."""
    field, thresholds = gmsh.model.mesh.field, []
    nuclei = [(3, tag) for tag in inside]
    skin = [tag for _, tag in gmsh.model.getBoundary(nuclei, oriented=False)]
    rim = []
    for _, curve in gmsh.model.getEntities(1):
        low, high = np.array(gmsh.model.getBoundingBox(1, curve)).reshape(2, 3)
        if high[1] < 1e-3 * dome.height and high[0] - low[0] > 0.1 * dome.length:
            rim.append(curve)
    for kind, tags, near in (("Surfaces", skin, size.nucleus), ("Curves", rim, size.rim)):
        if not tags:
            continue
        distance, threshold = field.add("Distance"), field.add("Threshold")
        field.setNumbers(distance, f"{kind}List", tags)
        field.setNumber(distance, "Sampling", 100)
        ramp = {"InField": distance, "SizeMin": near, "SizeMax": size.size, "DistMin": 0}
        for name, value in (ramp | {"DistMax": size.transition}).items():
            field.setNumber(threshold, name, value)
        thresholds.append(threshold)
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", thresholds)
    _sizes_by(gmsh, least)


def _collect(gmsh: Any, outside: list[int], inside: list[int]) -> TetMesh:
    numbers, xyz, _ = gmsh.model.mesh.getNodes()
    position = np.zeros(int(numbers.max()) + 1, dtype=np.int64)
    position[numbers] = np.arange(len(numbers))
    tets, region = [], []
    for number, volumes in ((CYTOPLASM, outside), (NUCLEUS, inside)):
        for tag in volumes:
            _, nodes = gmsh.model.mesh.getElementsByType(TET10, tag)
            tets.append(position[nodes].reshape(-1, 10)[:, TO_VTK])
            region.append(np.full(len(tets[-1]), number))
    used, renumbered = np.unique(np.vstack(tets), return_inverse=True)
    points = xyz.reshape(-1, 3)[used]
    return TetMesh(points, renumbered.reshape(-1, 10), np.concatenate(region))


@contextmanager
def _gmsh() -> Iterator[Any]:
    """One gmsh session; its exceptions become MeshError, and it is always closed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # deprecations of SWIG
            import gmsh
    except ImportError as error:
        raise MissingPackageError("gmsh", "cell") from error
    except OSError as error:  # the wheel needs libraries of the system
        remedy = f"apt-get install {SYSTEM}"
        raise MissingPackageError("gmsh", "cell", str(error), remedy) from error
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        options = {"General.Terminal": 0, "General.NumThreads": 1, "Mesh.ElementOrder": 2}
        for name, value in (options | {"Mesh.Algorithm3D": 1}).items():
            gmsh.option.setNumber(name, value)
        yield gmsh
    except MeshError:
        raise
    except Exception as error:  # gmsh raises nothing more specific
        raise MeshError(
            f"gmsh cannot mesh this body ({str(error).strip()}): look whether its surface crosses "
            "itself, or take another element size."
        ) from error
    finally:
        gmsh.finalize()
