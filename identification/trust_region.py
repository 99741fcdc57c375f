"""Steps of the trust-region-reflective method, compiled: what scipy's `least_squares` does, without its calls.

Branch, Coleman and Li (1999): distances to the bounds that the gradient points to scale the variables, so that steps
stay inside; the subproblem is solved by More's method on one singular value decomposition, and of the step up to the
bound, its reflection and the scaled gradient the best is taken. The search is the same as scipy's, step by step
(tests/test_compiled.py); only the hundred small Python calls of each step are gone.
"""

import numpy as np
from numba import njit


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
