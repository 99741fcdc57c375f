"""The arch once more, from energies alone: what Appendix B and Eq. 4.12 are held against.

Mass matrix and velocity terms come from the positions of Eqs. 4.1 to 4.7 by complex steps, springs and dampers from the
deformations that reproduce the printed forces (docs/errata.md). No entry of Appendix B is used.
"""

from dataclasses import replace

import numpy as np

from fasbody.arch import lagrange
from fasbody.arch.bones import DAMPERS, SPRINGS, Arch
from fasbody.arch.kinematics import Array, X, arms, centres, closing_angle, rest
from fasbody.arch.ode import initial_state, split, state_rate

_STEP = 1e-30
#: Coordinates with mass: all but x.
_MASSY = np.eye(6)[:5]


def mass_from_energy(arch: Arch, q: Array) -> Array:
    """Hessian of the kinetic energy in the rates, shape (5, 5)."""
    m = np.array([arch.m_T, arch.m_1, arch.m_2, arch.m_3, arch.m_4])
    velocity = np.array([centres(arch, q + 1j * _STEP * unit).imag / _STEP for unit in _MASSY])  # (5, bodies, 2)
    turns = np.array([_angles(arch, q + 1j * _STEP * unit).imag / _STEP for unit in _MASSY])  # (5, 4)
    inertia = np.array([arch.I_1, arch.I_2, arch.I_3, arch.I_4])
    return np.einsum("ibx,jbx,b->ij", velocity, velocity, m) + np.einsum("ib,jb,b->ij", turns, turns, inertia)


def _angles(arch: Arch, q: Array) -> Array:
    return np.array([closing_angle(arch, q), *q[2:5]])


def velocity_terms_from_energy(arch: Arch, q: Array, q_dot: Array, step: float = 1e-5) -> Array:
    """Centrifugal and Coriolis terms on the right-hand side, shape (5,), from differences of the mass matrix."""
    sides = [[mass_from_energy(arch, q + sign * step * unit) for unit in _MASSY] for sign in (1, -1)]
    slope = (np.array(sides[0]) - np.array(sides[1])) / (2 * step)  # d A_ij / d q_k as [k, i, j]
    w = q_dot[:5]
    return 0.5 * np.einsum("kij,i,j->k", slope, w, w) - np.einsum("kij,k,j->i", slope, w, w)


def _printed_elongations(arch: Arch, q: Array) -> tuple[Array, Array, Array, Array, Array]:
    """delta_11 as the product it was printed as, delta_12, and the three turns."""
    a, theta_1 = arms(arch, q), closing_angle(arch, q)
    front = arch.L_2 * (np.sin(q[2]) - np.sin(arch.theta_20))
    return (
        -np.sqrt(a.E_1) * arch.L_1 * np.sin(arch.theta_10) + front,
        front - q[X],
        theta_1 + q[2] - arch.theta_10 - arch.theta_20,
        q[3] - q[2] - arch.theta_30 + arch.theta_20,
        q[4] - q[3] - arch.theta_40 + arch.theta_30,
    )


def _printed_force(arch: Arch, q: Array) -> Array:
    """Minus the gradient of the energy with the printed deformations, shape (6,), complex where q is."""
    d = np.array(_printed_elongations(arch, q))
    units, h = np.eye(6), 1e-6
    slopes = np.array([
        (np.array(_printed_elongations(arch, q + h * u)) - np.array(_printed_elongations(arch, q - h * u))) / (2 * h)
        for u in units
    ])  # fmt: skip
    k = np.array([arch.k_11, arch.k_12, arch.k_2, arch.k_3, arch.k_4])
    return -slopes @ (k * d) - np.array([arch.k_F * q[0], arch.k_T * q[1], 0, 0, 0, 0])


def printed_stiffness(arch: Arch) -> Array:
    """Slope of those forces at rest, the printed convention of K in Eq. 4.12, shape (6, 6)."""
    q, h = rest(arch), 1e-4
    sides = [[_printed_force(arch, q + sign * h * unit) for unit in np.eye(6)] for sign in (1, -1)]
    return ((np.array(sides[0]) - np.array(sides[1])) / (2 * h)).T


def printed_damping(arch: Arch, q: Array | None = None) -> Array:
    """Dashpots on the rates stated in docs/errata.md, in the printed convention of C, shape (6, 6); q None: at rest."""
    q, unit, h = rest(arch) if q is None else q, np.eye(6), 1e-6
    slope = np.array([
        (np.array(_printed_elongations(arch, q + h * u)) - np.array(_printed_elongations(arch, q - h * u))) / (2 * h)
        for u in unit
    ]).T  # fmt: skip
    product = slope[0] - np.r_[0, 0, arch.L_2 * np.cos(q[2]), 0, 0, 0]  # delta_11 without its last term
    dashpots = (
        (arch.c_1, unit[X] + product), (arch.c_2, slope[2]), (arch.c_3, unit[3]), (arch.c_4, unit[4]),
        (arch.c_F, unit[0]), (arch.c_T, unit[1]),
    )  # fmt: skip
    return -np.sum([c * np.outer(direction, direction) for c, direction in dashpots], axis=0)


def differing(ours: Array, right: Array) -> set[tuple[int, int]]:
    """Places, from 1, at which two matrices differ by more than the differences above can be wrong."""
    scale = np.abs(right).max()
    if scale == 0:
        scale = 1.0
    return {(int(i) + 1, int(j) + 1) for i, j in np.argwhere(np.abs(ours - right) > 1e-5 * scale)}


def energy_drift(arch: Arch, duration: float = 0.05, steps: int = 10_000) -> float:
    """Largest change of T + U of the released arch, over its size, by the classical Runge-Kutta scheme."""
    state, h = initial_state(arch).copy(), duration / steps
    state[:5] += np.array([1e-4, 2e-4, 1e-3, -1e-3, 1e-3])

    def energy(s: Array) -> float:
        q, q_dot, _ = split(arch, s)
        return float(lagrange.kinetic(arch, q, q_dot) + lagrange.potential(arch, q))

    first, worst = energy(state), 0.0
    for _ in range(steps):
        k1 = state_rate(arch, state, 0.0)
        k2 = state_rate(arch, state + h / 2 * k1, 0.0)
        k3 = state_rate(arch, state + h / 2 * k2, 0.0)
        k4 = state_rate(arch, state + h * k3, 0.0)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        worst = max(worst, abs(energy(state) - first))
    return worst / first


def only(arch: Arch, name: str) -> Arch:
    """The arch with one of its 13 constants left; c_1 cannot be zero, so it is made negligible."""
    others = dict.fromkeys(SPRINGS + DAMPERS, 0.0) | {"c_1": 1e-300}
    return replace(arch, **others | {name: getattr(arch, name)})
