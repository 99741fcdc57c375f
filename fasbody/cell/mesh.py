"""A cell as tetrahedra: what every mesh becomes before the analysis, and how gmsh makes ours.

Our meshes conform to both materials and have 10-node tetrahedra (the SOLID187 of section 5.2).
"""

import io
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import astuple, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fasbody.cell.dome import Dome
from fasbody.exceptions import MeshError, MissingPackageError, SettingError
from fasbody.runner import Store, key, program

if TYPE_CHECKING:
    import trimesh

#: Region numbers; the names are those of Table 5.2.
CYTOPLASM, NUCLEUS = 0, 1
REGIONS = ("cytoplasm", "nucleus")
#: Degree that the quadrature integrates exactly on straight elements: two quadratic functions.
QUADRATURE = 4
#: Corner pairs of the six mid-edge nodes 4..9 of a 10-node tetrahedron, in the order of VTK.
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
#: Corners of the four faces, normals outwards.
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
#: How far above the lowest node a node still belongs to the base, relative to the height.
FLAT = 1e-5
#: How near two corners are one place, relative to the body's length.
SAME_PLACE = 1e-7
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
#: Angles from which an edge divides a surface into patches [degrees]: of a machine part, of a rough
#: one, none.
PATCHES = (40.0, 80.0, 180.0)
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


@dataclass(frozen=True)
class Quality:
    """Shape of the elements.

    Args:
        mean_ratio_min: least 12 (3 V)^(2/3) / sum of squared edge lengths of the corners'
            tetrahedra: 1 for a regular tetrahedron, 0 for a flat one.
        mean_ratio_mean: mean of the same.
        det_j_min: smallest det J at a quadrature point, relative to that element's mean.
    """

    mean_ratio_min: float
    mean_ratio_mean: float
    det_j_min: float


@dataclass(frozen=True)
class TetMesh:
    """Tetrahedra with 4 or 10 nodes, in the node order of VTK.

    Args:
        points_um: node positions (n, 3) [um].
        tets: node numbers (m, 4) or (m, 10).
        region: region number (m,); of a cell, see `REGIONS`.
        up: axis that points up from the base, 0 to 2; y for a cell.
        faces: corners (f, 3) of triangles that a file marks, by their number.

    Example:
        >>> dome_mesh(Dome(), MeshSize.of(5.0)).volume_um3
    """

    points_um: NDArray[np.float64]
    tets: NDArray[np.int64]
    region: NDArray[np.int64]
    up: int = 1
    faces: Mapping[int, NDArray[np.int64]] = field(default_factory=dict)

    def part(self, inside: NDArray[np.bool_]) -> "TetMesh":
        """Some of the tetrahedra (m,), with all points."""
        return TetMesh(self.points_um, self.tets[inside], self.region[inside], self.up)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corner positions (m, 4, 3) [um]."""
        return self.points_um[self.tets[:, :4]]

    @property
    def volumes(self) -> NDArray[np.float64]:
        """Volume between the corners of each tetrahedron (m,) [um^3]."""
        return np.asarray(np.abs(np.linalg.det(np.diff(self.corners, axis=1))) / 6)

    @property
    def volume_um3(self) -> float:
        """Volume [um^3]; of curved elements within some 1e-5."""
        return float(self.det_j.mean(axis=1).sum()) / 6

    @property
    def curved(self) -> bool:
        """Whether mid-edge nodes lie off the middles of their edges."""
        if self.tets.shape[1] == 4:
            return False
        middles = self.corners[:, np.array(EDGES)].mean(axis=2)
        off = np.abs(self.points_um[self.tets[:, 4:]] - middles).max()
        return bool(off > FLAT * float(np.ptp(self.points_um, axis=0).max()))

    @cached_property
    def surface(self) -> "trimesh.Trimesh":
        """Outer boundary as flat triangles over the corners, numbered as `points_um`."""
        import trimesh

        faces = self.tets[:, :4][:, FACES].reshape(-1, 3)
        corners = np.sort(faces, axis=1)
        _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
        return trimesh.Trimesh(self.points_um, faces[first[count == 1]], process=False)

    @cached_property
    def skfem(self) -> Any:
        """The same mesh for scikit-fem; curved elements stay curved."""
        from skfem import MeshTet, MeshTet2

        kind = MeshTet if self.tets.shape[1] == 4 else MeshTet2
        return kind(np.ascontiguousarray(self.points_um.T), np.ascontiguousarray(self.tets.T))

    @cached_property
    def det_j(self) -> NDArray[np.float64]:
        """Determinant of the Jacobian (m, q) at the quadrature points of the analysis [um^3]."""
        from skfem import Basis, ElementTetP0

        points = Basis(self.skfem, ElementTetP0(), intorder=QUADRATURE).X
        sign = self.skfem.mapping().detDF(points)
        return np.asarray(np.broadcast_to(sign, (len(self.tets), points.shape[1])))

    @cached_property
    def base(self) -> NDArray[np.int64]:
        """Corners (f, 3) of the faces that lie flat on the lowest plane.

        Raises:
            MeshError: there is none.
        """
        height = self.points_um[:, self.up]
        on_base = height <= height.min() + FLAT * float(np.ptp(height))
        faces = np.asarray(self.surface.faces)
        flat = faces[on_base[faces].all(axis=1)]
        if not len(flat):
            up = "xyz"[self.up]
            raise MeshError(f"no face lies flat on the lowest plane: it stands on its base with {up} up.")
        return flat

    def check(self) -> "TetMesh":
        """Return the mesh if its elements and its surface are sound and it is one body.

        Raises:
            MeshError: elements are flat, inverted or overlap, nodes not merged, bodies several, or
                the surface is open.
        """
        edges = np.diff(self.corners, axis=1)
        longest = np.linalg.norm(edges, axis=2).max(axis=1)
        flat = np.abs(np.linalg.det(edges)) <= FLAT**2 * longest**3
        bent = np.zeros_like(flat) if flat.any() else np.any(self.det_j <= 0, axis=1)
        for bad, what in ((flat, "flat: they have no volume"), (bent, "inverted or bent too far")):
            if bad.any():
                raise MeshError(
                    f"{int(bad.sum())} of the {len(self.tets)} tetrahedra are {what} (the first is "
                    f"number {int(np.argmax(bad))})."
                )
        if folded := self._folded():
            raise MeshError(f"tetrahedra overlap at {folded} faces: both neighbours lie on the same side.")
        skin = self.points_um[np.unique(self.surface.faces)]
        reach = SAME_PLACE * float(np.ptp(skin, axis=0).max())
        if double := len(cKDTree(skin).query_pairs(reach)):
            raise MeshError(
                f"{double} pairs of corners lie at the same place and are not one, so that nothing "
                "holds the elements together there: merge the nodes (gmsh: "
                "Mesh.removeDuplicateNodes)."
            )
        ends = self.tets[:, np.array(EDGES)].reshape(-1, 2).T
        shape = (len(self.points_um),) * 2
        links = sp.coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=shape)
        _, number = connected_components(links, directed=False)
        if (bodies := len(np.unique(number[self.tets[:, 0]]))) > 1:
            raise MeshError(f"{bodies} bodies share no nodes: analyse one at a time, or join them.")
        if not self.surface.is_watertight:
            raise MeshError("the mesh's outer surface is open or branched: neighbouring elements must share faces.")
        return self

    def _folded(self) -> int:
        """Faces whose neighbours lie on the same side."""
        faces = self.tets[:, :4][:, FACES].reshape(-1, 3)
        turned = np.linalg.det(np.eye(3)[np.argsort(faces, axis=1)])  # 1 or -1 by their sense
        corners = np.sort(faces, axis=1)
        _, face, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
        return int(((np.abs(np.bincount(face, turned)) > 0.5) & (count > 1)).sum())

    @cached_property
    def quality(self) -> Quality:
        """Shapes of the elements."""
        ends = self.corners[:, np.array(EDGES)]
        length2 = (np.diff(ends, axis=2) ** 2).sum(axis=(1, 2, 3))
        ratio = 12 * np.cbrt(3 * self.volumes) ** 2 / length2
        relative = self.det_j.min(axis=1) / self.det_j.mean(axis=1)
        return Quality(float(ratio.min()), float(ratio.mean()), float(relative.min()))


@dataclass(frozen=True)
class MeshSize:
    """Element sizes [um].

    Args:
        size: far from anything.
        nucleus: at the nucleus.
        rim: at the clamped rim.
        transition: width over which they grow.
    """

    size: float = 3.5
    nucleus: float = 1.225
    rim: float = 2.1
    transition: float = 8.0

    @classmethod
    def of(cls, size: float) -> "MeshSize":
        """Finer where stiff cytoplasm shakes a soft nucleus and where the clamped rim strains.

        Raises:
            SettingError: the size is not a positive number.
        """
        if not (np.isfinite(size) and size > 0):
            text = f"the element size must be a positive number of um, not {size}."
            raise SettingError(text, "size")
        return cls(size, 0.35 * size, 0.6 * size)

    def coarser(self, factor: float) -> "MeshSize":
        """All sizes times `factor`; the transition stays."""
        return MeshSize(factor * self.size, factor * self.nucleus, factor * self.rim, self.transition)


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


def refuse_above_limit(count: Callable[[float], float], size: float) -> None:
    """Refuse a mesh of more than `LIMIT` unknowns.

    Args:
        count: unknowns at a size [um].
        size: that is asked for [um].

    Raises:
        SettingError: with the number and an element size that would do.
    """
    if (many := count(size)) > LIMIT:
        valid = np.ceil(100 * _largest(count, size, LIMIT)) / 100
        raise SettingError(
            f"an element size of {size:g} um needs about {many:.2g} unknowns, more than the "
            f"{LIMIT} that fit into some 4 GB of memory: take {valid:g} um or more.",
            "size",
        )


def _largest(count: Callable[[float], float], size: float, most: int) -> float:
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
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    store = Store(cache or home / "fasbody" / "cell")
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


def surface_mesh(
    outer: "trimesh.Trimesh", inner: "trimesh.Trimesh | None" = None, size: MeshSize | None = None
) -> TetMesh:
    """The mesh of `sized_mesh`."""
    return sized_mesh(outer, inner, size)[0]


def sized_mesh(
    outer: "trimesh.Trimesh", inner: "trimesh.Trimesh | None" = None, size: MeshSize | None = None
) -> tuple[TetMesh, MeshSize]:
    """Fill a closed surface [um], which may have cavities, with tetrahedra.

    The triangles give the geometry only: gmsh divides it into patches at edges sharper than an
    angle of `PATCHES`. The first angle that gives sound elements and the volume is taken.

    Args:
        outer: of the body.
        inner: of the nucleus.
        size: None is `default_size`, or as much smaller as the surface needs.

    Raises:
        SettingError: the size needs more than `LIMIT` unknowns.
        MeshError: a surface is open or branched, the inner one is not inside, gmsh cannot fill it,
            or elements of this size lose a part of it.
    """
    _check_closed("", outer)
    _check_pieces(outer)
    if inner is not None:
        _check_closed("nucleus' ", inner)
        inside = (inner.bounds[0] > outer.bounds[0]) & (inner.bounds[1] < outer.bounds[1])
        if not inside.all():
            raise MeshError("the nucleus' surface is not inside the other.")
    used = size or default_size(outer)
    while True:
        refuse_above_limit(lambda h: filled(outer, h), used.size)
        mesh = fill(outer, used, inner)
        if strays(outer, mesh) <= STRAY * used.size:
            return mesh, used
        if size is not None:
            raise MeshError("elements of this size lose a part of the surface: take smaller ones.")
        used = used.coarser(FINER)


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
    return MeshSize.of(_largest(lambda h: filled(surface, h), size, DEFAULT))


def volume(surface: "trimesh.Trimesh") -> float:
    """Volume that is enclosed, without the cavities [um^3]."""
    parts = sorted(abs(float(part.volume)) for part in surface.split(only_watertight=False))
    return parts[-1] - sum(parts[:-1])


def rounded(surface: "trimesh.Trimesh") -> float:
    """Share of its volume between flat triangles and a smooth surface through their corners.

    Edges up to the first angle of `PATCHES` count as round: one that turns by phi between triangles
    of areas A and B has phi (A^2 + B^2) / (6 L) beside it, exactly so on evenly cut cylinders and
    spheres.
    """
    turn = surface.face_adjacency_angles
    turn = np.where(turn < np.radians(PATCHES[0]), turn, 0.0)
    squares = (surface.area_faces[surface.face_adjacency] ** 2).sum(axis=1)
    ends = np.diff(surface.vertices[surface.face_adjacency_edges], axis=1)[:, 0]
    length = np.linalg.norm(ends, axis=1)
    return float((turn * squares / (6 * length)).sum()) / volume(surface)


def _check_closed(whose: str, surface: "trimesh.Trimesh") -> None:
    _, count = np.unique(surface.edges_sorted, axis=0, return_counts=True)
    if many := int((count > 2).sum()):
        text = f"{many} edges belong to more than two triangles"
        raise MeshError(f"the {whose}surface branches: {text}.")
    if many := int((count == 1).sum()):
        text = f"{many} edges belong to one triangle only"
        raise MeshError(f"the {whose}surface is not closed: {text}.")
    if not surface.is_winding_consistent:
        text = "neighbouring triangles face opposite sides"
        raise MeshError(f"the {whose}surface is inside out in places: {text}.")


def _check_pieces(surface: "trimesh.Trimesh") -> None:
    """Every piece beside the largest must be a cavity of it: inside, and inside no other.

    Raises:
        MeshError: there are several bodies.
    """
    pieces = sorted(surface.split(only_watertight=False), key=lambda piece: -abs(piece.volume))
    depth = [sum(_inside(other, piece.vertices[0]) for other in pieces if other is not piece) for piece in pieces]
    if depth != [0] + [1] * (len(pieces) - 1):
        raise MeshError(
            f"the surface has {len(pieces)} separate pieces that are not one body with cavities: give one body."
        )


def _inside(surface: "trimesh.Trimesh", point: NDArray[np.float64]) -> bool:
    """Whether a closed surface goes round a point: its solid angle (Van Oosterom, Strackee 1983)."""
    a, b, c = np.moveaxis(surface.triangles - point, 1, 0)
    x, y, z = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    above = (a * np.cross(b, c)).sum(axis=1)
    sides = ((a, b, z), (b, c, x), (c, a, y))
    below = x * y * z + sum((p * q).sum(axis=1) * r for p, q, r in sides)
    return bool(abs(np.arctan2(above, below).sum()) > np.pi)


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
    """Whether a patch is one of this surface."""
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
        for volume in volumes:
            _, nodes = gmsh.model.mesh.getElementsByType(TET10, volume)
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
