"""The mounted arch as MJCF: matrices by closed form, MuJoCo and Pinocchio; response by closed form and by steps."""

from xml.etree.ElementTree import canonicalize

import mujoco
import numpy as np
import pytest

import mjcf
from fasbody.arch.bones import Arch
from fasbody.arch.crosscheck import build_pinocchio, import_pinocchio
from fasbody.arch.tree import tree_jacobian, tree_position
from fasbody.exceptions import ModelError, SettingError
from fasbody.foot.engine import callbacks
from fasbody.foot.linear import Linear
from fasbody.foot.model import Foot, load
from simulator import mount
from simulator.mounted import SEATED_N, SHIPPED, STANDING_N, stance

ARCH = Arch.nominal()
HZ = np.array([10.0, 20.0, 24.0, 35.0, 50.0])
#: Joints of the file in the order of the closed form's tree, and behind it.
TREE = ("apex", "talocrural", "hindfoot", "spring_ligament", "short_plantar_ligament", "long_plantar_ligament")
JOINTS = ("fat_pad", *TREE, "thigh", "tissue")


def turns(q: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joints (9,) of `JOINTS` at coordinates x (7,) from the pose q (6,), and their slopes (9, 7)."""
    moved = q + np.array([0, x[1], *x[2:5], 0])
    T = np.zeros((9, 7))
    T[0, 0] = T[7, 5] = T[8, 6] = 1
    T[1:7, 1:5] = tree_jacobian(ARCH, moved)[:, 1:5]
    at = np.concatenate([[x[0]], tree_position(ARCH, moved) - tree_position(ARCH, q), x[5:]])
    return at, T


def by_mujoco(foot: Foot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, damping and stiffness (7, 7), by what MuJoCo does on poses that close."""
    model, data = foot.model, mujoco.MjData(foot.model)
    dofs = [int(model.jnt_dofadr[model.joint(name).id]) for name in JOINTS]
    full, (_, T) = np.zeros((model.nv, model.nv)), turns(q, np.zeros(7))

    def force(x: np.ndarray, rate: np.ndarray) -> np.ndarray:
        at, slope = turns(q, x)
        data.qpos[dofs], data.qvel[dofs] = at, T @ rate
        mujoco.mj_forward(model, data)
        found: np.ndarray = slope.T @ (data.qfrc_passive + data.qfrc_actuator)[dofs]
        return found

    with callbacks():
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        closing = data.efc_J.reshape(-1, model.nv)[:2][:, dofs]
        assert np.abs(closing @ T).max() < 1e-9  # these coordinates are what MuJoCo's equalities leave free
        assert np.abs(force(np.zeros(7), np.zeros(7))).max() < 1e-9  # and the pose is one of rest
        C = -np.column_stack([force(np.zeros(7), e) - force(np.zeros(7), 0 * e) for e in np.eye(7)])
        h, weights = 1e-4, ((1, 8 / 12), (-1, -8 / 12), (2, -1 / 12), (-2, 1 / 12))
        K = -np.column_stack([sum(w * force(n * h * e, 0 * e) for n, w in weights) / h for e in np.eye(7)])
    return T.T @ full[np.ix_(dofs, dofs)] @ T, C, K


def by_pinocchio(foot: Foot, q: np.ndarray) -> np.ndarray:
    """Mass matrix (7, 7)."""
    pin, built = import_pinocchio(), build_pinocchio(foot.model, foot.name)
    upper = np.triu(pin.crba(built, built.createData(), pin.neutral(built)))
    dofs = [built.joints[built.getJointId(name)].idx_v for name in JOINTS]
    T = turns(q, np.zeros(7))[1]
    found: np.ndarray = T.T @ (upper + np.triu(upper, 1).T)[np.ix_(dofs, dofs)] @ T
    return found


def off(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max() / np.abs(a).max())


def test_the_file_is_what_the_shipped_set_makes() -> None:
    shipped, made = mjcf.path("mounted_arch").read_text(), mount.mjcf()
    assert canonicalize(shipped, with_comments=True) == canonicalize(made, with_comments=True)
    assert "stands under\n       60.0 N" in mount.mjcf(weight=60.0)


def test_a_load_moves_pose_pad_and_ligaments() -> None:
    """Mass alone would come to 1.065 at 40 Hz; the same model declares no added mass."""
    foot, f = load(mount.mjcf(added_kg=4.5)), np.array([40.0])
    carried = mount.response(f, *mount.matrices(weight=SEATED_N + 9.81 * 4.5, added_kg=4.5))[0]
    np.testing.assert_allclose(Linear(foot).transmissibility(f), carried, rtol=5e-4)
    assert abs(carried[0]) == pytest.approx(1.1733, abs=1e-4)
    with pytest.raises(SettingError, match="unknown parameter 'added_mass'"):
        load("mounted_arch").with_values({"added_mass": 4.5})
    with pytest.raises(ModelError, match="the actuator 'weight' stands for it"):
        load(mjcf.text("mounted_arch").replace('gravity="0 0 0"', 'gravity="0 -9.81 0"'))


@pytest.mark.parametrize(("weight", "added"), [(SEATED_N, 0.0), (SEATED_N, 4.5), (STANDING_N, 0.0)])
def test_three_engines_agree(weight: float, added: float) -> None:
    """Standing the aponeurosis pulls, too."""
    foot = load(mount.mjcf(weight=weight, added_kg=added))
    M, C, K, rows = mount.matrices(weight=weight, added_kg=added)
    q = mount.pose(SHIPPED, ARCH, weight)
    stepped_M, stepped_C, stepped_K = by_mujoco(foot, q)
    assert off(M, stepped_M) < 1e-12
    assert off(M, by_pinocchio(foot, q)) < 1e-12
    assert off(C, stepped_C) < 1e-12
    assert off(K[2:5, 2:5], stepped_K[2:5, 2:5]) < 1e-9  # by differences of forces
    assert off(K, stepped_K) < 1e-9
    exact = mount.response(HZ, M, C, K, rows)
    np.testing.assert_allclose(mount.response(HZ, stepped_M, stepped_C, stepped_K, rows), exact, rtol=1e-8)
    # MuJoCo's inverse dynamics, whose equalities give way by a share of 1e-4
    np.testing.assert_allclose(Linear(foot).transmissibility(HZ), exact[0], rtol=5e-4)
    same = SHIPPED.response(stance(ARCH, np.array(weight), SHIPPED.tissue), weight, HZ, added)
    np.testing.assert_allclose(exact, [np.ravel(same.malleolus), np.ravel(same.tuberosity)], rtol=1e-3)
