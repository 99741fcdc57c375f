"""Coordinates of the equations and of the tree that MuJoCo and Pinocchio see, both ways.

The tree hangs from the apex and closes at heel and metatarsal heads (mjcf/foot_arch/README.md); the equations have
the closure built in. With q = (z_F, z_T, theta_2, theta_3, theta_4, x) and the tree's velocities v = T(q) q', any
engine's mass matrix M and bias b become those of Eq. (4.11) by A = T^T M T and T^T (b + M T' q').
"""

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Z_F, Z_T, Array, X, arms, closing_angle, closing_gradient, deformations, gradients


def tree_position(arch: Arch, q: Array) -> Array:
    """Joint positions of the tree in the order of `mjcf.JOINTS`, shape (..., 6), for coordinates of shape (..., 6)."""
    d, a = deformations(arch, q), arms(arch, q)
    apex = q[..., Z_F] + a.E_2 - arch.height_0
    hindfoot = arch.theta_10 - closing_angle(arch, q)
    return np.stack([apex, q[..., Z_T], hindfoot, d.d_2, d.d_3, d.d_4], axis=-1)


def tree_jacobian(arch: Arch, q: Array) -> Array:
    """T = d(tree)/dq, shape (..., 6, 6); the column of x is zero."""
    g, a, slope = gradients(arch, q), arms(arch, q), closing_gradient(arch, q)
    T = np.zeros((*q.shape[:-1], 6, 6), dtype=q.dtype)
    T[..., 0, Z_F], T[..., 1, Z_T] = 1, 1
    T[..., 0, 2:5] = -np.stack([a.l_2, a.l_3, a.l_4], axis=-1)
    T[..., 2, 2:5] = -slope
    for row, gradient in enumerate((g.d_2, g.d_3, g.d_4), 3):
        T[..., row, :X] = gradient[..., :X]
    return T


def tree_drift(arch: Arch, q: Array, q_dot: Array) -> Array:
    """T' q', the tree's acceleration at q'' = 0, shape (..., 6)."""
    T_dot = tree_jacobian(arch, q + 1e-30j * q_dot).imag / 1e-30
    return np.einsum("...ij,...j->...i", T_dot, q_dot)


def project(arch: Arch, q: Array, q_dot: Array, M: Array, bias: Array) -> tuple[Array, Array]:
    """Mass matrix and bias of the tree (base left out, order of `mjcf.JOINTS`) in the coordinates of the equations.

    Args:
        arch: the constants.
        q: coordinates, shape (..., 6).
        q_dot: their rates, shape (..., 6).
        M: the engine's mass matrix, shape (..., 6, 6).
        bias: the engine's bias force, shape (..., 6).

    Returns:
        A and bias as `lagrange.mass_and_bias` gives them.
    """
    T = tree_jacobian(arch, q)
    turned = np.swapaxes(T, -1, -2)
    force = bias + np.einsum("...ij,...j->...i", M, tree_drift(arch, q, q_dot))
    return turned @ M @ T, np.einsum("...ij,...j->...i", turned, force)
