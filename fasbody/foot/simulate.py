"""The only stepping code: one foot or many, in parallel, each with its own parameters, time step and base motion."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import ArrayLike

from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot.damper import DAMPER
from fasbody.foot.engine import SHAKER_CONTROLS, callbacks
from fasbody.foot.model import Foot, Sensor
from fasbody.foot.parameters import Fitted
from fasbody.foot.shaker import BaseMotion
from fasbody.presentation import Presented, Sheet

#: Share of a damper that is taken at the end of a step, and of one on a hinge.
SHARE, HINGE_SHARE = 0.5, 0.55
#: Error of the time step, as a share of a signal, above which a simulation is refused.
ACCEPTED = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Presented):
    """Result of one batched rollout of `nsim` simulations and `n` steps.

    Attributes:
        time_s: (nsim, n) start of each step [s].
        base_m_s2: (nsim, n) realised base acceleration.
        malleolus_m_s2: (nsim, n) output of Eq. (4.31). All three as a recording calls them; `time`,
            `base` and `malleolus` are short for them.
        qpos: (nsim, n + 1, nq) positions, relative ones for slides [m].
        qvel: (nsim, n + 1, nv) velocities [m/s].
        act: (nsim, n + 1, na) activations.
        base_error: largest difference between realised and prescribed base acceleration, as a share
            of its peak.
        step_error: by how much the time step falsifies the accelerometer that it falsifies most, as
            a share of its root mean square; from a second run with half the step, NaN without one.
        sensors: name -> (nsim, n) of every accelerometer but the base's, the malleolus among them
            [m/s^2].
    """

    time_s: np.ndarray
    base_m_s2: np.ndarray
    malleolus_m_s2: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray
    base_error: float
    sensors: Mapping[str, np.ndarray] = field(default_factory=dict)
    step_error: float = np.nan

    figures: ClassVar[str] = "fasbody.foot.figures"
    plots: ClassVar[tuple[str, ...]] = ("motion",)

    @property
    def time(self) -> np.ndarray:
        """Short for `time_s`."""
        return self.time_s

    @property
    def base(self) -> np.ndarray:
        """Short for `base_m_s2`."""
        return self.base_m_s2

    @property
    def malleolus(self) -> np.ndarray:
        """Short for `malleolus_m_s2`."""
        return self.malleolus_m_s2

    def __str__(self) -> str:
        nsim, n = self.base.shape
        peak = np.abs(self.malleolus).max()
        return (
            f"{nsim} x {n} steps, malleolus peak {peak:.3g} m/s^2, base error {self.base_error:.1e}, "
            f"step error {self.step_error:.1e}"
        )

    def sheet(self) -> Sheet:
        """Peaks of each simulation."""
        read = {"base": self.base} | self.outputs
        rows = [
            (str(i + 1), f"{t[-1]:.4g}", *(f"{np.abs(values[i]).max():.4g}" for values in read.values()))
            for i, t in enumerate(self.time)
        ]
        columns = ("simulation", "ends at [s]", *(f"{name} peak [m/s²]" for name in read))
        return Sheet(str(self), columns, rows)

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """What each accelerometer but the base's reads (nsim, n) [m/s^2], the malleolus first."""
        return {"malleolus": self.malleolus} | dict(self.sensors)

    def records(self) -> list[dict[str, Any]]:
        """One row a step and simulation."""
        names = ("time_s", "base_m_s2", *(f"{name}_m_s2" for name in self.outputs))
        return [
            {"simulation": i + 1} | dict(zip(names, map(float, row), strict=True))
            for i, rows in enumerate(zip(self.time, self.base, *self.outputs.values(), strict=True))
            for row in zip(*rows, strict=True)
        ]


class Batch:
    """Many simulations of one foot, prepared once and run often: the inner loop of a fit.

    Args:
        foot: the model.
        nsim: number of simulations.
        threads: threads to use, 0 for all cores.
        hinge_share: of the dampers of hinges, see `_Shares`.
    """

    def __init__(self, foot: Foot, nsim: int, threads: int = 0, hinge_share: float = HINGE_SHARE) -> None:
        self.foot = foot
        with callbacks():
            self._batch = mujoco.batch.Batch(foot.model, nsim, threads or os.cpu_count() or 1)
        self._steps = self._batch.expand("opt.timestep")
        fields = foot.parameters.fields
        self._fields = {field: self._batch.expand(field).reshape(nsim, -1) for field in fields}
        #: Equalities with a solref in the direct form (negative numbers) close a loop as stiffly as the step allows.
        self._tied = np.flatnonzero((foot.model.eq_solref < 0).all(axis=1))
        self._solref = self._batch.expand("eq_solref") if self._tied.size else None
        self._shares = _Shares.of(foot, self._batch, hinge_share)
        self._velocities = _velocity_sensors(foot)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._act, self._time = self._batch.bind("act"), self._batch.bind("time")
        self._rest = foot.model.qpos0.copy()
        self.nsim = nsim

    def set(self, values: Mapping[str, np.ndarray | float]) -> None:
        """Set parameters: name -> one value, or (nsim,) one for each simulation."""
        for name, value in values.items():
            self.foot.parameters[name].write(self._fields, value)

    def run(
        self,
        controls: np.ndarray,
        steps: np.ndarray | float,
        qpos: np.ndarray | None = None,
        qvel: np.ndarray | None = None,
        act: np.ndarray | None = None,
    ) -> Simulation:
        """Run all simulations.

        Args:
            controls: (nsim or 1, n, 5) shaker controls of each step (`BaseMotion.controls`).
            steps: time step [s], one or (nsim,).
            qpos: initial positions, (nsim, nq) or (nq,); default the rest position.
            qvel: likewise, default zero.
            act: initial activations, (nsim, na), default zero.

        Raises:
            SimulationError: a simulation became non-finite; the message says which and when.
        """
        n = controls.shape[1]
        extra = int(bool(self._velocities))  # a velocity difference needs the end of the last step
        full = np.zeros((controls.shape[0], n + extra, self.foot.model.nu))
        full[:, :n, self.foot.shaker : self.foot.shaker + SHAKER_CONTROLS] = controls
        full[:, n:] = full[:, n - 1 : n]
        h = np.broadcast_to(np.asarray(steps, float).reshape(-1), (self.nsim,))
        self._steps[...] = h.reshape(-1, *([1] * (self._steps.ndim - 1)))
        if self._solref is not None:
            self._solref[:, self._tied] = np.stack([-0.25 / h**2, -1 / h], axis=1)[:, None]
        for share in self._shares:
            share.write()
        self._batch.warning[...] = 0
        self._qpos[...] = self._rest if qpos is None else qpos
        self._qvel[...] = 0.0 if qvel is None else qvel
        self._act[...] = 0.0 if act is None else act
        self._time[:] = controls[:, 0, 0]
        first = [array[:, None].copy() for array in (self._qpos, self._qvel, self._act)]
        with callbacks():
            out = self._batch.rollout(n + extra, full, record=("qpos", "qvel", "act", "sensordata"))
        after = (np.concatenate([a, out[key][:, :n]], 1) for a, key in zip(first, ("qpos", "qvel", "act"), strict=True))
        qpos_all, qvel_all, act_all = after
        self._check_finite(out["sensordata"], qvel_all)
        read = out["sensordata"]
        base = self.foot.sensors["base"].read(read[:, :n])
        sensors = {
            name: np.diff(self._velocities[name].read(read), axis=1) / h[:, None]
            if name in self._velocities
            else sensor.read(read[:, :n])
            for name, sensor in self.foot.sensors.items()
            if name != "base"
        }
        commanded = controls[..., 1]
        peak = np.abs(commanded).max() or 1.0
        return Simulation(
            time_s=np.broadcast_to(controls[..., 0], base.shape),
            base_m_s2=base,
            malleolus_m_s2=sensors["malleolus"],
            qpos=qpos_all, qvel=qvel_all, act=act_all,
            base_error=float(np.abs(base - commanded).max() / peak),
            sensors=sensors,
        )  # fmt: skip

    def run_checked(
        self,
        motions: Sequence[BaseMotion],
        step: float,
        qpos: np.ndarray | None = None,
        qvel: np.ndarray | None = None,
        accept: float | None = ACCEPTED,
    ) -> Simulation:
        """Run all simulations from rest, and again with half the step, which tells the error of the step.

        Args:
            motions: of the base, one or one a simulation; all of the first one's duration.
            step: time step [s].
            qpos, qvel: as in `run`.
            accept: largest error of the step, `Simulation.step_error`, that is no reason to refuse;
                None for any.

        Raises:
            SimulationError: unstable, or the error is larger.
        """
        count = round(motions[0].duration / step)
        if count < 1:
            raise SettingError(f"a motion of {motions[0].duration:g} s is shorter than one step of {step:g} s.")
        run, finer = (
            self.run(np.stack([motion.controls(h, n) for motion in motions]), h, qpos, qvel)
            for h, n in ((step, count), (step / 2, 2 * count))
        )
        return self.checked(run, finer, step, accept)

    def checked(self, run: Simulation, finer: Simulation, step: float, accept: float | None = ACCEPTED) -> Simulation:
        """A run with the error of its step [s], by one that is as long and has half of it.

        Raises:
            SimulationError: the error is larger than `accept`.
        """
        first_order = self.foot.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4
        errors = {}
        for name, values in run.outputs.items():
            fine = finer.outputs[name][:, ::2]
            off, size = (np.sqrt(np.mean(x**2, axis=1)) for x in (values - fine, fine))
            errors[name] = float(np.max(off / np.maximum(size, np.finfo(float).tiny)))
        worst = max(errors, key=lambda name: errors[name])
        error = errors[worst] * (2 if first_order else 16 / 15)
        if accept is not None and error > accept:
            integrator = mujoco.mjtIntegrator(self.foot.model.opt.integrator).name.removeprefix("mjINT_")
            raise SimulationError(
                f"{self.foot.name}: steps of {step:g} s put sensor {worst!r} off by {100 * error:.2g} % with the "
                f"integrator {integrator}; simulate with step={step * accept / error / 2:.1g}, or "
                f"accept={2 * error:.1g}."
            )
        return replace(run, step_error=error)

    def _check_finite(self, sensordata: np.ndarray, qvel: np.ndarray) -> None:
        bad = ~np.isfinite(sensordata).all(axis=(1, 2)) | ~np.isfinite(qvel).all(axis=(1, 2))
        bad |= np.asarray(self._batch.warning).reshape(self.nsim, -1).any(axis=1)
        if bad.any():
            raise SimulationError(
                f"{self.foot.name}: {bad.sum()} of {self.nsim} simulations became unstable; use a smaller time step "
                "or parameters within the declared bounds."
            )


@dataclass(frozen=True, eq=False)
class _Shares:
    """How much of the dampers of law 4.25 an integrator takes at the end of its step; the callback adds the rest.

    All of it, as the engine alone takes it, acts half a step late. Half of it does not, and is of second order, where
    a damper is not so stiff that it rings: that of a light bone on its hinge.

    Attributes:
        damping: (nsim, ...) of the engine.
        laws: (nsim, n, 8).
        to, at: places (m,) in both.
        share: (m,) of c_1.
    """

    damping: np.ndarray
    laws: np.ndarray
    to: np.ndarray
    at: np.ndarray
    share: np.ndarray

    def write(self) -> None:
        """Follow what the laws are now."""
        self.damping[:, self.to] = self.share * self.laws[:, self.at, 1]

    @classmethod
    def of(cls, foot: Foot, batch: Any, hinge_share: float) -> "list[_Shares]":
        """Of joints and of tendons; none with Runge-Kutta, which takes all of them alike."""
        model = foot.model
        if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            return []
        hinge = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        kinds = (
            ("jnt_user", "dof_damping", model.jnt_dofadr, np.where(hinge, hinge_share, SHARE)),
            ("tendon_user", "tendon_damping", np.arange(model.ntendon), np.full(model.ntendon, SHARE)),
        )
        shares = []
        for user, damping, address, share in kinds:
            laws = getattr(model, user)
            at = np.flatnonzero(laws[:, :1] == DAMPER)
            if at.size:
                of, to = (batch.expand(field).reshape(batch.nsim, -1) for field in (user, damping))
                of = of.reshape(batch.nsim, *laws.shape)
                shares.append(cls(to, of, address[at], at, share[at]))
        return shares


def _velocity_sensors(foot: Foot) -> dict[str, Sensor]:
    """The velocity sensors of integrators whose acceleration sensors are half a step off, by what they stand for.

    Runge-Kutta senses the acceleration at the start of the step. The implicit integrators read the velocity half a step
    early, so there the output is the difference of velocities, of the sensor
    `malleolus_velocity` (framelinvel) and so on.
    """
    model = foot.model
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        return {}
    return {
        name: Sensor(f"{name}_velocity", int(model.sensor(f"{name}_velocity").adr[0]), foot.up)
        for name in foot.sensors
        if name != "base"
    }


def simulate(
    foot: Foot,
    motions: BaseMotion | Sequence[BaseMotion],
    *,
    step: float | None = None,
    values: Mapping[str, ArrayLike] | Fitted | None = None,
    qpos: np.ndarray | None = None,
    qvel: np.ndarray | None = None,
    threads: int = 0,
    accept: float | None = ACCEPTED,
) -> Simulation:
    """Simulate one foot under one or several base motions, or with several parameter sets under one.

    Args:
        foot: the model.
        motions: one motion, or one a simulation; all of the first one's duration.
        step: time step [s], default the model's.
        values: what a fit returns, or parameters by name (`Foot.with_values`), one value or (nsim,)
            of each.
        qpos: initial positions (nq,) or (nsim, nq);
        qvel: initial velocities.
        threads: 0 for all cores.
        accept: largest error of the time step (`Simulation.step_error`) that is no reason to
            refuse; None for any.

    Raises:
        SettingError: an unknown parameter or value, or sizes that do not fit.
        SimulationError: unstable, or the step is too long.
    """
    if not isinstance(foot, Foot):
        raise SettingError(f"simulate takes a model, not {foot!r}; load it first: load({str(foot)!r}).")
    step = step or foot.step
    listed = [motions] if isinstance(motions, BaseMotion) else list(motions)
    parameters = {
        name: np.asarray(value) for name, value in foot.parameters.named({} if values is None else values).items()
    }
    for name, value in parameters.items():
        foot.parameters[name].check(value)
    sizes = {len(listed), *(value.size for value in parameters.values())} - {1}
    if len(sizes) > 1:
        raise SettingError(f"base motions and parameter values must be as many as each other, not {sorted(sizes)}.")
    batch = Batch(foot, sizes.pop() if sizes else 1, threads)
    batch.set(parameters)
    return batch.run_checked(listed, step, qpos, qvel, accept)
