"""The steady motion of the two-mass foot and of its rivals by harmonic balance, with exact derivatives, compiled.

One set of equations holds for every rival, and a rival is what of it differs from zero. With the motions z1 of the
ankle and z2 of the pad as harmonics, forces that bend (springs, dampers) are evaluated at instants of a period and
projected back; all that is linear is a number a harmonic, at s = i h omega:

    M(s) [s^2 (Z1 + Z2) + U] + N_T + k_T R(r_T) Z1 = 0
    m_F  [s^2 Z2 + U] - N_T - k_T R(r_T) Z1 + N_F + k_F R(r_F) Z2 = 0
    N   of  k [(exp(b z) - 1) / b + p z^2 + d z^3] + c_1 exp(-c_2 z) cos(c_3 z) z'
    R(r) = r s tau / (1 + s tau)                             a spring that relaxes (Zener)
    M(s) = load + m_S [1 - w + w T(s; f_w, zeta_w)]          a share w of the shank hangs on a spring
    T(s; f, zeta) = (1 + 2 zeta s / W) / (1 + 2 zeta s / W + (s / W)^2), W = 2 pi f

What the sensor gives is Y = [s^2 (Z1 + Z2) + U] T(s; 1 / sqrt(u), zeta_u) (1 + gain + drift x) exp(-s delay), with x
from -1/2 to 1/2 over a session. Springs and dampers may follow the load: k_T, c_11 times exp(e_T load / 2.3 kg), and
so for the pad.

Loops stand here instead of NumPy's words, which take numba many times as long to compile.
"""

import numpy as np
from numba import njit

from fasbody.foot.two_dof import solved

#: Constants in the order of the compiled code; the first twenty-two move the foot, the others only its sensor.
CONSTANTS = (
    "k_T", "k_F", "c_11", "c_12", "c_13", "c_21", "c_22", "c_23", "b_T", "p_T", "d_T", "b_F", "p_F", "d_F", "r_T",
    "r_F", "tau", "w", "f_w", "zeta_w", "m_S", "m_F", "e_T", "e_F", "u", "zeta_u", "gain", "drift", "delay",
)  # fmt: skip
INDEX = {name: i for i, name in enumerate(CONSTANTS)}
#: Harmonics of the motion, and instants of a period.
HARMONICS, INSTANTS = 8, 32
#: Load at which e_T and e_F are told [kg].
LOAD_KG = 2.3
_MOVING, _ALL = 22, len(CONSTANTS)
_SIZE = 2 * HARMONICS + 1
_PASSES, _LARGEST, _SMALL = 40, 2e-3, 1e-6
_theta = 2 * np.pi * np.arange(INSTANTS) / INSTANTS
_h = np.arange(1, HARMONICS + 1)
#: Positions (N, 2 H + 1) of the real coefficients (mean, then real and imaginary part of each harmonic), their rates
#: over omega, and the way back.
_E = np.ones((INSTANTS, _SIZE))
_E[:, 1::2], _E[:, 2::2] = np.cos(np.outer(_theta, _h)), -np.sin(np.outer(_theta, _h))
_V = np.zeros((INSTANTS, _SIZE))
_V[:, 1::2], _V[:, 2::2] = -_h * np.sin(np.outer(_theta, _h)), -_h * np.cos(np.outer(_theta, _h))
_OF = np.ascontiguousarray(np.hstack([_E, _V]).T)
_BACK = np.ascontiguousarray((_E * np.where(np.arange(_SIZE) == 0, 1.0, 2.0)).T / INSTANTS)


@njit(cache=True, error_model="numpy")
def _moved(q, first, w, z, v):  # type: ignore[no-untyped-def]
    """Position z (N,) and velocity v (N,) of the coefficients q from the first on."""
    z[:], v[:] = 0.0, 0.0
    for k in range(_SIZE):
        a = q[first + k]
        for t in range(INSTANTS):
            z[t] += _OF[k, t] * a
            v[t] += _OF[_SIZE + k, t] * (w * a)


@njit(cache=True, error_model="numpy")
def _projected(force, stiff, damp, w, N, G):  # type: ignore[no-untyped-def]
    """Coefficients N (n,) of a force, and G (n, n) their derivatives to those of the motion."""
    N[:], G[:] = 0.0, 0.0
    row = np.empty(_SIZE)
    for t in range(INSTANTS):
        for k in range(_SIZE):
            row[k] = stiff[t] * _E[t, k] + w * damp[t] * _V[t, k]
        for i in range(_SIZE):
            N[i] += _BACK[i, t] * force[t]
            for k in range(_SIZE):
                G[i, k] += _BACK[i, t] * row[k]


@njit(cache=True, error_model="numpy")
def _joint(z, v, k, c1, c2, c3, b, p, d, force, stiff, damp, by):  # type: ignore[no-untyped-def]
    """Force, tangents to z and z', and derivatives (n, 7) to k, c1, c2, c3, b, p, d of a joint that bends."""
    for t in range(z.size):
        x = z[t]
        if abs(b * x) < 1e-5:
            shape, slope, bend = x + b * x * x / 2, 1 + b * x, x * x / 2 + b * x**3 / 3
        else:
            grown = np.exp(b * x)
            shape, slope = (grown - 1) / b, grown
            bend = (x * grown - shape) / b
        shape, slope = shape + p * x * x + d * x**3, slope + 2 * p * x + 3 * d * x * x
        decay = np.exp(-c2 * x)
        cos, sin = decay * np.cos(c3 * x), decay * np.sin(c3 * x)
        force[t] = k * shape + c1 * cos * v[t]  # Eq. (4.25) beside the spring
        stiff[t] = k * slope - c1 * (c2 * cos + c3 * sin) * v[t]
        damp[t] = c1 * cos
        by[t, 0], by[t, 1], by[t, 2], by[t, 3] = shape, cos * v[t], -c1 * x * cos * v[t], -c1 * x * sin * v[t]
        by[t, 4], by[t, 5], by[t, 6] = k * bend, k * x * x, k * x**3


@njit(cache=True, error_model="numpy")
def _add(A, i, j, h, z):  # type: ignore[no-untyped-def]
    """Add the complex number z of harmonic h to block (i, j) of the real matrix A."""
    a, c = i * _SIZE + 2 * h - 1, j * _SIZE + 2 * h - 1
    A[a, c] += z.real
    A[a, c + 1] -= z.imag
    A[a + 1, c] += z.imag
    A[a + 1, c + 1] += z.real


@njit(cache=True, error_model="numpy")
def _put(B, i, h, column, z):  # type: ignore[no-untyped-def]
    """Add the complex number z of harmonic h to rows of block i of the right-hand sides B."""
    a = i * _SIZE + 2 * h - 1
    B[a, column] += z.real
    B[a + 1, column] += z.imag


@njit(cache=True, error_model="numpy")
def motion(c, load, hz, U, q):  # type: ignore[no-untyped-def]
    """Newton's method on the balance of one recording.

    Args:
        c: constants, in the order of `CONSTANTS`. load: on the knee [kg]. hz: fundamental.
        U: (H',) complex harmonics of the base [m/s^2], from the first. q: (2 (2 H + 1),) coefficients of z1 and z2 [m]
            to begin with, overwritten.

    Returns:
        Whether it came to rest, and the derivatives (2 (2 H + 1), 22 + 2 H') of q to the moving constants and to the
        real and imaginary parts of U.
    """
    n, w, count = _SIZE, 2 * np.pi * hz, U.size
    k_T, c_T = c[0] * np.exp(c[22] * load / LOAD_KG), c[2] * np.exp(c[22] * load / LOAD_KG)
    k_F, c_F = c[1] * np.exp(c[23] * load / LOAD_KG), c[5] * np.exp(c[23] * load / LOAD_KG)
    tau, share, m_S, m_F = c[16], c[17], c[20], c[21]
    own, zeta = 2 * np.pi * c[18], c[19]
    N = _E.shape[0]
    f1, s1, d1, by1 = np.empty(N), np.empty(N), np.empty(N), np.empty((N, 7))
    f2, s2, d2, by2 = np.empty(N), np.empty(N), np.empty(N), np.empty((N, 7))
    A, R = np.empty((2 * n, 2 * n)), np.empty((2 * n, 1))
    z1, v1, z2, v2 = np.empty(N), np.empty(N), np.empty(N), np.empty(N)
    N1, G1, N2, G2 = np.empty(n), np.empty((n, n)), np.empty(n), np.empty((n, n))
    kept = A
    M, T = np.empty(HARMONICS, np.complex128), np.empty(HARMONICS, np.complex128)
    for h in range(HARMONICS):
        s = 1j * w * (h + 1)
        above = 1 + 2 * zeta * s / own
        T[h] = above / (above + (s / own) ** 2)
        M[h] = load + m_S * (1 - share + share * T[h])
    settled = False
    for _ in range(_PASSES):
        _moved(q, 0, w, z1, v1)
        _moved(q, n, w, z2, v2)
        _joint(z1, v1, k_T, c_T, c[3], c[4], c[8], c[9], c[10], f1, s1, d1, by1)
        _joint(z2, v2, k_F, c_F, c[6], c[7], c[11], c[12], c[13], f2, s2, d2, by2)
        finite = True
        for t in range(N):
            finite = finite and np.isfinite(f1[t]) and np.isfinite(f2[t])
        if not finite:
            return False, np.empty((0, 0))
        _projected(f1, s1, d1, w, N1, G1)
        _projected(f2, s2, d2, w, N2, G2)
        for i in range(n):
            R[i, 0], R[n + i, 0] = N1[i], N2[i] - N1[i]
            for k in range(n):
                A[i, k], A[i, n + k], A[n + i, k], A[n + i, n + k] = G1[i, k], 0.0, -G1[i, k], G2[i, k]
        for h in range(1, HARMONICS + 1):
            s = 1j * w * h
            relax = s * tau / (1 + s * tau)
            a, b = c[14] * k_T * relax, c[15] * k_F * relax
            _add(A, 0, 0, h, M[h - 1] * s * s + a)
            _add(A, 0, 1, h, M[h - 1] * s * s)
            _add(A, 1, 0, h, -a)
            _add(A, 1, 1, h, m_F * s * s + b)
            Z1, Z2 = q[2 * h - 1] + 1j * q[2 * h], q[n + 2 * h - 1] + 1j * q[n + 2 * h]
            u = U[h - 1] if h <= count else 0j
            one = M[h - 1] * (s * s * (Z1 + Z2) + u) + a * Z1
            two = m_F * (s * s * Z2 + u) - a * Z1 + b * Z2
            R[2 * h - 1, 0] += one.real
            R[2 * h, 0] += one.imag
            R[n + 2 * h - 1, 0] += two.real
            R[n + 2 * h, 0] += two.imag
        kept = A.copy()
        if not solved(A, R):
            return False, np.empty((0, 0))
        size, largest = 0.0, 0.0
        for i in range(2 * n):
            finite = finite and np.isfinite(R[i, 0])
            size = max(size, abs(R[i, 0]))
        if not finite:
            return False, np.empty((0, 0))
        for i in range(2 * n):
            q[i] -= R[i, 0] * min(1.0, _LARGEST / size)
            largest = max(largest, abs(q[i]))
        if size < _SMALL * largest + 1e-16:  # what is left is the square of it
            settled = True
            break
    if not settled:
        return False, np.empty((0, 0))
    B = np.zeros((2 * n, _MOVING + 2 * count + 2))
    to_T, to_F = (0, 2, 3, 4, 8, 9, 10), (1, 5, 6, 7, 11, 12, 13)
    up_T, up_F = np.exp(c[22] * load / LOAD_KG), np.exp(c[23] * load / LOAD_KG)
    P1, P2 = np.zeros((n, 7)), np.zeros((n, 7))
    for t in range(N):
        for i in range(n):
            for j in range(7):
                P1[i, j] += _BACK[i, t] * by1[t, j]
                P2[i, j] += _BACK[i, t] * by2[t, j]
    for j in range(7):
        for i in range(n):
            one, two = P1[i, j] * (up_T if j < 2 else 1.0), P2[i, j] * (up_F if j < 2 else 1.0)
            B[i, to_T[j]], B[n + i, to_T[j]] = one, -one
            B[n + i, to_F[j]] = two
    for h in range(1, HARMONICS + 1):
        s = 1j * w * h
        x = s * tau
        relax = x / (1 + x)
        by_tau = s / (1 + x) ** 2
        Z1, Z2 = q[2 * h - 1] + 1j * q[2 * h], q[n + 2 * h - 1] + 1j * q[n + 2 * h]
        u = U[h - 1] if h <= count else 0j
        for column, z in ((0, c[14] * up_T * relax), (14, k_T * relax), (16, c[14] * k_T * by_tau)):
            _put(B, 0, h, column, z * Z1)
            _put(B, 1, h, column, -z * Z1)
        for column, z in ((1, c[15] * up_F * relax), (15, k_F * relax), (16, c[15] * k_F * by_tau)):
            _put(B, 1, h, column, z * Z2)
        moved = s * s * (Z1 + Z2) + u
        v = s / own
        below = 1 + 2 * zeta * v + v * v
        by_v = (2 * zeta * below - (1 + 2 * zeta * v) * (2 * zeta + 2 * v)) / below**2
        by_zeta = 2 * v * v * v / below**2
        _put(B, 0, h, 17, m_S * (T[h - 1] - 1) * moved)
        _put(B, 0, h, 18, -m_S * share * by_v * v / c[18] * moved)
        _put(B, 0, h, 19, m_S * share * by_zeta * moved)
        _put(B, 0, h, 20, (1 - share + share * T[h - 1]) * moved)
        _put(B, 1, h, 21, s * s * Z2 + u)
        if h <= count:
            for part, i in ((0, 1.0 + 0j), (1, 1j)):
                _put(B, 0, h, _MOVING + 2 * (h - 1) + part, M[h - 1] * i)
                _put(B, 1, h, _MOVING + 2 * (h - 1) + part, m_F * i)
    last = _MOVING + 2 * count
    for i in range(2 * n):  # k and c of a joint follow the load together
        B[i, last] = (c[0] * B[i, 0] + c[2] * B[i, 2]) * load / LOAD_KG
        B[i, last + 1] = (c[1] * B[i, 1] + c[5] * B[i, 5]) * load / LOAD_KG
        for j in range(last + 2):
            B[i, j] = -B[i, j]
    return solved(kept, B), B


@njit(cache=True, error_model="numpy")
def felt(c, load, hz, U, place, q, noisy):  # type: ignore[no-untyped-def]
    """What the malleolus' sensor gives in one recording; arguments as `motion`.

    Args:
        place: of the recording in its session, -1/2 to 1/2. noisy: derivatives to U instead of those to the constants.

    Returns:
        Whether there is a motion, harmonics Y (H',) [m/s^2], and derivatives (H', 29) or (H', 2 H').
    """
    count, n = U.size, _SIZE
    found, dq = motion(c, load, hz, U, q)
    width = 2 * count if noisy else _ALL
    Y, D = np.zeros(count, np.complex128), np.zeros((count, width), np.complex128)
    if not found:
        return False, Y, D
    for h in range(1, count + 1):
        s = 2j * np.pi * hz * h
        a, b = 2 * h - 1, 2 * h
        moved = s * s * (q[a] + q[n + a] + 1j * (q[b] + q[n + b])) + U[h - 1]
        f = hz * h
        root = np.sqrt(max(c[24], 0.0))
        upper = 1 + 2j * c[25] * f * root
        lower = upper - f * f * c[24]
        mount = upper / lower
        turn = -2 * np.pi * hz * h * c[28]
        late = np.cos(turn) + 1j * np.sin(turn)
        chain = (1 + c[26] + c[27] * place) * late
        Y[h - 1] = moved * mount * chain
        if noisy:
            for j in range(2 * count):
                k = _MOVING + j
                D[h - 1, j] = s * s * (dq[a, k] + dq[n + a, k] + 1j * (dq[b, k] + dq[n + b, k]))
            D[h - 1, 2 * h - 2] += 1.0
            D[h - 1, 2 * h - 1] += 1j
            for j in range(2 * count):
                D[h - 1, j] *= mount * chain
            continue
        for j in range(24):
            k = j if j < 22 else _MOVING + 2 * count + j - 22
            D[h - 1, j] = s * s * (dq[a, k] + dq[n + a, k] + 1j * (dq[b, k] + dq[n + b, k])) * mount * chain
        D[h - 1, 24] = moved * f * f * (1 + 1j * c[25] * f * root) / lower**2 * chain
        D[h - 1, 25] = moved * 2j * f * root * (lower - upper) / lower**2 * chain
        D[h - 1, 26] = moved * mount * late
        D[h - 1, 27] = moved * mount * late * place
        D[h - 1, 28] = -s * Y[h - 1]
    return True, Y, D


@njit(cache=True, error_model="numpy")
def whitened(c, loads, hz, U, counts, places, measured, W, starts, q, r, J):  # type: ignore[no-untyped-def]
    """Whitened residual and its derivatives to the constants, of all recordings.

    Args:
        c: (29,) constants. loads, hz, places: (n,). U, measured: (n, H) complex, of which counts (n,) are used.
        W: (n, 2 H, 2 H) whiteners. starts: (n,) first row of each. q: (n, 2 (2 H + 1)) motions, overwritten.
        r: (m,) and J: (m, 29), overwritten.

    Returns:
        Whether every recording has a motion.
    """
    noisy = J.shape[1] != _ALL  # False, and no constant, for which numba would compile `felt` once more
    for i in range(loads.size):
        k = counts[i]
        found, Y, D = felt(c, loads[i], hz[i], U[i, :k], places[i], q[i], noisy)
        if not found:
            q[i] = 0.0
            found, Y, D = felt(c, loads[i], hz[i], U[i, :k], places[i], q[i], noisy)
            if not found:
                q[i] = 0.0
                return False
        gap, by = np.empty(2 * k), np.empty((2 * k, _ALL))
        for h in range(k):
            gap[h], gap[k + h] = (Y[h] - measured[i, h]).real, (Y[h] - measured[i, h]).imag
            for j in range(_ALL):
                by[h, j], by[k + h, j] = D[h, j].real, D[h, j].imag
        for h in range(2 * k):
            row = starts[i] + h
            r[row] = 0.0
            for j in range(_ALL):
                J[row, j] = 0.0
            for m in range(2 * k):
                r[row] += W[i, h, m] * gap[m]
                for j in range(_ALL):
                    J[row, j] += W[i, h, m] * by[m, j]
    return True
