"""Descents of the steady-state problem in one compiled piece: orbit, harmonics, whitening and trust region.

A descent from a wild start takes some eighty evaluations of the twin, 0.05 ms each; called one by one from Python they
cost ten times that.

The steps are those of the trust-region-reflective method as scipy's `least_squares` takes them. Branch, Coleman and Li
(1999): distances to the bounds that the gradient points to scale the variables, so that steps stay inside; the
subproblem is solved by More's method on one singular value decomposition, and of the step up to the bound, its
reflection and the scaled gradient the best is taken. The search is the same as scipy's, step by step
(tests/test_compiled.py); only the hundred small Python calls of each step are gone.

Loops stand here instead of NumPy's words, and no constant is an argument of a compiled function: for each expression
and each constant numba compiles code of its own, and with every caller once more. The first fit waited a minute for it.
"""

import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from fasbody.foot import two_dof
from fasbody.foot.model import Foot
from fasbody.foot.two_dof import NAMES, STATES, both_periodic
from identification.engines.engine import LOST, PASSES, Excitation
from identification.engines.twin import Twin, twin_applies
from identification.search import UNSTABLE, ZERO
from identification.space import DELAY, Space

_P = len(NAMES)


@dataclass(frozen=True, eq=False)
class Compiled:
    """A steady-state problem of the twin as plain arrays; recordings lie behind each other.

    Args:
        twin: its excitations and inputs. space: what is free. measured: complex harmonics (H,) of each recording.
        whiten: (2 H, 2 H) of each. shared: (k, n) what all of them share (periodic.projection).
    """

    twin: Twin[Excitation]
    space: Space
    measured: list[np.ndarray]
    whiten: list[np.ndarray]
    shared: np.ndarray

    def descend(self, q0: np.ndarray, tolerance: float, gap: float, most: int) -> tuple[np.ndarray, float, int, bool]:
        """Minimise from q0.

        Args:
            q0: start (p,), inside the bounds. tolerance: of cost and step. gap: of the orbits. most: evaluations.

        Returns:
            The end (p,), its sum of squares (infinite if no orbit was found at the start), evaluations, convergence.
        """
        space, drives = self.space, self.twin.drives
        values = space.values(space.to_theta(q0))
        masses = [{**values, **e.masses} for e in drives]
        counts = np.array([m.size for m in self.measured])
        column = np.array([NAMES.index(i.name) if i.name != DELAY.name else -1 for i in space.free])
        low, high = space.bounds
        return _stamped(_sources())(
            q0, low, high, np.array([i.logarithmic for i in space.free]), space.scale, column,
            np.array([values[name] for name in NAMES]), float(values.get(DELAY.name, 0.0)),
            np.array([[m["m_S"], m["m_F"], e.frequency_hz, e.step] for m, e in zip(masses, drives, strict=True)]),
            np.array([e.steps for e in drives]), np.concatenate(self.twin.inputs), counts,
            np.concatenate(self.measured), np.concatenate([W.ravel() for W in self.whiten]), self.shared,
            tolerance, gap, most, PASSES, STATES + _P, False,
        )  # fmt: skip


@njit(nogil=True, error_model="numpy")
def _residual(  # type: ignore[no-untyped-def]
    q, logarithmic, scale, column, fixed, delay, about, steps, inputs, counts, measured, whiten, shared, gap,
    passes, columns, feet, last_x, last_dx, last_p, r, J,
):  # fmt: skip
    """Whitened residual r (n,) and Jacobian J (n, p) at q; returns whether every recording has an orbit."""
    p = fixed.copy()
    slope = np.empty(q.size)
    for j in range(q.size):
        value = np.exp(q[j]) if logarithmic[j] else q[j] * scale[j]
        slope[j] = value if logarithmic[j] else scale[j]
        if column[j] >= 0:
            p[column[j]] = value
        else:
            delay = value
    at_input, at_line, at_whiten, row = 0, 0, 0, 0
    guess, DA_real, DA_imag = (
        np.empty(STATES),
        np.empty(_P),
        np.empty(_P),
    )  # apart: a complex product is thrice the work
    for i in range(counts.size):
        m_S, m_F, frequency, h = about[i, 0], about[i, 1], about[i, 2], about[i, 3]
        n, H = steps[i], counts[i]
        u = inputs[at_input : at_input + 2 * n + 1]
        for k in range(STATES):
            guess[k] = last_x[i, k]
            for j in range(_P):
                guess[k] += last_dx[i, k, j] * (p[j] - last_p[j])
        miss = np.inf
        for _ in range(2):
            Y, DY, x, dx, miss, _, _ = both_periodic(guess, p, m_S, m_F, u, h, gap, passes, columns, feet)
            if miss < gap:
                break
            guess[:] = 0.0
        if not miss < LOST:
            return False
        for k in range(STATES):
            last_x[i, k] = x[k]
            for j in range(_P):
                last_dx[i, k, j] = dx[k, j]
        plain, D = np.empty(2 * H), np.empty((2 * H, q.size))
        for k in range(H):
            turn = -2.0 * np.pi * frequency * (k + 1) * delay
            at = (np.cos(turn) + 1j * np.sin(turn)) * (2.0 / n)
            turn = -2.0 * np.pi * (k + 1) / n
            step = np.cos(turn) + 1j * np.sin(turn)
            A = 0j
            DA_real[:], DA_imag[:] = 0.0, 0.0
            for s in range(n):
                A += at * Y[s]
                for j in range(_P):
                    DA_real[j] += at.real * DY[s, j]
                    DA_imag[j] += at.imag * DY[s, j]
                at *= step
            error = A - measured[at_line + k]
            plain[k], plain[H + k] = error.real, error.imag
            for j in range(q.size):
                d = -2j * np.pi * frequency * (k + 1) * A
                if column[j] >= 0:
                    d = complex(DA_real[column[j]], DA_imag[column[j]])
                D[k, j], D[H + k, j] = d.real * slope[j], d.imag * slope[j]
        for k in range(2 * H):
            r[row + k] = 0.0
            for j in range(q.size):
                J[row + k, j] = 0.0
            for s in range(2 * H):
                w = whiten[at_whiten + 2 * H * k + s]
                r[row + k] += w * plain[s]
                for j in range(q.size):
                    J[row + k, j] += w * D[s, j]
        at_input, at_line, at_whiten, row = at_input + 2 * n + 1, at_line + H, at_whiten + 4 * H * H, row + 2 * H
    by = np.empty(q.size)
    finite = True
    for k in range(shared.shape[0]):
        all_r = 0.0
        by[:] = 0.0
        for i in range(r.size):
            all_r += shared[k, i] * r[i]
            for j in range(q.size):
                by[j] += shared[k, i] * J[i, j]
        for i in range(r.size):
            r[i] -= shared[k, i] * all_r
            for j in range(q.size):
                J[i, j] -= shared[k, i] * by[j]
    for i in range(r.size):
        finite = finite and np.isfinite(r[i])
        for j in range(q.size):
            finite = finite and np.isfinite(J[i, j])
    for j in range(_P):
        last_p[j] = p[j]
    return finite


@njit(nogil=True, error_model="numpy")
def _dot(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@njit(nogil=True, error_model="numpy")
def _times(A, x):  # type: ignore[no-untyped-def]
    """A x."""
    out = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i] += A[i, j] * x[j]
    return out


@njit(nogil=True, error_model="numpy")
def _against(A, x):  # type: ignore[no-untyped-def]
    """A^T x for as many rows as x has."""
    out = np.zeros(A.shape[1])
    for i in range(x.size):
        for j in range(A.shape[1]):
            out[j] += A[i, j] * x[i]
    return out


class Orbits:
    """Harmonics of the twin's orbits of all recordings in one compiled call, and their derivatives.

    Args:
        twin: its drives and inputs. counts: harmonics of each recording. gap: of the orbits.
    """

    def __init__(self, twin: Twin[Excitation], counts: Sequence[int], gap: float) -> None:
        self._drives = twin.drives
        self._about = np.array([[e.frequency_hz, e.step] for e in twin.drives])
        self._steps, self._inputs = np.array([e.steps for e in twin.drives]), np.concatenate(twin.inputs)
        self._counts, self._gap = np.array(counts), gap
        self.forget()

    def forget(self) -> None:
        """Start the next orbits from rest."""
        n = len(self._drives)
        self._x, self._dx = np.zeros((n, STATES)), np.zeros((n, STATES, _P + 2))
        self._theta = np.zeros((n, _P + 2))

    def near(self, x: np.ndarray, theta: np.ndarray) -> None:
        """Start the next orbits from states x (R, 4) of feet theta (R, 10)."""
        self.forget()
        self._x[:], self._theta[:] = x, theta

    def __call__(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Harmonics (2, N) of shank and foot, recordings behind each other, and derivatives (2, N, 10) to all of theta.

        Args:
            theta: (R, 10) constants and masses of each recording. Returns None where a recording has no orbit.
        """
        Y, DY = np.empty((2, self._counts.sum()), complex), np.empty((2, self._counts.sum(), _P + 2), complex)
        found = _stamped_orbits(_sources())(
            theta, self._about, self._steps, self._inputs, self._counts, self._gap, PASSES, True, self._x, self._dx,
            self._theta, Y, DY,
        )  # fmt: skip
        return (Y, DY) if found else None


@functools.cache
def _stamped_orbits(stamp: int) -> Any:
    """What `Orbits` calls, kept as `_stamped` is."""

    @njit(cache=True, nogil=True, error_model="numpy")
    def orbits(  # type: ignore[no-untyped-def]
        theta, about, steps, inputs, counts, gap, passes, feet, last_x, last_dx, last_theta, out, slopes
    ):  # fmt: skip
        """Fill harmonics and derivatives; returns whether every recording has an orbit."""
        assert stamp != 0
        at_input, row = 0, 0
        width = theta.shape[1]
        guess, p = np.empty(STATES), np.empty(_P)
        for i in range(counts.size):
            n, H = steps[i], counts[i]
            u = inputs[at_input : at_input + 2 * n + 1]
            for j in range(_P):
                p[j] = theta[i, j]
            for k in range(STATES):
                guess[k] = last_x[i, k]
                for j in range(width):
                    guess[k] += last_dx[i, k, j] * (theta[i, j] - last_theta[i, j])
            m_S, m_F, h = theta[i, _P], theta[i, _P + 1], about[i, 1]
            miss = np.inf
            for _ in range(2):
                Y, DY, x, dx, miss, Z, DZ = both_periodic(guess, p, m_S, m_F, u, h, gap, passes, STATES + width, feet)
                if miss < gap:
                    break
                guess[:] = 0.0
            if not miss < LOST:
                return False
            for j in range(width):
                last_theta[i, j] = theta[i, j]
                for k in range(STATES):
                    last_dx[i, k, j] = dx[k, j]
            for k in range(STATES):
                last_x[i, k] = x[k]
            for k in range(H):
                turn = -2.0 * np.pi * (k + 1) / n
                step, at = np.cos(turn) + 1j * np.sin(turn), 2.0 / n + 0j
                out[:, row + k], slopes[:, row + k] = 0j, 0j
                for s in range(n):
                    out[0, row + k] += at * Y[s]
                    out[1, row + k] += at * Z[s]
                    for j in range(width):
                        slopes[0, row + k, j] += at * DY[s, j]
                        slopes[1, row + k, j] += at * DZ[s, j]
                    at *= step
            at_input, row = at_input + 2 * n + 1, row + H
        return True

    return orbits


#: The files whose functions a descent calls.
_FILES = (Path(str(two_dof.__file__)), Path(__file__))


@functools.cache
def _sources() -> int:
    """Digest of these files."""
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in _FILES))
    return int.from_bytes(digest.digest()[:4], "big") | 1


def cold() -> bool:
    """Whether the next descent is compiled first: numba keeps none on disk of these sources, younger than this file."""
    folder = Path(_stamped(_sources()).stats.cache_path)
    kept = [file.stat().st_mtime for file in folder.glob(f"*{_name(_sources())}*.nbc")]
    return max(kept, default=0.0) < Path(__file__).stat().st_mtime


def compiling(foot: Foot) -> str:
    """What to say before a first fit, which compiles the search; empty where that is on disk or not of this model."""
    if not (cold() and twin_applies(foot)):
        return ""
    return "compiling the search, once after each installation: the first fit takes about half a minute longer"


def _name(stamp: int) -> str:
    """The descent's name in those of the files that numba keeps."""
    return f"descend_{stamp:x}"


@functools.cache
def _stamped(stamp: int) -> Any:
    """The descent, kept on disk by numba until a file changes that it calls: of those numba's cache knows nothing.

    A number in a closure belongs to the cache's key.
    """

    def descend(  # type: ignore[no-untyped-def]
        q0, low, high, logarithmic, scale, column, fixed, delay, about, steps, inputs, counts, measured, whiten, shared,
        tolerance, gap, most, passes, columns, feet,
    ):  # fmt: skip
        """The method of scipy's `trf_bounds` with its exact solver and x_scale="jac"; names as there."""
        assert stamp != 0
        rows, p = 0, q0.size
        for i in range(counts.size):
            rows += 2 * counts[i]
        last_x, last_dx = np.zeros((counts.size, STATES)), np.zeros((counts.size, STATES, _P))
        last_p = fixed.copy()
        f, J, x, new = np.empty(rows), np.empty((rows, p)), q0.copy(), q0.copy()
        f_new, J_new = np.empty(rows), np.empty((rows, p))
        data = (logarithmic, scale, column, fixed, delay, about, steps, inputs, counts, measured, whiten, shared, gap)
        if not _residual(x, *data, passes, columns, feet, last_x, last_dx, last_p, f, J):
            return x, np.inf, 1, False
        cost, evaluations, alpha = 0.5 * _dot(f, f), 1, 0.0
        unit, inverse = np.zeros(p), np.empty(p)  # largest column norms met
        d, diagonal, g_h, augmented = np.empty(p), np.empty(p), np.empty(p), np.empty((rows + p, p))
        radius = -1.0
        while evaluations < most:
            g = _against(J, f)
            v, dv = scaling(x, g, low, high)
            steep, far = 0.0, 0.0
            for j in range(p):
                norm = 0.0
                for i in range(rows):
                    norm += J[i, j] ** 2
                unit[j] = max(unit[j], np.sqrt(norm))
                inverse[j] = unit[j] if unit[j] > 0.0 else 1.0
                steep = max(steep, abs(g[j] * v[j]))
                if dv[j] != 0.0:
                    v[j] *= inverse[j]
                far += (x[j] * inverse[j]) ** 2 / v[j]
            if radius < 0.0:
                radius = max(np.sqrt(far), 1e-300)
            if steep < tolerance or 2.0 * cost <= ZERO * rows:
                return x, 2.0 * cost, evaluations, True
            augmented[:] = 0.0
            for j in range(p):
                d[j], diagonal[j] = np.sqrt(v[j]) / inverse[j], g[j] * dv[j] / inverse[j]
                g_h[j] = d[j] * g[j]
                for i in range(rows):
                    augmented[i, j] = J[i, j] * d[j]
                augmented[rows + j, j] = np.sqrt(diagonal[j])
            J_h = augmented[:rows]
            U, s, Vt = np.linalg.svd(augmented, False)
            U_f = _against(U, f)
            theta = max(0.995, 1.0 - steep)
            improved = False
            while not improved and evaluations < most:
                step_h, alpha = restrained(U_f, s, Vt, radius, alpha, rows >= p)
                step, step_h, expected = reflected(x, J_h, g_h, diagonal, step_h, d, radius, low, high, theta)
                for j in range(p):
                    new[j] = x[j] + step[j]
                    if new[j] <= low[j]:
                        new[j] = np.nextafter(low[j], high[j])
                    elif new[j] >= high[j]:
                        new[j] = np.nextafter(high[j], low[j])
                evaluations += 1
                there = _residual(new, *data, passes, columns, feet, last_x, last_dx, last_p, f_new, J_new)
                size = np.sqrt(_dot(step_h, step_h))
                cost_new = 0.5 * _dot(f_new, f_new) if there else 0.5 * rows * UNSTABLE**2
                gain = cost - cost_new
                ratio = gain / expected if expected > 0.0 else 0.0
                before = radius
                if ratio < 0.25:
                    radius = 0.25 * size
                elif ratio > 0.75 and size > 0.95 * radius:
                    radius *= 2.0
                improved = gain > 0.0
                still = np.sqrt(_dot(step, step)) < tolerance * (tolerance + np.sqrt(_dot(x, x)))
                ended = still or (gain < tolerance * cost and ratio > 0.25)
                if improved:
                    x, new, cost = new, x, cost_new
                    f, f_new, J, J_new = f_new, f, J_new, J
                if ended:
                    return x, 2.0 * cost, evaluations, True
                alpha *= before / radius
        return x, 2.0 * cost, evaluations, False

    descend.__qualname__ = _name(stamp)
    return njit(cache=True, nogil=True, error_model="numpy")(descend)


@njit(cache=True, error_model="numpy")
def scaling(x, g, low, high):  # type: ignore[no-untyped-def]
    """Coleman and Li's v (p,) and its derivative: the distance to the bound that a descent heads for."""
    v, dv = np.empty(x.size), np.empty(x.size)
    for j in range(x.size):
        if g[j] < 0:
            v[j], dv[j] = high[j] - x[j], -1.0
        elif g[j] > 0:
            v[j], dv[j] = x[j] - low[j], 1.0
        else:
            v[j], dv[j] = 1.0, 0.0
    return v, dv


@njit(cache=True, error_model="numpy")
def restrained(U_f, s, Vt, radius, alpha, tall):  # type: ignore[no-untyped-def]
    """Step (p,) of least squares within a radius, and its damping.

    Args:
        U_f, s, Vt: U^T f, singular values and right vectors (rows) of the Jacobian. radius: of the trust region.
        alpha: damping of the last step. tall: the problem has as many residuals as variables.
    """
    n = s.size
    full = tall and s[n - 1] > 2.220446049250313e-16 * U_f.size * s[0]
    p = np.empty(n)
    if full:
        for j in range(n):
            p[j] = -U_f[j] / s[j]
        if np.sqrt(_dot(p, p)) <= radius:
            return _against(Vt, p), 0.0
    upper, lower = 0.0, 0.0
    for j in range(n):
        upper += (s[j] * U_f[j]) ** 2
    upper = np.sqrt(upper) / radius
    if full:
        length, slope = _secular(U_f, s, 0.0)
        lower = (length - radius) / -slope
    if not full and alpha == 0:
        alpha = max(0.001 * upper, np.sqrt(lower * upper))
    for _ in range(10):
        if alpha < lower or alpha > upper:
            alpha = max(0.001 * upper, np.sqrt(lower * upper))
        length, slope = _secular(U_f, s, alpha)
        phi = length - radius
        if phi < 0:
            upper = alpha
        lower = max(lower, alpha - phi / slope)
        alpha -= length * phi / slope / radius
        if abs(phi) < 0.01 * radius:
            break
    for j in range(n):
        p[j] = -s[j] * U_f[j] / (s[j] ** 2 + alpha)
    scale = radius / np.sqrt(_dot(p, p))
    for j in range(n):
        p[j] *= scale
    return _against(Vt, p), alpha


@njit(nogil=True, error_model="numpy")
def _secular(U_f, s, alpha):  # type: ignore[no-untyped-def]
    """Length of the step with damping alpha, and its derivative."""
    square, cube = 0.0, 0.0
    for j in range(s.size):
        below = s[j] ** 2 + alpha
        square += (s[j] * U_f[j] / below) ** 2
        cube += (s[j] * U_f[j]) ** 2 / below**3
    length = np.sqrt(square)
    return length, -cube / length


@njit(cache=True, error_model="numpy")
def _to_bound(x, s, low, high):  # type: ignore[no-untyped-def]
    """How often s fits between x and the nearest bound."""
    least = np.inf
    for j in range(x.size):
        if s[j] != 0.0:
            least = min(least, max((low[j] - x[j]) / s[j], (high[j] - x[j]) / s[j]))
    return least


@njit(cache=True, error_model="numpy")
def _value(J, g, diagonal, s):  # type: ignore[no-untyped-def]
    """The quadratic at s (p,)."""
    Js = _times(J, s)
    total = 0.5 * _dot(Js, Js)
    for j in range(s.size):
        total += 0.5 * diagonal[j] * s[j] ** 2 + g[j] * s[j]
    return total


@njit(cache=True, error_model="numpy")
def _best_along(J, g, diagonal, start, s, least, most):  # type: ignore[no-untyped-def]
    """The t in [least, most] with the lowest quadratic at start + t s, and that value."""
    Js, J0 = _times(J, s), _times(J, start)
    a, b, c = 0.5 * _dot(Js, Js), _dot(g, s) + _dot(J0, Js), _value(J, g, diagonal, start)
    for j in range(s.size):
        a += 0.5 * diagonal[j] * s[j] ** 2
        b += start[j] * diagonal[j] * s[j]
    best, value = least, least * (a * least + b) + c
    other = most * (a * most + b) + c
    if other < value:
        best, value = most, other
    if a != 0.0:
        inner = -0.5 * b / a
        if least < inner < most and inner * (a * inner + b) + c < value:
            best, value = inner, inner * (a * inner + b) + c
    return best, value


@njit(cache=True, error_model="numpy")
def reflected(x, J, g, diagonal, step_h, d, radius, low, high, theta):  # type: ignore[no-untyped-def]
    """The best of three steps that stay inside the bounds.

    Args:
        x: where (p,). J, g, diagonal: quadratic in the scaled variables. step_h: scaled step, d: its scale.
        radius: of the trust region. low, high: bounds. theta: share of the way to a bound that is gone.

    Returns:
        The step (p,), the same scaled, and the reduction of half the sum of squares that it promises.
    """
    n = x.size
    step, inside = np.empty(n), True
    for j in range(n):
        step[j] = d[j] * step_h[j]
        inside = inside and low[j] <= x[j] + step[j] <= high[j]
    if inside:
        return step, step_h, -_value(J, g, diagonal, step_h)
    stride = _to_bound(x, step, low, high)
    there, mirror, mirror_h, down, down_h = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    cut_h, start, step_r = np.empty(n), np.zeros(n), np.empty(n)
    for j in range(n):
        hits = step[j] != 0.0 and max((low[j] - x[j]) / step[j], (high[j] - x[j]) / step[j]) == stride
        mirror_h[j] = -step_h[j] if hits else step_h[j]
        mirror[j] = d[j] * mirror_h[j]
        cut_h[j] = step_h[j] * stride
        step_r[j] = cut_h[j]
        there[j] = x[j] + step[j] * stride
        down_h[j], down[j] = -g[j], -d[j] * g[j]

    # to the trust region along the reflection
    a, b, c = _dot(mirror_h, mirror_h), _dot(cut_h, mirror_h), _dot(cut_h, cut_h) - radius**2
    to_region = 0.0
    if c <= 0.0 and a > 0.0:
        q = -(b + np.copysign(np.sqrt(b * b - a * c), b))
        to_region = max(q / a, c / q)
    to_bound = _to_bound(there, mirror, low, high)
    far = min(to_bound, to_region)
    value_r = np.inf
    if far > 0.0:
        near, most = (1.0 - theta) * stride / far, theta * to_bound if far == to_bound else to_region
        if near <= most:
            t, value_r = _best_along(J, g, diagonal, cut_h, mirror_h, near, most)
            for j in range(n):
                step_r[j] = cut_h[j] + t * mirror_h[j]

    for j in range(n):
        cut_h[j] *= theta
    value_p = _value(J, g, diagonal, cut_h)

    to_region = radius / np.sqrt(_dot(g, g))
    to_bound = _to_bound(x, down, low, high)
    most = theta * to_bound if to_bound < to_region else to_region
    t, value_d = _best_along(J, g, diagonal, start, down_h, 0.0, most)
    for j in range(n):
        down_h[j] *= t
    best, value = down_h, value_d
    if value_p < value_r and value_p < value_d:
        best, value = cut_h, value_p
    elif value_r < value_p and value_r < value_d:
        best, value = step_r, value_r
    for j in range(n):
        step[j] = d[j] * best[j]
    return step, best, -value
