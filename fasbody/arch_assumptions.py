"""What the equations of Chapter 4 take for granted about the tree of foot_arch.xml, checked on a compiled model.

An edit that the equations cannot follow is refused here with the element's name; read on, it would only show as three
engines that disagree, or not at all.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from fasbody import damper
from fasbody.exceptions import ModelError

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
