"""A cell as tetrahedra: what every mesh, ours or a user's, becomes before the analysis, and how gmsh makes ours.

Our meshes conform to both materials and have 10-node tetrahedra (the SOLID187 of section 5.2).
"""

import io
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import astuple, dataclass, field
from functools import cached_property, partial
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
#: Degree that the quadrature integrates exactly on straight elements: products of two quadratic shape functions.
QUADRATURE = 4
#: Corner pairs of the six mid-edge nodes 4..9 of a 10-node tetrahedron, in the order of VTK.
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
#: Corners of the four faces, normals outwards.
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
#: How far above the lowest node a node still belongs to the base, relative to the height; and how near two corners are
#: one place, relative to the body's length.
FLAT, SAME_PLACE = 1e-5, 1e-7
#: gmsh numbers the last two mid-edge nodes the other way round than VTK.
TO_VTK = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
TET10 = 11  # gmsh's element type
#: What the wheel of gmsh needs of the system, by Debian's names.
SYSTEM = "libglu1-mesa libxcursor1 libxft2 libxinerama1 libgomp1"
#: Elements whose smallest det J is below this share of their mean are straightened, halfway at most so many times.
SQUASHED, UNBENDING = 0.2, 8
#: Unknowns above which a mesh is refused before it is made: its solution would not fit into some 4 GB.
LIMIT = 500_000
#: Unknowns that the default size of a surface gives, about: some seconds and about a minute of one processor.
LEAST, DEFAULT = 25_000, 300_000
#: Angles from which an edge divides a surface into patches [degrees]: those of a machine part, of a rough one, none.
PATCHES = (40.0, 80.0, 180.0)
#: Share of the volume that a new mesh may lose or gain, and mean ratio of the worst element with which it is good.
VOLUME_CHANGE, SLIVER = 0.02, 0.1
#: How far a vertex may lie from a mesh that follows its surface, of the element size: 0.32 to 0.37 on balls and bones,
#: 0.98 on a calcaneus that lost a process. By what a size is multiplied that does not do.
STRAY, FINER = 0.5, 0.75
#: Unknowns of quadratic elements of size h in a volume h^3 and on a surface h^2, counted on gmsh's domes.
PER_CUBE, PER_SQUARE = 10.0, 38.0


@dataclass(frozen=True)
class Quality:
    """Shape of the elements: mean ratio is 1 for a regular tetrahedron, 0 for a flat one; det J is relative.

    Args:
        mean_ratio_min: least 12 (3 V)^(2/3) / sum of squared edge lengths of the corners' tetrahedra.
        mean_ratio_mean: mean of the same.
        det_j_min: smallest det J of any element at the quadrature points, relative to that element's mean.
    """

    mean_ratio_min: float
    mean_ratio_mean: float
    det_j_min: float

    def __str__(self) -> str:
        return (
            f"mean ratio {self.mean_ratio_min:.3f} at worst, {self.mean_ratio_mean:.3f} on average; "
            f"det J / mean {self.det_j_min:.3f} at worst"
        )


@dataclass(frozen=True)
class TetMesh:
    """Tetrahedra with 4 or 10 nodes, in the node order of VTK.

    Args:
        points_um: node positions (n, 3) [um].
        tets: node numbers (m, 4) or (m, 10).
        region: region number (m,); of a cell, see `REGIONS`.
        up: axis that points up from the base, 0 to 2; y for a cell.
        faces: corners (f, 3) of triangles that a file marks, by their number.
    """

    points_um: NDArray[np.float64]
    tets: NDArray[np.int64]
    region: NDArray[np.int64]
    up: int = 1
    faces: Mapping[int, NDArray[np.int64]] = field(default_factory=dict)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corner positions (m, 4, 3) [um]."""
        return self.points_um[self.tets[:, :4]]

    @property
    def volume_um3(self) -> float:
        """Volume [um^3]; of curved elements within some 1e-5."""
        return float(self.det_j.mean(axis=1).sum()) / 6

    @property
    def curved(self) -> bool:
        """Whether mid-edge nodes lie off the middles of their edges."""
        if self.tets.shape[1] == 4:
            return False
        off = self.points_um[self.tets[:, 4:]] - self.corners[:, np.array(EDGES)].mean(axis=2)
        return bool(np.abs(off).max() > FLAT * float(np.ptp(self.points_um, axis=0).max()))

    @cached_property
    def surface(self) -> "trimesh.Trimesh":
        """Outer boundary as flat triangles over the corners; `points_um` numbers its vertices."""
        import trimesh

        faces = self.tets[:, :4][:, FACES].reshape(-1, 3)
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        return trimesh.Trimesh(self.points_um, faces[first[count == 1]], process=False)

    @cached_property
    def skfem(self) -> Any:
        """The same mesh for scikit-fem; curved elements stay curved."""
        from skfem import MeshTet, MeshTet2

        kind = MeshTet if self.tets.shape[1] == 4 else MeshTet2
        return kind(np.ascontiguousarray(self.points_um.T), np.ascontiguousarray(self.tets.T))

    @cached_property
    def det_j(self) -> NDArray[np.float64]:
        """Determinant of the Jacobian (m, q) of each element at the quadrature points of the analysis [um^3]."""
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
            raise MeshError(f"no face lies flat on the lowest plane: it stands on its base with {'xyz'[self.up]} up.")
        return flat

    def check(self) -> "TetMesh":
        """Return the mesh if its elements and its surface are sound and it is one body.

        Raises:
            MeshError: elements are flat, inverted or overlap, nodes not merged, bodies several, or the surface is open.
        """
        number = f"of the {len(self.tets)} tetrahedra"
        edges = np.diff(self.corners, axis=1)
        flat = np.abs(np.linalg.det(edges)) <= FLAT**2 * np.linalg.norm(edges, axis=2).max(axis=1) ** 3
        bent = np.zeros_like(flat) if flat.any() else np.any(self.det_j <= 0, axis=1)
        for bad, what in ((flat, "flat: they have no volume"), (bent, "inverted or bent too far")):
            if bad.any():
                raise MeshError(f"{int(bad.sum())} {number} are {what} (the first is number {int(np.argmax(bad))}).")
        faces = self.tets[:, :4][:, FACES].reshape(-1, 3)
        turned = np.linalg.det(np.eye(3)[np.argsort(faces, axis=1)])  # 1 or -1 by the sense of its corners
        _, face, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
        folded = (np.abs(np.bincount(face, turned)) > 0.5) & (count > 1)
        if folded.any():
            raise MeshError(f"tetrahedra overlap at {int(folded.sum())} faces: both neighbours lie on the same side.")
        skin = self.points_um[np.unique(self.surface.faces)]
        double = len(cKDTree(skin).query_pairs(SAME_PLACE * float(np.ptp(skin, axis=0).max())))
        if double:
            raise MeshError(
                f"{double} pairs of corners lie at the same place and are not one, so that nothing holds the elements "
                "together there: merge the nodes (gmsh: Mesh.removeDuplicateNodes)."
            )
        ends = self.tets[:, np.array(EDGES)].reshape(-1, 2)
        links = sp.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(self.points_um),) * 2)
        _, number = connected_components(links, directed=False)
        bodies = len(np.unique(number[self.tets[:, 0]]))
        if bodies > 1:
            raise MeshError(f"{bodies} bodies share no nodes: analyse one at a time, or join them.")
        if not self.surface.is_watertight:
            raise MeshError("the mesh's outer surface is open or branched: neighbouring elements must share faces.")
        return self

    @cached_property
    def quality(self) -> Quality:
        """Shapes of the elements."""
        x = self.corners
        volume = np.maximum(np.linalg.det(x[:, 1:] - x[:, :1]), 0) / 6
        length2 = sum(((x[:, i] - x[:, j]) ** 2).sum(axis=1) for i, j in EDGES)
        ratio = 12 * np.cbrt(3 * volume) ** 2 / length2
        relative = self.det_j.min(axis=1) / self.det_j.mean(axis=1)
        return Quality(float(ratio.min()), float(ratio.mean()), float(relative.min()))


@dataclass(frozen=True)
class MeshSize:
    """Element sizes [um]: far from anything, at the nucleus, at the clamped rim; and the width of the transition."""

    size: float = 3.5
    nucleus: float = 1.225
    rim: float = 2.1
    transition: float = 8.0

    @classmethod
    def of(cls, size: float) -> "MeshSize":
        """The usual proportions: fine where stiff cytoplasm shakes a soft nucleus and where the clamped rim strains.

        Raises:
            SettingError: the size is not a positive number.
        """
        if not (np.isfinite(size) and size > 0):
            raise SettingError(f"the element size must be a positive number of um, not {size}.")
        return cls(size, 0.35 * size, 0.6 * size)

    def coarser(self, factor: float) -> "MeshSize":
        """All sizes times `factor`; the transition stays."""
        return MeshSize(self.size * factor, self.nucleus * factor, self.rim * factor, self.transition)


def unknowns(dome: Dome, size: MeshSize) -> float:
    """About how many unknowns a mesh will have, by the integral of 1 / h^3 over fixed random points and the surface."""
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
    h = np.min([near + (size.size - near) * np.minimum(d / size.transition, 1) for d, near in distances], axis=0)
    surface = 2 * np.pi * dome.length * dome.width / 4
    return float(PER_CUBE * dome.volume_um3 * np.mean(1 / h**3) + PER_SQUARE * surface / size.size**2)


def refuse_above_limit(count: Callable[[float], float], size: float) -> None:
    """Refuse a mesh of more than `LIMIT` unknowns; `count` gives them at the sizes times a factor.

    Raises:
        SettingError: with the number and an element size that would do.
    """
    if count(1.0) <= LIMIT:
        return
    valid = np.ceil(size * _factor(count, LIMIT) * 100) / 100
    raise SettingError(
        f"an element size of {size:g} um needs about {count(1.0):.2g} unknowns, more than the {LIMIT} that fit into "
        f"some 4 GB of memory: take {valid:g} um or more."
    )


def _factor(count: Callable[[float], float], most: int) -> float:
    """By what element sizes must grow, 1 at least, so that `count` gives at most so many unknowns."""
    factor = max(1.0, float(np.cbrt(count(1.0) / most)))  # enough if all of it were volume
    while count(factor) > most:
        factor *= 1.05
    return factor


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
    store = Store(cache or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fasbody" / "cell")
    name = f"{key(program(__name__), astuple(dome), astuple(size))}.npz"
    stored, _ = store.load(name, _unpacked)
    if stored is not None:
        return stored
    refuse_above_limit(lambda factor: unknowns(dome, size.coarser(factor)), size.size)
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
    """Fill a closed surface [um], which may have cavities, with tetrahedra; `inner` encloses the nucleus.

    The triangles give the geometry only: gmsh divides it into patches at edges sharper than an angle of `PATCHES`,
    which are meshed separately. The first angle that gives sound elements and the volume is taken.

    Args:
        outer: of the body.
        inner: of the nucleus.
        size: element sizes, None is `default_size`, or as much smaller as the surface needs.

    Raises:
        SettingError: the size needs more than `LIMIT` unknowns.
        MeshError: a surface is open or branched, the inner one is not inside, gmsh cannot fill it, or elements of this
            size lose a part of it.
    """
    _check_closed("", outer)
    _check_pieces(outer)
    if inner is not None:
        _check_closed("nucleus' ", inner)
        if not ((inner.bounds[0] > outer.bounds[0]) & (inner.bounds[1] < outer.bounds[1])).all():
            raise MeshError("the nucleus' surface is not inside the other.")
    used = size or default_size(outer)
    while True:
        refuse_above_limit(partial(_filled_by, outer, used.size), used.size)
        mesh = fill(outer, used, inner)
        if strays(outer, mesh) <= STRAY * used.size:
            return mesh, used
        if size is not None:
            raise MeshError("elements of this size lose a part of the surface: take smaller ones.")
        used = used.coarser(FINER)


def strays(surface: "trimesh.Trimesh", mesh: TetMesh) -> float:
    """Largest distance [um] of a vertex from the corners, mid-edges and centres of a mesh's outer triangles."""
    corners = mesh.surface.triangles
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    points = np.concatenate([corners, middles, corners.mean(axis=1, keepdims=True)], axis=1).reshape(-1, 3)
    return float(cKDTree(points).query(surface.vertices)[0].max())


def fill(
    outer: "trimesh.Trimesh", size: MeshSize, inner: "trimesh.Trimesh | None" = None, tolerance: float = VOLUME_CHANGE
) -> TetMesh:
    """The same for sound surfaces, by the best of the `PATCHES`; the volume may change by a share `tolerance`."""
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
            failure = MeshError(f"elements of this size change its volume by {changed:.1%}: take smaller ones.")
        elif best is None or mesh.quality.mean_ratio_min > best.quality.mean_ratio_min:
            best = mesh
        if best is not None and best.quality.mean_ratio_min > SLIVER:
            return best
    if best is None:
        raise failure
    return best


def default_size(surface: "trimesh.Trimesh") -> MeshSize:
    """Half the thickness of the plate with this volume and area, or what gives `LEAST` to `DEFAULT` unknowns."""
    size = volume(surface) / float(surface.area)
    while filled(surface, size) < LEAST:
        size *= 0.97
    return MeshSize.of(size * _factor(partial(_filled_by, surface, size), DEFAULT))


def volume(surface: "trimesh.Trimesh") -> float:
    """Volume that is enclosed, without the cavities [um^3]."""
    parts = sorted((abs(float(part.volume)) for part in surface.split(only_watertight=False)), reverse=True)
    return parts[0] - sum(parts[1:])


def rounded(surface: "trimesh.Trimesh") -> float:
    """Share of its volume between flat triangles and a smooth surface through their corners.

    Edges up to the first angle of `PATCHES` count as round: one that turns by phi between triangles of areas A and B
    has phi (A^2 + B^2) / (6 L) beside it, exactly so on evenly cut cylinders and spheres.
    """
    turn = surface.face_adjacency_angles
    turn = np.where(turn < np.radians(PATCHES[0]), turn, 0.0)
    squares = (surface.area_faces[surface.face_adjacency] ** 2).sum(axis=1)
    length = np.linalg.norm(np.diff(surface.vertices[surface.face_adjacency_edges], axis=1)[:, 0], axis=1)
    return float((turn * squares / (6 * length)).sum()) / volume(surface)


def filled(surface: "trimesh.Trimesh", size: float) -> float:
    """About how many unknowns elements of one size [um] in a surface have, as counted on beams, plates and bones."""
    return 6.2 * volume(surface) / size**3 + 23.5 * float(surface.area) / size**2


def _filled_by(surface: "trimesh.Trimesh", size: float, factor: float) -> float:
    return filled(surface, size * factor)


def _check_closed(whose: str, surface: "trimesh.Trimesh") -> None:
    _, count = np.unique(surface.edges_sorted, axis=0, return_counts=True)
    for many, what in ((count > 2, "branches: {} edges belong to more than two triangles"),
                       (count == 1, "is not closed: {} edges belong to one triangle only")):  # fmt: skip
        if many.any():
            raise MeshError(f"the {whose}surface {what.format(int(many.sum()))}.")
    if not surface.is_winding_consistent:
        raise MeshError(f"the {whose}surface is inside out in places: neighbouring triangles face opposite sides.")


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
    """Whether a closed surface goes round a point, by its solid angle (Van Oosterom and Strackee 1983)."""
    a, b, c = np.moveaxis(surface.triangles - point, 1, 0)
    x, y, z = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = x * y * z + sum(np.einsum("ij,ij->i", p, q) * r for p, q, r in ((a, b, z), (b, c, x), (c, a, y)))
    return bool(abs(np.arctan2(above, below).sum()) > np.pi)


def _fill(surfaces: "list[trimesh.Trimesh]", size: MeshSize, angle: float) -> TetMesh:
    with _gmsh() as gmsh:
        first = 1
        for tag, surface in enumerate(surfaces, start=1):
            gmsh.model.addDiscreteEntity(2, tag)
            numbers = np.arange(first, first + len(surface.vertices))
            gmsh.model.mesh.addNodes(2, tag, numbers, np.asarray(surface.vertices).ravel())
            gmsh.model.mesh.addElementsByType(tag, 2, [], numbers[np.asarray(surface.faces)].ravel())
            first += len(surface.vertices)
        gmsh.model.mesh.classifySurfaces(np.radians(angle), True, True, np.pi)
        gmsh.model.mesh.createGeometry()
        patches = [tag for _, tag in gmsh.model.getEntities(2)]
        inside = [tag for tag in patches if len(surfaces) > 1 and _on(gmsh, tag, surfaces[1])]
        loops = [gmsh.model.geo.addSurfaceLoop([tag for tag in patches if tag not in inside])]
        loops += [gmsh.model.geo.addSurfaceLoop(inside)] if inside else []
        body = gmsh.model.geo.addVolume(loops)
        nucleus = [gmsh.model.geo.addVolume(loops[1:])] if inside else []
        gmsh.model.geo.synchronize()
        constant = gmsh.model.mesh.field.add("Constant")
        gmsh.model.mesh.field.setNumbers(constant, "VolumesList", nucleus)
        gmsh.model.mesh.field.setNumbers(constant, "SurfacesList", inside)
        gmsh.model.mesh.field.setNumber(constant, "VIn", size.nucleus)
        gmsh.model.mesh.field.setNumber(constant, "VOut", size.size)
        _sizes_by(gmsh, constant)
        gmsh.model.mesh.generate(3)
        return _collect(gmsh, [body], nucleus)


def _on(gmsh: Any, patch: int, surface: "trimesh.Trimesh") -> bool:
    """Whether a patch is one of this surface."""
    _, xyz, _ = gmsh.model.mesh.getNodes(2, patch, includeBoundary=True)
    away = cKDTree(surface.vertices).query(np.asarray(xyz).reshape(-1, 3))[0]
    return bool(away.max() < SAME_PLACE * float(surface.extents.max()))


def _sizes_by(gmsh: Any, field: int) -> None:
    """Element sizes come from this field and nothing else."""
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    for name in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{name}", 0)


def _unbend(mesh: TetMesh) -> TetMesh:
    """Straighten, step by step, the edges of elements that their curved faces squash or invert.

    gmsh's high-order optimisation would do it, but aborts the whole process where it does not succeed.
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
        return _unbend(_collect(gmsh, [ball], [])).check()


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
    return TetMesh(xyz.reshape(-1, 3)[used], renumbered.reshape(-1, 10), np.concatenate(region))


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
        raise MissingPackageError("gmsh", "cell", str(error), f"apt-get install {SYSTEM}") from error
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for name, value in (("General.Terminal", 0), ("General.NumThreads", 1), ("Mesh.ElementOrder", 2),
                            ("Mesh.Algorithm3D", 1)):  # fmt: skip
            gmsh.option.setNumber(name, value)
        yield gmsh
    except MeshError:
        raise
    except Exception as error:  # gmsh raises nothing more specific
        raise MeshError(
            f"gmsh cannot mesh this body ({str(error).strip()}): look whether its surface crosses itself, or take "
            "another element size."
        ) from error
    finally:
        gmsh.finalize()
