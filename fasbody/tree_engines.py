"""Mass matrix and bias of the arch's tree from MuJoCo and from Pinocchio, at poses given joint by joint.

Pinocchio's model is built from the compiled one, body by body, because its own MJCF reader drops what it does not know
without a word.
"""

from typing import Any

import mujoco
import numpy as np

from fasbody.arch_model import JOINTS
from fasbody.exceptions import FasError, ModelError
from fasbody.kinematics import Array


def mujoco_tree(model: mujoco.MjModel, name: str, tree: Array, velocity: Array) -> tuple[Array, Array]:
    """Mass matrices (n, 6, 6) and biases (n, 6) in the order of `JOINTS`."""
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    dofs = [int(model.jnt_dofadr[model.joint(joint).id]) for joint in JOINTS]
    places = [int(model.jnt_qposadr[model.joint(joint).id]) for joint in JOINTS]
    masses, biases = [], []
    for position, rate in zip(tree, velocity, strict=True):
        data.qpos[places], data.qvel[dofs] = position, rate
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_fullM(model, data, full)
        bias = np.zeros(model.nv)
        mujoco.mj_rne(model, data, 0, bias)
        masses.append(full[np.ix_(dofs, dofs)])
        biases.append(bias[dofs])
    return np.array(masses), np.array(biases)


def pinocchio_tree(model: mujoco.MjModel, name: str, tree: Array, velocity: Array) -> tuple[Array, Array]:
    """The same from Pinocchio: composite rigid body algorithm and nonlinear effects."""
    pin = _import_pinocchio()
    built = build_pinocchio(model, name)
    data = built.createData()
    dofs = [built.joints[built.getJointId(joint)].idx_v for joint in JOINTS]
    q, v = pin.neutral(built), np.zeros(built.nv)
    masses, biases = [], []
    for position, rate in zip(tree, velocity, strict=True):
        q[dofs], v[dofs] = position, rate
        upper = np.triu(pin.crba(built, data, q))
        full = upper + np.triu(upper, 1).T
        masses.append(full[np.ix_(dofs, dofs)])
        biases.append(pin.nonLinearEffects(built, data, q, v)[dofs].copy())
    return np.array(masses), np.array(biases)


def build_pinocchio(model: mujoco.MjModel, name: str = "model") -> Any:
    """A Pinocchio model of a compiled tree of hinges and slides, at most one to a body.

    Raises:
        ModelError: the model has other joints, or the built one differs in size or mass.
    """
    pin = _import_pinocchio()
    built = pin.Model()
    built.gravity.linear = model.opt.gravity.copy()
    # MuJoCo body -> the Pinocchio joint that carries it, and its frame in that joint's
    carrier, frame = {0: 0}, {0: pin.SE3.Identity()}
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        placement = frame[parent] * pin.SE3(_rotation(model.body_quat[body]), model.body_pos[body].copy())
        carrier[body], frame[body] = carrier[parent], placement
        if model.body_jntnum[body] > 1:
            raise ModelError(f"{name}: body {model.body(body).name!r} has several joints; give each a body of its own.")
        if model.body_jntnum[body] == 1:
            j = int(model.body_jntadr[body])
            make = {
                mujoco.mjtJoint.mjJNT_HINGE: pin.JointModelRevoluteUnaligned,
                mujoco.mjtJoint.mjJNT_SLIDE: pin.JointModelPrismaticUnaligned,
            }.get(mujoco.mjtJoint(model.jnt_type[j]))
            if make is None:
                raise ModelError(f"{name}: joint {model.joint(j).name!r} is neither a hinge nor a slide.")
            anchor = pin.SE3(np.eye(3), model.jnt_pos[j].copy())
            axis = model.jnt_axis[j].copy()
            joint = built.addJoint(carrier[parent], make(axis), placement * anchor, model.joint(j).name)
            built.armature[built.joints[joint].idx_v] = model.dof_armature[model.jnt_dofadr[j]]
            carrier[body], frame[body] = joint, anchor.inverse()
        R = _rotation(model.body_iquat[body])
        inertia = pin.Inertia(
            float(model.body_mass[body]), model.body_ipos[body].copy(), R @ np.diag(model.body_inertia[body]) @ R.T
        )
        built.appendBodyToJoint(carrier[body], inertia, frame[body])
    mass = sum(inertia.mass for inertia in built.inertias)
    if (built.nq, built.nv) != (model.nq, model.nv) or abs(mass - model.body_mass.sum()) > 1e-12 * mass:
        raise ModelError(
            f"{name}: Pinocchio's copy has nq {built.nq}, nv {built.nv}, {mass:.6g} kg, MuJoCo's nq {model.nq}, "
            f"nv {model.nv}, {model.body_mass.sum():.6g} kg."
        )
    return built


def _rotation(quaternion: Array) -> Array:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _import_pinocchio() -> Any:
    try:
        import pinocchio
    except ImportError as error:
        raise FasError("the cross-check needs Pinocchio: pip install 'fasbody[crosscheck]'.") from error
    return pinocchio
