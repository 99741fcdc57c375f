"""The mesher, and the shapes against the meshes that are stored."""

import numpy as np
import pytest
import trimesh

from reproduction.anatomy import bones, tissue
from reproduction.anatomy.field import ellipsoid, mesh, round_cone, union
from viz.anatomy import assets


@pytest.fixture(scope="module")
def parts() -> dict[str, assets.Part]:
    return {part.name: part for part in assets.read()}


def test_mesher_on_an_ellipsoid() -> None:
    made = mesh(ellipsoid((3, -2, 5), (20, 12, 8), 25), 1.0)
    closed = trimesh.Trimesh(made.vertices, made.faces, process=False)
    assert closed.is_watertight
    assert closed.volume == pytest.approx(4 / 3 * np.pi * 20 * 12 * 8, rel=0.005)
    assert np.quantile(np.einsum("ij,ij->i", closed.vertex_normals, made.normals), 0.01) > 0.98


def test_union_is_smooth_and_larger_than_its_parts() -> None:
    a, b = round_cone((0, 0, 0), (20, 0, 0), 5, 5), round_cone((10, 0, 0), (10, 20, 0), 4, 4)
    both = mesh(union(a, b, blend=5), 1.0)
    volumes = [trimesh.Trimesh(m.vertices, m.faces).volume for m in (both, mesh(a, 1.0), mesh(b, 1.0))]
    assert max(volumes[1:]) < volumes[0] < 1.1 * sum(volumes[1:])


def test_stored_parts_are_what_the_shapes_give(parts: dict[str, assets.Part]) -> None:
    """The assets are not older than the script."""
    for name, shape in (("talus", bones.talus()), ("navicular", bones.navicular())):
        p = 1e3 * parts[name].vertices[:, [0, 2, 1]] * (1, -1, 1)
        assert np.abs(shape.distance(p)).max() < 0.12, name


def test_skin_holds_every_bone(parts: dict[str, assets.Part]) -> None:
    skin = tissue.skin()
    for part in parts.values():
        if part.segment is not None:
            p = 1e3 * part.vertices[:, [0, 2, 1]] * (1, -1, 1)
            below_the_cut = p[:, 2] < bones.KNEE - 4
            assert skin.distance(p[below_the_cut]).max() < 0, part.name
