"""Periodic motion of any foot model, by harmonic balance on the engine's own inverse dynamics.

    balance = Balance(foot)
    orbit = balance.orbit(20.0, [8.95], {"k_T": 2e5, "m_S": 5.6})
    orbit.harmonics("malleolus")                                # complex (H,) [m/s^2]
    balance.derivatives(orbit, ["k_T", "m_S"])["malleolus"]     # complex (H, 2)
    balance.orbit(20.0, [8.95], {"k_T": 2.1e5}, start=orbit)    # from nearby: quicker
    orbit.stable, orbit.initial_state()                         # Floquet; to start a rollout from

At instants of a period MuJoCo is given position, velocity and acceleration of a Fourier series, and
returns the unbalanced force (`mj_inverse` less `mj_fwdActuation`) and the rate
of each activation. Newton's method makes the force zero and the rates consistent. All elements of
the MJCF act in the motion: tendons, equalities, dampers with memory. There is no time step and no
error of one. The base follows the prescribed motion exactly.
"""

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np

from fasbody.exceptions import PeriodicMotionError, SettingError, SimulationError, unknown
from fasbody.foot.damper import DAMPER
from fasbody.foot.engine import callbacks
from fasbody.foot.harmonic_balance import MOST_HARMONICS, Fourier, Solution, multipliers, periodic, rest
from fasbody.foot.model import Foot, can_change
from fasbody.foot.model_fields import constraint_name, element_name
from fasbody.foot.parameters import Fitted

Array = np.ndarray
#: Step of the engine [s]: the rate of a DC motor is a difference over it.
STEP = 1e-9
#: Differences in coordinates [m or rad] and rates [m/s or rad/s].
POSITION, RATE = 1e-6, 1e-4
#: In accelerations [m/s^2 or rad/s^2]: forces are linear in them, unless something lifts or slips from some on.
ACCELERATION, WITH_CHANGES = 1.0, 1e-4
#: Shares of a difference that are tried where something can lift or slip, until nothing does within it. A stiff contact
#: that is pressed lightly slips at 1e-4 m/s.
SHARES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4)
#: Shares of a difference over which slopes about rest are compared, by how much they may differ, and by how much less
#: over the smaller ones: a tenth where the force is smooth.
_NEARER, _SAME, _SMOOTH = (1.0, 1e-1, 1e-2), 1e-3, 0.2
#: Places beside the smallest difference at which a force lies on a line but for its rounding, by which it is known, and
#: the rounding of a slope at most over that.
_BESIDE, _ROUNDED = (1.0, 1.01, 1.02), 20.0
#: Time after which what falls has come to rest [s].
_FALL = 2.0
#: Stiffness over mass [1/s^2], or share of the largest, below which nothing holds a part, and what counts as a push.
_LOOSE, _NEARLY_NONE, _PUSHED = 4e-3, 1e-10, 1e-4
#: Difference in a parameter as a share of its size, and in harmonics of the base [m/s^2].
PARAMETER, BASE = 3e-4, 1.0


class Engine:
    """MuJoCo as a function: from position, velocity and acceleration to what does not fit.

    Coordinates are those of the model from rest, then its activations: c = nv + na of them. A row
    holds the c residuals, forces [N or N m] and rates of activation, then the model's sensor data.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self.size, d = model.nv + model.na, self.data
        self._state = d.qpos, d.qvel, d.qacc, d.act
        self._outputs = d.qfrc_inverse, d.qfrc_actuator, d.act_dot, d.sensordata
        *self._ends, self._raw = np.cumsum([part.size for part in self._outputs]).tolist()
        changes = can_change(model)
        self._acceleration = WITH_CHANGES if changes else ACCELERATION
        self._shares = SHARES if changes else SHARES[:1]

    def rows(self, motion: Array) -> Array:
        """Rows (N, r) at N instants of a motion (3, N, c)."""
        raw = np.empty((motion.shape[1], self._raw))
        for state, row in zip(self._states(motion), raw, strict=True):
            self._read(state, row)
        rows = self._reduced(raw)
        rows[:, self.model.nv : self.size] += motion[1, :, self.model.nv :]
        return rows

    def slopes(self, motion: Array, share: float = 1.0) -> Array:
        """Derivatives (3, N, r, c) of rows to coordinates, rates and accelerations, over a share of the differences."""
        nv, c = self.model.nv, self.size
        raw = np.zeros((3, c, motion.shape[1], self._raw))
        for i, state in enumerate(self._states(motion)):
            self._differences(state, raw[:, :, i], share)
        slopes = np.moveaxis(self._reduced(raw), 1, -1)
        slopes[1, :, nv:c, nv:] = np.eye(c - nv)
        return slopes

    def constraints(self, motion: Array) -> list[bytes]:
        """Which constraints act at each instant, and on which side."""
        row, out = np.empty(self._raw), []
        for state in self._states(motion):
            self._read(state, row)
            out.append(self.data.efc_state.tobytes())
        return out

    def kinks(self, motion: Array) -> list[str]:
        """What touches, stops or slips as soon as one instant (3, 1, c) changes at all, by kind and name."""
        nv, differences = self.model.nv, (POSITION, RATE, self._acceleration)
        beside = np.zeros((3, 3, nv, self.size))
        for order, size in enumerate(differences):
            beside[order, order, :, :nv] = SHARES[-1] * size * np.eye(nv)
        beside = beside.reshape(3, 3 * nv, self.size)
        still, *moved = self._acting(np.concatenate([motion, motion + beside, motion - beside], axis=1))
        return sorted({name for acting in moved for name, _ in acting.items() ^ still.items()})

    def corners(self, motion: Array) -> list[str]:
        """Joints about which the force has no slope at one instant (3, 1, c): one on each side, or ever more."""
        nv, shares = self.model.nv, np.array([*_NEARER[:-1], *(_NEARER[-1] * x for x in _BESIDE)])
        steps = np.multiply.outer(np.multiply.outer([POSITION, RATE], shares), [1.0, -1.0])
        beside = np.zeros((3, *steps.shape, nv, self.size))
        for order in range(2):
            beside[order, order, ..., :nv] = steps[order, ..., None, None] * np.eye(nv)
        near = motion + beside.reshape(3, -1, self.size)
        forces = self.rows(near)[:, :nv].reshape(*steps.shape, nv, nv)
        last = len(_NEARER) - 1
        rounding = np.abs(np.diff(forces[:, last:], n=2, axis=1)).max((1, 2, 3)) / steps[:, last, :1]
        slopes = ((forces - self.rows(motion)[0, :nv]) / steps[..., None, None])[:, : last + 1]
        coarse, fine = (np.ptp(part, axis=(1, 2)) for part in (slopes[:, :2], slopes[:, 1:]))
        size = np.abs(slopes).max((1, 2)).max(-1, keepdims=True)
        least = np.maximum(_SAME * size, _ROUNDED * rounding[:, None])
        apart = ((fine > least) & (fine > _SMOOTH * coarse)).any(2)
        (still,) = self.constraints(motion)  # what touches within a step is a kink elsewhere
        apart &= np.reshape([acting == still for acting in self.constraints(near)], (*steps.shape, nv)).all((1, 2))
        joints = self.model.dof_jntid[np.flatnonzero(apart.any(0))]
        return [element_name(self.model, "joint", int(joint)) for joint in dict.fromkeys(joints.tolist())]

    def _acting(self, motion: Array) -> Iterator[dict[str, tuple[int, ...]]]:
        """The constraints that push or hold at each instant, by kind and name, and on which side each of their rows."""
        row, idle = np.empty(self._raw), mujoco.mjtConstraintState.mjCNSTRSTATE_SATISFIED
        for state in self._states(motion):
            self._read(state, row)
            acting: dict[str, tuple[int, ...]] = {}
            for i in np.flatnonzero(self.data.efc_state != idle).tolist():
                name = constraint_name(self.data, i)
                acting[name] = (*acting.get(name, ()), int(self.data.efc_state[i]))
            yield acting

    def _states(self, motion: Array) -> Iterator[tuple[Array, ...]]:
        """qpos, qvel, qacc and act of each instant."""
        nv, (position, velocity, acceleration) = self.model.nv, motion
        qpos = self.model.qpos0 + position[:, :nv]
        return zip(qpos, velocity[:, :nv], acceleration[:, :nv], position[:, nv:], strict=True)

    def _reduced(self, raw: Array) -> Array:
        """Rows of what the engine gives (..., raw)."""
        inverse, actuator, rate, sensors = np.split(raw, self._ends, axis=-1)
        return np.concatenate([inverse - actuator, -rate, sensors], axis=-1)

    def _read(self, state: Sequence[Array], row: Array) -> None:
        for values, source in zip(self._state, state, strict=True):
            values[:] = source
        self._compute(0, row)

    def _compute(self, done: int, row: Array) -> None:
        """What the engine gives for the state in `data`, its stages up to `done` being computed."""
        m, d = self.model, self.data
        mujoco.mj_inverseSkip(m, d, done, 1)
        mujoco.mj_fwdActuation(m, d)
        mujoco.mj_rnePostConstraint(m, d)
        mujoco.mj_sensorAcc(m, d)
        np.concatenate(self._outputs, out=row)

    def exact_slopes(self, motion: Array) -> Array:
        """`slopes` without the error of second order, which a stiff equality that bends makes large."""
        return (4 * self.slopes(motion, 0.5) - self.slopes(motion)) / 3

    def _differences(self, state: Sequence[Array], out: Array, share: float) -> None:
        """Differences about one state into out (3, c, raw), costly stages as seldom as can be.

        Forces are linear in accelerations and activations, whose differences are one-sided.
        """
        (qpos, qvel, qacc, act), nv = self._state, self.model.nv
        centre = np.empty(self._raw)
        self._read(state, centre)
        self._central(qpos, share * POSITION, 0, out[0, :nv])
        self._read(state, centre)
        self._linear(act, 1.0, centre, out[0, nv:])
        self._linear(qacc, self._acceleration, centre, out[2, :nv])
        self._central(qvel, share * RATE, 1, out[1, :nv])

    def _linear(self, values: Array, size: float, centre: Array, out: Array) -> None:
        state = self.data.efc_state.tobytes()
        for j, row in enumerate(out):
            for share in self._shares:
                if self._beside(values, j, share * size, 2, row) == state:
                    break
            row -= centre
            row /= share * size

    def _central(self, values: Array, size: float, done: int, out: Array) -> None:
        state, other = self.data.efc_state.tobytes(), np.empty(self._raw)
        for j, row in enumerate(out):
            for share in self._shares:
                ends = ((share * size, row), (-share * size, other))
                if {self._beside(values, j, by, done, end) for by, end in ends} == {state}:
                    break
            row -= other
            row /= 2 * share * size

    def _beside(self, values: Array, j: int, by: float, done: int, row: Array) -> bytes:
        """What the engine gives beside the state, and which constraints act there."""
        value = values[j]
        values[j] = value + by
        self._compute(done, row)
        values[j] = value
        return self.data.efc_state.tobytes()


@dataclass(frozen=True, eq=False)
class Shaken:
    """A foot with its parameters on a base with its motion: the system that is balanced.

    Attributes:
        balance: of the model.
        frequency_hz: fundamental.
        base: (h,) complex harmonics A_k of its acceleration [m/s^2], Re sum A_k exp(i k w t).
        values: parameters that differ from the model's, by name.
    """

    balance: "Balance"
    frequency_hz: float
    base: Array
    values: Mapping[str, float]

    @property
    def name(self) -> str:
        """Of the model."""
        return self.balance.foot.name

    @property
    def metric(self) -> Array:
        """Mass matrix at rest (n, n)."""
        return self.balance.metric

    @cached_property
    def rest(self) -> Array:
        """See `Balance.rest`; the file's pose where the foot stands in none.

        Raises:
            SimulationError: it falls.
            PeriodicMotionError: a part of it rests anywhere.
        """
        x = self.balance.rest(self.values)
        if x is None and (loose := self.balance.loose(self.values)):
            anywhere = PeriodicMotionError(self.name, self.frequency_hz, 0.0, loose.text)
            raise SimulationError(loose.text) if loose.falls else anywhere
        return np.zeros(len(self.metric)) if x is None else x

    @property
    def _scale(self) -> Array:
        return (2 * np.pi * self.frequency_hz) ** np.arange(3)

    def motion(self, series: Fourier, x: Array, share: float = 1.0) -> Array:
        """Position, velocity and acceleration (3, N, c) of coefficients under a share of base."""
        whole = np.insert(x, self.balance.base, 0.0, axis=0)
        k = np.arange(1, self.base.size + 1)
        whole[self.balance.base] = series.real(-share * self.base / (k * self._scale[1]) ** 2)
        return (series.at(whole) * self._scale[:, None, None]).swapaxes(1, 2)

    def rows(self, series: Fourier, x: Array, share: float = 1.0) -> Array:
        """Rows (N, r) of the engine."""
        self.balance.set(self.values)
        return self.balance.engine.rows(self.motion(series, x, share))

    def slopes(self, series: Fourier, x: Array, share: float = 1.0) -> Array:
        """Derivatives (3, N, r - 1, n) of rows, `Engine.slopes`, but for those of the base."""
        self.balance.set(self.values)
        rows = self.balance.engine.slopes(self.motion(series, x, share))
        return np.delete(np.delete(rows, self.balance.base, 2), self.balance.base, 3)

    def residual(self, series: Fourier, x: Array, share: float) -> Array:
        """See `harmonic_balance.System`."""
        return series.project(self.rows(series, x, share)[:, self.balance.free].T)

    def jacobian(self, series: Fourier, x: Array, share: float) -> Array:
        """See `harmonic_balance.System`."""
        return self.assembled(series, self.slopes(series, x, share)[:, :, : len(x)])

    def assembled(self, series: Fourier, slopes: Array) -> Array:
        """Derivative (m L, n L) of projected rows from slopes (3, N, m, n), L = 2 H + 1."""
        blocks = series.tangent(np.moveaxis(slopes, 1, -1) * self._scale[:, None, None, None])
        m, n, L, _ = blocks.shape
        return blocks.swapaxes(1, 2).reshape(m * L, n * L)

    def changes(self, series: Fourier, x: Array) -> int:
        """See `harmonic_balance.System`."""
        self.balance.set(self.values)
        states = self.balance.engine.constraints(self.motion(series, x))
        return sum(one != other for one, other in zip(states, states[-1:] + states, strict=False))


@dataclass(frozen=True, eq=False)
class Orbit:
    """Periodic motion of a foot on a shaken base.

    Attributes:
        shaken: what moves.
        solution: coefficients of the coordinates from rest and activations, without the base.
        rows: (N, r) of the engine at instants of the period.
    """

    shaken: Shaken
    solution: Solution
    rows: Array

    @property
    def series(self) -> Fourier:
        """Its harmonics H and instants N."""
        return self.solution.series

    def harmonics(self, sensor: str = "malleolus") -> Array:
        """Complex harmonics (H,) of an accelerometer [m/s^2], the fundamental first."""
        readings = self.rows @ self.shaken.balance.reading(sensor)
        return self.series.complex(self.series.project(readings))

    def initial_state(self) -> tuple[Array, Array, Array]:
        """qpos (nq,), qvel (nv,) and act (na,) at time zero, the base's among them."""
        model = self.shaken.balance.model
        position, velocity, _ = self.shaken.motion(self.series, self.solution.x)[:, 0]
        return model.qpos0 + position[: model.nv], velocity[: model.nv], position[model.nv :]

    @property
    def table_force_n(self) -> Array:
        """Force of the table on what stands on it at the instants (N,), without its mean [N]."""
        balance = self.shaken.balance
        base = balance.base
        acceleration = self.shaken.motion(self.series, self.solution.x)[2, :, base]
        force = self.rows[:, base] - balance.table_kg * acceleration
        return force - force.mean()

    @cached_property
    def slopes(self) -> Array:
        """Derivatives of rows at the orbit, see `Shaken.slopes`."""
        with callbacks():
            return self.shaken.slopes(self.series, self.solution.x)

    @cached_property
    def inverse(self) -> Array:
        """Inverse (m, m) of the Jacobian at the orbit.

        Raises:
            PeriodicMotionError: the motion is not unique.
        """
        residuals = self.slopes[:, :, : len(self.solution.x)]
        try:
            return np.asarray(np.linalg.inv(self.shaken.assembled(self.series, residuals)))
        except np.linalg.LinAlgError:
            name, f = self.shaken.name, self.shaken.frequency_hz
            text = f"{name}: the motion at {f:g} Hz is not unique, as no spring or damper acts on a part of the model."
            raise PeriodicMotionError(name, f, 1.0, text) from None

    @property
    def start(self) -> Solution:
        """From where a motion nearby is searched, with the Jacobian here if derivatives were taken."""
        taken = "slopes" in vars(self)
        return replace(self.solution, inverse=self.inverse) if taken else self.solution

    @cached_property
    def multipliers(self) -> Array:
        """Floquet multipliers, the largest first: how small departures grow over a period."""
        residuals = self.slopes[:, :, : len(self.solution.x)]
        return multipliers(residuals, 1 / self.shaken.frequency_hz, self.shaken.balance.model.na)

    @property
    def stable(self) -> bool:
        """Whether every small departure decays."""
        return bool(np.abs(self.multipliers[0]) < 1)


class Loose(NamedTuple):
    """Why a foot stands nowhere: a sentence, and whether weight moves what is loose, which else stays where it is."""

    text: str
    falls: bool


#: Systems on either side of another, and how far apart their difference is.
Pair = tuple[Shaken, Shaken, float]


class Balance:
    """Periodic motions of one foot, whose parameters change often.

    One thread at a time: it holds one state of the engine. Threads take one each.

    Args:
        foot: the model.
        sensors: accelerometers whose derivatives are wanted.

    Raises:
        SettingError: a sensor that the model does not have.
    """

    def __init__(self, foot: Foot, sensors: Sequence[str] = ("malleolus",)) -> None:
        self.foot, self.sensors, self.base = foot, tuple(sensors), foot.base
        self.model = model = copy.copy(foot.model)
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_EULER, STEP
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        self.engine = Engine(model)
        self.free = np.delete(np.arange(self.engine.size), self.base)
        #: Mass of the table, which the shaker moves [kg].
        table = model.body_mass[model.dof_bodyid[self.base]]
        self.table_kg = float(model.dof_armature[self.base] + table)
        for name in sensors:
            self.reading(name)
        fields = foot.parameters.fields
        self._fields = {field: getattr(model, field).reshape(-1) for field in fields}
        self._nominal = {field: values.copy() for field, values in self._fields.items()}
        self._current: Mapping[str, float] | None = None
        self._rest_before: Array | None = None  # with the parameters of the foot

    @cached_property
    def metric(self) -> Array:
        """Mass matrix at rest (n, n), zero where activations are."""
        nv, data = self.model.nv, mujoco.MjData(self.model)
        mass = np.zeros((nv, nv))
        mujoco.mj_fwdPosition(self.model, data)
        mujoco.mj_fullM(self.model, data, mass)
        return np.pad(mass, (0, self.model.na))[np.ix_(self.free, self.free)]

    def rest(self, values: Mapping[str, float]) -> Array | None:
        """Coordinates from the file's pose, and activations, (n,) without the base's, at which a foot stands still.

        Args:
            values: parameters that differ from the model's, by name.

        Returns:
            None where nothing carries it.
        """
        if not values and self._rest_before is not None:
            return self._rest_before
        still = Shaken(self, 1.0, np.zeros(1), values)
        with callbacks():
            x, stands = rest(still, np.zeros(len(self.metric)))
            if not stands:  # a contact that is open has no slope: what falls comes to it
                x, stands = rest(still, self._fallen(values))
        if stands and not values:
            self._rest_before = x
        return x if stands else None

    def carried(self, values: Mapping[str, float]) -> Array | None:
        """See `rest`.

        Raises:
            SimulationError: nothing carries the foot.
        """
        x = self.rest(values)
        if x is None and (loose := self.loose(values)) and loose.falls:
            raise SimulationError(loose.text)
        return x

    def state(self, x: Array | None) -> tuple[Array, Array]:
        """qpos (nq,) and act (na,) of what `rest` returns, the base at zero; of the file's pose for None."""
        whole = np.zeros(self.engine.size) if x is None else np.insert(x, self.base, 0.0)
        return self.model.qpos0 + whole[: self.model.nv], whole[self.model.nv :]

    def loose(self, values: Mapping[str, float]) -> Loose | None:
        """What keeps a foot that stands nowhere from it; None where every part has a stiffness.

        Weight counts also where the model, about its static pose, has none.
        """
        x, motion = self._fallen(values), np.zeros((3, 1, self.engine.size))
        motion[0, 0, self.free] = x
        with callbacks():
            force, stiffness = self.engine.rows(motion)[0], self.engine.slopes(motion)[0, 0]
        lifted = np.zeros((3, self.model.nv))
        mujoco.mj_jacSubtreeCom(self.model, self.engine.data, lifted, 0)
        weight = np.pad(self.model.body_subtreemass[0] * np.array(self.foot.up) @ lifted, (0, self.model.na))
        inertia = np.diag(self.metric)
        scale = np.where(inertia > 0, inertia, 1.0) ** -0.5
        _, sizes, ways = np.linalg.svd(scale[:, None] * stiffness[np.ix_(self.free, self.free)] * scale)
        free = ways[sizes < max(_LOOSE, _NEARLY_NONE * sizes[0])]
        if not free.size:
            return None
        pushes = np.array([scale * force[self.free], scale * weight[self.free], x / scale])
        *pushed, moved = np.abs(pushes @ free.T @ free)
        falls = np.max(pushed, axis=0)
        if can_change(self.model):  # what a contact carries does not go far
            falls = np.where(moved > falls * _FALL**2 / 4, falls, 0.0)
        fallen = bool((falls > _PUSHED).any())
        parts = np.flatnonzero(falls > _PUSHED if fallen else (free**2).sum(axis=0) > _PUSHED)
        names = " and ".join(dict.fromkeys(self.part(int(i)) for i in self.free[parts]))
        text = f"nothing carries {names}: no spring holds it against weight; give it a stiffness."
        if not fallen:
            text = f"nothing brings {names} back to one place of rest; give it a stiffness, or step it in time."
        return Loose(f"{self.foot.name}: {text}", fallen)

    def part(self, coordinate: int) -> str:
        """The joint or actuator of a coordinate, by kind and name."""
        model, i = self.model, coordinate - self.model.nv
        if i < 0:
            return element_name(model, "dof", coordinate)
        first, count = model.actuator_actadr, model.actuator_actnum
        return element_name(model, "actuator", int(np.flatnonzero((first <= i) & (i < first + count))[0]))

    def _fallen(self, values: Mapping[str, float]) -> Array:
        """Where `rest` may be: after `_FALL` in the time domain."""
        self.set(values)
        model = copy.copy(self.model)
        model.opt.integrator, model.opt.timestep = self.foot.model.opt.integrator, self.foot.model.opt.timestep
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=round(_FALL / model.opt.timestep))
        return np.concatenate([data.qpos - model.qpos0, data.act])[self.free]

    def reading(self, sensor: str) -> Array:
        """Weights (r,) by which rows of the engine give an accelerometer, but for gravity."""
        known = self.foot.sensors
        if sensor not in known:
            message = unknown("accelerometer", sensor, known)
            raise SettingError(f"{message} in model {self.foot.name}.")
        item = known[sensor]
        weights = np.zeros(self.engine.size + self.model.nsensordata)
        weights[self.engine.size + item.first :][:3] = item.axis
        return weights

    def set(self, values: Mapping[str, float]) -> None:
        """Write parameters by name into the engine's model; all others are the foot's."""
        if values is self._current:
            return
        for field, nominal in self._nominal.items():
            self._fields[field][:] = nominal
        for name, value in values.items():
            self.foot.parameters[name].write(self._fields, value)
        mujoco.mj_setConst(self.model, self.engine.data)
        self._current = values

    def orbit(
        self,
        frequency_hz: float,
        base_harmonics: Sequence[complex] | Array,
        values: Mapping[str, float] | Fitted | None = None,
        start: Orbit | None = None,
    ) -> Orbit:
        """The periodic motion under a periodic base.

        Args:
            frequency_hz: fundamental.
            base_harmonics: (h,) complex amplitudes A_k of the base's acceleration [m/s^2], which is
                Re sum A_k exp(i k w t); the fundamental first.
            values: parameters by name, masses among them, as of `Foot.with_values`; all others are
                the foot's.
            start: a motion nearby, from which the search begins.

        Raises:
            SettingError: an unknown parameter or value, or an invalid base.
            PeriodicMotionError: there is no such motion.
            NotSmoothError: a contact, a stop or dry friction acts in it.
            SimulationError: nothing carries the foot, or a damper is negative about its mean pose.
        """
        base = np.atleast_1d(np.asarray(base_harmonics, complex))
        _check(frequency_hz, base)
        named = self.foot.parameters.named({} if values is None else values)
        for name, value in named.items():
            self.foot.parameters[name].check(value)
        shaken = Shaken(self, float(frequency_hz), base, named)
        with callbacks():
            solution = periodic(shaken, start.start if start else None, base.size)
            orbit = Orbit(shaken, solution, shaken.rows(solution.series, solution.x))
        moved = shaken.motion(solution.series, solution.x)[0, :, : self.model.nv].mean(0)
        check_dampers(self.foot, (self.model.qpos0 + moved)[None], self.model.jnt_user[None])
        return orbit

    def derivatives(self, orbit: Orbit, names: Sequence[str]) -> dict[str, Array]:
        """Derivatives of the sensors' harmonics to parameters: sensor -> complex (H, p).

        Args:
            orbit: where.
            names: of the parameters.
        """
        shaken, pairs = orbit.shaken, []
        for item in (self.foot.parameters[name] for name in names):
            value = shaken.values.get(item.name, item.read(self.foot.model))
            most = abs(value) if item.logarithmic else max(abs(item.lower), abs(item.upper))
            size = PARAMETER * most
            ends = ({**shaken.values, item.name: value + sign * size} for sign in (1, -1))
            one, other = (replace(shaken, values=values) for values in ends)
            pairs.append((one, other, 2 * size))
        return self._follow(orbit, pairs)

    def base_derivatives(self, orbit: Orbit) -> dict[str, Array]:
        """Derivatives to the base's harmonics, real parts first: sensor -> complex (H, 2 h)."""
        shaken, pairs, unit = orbit.shaken, [], BASE * np.eye(orbit.shaken.base.size)
        for nudge in (*unit, *(1j * unit)):
            one, other = (replace(shaken, base=shaken.base + sign * nudge) for sign in (1, -1))
            pairs.append((one, other, 2 * BASE))
        return self._follow(orbit, pairs)

    def _follow(self, orbit: Orbit, pairs: Sequence[Pair]) -> dict[str, Array]:
        """How readings change with the system; the motion follows (implicit function theorem).

        Args:
            orbit: the motion.
            pairs: systems on either side of it, and how far both are apart.
        """
        series, x, slopes = orbit.series, orbit.solution.x, orbit.slopes
        with callbacks():
            changes = [(a.rows(series, x) - b.rows(series, x)) / apart for a, b, apart in pairs]
        change = series.project(np.moveaxis(np.array(changes), 1, -1))  # (p, r, 2 H + 1), the motion held
        moved = -orbit.inverse @ change[:, self.free].reshape(len(pairs), -1).T
        out = {}
        for name in self.sensors:
            weights = self.reading(name)
            read = np.einsum("dtij,i->dtj", slopes, np.delete(weights, self.base))
            follows = orbit.shaken.assembled(series, read[:, :, None]) @ moved
            out[name] = series.complex(weights @ change + follows.T).T
        return out


def _check(frequency_hz: float, base: Array) -> None:
    """Refuse a motion of the base that is invalid or cannot be balanced."""
    if not (np.isfinite(frequency_hz) and frequency_hz > 0):
        raise SettingError(f"a periodic motion needs a frequency above 0 Hz, not {frequency_hz}.")
    if not (np.isfinite(base).all() and base.any()):
        amplitudes = ", ".join(f"{amplitude:g}" for amplitude in base)
        raise SettingError(f"harmonics of the base are {amplitudes}; give finite m/s^2, one not zero.")
    if base.size > MOST_HARMONICS:
        raise SettingError(f"a base of {base.size} harmonics has more than {MOST_HARMONICS}.")


def check_dampers(foot: Foot, qpos: Array, laws: Array) -> None:
    """Refuse poses about which a damper of the law 4.25 drives what it damps: its cosine is below zero there.

    Args:
        foot: the model.
        qpos: (n, nq) of rest, or about which motions go on.
        laws: (n or 1, njnt, 8) of the joints.

    Raises:
        SimulationError: by the joint's name.
    """
    model = foot.model
    for j in np.flatnonzero(model.jnt_user[:, :1] == DAMPER):
        q = model.jnt_qposadr[j]
        stretch, c_3 = np.broadcast_arrays(np.abs(qpos[:, q] - model.qpos_spring[q]), laws[:, j, 3])
        worst = int(np.argmax(c_3 * stretch))
        if c_3[worst] * stretch[worst] > np.pi / 2:
            raise SimulationError(
                f"{foot.name}: joint {model.joint(j).name!r} stands {1e3 * stretch[worst]:.3g} mm from its spring's "
                f"rest, where its damper is negative: c_3 = {c_3[worst]:g} of its law 4.25 allows "
                f"{500 * np.pi / c_3[worst]:.3g} mm. Lower c_3, or what pulls the foot."
            )
