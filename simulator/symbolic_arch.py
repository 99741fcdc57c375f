"""The arch derived from scratch by SymPy, sharing no line with fasbody: the oracle of the analytic tests.

Energies are written from Figure 4.2 with theta_1 as an unknown function of the other angles; Lagrange's equations come
from differentiation alone. Deformations in two versions: consistent, and those behind the printed forces.
"""

from collections.abc import Callable
from dataclasses import asdict, fields
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

from fasbody.arch.bones import Arch

Q = sp.symbols("z_F z_T theta_2 theta_3 theta_4 x", real=True)
V = sp.symbols("v_F v_T w_2 w_3 w_4 v_x", real=True)
P = {field.name: sp.Symbol(field.name, positive=True) for field in fields(Arch)}
z_F, z_T, th2, th3, th4, x = Q
REST = dict(zip(Q, (0, 0, P["theta_20"], P["theta_30"], P["theta_40"], 0), strict=True))

cosine_1 = (P["L_2"] * sp.cos(th2) + P["L_3"] * sp.cos(th3) + P["L_4"] * sp.cos(th4)) / P["L_1"]
th1 = sp.acos(cosine_1)
th10 = th1.subs(REST)


def kinetic_energy() -> sp.Expr:
    """Point masses at the middle of each link plus rotation; the table at rest."""
    L1, L2, L3, L4 = (P[f"L_{i}"] for i in range(1, 5))
    apex = z_F + L1 * sp.cos(th1)
    joint_3 = (L2 * sp.sin(th2), apex - L2 * sp.cos(th2))
    joint_4 = (joint_3[0] + L3 * sp.sin(th3), joint_3[1] - L3 * sp.cos(th3))
    head = (joint_4[0] + L4 * sp.sin(th4), joint_4[1] - L4 * sp.cos(th4))
    heel = (-L1 * sp.sin(th1), z_F)
    joints = [heel, (sp.Integer(0), apex), joint_3, joint_4, head]
    energy = P["m_T"] * _rate(apex + z_T) ** 2 / 2
    for i, angle in enumerate((th1, th2, th3, th4)):
        centre = [(joints[i][axis] + joints[i + 1][axis]) / 2 for axis in (0, 1)]
        energy += P[f"m_{i + 1}"] * (_rate(centre[0]) ** 2 + _rate(centre[1]) ** 2) / 2
        energy += P[f"I_{i + 1}"] * _rate(angle) ** 2 / 2
    return energy


def stretches(as_printed: bool) -> dict[str, sp.Expr]:
    """What each spring resists, by the name of its constant."""
    s_10 = P["L_1"] * sp.sin(th10)
    front = P["L_2"] * (sp.sin(th2) - sp.sin(P["theta_20"]))
    if as_printed:
        e, branch = -P["L_1"] * sp.sin(th1) * s_10 + front, front - x
    else:
        sines = ((3, th3), (4, th4))
        e = P["L_1"] * sp.sin(th1) - s_10 + front
        e += sum(P[f"L_{i}"] * (sp.sin(angle) - sp.sin(P[f"theta_{i}0"])) for i, angle in sines)
        branch = e - x
    d_3, d_4 = th3 - th2 - (P["theta_30"] - P["theta_20"]), th4 - th3 - (P["theta_40"] - P["theta_30"])
    return {
        "k_11": e, "k_12": branch, "k_2": th1 + th2 - th10 - P["theta_20"], "k_3": d_3, "k_4": d_4,
        "k_F": z_F, "k_T": z_T,
    }  # fmt: skip


def rates(as_printed: bool) -> dict[str, sp.Expr]:
    """What each damper resists. In print c_1 sits on x less the product above, c_3 and c_4 on absolute rates."""
    table = {"c_F": V[0], "c_T": V[1], "c_2": _rate(th1 + th2)}
    if as_printed:
        s_10 = P["L_1"] * sp.sin(th10)
        return table | {"c_1": V[5] - _rate(P["L_1"] * sp.sin(th1)) * s_10, "c_3": V[3], "c_4": V[4]}
    return table | {"c_1": V[5], "c_3": V[3] - V[2], "c_4": V[4] - V[3]}


def spring_force(as_printed: bool) -> sp.Matrix:
    """-dU/dq, shape (6, 1)."""
    energy = sum(P[name] * d**2 for name, d in stretches(as_printed).items()) / 2
    return -sp.Matrix([sp.diff(energy, q) for q in Q])


def damper_force(as_printed: bool) -> sp.Matrix:
    """-dD/dq', shape (6, 1)."""
    energy = sum(P[name] * d**2 for name, d in rates(as_printed).items()) / 2
    return -sp.Matrix([sp.diff(energy, v) for v in V])


def _rate(expression: sp.Expr) -> sp.Expr:
    return sum((sp.diff(expression, q) * v for q, v in zip(Q, V, strict=True)), start=sp.Integer(0))


@cache
def _numeric(name: str, as_printed: bool = False) -> Callable[..., Any]:
    if name == "mass":
        matrix = sp.hessian(kinetic_energy(), V)
    elif name == "velocity":  # L T = d/dt (dT/dq') - dT/dq with q'' = 0, moved to the right-hand side
        energy = kinetic_energy()
        matrix = -sp.Matrix([_rate(sp.diff(energy, v)) - sp.diff(energy, q) for q, v in zip(Q, V, strict=True)])
    elif name == "spring":
        matrix = spring_force(as_printed)
    elif name == "damper":
        matrix = damper_force(as_printed)
    elif name == "stiffness":  # d(force)/dq at rest, the right-hand side K of the thesis
        matrix = spring_force(as_printed).jacobian(sp.Matrix(Q)).subs(REST)
    elif name == "damping":
        matrix = damper_force(as_printed).jacobian(sp.Matrix(V)).subs(REST)
    return sp.lambdify([*Q, *V, *P.values()], matrix, "numpy", cse=True)


def evaluate(
    name: str,
    arch: Arch,
    q: np.ndarray,
    q_dot: np.ndarray | None = None,
    as_printed: bool = False,
) -> np.ndarray:
    """One of mass, velocity, spring, damper, stiffness, damping at one pose: shape (6, 6) or (6,)."""
    q_dot = np.zeros(6) if q_dot is None else q_dot
    return np.asarray(np.squeeze(_numeric(name, as_printed)(*q, *q_dot, *asdict(arch).values())))
