"""Meshes in and out: the same frequencies from a written file, regions by tag, and clear refusals."""

import json
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
import trimesh

from fasbody.cell.analysis import Analysis, analyse
from fasbody.cell.assembly import assemble
from fasbody.cell.materials import preset
from fasbody.cell.mesh import MeshSize, TetMesh
from fasbody.cell.meshfile import read_mesh, read_surface, write_browser, write_vtu
from fasbody.exceptions import InputFileError, SettingError
from simulator.bodies import block, cell

SI = preset("si")


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    return analyse(cell(size=8.0), None, SI, count=3)


def test_a_written_vtu_gives_the_same_frequencies(tmp_path: Path, analysis: Analysis) -> None:
    file = write_vtu(tmp_path / "cell.vtu", analysis)
    again = analyse(assemble(read_mesh(file)), None, SI, count=3)
    assert again.frequencies_hz == pytest.approx(analysis.frequencies_hz, rel=1e-9)
    data = meshio.read(file).point_data
    assert sorted(data) == ["mode_01", "mode_02", "mode_03"]
    assert np.linalg.norm(data["mode_02"], axis=1).max() == pytest.approx(1.0)


def test_browser_file_holds_surface_modes_and_document(tmp_path: Path, analysis: Analysis) -> None:
    with np.load(write_browser(tmp_path / "cell.npz", analysis), allow_pickle=False) as stored:
        surface = trimesh.Trimesh(stored["vertices_um"], stored["faces"], process=False)
        nucleus = trimesh.Trimesh(stored["vertices_um"], stored["nucleus_faces"], process=False)
        assert surface.is_watertight
        assert surface.volume == pytest.approx(analysis.model.assembly.volume_um3, rel=0.06)
        assert nucleus.is_watertight
        assert stored["modes"].shape == (3, len(stored["vertices_um"]), 3)
        on_base = stored["vertices_um"][:, 1] < 1e-6
        assert (stored["modes"][:, on_base] == 0).all()
        assert json.loads(str(stored["document"]))["frequencies_hz"] == pytest.approx(stored["frequencies_hz"].tolist())


@pytest.mark.parametrize("suffix", ["msh", "vtu"])
def test_linear_tetrahedra_with_tags(tmp_path: Path, suffix: str) -> None:
    mesh = cored()
    name = "gmsh:physical" if suffix == "msh" else "region"
    data = {name: [mesh.region + 4]}
    if suffix == "msh":
        data["gmsh:geometrical"] = [mesh.region + 1]
    content = meshio.Mesh(mesh.points_um / 1000, [("tetra", mesh.tets)], cell_data=data)
    content.write(tmp_path / f"own.{suffix}", **({"file_format": "gmsh22"} if suffix == "msh" else {}))
    again = read_mesh(tmp_path / f"own.{suffix}", um_per_unit=1000.0, nucleus_tag=5)
    assert np.bincount(again.region).tolist() == np.bincount(mesh.region).tolist()
    assert np.ptp(again.points_um, axis=0) == pytest.approx(2.0)


def cored(low: float = 0.5, high: float = 1.5, parts: int = 4) -> TetMesh:
    """A cube of 2 um with a cubic nucleus of region 1 between two heights and 0.5 um off the sides."""
    mesh = block((parts, parts, parts))
    middle = mesh.corners.mean(axis=1)
    inside = (abs(middle[:, [0, 2]] - 1) < 0.5).all(axis=1) & (middle[:, 1] > low) & (middle[:, 1] < high)
    return replace(mesh, region=inside.astype(np.int64))


def test_the_nucleus_is_a_region_of_the_file(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Another part, or none, gave a cell with other frequencies and not a word."""
    mesh = cored()
    file = tmp_path / "own.vtu"
    meshio.Mesh(mesh.points_um, [("tetra", mesh.tets)], cell_data={"region": [mesh.region + 4]}).write(file)
    assert read_mesh(file, nucleus_tag=5).region.sum() == mesh.region.sum()
    assert "regions of" in (
        said := capfd.readouterr().err
    ) and "4 (7 um^3, 88 %), 5 (1 um^3, 12 %); nucleus: 5" in said.replace("\n", " ")
    with pytest.raises(InputFileError, match=r"has no region 1; --nucleus-tag is one of its regions: 4 \(7 um"):
        read_mesh(file)
    with pytest.raises(InputFileError, match="in region 4, which is larger than all the rest"):
        read_mesh(file, nucleus_tag=4)
    assert "warning: " + str(file) not in " ".join(said.split())
    meshio.Mesh(mesh.points_um / 1000, [("tetra", mesh.tets)]).write(file)
    assert not read_mesh(file).region.any()
    said = " ".join(capfd.readouterr().err.split())
    assert "a cell without a nucleus" in said and "--um-per-unit 1000 (mm) would make it one" in said


def test_a_nucleus_lies_inside_and_has_a_nucleus_size(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A quarter of the cell at its bottom is none, one that stands on the base is told, and so is one of a crumb."""
    file = tmp_path / "own.vtu"

    def said(mesh: TetMesh) -> str:
        meshio.Mesh(mesh.points_um, [("tetra", mesh.tets)], cell_data={"region": [mesh.region]}).write(file)
        read_mesh(file)
        return " ".join(capfd.readouterr().err.split())

    # a slab of 2 x 0.5 x 2: 8 of its 12 um^2 are outside
    with pytest.raises(InputFileError, match="67 % of that region's surface is the cell's own"):
        said(block((4, 4, 4), nucleus_below=0.5))
    assert "17 % of the nucleus' surface is the cell's own, and a nucleus lies inside" in said(cored(low=0.0, high=1.0))
    one = block((8, 8, 8))
    crumb = replace(one, region=(np.arange(len(one.tets)) == _innermost(one)).astype(np.int64))
    assert (
        "its nucleus is 0.03" in (told := said(crumb)) and "% of the cell's volume, and nuclei are 0.2 to 40 %" in told
    )


def _innermost(mesh: TetMesh) -> int:
    return int(np.argmin(np.linalg.norm(mesh.corners.mean(axis=1) - 1, axis=1)))


def test_closed_stl_is_filled_and_open_stl_is_refused(tmp_path: Path) -> None:
    box = trimesh.creation.box((10, 8, 12)).subdivide()
    box.export(tmp_path / "closed.stl")
    assert assemble(read_mesh(tmp_path / "closed.stl")).volume_um3 == pytest.approx(960.0)
    box.update_faces(np.arange(len(box.faces)) > 1)
    box.export(tmp_path / "open.stl")
    with pytest.raises(InputFileError, match=r"open\.stl: the surface is not closed: \d edges belong to one"):
        read_mesh(tmp_path / "open.stl")


def test_a_coarse_stl_is_meshed_anew_at_the_size(tmp_path: Path) -> None:
    trimesh.creation.box((10, 8, 12)).export(tmp_path / "coarse.stl")
    counts = [len(read_mesh(tmp_path / "coarse.stl", size=MeshSize.of(size)).tets) for size in (4.0, 1.5)]
    assert counts[1] > 4 * counts[0]
    bad = trimesh.creation.box((10, 8, 12)).triangles.copy()
    bad[3, 1] = np.nan
    trimesh.Trimesh(bad.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False).export(tmp_path / "nan.stl")
    with pytest.raises(InputFileError, match=r"1 triangle with corners .* not finite .*\(the first is triangle 3\)"):
        read_mesh(tmp_path / "nan.stl")


@pytest.mark.parametrize("unit", [0.0, -2.0, 1e-30, float("nan"), float("inf")])
def test_units_that_cannot_be_meant(tmp_path: Path, unit: float) -> None:
    with pytest.raises(SettingError) as refusal:
        read_mesh(tmp_path / "absent.vtu", um_per_unit=unit)
    assert refusal.value.setting == "um_per_unit"


def test_files_that_are_no_cells(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        read_mesh(tmp_path / "absent.vtu")
    (tmp_path / "cell.obj").write_text("")
    with pytest.raises(InputFileError, match=r"valid: \.vtu, \.msh, \.stl"):
        read_mesh(tmp_path / "cell.obj")
    for name in ("broken.vtu", "broken.msh", "broken.stl"):
        (tmp_path / name).write_text("no mesh")
        with pytest.raises(InputFileError, match=name):
            read_mesh(tmp_path / name)
    for name, kind in (("broken.vtu", "VTU"), ("broken.msh", "MSH")):
        with pytest.raises(InputFileError, match=f"is not a {kind} file"):
            read_mesh(tmp_path / name)
    captured = capfd.readouterr()
    assert captured.out + captured.err == ""
    meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]).write(tmp_path / "flat.vtu")
    with pytest.raises(InputFileError, match="holds triangle; tetrahedra of one kind"):
        read_mesh(tmp_path / "flat.vtu")
    mesh = block()
    points = mesh.points_um.copy()
    points[7, 1] = np.nan
    meshio.Mesh(points, [("tetra", mesh.tets)]).write(tmp_path / "nan.vtu")
    with pytest.raises(InputFileError, match=r"has 1 point whose .* not finite .*\(the first is number 7 from 0\)"):
        read_mesh(tmp_path / "nan.vtu")
    lacking = np.delete(mesh.tets, _innermost(mesh), 0)
    meshio.Mesh(mesh.points_um, [("tetra", lacking)]).write(tmp_path / "lacking.vtu")
    with pytest.raises(InputFileError, match=r"outer surface branches: .* to \(.*\) um\): neighbouring elements must"):
        read_mesh(tmp_path / "lacking.vtu")
    points = mesh.points_um.copy()
    points[(points == 1).all(axis=1)] = 1.0, 3.0, 1.0  # the middle node, above the lid
    meshio.Mesh(points, [("tetra", mesh.tets)]).write(tmp_path / "folded.vtu")
    with pytest.raises(InputFileError, match=r"folded\.vtu: tetrahedra overlap at \d+ faces"):
        read_mesh(tmp_path / "folded.vtu")


@pytest.mark.parametrize(
    ("keep", "says"),
    [
        (slice(None, 342), "is cut off: 342 bytes, where its 12 triangles need 684"),
        (slice(0), "holds no triangles"),
        (b"time_s,u,y\n" * 20, "is text, but no STL"),
        (b"solid box\n facet normal", "is text that holds no whole triangle"),
        (slice(None), ""),
    ],
)
def test_what_is_no_stl_is_named(tmp_path: Path, keep: slice | bytes, says: str) -> None:
    file = tmp_path / "box.stl"
    trimesh.creation.box((30, 20, 10)).export(file)
    file.write_bytes(keep if isinstance(keep, bytes) else file.read_bytes()[keep])
    if not says:
        assert len(read_surface(file, 1.0).faces) == 12
        return
    with pytest.raises(InputFileError, match=rf"box\.stl: {says}"):
        read_surface(file, 1.0)


def test_tetrahedra_are_taken_whichever_way_they_are_numbered(tmp_path: Path) -> None:
    mesh = cell(size=8.0).mesh
    tets = mesh.tets.copy()
    tets[::3] = tets[::3][:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    meshio.Mesh(mesh.points_um, [("tetra10", tets)]).write(tmp_path / "turned.vtu")
    assert assemble(read_mesh(tmp_path / "turned.vtu")).volume_um3 == pytest.approx(cell(size=8.0).volume_um3)
