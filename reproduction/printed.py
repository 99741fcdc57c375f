"""Appendix B and Eq. (4.12) exactly as printed, errors and all, for comparison with the corrected equations.

Nothing here should be used for results: the printed stiffness is indefinite in every draw of Table 4.2. Each departure
from the derivation is marked "sic" and has a row in docs/errata.md. Where the print has an undefined symbol (A_1, A_2,
m_t, m_r, c_f, k_f) the only possible reading is taken (E_1, E_2, m_T, m_T, c_F, k_F).
"""

from math import sin

import numpy as np

from fasbody.arch import lagrange
from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import THETA_2, THETA_3, THETA_4, Z_F, Z_T, Array, X, arms, closing_angle, rest


def mass_matrix(arch: Arch, q: Array) -> Array:
    """A(q) of Appendix B, shape (..., 6, 6), with its one misprint."""
    A = lagrange.mass_matrix(arch, q)
    A[..., 4, 4] = A_55(arch, q)
    return A


def A_55(arch: Arch, q: Array) -> Array:
    """Entry of the mass matrix [kg m^2]; sic: m_4 / 4 without L_4^2, a mass added to moments of inertia."""
    a = arms(arch, q)
    J_1 = arch.m_1 * arch.L_1**2 / 4 / a.E_1 + arch.I_1 / a.E_1
    return (arch.m_T + J_1 + arch.m_2 + arch.m_3) * a.l_4**2 + arch.m_4 / 4 + arch.I_4


def B_1(arch: Arch, q: Array, q_dot: Array, q_ddot: Array, base_acceleration: float = 0.0) -> Array:
    """First right-hand side [N]; sic: squares of angular accelerations, and k_F times the velocity of z_F."""
    a = arms(arch, q)
    alpha_2, alpha_3, alpha_4 = q_ddot[..., THETA_2], q_ddot[..., THETA_3], q_ddot[..., THETA_4]
    return (
        (arch.m_T + arch.m_1 / 2 + arch.m_2 / 2) * a.h_2 * alpha_2**2
        + (arch.m_T + arch.m_1 / 2 + arch.m_2 + arch.m_3 / 2) * a.h_3 * alpha_3**2
        + (arch.m_T + arch.m_1 / 2 + arch.m_2 + arch.m_3 + arch.m_4 / 2) * a.h_4 * alpha_4**2
        - arch.c_F * q_dot[..., Z_F]
        - arch.k_F * q_dot[..., Z_F]
        - (arch.m_T + arch.m_F) * base_acceleration
    )


def velocity_terms(arch: Arch, q: Array, q_dot: Array) -> Array:
    """Products of velocities in B_1 to B_5, shape (..., 6); B_1 read with rates (see `B_1` for the literal one)."""
    m_T, m_1, m_2, m_3, m_4, L_1, I_1 = arch.m_T, arch.m_1, arch.m_2, arch.m_3, arch.m_4, arch.L_1, arch.I_1
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2 = arms(arch, q)
    w_2, w_3, w_4 = q_dot[..., THETA_2], q_dot[..., THETA_3], q_dot[..., THETA_4]
    J_1 = m_1 / 4 * L_1**2 / E_1 + I_1 / E_1
    P = (m_1 * L_1**2 / 4 + I_1) * E_2 / E_1**2
    B = np.zeros(np.broadcast_shapes(q.shape, q_dot.shape), dtype=np.result_type(q, q_dot))
    B[..., 0] = (
        (m_T + m_1 / 2 + m_2 / 2) * h_2 * w_2**2
        + (m_T + m_1 / 2 + m_2 + m_3 / 2) * h_3 * w_3**2
        + (m_T + m_1 / 2 + m_2 + m_3 + m_4 / 2) * h_4 * w_4**2
    )
    B[..., 1] = m_T * (h_2 * w_2**2 + h_3 * w_3**2 + h_4 * w_4**2)
    B[..., 2] = (
        -((m_T + J_1 - m_3 - m_4) * l_2 * h_2 - P * l_2**3) * w_2**2
        - (-P * l_3**2 * l_2 + (m_T + J_1 + m_2 / 2) * l_2 * h_3 - (m_3 / 2 + m_4) * l_3 * h_2) * w_3**2
        - (-P * l_4**2 * l_2 + (m_T + J_1 + m_2 / 2 - m_4 / 2) * l_2 * h_4) * w_4**2  # sic: m_4 / 2 in the bracket
        + (2 * P * l_2**2 * l_3 * w_3 + 2 * P * l_2**2 * l_4 * w_4) * w_2
        + 2 * P * l_2 * h_3 * h_4 * w_4 * w_3  # sic: cosines
    )
    B[..., 3] = (
        -((m_T + J_1 + m_2 / 2) * l_3 * h_2 - P * l_3 * l_2**2 - (m_3 / 2 + m_4) * l_2 * h_3) * w_2**2
        - (-P * l_3**3 + (m_T + J_1 + m_2 - m_4) * l_3 * h_3) * w_3**2
        - (-P * l_4**2 * l_3 + (m_T + J_1 + m_2 + m_3 / 2 - m_4 / 2) * l_3 * h_4) * w_4**2  # sic: m_4 / 2
        + (2 * P * l_2 * l_3**2 * w_3 + 2 * P * l_2 * l_3 * l_4 * w_4) * w_2
        + 2 * P * l_4 * l_3**2 * w_4 * w_3
    )
    B[..., 4] = (
        -((m_T + J_1 + m_2 / 2) * l_4 * h_2 - P * l_4 * l_2**2 - m_4 / 2 * l_2 * h_4) * w_2**2
        - (-P * l_3**2 * l_4 + (m_T + J_1 + m_2 + m_3 / 2) * h_3 * l_4 - m_4 / 2 * l_3 * h_4) * w_3**2
        - (-P * l_4**3 * l_2 + (m_T + J_1 + m_2 + m_3) * l_4 * h_4) * w_4**2  # sic: l_2
        + (2 * P * l_2 * l_3 * l_4 * w_3 + 2 * P * l_2 * l_4**2 * w_4) * w_2
        + 2 * P * l_4**2 * l_3 * w_4 * w_3
    )
    return B


def spring_forces(arch: Arch, q: Array) -> Array:
    """Terms of B in k, shape (..., 6).

    They follow from delta_11 = -sqrt(E_1) L_1 sin theta_10 + L_2 (sin theta_2 - sin theta_20), sic: an area minus a
    length, where the difference sqrt(E_1) - L_1 sin theta_10 was meant, and bodies 3 and 4 are left out.
    """
    l_2, l_3, l_4, h_2, _, _, E_1, E_2 = arms(arch, q)
    s_10 = arch.L_1 * sin(arch.theta_10)
    front = l_2 - arch.L_2 * sin(arch.theta_20)
    delta_11, delta_12 = -np.sqrt(E_1) * s_10 + front, front - q[..., X]
    theta_2, theta_3, theta_4 = q[..., THETA_2], q[..., THETA_3], q[..., THETA_4]
    delta_2 = closing_angle(arch, q) + theta_2 - (arch.theta_10 + arch.theta_20)
    delta_3 = theta_3 - theta_2 - (arch.theta_30 - arch.theta_20)
    delta_4 = theta_4 - theta_3 - (arch.theta_40 - arch.theta_30)
    Q = np.zeros(q.shape, dtype=q.dtype)
    Q[..., Z_F], Q[..., Z_T] = -arch.k_F * q[..., Z_F], -arch.k_T * q[..., Z_T]
    Q[..., THETA_2] = (
        -arch.k_11 * delta_11 * (-s_10 * l_2 * E_2 / np.sqrt(E_1) + h_2)
        - arch.k_12 * delta_12 * h_2
        - arch.k_2 * delta_2 * (l_2 + np.sqrt(E_1)) / np.sqrt(E_1)
        + arch.k_3 * delta_3
    )
    Q[..., THETA_3] = (
        arch.k_11 * delta_11 * s_10 * l_3 * E_2 / np.sqrt(E_1)
        - arch.k_2 * delta_2 * l_3 / np.sqrt(E_1)
        - arch.k_3 * delta_3
        + arch.k_4 * delta_4
    )
    Q[..., THETA_4] = (
        arch.k_11 * delta_11 * (s_10 * l_4 * E_2 / np.sqrt(E_1))
        - arch.k_2 * delta_2 * l_4 / np.sqrt(E_1)
        - arch.k_4 * delta_4
    )
    Q[..., X] = arch.k_12 * delta_12
    return Q


def damper_forces(arch: Arch, q: Array, q_dot: Array) -> Array:
    """Terms of B in c, shape (..., 6); c_2 on a relative rate, c_3 and c_4 on absolute ones."""
    c_1, c_2, c_3, c_4 = arch.c_1, arch.c_2, arch.c_3, arch.c_4
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2 = arms(arch, q)
    s_1 = arch.L_1 * np.sin(closing_angle(arch, q))
    s_10 = arch.L_1 * sin(arch.theta_10)
    root = np.sqrt(E_1)
    w_2, w_3, w_4, x_dot = (q_dot[..., i] for i in (THETA_2, THETA_3, THETA_4, X))
    pull = c_1 * s_10 * E_2 / root
    Q = np.zeros(np.broadcast_shapes(q.shape, q_dot.shape), dtype=np.result_type(q, q_dot))
    Q[..., Z_F], Q[..., Z_T] = -arch.c_F * q_dot[..., Z_F], -arch.c_T * q_dot[..., Z_T]
    Q[..., THETA_2] = (
        -(c_1 * (E_2 * s_1 * l_2) ** 2 / E_1 + c_2 * (l_2 / root + 1) ** 2) * w_2  # sic: sin theta_1
        - (c_1 * (E_2 * s_10) ** 2 * h_2 * l_3 / E_1 + c_2 * h_3 * (l_2 + root) / E_1) * w_3  # sic: h_2, h_3
        - (c_1 * (E_2 * s_10) ** 2 * h_2 * l_4 / E_1 + c_2 * h_4 * (l_2 - root) / E_1) * w_4  # sic: h_2, h_4, minus
        + pull * l_2 * x_dot
    )
    Q[..., THETA_3] = (
        -(c_1 * (E_2 * s_10) ** 2 / E_1 * l_2 * l_3 + c_2 * (l_2 + root) / E_1 * l_3) * w_2
        - (c_3 + c_2 * l_3**2 / E_1 + c_1 * (E_2 * s_10 * l_3) ** 2 / E_1) * w_3
        - (c_1 * (E_2 * s_10) ** 2 * l_4 * l_3 / E_1 + c_2 * l_4 * l_3 / E_1) * w_4
        + pull * l_3 * x_dot
    )
    Q[..., THETA_4] = (
        -(c_1 * (E_2 * s_10) ** 2 / E_1 * l_4 * l_2 + c_2 * l_4 * (l_2 + root) / E_1) * w_2
        - (c_1 * (E_2 * s_10) ** 2 * l_3 * l_4 / E_1 + c_2 * l_3 * l_4 / E_1) * w_3
        - (c_1 * (E_2 * s_10 * l_4) ** 2 / E_1 + c_2 * l_4**2 / E_1 + c_4) * w_4
        + pull * l_4 * x_dot
    )
    Q[..., X] = -c_1 * x_dot + pull * (l_2 * w_2 + l_3 * w_3 + l_4 * w_4)
    return Q


def right_hand_side(arch: Arch, q: Array, q_dot: Array, base_acceleration: float) -> Array:
    """B of Appendix B, shape (..., 6), under an acceleration of the table [m/s^2]; B_1 read with rates."""
    forces = spring_forces(arch, q) + damper_forces(arch, q, q_dot)
    return velocity_terms(arch, q, q_dot) + forces - mass_matrix(arch, q)[..., 0] * base_acceleration


def linear(arch: Arch) -> tuple[Array, Array, Array]:
    """C, K (6, 6) and the static part of Const (6,) of Eq. (4.12), on the right-hand side: M q'' = C q' + K q + Const.

    The table's part of Const is M_i1 times: -y_B'' for rows 1 and 2, sic: +y_B'' for rows 3 to 5.
    """
    l_2, l_3, l_4, h_2, _, _, E_10, E_20 = arms(arch, rest(arch))
    s_10, root = arch.L_1 * sin(arch.theta_10), np.sqrt(E_10)
    k_11, k_12, k_2, k_3, k_4 = arch.k_11, arch.k_12, arch.k_2, arch.k_3, arch.k_4
    c_1, c_2, c_3, c_4 = arch.c_1, arch.c_2, arch.c_3, arch.c_4
    sin_20, sin_40 = sin(arch.theta_20), sin(arch.theta_40)

    C = np.zeros((6, 6))
    C[0, 0], C[1, 1] = -arch.c_F, -arch.c_T
    C[2, 2] = -(c_1 * (E_20 * s_10 * l_2) ** 2 / E_10 + c_2 * (l_2 / E_10 + 1) ** 2)  # sic: E_10 without root
    C[2, 3] = -(c_1 * (E_20 * s_10) ** 2 * l_2 + c_2 * (l_2 + root)) * l_3 / E_10
    C[2, 4] = -(c_1 * (E_20 * s_10) ** 2 * l_2 + c_2 * (l_2 + root)) * l_4 / E_10
    C[2, 5] = c_1 * s_10 * l_2 * E_20 / root
    C[3, 3] = -(c_1 * (s_10 * l_3) ** 2 * E_20**2 / E_10 + c_2 * l_3**2 / E_10 + c_3)
    C[3, 4] = -(c_1 * (E_20 * s_10) ** 2 * l_3 + c_2 * l_3) * l_4 / E_10
    C[3, 5] = c_1 * s_10 * l_3 * E_20 / root
    C[4, 4] = -(c_1 * (s_10 * l_4) ** 2 * E_20**2 / E_10 + c_2 * l_4**2 / E_10 + c_4)
    C[4, 5] = c_1 * s_10 * l_4 * E_20 / root
    C[5, 5] = c_1  # sic: plus

    K = np.zeros((6, 6))
    K[0, 0], K[1, 1] = -arch.k_F, -arch.k_T
    K[2, 2] = -(
        # sic: no k_11 before this bracket, and k_2 over sqrt(E_10)
        (-2 * s_10 * l_2 * h_2 * E_20 / root + h_2**2 + E_20 * s_10**2 * h_2 - (s_10 * l_2) ** 2 + root * s_10 * l_2)
        + k_12 * h_2**2
        + k_2 * (l_2 + root) ** 2 / root
        + k_3
    )
    # sic: dimension m in the bracket, "- E_20 / sqrt(E_10)" for the term in L_2 cos theta_20
    bracket = -s_10 - E_20 / root
    K[2, 3] = -(k_11 * bracket * s_10 * arch.L_2 * sin_20 * l_3 + k_2 * l_3 * (l_2 + root) / E_10 - k_3)
    K[2, 4] = -(k_11 * bracket * s_10 * arch.L_2 * sin_20 * arch.L_4 * sin_40 + k_2 * l_4 * (l_2 + root) / E_10)
    K[2, 5] = k_12 * h_2
    K[3, 3] = -(k_11 * (-l_3 + E_20) * s_10**2 * l_3 + k_2 * l_3**2 / E_10 + k_3 + k_4)  # sic: -l_3 + E_20
    K[3, 4] = -(-k_11 * s_10**2 * l_3 * l_4 + k_2 * l_3 * l_4 / E_10 - k_4)
    K[4, 4] = -(k_11 * (-((s_10 * l_4) ** 2) + s_10**2 * l_4 * E_20) + k_2 * l_4**2 / E_10 + k_4)  # sic: sin theta_40
    K[5, 5] = k_12  # sic: plus

    constant = np.zeros(6)
    constant[2] = k_11 * s_10 * (s_10 * l_2 * E_20 - h_2 * root)  # sic: sign
    constant[3] = -k_11 * s_10**2 * l_3 * E_20
    constant[4] = -k_11 * s_10**2 * l_4 * E_20
    upper = np.triu_indices(6, 1)
    for matrix in (C, K):
        matrix[upper[1], upper[0]] = matrix[upper]
    return C, K, constant
