"""Hysteresis loops of ankle and fat pad over one cycle, and the energy that goes through the foot.

The loops are Eq. (4.42) along the periodic motion that the recording's own base drives: force against relative
displacement. Their areas are what ankle and pad dissipate a cycle. What the shaker puts in is computed without any
damper's force, and in a closed cycle the two must be equal: the imbalance is printed with every cycle.

- The two-mass foot: harmonic balance in closed form, many feet at once, springs that relax included. The shaker's force
  is the rate of change of the momentum on the base.
- Any other MJCF foot with a `talocrural` and a `fat_pad` (joint or tendon, or the pads of foot_arch): harmonic balance
  on MuJoCo's inverse dynamics. The force of each part is that of its spring, damper, law and actuators, whichever of
  MuJoCo's or the callbacks'. The shaker's force is that on the table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from fasbody.exceptions import ModelError, SimulationError
from fasbody.foot.damper import algebraic_force, damping
from fasbody.foot.engine import callbacks
from fasbody.foot.model import Foot
from fasbody.foot.parameters import names
from fasbody.foot.steady_state import Balance
from fasbody.foot.two_mass import PARAMETERS, Orbits, parameters, resolved

#: Instants of the cycle of a two-mass foot.
INSTANTS = 128
#: Names of the parts, first choice first; several elements work side by side.
PARTS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "ankle": (("talocrural",),),
    "fat_pad": (("fat_pad",), ("heel_pad", "forefoot_pad")),
}


@dataclass(frozen=True, eq=False)
class Loop:
    """Displacement (n,) [m] (extension positive), force (n,) [N] and dissipated energy [J] of one part in one cycle."""

    displacement_m: np.ndarray
    force_n: np.ndarray
    dissipated_j: float


@dataclass(frozen=True, eq=False)
class Cycle:
    """One closed cycle.

    Attributes:
        ankle: its loop.
        fat_pad: its loop.
        dissipated_j: by the whole model, which may have other dampers.
        shaker_work_j: by the base on the foot.
        malleolus_m_s2: fundamental of its acceleration.
    """

    ankle: Loop
    fat_pad: Loop
    dissipated_j: float
    shaker_work_j: float
    malleolus_m_s2: complex

    @property
    def imbalance(self) -> float:
        """Share of the shaker's work that the dampers do not account for."""
        return (self.shaker_work_j - self.dissipated_j) / self.shaker_work_j


def cycle(
    foot: Foot, frequency_hz: float, base: Sequence[complex] | np.ndarray, values: Mapping[str, float], two_mass: bool
) -> Cycle:  # fmt: skip
    """The cycle of a foot on a periodic base.

    Args:
        foot: the model.
        frequency_hz: fundamental.
        base: (h,) complex harmonics of its acceleration [m/s^2].
        values: parameters and masses by name.
        two_mass: the model is the two-mass foot.

    Raises:
        SimulationError: no periodic motion. ModelError: the model has no ankle or no fat pad by these names.
    """
    A = np.asarray(base, complex)
    if not two_mass:
        return _of_model(foot, frequency_hz, A, values)
    return of_orbits(periodic_motion(foot, frequency_hz, A, values), A[None])[0]


def periodic_motion(foot: Foot, frequency_hz: float, base: np.ndarray, values: Mapping[str, float]) -> Orbits:
    """The motion of the two-mass foot on a base of harmonics (h,) [m/s^2].

    Raises:
        SimulationError: there is none with these values.
    """
    omega = np.array([2 * np.pi * frequency_hz])
    orbits = resolved(parameters(values)[None], omega, base[None])
    if not orbits.converged.all():
        raise SimulationError(f"{foot.name}: no periodic motion at {frequency_hz:g} Hz with these values.")
    return orbits


def of_orbits(orbits: Orbits, base: np.ndarray) -> list[Cycle]:
    """The cycles of B two-mass feet in their periodic motions, on bases (B, h) [m/s^2]."""
    H = orbits.shank.shape[1]
    s = 1j * orbits.omega[:, None] * np.arange(1, H + 1)
    turning = np.exp(2j * np.pi * np.outer(np.arange(1, H + 1), np.arange(INSTANTS)) / INSTANTS)
    period = 2 * np.pi / orbits.omega
    z, rate = ((x @ turning).real for x in (orbits.stretch, s[:, None] * orbits.stretch))
    at = {name: orbits.theta[:, i, None] for i, name in enumerate(PARAMETERS)}
    lag = s * at["tau"]
    forces = []
    for joint, (j, n) in enumerate((("T", 1), ("F", 2))):
        relaxes = (at[f"r_{j}"] * lag / (1 + lag) * orbits.stretch[:, joint]) @ turning
        c = damping(z[:, joint], *(at[f"c_{n}{i}"] for i in (1, 2, 3)))  # Eq. (4.32)
        forces.append(at[f"k_{j}"] * (z[:, joint] + relaxes.real) + c * rate[:, joint])  # Eq. (4.42)
    work = np.mean(np.stack(forces, 1) * rate, axis=2) * period[:, None]
    A = np.zeros((len(period), H), complex)
    A[:, : base.shape[1]] = base
    momentum_rate = ((at["m_S"] * orbits.shank + at["m_F"] * orbits.foot) @ turning).real
    shaker = np.mean(momentum_rate * ((A / s) @ turning).real, axis=1) * period
    cycles = []
    for b, (ankle, pad) in enumerate(zip(*forces, strict=True)):
        loops = Loop(z[b, 0], ankle, float(work[b, 0])), Loop(z[b, 1], pad, float(work[b, 1]))
        cycles.append(Cycle(*loops, float(work[b].sum()), float(shaker[b]), complex(orbits.shank[b, 0])))
    return cycles


def _of_model(foot: Foot, frequency_hz: float, base: np.ndarray, values: Mapping[str, float]) -> Cycle:
    """The cycle of any model; see `cycle`."""
    parts = {part: _elements(foot, part) for part in PARTS}
    declared = {name: value for name, value in values.items() if name in foot.parameters}
    balance = Balance(foot)
    orbit = balance.orbit(frequency_hz, base, declared)
    balance.set(declared)
    motion = orbit.shaken.motion(orbit.series, orbit.solution.x)
    with callbacks():
        x, power = _forces(balance, motion, parts)
    loops = {}
    for part, row in parts.items():
        z, rate, force = np.stack([x[part, i] for i in range(len(row))], axis=1)
        work = np.mean(force * rate, axis=1).sum() / frequency_hz
        loops[part] = Loop(z.mean(axis=0), force.sum(axis=0), float(work))
    reaction = orbit.table_force_n * motion[1, :, balance.base]
    energies = float(np.mean(power) / frequency_hz), float(np.mean(reaction) / frequency_hz)
    return Cycle(loops["ankle"], loops["fat_pad"], *energies, complex(orbit.harmonics()[0]))


def _forces(
    balance: Balance, motion: np.ndarray, parts: Mapping[str, Sequence[tuple[str, int]]]
) -> tuple[dict[tuple[str, int], np.ndarray], np.ndarray]:
    """Displacement, its rate and force (3, N) of each element of each part, and the power (N,) that the foot takes up.

    Args:
        balance: of the model, its values set.
        motion: (3, N, c) positions from rest, velocities and accelerations.
        parts: elements by kind and number.
    """
    model, data = balance.model, mujoco.MjData(balance.model)
    elements = {(part, i): Element(model, *one) for part, row in parts.items() for i, one in enumerate(row)}
    x = {name: np.empty((3, motion.shape[1])) for name in elements}
    power = np.empty(motion.shape[1])
    for k, (position, velocity, acceleration) in enumerate(motion.swapaxes(0, 1)):
        data.qpos[:], data.act[:] = model.qpos0 + position[: model.nv], position[model.nv :]
        data.qvel[:], data.qacc[:] = velocity[: model.nv], acceleration[: model.nv]
        mujoco.mj_inverse(model, data)
        mujoco.mj_fwdActuation(model, data)
        force = data.qfrc_passive + data.qfrc_actuator + data.qfrc_constraint
        power[k] = -np.delete(force * data.qvel, balance.base).sum()
        for name, element in elements.items():
            x[name][:, k] = element.stretched(data)
    return x, power


def _elements(foot: Foot, part: str) -> list[tuple[str, int]]:
    """Kind and number of the joints or tendons that are this part."""
    for elements in PARTS[part]:
        for kind in ("joint", "tendon"):
            declared = names(foot.model, kind)
            if set(elements) <= set(declared):
                return [(kind, declared.index(name)) for name in elements]
    valid = " or ".join(map(" and ".join, PARTS[part]))
    raise ModelError(f"{foot.name}: no joint or tendon is called {valid}, so it has no {part.replace('_', ' ')} loop.")


class Element:
    """A joint or tendon, and what pulls in it: spring, damper, law and actuators.

    Args:
        model: that it is of; what is read of it does not change.
        kind: ``joint`` or ``tendon``.
        number: of the element.
    """

    def __init__(self, model: mujoco.MjModel, kind: str, number: int) -> None:
        i, self._joint = number, kind == "joint"
        if self._joint:
            self._q, self._v = int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])
            self._rest = float(model.qpos_spring[self._q])
            self._slack = self._rest, self._rest
            through, user, of, on, v = mujoco.mjtTrn.mjTRN_JOINT, model.jnt_user, "jnt", "dof", self._v
        else:
            self._q = self._v = v = i
            self._rest, self._slack = float(model.tendon_length0[i]), tuple(model.tendon_lengthspring[i].tolist())
            through, user, of, on = mujoco.mjtTrn.mjTRN_TENDON, model.tendon_user, "tendon", "tendon"
        self._k, self._c = (
            [*np.ravel(getattr(model, field)[j]).tolist(), *getattr(model, f"{field}poly")[j].tolist()]
            for field, j in ((f"{of}_stiffness", i), (f"{on}_damping", v))
        )
        self._law = user[i].copy() if user.shape[1] else None
        acts = (model.actuator_trntype == through) & (model.actuator_trnid[:, 0] == i)
        self._outputs = model.actuator_outadr[acts]  # such as the branch of the aponeurosis, or a pad with a memory
        self._gear = model.actuator_gear[self._outputs, 0].copy()

    def stretched(self, data: mujoco.MjData) -> tuple[float, float, float]:
        """Extension [m], its rate and the pull [N], of forces that are computed, under `callbacks`."""
        lengths, rates = (data.qpos, data.qvel) if self._joint else (data.ten_length, data.ten_velocity)
        length, x_dot = float(lengths[self._q]), float(rates[self._v])
        x, spring = length - self._rest, length - min(max(length, self._slack[0]), self._slack[1])
        pull = spring * _polynomial(self._k, spring) + x_dot * _polynomial(self._c, abs(x_dot))
        if self._law is not None:
            pull -= algebraic_force(self._law, x, x_dot, self._c[0])
        if self._outputs.size:
            pull -= float(data.actuator_force[self._outputs] @ self._gear)
        return x, x_dot, pull


def _polynomial(coefficients: Sequence[float], x: float) -> float:
    """Value of a polynomial, its constant first."""
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * x + coefficient
    return value
