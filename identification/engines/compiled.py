"""Descents of the steady-state problem in one compiled piece: orbit, harmonics, whitening and trust region.

A descent from a wild start takes some eighty evaluations of the twin, 0.05 ms each; called one by one from Python they
cost ten times that.

The steps are those of the trust-region-reflective method as scipy's `least_squares` takes them. Branch, Coleman and Li
(1999): distances to the bounds that the gradient points to scale the variables, so that steps stay inside; the
subproblem is solved by More's method on one singular value decomposition, and of the step up to the bound, its
reflection and the scaled gradient the best is taken. The search is the same as scipy's, step by step
(tests/test_compiled.py); only the hundred small Python calls of each step are gone.
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
from fasbody.foot.two_dof import NAMES, STATES, WITH_MASSES, both_periodic, periodic
from identification.engines.engine import LOST, PASSES, Excitation
from identification.engines.twin import Twin
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
            tolerance, gap, most,
        )  # fmt: skip


@njit(nogil=True, error_model="numpy")
def _residual(  # type: ignore[no-untyped-def]
    q, logarithmic, scale, column, fixed, delay, about, steps, inputs, counts, measured, whiten, shared, gap,
    last_x, last_dx, last_p, r, J,
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
    for i in range(counts.size):
        m_S, m_F, frequency, h = about[i]
        n, H = steps[i], counts[i]
        u = inputs[at_input : at_input + 2 * n + 1]
        guess = last_x[i] + last_dx[i] @ (p - last_p)
        Y, DY, x, dx, miss = periodic(guess, p, m_S, m_F, u, h, gap, PASSES)
        if not miss < gap:
            Y, DY, x, dx, miss = periodic(np.zeros(STATES), p, m_S, m_F, u, h, gap, PASSES)
        if not miss < LOST:
            return False
        last_x[i], last_dx[i] = x, dx
        W = whiten[at_whiten : at_whiten + 4 * H * H].reshape(2 * H, 2 * H)
        plain, D = np.empty(2 * H), np.zeros((2 * H, q.size))
        for k in range(H):
            turn = np.exp(-2j * np.pi * frequency * (k + 1) * delay) * 2.0 / n
            step, at = np.exp(-2j * np.pi * (k + 1) / n), turn
            A, DA = 0j, np.zeros(_P, np.complex128)
            for s in range(n):
                A += at * Y[s]
                for j in range(_P):
                    DA[j] += at * DY[s, j]
                at *= step
            error = A - measured[at_line + k]
            plain[k], plain[H + k] = error.real, error.imag
            for j in range(q.size):
                d = DA[column[j]] if column[j] >= 0 else -2j * np.pi * frequency * (k + 1) * A
                D[k, j], D[H + k, j] = d.real * slope[j], d.imag * slope[j]
        r[row : row + 2 * H] = W @ plain
        J[row : row + 2 * H] = W @ D
        at_input, at_line, at_whiten, row = at_input + 2 * n + 1, at_line + H, at_whiten + 4 * H * H, row + 2 * H
    for k in range(shared.shape[0]):
        along = shared[k]
        r -= along * (along @ r)
        J -= np.outer(along, along @ J)
    last_p[:] = p
    return bool(np.isfinite(r).all() and np.isfinite(J).all())


@njit(nogil=True, error_model="numpy")
def _descend(  # type: ignore[no-untyped-def]
    q0, low, high, logarithmic, scale, column, fixed, delay, about, steps, inputs, counts, measured, whiten, shared,
    tolerance, gap, most,
):  # fmt: skip
    """The method of scipy's `trf_bounds` with its exact solver and x_scale="jac"; names as there."""
    rows, p = 2 * counts.sum(), q0.size
    last_x, last_dx = np.zeros((counts.size, STATES)), np.zeros((counts.size, STATES, _P))
    last_p = fixed.copy()
    f, J, x = np.empty(rows), np.empty((rows, p)), q0.copy()
    f_new, J_new = np.empty(rows), np.empty((rows, p))
    data = (logarithmic, scale, column, fixed, delay, about, steps, inputs, counts, measured, whiten, shared, gap)
    if not _residual(x, *data, last_x, last_dx, last_p, f, J):
        return x, np.inf, 1, False
    cost, evaluations, alpha = 0.5 * (f @ f), 1, 0.0
    unit = np.zeros(p)  # largest column norms met
    radius = -1.0
    while evaluations < most:
        g = J.T @ f
        for j in range(p):
            unit[j] = max(unit[j], np.sqrt(np.sum(J[:, j] ** 2)))
        inverse = np.where(unit > 0.0, unit, 1.0)
        v, dv = scaling(x, g, low, high)
        steep = np.abs(g * v).max()
        v = np.where(dv != 0.0, v * inverse, v)
        if radius < 0.0:
            start = x * inverse / np.sqrt(v)
            radius = max(np.sqrt(start @ start), 1e-300)
        if steep < tolerance or 2.0 * cost <= ZERO * rows:
            return x, 2.0 * cost, evaluations, True
        d, diagonal = np.sqrt(v) / inverse, g * dv / inverse
        g_h = d * g
        augmented = np.zeros((rows + p, p))
        augmented[:rows] = J * d
        J_h = augmented[:rows]
        for j in range(p):
            augmented[rows + j, j] = np.sqrt(diagonal[j])
        U, s, Vt = np.linalg.svd(augmented, False)
        U_f = np.ascontiguousarray(U[:rows].T) @ f
        V = np.ascontiguousarray(Vt.T)
        theta = max(0.995, 1.0 - steep)
        improved = False
        while not improved and evaluations < most:
            step_h, alpha = restrained(U_f, s, V, radius, alpha, rows >= p)
            step, step_h, expected = reflected(x, J_h, g_h, diagonal, step_h, d, radius, low, high, theta)
            new = x + step
            for j in range(p):
                if new[j] <= low[j]:
                    new[j] = np.nextafter(low[j], high[j])
                elif new[j] >= high[j]:
                    new[j] = np.nextafter(high[j], low[j])
            evaluations += 1
            there = _residual(new, *data, last_x, last_dx, last_p, f_new, J_new)
            size = np.sqrt(step_h @ step_h)
            cost_new = 0.5 * (f_new @ f_new) if there else 0.5 * rows * UNSTABLE**2
            gain = cost - cost_new
            ratio = gain / expected if expected > 0.0 else 0.0
            before = radius
            if ratio < 0.25:
                radius = 0.25 * size
            elif ratio > 0.75 and size > 0.95 * radius:
                radius *= 2.0
            improved = gain > 0.0
            still = np.sqrt(step @ step) < tolerance * (tolerance + np.sqrt(x @ x))
            ended = still or (gain < tolerance * cost and ratio > 0.25)
            if ended:
                if improved:
                    x, cost = new, cost_new
                return x, 2.0 * cost, evaluations, True
            alpha *= before / radius
        if improved:
            x, cost = new, cost_new
            f[:], J[:] = f_new, J_new
    return x, 2.0 * cost, evaluations, False


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

    def __call__(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Harmonics (2, N) of shank and foot, recordings behind each other, and derivatives (2, N, 10) to all of theta.

        Args:
            theta: (R, 10) constants and masses of each recording. Returns None where a recording has no orbit.
        """
        Y, DY = np.empty((2, self._counts.sum()), complex), np.empty((2, self._counts.sum(), _P + 2), complex)
        found = _stamped_orbits(_sources())(
            theta, self._about, self._steps, self._inputs, self._counts, self._gap, self._x, self._dx, self._theta,
            Y, DY,
        )  # fmt: skip
        return (Y, DY) if found else None


@njit(nogil=True, error_model="numpy")
def _orbits(  # type: ignore[no-untyped-def]
    theta, about, steps, inputs, counts, gap, last_x, last_dx, last_theta, out, slopes
):  # fmt: skip
    """Fill harmonics and derivatives; returns whether every recording has an orbit."""
    at_input, row = 0, 0
    width = theta.shape[1]
    for i in range(counts.size):
        n, H = steps[i], counts[i]
        u, p = inputs[at_input : at_input + 2 * n + 1], theta[i, :_P].copy()
        guess, m_S, m_F, h = (
            last_x[i] + last_dx[i] @ (theta[i] - last_theta[i]),
            theta[i, _P],
            theta[i, _P + 1],
            about[i, 1],
        )
        miss = np.inf
        for _ in range(2):
            Y, DY, x, dx, miss, Z, DZ = both_periodic(guess, p, m_S, m_F, u, h, gap, PASSES, WITH_MASSES, True)
            if miss < gap:
                break
            guess = np.zeros(STATES)
        if not miss < LOST:
            return False
        last_x[i], last_dx[i], last_theta[i] = x, dx, theta[i]
        for k in range(H):
            step, at = np.exp(-2j * np.pi * (k + 1) / n), 2.0 / n + 0j
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


@functools.cache
def _stamped_orbits(stamp: int) -> Any:
    """`_orbits`, kept as `_stamped` is."""

    @njit(cache=True, nogil=True, error_model="numpy")
    def orbits(*arguments):  # type: ignore[no-untyped-def]
        assert stamp != 0
        return _orbits(*arguments)

    return orbits


@functools.cache
def _sources() -> int:
    """Digest of the files whose functions a descent calls."""
    digest = hashlib.sha256()
    for file in (two_dof.__file__, __file__):
        digest.update(Path(str(file)).read_bytes())
    return int.from_bytes(digest.digest()[:4], "big") | 1


@functools.cache
def _stamped(stamp: int) -> Any:
    """`_descend`, kept on disk by numba until a file changes that it calls: of those numba's cache knows nothing.

    A number in a closure belongs to the cache's key.
    """

    @njit(cache=True, nogil=True, error_model="numpy")
    def descend(*arguments):  # type: ignore[no-untyped-def]
        assert stamp != 0
        return _descend(*arguments)

    return descend


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
def restrained(U_f, s, V, radius, alpha, tall):  # type: ignore[no-untyped-def]
    """Step (p,) of least squares within a radius, and its damping.

    Args:
        U_f, s, V: U^T f, singular values and right vectors of the Jacobian. radius: of the trust region. alpha: damping
            of the last step. tall: the problem has as many residuals as variables.
    """
    full = tall and s[-1] > 2.220446049250313e-16 * U_f.size * s[0]
    if full:
        p = -(V @ (U_f / s))
        if np.sqrt(p @ p) <= radius:
            return p, 0.0
    s_f = s * U_f
    upper, lower = np.sqrt(s_f @ s_f) / radius, 0.0
    if full:
        length = np.sqrt(np.sum((s_f / s**2) ** 2))
        lower = (length - radius) / (np.sum(s_f**2 / s**6) / length)
    if not full and alpha == 0:
        alpha = max(0.001 * upper, np.sqrt(lower * upper))
    for _ in range(10):
        if alpha < lower or alpha > upper:
            alpha = max(0.001 * upper, np.sqrt(lower * upper))
        denominator = s**2 + alpha
        length = np.sqrt(np.sum((s_f / denominator) ** 2))
        phi, slope = length - radius, -np.sum(s_f**2 / denominator**3) / length
        if phi < 0:
            upper = alpha
        lower = max(lower, alpha - phi / slope)
        alpha -= length * phi / slope / radius
        if abs(phi) < 0.01 * radius:
            break
    p = -(V @ (s_f / (s**2 + alpha)))
    return p * (radius / np.sqrt(p @ p)), alpha


@njit(cache=True, error_model="numpy")
def _to_bound(x, s, low, high):  # type: ignore[no-untyped-def]
    """How often s fits between x and the nearest bound, and which coordinates hit it."""
    steps = np.full(x.size, np.inf)
    for j in range(x.size):
        if s[j] != 0.0:
            steps[j] = max((low[j] - x[j]) / s[j], (high[j] - x[j]) / s[j])
    least = steps.min()
    return least, steps == least


@njit(cache=True, error_model="numpy")
def _value(J, g, diagonal, s):  # type: ignore[no-untyped-def]
    Js = J @ s
    return 0.5 * (Js @ Js + s @ (diagonal * s)) + g @ s


@njit(cache=True, error_model="numpy")
def _best_along(J, g, diagonal, start, s, least, most):  # type: ignore[no-untyped-def]
    """The t in [least, most] with the lowest quadratic at start + t s, and that value."""
    Js, J0 = J @ s, J @ start
    a = 0.5 * (Js @ Js + s @ (diagonal * s))
    b = g @ s + J0 @ Js + start @ (diagonal * s)
    c = _value(J, g, diagonal, start)
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
    step = d * step_h
    if ((x + step >= low) & (x + step <= high)).all():
        return step, step_h, -_value(J, g, diagonal, step_h)
    stride, hits = _to_bound(x, step, low, high)
    mirror_h = np.where(hits, -step_h, step_h)
    step, step_h = step * stride, step_h * stride

    # to the trust region along the reflection
    a, b, c = mirror_h @ mirror_h, step_h @ mirror_h, step_h @ step_h - radius**2
    to_region = 0.0
    if c <= 0.0 and a > 0.0:
        q = -(b + np.copysign(np.sqrt(b * b - a * c), b))
        to_region = max(q / a, c / q)
    to_bound, _ = _to_bound(x + step, d * mirror_h, low, high)
    far = min(to_bound, to_region)
    value_r, step_r = np.inf, step_h
    if far > 0.0:
        near, most = (1.0 - theta) * stride / far, theta * to_bound if far == to_bound else to_region
        if near <= most:
            t, value_r = _best_along(J, g, diagonal, step_h, mirror_h, near, most)
            step_r = step_h + t * mirror_h

    step_h = step_h * theta
    value_p = _value(J, g, diagonal, step_h)

    down_h = -g
    to_region = radius / np.sqrt(g @ g)
    to_bound, _ = _to_bound(x, d * down_h, low, high)
    most = theta * to_bound if to_bound < to_region else to_region
    t, value_d = _best_along(J, g, diagonal, np.zeros(x.size), down_h, 0.0, most)
    if value_p < value_r and value_p < value_d:
        return d * step_h, step_h, -value_p
    if value_r < value_p and value_r < value_d:
        return d * step_r, step_r, -value_r
    return d * (t * down_h), t * down_h, -value_d
