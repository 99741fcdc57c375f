"""The nonlinear equations against SymPy's Lagrangian, and against physics: energy, definiteness, differentiation."""

import numpy as np
import pytest

from fasbody.arch import kinematics, lagrange
from fasbody.arch.bones import PARAMETERS, Arch
from fasbody.exceptions import SimulationError
from simulator.arch import poses
from simulator.symbolic_arch import evaluate

STEP = 1e-30


@pytest.fixture(params=["nominal", "draw", "centroidal"])
def arch(request: pytest.FixtureRequest) -> Arch:
    rng = np.random.default_rng(4)
    return {
        "nominal": Arch.nominal(),
        "draw": Arch.draw(rng),
        "centroidal": Arch.draw(rng, 0.015, "centroidal").with_height(0.048),
    }[request.param]


def relative(ours: np.ndarray, oracle: np.ndarray) -> float:
    return float(np.max(np.abs(ours - oracle)) / np.max(np.abs(oracle)))


def test_mass_matrix_entry_by_entry(arch: Arch) -> None:
    q, _ = poses(arch, np.random.default_rng(1), 200)
    ours, oracle = lagrange.mass_matrix(arch, q), np.array([evaluate("mass", arch, pose) for pose in q])
    scale = np.abs(oracle).max(axis=0) + (oracle == 0).all(axis=0)
    assert np.max(np.abs(ours - oracle) / scale) < 1e-13
    assert np.linalg.eigvalsh(ours[:, :5, :5]).min() > 0


def test_velocity_terms_entry_by_entry(arch: Arch) -> None:
    q, v = poses(arch, np.random.default_rng(2), 200)
    ours = lagrange.velocity_terms(arch, q, v)
    oracle = np.array([evaluate("velocity", arch, *pose) for pose in zip(q, v, strict=True)])
    assert np.max(np.abs(ours - oracle).max(axis=0)[:5] / np.abs(oracle).max(axis=0)[:5]) < 1e-12
    assert not ours[:, 5].any()


def test_springs_and_dampers(arch: Arch) -> None:
    q, v = poses(arch, np.random.default_rng(3), 50)
    ours = lagrange.spring_damper_forces(arch, q, v)
    for pose, rate, force in zip(q, v, ours, strict=True):
        assert relative(force, evaluate("spring", arch, pose) + evaluate("damper", arch, pose, rate)) < 1e-12


def test_force_is_the_gradient_of_the_potential(arch: Arch) -> None:
    q, _ = poses(arch, np.random.default_rng(5), 20)
    gradient = np.stack([lagrange.potential(arch, q + 1j * STEP * unit).imag / STEP for unit in np.eye(6)], axis=-1)
    force = lagrange.spring_damper_forces(arch, q, np.zeros_like(q))
    np.testing.assert_allclose(force, -gradient, rtol=1e-10, atol=1e-9 * np.abs(force).max())


def test_power_lost_in_the_dampers(arch: Arch) -> None:
    q, v = poses(arch, np.random.default_rng(6), 20)
    dampers = lagrange.spring_damper_forces(arch, q, v) - lagrange.spring_damper_forces(arch, q, np.zeros_like(v))
    np.testing.assert_allclose(-np.sum(dampers * v, axis=-1), lagrange.dissipated_power(arch, q, v), rtol=1e-9)


def test_kinetic_energy_on_a_moving_table(arch: Arch) -> None:
    """Against the speeds of the five centres of mass, differentiated by complex steps."""
    q, v = poses(arch, np.random.default_rng(7), 20)
    speed = kinematics.centres(arch, q + 1j * STEP * v, 1j * STEP * 0.7).imag / STEP
    theta_1_rate = kinematics.closing_angle(arch, q + 1j * STEP * v).imag / STEP
    spin = np.column_stack([np.zeros(20), theta_1_rate, v[:, 2:5]])
    masses = np.array([arch.m_T, arch.m_1, arch.m_2, arch.m_3, arch.m_4])
    inertias = np.array([0, arch.I_1, arch.I_2, arch.I_3, arch.I_4])
    direct = 0.5 * (masses * (speed**2).sum(axis=-1) + inertias * spin**2).sum(axis=-1)
    np.testing.assert_allclose(lagrange.kinetic(arch, q, v, 0.7), direct, rtol=1e-12)


def test_gravity_is_a_table_accelerating_upwards() -> None:
    """-A[:, z_F] g must be minus the gradient of sum m_i g y_i of the centres of mass."""
    arch = Arch.nominal()
    q, _ = poses(arch, np.random.default_rng(8), 10)
    _, bias = lagrange.mass_and_bias(arch, q, np.zeros_like(q), gravity=9.81)
    masses = np.array([arch.m_T, arch.m_1, arch.m_2, arch.m_3, arch.m_4])
    for i, unit in enumerate(np.eye(6)):
        rise = kinematics.centres(arch, q + 1j * STEP * unit)[..., 1].imag / STEP
        np.testing.assert_allclose(bias[:, i], 9.81 * rise @ masses, rtol=1e-12, atol=1e-14)


def test_forces_are_linear_in_the_thirteen_constants() -> None:
    arch = Arch.nominal()
    q, v = poses(arch, np.random.default_rng(9), 5)
    table = lagrange.force_per_parameter(arch, q, v)
    assert tuple(table) == PARAMETERS
    total = sum(getattr(arch, name) * force for name, force in table.items())
    np.testing.assert_allclose(total, lagrange.spring_damper_forces(arch, q, v), rtol=1e-12)


def test_an_arch_that_cannot_close_says_so() -> None:
    with pytest.raises(SimulationError, match="cannot close"):
        kinematics.arms(Arch.nominal(), np.zeros(6))
