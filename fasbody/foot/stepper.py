"""The compiled twin of the two-mass foot in the time domain, with exact forward sensitivities.

It integrates the states of `two_dof` and their derivatives with respect to the four initial states, the eight
parameters and, optionally, the two masses together, with the same Runge-Kutta scheme, step and input as the MuJoCo
model, so that the two differ by rounding only. numba compiles it the first time that it runs.
"""

import numpy as np
from numba import njit

from fasbody.foot.two_dof import NAMES, STATES

_COLUMNS = STATES + len(NAMES)
#: Columns that are computed: a constant number, so that the compiler vectorises the loop without a remainder.
_ROW = 16


def trajectory(
    x0: np.ndarray, p: np.ndarray, m_S: float, m_F: float, u: np.ndarray, h: float, stride: int, columns: int
) -> tuple[np.ndarray, ...]:
    """Integrate states and sensitivities by fourth-order Runge-Kutta.

    Args:
        x0: (4,) initial states.
        p: (8,) parameters in the order of `two_dof.NAMES`.
        m_S, m_F: masses [kg].
        u: (2 n + 1,) base acceleration at half steps [m/s^2] (`BaseMotion.half_steps`).
        h: step [s].
        stride: output every `stride` steps.
        columns: 0 no sensitivities, 4 those to the initial states, 12 those to the parameters as
            well, 14 those to m_S and m_F, too.

    Returns:
        Y (n // stride,) malleolus acceleration, Eq. (4.31); DY (n // stride, 12 or 14) its derivatives (x0 first, then
        p, then the masses); the final states (4,) and their derivatives (4, 12 or 14).
    """
    Y, DY, x, S, _, _ = both(x0, p, m_S, m_F, u, h, stride, columns, False)
    return Y, DY, x, S


@njit(cache=True, nogil=True, error_model="numpy")
def both(x0, p, m_S, m_F, u, h, stride, columns, feet):  # type: ignore[no-untyped-def]
    """`trajectory` with the acceleration of the foot's mass beside that of the malleolus.

    Compiled callers give no constant for `stride`, `columns` and `feet`: numba compiles anew for each that it sees.

    Args: as `trajectory`.
        feet: compute what follows it in the result, else that is empty.

    Returns:
        What `trajectory` does, then the acceleration of the foot's mass (n // stride,) and its derivatives.
    """
    n, width = (u.size - 1) // 2, max(_COLUMNS, columns)
    Y, DY = np.empty(n // stride), np.zeros((n // stride, width))
    rows = n // stride if feet else 0
    Z, DZ = np.empty(rows), np.zeros((rows, width))
    k_T, k_F, c_11, c_12, c_13, c_21, c_22, c_23 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]
    a_T, a_F = 1.0 / m_F + 1.0 / m_S, 1.0 / m_F
    x_0, x_1, x_2, x_3 = x0[0], x0[1], x0[2], x0[3]
    f_0, f_1, f_2, f_3 = 0.0, 0.0, 0.0, 0.0
    # Rows of sensitivities in one array: 0 to 3 of the states, 6 to 9 of the rates, 10 to 13 what a step adds, 14 and
    # 15 what z1'' and z2'' have of the parameters themselves.
    W = np.zeros(16 * _ROW)
    for i in range(STATES):
        W[i * _ROW + i] = 1.0
    a, b = 14 * _ROW + STATES, 15 * _ROW + STATES
    row, skipped = 0, 0
    for k in range(n):
        s_0, s_1, s_2, s_3 = 0.0, 0.0, 0.0, 0.0  # of the four stages' rates
        for stage in range(4):
            w = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            share = 1.0 if stage == 0 or stage == 3 else 2.0
            z_0, z_1, z_2, z_3 = x_0 + w * f_0, x_1 + w * f_1, x_2 + w * f_2, x_3 + w * f_3
            g_T, g_F = np.exp(-c_12 * z_0), np.exp(-c_22 * z_1)
            cos_T, cos_F = np.cos(c_13 * z_0), np.cos(c_23 * z_1)
            c_T, c_F = c_11 * g_T * cos_T, c_21 * g_F * cos_F  # Eq. (4.32)
            f_T, f_F = c_T * z_2 + k_T * z_0, c_F * z_3 + k_F * z_1
            shank, between = f_T / m_S, (f_F - f_T) / m_F
            f_0, f_1, f_2, f_3 = z_2, z_3, between - shank, -between - u[2 * k + (stage + 1) // 2]  # Eq. (4.29)
            s_0, s_1, s_2, s_3 = s_0 + share * f_0, s_1 + share * f_1, s_2 + share * f_2, s_3 + share * f_3
            if columns > 0:
                sin_T, sin_F = np.sin(c_13 * z_0), np.sin(c_23 * z_1)
                T, F = (  # dF_T/dz1 and dF_F/dz2
                    k_T - z_2 * c_11 * g_T * (c_12 * cos_T + c_13 * sin_T),
                    k_F - z_3 * c_21 * g_F * (c_22 * cos_F + c_23 * sin_F),
                )
                A_00, A_01, A_02, A_03 = -a_T * T, a_F * F, -a_T * c_T, a_F * c_F
                A_10, A_11, A_12, A_13 = a_F * T, -a_F * F, a_F * c_T, -a_F * c_F
                if columns > STATES:
                    # dF_T/d(k_T, c_11, c_12, c_13) and dF_F/d(k_F, c_21, c_22, c_23), then the masses
                    d_0, d_1 = z_0, g_T * cos_T * z_2
                    d_2, d_3 = -z_0 * c_T * z_2, -z_0 * c_11 * g_T * sin_T * z_2
                    W[a], W[a + 2], W[a + 3], W[a + 4] = -a_T * d_0, -a_T * d_1, -a_T * d_2, -a_T * d_3
                    W[b], W[b + 2], W[b + 3], W[b + 4] = a_F * d_0, a_F * d_1, a_F * d_2, a_F * d_3
                    d_0, d_1 = z_1, g_F * cos_F * z_3
                    d_2, d_3 = -z_1 * c_F * z_3, -z_1 * c_21 * g_F * sin_F * z_3
                    W[a + 1], W[a + 5], W[a + 6], W[a + 7] = a_F * d_0, a_F * d_1, a_F * d_2, a_F * d_3
                    W[b + 1], W[b + 5], W[b + 6], W[b + 7] = -a_F * d_0, -a_F * d_1, -a_F * d_2, -a_F * d_3
                if columns > _COLUMNS:
                    W[a + 8], W[a + 9], W[b + 9] = f_T / m_S**2, (f_T - f_F) / m_F**2, (f_F - f_T) / m_F**2
                for j in range(_ROW):
                    v_0, v_1 = W[j] + w * W[6 * _ROW + j], W[_ROW + j] + w * W[7 * _ROW + j]
                    v_2, v_3 = W[2 * _ROW + j] + w * W[8 * _ROW + j], W[3 * _ROW + j] + w * W[9 * _ROW + j]
                    y_2 = A_00 * v_0 + A_01 * v_1 + A_02 * v_2 + A_03 * v_3 + W[14 * _ROW + j]
                    y_3 = A_10 * v_0 + A_11 * v_1 + A_12 * v_2 + A_13 * v_3 + W[15 * _ROW + j]
                    W[6 * _ROW + j], W[7 * _ROW + j], W[8 * _ROW + j], W[9 * _ROW + j] = v_2, v_3, y_2, y_3
                    W[10 * _ROW + j] += share * v_2
                    W[11 * _ROW + j] += share * v_3
                    W[12 * _ROW + j] += share * y_2
                    W[13 * _ROW + j] += share * y_3
            if stage == 0 and skipped == 0 and row < Y.size:
                Y[row] = -shank  # Eq. (4.31)
                for j in range(columns):  # y = z1'' + z2'' + u, so its derivative is the sum of two rows
                    DY[row, j] = W[8 * _ROW + j] + W[9 * _ROW + j]
                if feet:
                    Z[row] = f_3 + u[2 * k]  # z2'' + u
                    for j in range(columns):
                        DZ[row, j] = W[9 * _ROW + j]
                row += 1
        skipped += 1
        if skipped == stride:
            skipped = 0
        sixth = h / 6.0
        x_0, x_1, x_2, x_3 = x_0 + sixth * s_0, x_1 + sixth * s_1, x_2 + sixth * s_2, x_3 + sixth * s_3
        if columns > 0:
            for j in range(STATES * _ROW):
                W[j] += sixth * W[10 * _ROW + j]
                W[10 * _ROW + j] = 0.0
    x, S = np.empty(STATES), np.zeros((STATES, width))
    x[0], x[1], x[2], x[3] = x_0, x_1, x_2, x_3
    for i in range(STATES):
        for j in range(columns):
            S[i, j] = W[i * _ROW + j]
    return Y, DY, x, S, Z, DZ
