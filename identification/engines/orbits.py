"""A Jacobian from MuJoCo: the nominal simulation and one a column, each a little displaced, in one batch.

Coordinates are measured from rest and exclude the base, whose own position and velocity a foot on it does not feel.

Periodic orbits of the foot on a periodically moving base, with derivatives to the parameters: two engines.

`Twin` integrates Eq. (4.29) with exact sensitivities (two_dof.py); `Rollouts` steps any MJCF in MuJoCo, one short
simulation a column of the Jacobian, all columns in one batch. Both find the initial states by Newton's method on the
gap after one period (shooting), start from the last orbit moved along its derivative, and accept a small gap with a
first-order correction, so that a fit costs about one period of simulation for each evaluation.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.shaker import BaseMotion, harmonics
from fasbody.foot.simulate import Batch, Simulation
from fasbody.foot.two_dof import NAMES, STATES, periodic

#: A displacement [m or rad] and a velocity [m/s or rad/s] typical of a foot, and the share of them that is a nudge:
#: small against the motion, large against rounding.
_POSITION, _VELOCITY, _ACTIVATION, _NUDGE = 1e-3, 0.1, 1.0, 1e-4
_PARAMETER_NUDGE = 1e-6


@dataclass(frozen=True, eq=False)
class Differences:
    """Outputs of one run: y (n,) [m/s^2], final states x (s,), and derivatives to states (s) and parameters (p)."""

    y: np.ndarray
    x: np.ndarray
    y_by_state: np.ndarray
    y_by_parameter: np.ndarray
    x_by_state: np.ndarray
    x_by_parameter: np.ndarray


class Coordinates:
    """States of a foot as the fit sees them: positions from rest, velocities and activations, without the base."""

    def __init__(self, foot: Foot) -> None:
        self.foot, model = foot, foot.model
        self._q, self._v = np.delete(np.arange(model.nq), foot.base), np.delete(np.arange(model.nv), foot.base)
        sizes = [np.full(self._q.size, _POSITION), np.full(self._v.size, _VELOCITY), np.full(model.na, _ACTIVATION)]
        self.scale = np.concatenate(sizes)

    def unpack(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """qpos, qvel, act, each (nsim, ...), of states x (nsim, s), with the base at rest."""
        model, nq, nv = self.foot.model, self._q.size, self._v.size
        qpos, qvel = np.tile(model.qpos0, (x.shape[0], 1)), np.zeros((x.shape[0], model.nv))
        qpos[:, self._q] += x[:, :nq]
        qvel[:, self._v] = x[:, nq : nq + nv]
        return qpos, qvel, x[:, nq + nv :]

    def final(self, out: Simulation) -> np.ndarray:
        """States (nsim, s) at the end of a simulation."""
        rest = self.foot.model.qpos0[self._q]
        return np.hstack([out.qpos[:, -1, self._q] - rest, out.qvel[:, -1, self._v], out.act[:, -1]])


class Columns:
    """Prepared batch for one foot and a set of parameters.

    Args:
        foot: the model. names: parameters whose derivatives are wanted. threads: 0 for all cores.
    """

    def __init__(self, foot: Foot, names: Sequence[str], threads: int = 0) -> None:
        self.foot, self.names, self._coordinates = foot, tuple(names), Coordinates(foot)
        self.scale = self._coordinates.scale
        self.states = self.scale.size
        self._batch = Batch(foot, 1 + self.states + len(self.names), threads)

    def run(self, controls: np.ndarray, step: float, values: Mapping[str, float], x0: np.ndarray) -> Differences:
        """Simulate and difference.

        Args:
            controls: (n, 5) shaker controls. step: [s]. values: all parameters by name; others than the model's are
                ignored. x0: (s,) initial states.
        """
        declared, ns = self.foot.parameters, self.states
        self._batch.set({k: v for k, v in values.items() if k in declared and k not in self.names})
        nudge = np.concatenate([_NUDGE * self.scale, np.empty(len(self.names))])
        for i, name in enumerate(self.names):
            item = declared[name]
            # values like c_12 pass through zero: their nudge follows the declared range instead
            size = abs(values[name]) if item.logarithmic else max(abs(item.lower), abs(item.upper))
            nudge[ns + i] = _PARAMETER_NUDGE * size
            column = np.full(self._batch.nsim, float(values[name]))  # a whole number must take the nudge too
            column[1 + ns + i] += nudge[ns + i]
            self._batch.set({name: column})
        start = np.tile(x0, (self._batch.nsim, 1))
        start[np.arange(1, ns + 1), np.arange(ns)] += nudge[:ns]
        out = self._batch.run(controls[None], step, *self._coordinates.unpack(start))
        final = self._coordinates.final(out)
        Dy, Dx = (out.malleolus[1:] - out.malleolus[0]).T / nudge, (final[1:] - final[0]).T / nudge
        return Differences(out.malleolus[0], final[0], Dy[:, :ns], Dy[:, ns:], Dx[:, :ns], Dx[:, ns:])


#: Longest time step of an orbit [s], and fewest steps a period, to begin with. RK4 then errs by 1e-5 of the peak in
#: the median of fitted feet, but by 2 % where a damper is at its bound under 4.5 kg: resolution.py halves it there.
LONGEST_STEP = 5e-4
FEWEST_STEPS = 48
#: Most passes of Newton's method.
PASSES = 12
#: Relative gap after one period beyond which there is no orbit.
LOST = 1e-2


@dataclass(frozen=True, eq=False)
class Excitation:
    """One period of base motion: frequency [Hz], complex harmonics (H,) [m/s^2], and the masses on it [kg]."""

    frequency_hz: float
    amplitudes: np.ndarray
    masses: Mapping[str, float]
    longest_step: float = LONGEST_STEP  # the model's own, where it asks for a finer one

    @property
    def steps(self) -> int:
        """Steps a period."""
        return max(FEWEST_STEPS, int(np.ceil(1.0 / (self.frequency_hz * self.longest_step) - 1e-6)))

    @property
    def step(self) -> float:
        """Time step [s]."""
        return 1.0 / (self.frequency_hz * self.steps)

    @property
    def motion(self) -> BaseMotion:
        """The base motion over one period."""
        return harmonics(self.frequency_hz, self.amplitudes, 1.0 / self.frequency_hz)


class Engine(Protocol):
    """What finds orbits: one excitation at a time, remembering its last orbit."""

    name: str
    excitations: list[Excitation]

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output over one period (n,) [m/s^2] and its derivatives (n, p) to the named parameters."""

    def forget(self) -> None:
        """Start the next orbits from rest."""


@dataclass
class _Last:
    """Where the last orbit of an excitation started, and how that moves with the parameters."""

    x: np.ndarray
    dx: np.ndarray
    theta: np.ndarray

    def predict(self, theta: np.ndarray) -> np.ndarray:
        if self.theta.size != theta.size:
            return self.x
        return self.x + self.dx @ (theta - self.theta)


class _Memory:
    """What both engines share: the last orbit of each excitation, from which the next one is sought."""

    def __init__(self, excitations: Sequence[Excitation], states: int, what: str) -> None:
        self.excitations, self._states, self._what = list(excitations), states, what
        self.forget()

    def forget(self) -> None:
        """Start the next orbits from rest."""
        self._last: list[_Last | None] = [None] * len(self.excitations)

    def start(self, number: int) -> np.ndarray:
        """States (s,) of the last orbit at time zero."""
        last = self._last[number]
        return np.zeros(self._states) if last is None else last.x

    def _guess(self, number: int, theta: np.ndarray) -> np.ndarray:
        last = self._last[number]
        return np.zeros(self._states) if last is None else last.predict(theta)

    def _keep(self, number: int, x: np.ndarray, dx: np.ndarray, theta: np.ndarray, gap: float) -> None:
        """Remember an orbit, or say that there is none."""
        if not gap < LOST:
            self._last[number] = None
            at = f"{self.excitations[number].frequency_hz:g} Hz"
            raise SimulationError(f"{self._what}: no periodic motion at {at} for {theta}.")
        self._last[number] = _Last(x, dx, theta)


class Twin(_Memory):
    """The compiled two-mass model."""

    name = "twin"

    def __init__(self, excitations: Sequence[Excitation]) -> None:
        super().__init__(excitations, STATES, "the two-mass model")
        self.inputs = [e.motion.half_steps(e.step, e.steps) for e in self.excitations]

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (n,), (n, p)."""
        e = self.excitations[number]
        masses = {**values, **e.masses}
        theta = np.array([values[name] for name in NAMES])
        arguments = (theta, masses["m_S"], masses["m_F"], self.inputs[number], e.step, tolerance, PASSES)
        try:
            Y, DY, x, dx, gap = periodic(self._guess(number, theta), *arguments)
            if not gap < tolerance:  # a bad guess: once more from rest
                Y, DY, x, dx, gap = periodic(np.zeros(STATES), *arguments)
        except np.linalg.LinAlgError:  # neutral: any start is an orbit, or none
            gap, Y, DY, x, dx = np.inf, np.empty(0), np.empty((0, 0)), np.empty(0), np.empty((0, 0))
        self._keep(number, x, dx, theta, gap)
        return Y, DY[:, [NAMES.index(name) for name in names]]


class Rollouts(_Memory):
    """Any MJCF foot in MuJoCo.

    Args:
        foot: the model. excitations: what moves the base. names: the parameters whose derivatives are wanted.
        threads: 0 for all cores.
    """

    name = "mujoco"

    def __init__(self, foot: Foot, excitations: Sequence[Excitation], names: Sequence[str], threads: int = 0) -> None:
        self.columns = Columns(foot, names, threads)
        super().__init__(excitations, self.columns.states, foot.name)
        self._controls = [e.motion.controls(e.step, e.steps) for e in self.excitations]

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (n,), (n, p); `names` are those given at construction."""
        e = self.excitations[number]
        theta = np.array([values[name] for name in self.columns.names])
        x = self._guess(number, theta)
        for _ in range(PASSES):
            d = self.columns.run(self._controls[number], e.step, {**values, **e.masses}, x)
            monodromy = np.eye(x.size) - d.x_by_state
            step = np.linalg.solve(monodromy, d.x - x)
            x = x + step
            gap = np.abs(step).max() / max(1e-12, np.abs(x).max())
            if gap < tolerance:
                break
        dx = np.linalg.solve(monodromy, d.x_by_parameter)
        self._keep(number, x, dx, theta, gap)
        return d.y + d.y_by_state @ step, d.y_by_parameter + d.y_by_state @ dx


@functools.lru_cache(maxsize=8)  # a study asks twice for each of its fits
def twin_applies(foot: Foot) -> bool:
    """Whether the compiled two-mass model is this model: the same accelerations at random states and parameters."""
    from fasbody.foot.engine import callbacks
    from fasbody.foot.two_dof import TwoDof

    model = foot.model
    needed = {*NAMES, "m_S", "m_F"}
    if (
        not needed <= set(foot.parameters)
        or model.nv != 3
        or model.na
        or model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4
    ):
        return False
    joints = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)]
    if not {"talocrural", "fat_pad"} <= set(joints):
        return False
    at = [int(model.joint(name).qposadr[0]) for name in ("talocrural", "fat_pad")]
    rng = np.random.default_rng(0)
    for _ in range(8):
        values = {n: v * rng.uniform(0.5, 1.5) for n, v in foot.values().items() if n in needed}
        trial = foot.with_values(values)
        data = mujoco.MjData(trial.model)
        x, u = np.concatenate([rng.normal(0, 1e-3, 2), rng.normal(0, 0.1, 2)]), rng.normal(0, 9)
        data.qpos[at], data.qvel[at] = x[:2] + model.qpos0[at], x[2:]
        data.ctrl[foot.shaker + 1] = u
        with callbacks():
            mujoco.mj_forward(trial.model, data)
        twin = TwoDof.from_values(values)
        want = np.append(twin.rates(0.0, x, u)[2:], twin.output(x))
        have = np.append(data.qacc[at], data.sensordata[foot.sensor["malleolus"]])
        if np.abs(have - want).max() > 1e-6 * np.abs(want).max():
            return False
    return True


def twin_order(foot: Foot) -> np.ndarray:
    """(4,) where z1, z2, z1', z2' of the twin stand among the model's coordinates without the base; its own inverse."""
    ankle, pad = (int(foot.model.joint(name).qposadr[0]) for name in ("talocrural", "fat_pad"))
    return np.array([0, 1, 2, 3] if ankle < pad else [1, 0, 3, 2])
