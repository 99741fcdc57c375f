"""A leg as a chain of masses that go up and down on the table: matrices and frequency response in closed form.

Every mass m_i hangs on the one below it (or on the table) by a spring k_i and a damper c_i. With z_i the stretch of its
joint, a mass is at y = y_0 + P z, where P_ij = 1 if joint j lies on the way from the table to mass i. In z the
equations are

    P^T m P z'' + diag(c) z' + diag(k) z = - P^T m 1 y_0''

so that the acceleration of mass i over that of the table is T_i = 1 + (P Z)_i with
Z = s^2 / (s^2 P^T m P + s c + k) (-P^T m 1) and s = 2 pi j f. The chain may branch.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fasbody.exceptions import ModelError, unknown
from fasbody.foot import damper
from fasbody.foot.accelerometers import body_of, leans, reference_pose
from fasbody.foot.model import check_constants, check_free
from fasbody.foot.model_fields import element_name
from fasbody.foot.parameters import declared, names
from fasbody.presentation import Tabled

Array = np.ndarray
#: Sites that a leg has: where the accelerometers of section 2.2 sit, and the knee.
SITES = ("malleolus", "tuberosity", "knee")
#: Number of what stands still, in place of a mass.
WORLD = -2


@dataclass(frozen=True, eq=False)
class Leg(Tabled):
    """A chain on the table.

    Attributes:
        names: joint of each mass, from the table up, (n,).
        mass: [kg], (n,), with every body that is welded to it.
        parent: number of the mass below, -1 for the table, (n,).
        stiffness: of each joint [N/m], (n,).
        damping: of each joint [N s/m], (n,).
        site: site -> number of the mass it sits on, -1 for the table, -2 for what stands still.
        carrier: number of the mass that carries the added one, None if the model names none.
        added: mass that it carries already [kg], in `mass`.
    """

    names: tuple[str, ...]
    mass: Array
    parent: tuple[int, ...]
    stiffness: Array
    damping: Array
    site: Mapping[str, int]
    carrier: int | None = None
    added: float = 0.0

    @classmethod
    def from_model(cls, model: mujoco.MjModel, name: str = "model") -> "Leg":
        """Read a compiled model: any tree of slides along y on the joint base, with linear springs and dampers.

        Laws in `user` fields are taken for small motion about rest.

        Args:
            model: the compiled model.
            name: what to call it in messages.

        Raises:
            ModelError: something in the model is not in these equations; the message names it.
        """
        check_constants(model, name)
        _check_nothing_else(model, name)
        data = reference_pose(model)
        base = _slides(data, name)
        joints = [j for j in range(model.njnt) if j != base]
        at = {int(model.jnt_bodyid[j]): i for i, j in enumerate(joints)}
        table = int(model.jnt_bodyid[base])
        on = {0: WORLD, table: -1}  # body -> the mass it belongs to
        mass, parent = np.zeros(len(joints)), [0] * len(joints)
        for body in range(1, model.nbody):
            below = on[int(model.body_parentid[body])]
            on.setdefault(body, at.get(body, below))
            if body in at and below == WORLD:
                raise ModelError(f"{name}: body {model.body(body).name!r} does not stand on the table; put it there.")
            if body in at:
                parent[at[body]] = below
            if on[body] >= 0:
                mass[on[body]] += model.body_mass[body]
        laws = [_law(model, j, name) for j in joints]
        sites = {site: on[int(model.site(site).bodyid[0])] for site in names(model, "site")}
        for site in SITES:
            if sites.get(site, 0) < 0:
                on_what = model.body(int(model.site(site).bodyid[0])).name
                raise ModelError(
                    f"{name}: site {site!r} is on {on_what!r}, not a part of the leg; put it on one of its masses."
                )
        for sensor in {*names(model, "sensor")} & {*sites}:
            sensed = body_of(model, model.sensor(sensor).id)
            if on[sensed] != sites[sensor]:
                raise ModelError(
                    f"{name}: sensor {sensor!r} sits on {model.body(sensed).name!r} and the site {sensor!r} does not; "
                    "put both on one body."
                )
            if leans(data, model.sensor(sensor).id, (0.0, 1.0, 0.0)):
                raise ModelError(
                    f"{name}: sensor {sensor!r} leans, and these equations read it along y; turn its site."
                )
        labels = tuple(model.joint(j).name for j in joints)
        k, c = (np.array([law[i] for law in laws]) for i in (0, 1))
        parameters = declared(model, name)
        carrier, added = None, 0.0
        if "added_mass" in parameters:
            carrier, added = on[parameters["added_mass"].places[0].index], parameters["added_mass"].read(model)
            if carrier < 0:
                raise ModelError(
                    f"{name}: added_mass stands on the table or beside it, and so is not a part of the leg."
                )
        return cls(labels, mass, tuple(parent), k, c, sites, carrier, added)

    @property
    def path(self) -> Array:
        """P, shape (n, n): 1 where a joint lies between the table and a mass."""
        P = np.eye(len(self.mass))
        for i, below in enumerate(self.parent):
            if below >= 0:
                P[i] += P[below]
        return P

    def matrices(self) -> tuple[Array, Array, Array]:
        """Mass [kg], damping [N s/m] and stiffness [N/m] in the stretches of the joints, each (n, n)."""
        P = self.path
        return P.T @ (self.mass[:, None] * P), np.diag(self.damping), np.diag(self.stiffness)

    def with_added(self, added_mass_kg: float) -> "Leg":
        """The leg with a mass [kg] where the model says that it goes, in place of what is there; 0 takes that away.

        Raises:
            ModelError: the model names no place for it.
        """
        if self.carrier is None:
            if not added_mass_kg:
                return self
            raise ModelError("the model declares no parameter 'added_mass', so that nothing carries the added mass.")
        mass = self.mass.copy()
        mass[self.carrier] += added_mass_kg - self.added
        return replace(self, mass=mass, added=added_mass_kg)

    def stretch(self, frequency_hz: Array) -> Array:
        """Stretch of each joint per acceleration of the table [s^2], complex, shape (f, n)."""
        M, C, K = self.matrices()
        s = 2j * np.pi * np.asarray(frequency_hz, float).reshape(-1, 1, 1)
        push = -self.path.T @ self.mass
        return np.linalg.solve(s**2 * M + s * C + K, np.broadcast_to(push[:, None], (s.shape[0], push.size, 1)))[..., 0]

    def response(self, frequency_hz: Array) -> Array:
        """Acceleration of each mass over that of the table, complex, shape (f, n)."""
        s = 2j * np.pi * np.asarray(frequency_hz, float).reshape(-1, 1)
        return 1 + s**2 * (self.stretch(frequency_hz) @ self.path.T)

    def at(self, site: str, frequency_hz: Array) -> Array:
        """The same at a site, shape (f,).

        Raises:
            ModelError: there is no such site.
        """
        if site not in self.site:
            raise ModelError(f"{unknown('site', site, self.site)}.")
        number = self.site[site]
        if number < 0:
            return np.full(np.size(frequency_hz), 0 if number == WORLD else 1, complex)
        return self.response(frequency_hz)[:, number]

    def modes(self) -> tuple[Array, Array]:
        """Natural frequencies [Hz] and damping ratios of the oscillating modes, sorted by frequency."""
        M, C, K = self.matrices()
        n = len(M)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
        poles = np.linalg.eigvals(A)
        poles = poles[poles.imag > 0]
        poles = poles[np.argsort(np.abs(poles))]
        return np.abs(poles) / (2 * np.pi), -poles.real / np.abs(poles)


def _slides(data: mujoco.MjData, name: str) -> int:
    """Number of the joint base; every joint must be a slide along y, one to a body, the bodies not turned."""
    model = data.model
    for j in range(model.njnt):
        off = np.abs(data.xaxis[j] - (0, 1, 0)).max()
        if model.jnt_type[j] != mujoco.mjtJoint.mjJNT_SLIDE or off > 1e-9:
            raise ModelError(f"{name}: joint {model.joint(j).name!r} is not a slide along y; a leg moves only along y.")
        at = model.jnt_qposadr[j]
        if model.joint(j).name != "base" and model.qpos_spring[at] != model.qpos0[at]:
            raise ModelError(
                f"{name}: joint {model.joint(j).name!r} has a springref that is not its ref, so that its spring pulls "
                "from the start; a leg begins at rest, so write both alike or neither."
            )
    for body in range(model.nbody):
        if model.body_jntnum[body] > 1:
            raise ModelError(f"{name}: body {model.body(body).name!r} has several joints; give each a body of its own.")
    base = int(model.joint("base").id)
    for dof in range(model.nv):
        if model.dof_jntid[dof] != base and model.dof_armature[dof]:
            joint = model.joint(model.dof_jntid[dof]).name
            raise ModelError(f"{name}: joint {joint!r} has an armature; give its body that mass instead.")
    return base


def _check_nothing_else(model: mujoco.MjModel, name: str) -> None:
    """Refuse what pushes or holds and is not in the equations."""
    for kind, count in (("tendon", model.ntendon), ("equality", model.neq)):
        if count:
            raise ModelError(f"{name}: {element_name(model, kind, 0)} is not in the equations of a leg.")
    base = int(model.joint("base").id)
    for a in range(model.nactuator):
        if model.actuator_trntype[a] != mujoco.mjtTrn.mjTRN_JOINT or model.actuator_trnid[a, 0] != base:
            raise ModelError(f"{name}: {element_name(model, 'actuator', a)} is not in the equations of a leg.")
    for field in ("jnt_stiffnesspoly", "dof_dampingpoly"):
        values = getattr(model, field)
        if np.any(values):
            number = int(np.flatnonzero(np.any(values.reshape(len(values), -1), axis=1))[0])
            joint = number if field.startswith("jnt") else int(model.dof_jntid[number])
            raise ModelError(f"{name}: joint {model.joint(joint).name!r} has a polynomial law; a leg's are linear.")
    check_free(model, name)


def _law(model: mujoco.MjModel, joint: int, name: str) -> tuple[float, float]:
    """Stiffness and damping of a joint for small motion about rest."""
    user = model.jnt_user[joint] if model.jnt_user.shape[1] else np.zeros(damper.USER_SIZE)
    if model.opt.gravity[1] and not (user[0] == 0 or (user[0] == damper.DAMPER and not user[2:].any())):
        raise ModelError(
            f"{name}: joint {model.joint(joint).name!r} has a law that depends on how far gravity presses it, which "
            'these equations do not follow; write gravity="0 0 0" and the law about the loaded state.'
        )
    try:
        k, c = damper.at_rest(user)
    except ValueError as error:
        raise ModelError(f"{name}: joint {model.joint(joint).name!r} {error}.") from None
    native = float(model.dof_damping[model.jnt_dofadr[joint]])
    native = 0.0 if user[0] == damper.DAMPER else native  # with the damper law, native damping is a share of it
    return float(model.jnt_stiffness[joint]) + k, native + c
