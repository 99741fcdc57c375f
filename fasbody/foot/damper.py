"""Force laws of the fat pad and the joints: Eqs. (4.22) to (4.25) and (4.32).

A law travels with the MJCF element it acts on, in the `user` field of a joint or tendon, as the number of its equation
followed by its parameters (`LAWS` lists them), so `user="4.25 310 -120 180"` reads like the page. In the element's
coordinate x (extension positive, from rest) the compressive strain of a pad of thickness h is e = e0 - x/h, where e0 is
the static strain under the foot's weight; the pad's force is taken about that equilibrium, as Eq. (4.29) is. A pad that
lifts off (e < 0) has no force; one that expands fast while compressed may pull, as the printed laws have it.

Laws 1 to 3 are none of the thesis'. Law 3 is a spring in series with a damper. Laws 1 and 2 stiffen, pads under
compression (side -1), ligaments under tension (side 1):
with d the deformation on that side, S(d) the spring and W the static force that it carries where x = 0,

    force = max(0, S(d) (1 + eta d')) - W,    S = A d^n or k_0/b (exp(b d) - 1), S(d) = W at x = 0

so they never act on the other side. W = 0 is an element that begins unloaded, as in a model with gravity.

The native callbacks compile these functions (native.py); their Python twin and the plots call them as they are.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

#: A number, or an array of them.
Values = Any


@dataclass(frozen=True)
class Law:
    """One force law: the code that selects it, and its parameters in the order of the `user` field."""

    equation: str
    name: str
    parameters: tuple[str, ...]  # name [unit]

    @property
    def code(self) -> float:
        """First number of the `user` field."""
        return float(self.equation)


LAWS = (
    Law("4.22", "quasi-linear viscoelastic pad", ("A [N]", "B", "c", "tau_1 [s]", "tau_2 [s]", "h [m]", "e0")),
    Law("3", "Maxwell element, a spring that relaxes", ("k [N/m]", "tau [s]")),
    Law("4.23", "nonlinear spring and damper", ("j [N]", "k", "l [N s^n]", "m", "n", "h [m]", "e0")),
    Law("4.24", "linear spring, strain-proportional damper", ("E [N]", "eta [N s]", "h [m]", "e0")),
    Law("1", "power law with Hunt and Crossley's damper", ("k [N/m]", "F [N]", "n", "eta [s/m]", "W [N]", "side")),
    Law("2", "exponential with a toe region", ("k_0 [N/m]", "b [1/m]", "eta [s/m]", "W [N]", "side")),
    Law("4.25", "nonlinear damper beside a linear spring", ("c1 [N s/m]", "c2 [1/m]", "c3 [1/m]")),
)
#: Code of the damper law, which stands beside the element's own spring and includes the element's own damping.
DAMPER = LAWS[-1].code
#: Code of the Maxwell element: its force f obeys f' = k x' - f / tau.
MAXWELL = 3.0
#: Code of the quasi-linear viscoelastic pad.
VISCOELASTIC = 4.22
#: Codes of the laws that act on one side.
ONE_SIDED = (1.0, 2.0)
#: What shapes a law and is no constant of the material: not declared by itself.
FIXED = ("h", "e0", "tau_1", "tau_2", "side", "F", "W")
#: Length of the `user` field: the law's code and at most seven parameters.
USER_SIZE = 8
#: Exponentials that stand for the continuous relaxation spectrum of Eq. (4.22).
BRANCHES = 8
#: Codes of the laws with a memory, which are actuators, and how many activations each has.
MEMORY = {VISCOELASTIC: BRANCHES, MAXWELL: 1}
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(BRANCHES)


def damping(x: Values, c1: Values, c2: Values, c3: Values) -> Values:
    """Damping constant [N s/m] at relative displacement x [m]; Eq. (4.32) applies it to ankle and fat pad."""
    return c1 * np.exp(-c2 * x) * np.cos(c3 * x)  # Eq. (4.25)


def power_law(e: Values, e_dot: Values, j: float, k: float, l: float, m: float, n: float) -> Values:  # noqa: E741
    """Compressive force [N] at strain e >= 0 and strain rate e_dot [1/s], exponents corrected (docs/errata.md)."""
    return j * e**k + l * e**m * np.abs(e_dot) ** n * np.sign(e_dot)  # Eq. (4.23)


def strain_damper(e: Values, e_dot: Values, E: float, eta: float) -> Values:
    """Compressive force [N] at strain e >= 0 and strain rate e_dot [1/s]."""
    return E * e + eta * e * e_dot  # Eq. (4.24), compression positive


def elastic(e: Values, A: float, B: float) -> Values:
    """Elastic function sigma_e of Eq. (4.22) [N]."""
    return A * (np.exp(B * e) - 1.0)


def relaxation(t: float, c: float, tau_1: float, tau_2: float) -> float:
    """Reduced relaxation function G(t) of Eq. (4.22), its spectrum integrated by quadrature in log(tau)."""
    total = 1.0
    for i in range(BRANCHES):
        total += c * branch_weight(i, tau_1, tau_2) * np.exp(-t / branch_time(i, tau_1, tau_2))
    return total / (1.0 + c * np.log(tau_2 / tau_1))


def branch_time(i: int, tau_1: float, tau_2: float) -> float:
    """Relaxation time [s] of exponential i, a Gauss-Legendre node in log(tau)."""
    return tau_1 * (tau_2 / tau_1) ** (0.5 * (1.0 + _NODES[i]))


def branch_weight(i: int, tau_1: float, tau_2: float) -> float:
    """Share of exponential i in the spectrum; the shares sum to log(tau_2/tau_1)."""
    return 0.5 * _WEIGHTS[i] * np.log(tau_2 / tau_1)


def one_sided(user: np.ndarray, x: float, x_dot: float) -> float:
    """Force [N] along +x of law 1 or 2, about the static state that carries W."""
    if round(user[0]) == 1:
        n, eta, W, side = user[3], user[4], user[5], user[6]
        A = (user[1] / (n * user[2] ** (1.0 - 1.0 / n))) ** n  # tangent stiffness k at the force F
        d = (W / A) ** (1.0 / n) + side * x
        spring = A * d**n if d > 0.0 else 0.0
    else:
        k_0, b, eta, W, side = user[1], user[2], user[3], user[4], user[5]
        d = np.log1p(b * W / k_0) / b + side * x
        spring = k_0 / b * np.expm1(b * d) if d > 0.0 else 0.0
    return -side * (max(0.0, spring * (1.0 + eta * side * x_dot)) - W)


def algebraic_force(user: np.ndarray, x: float, x_dot: float, native_damping: float) -> float:
    """Force [N] along +x of a law without memory.

    Args:
        user: (8,) law code and parameters.
        x: extension from rest [m].
        x_dot: its rate [m/s].
        native_damping: the element's own MJCF damping [N s/m]. It is the share of the same damper
            that the engine integrates implicitly, so Eq. (4.25) returns the rest.

    Raises nothing: an unknown code gives zero force (loading the model has refused it).
    """
    code = round(100.0 * user[0])
    if code == 425:
        return -(damping(x, user[1], user[2], user[3]) - native_damping) * x_dot
    if code == 424:
        e, e_dot, rest = user[4] - x / user[3], -x_dot / user[3], user[1] * user[4]
        return (strain_damper(e, e_dot, user[1], user[2]) if e > 0.0 else 0.0) - rest
    if code == 423:
        e, e_dot, rest = user[7] - x / user[6], -x_dot / user[6], user[1] * user[7] ** user[2]
        return (power_law(e, e_dot, user[1], user[2], user[3], user[4], user[5]) if e > 0.0 else 0.0) - rest
    if code == 100 or code == 200:
        return one_sided(user, x, x_dot)
    return 0.0


def at_rest(user: np.ndarray) -> tuple[float, float]:
    """Stiffness [N/m] and damping [N s/m] of a law without memory for small motion about rest.

    Args:
        user: (8,) law code and parameters; zeros for no law.

    Raises:
        ValueError: the law has no linear damper or spring at rest; the message is a clause that says so.
    """
    code = round(100.0 * user[0])
    if user[0] in ONE_SIDED and not user[5 if user[0] == ONE_SIDED[0] else 4]:
        raise ValueError(f"has the law {user[0]:g} with W = 0, which carries nothing and so is not linear at rest")
    if code == 425:
        return 0.0, float(user[1])
    if code == 424:
        E, eta, h, e0 = map(float, user[1:5])
        return E / h, eta * e0 / h
    if code == 423:
        j, k, l, m, n, h, e0 = map(float, user[1:8])  # noqa: E741
        if l and n != 1:
            raise ValueError(f"has the law 4.23 with n = {n:g}, whose damper is not linear at rest; only n = 1 is")
        return j * k * e0 ** (k - 1) / h, l * e0**m / h
    if code == 100:
        k, F, n, eta, W = map(float, user[1:6])
        return k * (W / F) ** (1 - 1 / n), eta * W
    if code == 200:
        k_0, b, eta, W = map(float, user[1:5])
        return k_0 + b * W, eta * W
    return 0.0, 0.0


def viscoelastic_force(p: np.ndarray, h: np.ndarray, x: float) -> float:
    """Force [N] along +x of the quasi-linear viscoelastic pad, Eq. (4.22), about its relaxed static state.

    Args:
        p: (8,) law code and parameters.
        h: (BRANCHES,) internal stresses of the exponentials [N].
        x: extension [m].
    """
    A, B, c, tau_1, tau_2 = p[1], p[2], p[3], p[4], p[5]
    e = p[7] - x / p[6]
    total = elastic(max(e, 0.0), A, B) - elastic(p[7], A, B)
    for i in range(BRANCHES):
        total += c * branch_weight(i, tau_1, tau_2) * h[i]
    return total / (1.0 + c * np.log(tau_2 / tau_1))


def viscoelastic_rate(p: np.ndarray, h: np.ndarray, x: float, x_dot: float, i: int) -> float:
    """Rate [N/s] of internal stress i: dh_i/dt = d(sigma_e)/dt - h_i/tau_i, the hereditary integral of Eq. (4.22)."""
    e, e_dot = p[7] - x / p[6], -x_dot / p[6]
    driving = p[1] * p[2] * np.exp(p[2] * e) * e_dot if e > 0.0 else 0.0
    return driving - h[i] / branch_time(i, p[4], p[5])
