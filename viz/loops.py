"""Force over extension of fat pad, ankle and fascia in a state of the model: the points of the page's loops."""

import mujoco
import numpy as np

from fasbody.damper import algebraic_force
from fasbody.parameters import names

#: Joints and tendons whose force loop is worth a plot, by what they stand for.
LOOPS = {"fat pad": ("fat_pad", "heel_pad"), "ankle": ("talocrural",), "fascia": ("plantar_aponeurosis",)}


def watched(model: mujoco.MjModel) -> dict[str, list[tuple[str, int]]]:
    """What a model has of `LOOPS`: label -> kind ("joint" or "tendon") and number of each element."""
    found: dict[str, list[tuple[str, int]]] = {}
    for label, wanted in LOOPS.items():
        for kind in ("joint", "tendon"):
            there = names(model, kind)
            found.setdefault(label, []).extend((kind, getattr(model, kind)(n).id) for n in wanted if n in there)
    return {label: elements for label, elements in found.items() if elements}


def loop_point(model: mujoco.MjModel, data: mujoco.MjData, kind: str, i: int) -> tuple[float, float]:
    """Extension [m] and tensile force [N] of a joint's or tendon's spring, native damper and law together."""
    if kind == "joint":
        q, v = model.jnt_qposadr[i], model.jnt_dofadr[i]
        x, x_dot = data.qpos[q] - model.qpos_spring[q], data.qvel[v]
        stiffness, native, user = model.jnt_stiffness, model.dof_damping.reshape(model.nv, -1)[v, 0], model.jnt_user
    else:
        x, x_dot = data.ten_length[i] - model.tendon_length0[i], data.ten_velocity[i]
        stiffness, user = model.tendon_stiffness, model.tendon_user
        native = model.tendon_damping.reshape(model.ntendon, -1)[i, 0]
    force = stiffness.reshape(len(user), -1)[i, 0] * x + native * x_dot
    if user.shape[1]:
        force -= algebraic_force(user[i], x, x_dot, native)
    if kind == "tendon":  # an actuator on the tendon pulls too, such as the branch of the aponeurosis
        on = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (model.actuator_trnid[:, 0] == i)
        force -= float(np.sum(data.actuator_force[on]))
    return float(x), float(force)
