"""Misprints of Appendix B: printed formulas (reproduction/printed.py) against SymPy's derivation, entry by entry.

Exactly the listed entries differ, and each differs as listed.
"""

import numpy as np
import pytest
from errata_arch import ARCH, POSE, REST, UNIT, differing, only

from fasbody.arch import lagrange
from fasbody.arch.bones import DAMPERS
from fasbody.arch.kinematics import arms
from reproduction import printed
from simulator.symbolic_arch import evaluate


def test_A_55_is_the_only_wrong_entry_of_the_mass_matrix() -> None:
    as_printed = printed.mass_matrix(ARCH, POSE)
    right = evaluate("mass", ARCH, POSE)
    assert differing(as_printed, right) == {(5, 5)}
    assert as_printed[4, 4] - right[4, 4] == pytest.approx(ARCH.m_4 / 4 * (1 - ARCH.L_4**2), rel=1e-9)
    ratio = printed.A_55(ARCH, REST) / evaluate("mass", ARCH, REST)[4, 4]
    assert ratio == pytest.approx(2.15, abs=0.005)  # +115 %
    assert np.linalg.eigvalsh(as_printed[:5, :5]).min() > 0  # so definiteness does not find it


def velocity_products(terms) -> dict[tuple[int, int, int], float]:
    """Coefficient of theta_i' theta_j' in row r of B; (r, i, j)."""
    table = {}
    for i in (2, 3, 4):
        for j in range(i, 5):
            own = terms(UNIT[i]) if i == j else terms(UNIT[i] + UNIT[j]) - terms(UNIT[i]) - terms(UNIT[j])
            table |= {(row + 1, i, j): own[row] for row in range(5)}
    return table


def test_four_wrong_velocity_products() -> None:
    as_printed = velocity_products(lambda w: printed.velocity_terms(ARCH, POSE, w))
    right = velocity_products(lambda w: evaluate("velocity", ARCH, POSE, w))
    scale = max(map(abs, right.values()))
    wrong = {key for key in right if abs(as_printed[key] - right[key]) > 1e-12 * scale}
    assert wrong == {(3, 4, 4), (3, 3, 4), (4, 4, 4), (5, 4, 4)}
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2 = arms(ARCH, POSE)
    P = (ARCH.m_1 * ARCH.L_1**2 / 4 + ARCH.I_1) * E_2 / E_1**2
    half = ARCH.m_4 / 2
    error = {key: as_printed[key] - right[key] for key in wrong}
    assert error[3, 4, 4] == pytest.approx(half * l_2 * h_4 - half * h_2 * l_4)
    assert error[4, 4, 4] == pytest.approx(half * l_3 * h_4 - half * h_3 * l_4)
    assert error[3, 3, 4] == pytest.approx(2 * P * l_2 * (h_3 * h_4 - l_3 * l_4))
    assert error[5, 4, 4] == pytest.approx(P * l_4**3 * (l_2 - 1))


def test_B_1_squares_accelerations_and_multiplies_k_F_by_a_velocity() -> None:
    q_dot, q_ddot = np.array([0.3, 0, 2.0, -1.0, 1.5, 0]), np.array([0, 0, 30.0, 20.0, -10.0, 0])
    right = lagrange.right_hand_side(ARCH, POSE, q_dot, 1.0)[0]
    as_printed = printed.B_1(ARCH, POSE, q_dot, q_ddot, 1.0)
    repaired = (
        printed.B_1(ARCH, POSE, q_dot, q_dot, 1.0) + ARCH.k_F * q_dot[0] - ARCH.k_F * POSE[0]
    )  # rates for accelerations, z_F for its rate
    assert repaired == pytest.approx(right)
    assert abs(as_printed - right) > 0.5 * abs(right)


def test_printed_springs_follow_from_a_product_where_a_difference_was_meant() -> None:
    """Every printed spring force is the gradient of -sqrt(E_1) L_1 sin theta_10 + front: no slip beyond it."""
    right = evaluate("spring", ARCH, POSE, as_printed=True)
    np.testing.assert_allclose(printed.spring_forces(ARCH, POSE), right, rtol=1e-9)
    consistent = evaluate("spring", ARCH, REST)
    np.testing.assert_allclose(consistent, 0, atol=1e-7)
    assert np.all(np.abs(evaluate("spring", ARCH, REST, as_printed=True)[2:5]) > 1)  # [N m] at rest, out of nothing


def test_five_wrong_damper_terms_in_B_3() -> None:
    def matrix(name: str, force) -> np.ndarray:
        return np.stack([force(only(name), rate) for rate in UNIT], axis=-1)

    wrong, errors = {}, {}
    for name in DAMPERS:
        as_printed = matrix(name, lambda arch, rate: printed.damper_forces(arch, POSE, rate))
        right = matrix(name, lambda arch, rate: evaluate("damper", arch, POSE, rate, as_printed=True))
        wrong[name], errors[name] = differing(as_printed, right), (as_printed - right) / getattr(ARCH, name)
    none: dict[str, set] = {name: set() for name in ("c_3", "c_4", "c_T", "c_F")}
    assert wrong == none | {"c_1": {(3, 3), (3, 4), (3, 5)}, "c_2": {(3, 4), (3, 5)}}
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2 = arms(ARCH, POSE)
    s_10, root = ARCH.L_1 * np.sin(ARCH.theta_10), np.sqrt(E_1)
    assert errors["c_1"][2, 2] == pytest.approx(-((E_2 * l_2) ** 2) * (E_1 - s_10**2) / E_1)  # sin theta_1: theta_10
    assert errors["c_1"][2, 3] == pytest.approx(-((E_2 * s_10) ** 2) * (h_2 - l_2) * l_3 / E_1)  # cos: sin theta_2
    assert errors["c_1"][2, 4] == pytest.approx(-((E_2 * s_10) ** 2) * (h_2 - l_2) * l_4 / E_1)
    assert errors["c_2"][2, 3] == pytest.approx(-(h_3 - l_3) * (l_2 + root) / E_1)  # cos: sin theta_3
    assert errors["c_2"][2, 4] == pytest.approx(-(h_4 * (l_2 - root) - l_4 * (l_2 + root)) / E_1)


def test_third_joint_spring_is_left_out_of_the_printed_energy() -> None:
    """Eq. 4.9 sums k_i to i = 3; the printed B_4 and B_5 do contain k_4."""
    assert np.abs(printed.spring_forces(only("k_4"), POSE)[3:5]).min() > 1
