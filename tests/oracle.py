"""The two-mass foot a second time: Eq. 4.26 in displacements relative to the base, integrated by SciPy's DOP853.

Shares no line with the package, so that a slip in its equations, its engine or its input shows as a difference.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

Force = Callable[[float, float], float]

#: Four feet: the bundled truth, one of medium stiffness, a stiff one, a soft one; masses of subject 16.
MASSES = {"m_S": 0.0465 * 72.57, "m_F": 0.0145 * 72.57}
TRUTH = {"k_T": 1.31e5, "k_F": 9.4e4, "c_11": 380, "c_12": 90, "c_13": 140, "c_21": 760, "c_22": -120, "c_23": 180}
MEDIUM = {"k_T": 1e5, "k_F": 1e5, "c_11": 300, "c_12": 50, "c_13": 100, "c_21": 800, "c_22": -50, "c_23": 100}
STIFF = {"k_T": 2e5, "k_F": 3e5, "c_11": 800, "c_12": 60, "c_13": 120, "c_21": 2000, "c_22": -80, "c_23": 150}
SOFT = {"k_T": 3e4, "k_F": 2e4, "c_11": 200, "c_12": 40, "c_13": 60, "c_21": 300, "c_22": -40, "c_23": 60}
FEET = {"truth": TRUTH, "medium": MEDIUM, "stiff": STIFF, "soft": SOFT}


def spring_and_damper(k: float, c1: float, c2: float, c3: float) -> Force:
    """Tension of a linear spring beside the nonlinear damper."""
    return lambda x, v: k * x + c1 * math.exp(-c2 * x) * math.cos(c3 * x) * v


def ankle_of(p: dict[str, float]) -> Force:
    return spring_and_damper(p["k_T"], p["c_11"], p["c_12"], p["c_13"])


def pad_of(p: dict[str, float]) -> Force:
    return spring_and_damper(p["k_F"], p["c_21"], p["c_22"], p["c_23"])


def malleolus(
    p: dict[str, float],
    base: Callable[[float], float],
    t: np.ndarray,
    *,
    pad: Force | None = None,
    start: tuple[float, float, float, float] = (0, 0, 0, 0),
    rtol: float = 1e-10,
) -> np.ndarray:
    """Acceleration of the upper mass at times t (n,) from t[0] on.

    Args:
        p: parameters and masses. base: base acceleration. pad: tension of the pad, default spring and damper.
        start: z1, z2 and their rates at t[0].
    """
    p = {**MASSES, **p}
    ankle, pad = ankle_of(p), pad or pad_of(p)
    m_S, m_F = p["m_S"], p["m_F"]

    def rates(time: float, s: np.ndarray) -> list[float]:
        w1, w2, v1, v2 = s  # of shank and foot, seen from the base
        T, P, a = ankle(w1 - w2, v1 - v2), pad(w2, v2), base(time)
        return [v1, v2, -T / m_S - a, (T - P) / m_F - a]

    z1, z2, z1_dot, z2_dot = start
    s0 = (z1 + z2, z2, z1_dot + z2_dot, z2_dot)
    s = solve_ivp(rates, (t[0], t[-1]), s0, method="DOP853", t_eval=t, rtol=rtol, atol=1e-14).y
    return np.array([-ankle(w1 - w2, v1 - v2) / m_S for w1, w2, v1, v2 in s.T])


def linear_response(p: dict[str, float], frequency_hz: np.ndarray) -> np.ndarray:
    """Malleolus over base acceleration of the linear foot, from the 2 x 2 dynamic stiffness of Eq. 4.26."""
    p = {**MASSES, **p}
    H = []
    for w in 2 * np.pi * np.atleast_1d(frequency_hz):
        T, F = p["k_T"] + 1j * w * p["c_11"], p["k_F"] + 1j * w * p["c_21"]
        D = np.array([[T - w**2 * p["m_S"], -T], [-T, T + F - w**2 * p["m_F"]]])
        H.append(np.linalg.solve(D, [0, F])[0])
    return np.array(H)


def sine(frequency_hz: float, amplitude: float = 8.95) -> Callable[[float], float]:
    return lambda t: amplitude * math.sin(2 * math.pi * frequency_hz * t)


def steady(
    p: dict[str, float], frequency_hz: float, rate_hz: float, seconds: float, *, amplitude: float = 8.95,
    delay: float = 0.0, pad: Force | None = None, settle: float = 0.6,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Time, base and malleolus (n,) of the settled motion under one sine; rate_hz / frequency_hz a whole number."""
    count = round(rate_hz / frequency_hz)
    assert count * frequency_hz == rate_hz
    periods = math.ceil(settle * frequency_hz)
    first = periods / frequency_hz - delay
    t = np.concatenate([[0.0], first + np.arange(count) / rate_hz])
    one = malleolus(p, sine(frequency_hz, amplitude), t, pad=pad, rtol=1e-9)[1:]
    n = round(seconds * rate_hz)
    time = np.arange(n) / rate_hz
    base = amplitude * np.sin(2 * np.pi * frequency_hz * time)
    return time, base, np.resize(one, n)
