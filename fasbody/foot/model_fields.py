"""Fields of a compiled model that some command would follow and another would not: each must have its default.

A command that steps with MuJoCo follows every field; one that linearises or has separate equations does not. The fields
in these tables are therefore refused for all commands when a model is loaded.
"""

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np

from fasbody.exceptions import ModelError
from fasbody.foot.engine import SHAKER_CONTROLS


class Field(NamedTuple):
    """A field that must have its default.

    Attributes:
        name: of mjModel.
        default: of every entry.
        attribute: as MJCF calls it.
        why: what it would do.
    """

    name: str
    default: float
    attribute: str
    why: str


_LATE = "the sensor would be read late, and curves and equations would not be"
#: Of elements of a kind, the prefix of the field saying which.
FIELDS = (
    Field("jnt_actfrclimited", 0, "actuatorfrcrange", "forces would be cut off beside the equations"),
    Field("jnt_springyield", 0, "springyield", "the spring would yield, which no periodic motion can"),
    Field("jnt_plasticadr", -1, "springyield", "the spring would yield, which no periodic motion can"),
    Field("tendon_actfrclimited", 0, "actuatorfrcrange", "forces would be cut off beside the equations"),
    Field("tendon_springyield", 0, "springyield", "the spring would yield, which no periodic motion can"),
    Field("tendon_plasticadr", -1, "springyield", "the spring would yield, which no periodic motion can"),
    Field("actuator_plugin", -1, "plugin", "no equation knows a plugin"),
    Field("actuator_delay", 0, "delay", "its controls would come late"),
    Field("actuator_damping", 0, "damping", "energies would not count it; write the damping at its joint or tendon"),
    Field("actuator_dampingpoly", 0, "damping", "energies would not count it; write it at its joint or tendon"),
    Field("body_plugin", -1, "plugin", "no equation knows a plugin"),
    Field("geom_plugin", -1, "plugin", "no equation knows a plugin"),
    Field("geom_surfacevel", 0, "surfacevel", "it would push what touches it, at rest too"),
    Field("geom_adhesion", 0, "adhesion", "it would hold what touches it"),
)
#: Of the sensors that are read.
SENSED = (
    Field("sensor_cutoff", 0, "cutoff", "large accelerations would be cut off in a motion and not in a curve"),
    Field("sensor_delay", 0, "delay", _LATE),
    Field("sensor_history", 0, "nsample", _LATE),
    Field("sensor_interval", 0, "interval", _LATE),
    Field("sensor_refid", -1, "refname", "it would be read against another body, and its number is used as absolute"),
    Field("sensor_plugin", -1, "plugin", "no equation knows a plugin"),
)
_ASKED = "the table moves as it is asked to"
#: Of the joint base, which no spring holds.
TABLE = (
    Field("jnt_stiffness", 0, "stiffness", _ASKED),
    Field("jnt_stiffnesspoly", 0, "stiffness", _ASKED),
    Field("dof_damping", 0, "damping", _ASKED),
    Field("dof_dampingpoly", 0, "damping", _ASKED),
    Field("dof_frictionloss", 0, "frictionloss", _ASKED),
    Field("jnt_limited", 0, "range", _ASKED),
    Field("jnt_user", 0, "user", _ASKED),
)
#: Of the shaker and the four actuators that carry its controls.
DRIVES = (
    Field("actuator_gaintype", 0, "gaintype", _ASKED),
    Field("actuator_dyntype", 0, "dyntype", _ASKED),
    Field("actuator_gainprm", 0, "gainprm", _ASKED),
    Field("actuator_armature", 0, "armature", _ASKED),
)
#: Fields that only show.
_DRAWN = ("_rgba", "cam_", "light_", "mat_", "tex_", "mesh_", "skin_", "hfield_", "bvh_", "geom_aabb", "_user", "text_")
_KINDS = {
    "jnt": "joint", "dof": "dof", "tendon": "tendon", "sensor": "sensor", "actuator": "actuator", "body": "body",
    "geom": "geom", "site": "site", "eq": "equality", "key": "key", "pair": "pair", "numeric": "numeric",
}  # fmt: skip


def check_fields(model: mujoco.MjModel, name: str) -> None:
    """Refuse what no command, or not every command, could follow.

    Args:
        model: the compiled model, with joint base and actuator shaker.
        name: what to call it in messages.

    Raises:
        ModelError: the first field found that has not its default, or is no number; the message names its element.
    """
    _check_numbers(model, name)
    for field in FIELDS:
        _check_default(model, name, field)
    base = int(model.joint("base").id)
    first = int(model.actuator_ctrladr[model.actuator("shaker").id])
    on_joint = np.isin(model.actuator_trntype, (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    on_table = on_joint & (model.actuator_trnid[:, 0] == base)
    drives = np.flatnonzero((model.actuator_ctrladr >= first) & (model.actuator_ctrladr < first + SHAKER_CONTROLS))
    for field in TABLE:
        _check_default(model, name, field, [int(model.jnt_dofadr[base]) if field.name.startswith("dof") else base])
    for field in DRIVES:
        _check_default(model, name, field, drives)
    for number in map(int, drives):
        if model.actuator_biastype[number] and number != model.actuator("shaker").id:
            raise ModelError(
                f"{name}: {element_name(model, 'actuator', number)} has a biastype; {_ASKED}, so remove it."
            )
    for number in {*map(int, np.flatnonzero(on_table))} - {*map(int, drives)}:
        raise ModelError(
            f"{name}: {element_name(model, 'actuator', number)} acts on the joint 'base' beside the shaker; {_ASKED}, "
            "so remove it."
        )
    for number in map(int, np.flatnonzero(model.actuator_dyntype == mujoco.mjtDyn.mjDYN_INTEGRATOR)):
        raise ModelError(
            f"{name}: {element_name(model, 'actuator', number)} integrates its control, so that any mean of it "
            "repeats; write a <position>, or a <general> without dyntype."
        )
    for number in map(int, np.flatnonzero(model.actuator_actlimited)):
        raise ModelError(
            f"{name}: {element_name(model, 'actuator', number)} has an actrange, which MuJoCo keeps while it steps "
            "only; limit its control by ctrlrange, or its force by forcerange."
        )
    read = np.isin(model.sensor_type, [getattr(mujoco.mjtSensor, f"mjSENS_{kind}") for kind in READ])
    for field in SENSED:
        _check_default(model, name, field, np.flatnonzero(read))
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:
        raise ModelError(f'{name}: <flag sleep="enable"/> stops bodies that move little; remove it.')


#: Sensors whose readings are used.
READ = ("FRAMELINACC", "ACCELEROMETER", "FRAMELINVEL", "VELOCIMETER")


def _check_default(model: mujoco.MjModel, name: str, field: Field, among: Iterable[int] | None = None) -> None:
    """One field, of all elements or those `among`."""
    values = getattr(model, field.name)
    kind = _KINDS[field.name.split("_")[0]]
    for number in range(len(values)) if among is None else among:
        if np.any(values[number] != field.default):
            numbers = " ".join(f"{value:g}" for value in np.ravel(values[number]) if value != field.default)
            of = f" ({numbers})" if values.dtype != bool and field.default == 0 else ""
            raise ModelError(
                f"{name}: {element_name(model, kind, int(number))} has the attribute {field.attribute!r}{of}; "
                f"{field.why}, so remove it."
            )


def _check_numbers(model: mujoco.MjModel, name: str) -> None:
    """Every number of the physics is one."""
    for field in dir(model):
        values = getattr(model, field) if not field.startswith("_") else None
        if isinstance(values, np.ndarray) and values.dtype.kind == "f" and not any(part in field for part in _DRAWN):
            wrong = np.argwhere(np.isnan(values))
            if wrong.size:
                kind = _KINDS.get(field.split("_")[0])
                where = element_name(model, kind, int(wrong[0, 0])) if kind else "the model"
                raise ModelError(f"{name}: {where} has something that is no number ({field}); write a number.")
    for option in ("timestep", "gravity", "wind", "density", "viscosity", "tolerance"):
        if not np.all(np.isfinite(getattr(model.opt, option))):
            raise ModelError(f"{name}: <option> has a {option} that is no number; write a number.")


def constraint_name(data: mujoco.MjData, row: int) -> str:
    """What a row of the constraints stands for, by kind and name."""
    model, kinds = data.model, mujoco.mjtConstraint
    kind, number = int(data.efc_type[row]), int(data.efc_id[row])
    elements = {
        int(kinds.mjCNSTR_EQUALITY): "equality", int(kinds.mjCNSTR_FRICTION_DOF): "dof",
        int(kinds.mjCNSTR_FRICTION_TENDON): "tendon", int(kinds.mjCNSTR_LIMIT_JOINT): "joint",
        int(kinds.mjCNSTR_LIMIT_TENDON): "tendon",
    }  # fmt: skip
    if kind in elements:
        return element_name(model, elements[kind], number)
    return "the contact of " + " and ".join(element_name(model, "geom", int(g)) for g in data.contact[number].geom)


def element_name(model: mujoco.MjModel, kind: str, number: int) -> str:
    """An element by kind and name, or by number where it has none."""
    if kind == "dof":
        kind, number = "joint", int(model.dof_jntid[number])
    element = getattr(model, kind)(number).name
    return f"{kind} {element!r}" if element else f"{kind} number {number + 1}"
