"""What the equations of Chapter 4 take for granted about a compiled foot_arch model, and its numbers for them.

An edit that the equations cannot follow is refused with the element's name. Otherwise the engines would disagree, or
the error would not show at all. The numbers are those that MuJoCo steps; a declared parameter must agree with them.
"""

from collections.abc import Iterable, Mapping

import mujoco
import numpy as np

from fasbody.exceptions import ModelError, unknown
from fasbody.foot import damper
from fasbody.foot.accelerometers import leans, reference_pose
from fasbody.foot.model import check_constants, check_free
from fasbody.foot.model_fields import element_name
from fasbody.foot.parameters import declared, names

#: The joints of the tree in the order of `tree_position`; the shaker's `base` comes before them.
JOINTS = (
    "apex", "talocrural", "hindfoot", "spring_ligament", "short_plantar_ligament", "long_plantar_ligament",
)  # fmt: skip
#: Those with a spring and a damper, by the index of their constants: k_T, c_T and so on.
SPRUNG = {"T": JOINTS[1], "2": JOINTS[3], "3": JOINTS[4], "4": JOINTS[5]}
SITES = ("heel", "heads")
PADS = ("heel_pad", "forefoot_pad")
FASCIA = "plantar_aponeurosis"
#: The actuator that is k_12 and c_1 in series.
BRANCH = "aponeurosis_branch"

#: Largest mass of the apex that does not change a result [kg].
APEX_MASS = 1e-9
#: How far an axis, the closure's polynomial, a rest length or a declared constant may be off.
TOLERANCE = 1e-6

#: Smallest stiffness [1/s^2] of the closure times its impedance: the equations have a rigid one, 5e-4 from it at 45 Hz.
RIGID = 5e6
#: How far a pad may lean [rad].
UPRIGHT = 1e-3

_KINDS = {"joint": JOINTS, "site": (*SITES, "malleolus"), "tendon": (*PADS, FASCIA), "actuator": (BRANCH,)}
Index = Mapping[tuple[str, str], int]


def numbers(model: mujoco.MjModel, name: str = "model") -> dict[str, float]:
    """Everything that `Arch` needs, by thesis symbol, SI units and rad.

    Args:
        model: the compiled model.
        name: what to call it in messages.

    Raises:
        ModelError: a needed element is missing, a constant is negative, or the model departs from what the equations
            assume; the message names the element.
    """
    index = _index(model, name)
    check_constants(model, name)
    check_free(model, name)
    data = reference_pose(model)
    _check_joints(data, index, name)
    _check_bodies(data, index, name)
    _check_closure(model, index, name)
    _check_springs(model, index, name)
    _check_tendons(data, index, name)
    _check_actuators(model, index, name)
    constants = _constants(model, index, name)
    _check_declared(model, constants, name)
    return _bones(data, index, name) | constants


def nonlinear_laws(model: mujoco.MjModel) -> list[str]:
    """Joints and tendons whose law is more than a linear damper, each as a clause for a note."""
    clauses = []
    for kind in ("joint", "tendon"):
        for number in range(model.njnt if kind == "joint" else model.ntendon):
            law = _law(model, kind, number)
            if law[0] and not (law[0] == damper.DAMPER and not law[2:].any()):
                clauses.append(f"{kind} {getattr(model, kind)(number).name!r} (law {law[0]:g})")
    return clauses


def carried_mass(model: mujoco.MjModel, body: int) -> float:
    """Mass of a body and of all that is fixed to it without a joint [kg]."""
    return float(model.body_mass[np.asarray(model.body_weldid) == body].sum())


def _index(model: mujoco.MjModel, name: str) -> Index:
    counts = {"joint": model.njnt, "site": model.nsite, "tendon": model.ntendon, "actuator": model.nactuator}
    numbers = {}
    for kind, elements in _KINDS.items():
        present = {getattr(model, kind)(number).name: number for number in range(counts[kind])}
        for element in elements:
            if element not in present:
                problem = unknown(kind, element, filter(None, present)).replace("unknown", "there is no")
                raise ModelError(f"{name}: {problem}; the five-body arch needs it.")
            numbers[kind, element] = present[element]
    return numbers


def _bones(data: mujoco.MjData, index: Index, name: str) -> dict[str, float]:
    """Masses, lengths, inertias and rest angles, from the pose in which the file stands."""
    model = data.model
    joint = [index["joint", element] for element in JOINTS]
    anchor, body = data.xanchor[joint], model.jnt_bodyid[joint]
    heel, heads = (data.site_xpos[index["site", element]] for element in SITES)
    apart = np.linalg.norm(anchor[3] - anchor[2])
    if apart > TOLERANCE:
        raise ModelError(
            f"{name}: joint {JOINTS[3]!r} lies {apart * 1e3:.3f} mm off joint {JOINTS[2]!r}; in the equations both "
            "are the apex of the arch."
        )
    if abs(heel[1] - heads[1]) > TOLERANCE:
        raise ModelError(
            f"{name}: heel and heads rest {abs(heel[1] - heads[1]) * 1e3:.3f} mm apart in height; "
            "turn calcaneus_talus until both are equal."
        )
    bones = {"m_T": carried_mass(model, int(body[1]))}
    ends = [(anchor[2], heel), (anchor[3], anchor[4]), (anchor[4], anchor[5]), (anchor[5], heads)]
    for i, (link, (top, bottom)) in enumerate(zip(body[2:], ends, strict=True), 1):
        gap = np.linalg.norm(data.xipos[link] - (top + bottom) / 2)
        if gap > TOLERANCE:
            raise ModelError(
                f"{name}: the centre of mass of {model.body(link).name} lies {gap * 1e3:.3f} mm off the middle of its "
                "bone, where the equations of Chapter 4 have it."
            )
        across = data.ximat[link].reshape(3, 3)[2]
        bones[f"m_{i}"], bones[f"L_{i}"] = float(model.body_mass[link]), float(np.linalg.norm(bottom - top))
        bones[f"I_{i}"] = float(across @ (model.body_inertia[link] * across))
        if i > 1:
            bones[f"theta_{i}0"] = float(np.arctan2(bottom[0] - top[0], top[1] - bottom[1]))
    return bones


def _constants(model: mujoco.MjModel, index: Index, name: str) -> dict[str, float]:
    """The 13 springs and dampers, laws taken as they are at rest."""
    constants = {}
    for symbol, element in SPRUNG.items():
        constants[f"k_{symbol}"], constants[f"c_{symbol}"] = _at_rest(model, "joint", index["joint", element], name)
    pads = [_at_rest(model, "tendon", index["tendon", element], name) for element in PADS]
    constants["k_F"], constants["c_F"] = (sum(values) for values in zip(*pads, strict=True))
    for symbol, elements in (("k_T", "joint 'talocrural' has"), ("k_F", "tendons 'heel_pad' and 'forefoot_pad' have")):
        if constants[symbol] == 0:
            raise ModelError(f"{name}: {elements} no stiffness ({symbol}), so nothing carries the leg; give it some.")
    branch = index["actuator", BRANCH]
    resistance, time_constant = float(model.actuator_gainprm[branch, 0]), float(model.actuator_dynprm[branch, 0])
    if not (resistance > 0 and time_constant > 0):
        raise ModelError(f"{name}: actuator {BRANCH!r} needs resistance (1/c_1) and inductance (1/k_12) above zero.")
    c_1, k_11 = 1 / resistance, float(model.tendon_stiffness[index["tendon", FASCIA]])
    return constants | {"k_11": k_11, "c_1": c_1, "k_12": c_1 / time_constant}


def _check_springs(model: mujoco.MjModel, index: Index, name: str) -> None:
    """Require springs of joints that pull nowhere at rest; those of tendons are measured in the pose of these."""
    for element in SPRUNG.values():
        place = model.jnt_qposadr[index["joint", element]]
        if model.qpos_spring[place] != model.qpos0[place]:
            raise ModelError(f"{name}: joint {element!r} has a spring that pulls at rest; remove its springref.")


def _at_rest(model: mujoco.MjModel, kind: str, number: int, name: str) -> tuple[float, float]:
    """Stiffness and damping of a joint or tendon for small motion about rest: its own, and its law's."""
    where = f"{name}: {kind} {getattr(model, kind)(number).name!r}"
    if kind == "joint":
        dof = model.jnt_dofadr[number]
        linear = model.jnt_stiffness[number], model.dof_damping[dof]
        poly = model.jnt_stiffnesspoly[number], model.dof_dampingpoly[dof]
    else:
        linear = model.tendon_stiffness[number], model.tendon_damping[number]
        poly = model.tendon_stiffnesspoly[number], model.tendon_dampingpoly[number]
    for quantity, coefficients in zip(("stiffness", "damping"), poly, strict=True):
        if np.any(coefficients):
            raise ModelError(
                f"{where} has a {quantity} that changes with the motion (a polynomial), where the equations have one "
                "number; keep its first."
            )
    try:
        stiffness, damping = damper.at_rest(_law(model, kind, number))
    except ValueError as error:
        raise ModelError(f"{where} {error}.") from None
    native = 0.0 if _law(model, kind, number)[0] == damper.DAMPER else float(linear[1])  # a share of the law's damper
    return float(linear[0]) + stiffness, native + damping


def _law(model: mujoco.MjModel, kind: str, number: int) -> np.ndarray:
    """The law of a joint or tendon, shape (8,); zeros where it has none."""
    user = (model.jnt_user if kind == "joint" else model.tendon_user)[number, : damper.USER_SIZE]
    return np.pad(user, (0, damper.USER_SIZE - len(user)))


def _check_joints(data: mujoco.MjData, index: Index, name: str) -> None:
    model = data.model
    for joint in JOINTS:
        j = index["joint", joint]
        dof = int(model.jnt_dofadr[j])
        slides = joint in ("apex", "talocrural")
        joint_type, axis = ("slide", (0, 1, 0)) if slides else ("hinge", (0, 0, 1))
        kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        if model.jnt_type[j] != kind or np.abs(data.xaxis[j] - axis).max() > TOLERANCE:
            raise ModelError(
                f'{name}: joint {joint!r} must be a {joint_type} with axis="{_listed(axis)}" in the world\'s axes, '
                f"not {_listed(np.round(data.xaxis[j], 6) + 0.0)}; turn it or its body."
            )
        if model.dof_armature[dof] != 0:
            raise ModelError(
                f"{name}: joint {joint!r} has the armature {model.dof_armature[dof]:g}, which the equations lack; "
                "remove it."
            )
        springs = (model.jnt_stiffness[j], *model.jnt_stiffnesspoly[j])
        dampers = (model.dof_damping[dof], *model.dof_dampingpoly[dof], _law(model, "joint", j)[0])
        if joint not in SPRUNG.values() and any((*springs, *dampers)):
            raise ModelError(f"{name}: joint {joint!r} has a spring or damper; in the equations it is free.")


def _check_bodies(data: mujoco.MjData, index: Index, name: str) -> None:
    model = data.model
    for floating in np.flatnonzero(model.body_gravcomp):
        raise ModelError(
            f"{name}: body {model.body(floating).name!r} has a gravcomp, which the equations lack; remove it."
        )
    bodies = {joint: int(model.jnt_bodyid[index["joint", joint]]) for joint in JOINTS}
    apex, tibia = bodies["apex"], bodies["talocrural"]
    if carried_mass(model, apex) > APEX_MASS:
        raise ModelError(
            f"{name}: body {model.body(apex).name!r} and what is fixed to it weigh {carried_mass(model, apex):g} kg, "
            f"but the apex has no mass in the equations; give it at most {APEX_MASS:g} kg."
        )
    known = set(bodies.values())
    for body in range(1, model.nbody):
        above, inside = body, False
        while above:
            inside, above = inside or above == apex, int(model.body_parentid[above])
        fixed_to = int(model.body_weldid[body])
        if not inside or (fixed_to == tibia and body != tibia):  # the tibia only slides, so what it carries is mass
            continue
        inert = bool(model.body_mass[body] or model.body_inertia[body].any())
        if fixed_to not in known or model.body_jntnum[body] > 1 or (body not in known and inert):
            raise ModelError(
                f"{name}: body {model.body(body).name!r} has a mass or joint of its own that the five-body arch does "
                "not have; fix it to tibia, or add its mass to a bone."
            )
    _check_on_table(model, int(model.body_parentid[apex]), f"{name}: body {model.body(apex).name!r} stands on")
    sensed = int(model.site_bodyid[model.site("malleolus").id])
    if model.body_weldid[sensed] != tibia:
        raise ModelError(
            f"{name}: site 'malleolus' is on {model.body(sensed).name!r}, and the equations have it on the tibia."
        )
    if "malleolus" in names(model, "sensor") and leans(data, model.sensor("malleolus").id, (0.0, 1.0, 0.0)):
        raise ModelError(f"{name}: sensor 'malleolus' leans, and the equations read it along y; turn its site.")


def _check_on_table(model: mujoco.MjModel, body: int, where: str) -> None:
    if model.body_weldid[body] != model.body_weldid[model.jnt_bodyid[model.joint("base").id]]:
        raise ModelError(
            f"{where} body {model.body(body).name!r}, which moves by itself, and the equations have the table there; "
            "put its stiffness in series with the pads' instead."
        )


def _check_closure(model: mujoco.MjModel, index: Index, name: str) -> None:
    pads = {index["tendon", pad] for pad in PADS}
    closed = False
    for e in np.flatnonzero(model.eq_active0):
        equality = element_name(model, "equality", int(e))
        is_tendons = model.eq_type[e] == mujoco.mjtEq.mjEQ_TENDON
        if not is_tendons or {int(model.eq_obj1id[e]), int(model.eq_obj2id[e])} != pads:
            raise ModelError(f"{name}: {equality} is none of the arch's; remove it.")
        if np.abs(model.eq_data[e, :5] - (0, 1, 0, 0, 0)).max() > TOLERANCE:
            raise ModelError(f"{name}: {equality} must keep both pads equally long; remove its polycoef.")
        if -model.eq_solref[e, 0] * model.eq_solimp[e, :2].min() < RIGID:
            raise ModelError(f"{name}: {equality} gives way (solref, solimp); the equations know none that does.")
        closed = True
    if not closed:
        raise ModelError(
            f"{name}: there is no active equality between the tendons 'heel_pad' and 'forefoot_pad', which keeps heel "
            "and metatarsal heads at one height (Eq. 4.6); put the equality closure of foot_arch.xml back."
        )


def _check_tendons(data: mujoco.MjData, index: Index, name: str) -> None:
    model = data.model
    for tendon, anchor in zip((*PADS, FASCIA), (*SITES, SITES), strict=True):
        first, count = (int(rows[index["tendon", tendon]]) for rows in (model.tendon_adr, model.tendon_num))
        straight = count == 2 and (model.wrap_type[first : first + 2] == mujoco.mjtWrap.mjWRAP_SITE).all()
        sites = {int(s) for s in model.wrap_objid[first : first + count]}
        ends = {index["site", element] for element in ([anchor] if isinstance(anchor, str) else anchor)}
        if not straight or not ends <= sites:
            way = f"from the table to {anchor!r}" if isinstance(anchor, str) else "from 'heel' to 'heads'"
            raise ModelError(f"{name}: tendon {tendon!r} must run straight {way}, as in the equations.")
        for site in sites - ends:
            (end,) = ends
            x, y, z = data.site_xpos[end] - data.site_xpos[site]
            if np.hypot(x, z) > UPRIGHT * abs(y):
                raise ModelError(
                    f"{name}: tendon {tendon!r} leans, and the equations have it upright; put "
                    f"{element_name(model, 'site', site)} below {anchor!r}."
                )
            _check_on_table(model, int(model.site_bodyid[site]), f"{name}: tendon {tendon!r} ends on")
        if model.tendon_armature[index["tendon", tendon]]:
            raise ModelError(f"{name}: tendon {tendon!r} has an armature, which the equations lack; remove it.")
    ours = {index["tendon", tendon] for tendon in (*PADS, FASCIA)}
    for t in sorted(set(range(model.ntendon)) - ours):
        fields = ("stiffness", "stiffnesspoly", "damping", "dampingpoly", "frictionloss", "limited", "armature", "user")
        if any(np.any(getattr(model, f"tendon_{field}")[t]) for field in fields):
            raise ModelError(f"{name}: {element_name(model, 'tendon', t)} pulls, and the equations lack it; remove it.")
    for tendon in (*PADS, FASCIA):
        t = index["tendon", tendon]
        low, high = model.tendon_lengthspring[t] - model.tendon_length0[t]
        if max(abs(low), abs(high)) > TOLERANCE:
            slack = low <= TOLERANCE and high >= -TOLERANCE
            does = "is slack over a part of its way, where the equations have a spring" if slack else "pulls at rest"
            raise ModelError(f"{name}: the spring of tendon {tendon!r} {does}; remove its springlength.")
    fascia = index["tendon", FASCIA]
    if _at_rest(model, "tendon", fascia, name)[1] or _law(model, "tendon", fascia)[0]:
        raise ModelError(
            f"{name}: tendon {FASCIA!r} has a damper, but only its branch of k_12 and c_1 yields; remove it."
        )


def _check_actuators(model: mujoco.MjModel, index: Index, name: str) -> None:
    """The shaker drives the base; beside it only the aponeurosis' branch may act, and on the aponeurosis."""
    base = [j for j in range(model.njnt) if model.joint(j).name == "base"]
    for actuator in range(model.nactuator):
        kind, (target, _) = model.actuator_trntype[actuator], model.actuator_trnid[actuator]
        called = model.actuator(actuator).name
        if actuator == index["actuator", BRANCH]:
            if kind != mujoco.mjtTrn.mjTRN_TENDON or target != index["tendon", FASCIA]:
                raise ModelError(f"{name}: actuator {BRANCH!r} must act on the tendon {FASCIA!r}.")
            _check_branch(model, actuator, name)
        elif kind != mujoco.mjtTrn.mjTRN_JOINT or target not in base:
            raise ModelError(
                f"{name}: actuator {called!r} acts on the arch, but the equations have only {BRANCH!r} beside the "
                "springs and dampers; remove it (laws with a memory, 4.22 and 3, are such actuators, too)."
            )


def _check_branch(model: mujoco.MjModel, branch: int, name: str) -> None:
    """The branch is a spring and a dashpot in series, and nothing else that a motor can be."""
    motor = (("gaintype", mujoco.mjtGain.mjGAIN_DCMOTOR), ("biastype", mujoco.mjtBias.mjBIAS_DCMOTOR),
             ("dyntype", mujoco.mjtDyn.mjDYN_DCMOTOR))  # fmt: skip
    for attribute, required in motor:
        if getattr(model, f"actuator_{attribute}")[branch] != required:
            raise ModelError(f"{name}: actuator {BRANCH!r} must be a <dcmotor>, as in foot_arch.xml.")
    rows: list[tuple[str, np.ndarray, tuple[int, ...]]] = []
    rows += [("gear", model.actuator_gear[branch], (1,)), ("motorconst", model.actuator_gainprm[branch, 1:], (1,))]
    rows += [(attribute, np.ravel(getattr(model, f"actuator_{attribute}")[branch]), ())
             for attribute in ("biasprm", "armature", "damping", "dampingpoly", "actlimited", "forcelimited")
             if len(getattr(model, f"actuator_{attribute}")) > branch]  # fmt: skip
    rows += [("dynprm", model.actuator_dynprm[branch, 1:], ())]
    for attribute, row, required in rows:
        if np.abs(row.astype(float) - np.pad(np.array(required, float), (0, len(row) - len(required)))).max() > 0:
            raise ModelError(
                f"{name}: actuator {BRANCH!r} has another {attribute} than in foot_arch.xml, and the equations have a "
                "spring and a dashpot in series alone; change resistance (1/c_1) and inductance (1/k_12) only."
            )
    if model.actuator_actnum[branch] != 1:
        raise ModelError(f"{name}: actuator {BRANCH!r} must have one state, its current.")


def _check_declared(model: mujoco.MjModel, constants: Mapping[str, float], name: str) -> None:
    """What `<custom>` declares is what a fit starts from, so it must be what the model has."""
    for symbol, parameter in declared(model, name).items():
        value = parameter.read(model)
        if symbol in constants and not abs(value - constants[symbol]) <= TOLERANCE * constants[symbol]:
            raise ModelError(
                f"{name}: parameter {symbol!r} is declared where {value:g} {parameter.unit} stands, but the model has "
                f"{constants[symbol]:g} in all; edit every place that its <text> names, or its <text>."
            )


def _listed(values: Iterable[float]) -> str:
    return " ".join(f"{value:g}" for value in values)
