"""The time-domain fit as scipy's documentation leads to it: what a user would otherwise run.

`solve_ivp(method="RK45")` inside a residual function for `least_squares`, the Jacobian by finite differences. It gets
all advantages: tight tolerances (the default rtol 1e-3 is too coarse for differences), a right-hand side on plain
numbers, the same spline as input, the same scaled search variable, bounds and noise, and difference steps above the
error of the integrator (scipy's default step lies below it). Its loop shares data and model with fasbody, nothing
else.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from fasbody.foot.two_dof import STATES, TwoDof
from identification.engines.twin import Twin
from identification.time_problem import TimeProblem

_DIFF_STEP, _RTOL, _ATOL = 1e-4, 1e-6, 1e-9


def fit(problem: TimeProblem, z0: np.ndarray, evaluations: int) -> tuple[np.ndarray, float]:
    """Estimate and weighted sum of squares of a problem with one recording and no delay.

    Args:
        problem: gives data, noise, scaling and bounds. z0: start of its full search variable. evaluations: `max_nfev`,
            residuals at trial points; those for differences come on top.
    """
    # The initial states are searched for as 1 + state, because scipy's difference step is relative to the variable.
    shift = np.where(np.arange(z0.size) < z0.size - STATES, 0.0, 1.0)
    low, high = problem.bounds
    solution = least_squares(
        lambda z: residual(problem, z - shift), z0 + shift, bounds=(low + shift, high + shift), method="trf",
        x_scale="jac", diff_step=_DIFF_STEP, max_nfev=evaluations,
    )  # fmt: skip
    return solution.x - shift, 2 * float(solution.cost)


def residual(problem: TimeProblem, z: np.ndarray) -> np.ndarray:
    """(n,) prediction error over its noise."""
    assert isinstance(problem.engine, Twin)
    recording, p = problem.recordings[0], problem.space.lower.size
    foot = TwoDof.from_values({**problem.space.values(problem.space.to_theta(z[:p])), **recording.condition.masses})
    t = recording.time_s - recording.time_s[0]
    x0 = problem.states(z, 0)[problem.engine.order]
    rates = plain_rates(foot, t, recording.base_m_s2)
    solution = solve_ivp(rates, (0.0, t[-1]), x0, method="RK45", t_eval=t, rtol=_RTOL, atol=_ATOL)
    if not solution.success:
        return np.full(t.size, 1e6)
    return (foot.output(solution.y) - recording.malleolus_m_s2) / problem.sigma[0]


def plain_rates(foot: TwoDof, t: np.ndarray, base: np.ndarray) -> Callable[[float, np.ndarray], tuple[float, ...]]:
    """`TwoDof.rates` without numpy, several times faster for four numbers; the base is the spline through samples."""
    c3, c2, c1, c0 = (row.tolist() for row in CubicSpline(t, base).c)
    rate, last = 1.0 / (t[1] - t[0]), t.size - 2
    k_T, k_F, c_11, c_12, c_13, c_21, c_22, c_23 = foot.theta.tolist()
    m_S, m_F, exp, cos = foot.m_S, foot.m_F, math.exp, math.cos

    def rates(time: float, x: np.ndarray) -> tuple[float, ...]:
        z1, z2, v1, v2 = x.tolist()
        i = min(int(time * rate), last)
        s = time - i / rate
        f_T = k_T * z1 + c_11 * exp(-c_12 * z1) * cos(c_13 * z1) * v1
        f_F = k_F * z2 + c_21 * exp(-c_22 * z2) * cos(c_23 * z2) * v2
        u = c0[i] + s * (c1[i] + s * (c2[i] + s * c3[i]))
        return v1, v2, (f_F - f_T) / m_F - f_T / m_S, (f_T - f_F) / m_F - u

    return rates
