"""The nonlinear arch in time: theta_1 eliminated, 11 states, integrated by an implicit method to a tight tolerance.

This is the oracle for the stepped MuJoCo arch: no closure constraint, no carrier mass, no step of its own. The
equations are stiff (light bones between strong dampers relax in 1e-8 s), hence Radau IIA with the exact Jacobian.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import THETA_2, THETA_3, THETA_4, Z_F, Z_T, Array, X, arms, rest
from fasbody.arch.lagrange import mass_matrix, spring_damper_forces, velocity_terms
from fasbody.exceptions import SimulationError

#: The 11 states: five coordinates, their rates, and x, which has no mass and therefore no rate of its own.
STATES = (
    "z_F", "z_T", "theta_2", "theta_3", "theta_4",
    "z_F_dot", "z_T_dot", "theta_2_dot", "theta_3_dot", "theta_4_dot", "x",
)  # fmt: skip

#: Magnitudes below which a state does not count [m, rad, m/s, rad/s]: absolute tolerance = relative tolerance x scale.
SCALE = np.array([1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-1, 1e-1, 1e-1, 1e-5])

_COMPLEX_STEP = 1e-30


@dataclass(frozen=True)
class Trajectory:
    """Motion of the arch at the given times.

    Attributes:
        time: [s], shape (n,).
        states: in the order of `STATES`, angles absolute, shape (n, 11).
        malleolus: acceleration of the malleolus [m/s^2], shape (n,).
        evaluations: calls of the right-hand side.
    """

    time: Array
    states: Array
    malleolus: Array
    evaluations: int

    @property
    def q(self) -> Array:
        """Coordinates, shape (n, 6)."""
        return self.states[:, [0, 1, 2, 3, 4, 10]]


def initial_state(arch: Arch) -> Array:
    """The rest pose without motion, shape (11,)."""
    return np.concatenate([rest(arch)[:5], np.zeros(6)])


def split(arch: Arch, states: Array) -> tuple[Array, Array, Array]:
    """Coordinates and rates q, q' of shape (..., 6), and the spring and damper forces; x' from B_6 = 0."""
    q = np.concatenate([states[..., :5], states[..., 10:]], axis=-1)
    q_dot = np.concatenate([states[..., 5:10], np.zeros_like(states[..., 10:])], axis=-1)
    forces = spring_damper_forces(arch, q, q_dot)
    q_dot[..., X] = forces[..., X] / arch.c_1
    return q, q_dot, forces


def state_rate(arch: Arch, states: Array, base_acceleration: float | Array) -> Array:
    """f(X, u) of Eq. (4.16), shape (..., 11), for table accelerations [m/s^2] of shape (...)."""
    q, q_dot, forces = split(arch, states)
    A = mass_matrix(arch, q)[..., :5, :5]
    B = (velocity_terms(arch, q, q_dot) + forces)[..., :5]
    B = B - A[..., 0] * np.asarray(base_acceleration)[..., None]
    q_ddot = np.linalg.solve(A, B[..., None])[..., 0]  # Eq. (4.11)
    return np.concatenate([q_dot[..., :5], q_ddot, q_dot[..., X:]], axis=-1)


def jacobian(arch: Arch, states: Array, base_acceleration: float | Array) -> Array:
    """J = df/dX by complex steps, exact to rounding, shape (..., 11, 11)."""
    stepped = states[..., None, :] + 1j * _COMPLEX_STEP * np.eye(11)
    rate = state_rate(arch, stepped, np.asarray(base_acceleration)[..., None])
    return np.swapaxes(rate.imag / _COMPLEX_STEP, -1, -2)


def malleolus_acceleration(arch: Arch, states: Array, base_acceleration: float | Array) -> Array:
    """y_out'' [m/s^2], shape (...)."""
    rate = state_rate(arch, states, base_acceleration)
    return malleolus_output(arch, states, rate, base_acceleration)


def malleolus_output(arch: Arch, states: Array, rate: Array, base_acceleration: float | Array) -> Array:
    """y_out'' [m/s^2] from the states and their known rates."""
    q = np.concatenate([states[..., :5], states[..., 10:]], axis=-1)
    l_2, l_3, l_4, h_2, h_3, h_4, _, _ = arms(arch, q)
    w, alpha = states[..., 5:10], rate[..., 5:10]
    return (  # Eq. (4.13)
        alpha[..., Z_T] + alpha[..., Z_F] + base_acceleration
        - h_2 * w[..., THETA_2] ** 2 - l_2 * alpha[..., THETA_2]
        - h_3 * w[..., THETA_3] ** 2 - l_3 * alpha[..., THETA_3]
        - h_4 * w[..., THETA_4] ** 2 - l_4 * alpha[..., THETA_4]
    )  # fmt: skip


def solve(
    arch: Arch,
    base_acceleration: Callable[[float], float],
    time: Array,
    initial: Array | None = None,
    gravity: float = 0.0,
    tolerance: float = 1e-9,
) -> Trajectory:
    """Integrate from time[0] to time[-1].

    Args:
        arch: the constants.
        base_acceleration: upward acceleration of the table [m/s^2] at a time [s].
        time: instants of the result [s], increasing, shape (n,).
        initial: states at time[0], shape (11,); None is the rest pose without motion.
        gravity: downward acceleration [m/s^2]; 0 when the rest pose is the loaded equilibrium.
        tolerance: relative tolerance of Radau IIA.

    Raises:
        SimulationError: the integration stopped before the end.
    """
    start = initial_state(arch) if initial is None else initial
    solution = solve_ivp(
        lambda t, state: state_rate(arch, state, base_acceleration(t) + gravity),
        (time[0], time[-1]), start, method="Radau", t_eval=time, rtol=tolerance, atol=tolerance * SCALE,
        jac=lambda t, state: jacobian(arch, state, base_acceleration(t) + gravity),
    )  # fmt: skip
    if not solution.success:
        raise SimulationError(f"the arch could be integrated to {solution.t[-1]:.4g} s only: {solution.message}")
    states = solution.y.T
    table = np.array([base_acceleration(t) for t in time])
    rate = state_rate(arch, states, table + gravity)
    return Trajectory(np.asarray(time), states, malleolus_output(arch, states, rate, table), solution.nfev)
