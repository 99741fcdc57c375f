"""Positions of the five-body arch: closure, centres of mass, relative coordinates, spring deformations.

Every function takes the coordinates q = (z_F, z_T, theta_2, theta_3, theta_4, x) as an array of shape (..., 6), real or
complex (complex steps give exact derivatives), and works on all leading axes at once. z_F and z_T are displacements
from rest [m], angles are absolute and from the vertical [rad], x is the stretch of the aponeurosis' dashpot [m].
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fasbody.arch.bones import Arch
from fasbody.exceptions import SimulationError

#: Complex when the caller differentiates by complex steps.
Array = NDArray[Any]

#: Places of the coordinates z_F, z_T, theta_2, theta_3, theta_4, x everywhere.
Z_F, Z_T, THETA_2, THETA_3, THETA_4, X = range(6)


class Arms(NamedTuple):
    """Horizontal arms l_i = L_i sin theta_i, heights h_i = L_i cos theta_i, and E_1, E_2 of Appendix B."""

    l_2: Array
    l_3: Array
    l_4: Array
    h_2: Array
    h_3: Array
    h_4: Array
    E_1: Array  # (L_1 sin theta_1)^2
    E_2: Array  # L_1 cos theta_1


def rest(arch: Arch) -> Array:
    """The coordinates of the rest pose, shape (6,)."""
    return np.array([0.0, 0.0, arch.theta_20, arch.theta_30, arch.theta_40, 0.0])


def arms(arch: Arch, q: Array) -> Arms:
    """Arms and heights of the links [m], each of shape q.shape[:-1], at coordinates q (..., 6).

    Raises:
        SimulationError: at one of the poses the forefoot is higher than the hindfoot is long.
    """
    theta_2, theta_3, theta_4 = q[..., THETA_2], q[..., THETA_3], q[..., THETA_4]
    l_2, l_3, l_4 = arch.L_2 * np.sin(theta_2), arch.L_3 * np.sin(theta_3), arch.L_4 * np.sin(theta_4)
    h_2, h_3, h_4 = arch.L_2 * np.cos(theta_2), arch.L_3 * np.cos(theta_3), arch.L_4 * np.cos(theta_4)
    E_2 = h_2 + h_3 + h_4  # Eq. (4.6): L_1 cos theta_1, a scleronomic constraint (the thesis says rheonomic)
    E_1 = arch.L_1**2 - E_2**2
    if not (E_1.real > 0).all():
        raise SimulationError("the arch cannot close: its forefoot has risen above the length of the hindfoot.")
    return Arms(l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2)


def closing_angle(arch: Arch, q: Array) -> Array:
    """theta_1 [rad] that keeps heel and metatarsal heads at one height, shape (...)."""
    return np.arccos(arms(arch, q).E_2 / arch.L_1)  # Eq. (4.7)


def closing_gradient(arch: Arch, q: Array) -> Array:
    """Slope d theta_1 / d(theta_2, theta_3, theta_4), shape (..., 3): l_i / (L_1 sin theta_1)."""
    a = arms(arch, q)
    return np.stack([a.l_2, a.l_3, a.l_4], axis=-1) / np.sqrt(a.E_1)[..., None]


def centres(arch: Arch, q: Array, y_B: float | Array = 0.0) -> Array:
    """Centres of mass of tibia and bodies 1 to 4: (x, y) [m], shape (..., 5, 2); x = 0 is below the apex.

    Args:
        arch: the constants.
        q: coordinates, shape (..., 6).
        y_B: height of the shaker table [m].
    """
    a, theta_1 = arms(arch, q), closing_angle(arch, q)
    y_F, y_T = absolute(arch, q, y_B)
    zero = np.zeros_like(y_F)
    R_T = (zero, y_T)  # Eq. (4.1)
    R_1 = (-arch.L_1 / 2 * np.sin(theta_1), y_F + arch.L_1 / 2 * np.cos(theta_1))  # Eq. (4.2)
    R_2 = (a.l_2 / 2, y_F + a.h_2 / 2 + a.h_3 + a.h_4)  # Eq. (4.3)
    R_3 = (a.l_2 + a.l_3 / 2, y_F + a.h_3 / 2 + a.h_4)  # Eq. (4.4)
    R_4 = (a.l_2 + a.l_3 + a.l_4 / 2, y_F + a.h_4 / 2)  # Eq. (4.5)
    return np.stack([np.stack(np.broadcast_arrays(*R), axis=-1) for R in (R_T, R_1, R_2, R_3, R_4)], axis=-2)


def absolute(arch: Arch, q: Array, y_B: float | Array = 0.0) -> tuple[Array, Array]:
    """Heights y_F of the bottom of the foot and y_T of the tibia [m], the inverse of Eq. (4.8)."""
    y_F = q[..., Z_F] + y_B
    return y_F, q[..., Z_T] + y_F + arms(arch, q).E_2


def relative(arch: Arch, q: Array, y_F: Array, y_T: Array, y_B: float | Array = 0.0) -> tuple[Array, Array]:
    """z_F and z_T [m] from the heights; only the angles of `q` are read."""
    return y_F - y_B, y_T - (y_F + arms(arch, q).E_2)  # Eq. (4.8), with L_1 cos theta_1 = E_2


class Deformations(NamedTuple):
    """What stretches or turns each spring from rest, zero in the rest pose."""

    e: Array  # aponeurosis [m]
    d_2: Array  # apex, hindfoot to navicular [rad]
    d_3: Array  # navicular to cuneiforms [rad]
    d_4: Array  # cuneiforms to metatarsals [rad]


def deformations(arch: Arch, q: Array) -> Deformations:
    """Elongation of the aponeurosis and turn of the three joints, each of shape (...).

    The aponeurosis spans from heel to metatarsal heads. The elongation of the thesis multiplies in place of a
    difference and leaves out two of the links (docs/errata.md).
    """
    a = arms(arch, q)
    theta_1 = np.arccos(a.E_2 / arch.L_1)
    theta_2, theta_3, theta_4 = q[..., THETA_2], q[..., THETA_3], q[..., THETA_4]
    return Deformations(
        e=np.sqrt(a.E_1) + a.l_2 + a.l_3 + a.l_4 - arch.l_0,
        d_2=theta_1 + theta_2 - (arch.theta_10 + arch.theta_20),
        d_3=theta_3 - theta_2 - (arch.theta_30 - arch.theta_20),
        d_4=theta_4 - theta_3 - (arch.theta_40 - arch.theta_30),
    )


def gradients(arch: Arch, q: Array) -> Deformations:
    """d/dq of each deformation, each of shape (..., 6)."""
    a = arms(arch, q)
    zeros = np.zeros((*a.E_1.shape, 6), dtype=a.E_1.dtype)
    e, d_2, d_3, d_4 = zeros.copy(), zeros.copy(), zeros.copy(), zeros
    # L_i sin(theta_1 + theta_i) / sin theta_1: (13.19, 24.79, 59.41) mm at rest
    cot_1 = a.E_2 / np.sqrt(a.E_1)
    for i, l, h in ((THETA_2, a.l_2, a.h_2), (THETA_3, a.l_3, a.h_3), (THETA_4, a.l_4, a.h_4)):  # noqa: E741
        e[..., i] = cot_1 * l + h
        d_2[..., i] = l / np.sqrt(a.E_1)
    d_2[..., THETA_2] += 1
    d_3[..., THETA_2], d_3[..., THETA_3] = -1, 1
    d_4[..., THETA_3], d_4[..., THETA_4] = -1, 1
    return Deformations(e, d_2, d_3, d_4)
