"""The MJCF arch against the equations: constants, mass matrix, bias, stepped motion; edited copies."""

from dataclasses import asdict

import mujoco
import numpy as np
import pytest
from arch_copies import compiled, high_arch

from fasbody.arch import lagrange, tree
from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import rest
from fasbody.arch.load import under_weight
from fasbody.foot.model import check
from fasbody.foot.shaker import harmonics
from fasbody.foot.simulate import simulate
from simulator.arch import poses
from simulator.symbolic_arch import evaluate


def engine(model: mujoco.MjModel, arch: Arch, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and bias of MuJoCo at the poses of the equations, base left out, projected."""
    data, masses, biases = mujoco.MjData(model), [], []
    joints, T = tree.tree_position(arch, q), tree.tree_jacobian(arch, q)
    for i in range(len(q)):
        data.qpos[1:], data.qvel[1:] = joints[i], T[i] @ v[i]
        mujoco.mj_forward(model, data)
        heel, heads = data.site("heel").xpos[1], data.site("heads").xpos[1]
        assert heel == pytest.approx(q[i, 0], abs=1e-12)
        assert heads == pytest.approx(q[i, 0], abs=1e-12)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        masses.append(full[1:, 1:])
        biases.append(data.qfrc_bias[1:].copy())
    return tree.project(arch, q, v, np.array(masses), np.array(biases))


def test_shipped_model_is_the_nominal_arch() -> None:
    ours, nominal = Arch.from_model(compiled()), Arch.nominal()
    for name, value in asdict(nominal).items():
        assert getattr(ours, name) == pytest.approx(value, rel=1e-9), name


@pytest.mark.parametrize("model", [compiled, high_arch], ids=["shipped", "high arch"])
def test_mass_matrix_and_bias_against_equations_and_sympy(model) -> None:
    model = model()
    arch = Arch.from_model(model)
    q, v = poses(arch, np.random.default_rng(0), 200)
    A, bias = lagrange.mass_and_bias(arch, q, v)
    M, b = engine(model, arch, q, v)
    assert np.max(np.abs(M - A).max(axis=0)[:5, :5] / np.abs(A).max(axis=0)[:5, :5]) < 1e-12
    assert np.max(np.abs(b - bias).max(axis=0)[:5] / np.abs(bias).max(axis=0)[:5]) < 1e-12
    np.testing.assert_allclose(M[0], evaluate("mass", arch, q[0]), atol=1e-12)


def test_edits_reach_the_arch() -> None:
    arch = Arch.from_model(high_arch())
    assert arch.height_0 == pytest.approx(0.0486, abs=1e-4)  # 20 % above 40 mm
    assert (arch.m_3, arch.k_11) == (0.040, pytest.approx(40e3))


def test_tree_coordinates_by_complex_steps() -> None:
    arch = Arch.nominal()
    q, v = poses(arch, np.random.default_rng(1), 20)
    T = tree.tree_jacobian(arch, q)
    for i, unit in enumerate(np.eye(6)):
        slope = tree.tree_position(arch, q + 1e-30j * unit).imag / 1e-30
        np.testing.assert_allclose(T[..., i], slope, rtol=1e-12, atol=1e-14)
    step = 1e-6
    faster = np.einsum("nij,nj->ni", tree.tree_jacobian(arch, q + step * v), v)
    slower = np.einsum("nij,nj->ni", tree.tree_jacobian(arch, q - step * v), v)
    np.testing.assert_allclose(tree.tree_drift(arch, q, v), (faster - slower) / (2 * step), rtol=1e-6, atol=1e-6)


def test_gravity_hold_settles_on_pad_and_ankle() -> None:
    """z_F = -W / k_F and z_T = -m_T g / k_T; the dashpot yields to the whole elongation, its tension to nothing."""
    foot = check(compiled(('gravity="0 0 0"', 'gravity="0 -9.81 0"')), "hold")
    end = simulate(foot, harmonics(10.0, [0.0], 1.0), accept=0.05)
    data, arch = mujoco.MjData(foot.model), Arch.from_model(compiled())
    mujoco.mj_kinematics(foot.model, data)
    before = data.site("heel").xpos[1]
    data.qpos[:] = end.qpos[0, -1]
    mujoco.mj_kinematics(foot.model, data)
    sunk = data.site("heel").xpos[1] - before - end.qpos[0, -1, 0]
    assert sunk == pytest.approx(-(arch.m_T + arch.m_F) * 9.81 / arch.k_F, rel=1e-3)
    assert end.qpos[0, -1, 2] == pytest.approx(-arch.m_T * 9.81 / arch.k_T, rel=1e-3)
    pose = under_weight(arch, rest(arch), 9.81)
    np.testing.assert_allclose(end.qpos[0, -1, 1:], tree.tree_position(arch, pose), rtol=1e-3)


def test_what_is_fixed_to_the_tibia_is_its_mass() -> None:
    """A cast: MuJoCo's own mass matrix carries it, so the equations must."""
    cast = '<body name="cast"><inertial pos="0 0.1 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/></body>'
    geom = '<geom name="tibia"'
    model = compiled((geom, cast + geom))
    arch = Arch.from_model(model)
    assert arch.m_T == pytest.approx(2.86)
    q, v = poses(arch, np.random.default_rng(2), 5)
    np.testing.assert_allclose(engine(model, arch, q, v)[0], lagrange.mass_matrix(arch, q), rtol=1e-10, atol=1e-12)
