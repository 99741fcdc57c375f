"""The nonlinear equations of motion of the five-body arch: A(q) q'' = B(q, q', y_B''), Appendix B corrected.

The kinetic part follows Appendix B entry by entry, seven misprints corrected. The springs and dampers follow one
consistent model: each force is minus the gradient of one energy, so that energy is conserved without dampers and the
stiffness is positive definite, neither of which holds in print. docs/errata.md lists every difference.

All functions work on arrays of poses, shape (..., 6), in the order (z_F, z_T, theta_2, theta_3, theta_4, x).
"""

import numpy as np

from fasbody.arch.bones import DAMPERS, PARAMETERS, SPRINGS, Arch
from fasbody.arch.kinematics import THETA_2, THETA_3, THETA_4, Z_F, Z_T, Array, X, arms, deformations, gradients

_LOWER = np.tril_indices(6, -1)


def mass_matrix(arch: Arch, q: Array) -> Array:
    """A(q) of Eq. (4.11) as in Appendix B, shape (..., 6, 6); row and column of x are zero, x has no mass.

    Args:
        arch: the constants.
        q: coordinates, shape (..., 6).
    """
    m_T, m_1, m_2, m_3, m_4 = arch.m_T, arch.m_1, arch.m_2, arch.m_3, arch.m_4
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, _ = arms(arch, q)
    J_1 = (m_1 * arch.L_1**2 / 4 + arch.I_1) / E_1  # calcaneus and talus, carried along by the closure
    A = np.zeros((*q.shape[:-1], 6, 6), dtype=q.dtype)
    A[..., 0, 0] = m_T + m_1 + m_2 + m_3 + m_4
    A[..., 0, 1] = m_T
    A[..., 0, 2] = -(m_T + m_1 / 2 + m_2 / 2) * l_2
    A[..., 0, 3] = -(m_T + m_1 / 2 + m_2 + m_3 / 2) * l_3
    A[..., 0, 4] = -(m_T + m_1 / 2 + m_2 + m_3 + m_4 / 2) * l_4
    A[..., 1, 1] = m_T
    A[..., 1, 2] = -m_T * l_2
    A[..., 1, 3] = -m_T * l_3
    A[..., 1, 4] = -m_T * l_4
    A[..., 2, 2] = (m_T + J_1) * l_2**2 + (m_3 + m_4) * h_2**2 + m_2 * arch.L_2**2 / 4 + arch.I_2
    A[..., 2, 3] = (m_T + J_1 + m_2 / 2) * l_2 * l_3 + (m_3 / 2 + m_4) * h_2 * h_3
    A[..., 2, 4] = (m_T + J_1 + m_2 / 2) * l_2 * l_4 + m_4 / 2 * h_2 * h_4
    A[..., 3, 3] = (m_T + J_1 + m_2) * l_3**2 + m_4 * h_3**2 + m_3 * arch.L_3**2 / 4 + arch.I_3
    A[..., 3, 4] = (m_T + J_1 + m_2 + m_3 / 2) * l_3 * l_4 + m_4 / 2 * h_3 * h_4
    A[..., 4, 4] = (m_T + J_1 + m_2 + m_3) * l_4**2 + m_4 / 4 * arch.L_4**2 + arch.I_4
    A[..., _LOWER[0], _LOWER[1]] = A[..., _LOWER[1], _LOWER[0]]
    return A


def velocity_terms(arch: Arch, q: Array, q_dot: Array) -> Array:
    """The terms of B in products of velocities (centrifugal and Coriolis), shape (..., 6), on the right-hand side.

    Args:
        arch: the constants.
        q: coordinates, shape (..., 6).
        q_dot: their rates, shape (..., 6).
    """
    m_T, m_1, m_2, m_3, m_4 = arch.m_T, arch.m_1, arch.m_2, arch.m_3, arch.m_4
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2 = arms(arch, q)
    w_2, w_3, w_4 = q_dot[..., THETA_2], q_dot[..., THETA_3], q_dot[..., THETA_4]
    J_1 = (m_1 * arch.L_1**2 / 4 + arch.I_1) / E_1
    B = np.zeros(np.broadcast_shapes(q.shape, q_dot.shape), dtype=np.result_type(q, q_dot))
    B[..., 0] = (
        (m_T + m_1 / 2 + m_2 / 2) * h_2 * w_2**2
        + (m_T + m_1 / 2 + m_2 + m_3 / 2) * h_3 * w_3**2
        + (m_T + m_1 / 2 + m_2 + m_3 + m_4 / 2) * h_4 * w_4**2
    )
    B[..., 1] = m_T * (h_2 * w_2**2 + h_3 * w_3**2 + h_4 * w_4**2)
    # all terms in E_2 / E_1^2 together: the closure turns the hindfoot at (l_2 w_2 + l_3 w_3 + l_4 w_4) / sqrt(E_1)
    closure = J_1 * E_2 / E_1 * (l_2 * w_2 + l_3 * w_3 + l_4 * w_4) ** 2
    B[..., 2] = (
        closure * l_2
        - (m_T + J_1 - m_3 - m_4) * l_2 * h_2 * w_2**2
        - ((m_T + J_1 + m_2 / 2) * l_2 * h_3 - (m_3 / 2 + m_4) * h_2 * l_3) * w_3**2
        - ((m_T + J_1 + m_2 / 2) * l_2 * h_4 - m_4 / 2 * h_2 * l_4) * w_4**2
    )
    B[..., 3] = (
        closure * l_3
        - ((m_T + J_1 + m_2 / 2) * l_3 * h_2 - (m_3 / 2 + m_4) * h_3 * l_2) * w_2**2
        - (m_T + J_1 + m_2 - m_4) * l_3 * h_3 * w_3**2
        - ((m_T + J_1 + m_2 + m_3 / 2) * l_3 * h_4 - m_4 / 2 * h_3 * l_4) * w_4**2
    )
    B[..., 4] = (
        closure * l_4
        - ((m_T + J_1 + m_2 / 2) * l_4 * h_2 - m_4 / 2 * h_4 * l_2) * w_2**2
        - ((m_T + J_1 + m_2 + m_3 / 2) * l_4 * h_3 - m_4 / 2 * h_4 * l_3) * w_3**2
        - (m_T + J_1 + m_2 + m_3) * l_4 * h_4 * w_4**2
    )
    return B


def mass_and_bias(arch: Arch, q: Array, q_dot: Array, gravity: float = 0.0) -> tuple[Array, Array]:
    """What a rigid-body engine returns: M(q) and bias(q, q') of M q'' + bias = applied forces, without springs.

    Args:
        arch: the constants.
        q: coordinates, shape (..., 6).
        q_dot: their rates, shape (..., 6).
        gravity: downward acceleration [m/s^2]; it acts like a table accelerating upwards.

    Returns:
        Mass matrix, shape (..., 6, 6), and bias, shape (..., 6); x has neither.
    """
    A = mass_matrix(arch, q)
    return A, -velocity_terms(arch, q, q_dot) + A[..., 0] * gravity


def strains(arch: Arch, q: Array) -> dict[str, tuple[Array, Array]]:
    """What each of the 13 constants resists, zero at rest: deformation (...), gradient (..., 6)."""
    d, g, unit = deformations(arch, q), gradients(arch, q), np.eye(6)
    joints = {
        "2": (d.d_2, g.d_2), "3": (d.d_3, g.d_3), "4": (d.d_4, g.d_4),
        "T": (q[..., Z_T], unit[Z_T]), "F": (q[..., Z_F], unit[Z_F]),
    }  # fmt: skip
    table = {f"{kind}_{i}": strain for kind in "kc" for i, strain in joints.items()}
    table |= {"k_11": (d.e, g.e), "k_12": (d.e - q[..., X], g.e - unit[X])}
    table |= {"c_1": (q[..., X], unit[X])}
    return {name: table[name] for name in PARAMETERS}


def potential(arch: Arch, q: Array) -> Array:
    """U(q) [J] of the consistent model, shape (...)."""
    of = strains(arch, q)
    # Eq. (4.9), the sum running to k_4
    return 0.5 * sum(getattr(arch, name) * of[name][0] ** 2 for name in SPRINGS)


def kinetic(arch: Arch, q: Array, q_dot: Array, v_B: float | Array = 0.0) -> Array:
    """T(q, q') [J] on a table moving at v_B [m/s], shape (...); Eq. (4.9)."""
    carried = q_dot.copy()
    carried[..., Z_F] = carried[..., Z_F] + v_B
    return 0.5 * np.einsum("...i,...ij,...j->...", carried, mass_matrix(arch, q), carried)


def dissipated_power(arch: Arch, q: Array, q_dot: Array) -> Array:
    """2 D [W], the power lost in all six dampers, shape (...); D is the dissipation of Eq. (4.9)."""
    of = strains(arch, q)
    return sum(getattr(arch, name) * (of[name][1] * q_dot).sum(axis=-1) ** 2 for name in DAMPERS)


def force_per_parameter(arch: Arch, q: Array, q_dot: Array) -> dict[str, Array]:
    """dQ/d(parameter) of the generalized force Q, each of shape (..., 6): the force of a spring or damper of one unit.

    Forces are linear in the 13 constants, so the same table gives the forces and their sensitivities.
    """
    return {
        name: -(stretch if name in SPRINGS else (slope * q_dot).sum(axis=-1))[..., None] * slope
        for name, (stretch, slope) in strains(arch, q).items()
    }


def spring_damper_forces(arch: Arch, q: Array, q_dot: Array) -> Array:
    """Generalized forces of all springs and dampers, shape (..., 6): -dU/dq - dD/dq' of Eq. (4.10)."""
    of_unit = force_per_parameter(arch, q, q_dot)
    return sum(getattr(arch, name) * force for name, force in of_unit.items())


def right_hand_side(arch: Arch, q: Array, q_dot: Array, base_acceleration: float | Array) -> Array:
    """B of Eq. (4.11), shape (..., 6): velocity terms, springs and dampers, and the table's acceleration [m/s^2]."""
    table = mass_matrix(arch, q)[..., 0] * np.asarray(base_acceleration)[..., None]
    return velocity_terms(arch, q, q_dot) + spring_damper_forces(arch, q, q_dot) - table
