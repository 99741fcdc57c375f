"""A foot as an MJCF model: loaded by name or file, checked for what every command needs, refused in one sentence."""

import copy
import re
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import mjcf
from fasbody.exceptions import InputFileError, ModelError, unknown
from fasbody.foot import damper
from fasbody.foot.accelerometers import Sensor, accelerometers, check_sensors, reference_pose
from fasbody.foot.compiler import compiler_complaint
from fasbody.foot.engine import SHAKER_CONTROLS, quiet
from fasbody.foot.law_checks import check_laws
from fasbody.foot.model_fields import check_fields, element_name
from fasbody.foot.native import SHAKER
from fasbody.foot.parameters import Fitted, Parameters, declared, names
from fasbody.presentation import Sheet, Tabled, readable

#: Elements that every command needs, by kind.
REQUIRED = {"joint": ("base",), "actuator": ("shaker",), "sensor": ("base", "malleolus"), "site": ("malleolus",)}
#: Armature from which a joint is the shaker's table [kg], and how far two tied pads may differ at rest [m].
HEAVY, CLOSED = 1e6, 1e-6
#: Improvement at which the solver of constraints stops, and its iterations. MuJoCo divides it by all
#: inertia, of which the table has nearly all: at the usual 1e-8 a foot's constraint is not seen.
_IMPROVEMENT, _ITERATIONS = 1e-30, 100
#: How far [m] and fast [m/s] a table is moved to see what ties it to the world, and by how much that may change its
#: acceleration [1/s^2 or 1/s], and a foot's. Jacobian from which on something pulls.
_MOVED, _SPEED, _HELD, _FELT, _PULLS = 1e-3, 0.1, 1.0, 0.1, 1e-9
#: Density of a geom that names none [kg/m^3].
_WATER = 1000.0
#: Geoms whose density is written.
_DENSE = re.compile(r"<geom(?=[^>]*\sdensity\s*=)[^>]*>")
#: Density as it is where none is written.
_WATERY = re.compile(r"""\sdensity\s*=\s*["']\s*(1000(\.0*)?|1e3)\s*["']""")
#: The actuator that is the static load of a model without gravity.
WEIGHT = "weight"
#: What lets the compiler change masses and inertias.
_BOUNDS, _WEIGHS = ("boundmass", "boundinertia", "balanceinertia"), ("mass", "inertia")
#: Least eigenvalue of a mass matrix whose diagonal is 1: the arch has 4e-3, and rounding makes 1e-16 of none.
_SINGULAR = 1e-9
#: Parts of the physics that no model may switch off.
_NEEDED = ("spring", "damper", "gravity", "equality", "actuation", "sensor")


@dataclass(frozen=True, eq=False, repr=False)
class Foot(Tabled):
    """A compiled model with the places that the commands use.

    Attributes:
        name: file name or name of the shipped model.
        model: the compiled model; treat it as read-only, `with_values` returns a changed copy.
        parameters: what the model declares as editable.
        base: index of the base coordinate in qpos and qvel.
        shaker: first of the shaker's five controls.
        up: (3,) the vertical, along which the base slides.
        sensors: the model's accelerometers by name, the base's among them.
        xml: the MJCF as MuJoCo writes it, to build another model on; "" where it needs other files.
    """

    name: str
    model: mujoco.MjModel
    parameters: Parameters
    base: int
    shaker: int
    up: tuple[float, float, float]
    sensors: Mapping[str, Sensor]
    xml: str = ""

    @property
    def step(self) -> float:
        """Default time step [s]."""
        return float(self.model.opt.timestep)

    def values(self) -> dict[str, float]:
        """Current value of every declared parameter, in its unit."""
        return {name: item.read(self.model) for name, item in self.parameters.items()}

    def with_values(self, values: Mapping[str, float] | Fitted, step: float | None = None) -> "Foot":
        """A copy with some parameters (and the time step) changed.

            foot.with_values({"k_T": 2e5})
            foot.with_values(fit_foot(recordings, foot))

        Args:
            values: what a fit returns, or numbers by thesis symbol, ``k_T``, or as a fit names them, ``k_T_n_per_m`` or
                ``k_T [N/m]``. Of a fit, the constants that hold if the model is true are written: with the masses as
                stated, they move the foot as recorded. The masses stay those of the foot, also where others were
                fitted beside the constants; set m_S and m_F for another body. A delay is one of the recording's
                channels, not of the foot, and is left out.
            step: time step [s].

        Raises:
            SettingError: parameters that the model does not have (the message lists those that exist), or a value that
                one cannot have.
        """
        changed = copy.copy(self.model)
        for name, value in self.parameters.named(values).items():
            item = self.parameters[name]
            item.check(value)
            item.write({field: getattr(changed, field).reshape(-1) for field in item.fields}, value)
        if step is not None:
            changed.opt.timestep = step
        mujoco.mj_setConst(changed, mujoco.MjData(changed))
        return replace(self, model=changed)

    def __str__(self) -> str:
        return f"{self.name}: " + ", ".join(
            f"{name} {readable(value, 4)} {self.parameters[name].unit}" for name, value in self.values().items()
        )

    def __repr__(self) -> str:
        return str(self.sheet())

    def sheet(self) -> Sheet:
        """Parameters with their bounds and where they come from."""
        values = self.values()
        rows = [
            (p.name, readable(values[p.name], 6), p.unit, f"{readable(p.lower)} to {readable(p.upper)}", p.source)
            for p in self.parameters.values()
        ]
        return Sheet(self.name, ("parameter", "value", "unit", "bounds", "source"), rows)


def load(model: str | Path | mujoco.MjSpec, name: str = "") -> Foot:
    """Load a foot model.

        load("two_dof")
        load("my_foot.xml")
        load(Path("my_foot.xml").read_text())

    Args:
        model: name of a shipped model (``two_dof``), an MJCF file, the text of one, or a `mujoco.MjSpec`, which is
            compiled as it is then. Text and MjSpec are called as their ``<mujoco model="...">`` says.
        name: of a file's model, if not the file's.

    Raises:
        InputFileError: no such model or file, or MuJoCo cannot compile it.
        ModelError: a required element is missing, or a parameter or law is not valid.
    """
    shipped = mjcf.names()
    if isinstance(model, mujoco.MjSpec):
        return _checked(lambda: model, "MjSpec")
    if isinstance(model, str) and model.lstrip().startswith("<"):
        files = [part for name in mjcf.included(model) if Path(name).is_file() for part in mjcf.parts(Path(name))]
        dense = _dense("MJCF text", model, *(part.read_text(errors="replace") for part in files))
        return _checked(lambda: mujoco.MjSpec.from_string(model, _shaker(model)), "MJCF text", dense=dense)
    file = mjcf.path(str(model)) if str(model) in shipped else Path(model)
    if not file.is_file():
        valid = f"give an MJCF file or one of {', '.join(shipped)}"
        raise InputFileError(model, "is a folder" if file.is_dir() else "no such model", valid)
    name = name or (str(model) if str(model) in shipped else file.name)
    dense = _dense(name, *(part.read_text(errors="replace") for part in mjcf.parts(file)))
    return _checked(lambda: read_spec(file), file, name, dense)


def read_spec(file: Path) -> mujoco.MjSpec:
    """An MJCF file, also of a copy that left the shaker behind, which it includes.

    Raises:
        ValueError: MuJoCo cannot read it.
    """
    return mujoco.MjSpec.from_file(str(file), _shaker(file.read_text(errors="replace"), file.parent))


def _shaker(text: str, folder: Path | None = None) -> dict[str, bytes]:
    """The shipped shaker by the names under which MJCF includes it, where its folder has none."""
    named = [name for name in mjcf.included(text) if Path(name).name == mjcf.SHAKER.name]
    return {name: mjcf.SHAKER.read_bytes() for name in named if not (folder and (folder / name).is_file())}


def _dense(of: str, *texts: str) -> set[tuple[int, str]]:
    """Line and name of each geom whose density is written in MJCF, or in what it includes or attaches.

    MuJoCo does not say whether a geom's 1000 kg/m^3 are written or its default.
    """
    geoms = set()
    for bare in map(mjcf.without_comments, texts):
        for match in _DENSE.finditer(bare):
            before = bare[: match.start()]
            if len(re.findall(r"<default[\s>]", before)) > before.count("</default>") and _WATERY.search(match[0]):
                raise ModelError(
                    f"{of}: {match[0]} in a <default> cannot be told from a density that nobody wrote; write the "
                    "masses, or the density at each geom."
                )
            name = re.search(r"""\sname\s*=\s*["']([^"']*)""", match[0])
            geoms.add((bare.count("\n", 0, match.start()) + 1, name[1] if name else ""))
    return geoms


def _checked(
    read: Callable[[], mujoco.MjSpec], place: str | Path, name: str = "",
    dense: Collection[tuple[int, str]] = (),
) -> Foot:  # fmt: skip
    """The foot that MuJoCo makes of a model; without a name it has the one in its MJCF.

    Args:
        read: makes the model.
        place: where it comes from.
        name: what to call it.
        dense: line and name of the geoms whose density is written.

    Raises:
        InputFileError: it cannot compile it. ModelError: see `load`.
    """
    try:
        with quiet(), warnings.catch_warnings(category=UserWarning, action="ignore"):
            # what MuJoCo has to warn of is refused below, in a sentence
            spec = read()
            _check_masses(spec, name or spec.modelname, dense)
            compiled = spec.compile()
            _check_bounds(spec, compiled, name or spec.modelname)
            xml = "" if spec.meshes or spec.hfields or spec.textures else spec.to_xml()
    except ValueError as error:
        clause, line = compiler_complaint(str(error))
        raise InputFileError(place, f"MuJoCo cannot compile it ({clause})", line=line) from None
    foot = check(compiled, name or _called(compiled))
    _check_derived(spec, foot)
    return replace(foot, xml=xml)


def _check_derived(spec: mujoco.MjSpec, foot: Foot) -> None:
    """Refuse what MuJoCo derives from masses when it compiles, and would not follow a parameter afterwards."""
    for actuator in spec.actuators:
        affine = actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE
        if affine and actuator.biasprm[2] > 0 and actuator.gainprm[0] == -actuator.biasprm[1]:  # MuJoCo's rule
            raise ModelError(
                f"{foot.name}: the kv of actuator {actuator.name!r} follows from its dampratio, as which MuJoCo takes "
                "a positive biasprm, and the mass in the file only, and not from other values of a parameter; write kv."
            )
    for joint in spec.joints:
        if np.any(joint.springdamper):
            raise ModelError(
                f"{foot.name}: stiffness and damping of joint {joint.name!r} follow from its springdamper and the mass "
                "in the file only, and not from other values of a parameter; write stiffness and damping."
            )
    for symbol, parameter in foot.parameters.items():
        for place in parameter.places:
            body = foot.model.body(place.index).name if place.field == "body_mass" else ""
            if body and not spec.body(body).explicitinertial and _turns(foot.model, place.index):
                raise ModelError(
                    f"{foot.name}: parameter {symbol!r} is the mass of body {body!r}, whose inertia follows from its "
                    "geoms in the file only; write an <inertial>."
                )


def _turns(model: mujoco.MjModel, body: int) -> bool:
    """Whether a body has a hinge or a ball, its own or one that carries it."""
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    while body:
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        if any(model.jnt_type[first : first + count] != slide):
            return True
        body = int(model.body_parentid[body])
    return False


def _called(model: mujoco.MjModel) -> str:
    """The name that a model gives itself, which MuJoCo keeps before those of its elements."""
    return str(model.names.partition(b"\0")[0].decode())


def _check_masses(spec: mujoco.MjSpec, name: str, dense: Collection[tuple[int, str]]) -> None:
    """Refuse masses that MuJoCo ignores without a warning, or also spreads over the table."""
    if spec.compiler.settotalmass > 0:
        raise ModelError(
            f'{name}: <compiler settotalmass="{spec.compiler.settotalmass:g}"/> scales all masses until they come to '
            "that with the table's; write the masses of the bodies."
        )
    for body in spec.bodies[1:]:
        by_geoms = body.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        stated = body.explicitinertial and not by_geoms
        for geom in body.geoms:
            written = geom.density != _WATER or _is_among(geom, dense)
            density = f"density {geom.density:g}" if written and geom.density else ""
            if stated and (geom.mass > 0 or density):
                quantity, ruled = density or f"mass {geom.mass:g}", f"body {body.name!r} has an <inertial>"
            elif density and not np.isnan(geom.mass):
                ruled = f'its mass is written, too: mass="{geom.mass:g}", maybe of a default class'
                quantity = density
            else:
                continue
            of = f"geom {geom.name!r}" if geom.name else f"a geom of body {body.name!r}"
            raise ModelError(
                f"{name}: {of} has the {quantity}, which counts for nothing, as {ruled}; write the mass there."
            )
        if body.geoms and not body.explicitinertial and all(geom.density and geom.mass == 0 for geom in body.geoms):
            raise ModelError(
                f'{name}: body {body.name!r} weighs nothing, as each of its geoms has mass="0", maybe of a default '
                'class; write their masses, or density="0" where one is only drawn.'
            )


def _is_among(geom: Any, written: Collection[tuple[int, str]]) -> bool:
    """Whether a geom is one of some lines and names; one that was attached has a longer name."""
    line = int((re.search(r"\d+", geom.info) or "0")[0])
    return any(at == line and (geom.name.endswith(name) if name else not geom.name) for at, name in written)


def _check_bounds(spec: mujoco.MjSpec, compiled: mujoco.MjModel, name: str) -> None:
    """Refuse masses and inertias that the compiler raises or balances."""
    used = {bound for body in spec.bodies for bound in _BOUNDS if getattr(body.compiler, bound)}
    if not used:
        return
    plain = spec.copy()
    for body in plain.bodies:
        for bound in used:
            setattr(body.compiler, bound, 0)
    by, advice = f"<compiler {' '.join(sorted(used))}>", "write at the body what is meant, and leave the attribute out."
    try:
        unbound = plain.compile()
    except ValueError as error:
        clause = compiler_complaint(str(error))[0].partition(";")[0]
        body = re.match(r"'([^']*)'", clause)
        numbers = [f"{part} {_listed(getattr(compiled.body(body[1]), part))}" for part in _WEIGHS if body]
        takes = " and ".join(numbers) or "something else"
        raise ModelError(f"{name}: body {clause}, where {by} takes {takes}; {advice}") from None
    for quantity in _WEIGHS:
        for i in range(compiled.nbody):
            stated, taken = (_listed(getattr(model.body(i), quantity)) for model in (unbound, compiled))
            if stated != taken:
                raise ModelError(
                    f"{name}: body {compiled.body(i).name!r} has the {quantity} {stated}, and {by} makes it {taken}; "
                    f"{advice}"
                )


def _listed(numbers: np.ndarray) -> str:
    return " ".join(f"{number:g}" for number in numbers)


def check(model: mujoco.MjModel, name: str) -> Foot:
    """Wrap a compiled model as a `Foot`.

    Args:
        model: the compiled model.
        name: what to call it in messages.

    Raises:
        ModelError: see `load`.
    """
    for kind, needed in REQUIRED.items():
        elements = names(model, kind)
        missing = [element for element in needed if element not in elements]
        if missing:
            needs = ", ".join(f"{k} {' and '.join(n)}" for k, n in REQUIRED.items())
            raise ModelError(
                f"{name}: {unknown(kind, missing[0], elements).replace('unknown', 'there is no')}; "
                f"every foot model needs {needs}."
            )
    check_constants(model, name)
    check_laws(model, name)
    _check_options(model, name)
    solve_exactly(model)
    shaker = model.actuator("shaker").id
    first = int(model.actuator_ctrladr[shaker])
    if model.actuator_biasprm[shaker, 0] != SHAKER or model.nu < first + SHAKER_CONTROLS:
        raise ModelError(
            f'{name}: the actuator shaker needs biastype="user" biasprm="{SHAKER:g}" and four more actuators behind it '
            "that carry its controls; copy the actuators of two_dof.xml."
        )
    _check_shaker(model, name, first)
    check_fields(model, name)
    up = _check_base(model, name, shaker)
    _check_held(model, name)
    _check_inertia(model, name)
    _check_pads(model, name)
    sensors = accelerometers(model, up)
    for element in REQUIRED["sensor"]:
        if element not in sensors:
            raise ModelError(f"{name}: sensor {element!r} reads no acceleration; make it a framelinacc at a site.")
    check_sensors(model, name, sensors)
    base = int(model.jnt_qposadr[model.joint("base").id])
    if not can_be_constrained(model):  # MuJoCo then need not look for contacts: a fifth of a step
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    parameters = declared(model, name)
    _check_added_mass(model, parameters, name)
    _check_places(model, parameters, name)
    return Foot(name, model, parameters, base, first, up, sensors)


def solve_exactly(model: mujoco.MjModel) -> None:
    """Iterate the constraint solver to convergence: the solution is unique, so the file's solver does not matter."""
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.tolerance = min(model.opt.tolerance, _IMPROVEMENT)
    model.opt.iterations = max(model.opt.iterations, _ITERATIONS)


def _check_options(model: mujoco.MjModel, name: str) -> None:
    """Require slides and hinges only, and no physics switched off, which no equation would follow."""
    for j in range(model.njnt):
        if int(model.jnt_type[j]) not in (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)):
            on = element_name(model, "body", int(model.jnt_bodyid[j]))
            raise ModelError(
                f"{name}: {element_name(model, 'joint', j)} of {on} is a ball or free; use slides and hinges."
            )
    for flag in (*_NEEDED, *(("constraint",) if can_be_constrained(model) else ())):
        if model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}"):
            raise ModelError(
                f'{name}: <flag {flag}="disable"/> switches off what the model is made of; remove it, and change the '
                "numbers of the elements instead."
            )
    if WEIGHT in names(model, "actuator") and model.opt.gravity.any():
        raise ModelError(
            f"{name}: <option> has gravity, and the actuator {WEIGHT!r} stands for it, so that the weight would count "
            "twice; remove one of both."
        )
    if model.opt.noslip_iterations:
        raise ModelError(f"{name}: <option> has noslip_iterations, which no periodic motion knows; remove it.")


def _check_inertia(model: mujoco.MjModel, name: str) -> None:
    """Require that no joint moves what others move already, without a mass of its own."""
    M, data = np.zeros((model.nv, model.nv)), reference_pose(model)
    mujoco.mj_makeM(model, data)
    mujoco.mj_fullM(model, data, M)
    size = np.sqrt(np.diag(M))
    shares, ways = np.linalg.eigh(M / np.outer(size, size))
    if shares[0] < _SINGULAR:
        moved = np.flatnonzero(np.abs(ways[:, 0]) > 0.1)
        alike = " and ".join(dict.fromkeys(element_name(model, "dof", int(i)) for i in moved))
        raise ModelError(
            f"{name}: {alike} move the same masses in the same way, so that nobody knows which of them moves; put a "
            "body with a mass between them, or remove one."
        )


def _check_shaker(model: mujoco.MjModel, name: str, first: int) -> None:
    """Require that the shaker is on and its force unlimited."""
    for actuator in range(model.nactuator):
        control = int(model.actuator_ctrladr[actuator])
        called, out = model.actuator(actuator).name, int(model.actuator_outadr[actuator])
        group = int(model.actuator_group[actuator])
        if 0 <= group < 31 and model.opt.disableactuator >> group & 1:
            raise ModelError(
                f"{name}: actuator {called!r} is switched off by actuatorgroupdisable; remove one of both."
            )
        if not first <= control < first + SHAKER_CONTROLS:
            continue
        if model.actuator_ctrllimited[control] or model.actuator_forcelimited[out]:
            raise ModelError(f"{name}: actuator {called!r} has a range, and the table must move as asked; remove it.")


def _check_added_mass(model: mujoco.MjModel, parameters: Parameters, name: str) -> None:
    """The added mass goes to one place: that of `added_mass`, or with the shank into m_S or m_T."""
    shank = next((symbol for symbol in ("m_S", "m_T") if symbol in parameters), None)
    if "added_mass" not in parameters:
        return
    if shank:
        raise ModelError(
            f"{name}: declares added_mass and {shank}, and {shank} of a recording holds the added mass already; "
            f"call {shank} otherwise, such as m_K, or leave added_mass out."
        )
    place, *more = parameters["added_mass"].places
    if more or place.field != "body_mass" or place.share != 1 or place.reciprocal:
        raise ModelError(f"{name}: added_mass must stand at one place, body NAME mass.")
    if model.body_dofnum[place.index]:
        raise ModelError(
            f"{name}: added_mass stands at body {model.body(place.index).name!r}, whose own "
            f"{model.body_mass[place.index]:g} kg it would replace; name a body of mass 0 that is fixed to it, as the "
            "body load of leg.xml is."
        )


def _check_places(model: mujoco.MjModel, parameters: Parameters, name: str) -> None:
    """Where a parameter stands at several places, all must say the same: one number is read, and all are written."""
    for symbol, parameter in parameters.items():
        value = parameter.read(model)
        for place in parameter.places[1:]:
            other = place.read(model)
            if abs(other - value) > 1e-6 * max(abs(value), abs(other)):
                raise ModelError(
                    f"{name}: parameter {symbol!r} is {value:g} {parameter.unit} at the first place that its <text> "
                    f"names and {other:g} at another; edit every place alike, or the shares in the <text>."
                )


def _check_base(model: mujoco.MjModel, name: str, shaker: int) -> tuple[float, float, float]:
    """The base goes up and down, the foot on it along the same way, and no other joint is as heavy; which way is up.

    The shaker's force is gear x acceleration, so the gear must be the base's armature.
    """
    joint, data = model.joint("base").id, reference_pose(model)
    axis = np.where(np.abs(data.xaxis[joint]) < 1e-9, 0.0, data.xaxis[joint])
    if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_SLIDE:
        raise ModelError(f"{name}: joint 'base' must be a slide along the vertical, which its axis says.")
    on = int(model.site_bodyid[model.site("malleolus").id])
    if model.body_weldid[on] in (0, model.body_weldid[model.jnt_bodyid[joint]]):
        raise ModelError(
            f"{name}: site 'malleolus' is on {model.body(on).name!r}, which no joint of the foot moves; put it on a "
            "body of the foot."
        )
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, model.site("malleolus").id)
    if np.abs(np.delete(axis @ jacobian, int(model.jnt_dofadr[joint]))).max(initial=0.0) < 1e-9:
        raise ModelError(
            f"{name}: joint 'base' moves along {axis[0]:g} {axis[1]:g} {axis[2]:g}, which is up then, and no other "
            "joint moves the malleolus that way; turn the axis of base or those of the foot."
        )
    gear, base = float(model.actuator_gear[model.actuator_outadr[shaker], 0]), int(model.jnt_dofadr[joint])
    armature = float(model.dof_armature[base])
    if not (armature >= HEAVY and abs(gear / armature - 1) < 1e-6):
        raise ModelError(
            f"{name}: the shaker has gear {gear:g} and the joint base has armature {armature:g}; "
            "both must be the same large number (1e9), so that the base follows the prescribed acceleration."
        )
    for dof in np.flatnonzero(model.dof_armature >= HEAVY):
        if dof != base:
            raise ModelError(
                f"{name}: joint {model.joint(model.dof_jntid[dof]).name!r} has the armature "
                f'{model.dof_armature[dof]:g} of the shaker\'s table, so that nothing moves it; give it armature="0".'
            )
    x, y, z = (float(part) for part in axis)
    return x, y, z


def _check_held(model: mujoco.MjModel, name: str) -> None:
    """Refuse what ties the table to the world with a force that is not small against the table's inertia."""
    change, data = _moved(model)
    dof = int(model.jnt_dofadr[model.joint("base").id])
    if change[dof] < _HELD:
        return
    raise ModelError(
        f"{name}: {' and '.join(_holders(model, data, dof))} holds the table, which moves as it is asked to; tie it to "
        "the foot, or remove it."
    )


def held_to_world(foot: Foot) -> list[str]:
    """What makes the foot feel where the table is or how fast it goes; a contact that is open shows nothing of it."""
    change, data = _moved(foot.model)
    if np.delete(change, foot.base).max(initial=0.0) < _FELT:
        return []
    return _holders(foot.model, data, foot.base)


def _moved(model: mujoco.MjModel) -> tuple[np.ndarray, mujoco.MjData]:
    """How accelerations (nv,) change per m and per m/s of the table, whichever is more, and the data there."""
    data, base = mujoco.MjData(model), model.joint("base")
    mujoco.mj_forward(model, data)
    rest, changes = data.qacc.copy(), []
    for state, index, size in ((data.qpos, base.qposadr[0], _MOVED), (data.qvel, base.dofadr[0], _SPEED)):
        state[index] += size
        mujoco.mj_forward(model, data)
        changes.append(np.abs(data.qacc - rest) / size)
        rest = data.qacc.copy()
    return np.maximum(*changes), data


def _holders(model: mujoco.MjModel, data: mujoco.MjData, dof: int) -> list[str]:
    """What acts between a degree of freedom and the world, by kind and name."""
    pull = _column(data.ten_J, model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind, dof)
    push = _column(data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind, dof)
    rows = np.zeros(data.nefc)
    mujoco.mj_mulJacVec(model, data, rows, np.eye(model.nv)[dof])  # of a sparse Jacobian and of a dense one
    equal = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    equalities = dict.fromkeys(map(int, data.efc_id[equal & (rows != 0)]))
    forces = (model.tendon_stiffness, model.tendon_damping, model.tendon_frictionloss, model.tendon_limited)
    tendons = np.flatnonzero(np.any(forces, axis=0) & (np.abs(pull) > _PULLS))
    pushing = np.abs(push[model.actuator_outadr]) > _PULLS
    actuators = np.flatnonzero(pushing & (model.actuator_trntype != mujoco.mjtTrn.mjTRN_JOINT))
    kinds = (("equality", list(equalities)), ("tendon", tendons.tolist()), ("actuator", actuators.tolist()))
    return [element_name(model, kind, number) for kind, numbers in kinds for number in numbers] or ["something"]


def _column(values: np.ndarray, count: np.ndarray, first: np.ndarray, columns: np.ndarray, column: int) -> np.ndarray:
    """One column (rows,) of a sparse matrix of MuJoCo."""
    flat, where = values.ravel(), columns.ravel()
    rows = (slice(start, start + n) for start, n in zip(first, count, strict=True))
    return np.array([flat[row][where[row] == column].sum() for row in rows])


def _check_pads(model: mujoco.MjModel, name: str) -> None:
    """Tendons that an equality keeps equally long must begin so: the engine would keep the gap that it finds."""
    for e in np.flatnonzero((model.eq_type == mujoco.mjtEq.mjEQ_TENDON) & model.eq_active0):
        one, other = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        tie = f"{name}: {element_name(model, 'equality', int(e))}"
        gap = abs(float(model.tendon_length0[one] - model.tendon_length0[other])) if other >= 0 else 0.0
        if gap > CLOSED and not np.any(model.eq_data[e, :5] - (0, 1, 0, 0, 0)):
            raise ModelError(
                f"{tie} ties the tendons {model.tendon(one).name!r} and "
                f"{model.tendon(other).name!r}, whose lengths at rest are {gap * 1e3:.3f} mm apart; turn or move a "
                "body until both are equal (in foot_arch.xml calcaneus_talus, until heel and heads are level)."
            )


def check_constants(model: mujoco.MjModel, name: str) -> None:
    """Refuse a stiffness, damping or mass that is negative or no number; the message names its element.

    Args:
        model: the compiled model.
        name: what to call it in messages.

    Raises:
        ModelError: the first one found.
    """
    rows = [("body", b, "mass", m) for b, m in enumerate(model.body_mass)]
    rows += [("joint", int(model.dof_jntid[i]), "damping", c) for i, c in enumerate(model.dof_damping)]
    rows += [("joint", j, "stiffness", k) for j, k in enumerate(model.jnt_stiffness)]
    rows += [("tendon", t, "damping", c) for t, c in enumerate(model.tendon_damping)]
    rows += [("tendon", t, "stiffness", k) for t, k in enumerate(model.tendon_stiffness)]
    for kind, user in (("joint", model.jnt_user), ("tendon", model.tendon_user)):
        if user.shape[1] > 1:
            rows += [(kind, i, "damping", row[1]) for i, row in enumerate(user) if row[0] == damper.DAMPER]
    for kind, number, quantity, value in rows:
        if not 0 <= value < np.inf:
            element = getattr(model, kind)(number).name
            raise ModelError(
                f"{name}: {kind} {element!r} has the {quantity} {value:g}; it must be a number of zero or more."
            )


def can_be_constrained(model: mujoco.MjModel) -> bool:
    """Whether anything in a model can touch, or has a limit, an equality or dry friction."""
    return bool(model.neq) or can_change(model)


def can_change(model: mujoco.MjModel) -> bool:
    """Whether anything in a model can touch, stop or slip."""
    limited = model.jnt_limited.any() or model.tendon_limited.any()
    return bool(_can_touch(model) or limited or model.dof_frictionloss.any() or model.tendon_frictionloss.any())


def _can_touch(model: mujoco.MjModel) -> bool:
    return bool(np.bitwise_and.outer(model.geom_contype, model.geom_conaffinity).any() or model.npair or model.nflex)


def check_free(model: mujoco.MjModel, name: str) -> None:
    """Refuse what pushes or stops a foot and is in no equation: contact, limits, dry friction, a fluid.

    Args:
        model: the compiled model.
        name: what to call it in messages.

    Raises:
        ModelError: the first one found, by its name.
    """
    for kind, limited, friction in (
        ("joint", model.jnt_limited, model.dof_frictionloss),
        ("tendon", model.tendon_limited, model.tendon_frictionloss),
    ):
        for number in np.flatnonzero(limited):
            element = getattr(model, kind)(number).name
            raise ModelError(f"{name}: {kind} {element!r} has a limit, which no equation has.")
        for number in np.flatnonzero(friction):
            element = getattr(model, kind)(model.dof_jntid[number] if kind == "joint" else number).name
            raise ModelError(f"{name}: {kind} {element!r} has dry friction, which no linear equation has.")
    if _can_touch(model):
        raise ModelError(
            f'{name}: geoms can touch, which no linear equation has; use contype="0" conaffinity="0" and no <pair>.'
        )
    if model.opt.density or model.opt.viscosity:
        raise ModelError(f"{name}: <option> has a density or viscosity of what is around, which no equation has.")


