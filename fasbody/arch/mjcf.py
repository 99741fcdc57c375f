"""What the equations of Chapter 4 take for granted about the tree of foot_arch.xml, checked on a compiled model.

An edit that the equations cannot follow is refused here with the element's name; read on, it would only show as three
engines that disagree, or not at all.

Between the arch of the equations and its MJCF tree: constants read from a compiled model, coordinates both ways.

The tree hangs from the apex and closes at heel and metatarsal heads (mjcf/foot_arch.md); the equations have the closure
built in. With q = (z_F, z_T, theta_2, theta_3, theta_4, x) and the tree's velocities v = T(q) q', any engine's mass
matrix M and bias b become those of Eq. (4.11) by A = T^T M T and T^T (b + M T' q').
"""

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Z_F, Z_T, Array, X, arms, closing_angle, closing_gradient, deformations, gradients
from fasbody.exceptions import ModelError, unknown
from fasbody.foot import damper
from fasbody.foot.model import check_constants, load

#: Mass of the apex that no engine can see [kg].
APEX_MASS = 1e-9
#: How far an axis, the closure's polynomial or the aponeurosis' rest length may be off.
TOLERANCE = 1e-6

Index = Mapping[tuple[str, str], int]


def check_assumptions(model: mujoco.MjModel, index: Index, name: str) -> None:
    """Refuse a model that the equations cannot follow.

    Args:
        model: the compiled model.
        index: (kind, element) -> number, of the joints and tendons of the arch.
        name: what to call the model in messages.

    Raises:
        ModelError: the first departure found.
    """
    joints = [number for (kind, _), number in index.items() if kind == "joint"]
    _check_joints(model, joints, name)
    _check_bodies(model, joints, index, name)
    _check_closure(model, index, name)
    _check_tendons(model, index, name)


def carried_mass(model: mujoco.MjModel, body: int) -> float:
    """Mass of a body and of all that is fixed to it without a joint [kg]."""
    return float(model.body_mass[np.asarray(model.body_weldid) == body].sum())


def _check_joints(model: mujoco.MjModel, joints: list[int], name: str) -> None:
    for j in joints:
        joint, dof = model.joint(j).name, int(model.jnt_dofadr[j])
        slides = joint in ("apex", "talocrural")
        wanted, axis = ("slide", (0, 1, 0)) if slides else ("hinge", (0, 0, 1))
        kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        if model.jnt_type[j] != kind or np.abs(model.jnt_axis[j] - axis).max() > TOLERANCE:
            raise ModelError(
                f'{name}: joint {joint!r} must be a {wanted} with axis="{" ".join(map(str, axis))}", '
                f"not one about {_listed(model.jnt_axis[j])}."
            )
        if model.dof_armature[dof] != 0:
            raise ModelError(
                f"{name}: joint {joint!r} has the armature {model.dof_armature[dof]:g}, which the equations lack; "
                "remove it."
            )
        if joint in ("apex", "hindfoot"):  # free in the equations
            law = model.jnt_user[j, 0] if model.jnt_user.shape[1] else 0
            stiffness = model.jnt_stiffness.reshape(model.njnt, -1)[j, 0]
            damping = model.dof_damping.reshape(model.nv, -1)[dof, 0]
            if law or stiffness or damping:
                raise ModelError(f"{name}: joint {joint!r} has a spring or damper; in the equations it is free.")


def _check_bodies(model: mujoco.MjModel, joints: list[int], index: Index, name: str) -> None:
    apex, tibia = (int(model.jnt_bodyid[index["joint", joint]]) for joint in ("apex", "talocrural"))
    if carried_mass(model, apex) > APEX_MASS:
        raise ModelError(
            f"{name}: body {model.body(apex).name!r} and what is fixed to it weigh {carried_mass(model, apex):g} kg, "
            f"but the apex has no mass in the equations; give it at most {APEX_MASS:g} kg."
        )
    known = {int(model.jnt_bodyid[j]) for j in joints}
    for body in range(1, model.nbody):
        above, inside = body, False
        while above:
            inside, above = inside or above == apex, int(model.body_parentid[above])
        fixed_to = int(model.body_weldid[body])
        if not inside or (fixed_to == tibia and body != tibia):  # the tibia only slides, so what it carries is mass
            continue
        if fixed_to not in known or model.body_jntnum[body] > 1 or (body not in known and model.body_mass[body] > 0):
            raise ModelError(
                f"{name}: body {model.body(body).name!r} has a mass or joint of its own that the five-body arch does "
                "not have; fix it to tibia, or add its mass to a bone."
            )


def _check_closure(model: mujoco.MjModel, index: Index, name: str) -> None:
    pads = {index["tendon", "heel_pad"], index["tendon", "forefoot_pad"]}
    closed = False
    for e in range(model.neq):
        if not model.eq_active0[e]:
            continue
        is_tendons = model.eq_type[e] == mujoco.mjtEq.mjEQ_TENDON
        if not is_tendons or {int(model.eq_obj1id[e]), int(model.eq_obj2id[e])} != pads:
            raise ModelError(f"{name}: equality {model.equality(e).name!r} is none of the arch's; remove it.")
        if np.abs(model.eq_data[e, :5] - (0, 1, 0, 0, 0)).max() > TOLERANCE:
            raise ModelError(
                f"{name}: equality {model.equality(e).name!r} must keep both pads equally long; remove its polycoef."
            )
        closed = True
    if not closed:
        raise ModelError(
            f"{name}: there is no active equality between the tendons 'heel_pad' and 'forefoot_pad', which keeps heel "
            "and metatarsal heads at one height (Eq. 4.6); put the equality closure of foot_arch.xml back."
        )


def _check_tendons(model: mujoco.MjModel, index: Index, name: str) -> None:
    for (kind, tendon), t in index.items():
        if kind != "tendon":
            continue
        if np.abs(model.tendon_lengthspring[t] - model.tendon_length0[t]).max() > TOLERANCE:
            raise ModelError(f"{name}: tendon {tendon!r} has a spring that pulls at rest; remove its springlength.")
    fascia = index["tendon", "plantar_aponeurosis"]
    law = model.tendon_user[fascia, 0] if model.tendon_user.shape[1] else 0
    if law or model.tendon_damping.reshape(model.ntendon, -1)[fascia, 0]:
        raise ModelError(
            f"{name}: tendon 'plantar_aponeurosis' has a damper, but only its branch of k_12 and c_1 yields; remove it."
        )


def nonlinear_laws(model: mujoco.MjModel) -> list[str]:
    """Joints and tendons whose law is more than a linear damper, each as a clause for a note."""
    clauses = []
    for kind, user in (("joint", model.jnt_user), ("tendon", model.tendon_user)):
        for number in range(len(user)):
            law = user[number, : damper.USER_SIZE] if user.shape[1] else np.zeros(1)
            if law[0] and not (law[0] == 4.25 and not law[2:].any()):
                clauses.append(f"{kind} {getattr(model, kind)(number).name!r} (law {law[0]:g})")
    return clauses


def _listed(values: np.ndarray) -> str:
    return " ".join(f"{value:g}" for value in values)


#: The joints of the tree in the order of `tree_position`; the shaker's `base` comes before them.
JOINTS = (
    "apex", "talocrural", "hindfoot", "spring_ligament", "short_plantar_ligament", "long_plantar_ligament",
)  # fmt: skip
SITES = ("heel", "heads")
TENDONS = ("heel_pad", "forefoot_pad", "plantar_aponeurosis")
BRANCH = "aponeurosis_branch"

#: The damper law of Eq. (4.25) in a `user` field; at rest it has the damping of its first parameter.
NONLINEAR = 4.25


_KINDS = {
    "joint": (mujoco.mjtObj.mjOBJ_JOINT, JOINTS),
    "site": (mujoco.mjtObj.mjOBJ_SITE, SITES),
    "tendon": (mujoco.mjtObj.mjOBJ_TENDON, TENDONS),
    "actuator": (mujoco.mjtObj.mjOBJ_ACTUATOR, (BRANCH,)),
}


def arch_from_model(model: mujoco.MjModel, name: str = "model") -> Arch:
    """The constants of the analytic arch, read from a compiled foot_arch model or an edited copy.

    Args:
        model: the compiled model.
        name: what to call it in messages.

    Raises:
        ModelError: a needed element is missing, or a constant is negative, or the model departs from what
            the equations of Chapter 4 assume (arch_assumptions.py).
    """
    index = _indices(model, name)
    check_constants(model, name)
    check_assumptions(model, index, name)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    joint = [index["joint", element] for element in JOINTS]
    anchor, body = data.xanchor[joint], model.jnt_bodyid[joint]
    heel, heads = (data.site_xpos[index["site", element]] for element in SITES)

    ends = [(anchor[2], heel), (anchor[3], anchor[4]), (anchor[4], anchor[5]), (anchor[5], heads)]
    if abs(heel[1] - heads[1]) > TOLERANCE:
        raise ModelError(
            f"{name}: heel and heads rest {abs(heel[1] - heads[1]) * 1e3:.3f} mm apart in height; "
            "turn calcaneus_talus until both are equal."
        )
    links = body[2:]
    for link, (top, bottom) in zip(links, ends, strict=True):
        gap = np.linalg.norm(data.xipos[link] - (top + bottom) / 2)
        if gap > TOLERANCE:
            raise ModelError(
                f"{name}: the centre of mass of {model.body(link).name} lies {gap * 1e3:.3f} mm off the middle of its "
                "bone, where the equations of Chapter 4 have it."
            )
    spin = [float(R[2] @ (model.body_inertia[link] * R[2])) for link in links for R in [data.ximat[link].reshape(3, 3)]]
    length = [float(np.linalg.norm(bottom - top)) for top, bottom in ends]
    angle = [float(np.arctan2(bottom[0] - top[0], top[1] - bottom[1])) for top, bottom in ends]
    numbers = {f"m_{i}": float(model.body_mass[link]) for i, link in enumerate(links, 1)}
    numbers |= {f"L_{i}": value for i, value in enumerate(length, 1)} | {f"I_{i}": v for i, v in enumerate(spin, 1)}
    numbers |= {f"theta_{i}0": angle[i - 1] for i in (2, 3, 4)} | {"m_T": carried_mass(model, int(body[1]))}
    return Arch(**numbers, **_constants(model, index, name))


def read_arch(model: str | Path) -> Arch:
    """The arch of a shipped model or an MJCF file.

    Raises:
        InputFileError, ModelError: see `model.load` and `arch_from_model`.
    """
    foot = load(model)
    return arch_from_model(foot.model, foot.name)


def _constants(model: mujoco.MjModel, index: dict[tuple[str, str], int], name: str) -> dict[str, float]:
    damping = _damping(model.dof_damping[model.jnt_dofadr], model.jnt_user)
    tendon_damping = _damping(model.tendon_damping, model.tendon_user)
    stiffness = np.reshape(model.jnt_stiffness, (model.njnt, -1))[:, 0]
    tendon_stiffness = np.reshape(model.tendon_stiffness, (model.ntendon, -1))[:, 0]
    constants = {}
    places = zip(("T", "2", "3", "4"), (JOINTS[1], *JOINTS[3:]), strict=True)
    for symbol, element in places:
        j = index["joint", element]
        constants[f"k_{symbol}"] = float(stiffness[j])
        constants[f"c_{symbol}"] = float(damping[j])
        if model.qpos_spring[model.jnt_qposadr[j]] != model.qpos0[model.jnt_qposadr[j]]:
            raise ModelError(f"{name}: joint {element!r} has a spring that pulls at rest; remove its springref.")
    pads = [index["tendon", element] for element in TENDONS[:2]]
    fascia, branch = index["tendon", TENDONS[2]], index["actuator", BRANCH]
    constants |= {"k_F": float(tendon_stiffness[pads].sum()), "c_F": float(tendon_damping[pads].sum())}
    resistance, time_constant = float(model.actuator_gainprm[branch, 0]), float(model.actuator_dynprm[branch, 0])
    if not (resistance > 0 and time_constant > 0):
        raise ModelError(f"{name}: actuator {BRANCH!r} needs resistance (1/c_1) and inductance (1/k_12) above zero.")
    c_1 = 1 / resistance
    return constants | {"k_11": float(tendon_stiffness[fascia]), "c_1": c_1, "k_12": c_1 / time_constant}


def _damping(native: Array, user: Array) -> Array:
    """Damping at rest of each joint or tendon: the whole law where `user` names one, else the native constant."""
    laws = np.zeros((len(native), 2)) if user.shape[-1] == 0 else user[:, :2]
    return np.where(laws[:, 0] == NONLINEAR, laws[:, 1], native.reshape(len(native), -1)[:, 0])


def _indices(model: mujoco.MjModel, name: str) -> dict[tuple[str, str], int]:
    found = {}
    for kind, (code, wanted) in _KINDS.items():
        for element in wanted:
            found[kind, element] = mujoco.mj_name2id(model, code, element)
            if found[kind, element] < 0:
                count = {"joint": model.njnt, "site": model.nsite, "tendon": model.ntendon}.get(kind, model.nactuator)
                there = [mujoco.mj_id2name(model, code, i) for i in range(count)]
                problem = unknown(kind, element, filter(None, there)).replace("unknown", "there is no")
                raise ModelError(f"{name}: {problem}; the five-body arch needs it.")
    return found


def tree_position(arch: Arch, q: Array) -> Array:
    """Joint positions of the tree in the order of `JOINTS`, shape (..., 6), for coordinates of shape (..., 6)."""
    d, a = deformations(arch, q), arms(arch, q)
    apex = q[..., Z_F] + a.E_2 - arch.height_0
    hindfoot = arch.theta_10 - closing_angle(arch, q)
    return np.stack([apex, q[..., Z_T], hindfoot, d.d_2, d.d_3, d.d_4], axis=-1)


def tree_jacobian(arch: Arch, q: Array) -> Array:
    """T = d(tree)/dq, shape (..., 6, 6); the column of x is zero."""
    g, a, slope = gradients(arch, q), arms(arch, q), closing_gradient(arch, q)
    T = np.zeros((*q.shape[:-1], 6, 6), dtype=q.dtype)
    T[..., 0, Z_F], T[..., 1, Z_T] = 1, 1
    T[..., 0, 2:5] = -np.stack([a.l_2, a.l_3, a.l_4], axis=-1)
    T[..., 2, 2:5] = -slope
    for row, gradient in enumerate((g.d_2, g.d_3, g.d_4), 3):
        T[..., row, :X] = gradient[..., :X]
    return T


def tree_drift(arch: Arch, q: Array, q_dot: Array) -> Array:
    """T' q', the tree's acceleration at q'' = 0, shape (..., 6)."""
    T_dot = tree_jacobian(arch, q + 1e-30j * q_dot).imag / 1e-30
    return np.einsum("...ij,...j->...i", T_dot, q_dot)


def project(arch: Arch, q: Array, q_dot: Array, M: Array, bias: Array) -> tuple[Array, Array]:
    """Mass matrix and bias of the tree (base left out, order of `JOINTS`) in the coordinates of the equations.

    Args:
        arch: the constants.
        q: coordinates, shape (..., 6).
        q_dot: their rates, shape (..., 6).
        M: the engine's mass matrix, shape (..., 6, 6).
        bias: the engine's bias force, shape (..., 6).

    Returns:
        A and bias as `lagrange.mass_and_bias` gives them.
    """
    T = tree_jacobian(arch, q)
    turned = np.swapaxes(T, -1, -2)
    force = bias + np.einsum("...ij,...j->...i", M, tree_drift(arch, q, q_dot))
    return turned @ M @ T, np.einsum("...ij,...j->...i", turned, force)
