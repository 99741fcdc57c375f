"""Any body: textbook answers from files, six rigid motions, parts by number and name, a sentence for each refusal."""

import json
import re
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
import scipy.sparse.linalg as spla
import trimesh
from matplotlib.text import Text
from typer.testing import CliRunner

from fasbody.cell.__main__ import app
from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.body import UNITS, Body, BodyModes, body_modes, bones, read_body
from fasbody.cell.companion import pair, refined
from fasbody.cell.figures import mode_shapes
from fasbody.cell.materials import Material
from fasbody.cell.mesh import FACES
from fasbody.cell.mesher import LIMIT, default_size, fill
from fasbody.cell.modal import CellModel, solve
from fasbody.cell.viscoelastic import ReducedCell, StandardLinearSolid, damped_modes, force_response, point_load
from fasbody.exceptions import InputFileError, SettingError
from simulator.bodies import block, box, cell, lamb_torsional, timoshenko, two_part_rod

SOFT, STIFF = Material(2e6, 0.0, 200.0), Material(3e7, 0.0, 1200.0)
BONE = Material(7.3e9, 0.3, 1500.0)


@pytest.fixture(scope="module")
def rod(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rod of 10 x 10 x 40 mm along x, its first 16 mm region 3, the rest region 7, its end at x = 0 triangles 9."""
    across = np.linspace(0, 10, 2)
    mesh = box(np.linspace(0, 40, 11), across, across, up=0)
    tag = np.where(mesh.corners[:, :, 0].mean(axis=1) < 16, 3, 7)
    file = tmp_path_factory.mktemp("bodies") / "rod.vtu"
    cells = [("tetra", mesh.tets), ("triangle", mesh.base)]
    meshio.Mesh(mesh.points_um, cells, cell_data={"region": [tag, np.full(len(mesh.base), 9)]}).write(file)
    return file


def test_a_rod_of_two_materials(rod: Path) -> None:
    body = read_body(rod, up="x")
    found = body_modes(body, {"3": SOFT, None: STIFF}, "base", count=8)
    axial = [f for f, d in zip(found.frequencies_hz, found.descriptions, strict=True) if d.energy[0] > 0.999]
    assert axial[0] == pytest.approx(two_part_rod((SOFT, STIFF), (0.016, 0.024)), rel=1e-4)
    document = json.loads(json.dumps(found.document(), default=np.ndarray.tolist))
    assert [part["volume_m3"] for part in document["regions"]] == pytest.approx([1.6e-6, 2.4e-6])
    assert document["mass_kg"] == pytest.approx(200 * 1.6e-6 + 1200 * 2.4e-6)
    assert found.modes.rigid_hz.size == 0
    assert np.sum([list(d.parts.values()) for d in found.descriptions], axis=1) == pytest.approx(1.0)


def test_triangles_of_the_file_hold_like_the_base(rod: Path) -> None:
    body = read_body(rod)
    one = body_modes(body, {None: SOFT}, "region", part="9", count=3).frequencies_hz
    two = body_modes(read_body(rod, up="x"), {None: SOFT}, "base", count=3).frequencies_hz
    assert one == pytest.approx(two, rel=1e-9)
    held = assemble(body.mesh, held=body.holding("region", "3")[0])
    assert held.nodes_um[held.free][:, 0].min() > 16e3  # all of the first part stands still, its inside too


@pytest.fixture(scope="module")
def sesamoid() -> BodyModes:
    return body_modes(read_body("sesamoid_medial", size=2.0), {None: BONE}, count=4)


def test_a_free_bone_skips_six_rigid_motions(sesamoid: BodyModes) -> None:
    """Against scipy's own shift-invert of K and M, rigid motions and all."""
    model = sesamoid.model
    first = (2 * np.pi * sesamoid.frequencies_hz[0]) ** 2
    found = spla.eigsh(model.K.tocsc(), 12, model.M.tocsc(), sigma=-first, return_eigenvectors=False)
    elastic = np.sort(found[found > 0.1 * first])[:4]  # of six equal squares scipy misses one
    assert sesamoid.frequencies_hz == pytest.approx(np.sqrt(elastic) / (2 * np.pi), rel=1e-6)
    assert len(sesamoid.modes.rigid_hz) == 6
    assert sesamoid.modes.rigid_hz.max() < 1e-4 * sesamoid.frequencies_hz[0]
    assert "six rigid motions of the free body" in str(sesamoid) and "six rigid" in repr(sesamoid)
    assert np.abs(sesamoid.modes.participation).max() < 1e-9  # a free body's mode moves no centre of mass


def test_a_body_of_less_than_a_millimetre_may_have_another_unit(rod: Path) -> None:
    small = body_modes(read_body(rod, unit="um"), {None: SOFT}, count=2)
    assert "--unit m" not in str(small)  # its unit was chosen
    assert "--unit m" in str(replace(small, body=replace(small.body, unit="mm")))


@pytest.mark.parametrize("way", ["multigrid", "superlu"])
def test_ways_agree_on_a_free_body(sesamoid: BodyModes, way: str) -> None:
    again = body_modes(sesamoid.body, {None: BONE}, count=4, way=way)
    assert again.frequencies_hz == pytest.approx(sesamoid.frequencies_hz, rel=1e-9)


def test_bundled_bones_have_the_size_of_bones() -> None:
    assert "calcaneus" in bones()
    body = read_body("sesamoid_medial")
    assert (np.ptp(body.mesh.points_um, axis=0) / UNITS["mm"] < 20).all()


@pytest.mark.long
def test_obj_and_stl_give_the_same(tmp_path: Path) -> None:
    surface = trimesh.creation.box((40, 10, 12))
    found = []
    for suffix in ("stl", "obj"):
        surface.export(tmp_path / f"block.{suffix}")
        found.append(body_modes(read_body(tmp_path / f"block.{suffix}"), {None: SOFT}, "base", count=3).frequencies_hz)
    assert found[0] == pytest.approx(found[1], rel=0.02)  # the triangles come in another order


def two_cubes(folder: Path, numbers: tuple[int, int], base: int, names: dict[str, list[int]]) -> Path:
    """A .msh of a cube in two regions of these numbers, its base triangles of another."""
    mesh = box(*[np.linspace(0, 2, 3)] * 3)
    region = np.array(numbers)[(mesh.corners[:, :, 0].mean(axis=1) > 1).astype(int)]
    marks = [region, np.full(len(mesh.base), base)]
    content = meshio.Mesh(
        mesh.points_um, [("tetra", mesh.tets), ("triangle", mesh.base)],
        cell_data={"gmsh:physical": marks, "gmsh:geometrical": marks},
        field_data={name: np.array(group) for name, group in names.items()},
    )  # fmt: skip
    content.write(folder / "two.msh", file_format="gmsh22")
    return folder / "two.msh"


def of_region(body: Body, number: int) -> np.ndarray:
    """Faces of all tetrahedra of a region of the file: what holding it holds."""
    return body.mesh.tets[body.mesh.region == body.tags.index(number)][:, FACES].reshape(-1, 3)


NAMED_BY_DIMENSION = {"heel": [1, 3], "sole": [2, 3], "floor": [1, 2]}


def test_a_number_of_triangles_and_of_tetrahedra(tmp_path: Path) -> None:
    """gmsh numbers groups by dimension: surface 1 is not volume 1, and a surface's name no region of a material."""
    file = two_cubes(tmp_path, (1, 2), 1, NAMED_BY_DIMENSION)
    body = read_body(file)
    assert body.by_region("material", {"1": SOFT, "sole": STIFF}) == (SOFT, STIFF)
    assert body.by_region("material", {"heel": SOFT, None: STIFF}) == (SOFT, STIFF)
    for held in ("floor", "triangles:1", "triangles:floor"):
        assert np.array_equal(body.holding("region", held)[0], body.mesh.faces[1])
    for held in ("heel", "tetrahedra:1", "tetrahedra:heel"):
        assert np.array_equal(body.holding("region", held)[0], of_region(body, 1))
    for given, says in (
        ({"floor": SOFT, None: STIFF}, "no region 'floor'.*: tetrahedra 1 .heel., tetrahedra 2 .sole."),
        ({"sole": SOFT, "2": STIFF, None: SOFT}, "region 2 of .* has one already"),
        ({"6": SOFT, None: SOFT}, "no region '6'"),
        ({"1": SOFT}, "region 2 of .* has none: give --material 2=VALUES"),
    ):
        with pytest.raises(SettingError, match=says):
            body.by_region("material", given)
    for held, says in (
        ("1", "'1' may be triangles:1 or tetrahedra:1"),
        ("triangles:2", "no region 'triangles:2'"),
        ("triangles:heel", "no region 'triangles:heel'"),
    ):
        with pytest.raises(SettingError, match=says):
            body.holding("region", held)
    file.write_bytes(file.read_bytes().replace(b'2 1 "floor"', b'2 1 "heel"'))  # meshio keeps one of them
    with pytest.raises(SettingError, match="'heel' may be triangles:1 or tetrahedra:1"):
        read_body(file).holding("region", "heel")


def test_a_group_that_is_named_by_a_number(tmp_path: Path) -> None:
    """`--held 7` is the group of that name; where another has the number, the user says which."""
    body = read_body(two_cubes(tmp_path, (3, 7), 5, {"9": [5, 2], "7": [3, 3]}))
    with pytest.raises(SettingError, match=r"'7' may be tetrahedra:3 or tetrahedra:7"):
        body.holding("region", "7")
    for number in (3, 7):
        assert np.array_equal(body.holding("region", f"tetrahedra:{number}")[0], of_region(body, number))
    found = body_modes(body, {None: STIFF}, "region", part="9", count=1)
    assert np.array_equal(body.holding("region", "9")[0], body.mesh.faces[5])
    assert found.document()["held"] == {"number": 5, "name": "9", "kind": "triangles"}
    assert "held at triangles 5 (9): " in str(found)


def test_each_unsound_body_gets_its_sentence(tmp_path: Path) -> None:
    mesh = box(*[np.linspace(0, 1, 2)] * 3)
    file = tmp_path / "body.vtu"

    def written(points: np.ndarray, tets: np.ndarray) -> Path:
        meshio.Mesh(points, [("tetra", tets)]).write(file)
        return file

    torn = mesh.points_um[mesh.tets].reshape(-1, 3), np.arange(mesh.tets.size).reshape(-1, 4)
    with pytest.raises(InputFileError, match=r"pairs of corners lie at the same place.*merge the nodes"):
        read_body(written(*torn))
    far = np.vstack([mesh.points_um, mesh.points_um + 5]), np.vstack([mesh.tets, mesh.tets + len(mesh.points_um)])
    with pytest.raises(InputFileError, match="2 bodies share no nodes"):
        read_body(written(*far))
    two = trimesh.creation.box((1, 1, 1)) + trimesh.creation.box((1, 1, 1)).apply_translation([3, 0, 0])
    two.export(tmp_path / "two.stl")
    with pytest.raises(InputFileError, match="2 separate pieces"):
        read_body(tmp_path / "two.stl")
    turn = np.array([[1, 1, 0], [-1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    turned = Body("turned", *[replace(mesh, points_um=mesh.points_um @ turn.T)] * 2)
    with pytest.raises(InputFileError, match=r"no face lies flat on the lowest plane.*--support free"):
        turned.holding("base")
    assert len(turned.holding("free")[0]) == len(FREE)


BONE_OF = ["--material", "1,0,1"]


@pytest.mark.parametrize(
    ("arguments", "setting"),
    [
        (["--material", "1,0"], "material"),
        (["--material", "1,0.5,1"], "material"),
        (["--material", "2=1,0,1"], "material"),
        ([*BONE_OF, *BONE_OF], "material"),
        (["--material", "0=1,0,1", "--material", "0=2,0,1"], "material"),
        ([*BONE_OF, "--support", "glued"], "support"),
        ([*BONE_OF, "--support", "region"], "held"),
        ([*BONE_OF, "--support", "region", "--held", "0"], "held"),
        ([*BONE_OF, "--support", "region", "--held", "5"], "held"),
        ([*BONE_OF, "--held", "0"], "held"),
        ([*BONE_OF, "--unit", "inch"], "unit"),
        ([*BONE_OF, "--up", "w"], "up"),
        ([*BONE_OF, "--size", "0"], "size"),
    ],
)
def test_bad_input_names_its_option(arguments: list[str], setting: str) -> None:
    found = CliRunner().invoke(app, ["modes", "sesamoid_medial", "--size", "2", *arguments])
    assert isinstance(found.exception, SettingError) and found.exception.setting == setting


def test_no_such_body(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="or name a bone: calcaneus"):
        read_body("no_bone")
    with pytest.raises(InputFileError, match=r"is a folder; it holds none that ends in \.vtu"):
        read_body(tmp_path)
    (tmp_path / "sole.stl").touch()
    with pytest.raises(InputFileError, match=r"is a folder; name a file, such as .*sole\.stl"):
        read_body(tmp_path)
    for missing in (tmp_path / "x.stl", tmp_path / "x"):
        with pytest.raises(InputFileError, match=r"there is no such file; name a \.vtu") as found:
            read_body(missing)
        assert "calcaneus" not in str(found.value)


@pytest.mark.long
def test_a_size_that_loses_the_edges_of_a_sole_names_one_that_does_not(tmp_path: Path) -> None:
    trimesh.creation.box((100, 40, 5)).export(tmp_path / "sole.stl")
    with pytest.raises(InputFileError, match=r"use --size 2\.1 \(mm\) or less, half of its mean thickness"):
        read_body(tmp_path / "sole.stl", size=5.0)
    assert read_body(tmp_path / "sole.stl", size=2.1).size_um == 2100


def test_large_errors_come_with_advice(sesamoid: BodyModes) -> None:
    def last(error: float, **changes: object) -> str:
        body = replace(sesamoid.body, **changes)  # type: ignore[arg-type]
        return replace(sesamoid, body=body, errors=np.full(4, error)).heading()[1][-1]

    assert "errors below" not in last(0.049)
    size, unknowns = re.findall(r"--size (\S+) \(mm; about (\d+) unknowns\)", last(0.1, changed=0.0))[0]
    assert float(size) == pytest.approx(1.0, rel=0.05)  # half of 2 mm, for half of the error
    assert sesamoid.model.assembly.dof < int(unknowns) < LIMIT
    assert "mesh of smaller elements" in last(0.1, changed=0.0, size_um=None)
    assert "does not fit" in last(0.1, changed=0.0, size_um=100.0)
    assert "errors below" not in last(0.1, changed=0.06)  # which no element size mends


def test_the_progress_of_both_meshes_is_told(rod: Path) -> None:
    told: list[tuple[str, int, int]] = []
    body_modes(read_body(rod), {None: SOFT}, count=1, advance=lambda *step: told.append(step))
    assert [(done, total) for _, done, total in told] == [(1, 3), (2, 3)]
    assert "finer" in told[0][0] and "coarser" in told[1][0]


def test_the_picture_of_modes_cuts_no_words(sesamoid: BodyModes) -> None:
    close = replace(sesamoid.modes, frequencies_hz=np.array([1947.0, 1951.0, 1960.0, 1967.0]))
    figure = mode_shapes(replace(sesamoid, modes=close))
    figure.draw_without_rendering()
    page = figure.bbox
    words = [*figure.texts, figure.axes[-1].xaxis.label, *(axes.title for axes in figure.axes)]
    words += [text for axes in figure.axes for text in axes.findobj(Text) if text.get_text().startswith("mode")]
    boxes = [text.get_window_extent() for text in words if text.get_text()]
    assert len(boxes) == 7  # head, scale, caption, four titles
    assert all(page.x0 <= b.x0 and b.x1 <= page.x1 and page.y0 <= b.y0 and b.y1 <= page.y1 for b in boxes)
    titles = [text.get_text().split(",")[0] for text in words if text.get_text().startswith("mode")]
    assert titles == [f"mode {i}: {f} kHz" for i, f in enumerate(("1.947", "1.951", "1.96", "1.967"), 1)]


def test_the_command_writes_its_files(rod: Path, tmp_path: Path) -> None:
    options = ["--support", "base", "--up", "x", "--material", "2e6,0,200", "--modes", "3", "--out", str(tmp_path)]
    found = CliRunner().invoke(app, ["modes", str(rod), "--json", *options])
    assert found.exit_code == 0, found.exception
    document = json.loads(found.stdout)
    assert json.loads((tmp_path / "body.json").read_text()) == document
    assert {file.name for file in tmp_path.iterdir()} == {"body.json", "body.vtu", "body.npz", "modes.png"}
    again = meshio.read(tmp_path / "body.vtu")
    assert np.ptp(again.points, axis=0) == pytest.approx([40, 10, 10])
    assert sorted(set(again.cell_data["region"][0])) == [3, 7]
    assert max(document["estimated_error"]) < 0.1
    with np.load(tmp_path / "body.npz") as stored:  # the page's y is the body's x
        assert np.ptp(stored["vertices_um"], axis=0) == pytest.approx([1e4, 4e4, 1e4])


def _surface(folder: Path, mesh: trimesh.Trimesh) -> BodyModes:
    mesh.export(folder / "body.stl")
    return body_modes(read_body(folder / "body.stl"), {None: BONE}, count=5)


@pytest.mark.long
def test_a_beam_of_twelve_triangles_swings_as_timoshenko_says(tmp_path: Path) -> None:
    """Its own triangles gave 54 unknowns and a third too much."""
    trimesh.creation.box((100, 10, 10)).export(tmp_path / "beam.stl")
    straight = Material(7.3e9, 0.0, 1500.0)
    found = body_modes(read_body(tmp_path / "beam.stl"), {None: straight}, count=2)
    theory = timoshenko(straight.E, straight.rho, 0.1, 0.01, held=False)
    assert (np.abs(found.frequencies_hz / theory - 1) < 0.001).all()
    assert f"  {100 * found.errors[0]:.2g}  " in str(found).splitlines()[2]


@pytest.mark.long
def test_a_shell_with_a_chamber_has_the_error_that_is_printed(tmp_path: Path) -> None:
    ball, room = (trimesh.creation.icosphere(3, radius) for radius in (10.0, 6.0))
    surface = trimesh.util.concatenate([ball, room])
    found = _surface(tmp_path, surface)
    fine = fill(surface.copy().apply_scale(1e3), default_size(surface.apply_scale(1e3)).coarser(0.7))
    exact = solve(CellModel(assemble(fine, held=FREE), (BONE,)), 5).frequencies_hz
    assert (np.abs(found.frequencies_hz / exact - 1) < found.errors).all()
    assert found.errors.max() < 0.03


@pytest.mark.long
def test_the_printed_error_of_a_ball_of_flat_triangles_holds(tmp_path: Path) -> None:
    """Beside Lamb's sphere, 0.9 % of whose volume 1,280 triangles leave out; elements alone err by a fifth of that."""
    found = _surface(tmp_path, trimesh.creation.icosphere(3, 10.0))
    speed = np.sqrt(BONE.E / (2 * (1 + BONE.nu) * BONE.rho))
    off = np.abs(found.frequencies_hz / (lamb_torsional(2) * speed / (2 * np.pi * 0.01)) - 1)
    assert found.errors.max() - found.body.changed < off.max() < found.errors.min()
    assert "0.88% of each error is due to the flat triangles of the surface" in str(found)
    assert found.document()["shape_error"] == found.body.changed


@pytest.mark.parametrize("curved", [False, True])
def test_a_finer_mesh_is_the_same_body(curved: bool) -> None:
    mesh = cell(size=8.0).mesh if curved else block((2, 2, 2), nucleus_below=1.0, seed=3)
    marked = replace(mesh, faces={5: mesh.base})
    fine = refined(marked).check()
    assert len(fine.tets) == 8 * len(mesh.tets)
    assert fine.volume_um3 == pytest.approx(mesh.volume_um3, rel=1e-4)
    one, two = (trimesh.Trimesh(m.points_um, m.faces[5], process=False).area for m in (marked, fine))
    assert len(fine.faces[5]) == 4 * len(mesh.base)
    assert two == pytest.approx(one, rel=5e-3 if curved else 1e-12)
    assemble(fine, held=fine.faces[5])  # every one is a face of it


@pytest.mark.parametrize(("limit", "finer"), [(8 * 3 * 125 - 1, False), (8 * 3 * 125, True)])
def test_a_large_mesh_gets_a_coarser_companion(limit: int, finer: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block of 2 x 2 x 2 parts has 125 nodes of quadratic elements."""
    monkeypatch.setattr("fasbody.cell.companion.REFINED", limit)
    mesh = replace(block((2, 2, 2), nucleus_below=1.0), faces={5: block((2, 2, 2)).base})
    fine, rough = pair(mesh)
    assert (rough is mesh) == finer and (fine is mesh) != finer
    assert set(rough.region) == {0, 1}
    bottom = rough.points_um[rough.faces[5]]
    assert np.abs(bottom[..., 1]).max() < 1e-9


def test_a_free_body_under_a_force_agrees_with_the_full_matrices() -> None:
    body = assemble(block((1, 2, 1)), held=FREE)
    model = CellModel(body, (BONE,))
    solid = StandardLinearSolid(0.4, 1e-9)
    f = 0.7 * solve(model, 1).frequencies_hz[0]
    reduced = ReducedCell.of(model, 40)
    w, load = 2 * np.pi * f, point_load(model)
    u = spla.spsolve((solid(1j * w) * model.K - w**2 * model.M).tocsc().astype(complex), load)
    found = force_response(reduced, (solid,), np.array([f])).accelerance[:, 0]
    assert found == pytest.approx(-(w**2) * np.diag(load.T @ u), rel=1e-3)
    slow = force_response(reduced, (solid,), np.array([1e-4 * f])).accelerance[:, 0]
    assert (slow.real > 1 / model.mass_kg).all()  # a force off the centre of mass turns the body, too
    damped = damped_modes(reduced, (solid,), 3)
    assert damped.elastic_hz == pytest.approx(solve(model, 3).frequencies_hz, rel=1e-6)


@pytest.mark.parametrize(("support", "says"), [("base", "resonance"), ("free", "driven by a force")])
def test_any_body_is_shaken(rod: Path, tmp_path: Path, support: str, says: str) -> None:
    options = ["--up", "x", "--material", "2e6,0,200", "--relaxation", "7=0.3,0.001", "--relaxation", "0.5,0.01"]
    found = CliRunner().invoke(
        app, ["response", str(rod), "--support", support, *options, "--modes", "6", "--out", str(tmp_path)]
    )
    assert found.exit_code == 0, found.exception
    assert says in found.stdout and "damping" in found.stdout
    document = json.loads((tmp_path / "shake.json").read_text())
    assert min(document["damped_modes"]["damping_ratio"]) > 0
    assert (tmp_path / "shake.png").stat().st_size > 1000
