"""The meshes: closed, in place, following the bodies; and for display only."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mjcf
from fasbody.arch.bones import Arch
from fasbody.foot.model import load
from viz.anatomy import assets
from viz.anatomy.rest import SEGMENT_BODIES, TABLE, carried, extra_geoms, reach, segment_bodies
from viz.load import load_foot

trimesh = pytest.importorskip("trimesh", reason="needs the extra: pip install 'fasbody[view]'")


@pytest.fixture(scope="module")
def parts() -> dict[str, assets.Part]:
    return {part.name: part for part in assets.read()}


def solid(part: assets.Part):  # type: ignore[no-untyped-def]
    return trimesh.Trimesh(part.vertices, part.faces, process=False)


def test_every_stored_part_is_closed_and_in_one_piece(parts: dict[str, assets.Part]) -> None:
    assert len(parts) == 34
    for part in parts.values():
        body = solid(part)
        assert body.is_watertight, part.name
        assert body.is_winding_consistent, part.name
        assert body.volume > 0, part.name
        assert body.body_count == 1, part.name
        assert np.allclose(part.weights.sum(1), 1)


def test_anatomy_is_where_it_belongs(parts: dict[str, assets.Part]) -> None:
    centre = {name: solid(part).center_mass for name, part in parts.items()}
    x, y, z = 0, 1, 2
    assert centre["calcaneus"][x] < centre["talus"][x] < centre["navicular"][x] < centre["medial_cuneiform"][x]
    assert centre["calcaneus"][y] < centre["talus"][y] < centre["tibia"][y]
    assert centre["fibula"][z] < centre["tibia"][z]  # lateral is -z on a left foot
    assert centre["cuboid"][z] < centre["lateral_cuneiform"][z] < centre["medial_cuneiform"][z]
    heads = [parts[f"metatarsal_{i}"].vertices[:, x].max() for i in range(1, 6)]
    assert heads[2] > heads[3] > heads[4]
    # the bones of the arch end where Table 4.1 has its joints
    arch = Arch.thesis()
    assert centre["calcaneus"][x] == pytest.approx(-arch.L_1 * np.sin(arch.theta_10), abs=0.03)
    heads_at = arch.l_0 - arch.L_1 * np.sin(arch.theta_10)
    assert parts["metatarsal_1"].vertices[:, x].max() == pytest.approx(heads_at, abs=0.015)
    # pads stand on the table and reach the bone
    for pad in ("heel_pad", "forefoot_pad"):
        assert parts[pad].vertices[:, y].min() == pytest.approx(1e-3 * TABLE, abs=0.0012)


@pytest.mark.parametrize("name", list(SEGMENT_BODIES))
def test_display_changes_no_dynamics(name: str) -> None:
    bare = mujoco.MjModel.from_xml_path(str(mjcf.path(name)))
    dressed = mujoco.MjModel.from_xml_path(str(mjcf.scene(name)))
    assert dressed.nskin == 4
    assert bare.nskin == 0
    fields = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_armature", "dof_damping", "jnt_stiffness")
    for field in fields:
        assert np.array_equal(getattr(bare, field), getattr(dressed, field)), field
    assert (bare.nv, bare.nbody, bare.ncam) == (dressed.nv, dressed.nbody, dressed.ncam)
    states = []
    dressed.tendon_stiffness[dressed.tendon("spring_of_the_table").id] = 0  # it moves the table, and nothing else
    for model in (bare, dressed):
        data = mujoco.MjData(model)
        data.qvel[:] = np.linspace(0.01, 0.05, model.nv)
        mujoco.mj_step(model, data, 20)
        states.append(data.qpos.copy())
    np.testing.assert_allclose(*states, rtol=1e-9, atol=1e-12)


def test_skins_bend_with_the_bodies() -> None:
    """MuJoCo's bind poses are the rest poses, so at rest nothing moves and a bone follows its body rigidly."""
    model = mujoco.MjModel.from_xml_path(str(mjcf.scene("foot_arch")))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for bone in range(model.nskinbone):
        body = model.skin_bonebodyid[bone]
        assert np.allclose(model.skin_bonebindpos[bone], data.xpos[body], atol=1e-6)
        turned = abs(model.skin_bonebindquat[bone] @ data.xquat[body])
        assert turned == pytest.approx(1, abs=1e-6)


def test_flat_foot_is_a_model_of_its_own() -> None:
    flat = load_foot("foot_arch@25")
    arch = Arch.from_model(flat.model)
    assert arch.height_0 == pytest.approx(0.025, abs=1e-9)
    normal = Arch.from_model(load("foot_arch").model)
    assert (arch.L_1, arch.m_F, arch.k_11) == pytest.approx((normal.L_1, normal.m_F, normal.k_11))
    assert arch.l_0 > normal.l_0  # a flatter foot is longer
    found = segment_bodies(flat.model)
    assert found is not None
    assert found[0] == "foot_arch"


def test_mounted_arch_wears_the_bones_of_the_arch(parts: dict[str, assets.Part]) -> None:
    """It stands almost as the arch does, so every bone lies within two millimetres of where it was made."""
    model = load("mounted_arch").model
    on = carried(model)
    assert on is not None and {on[name].body for name in on} == {
        "calcaneus_talus", "navicular", "cuneiforms", "metatarsals", "shank", "base",
    }  # fmt: skip
    for name, segment in on.items():
        made = np.vstack([np.zeros((0, 3)), *(part.vertices for part in parts.values() if part.segment == name)])
        to, back = (Rotation.from_quat(f.quaternion, scalar_first=True) for f in (segment.rest, segment.bind))
        moved = segment.rest.position + (to * back.inv()).apply(made - segment.bind.position)
        assert np.abs(moved - made).max(initial=0) < 2e-3, name
    assert {model.geom(i).name for i in extra_geoms(model).geoms} == {"thigh", "load"}


def test_toes_of_a_flat_foot_stay_on_the_table(parts: dict[str, assets.Part]) -> None:
    """Turned with their metatarsals they would rise; moved with the heads they keep their height."""
    on = carried(load_foot("foot_arch@25").model)
    assert on is not None
    toes = np.vstack([part.vertices for part in parts.values() if part.segment == "toes"])

    def lowest(segment: str) -> float:
        to, made = on[segment].rest, on[segment].bind
        turn = Rotation.from_quat(to.quaternion, scalar_first=True)
        back = Rotation.from_quat(made.quaternion, scalar_first=True).inv()
        moved = to.position + (turn * back).apply(toes - made.position)
        return float(moved[moved[:, 0] > moved[:, 0].max() - 0.03, 1].min())

    level = float(toes[toes[:, 0] > toes[:, 0].max() - 0.03, 1].min())
    assert lowest("toes") == pytest.approx(level, abs=0.001)
    assert lowest("metatarsals") > level + 0.005
    # and with the model as it is shipped both are the same
    on = carried(load("foot_arch").model)
    assert on is not None
    assert lowest("toes") == pytest.approx(lowest("metatarsals"), abs=1e-9) == pytest.approx(level, abs=1e-9)


def test_cameras_know_of_thigh_and_load() -> None:
    """What stands above the bones of a leg, to the load's upper side; a foot alone has nothing."""
    leg, foot = load("leg").model, load("two_dof").model
    low, high = reach(leg, extra_geoms(leg).geoms)
    assert (low[0], high[1]) == pytest.approx((-0.46, 0.625))
    assert reach(foot, extra_geoms(foot).geoms) == []
