"""The linear five-body arch, Eq. (4.12) to Eq. (4.14), and the linear two-mass model it is reduced to, Eq. (4.30).

Convention: M q'' + C q' + K q = -M[:, z_F] y_B'' with q measured from rest and C, K positive (the thesis has both on
the right with negative entries). K of the consistent model is a sum of squares, so it is positive definite.
"""

from dataclasses import dataclass

import numpy as np

from fasbody.arch.bones import SPRINGS, Arch
from fasbody.arch.kinematics import Array, X, arms, rest
from fasbody.arch.lagrange import mass_matrix, right_hand_side, strains


@dataclass(frozen=True)
class Linear:
    """M, C, K of shape (6, 6) and the malleolus' row, shape (6,), of the arch about a pose."""

    M: Array
    C: Array
    K: Array
    out: Array


def linearise(arch: Arch, q: Array | None = None, gravity: float = 0.0) -> Linear:
    """The matrices of Eq. (4.12), consistent model.

    Args:
        arch: the constants.
        q: an equilibrium under `gravity` [m/s^2], shape (6,); None is the rest pose, where no spring pulls.
        gravity: downward acceleration [m/s^2].
    """
    pose = rest(arch) if q is None else q
    K, C = np.zeros((6, 6)), np.zeros((6, 6))
    for name, (_, g) in strains(arch, pose).items():
        matrix = K if name in SPRINGS else C
        matrix += getattr(arch, name) * np.outer(g, g)
    if q is not None:  # stretched springs and weight turn with the pose
        K = (right_hand_side(arch, q + 1e-30j * np.eye(6), np.zeros(6), gravity).imag / -1e-30).T
    a = arms(arch, pose)
    out = np.array([1.0, 1.0, -a.l_2, -a.l_3, -a.l_4, 0.0])  # Eq. (4.14): y_out'' = y_B'' + out . q''
    return Linear(mass_matrix(arch, pose), C, K, out)


def response(model: Linear, frequency_hz: Array) -> Array:
    """Malleolus over table acceleration, complex, shape of `frequency_hz` [Hz]."""
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
    dynamic = s[..., None, None] ** 2 * model.M + s[..., None, None] * model.C + model.K
    q = np.linalg.solve(dynamic, np.broadcast_to(-model.M[:, :1], (*s.shape, 6, 1)))[..., 0]
    return 1 + s**2 * (q @ model.out)  # Eq. (4.14)


def transmissibility(arch: Arch, frequency_hz: Array) -> Array:
    """Malleolus over table acceleration of the arch about rest, complex, shape of `frequency_hz` [Hz]."""
    return response(linearise(arch), frequency_hz)


def state_space(arch: Arch) -> tuple[Array, Array, Array, float]:
    """A, b, c, d of the 11 states (z_F, z_T, theta_2, theta_3, theta_4, their rates, x): input y_B'', output y_out''.

    x has no mass: its own equation, c_1 x' = k_12 (e - x), is of first order.
    """
    model = linearise(arch)
    M, K, C = model.M[:5, :5], model.K, model.C[:5, :5]
    A = np.zeros((11, 11))
    A[:5, 5:10] = np.eye(5)
    A[5:10, :5] = -np.linalg.solve(M, K[:5, :5])
    A[5:10, 5:10] = -np.linalg.solve(M, C)
    A[5:10, 10] = -np.linalg.solve(M, K[:5, X])
    A[10, :5], A[10, 10] = -K[X, :5] / arch.c_1, -K[X, X] / arch.c_1
    b = np.zeros(11)
    b[5:10] = -np.linalg.solve(M, M[:, 0])
    out = model.out[:5]
    return A, b, out @ A[5:10], float(1 + out @ b[5:10])


def modes(arch: Arch) -> tuple[Array, Array]:
    """Natural frequencies [Hz] and damping ratios of the oscillating modes, slowest first."""
    values = np.linalg.eigvals(state_space(arch)[0])
    values = values[values.imag > 1e-9 * np.abs(values)]
    values = values[np.argsort(np.abs(values))]
    return np.abs(values) / (2 * np.pi), -values.real / np.abs(values)


def two_mass_state_space(
    m_S: float, m_F: float, k_T: float, k_F: float, c_T: float, c_F: float
) -> tuple[Array, Array, Array]:
    """A (4, 4), b (4,) of Eq. (4.30) and c (4,) of Eq. (4.31), states (z_1, z_2, z_1', z_2'), input y_0''."""
    A = np.array([
        [0, 0, 1, 0],
        [0, 0, 0, 1],
        [-(m_S + m_F) * k_T / (m_S * m_F), k_F / m_F, -(m_S + m_F) * c_T / (m_S * m_F), c_F / m_F],
        [k_T / m_F, -k_F / m_F, c_T / m_F, -c_F / m_F],
    ])  # Eq. (4.30)  # fmt: skip
    return A, np.array([0.0, 0.0, 0.0, -1.0]), -np.array([k_T, 0.0, c_T, 0.0]) / m_S  # Eq. (4.31)


def two_mass_transmissibility(arch: Arch, frequency_hz: Array) -> Array:
    """Malleolus over table acceleration (n,) of the arch's two-mass reduction.

    At (n,) [Hz]; the arch is rigid, m_S = m_T, m_F = sum m_i.
    """
    A, b, c = two_mass_state_space(arch.m_T, arch.m_F, arch.k_T, arch.k_F, arch.c_T, arch.c_F)
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)[..., None, None]
    states = np.linalg.solve(s * np.eye(4) - A, np.broadcast_to(b[:, None], (*s.shape[:-2], 4, 1)))
    return states[..., 0] @ c
