"""The only stepping code: one foot or many, in parallel, each with its own parameters, time step and base motion."""

import functools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import ArrayLike

from fasbody.exceptions import SettingError, SimulationError, UnstableError
from fasbody.foot.accelerometers import Sensor
from fasbody.foot.damper import DAMPER
from fasbody.foot.engine import SHAKER_CONTROLS, callbacks
from fasbody.foot.model import Foot, can_change, held_to_world
from fasbody.foot.parameters import Fitted
from fasbody.foot.rest import slopes_at_rest
from fasbody.foot.shaker import BaseMotion
from fasbody.foot.steady_state import Balance, check_dampers
from fasbody.presentation import Presented, Sheet

#: Share of a damper that is taken at the end of a step, and of one on a hinge.
SHARE, HINGE_SHARE = 0.5, 0.55
#: Stiffness [1/s^2] from which on an equality of tendons closes a loop.
CLOSING = 1e6
#: Error of the time step, as a share of a signal, above which the step is halved; how often; and
#: steps of all simulations together that fit into memory.
ACCEPTED, HALVINGS, MOST_STEPS = 1e-3, 10, 2**20
#: Error of the samples that are kept above which they are refused: peaks of impacts between them are lost.
FOLDED = 1e-2
_EXPLICIT = (mujoco.mjtIntegrator.mjINT_RK4, mujoco.mjtIntegrator.mjINT_EULER)
#: What the engine derives from masses when it reads a file, and constraints and muscles are scaled by.
_DERIVED = (
    "dof_invweight0", "body_invweight0", "tendon_invweight0", "actuator_acc0", "dof_M0", "body_subtreemass",
)  # fmt: skip
#: Signal [m/s^2] below which an error is a share of this: a hundred-thousandth of g, less than sensors resolve.
_NOTHING = 1e-4
#: Error above which no order of the step can be read from it.
READABLE = 0.1
#: Pieces of a run, of which the worst gives the error: that of stick and slip differs from one period to the next.
PIECES = 4
#: Steps in which most of what is unstable shows.
PROBE = 500


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
            a share of its root mean square; from runs with half and a quarter of the step, NaN without them.
            Of a foot that can touch, stop or slip: at the frequencies at which the base moves, in the
            worst quarter of the run.
        sample_error: the same of the samples as they are. How high the peak of an impact is hangs
            on its instant, and the motion hardly does.
        step_s: the time step that was computed with [s], the samples' own or a half, a quarter ... of
            it; NaN where none was looked for.
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
    step_s: float = np.nan
    sample_error: float = np.nan

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
            + ("" if np.isnan(self.step_s) else f" at {self.step_s:.3g} s")
            + (f", {self.sample_error:.1e} with impacts" if self.sample_error > self.step_error else "")
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

    def every(self, stride: int, **changes: float) -> "Simulation":
        """One of `stride` steps, with other fields changed."""
        if stride == 1:
            return replace(self, **changes)  # type: ignore[arg-type]
        arrays = {name: value[:, ::stride] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        sensors = {name: values[:, ::stride] for name, values in self.sensors.items()}
        return replace(self, **arrays, sensors=sensors, **changes)  # type: ignore[arg-type]

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
        #: Stiffly tied tendons close a loop: as the file says, or as stiffly as the step allows.
        stiff = foot.model.eq_solref[:, 0] <= -CLOSING
        self._tied = np.flatnonzero((foot.model.eq_type == mujoco.mjtEq.mjEQ_TENDON) & stiff)
        self._solref = self._batch.expand("eq_solref") if self._tied.size else None
        self._shares = _Shares.of(foot, self._batch, hinge_share)
        self._velocities = _velocity_sensors(foot)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._act, self._time = self._batch.bind("act"), self._batch.bind("time")
        self._rest = foot.model.qpos0.copy()
        self._values: dict[str, np.ndarray | float] = {}
        self._derived = {field: self._batch.expand(field).reshape(nsim, -1) for field in _DERIVED}
        self._current = True  # what the engine derives belongs to the values that were set
        self.nsim = nsim

    def set(self, values: Mapping[str, np.ndarray | float]) -> None:
        """Set parameters: name -> one value, or (nsim,) one for each simulation."""
        for name, value in values.items():
            self.foot.parameters[name].write(self._fields, value)
            self._values[name] = value
            self._current = False

    @functools.cached_property
    def _balance(self) -> Balance:
        return Balance(self.foot)

    def _rows(self) -> list[tuple[float, ...]]:
        """The parameters of each simulation that were set, in the order of `_values`."""
        columns = [np.broadcast_to(value, (self.nsim,)).tolist() for value in self._values.values()]
        return [tuple(column[i] for column in columns) for i in range(self.nsim)]

    def _derive(self) -> None:
        """What the engine derives from the masses of each simulation."""
        last: tuple[float, ...] | None = None
        for i, row in enumerate(self._rows()):
            if row != last:
                self._balance.set(dict(zip(self._values, row, strict=True)))
            last = row
            for name, derived in self._derived.items():
                derived[i] = getattr(self._balance.model, name).reshape(-1)
        self._current = True

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
            qpos: initial positions, (nsim, nq) or (nq,); default the pose of the file.
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
            self._solref[:, self._tied] = self._closing(h)
        for share in self._shares:
            share.write()
        if not self._current:
            self._derive()
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
        """Run all simulations, from where the feet stand, with a step so short that half of it changes little.

        Args:
            motions: of the base, one or one a simulation; all of the first one's duration.
            step: time step of the result, and the first one that is tried [s].
            qpos, qvel: as in `run`; the base begins where its motion does not drift, in addition.
            accept: error of the step, `Simulation.step_error`, above which it is halved; None for
                any, so that it is not. A foot that can touch, stop or slip is halved by the error of the
                motion; its samples miss peaks of impacts, so theirs may be larger, up to `FOLDED`.

        Raises:
            SimulationError: unstable, or the error is larger after `HALVINGS`, or above `FOLDED` in what is kept.
        """
        count = round(motions[0].duration / step)
        if count < 1:
            raise SettingError(f"a motion of {motions[0].duration:g} s is shorter than one step of {step:g} s.")

        stands = functools.cache(self.standing)

        @functools.cache
        def tried(halved: int, most: float = np.inf) -> Simulation:
            h, n = step / 2**halved, int(min(count * 2**halved, most))
            q, act = stands(h if self._tied.size else step) if qpos is None else (qpos, None)
            state = *self.initial_state(motions, q, qvel), act
            return self.run(np.stack([motion.controls(h, n) for motion in motions]), h, *state)

        laws = self.foot.model.jnt_user[None]
        laws = np.reshape(self._fields.get("jnt_user", laws), (-1, *laws.shape[1:])) if laws.size else laws
        room = np.log2(MOST_STEPS / (2 * count * self.nsim))
        most = 0 if accept is None else int(np.clip(room, 0, HALVINGS))
        limit, before, least = np.inf if accept is None else accept, np.inf, 0
        while True:
            try:
                tried(least, PROBE)
                break
            except UnstableError:
                if least == most:
                    raise
                least += 1
        problem = SimulationError("")
        for halved in range(least, most + 1):
            try:
                runs = [tried(halved), tried(halved + 1)]
                error, sensor, of_samples = self.step_error(*runs)
                if error <= limit and self.order == 1 and halved + 1 <= room:
                    runs.append(tried(halved + 2))
                    error, sensor, of_samples = self.step_error(*runs)
            except UnstableError as unstable:
                problem = unstable
                continue
            check_dampers(self.foot, runs[0].qpos[:, runs[0].qpos.shape[1] // 2 :].mean(axis=1), laws)
            kept, which = error, sensor
            if not self._smooth:
                kept, which, _ = self.step_error(*runs, stride=2**halved)
            missed = kept if error <= limit else kept - error  # between samples, which no halving mends
            if missed > max(limit, FOLDED):
                raise self._too_long(step, kept, which, max(limit, FOLDED))
            if error <= limit:
                if not self._smooth:
                    kept = max(kept, self.step_error(*runs, stride=2**halved, pieces=PIECES)[0])
                return runs[0].every(2**halved, step_error=kept, step_s=step / 2**halved, sample_error=of_samples)
            problem = self._too_long(step / 2**halved, error, sensor, limit)
            falls = max(before / error, 2.0**self.order)
            if self._smooth and error < READABLE and error / falls ** (most - halved) > limit:
                break
            before = error
        raise problem

    def standing(self, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (nsim, nq) and activations (nsim, na) of feet that stand; the file's where one stands nowhere.

        Args:
            step: [s], which may let no loop be closed as stiffly as the file says.

        Raises:
            SimulationError: one falls, or topples from where gravity and springs balance.
        """
        balance, rows = self._balance, self._rows()
        balance.model.eq_solref[self._tied] = self._closing(np.array([step]))[0]
        named = {row: dict(zip(self._values, row, strict=True)) for row in rows}
        known = {}
        for row, values in named.items():
            x = balance.carried(values)
            if x is not None:
                slopes_at_rest(balance, x)
            known[row] = balance.state(x)
        qpos, act = zip(*(known[row] for row in rows), strict=True)
        return np.array(qpos), np.array(act)

    def _closing(self, h: np.ndarray) -> np.ndarray:
        """`solref` (nsim, ties, 2) of what closes a loop, for steps (nsim,) [s]."""
        allowed = np.stack([-0.25 / h**2, -1 / h], axis=1)[:, None]
        return np.maximum(self.foot.model.eq_solref[self._tied], allowed)

    def initial_state(
        self, motions: Sequence[BaseMotion], qpos: np.ndarray | None = None, qvel: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where the motions begin: qpos (nsim, nq) and qvel (nsim, nv), with the base where it does not drift.

        Args:
            motions: of the base, one or one a simulation.
            qpos, qvel: of the foot, as in `run`.

        Raises:
            SimulationError: a motion drifts from wherever it begins, and the foot feels where the base is.
        """
        for motion in motions:
            if motion.start is None:
                check_drift(self.foot, motion.name)
                break
        base = self.foot.base
        at = np.array([motion.start or (0.0, 0.0) for motion in motions])
        q = np.broadcast_to(self._rest if qpos is None else qpos, (self.nsim, self._rest.size)).copy()
        v = np.broadcast_to(0.0 if qvel is None else qvel, (self.nsim, self.foot.model.nv)).copy()
        q[:, base] += at[:, 0]
        v[:, base] += at[:, 1]
        return q, v

    def _too_long(self, step: float, error: float, sensor: str, accept: float) -> SimulationError:
        integrator = mujoco.mjtIntegrator(self.foot.model.opt.integrator).name.removeprefix("mjINT_")
        if error > READABLE:
            advice = f"a step far below {step:.1g} s"
        else:
            shorter = step / 2 * (accept / error) ** (1 / self.order)
            advice = f"accept={2 * error:.1g}, or with a step of {shorter:.1g} s"
        return SimulationError(
            f"{self.foot.name}: steps of {step:.3g} s put sensor {sensor!r} off by {100 * error:.2g} % with the "
            f"integrator {integrator}; simulate with {advice}."
        )

    @property
    def order(self) -> int:
        """Power of the step by which its error falls.

        What touches, stops or slips spoils that of Runge-Kutta, and so does the current of a motor, whose rate is a
        difference over a step, and a constraint, whose stiffness MuJoCo may take from the step.
        """
        model = self.foot.model
        smooth = self._smooth and not model.neq and not np.any(model.actuator_dyntype == mujoco.mjtDyn.mjDYN_DCMOTOR)
        return 4 if smooth and model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 1

    @property
    def _smooth(self) -> bool:
        return not can_change(self.foot.model)

    def step_error(
        self, *runs: Simulation, stride: int = 1, pieces: int = 1, periodic: bool = False
    ) -> tuple[float, str, float]:
        """Error of a run's step, by runs that are as long and have half of it, a quarter ...

        The last two say where steps of no length would lead. A third run is needed where two errors fall at
        different rates, such as those of a soft pad and of a light bone: then two runs can be alike by chance.

        Args:
            runs: two or more, each with half of the step before.
            stride: of the first one sample of so many is kept, so that peaks of impacts fold into low frequencies.
            pieces: of a run that touches, stops or slips, of which the worst is judged.
            periodic: they are whole periods of a motion that repeats.

        Returns:
            `Simulation.step_error`, the sensor that it falsifies most, and `Simulation.sample_error`.
        """
        signals = [{name: x[:, :: 2**i] for name, x in run.outputs.items()} for i, run in enumerate(runs)]
        whole = self._off(signals, 1.0)
        judged = whole
        if not self._smooth:
            kept = runs[0].every(stride)
            size = kept.base.shape[1] // pieces
            moves = np.abs(_lines(kept.base, size, size, periodic)) ** 2
            moves = np.where(moves.any(axis=1, keepdims=True), moves, 1.0)
            lines = [
                {
                    name: _lines(x, size * (x.shape[1] // kept.base.shape[1]), size, periodic)
                    for name, x in run.outputs.items()
                }
                for run in (kept, *runs[1:])
            ]
            judged = self._off(lines, moves)
        worst = max(judged, key=lambda name: judged[name])
        return judged[worst], worst, max(whole.values())

    def _off(self, signals: Sequence[Mapping[str, np.ndarray]], weights: np.ndarray | float) -> dict[str, float]:
        """By how much the first of each accelerometer's signals or spectra is off, by where the last two lead."""
        first, (coarse, fine) = signals[0], signals[-2:]
        exact = {name: fine[name] + (fine[name] - coarse[name]) / (2**self.order - 1) for name in first}
        return {name: _share(first[name] - exact[name], fine[name], weights) for name in first}

    def _check_finite(self, sensordata: np.ndarray, qvel: np.ndarray) -> None:
        bad = ~np.isfinite(sensordata).all(axis=(1, 2)) | ~np.isfinite(qvel).all(axis=(1, 2))
        bad |= np.asarray(self._batch.warning).reshape(self.nsim, -1).any(axis=1)
        if bad.any():
            explicit = self.foot.model.opt.integrator in _EXPLICIT
            other = "the integrator implicitfast, " if explicit else ""
            raise UnstableError(
                f"{self.foot.name}: {bad.sum()} of {self.nsim} simulations became unstable; use a smaller time step, "
                f"{other}or parameters within the declared bounds."
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


def _share(off: np.ndarray, whole: np.ndarray, weights: np.ndarray | float) -> float:
    """Largest of the weighted root mean squares of `off` over that of `whole`, (m, n) each [m/s^2]."""
    size, error = (np.sqrt(np.average(np.abs(x) ** 2, 1, np.broadcast_to(weights, x.shape))) for x in (whole, off))
    return float(np.max(error / np.maximum(size, _NOTHING)))


def _lines(x: np.ndarray, piece: int, size: int, periodic: bool) -> np.ndarray:
    """Lines of the spectra (k m, size // 2 + 1) of pieces of signals (m, n).

    Args:
        x: signals.
        piece: samples of each piece; what is left over at the end is left out.
        size: as many in the coarsest signal, whose lines are taken.
        periodic: the ends of a piece meet; else a window takes them away.
    """
    x = x[:, : x.shape[1] // piece * piece].reshape(-1, piece)
    window = 1.0 if periodic else np.sqrt(8 / 3) * np.sin(np.pi * np.arange(piece) / piece) ** 2
    lines: np.ndarray = np.sqrt(2) * np.fft.rfft(x * window, axis=1)[:, : size // 2 + 1] / piece
    return lines


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


def check_drift(foot: Foot, motion: str) -> None:
    """Refuse a base whose acceleration alone is known, which drifts, for a foot that feels where the base is.

    Args:
        foot: the model.
        motion: name of the base's motion, or the file of its recording.

    Raises:
        SimulationError: something ties the foot to the world.
    """
    if holders := held_to_world(foot):
        raise SimulationError(
            f"{foot.name}: {' and '.join(holders)} ties the foot to the world, and the base of {motion!r} drifts away "
            "from it; use sines, or tie it to the table."
        )


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
        step: time step of the result [s], default the model's. It is computed with this step, or with
            a half, a quarter ... of it (`Simulation.step_s`) until the error is accepted.
        values: what a fit returns, or parameters by name (`Foot.with_values`), one value or (nsim,)
            of each.
        qpos: initial positions (nq,) or (nsim, nq), default where the foot stands;
        qvel: initial velocities.
        threads: 0 for all cores.
        accept: error of the time step (`Simulation.step_error`) above which it is halved; None for
            any. The check runs half the step and a quarter, six times as long as the run itself, a
            half alone for a smooth foot on Runge-Kutta or beyond `MOST_STEPS`; each halving takes
            twice as long as the one before. It is no bound of `step_error` for a foot that can touch,
            stop or slip: the samples that are kept miss peaks of impacts, and are refused above 1 %.

    Raises:
        SettingError: an unknown parameter or value, or sizes that do not fit.
        SimulationError: unstable, or no step is short enough.
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
