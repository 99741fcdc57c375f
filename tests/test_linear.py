"""The linear arch against the nonlinear one, against SymPy, and against its own state space."""

import numpy as np
import pytest

from fasbody.arch import linear
from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import rest
from fasbody.arch.ode import initial_state, jacobian
from simulator.symbolic_arch import evaluate

FREQUENCY = np.geomspace(1, 100, 25)


@pytest.fixture(params=["nominal", "thesis", "literal draw", "lever draw"])
def arch(request: pytest.FixtureRequest) -> Arch:
    rng = np.random.default_rng(11)
    return {
        "nominal": Arch.nominal(),
        "thesis": Arch.thesis(),
        "literal draw": Arch.draw(rng),
        "lever draw": Arch.draw(rng, 0.015),
    }[request.param]


def test_matrices_are_the_derivatives_of_the_lagrangian(arch: Arch) -> None:
    model, q = linear.linearise(arch), rest(arch)
    for ours, oracle in (
        (model.M, evaluate("mass", arch, q)),
        (-model.K, evaluate("stiffness", arch, q)),
        (-model.C, evaluate("damping", arch, q)),
    ):
        np.testing.assert_allclose(ours, oracle, rtol=1e-12, atol=1e-12 * np.abs(oracle).max())


def test_stiffness_is_positive_definite_in_every_draw() -> None:
    rng = np.random.default_rng(0)
    for lever_arm_m in (None, 0.015):
        for _ in range(500):
            K = linear.linearise(Arch.draw(rng, lever_arm_m)).K
            scale = 1 / np.sqrt(np.diag(K))
            assert np.linalg.eigvalsh(scale[:, None] * K * scale).min() > 0


def test_state_space_is_the_tangent_of_the_nonlinear_model(arch: Arch) -> None:
    A, *_ = linear.state_space(arch)
    J = jacobian(arch, initial_state(arch), 0.0)
    rows = np.abs(A).max(axis=1, keepdims=True)
    assert np.max(np.abs(A - J) / rows) < 1e-9


def test_every_arch_is_stable() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        values = np.linalg.eigvals(linear.state_space(Arch.draw(rng, 0.03))[0])
        assert values.real.max() < 0


def test_transmissibility_in_second_order_and_in_state_space_form(arch: Arch) -> None:
    A, b, c, d = linear.state_space(arch)
    s = 2j * np.pi * FREQUENCY[:, None, None]
    states = np.linalg.solve(s * np.eye(11) - A, np.tile(b[:, None], (25, 1, 1)))[..., 0]
    np.testing.assert_allclose(states @ c + d, linear.transmissibility(arch, FREQUENCY), rtol=1e-8)


def test_slow_tables_carry_the_foot_along(arch: Arch) -> None:
    assert linear.transmissibility(arch, np.array(1e-3)) == pytest.approx(1, abs=1e-5)


def test_arch_with_rigid_joints_is_the_two_mass_model() -> None:
    """Stiff enough joints leave z_F and z_T: Eq. (4.30) must appear, apart from its rigid foot."""
    rigid = Arch.nominal()
    rigid = type(rigid)(**{**vars(rigid), "k_11": 1e12, "k_2": 1e9, "k_3": 1e9, "k_4": 1e9})
    np.testing.assert_allclose(
        linear.transmissibility(rigid, FREQUENCY), linear.two_mass_transmissibility(rigid, FREQUENCY), rtol=1e-5
    )


def test_two_mass_model_against_its_second_order_form() -> None:
    """Eq. (4.26) solved in absolute coordinates."""
    m_S, m_F, k_T, k_F, c_T, c_F = 3.3, 1.0, 6e4, 3e4, 400.0, 900.0
    A, b, c = linear.two_mass_state_space(m_S, m_F, k_T, k_F, c_T, c_F)
    for frequency in FREQUENCY:
        s = 2j * np.pi * frequency
        T, F = k_T + s * c_T, k_F + s * c_F
        y_1 = np.linalg.solve([[m_S * s**2 + T, -T], [-T, m_F * s**2 + T + F]], [0, F])[0]
        assert c @ np.linalg.solve(s * np.eye(4) - A, b) == pytest.approx(y_1, rel=1e-10)


def test_middle_of_table_4_2_resonates_at_30_hz() -> None:
    frequency, damping = linear.modes(Arch.thesis())
    assert frequency[0] == pytest.approx(30.1, abs=0.05)
    assert damping[0] == pytest.approx(0.30, abs=0.005)


def test_nominal_arch_peaks_where_chapter_2_measured() -> None:
    frequency = np.arange(5, 60, 0.1)
    T = np.abs(linear.transmissibility(Arch.nominal(), frequency))
    assert frequency[T.argmax()] == pytest.approx(21.8, abs=0.3)
    assert T.max() == pytest.approx(1.22, abs=0.005)
