"""Meshes: closed forms of volume, conformity, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

import mjcf
from fasbody.cell.assembly import assemble
from fasbody.cell.dome import Dome, Nucleus
from fasbody.cell.mesh import EDGES, NUCLEUS, MeshSize, TetMesh
from fasbody.cell.mesher import DEFAULT, STRAY, default_size, dome_mesh, filled, sized_mesh, strays, unknowns
from fasbody.cell.meshfile import upward
from fasbody.cell.surface import rounded
from fasbody.exceptions import MeshError, SettingError
from simulator.bodies import CACHE, block, cell


def surface_mesh(*surfaces: trimesh.Trimesh, size: MeshSize | None = None) -> TetMesh:
    """The mesh that fills a surface."""
    return sized_mesh(*surfaces, *[None] * (2 - len(surfaces)), size)[0]


@pytest.mark.parametrize("profile", ["ellipsoid", "cap"])
def test_volumes_agree_with_the_closed_forms(profile: str) -> None:
    dome = Dome(profile=profile)
    assembly = assemble(dome_mesh(dome, MeshSize.of(5.0), cache=CACHE))
    assert assembly.volume_um3 == pytest.approx(dome.volume_um3, rel=5e-4)
    assert assembly.regions[NUCLEUS].volume_um3 == pytest.approx(Nucleus().volume_um3, rel=5e-3)


def test_mesh_is_conforming_closed_and_quadratic() -> None:
    mesh = cell().mesh
    assert mesh.surface.is_watertight
    inside = mesh.region == NUCLEUS
    nucleus = TetMesh(mesh.points_um, mesh.tets[inside], mesh.region[inside])
    assert nucleus.surface.is_watertight  # so cytoplasm and nucleus share their nodes: one hole, one plug
    shared = np.intersect1d(mesh.tets[inside], mesh.tets[~inside])
    assert set(np.unique(nucleus.surface.faces)) <= set(shared)
    ends = mesh.points_um[mesh.tets[:, np.array(EDGES)]]
    length = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)
    off = np.linalg.norm(mesh.points_um[mesh.tets[:, 4:]] - ends.mean(axis=2), axis=2)
    assert (off < 0.35 * length).all()  # a wrong node order puts mid-edge nodes far from their edges


def test_curved_nodes_lie_on_the_dome() -> None:
    mesh = cell().mesh
    level = Dome().level(mesh.points_um)
    assert level.max() == pytest.approx(1.0, abs=1e-6)


def test_quality_of_a_cube_cut_in_six() -> None:
    """Kuhn's tetrahedra: volume 1/6, squared edges 1, 1, 1, 2, 2, 3, so the mean ratio is 12 (1/2)^(2/3) / 10."""
    quality = block((1, 1, 1)).quality
    assert quality.mean_ratio_min == pytest.approx(1.2 * 0.5 ** (2 / 3))
    assert quality.det_j_min == pytest.approx(1.0)


def test_cache_returns_the_same_mesh_and_survives_damage(tmp_path: Path) -> None:
    dome, size = Dome(40.0, 30.0, nucleus=None), MeshSize.of(9.0)
    first = dome_mesh(dome, size, cache=tmp_path)
    (file,) = tmp_path.glob("*.npz")
    again = dome_mesh(dome, size, cache=tmp_path)
    assert (again.tets == first.tets).all()
    assert again.points_um == pytest.approx(first.points_um)
    file.write_bytes(b"damaged")
    assert (dome_mesh(dome, size, cache=tmp_path).tets == first.tets).all()


def test_inverted_elements_are_named() -> None:
    mesh = block()
    tets = mesh.tets.copy()
    tets[5] = tets[5][[1, 0, 2, 3]]
    with pytest.raises(MeshError, match=r"1 of the \d+ tetrahedra are inverted .*\(the first is number 5\)"):
        TetMesh(mesh.points_um, tets, mesh.region).check()


def test_hanging_cell_has_no_base() -> None:
    mesh = block()
    turn = np.array([[1, 1, 0], [-1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    with pytest.raises(MeshError, match="stands on its base with y up"):
        assemble(TetMesh(mesh.points_um @ turn.T, mesh.tets, mesh.region).check())


def test_closed_surfaces_are_filled() -> None:
    box = trimesh.creation.box((10, 8, 12)).subdivide().subdivide()
    ball = trimesh.creation.icosphere(2, 2.0)
    assembly = assemble(surface_mesh(box, ball))
    assert assembly.volume_um3 == pytest.approx(960.0, rel=1e-9)
    assert assembly.regions[NUCLEUS].volume_um3 == pytest.approx(ball.volume, rel=5e-3)


@pytest.mark.parametrize("size", [4.0, 2.0])
def test_surfaces_are_filled_at_the_size_asked_for(size: float) -> None:
    """Mean edge of the straight tetrahedra; the triangles of the box are 8 to 14 um long to begin with."""
    mesh = surface_mesh(trimesh.creation.box((10, 8, 12)), size=MeshSize.of(size))
    x = mesh.corners
    edges = np.concatenate([np.linalg.norm(x[:, i] - x[:, j], axis=1) for i, j in EDGES])
    assert edges.mean() == pytest.approx(size, rel=0.4)
    assert assemble(mesh).volume_um3 == pytest.approx(960.0, rel=1e-9)


def test_a_nucleus_surface_is_filled_finer_than_its_cell() -> None:
    ball = trimesh.creation.icosphere(1, 2.0)
    mesh = surface_mesh(trimesh.creation.box((10, 8, 12)), ball, size=MeshSize.of(4.0))
    assert assemble(mesh).regions[NUCLEUS].volume_um3 == pytest.approx(ball.volume, rel=0.02)
    edge = [np.linalg.norm(np.diff(mesh.corners[mesh.region == r], axis=1), axis=2).mean() for r in (0, 1)]
    assert edge[1] < 0.8 * edge[0]


def test_unknowns_are_foreseen_and_too_many_are_refused() -> None:
    for size in (6.0, 8.0):
        dof = 3 * len(cell(size=size).nodes_um)
        assert unknowns(Dome(), MeshSize.of(size)) == pytest.approx(dof, rel=0.15)
    with pytest.raises(SettingError, match=r"0\.05 um needs about .*e\+0.* unknowns.*: take [\d.]+ um or more"):
        dome_mesh(Dome(), MeshSize.of(0.05), cache=CACHE)
    with pytest.raises(SettingError, match=r"take [\d.]+ um or more"):
        surface_mesh(trimesh.creation.box((10, 8, 12)), size=MeshSize.of(0.05))


def test_a_plate_gets_two_elements_through_its_thickness_and_a_count_that_was_foreseen() -> None:
    plate = trimesh.creation.box((40, 2, 30))
    mesh = surface_mesh(plate)
    height = mesh.points_um[np.unique(mesh.tets[:, :4]), 1]  # of the corners: inner ones divide the thickness
    assert (np.abs(height) < 0.6).sum() > 0.15 * len(height)
    size = default_size(plate)
    assert size.size == pytest.approx(1.0, rel=0.2)
    assert 3 * len(mesh.points_um) == pytest.approx(filled(plate, size.size), rel=0.25)
    assert 3 * len(surface_mesh(plate, size=MeshSize.of(4.0)).points_um) < 10_000  # and no finer than asked for


def test_a_large_plate_gets_the_elements_that_fit() -> None:
    for side, fits in ((60, True), (90, False)):
        plate = trimesh.creation.box((side, 2, side))
        size = default_size(plate).size
        assert (size == pytest.approx(plate.volume / plate.area)) == fits
        assert filled(plate, size) <= DEFAULT


@pytest.mark.parametrize(("size", "keeps"), [(5e3, True), (8e3, False)])
def test_elements_that_lose_a_part_of_the_surface_are_refused(size: float, keeps: bool) -> None:
    """Elements of 8 mm cut a process off the heel bone, and with it its eighth mode."""
    with np.load(mjcf.asset("anatomy.npz")) as stored:
        bone = trimesh.Trimesh(10.0 * stored["calcaneus.vertices"], stored["calcaneus.faces"])
    if keeps:
        assert strays(bone, surface_mesh(bone, size=MeshSize.of(size))) < STRAY * size
        return
    with pytest.raises(MeshError, match="elements of this size lose a part of the surface"):
        surface_mesh(bone, size=MeshSize.of(size))


@pytest.mark.parametrize("sections", [16, 64])
def test_what_flat_triangles_leave_of_a_cylinder_is_its_closed_form(sections: int) -> None:
    surface = trimesh.creation.cylinder(5.0, 40.0, sections=sections)
    turn = 2 * np.pi / sections
    assert rounded(surface) == pytest.approx(turn / np.sin(turn) - 1, rel=0.01)


def test_sharp_edges_are_no_round_shape() -> None:
    """An octagonal bar turns by 45 degrees at its edges, one of ten sides by 36."""
    assert rounded(trimesh.creation.cylinder(5.0, 40.0, sections=8)) < 1e-6
    assert rounded(trimesh.creation.cylinder(5.0, 40.0, sections=10)) > 0.05


def test_a_closed_cavity_stays_empty() -> None:
    room = trimesh.creation.icosphere(3, 2.0)
    block = trimesh.creation.box((10, 8, 12))
    mesh = surface_mesh(trimesh.util.concatenate([block, room]), size=MeshSize.of(2.0))
    assert assemble(mesh).volume_um3 == pytest.approx(960.0 - room.volume, rel=1e-3)
    assert len(mesh.surface.split()) == 2


@pytest.mark.parametrize(
    ("height", "says"),
    [(-0.5, None), (0.0, "1 of the 2 tetrahedra are flat"), (0.5, "overlap at 1 face:")],
)
def test_a_tetrahedron_that_is_folded_over_its_neighbour(height: float, says: str | None) -> None:
    """The second apex moves from the far side of the common face through it to the near one."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.3, 0.3, height]])
    tets = upward(points, np.array([[0, 1, 2, 3], [0, 1, 2, 4]]))
    mesh = TetMesh(points, tets, np.zeros(2, np.int64))
    if says is None:
        assert mesh.check() is mesh
        return
    with pytest.raises(MeshError, match=says):
        mesh.check()


def test_open_or_misplaced_surfaces_are_refused() -> None:
    box = trimesh.creation.box((10, 8, 12))
    box.update_faces(np.arange(len(box.faces)) > 0)
    with pytest.raises(MeshError, match=r"is not closed: 3 edges .* \(the first from \(.*\) to \(.*\) um\): mend"):
        surface_mesh(box)
    whole = trimesh.creation.box((10, 8, 12))
    fin = [*whole.faces[0][:2], len(whole.vertices)]
    branched = trimesh.Trimesh([*whole.vertices, [9, 9, 9]], [*whole.faces, fin], process=False)
    with pytest.raises(MeshError, match="the surface branches: 1 edge belongs to more than two triangles"):
        surface_mesh(branched)
    whole.faces[0] = whole.faces[0][::-1]
    with pytest.raises(MeshError, match="neighbouring triangles face opposite sides"):
        surface_mesh(trimesh.Trimesh(whole.vertices, whole.faces, process=False))
    with pytest.raises(MeshError, match="not inside"):
        surface_mesh(trimesh.creation.box((10, 8, 12)), trimesh.creation.icosphere(1, 5.0))


def test_element_size_must_be_positive() -> None:
    with pytest.raises(SettingError, match="element size"):
        MeshSize.of(-1.0)
