"""The arch at rest under a load on its apex or under its own weight, and the linear model about that pose.

Static means after the dashpot of the aponeurosis has yielded: only k_11 holds. A load on the apex leaves z_F = -W / k_F
and z_T = -W / k_T apart from the angles, so that the arch itself is three equations, solved by Newton's method.
"""

from dataclasses import dataclass

import numpy as np

from fasbody.arch import Arch
from fasbody.exceptions import SimulationError
from fasbody.kinematics import Array, X, arms, deformations, gradients, rest
from fasbody.lagrange import force_per_parameter, right_hand_side
from fasbody.linear import Linear, linearise

#: Acceleration of gravity [m/s^2].
G = 9.81

_STEP = 1e-30


@dataclass(frozen=True)
class Equilibrium:
    """The relaxed arch under a vertical load on its apex.

    Attributes:
        q: the pose, shape (6,), with x yielded.
        sag: fall of the apex towards the floor of the arch [m].
        elongation: of the aponeurosis [m].
        stiffness: of the arch, d load / d sag [N/m].
        share: part of the load that the aponeurosis carries, tension x d elongation / d sag / load.
        heel: part of the load that presses on the heel, the rest on the metatarsal heads.
    """

    q: Array
    sag: float
    elongation: float
    stiffness: float
    share: float
    heel: float


def equilibrium(arch: Arch, load: float, steps: int = 20) -> Equilibrium:
    """Settle the arch under `load` [N] > 0 on its apex, raised in equal steps.

    Raises:
        SimulationError: the arch collapses under the load.
    """
    q = rest(arch)
    for force in np.linspace(load / steps, load, steps):
        q = _settle(arch, q, force, load)
    a, e = arms(arch, q), float(deformations(arch, q).e)
    fall = np.array([a.l_2, a.l_3, a.l_4])  # d sag / d theta
    give = np.linalg.solve(-_tangent(arch, q, load), fall)  # d theta / d load
    lengthening = gradients(arch, q).e[2:5] @ give / (fall @ give)
    q[0], q[1], q[X] = -load / arch.k_F, -load / arch.k_T, e
    share = arch.k_11 * e * lengthening / load
    front = a.l_2 + a.l_3 + a.l_4  # moments of both contact points about the apex
    heel = front / (front + np.sqrt(a.E_1))
    return Equilibrium(q, float(arch.height_0 - a.E_2), e, float(1 / (fall @ give)), float(share), float(heel))


def _settle(arch: Arch, q: Array, force: float, load: float) -> Array:
    """Newton's method for one of the forces on the way to `load` [N]; flat or unstable counts as collapsed."""
    for _ in range(50):
        step = np.linalg.solve(_tangent(arch, q, force), _moments(arch, q, force))
        q = q.copy()
        q[2:5] -= step
        if not np.abs(step).max() < 1 or not abs(apex_height(arch, q)) < arch.L_1:
            break
        if np.abs(step).max() < 1e-13:
            tangent = _tangent(arch, q, force)
            if apex_height(arch, q) > 0 and np.linalg.eigvalsh(-(tangent + tangent.T) / 2)[0] > 0:
                return q
            break
    raise SimulationError(
        f"the arch of {arch.height_0 * 1e3:.0f} mm collapses under {load:.0f} N (at {force:.0f} N on the way); "
        "lower the load or stiffen k_2, k_3, k_4 or k_11."
    )


def apex_height(arch: Arch, q: Array) -> float:
    """Height of the apex [m], which needs no closed arch."""
    return float(np.cos(q[2:5]) @ [arch.L_2, arch.L_3, arch.L_4])


def _moments(arch: Arch, q: Array, load: float) -> Array:
    """Moments about theta_2, theta_3, theta_4 with the dashpot yielded, shape (3,)."""
    table, a = force_per_parameter(arch, q, np.zeros(6)), arms(arch, q)
    springs = sum(getattr(arch, name) * table[name] for name in ("k_11", "k_2", "k_3", "k_4"))
    return springs[2:5] + load * np.array([a.l_2, a.l_3, a.l_4])


def _tangent(arch: Arch, q: Array, load: float) -> Array:
    return np.stack([_moments(arch, q + 1j * _STEP * unit, load).imag / _STEP for unit in np.eye(6)[2:5]], axis=-1)


def loaded(arch: Arch, gravity: float = G) -> Linear:
    """M, C, K and output row about the pose in which the arch carries its own weight and the tibia's."""
    start = equilibrium(arch, (arch.m_T + arch.m_1 / 2) * gravity).q
    q = under_weight(arch, start, gravity)
    return linearise(arch, q, gravity)


def under_weight(arch: Arch, q: Array, gravity: float) -> Array:
    """The pose, shape (6,), at which all six right-hand sides vanish under gravity: springs, dashpot and every mass."""

    def residual(pose: Array) -> Array:
        return right_hand_side(arch, pose, np.zeros(6), gravity)

    for _ in range(50):
        tangent = np.stack([residual(q + 1j * _STEP * unit).imag / _STEP for unit in np.eye(6)], axis=-1)
        step = np.linalg.solve(tangent, residual(q))
        q = q - step
        if np.abs(step).max() < 1e-13 and apex_height(arch, q) > 0:
            return q
    raise SimulationError("the arch collapses under its own weight; stiffen k_2, k_3, k_4 or k_11.")
