"""What the viewer shows of one foot: a periodic motion under a sine, or a transient under any base motion.

Works for every MJCF that the commands accept. The linear model of one step gives the transmissibility and the start of
the periodic motion; MuJoCo then runs whole periods until the motion repeats itself. Beside the poses stand the loops,
force over extension of fat pad, ankle and fascia.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from fasbody.exceptions import SimulationError
from fasbody.foot.damper import algebraic_force
from fasbody.foot.engine import SHAKER_CONTROLS, callbacks
from fasbody.foot.model import Foot
from fasbody.foot.parameters import names
from fasbody.foot.rest import standing
from fasbody.foot.shaker import CLOCK, BaseMotion, harmonics
from fasbody.foot.simulate import Batch, Simulation
from viz.anatomy.rest import frames as rest_frames
from viz.settings import Settings

Array = np.ndarray

#: Joints and tendons whose force loop is worth a plot, by what they stand for.
LOOPS = {"fat pad": ("fat_pad", "heel_pad"), "ankle": ("talocrural",), "fascia": ("plantar_aponeurosis",)}
#: Frames of one shown period; a transient has at least `RATE` frames a second: 12 a cycle at `HIGHEST` [Hz].
FRAMES = 64
HIGHEST, PER_CYCLE = 50.0, 12
RATE = PER_CYCLE * HIGHEST
#: The motion counts as periodic when a period changes its joints by less than this share of their travel.
PERIODIC = 1e-3
#: Travel of the joints [m or rad] below which the motion counts as rest.
FLOOR = 1e-7
#: A settled orbit is tried for at most so many periods, and the step halved at most so often.
PERIODS, HALVINGS = 60, 8
#: Most steps of a halved run; more would take too long and too much memory for a slider.
STEPS = 2**17
#: Computing time [s] after which no further period or smaller step is tried.
PATIENCE = 20.0
#: The transmissibility curve [Hz].
CURVE = np.linspace(1.0, 60.0, 119)


@dataclass(frozen=True, eq=False)
class Motion:
    """One shown motion of one foot.

    Attributes:
        time: (n,) [s]; a periodic motion starts again after `duration`.
        duration: [s].
        bodies: (n, bodies, 6) displacement [m] and rotation vector [rad] of each body from rest, in order of `names`.
        names: bodies of the model.
        base: (n,) base acceleration; malleolus: (n,) its acceleration [m/s^2].
        loops: what -> (2, n) extension [m] and force [N], both positive in extension.
        transmissibility: complex malleolus over base of the linear model at `CURVE`.
        ratio: |T| of the shown motion at its frequency, None for a transient or a table at rest. phase: of it [deg].
        gap: change of the joints over the last period, as a share of their travel.
        periodic: whether it repeats.
    """

    time: Array
    duration: float
    bodies: Array
    names: Sequence[str]
    base: Array
    malleolus: Array
    loops: Mapping[str, Array]
    transmissibility: Array
    ratio: float | None
    phase: float | None
    gap: float
    periodic: bool

    def __str__(self) -> str:
        ratio = "" if self.ratio is None else f", transmissibility {self.ratio:.3f}"
        return f"{len(self.time)} frames over {self.duration:.4g} s{ratio}"


@dataclass(frozen=True, eq=False)
class Discrete:
    """x_(k+1) = A x_k + B c_k of one step about rest: x = (q, q', act), c = (a_0, ..., a_3) of the base acceleration.

    `malleolus` (states,) gives the vertical velocity of the malleolus, `rest` (nq,) is the pose that q counts from,
    `exact` whether velocities and positions are of one moment: the implicit integrators' are half a step apart.
    """

    step: float
    A: Array
    B: Array
    malleolus: Array
    rest: Array
    exact: bool

    def controls(self, frequency_hz: Array) -> Array:
        """(n, 4) coefficients c of a base acceleration exp(i w t) at t = 0, as `BaseMotion.controls` makes them."""
        w = 2j * np.pi * np.asarray(frequency_hz, float)
        a, b = np.ones_like(w), np.exp(w * self.step)
        rise, j, k = (b - a) / self.step, w * a, w * b
        found = np.stack([a, j, (3 * rise - 2 * j - k) / self.step, (j + k - 2 * rise) / self.step**2], -1)
        return found * CLOCK ** np.arange(4)

    def states(self, frequency_hz: Array) -> Array:
        """(n, states) complex steady states at t = 0 under a base acceleration exp(i w t)."""
        z = np.exp(2j * np.pi * np.asarray(frequency_hz, float) * self.step)
        force = self.controls(frequency_hz) @ self.B.T
        return np.linalg.solve(z[:, None, None] * np.eye(len(self.A)) - self.A, force[..., None])[..., 0]

    def transmissibility(self, frequency_hz: Array) -> Array:
        """(n,) complex malleolus over base acceleration."""
        s = 2j * np.pi * np.asarray(frequency_hz)
        rate = s if self.exact else (np.exp(s * self.step) - 1) / self.step  # as `simulate` takes it from velocities
        return rate * (self.states(frequency_hz) @ self.malleolus)


def discretise(foot: Foot) -> Discrete:
    """The linear model of one step, by central differences of one batched step.

    Raises:
        SimulationError: it rests in no pose.
    """
    foot = foot.with_values({})
    model = foot.model
    model.opt.tolerance = 0.0  # the solver of constraints would stop before it has seen a small motion
    n, n_act = model.nv, model.na
    # Large enough for MuJoCo's constraint solver, which stops at an absolute gain and would see nothing in small ones.
    size = np.concatenate([np.full(n, 1e-4), np.full(n, 1e-2), np.full(n_act, 1.0), [1.0, 0.1, 0.01, 1e-3]])
    states, count = 2 * n + n_act, len(size)
    push = np.concatenate([np.diag(size), -np.diag(size)])
    controls = np.zeros((2 * count, 1, SHAKER_CONTROLS))
    controls[:, 0, 1:] = push[:, states:]
    rest = standing(foot)
    start = np.concatenate([rest, np.zeros(n + n_act)]) + push[:, :states]
    out = Batch(foot, 2 * count, threads=1).run(controls, foot.step, *np.split(start, [n, 2 * n], axis=1))
    after = np.concatenate([out.qpos[:, -1], out.qvel[:, -1], out.act[:, -1]], axis=1)
    slope = (after[:count] - after[count:]) / (2 * size[:, None])
    data, jacobian = mujoco.MjData(model), np.zeros((3, n))
    data.qpos[:] = rest
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_jacSite(model, data, jacobian, None, model.site("malleolus").id)
    row = np.concatenate([np.zeros(n), foot.up @ jacobian, np.zeros(n_act)])
    exact = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    return Discrete(foot.step, slope[:states].T, slope[states:].T, row, rest, exact)


def periodic_motion(foot: Foot, settings: Settings, amplitudes: Array | None = None) -> Motion:
    """The motion under a sine, or under several harmonics, as it repeats itself once everything has settled.

    A foot too stiff for its model's time step is tried with smaller ones.

    Args:
        foot: the model. settings: of the sliders. amplitudes: (H,) complex of the base acceleration at the multiples
            of the settings' frequency [m/s^2]; None for the settings' sine.

    Raises:
        SettingError: settings outside their bounds. SimulationError: unstable, or it does not settle.
    """
    changed = settings.apply(foot)
    if amplitudes is None:  # the base moves as sin(w t)
        amplitudes = np.array([-0.5j * settings.peak_to_peak])
    f, U = settings.frequency, amplitudes
    count = FRAMES * int(np.ceil(1 / (f * changed.step * FRAMES)))
    return _stable(foot, changed, count, lambda steps: _settled(changed, f, U, steps))


class _Unsettled(SimulationError):
    """Stable, but not periodic within `PERIODS`."""


def _stable(foot: Foot, changed: Foot, count: int, run: Callable[[int], Motion]) -> Motion:
    """What `run` makes with `count` steps, or with the fewest halvings of the step that keep it stable."""
    began = time.process_time()
    for halving in range(HALVINGS + 1):
        try:
            return run(count * 2**halving)
        except _Unsettled:
            late = time.process_time() - began > PATIENCE
            if late or halving >= HALVINGS // 2 or count * 2 ** (halving + 1) > STEPS:
                raise
        except (SimulationError, np.linalg.LinAlgError):
            if count * 2 ** (halving + 1) > STEPS or time.process_time() - began > PATIENCE:
                break
    raise SimulationError(
        f"{foot.name}: too stiff or too damped for the smallest time step that a slider waits for; "
        f"{_advice(foot, changed)}."
    )


def _advice(foot: Foot, changed: Foot) -> str:
    """Which parameter to lower: the one that was raised most over the model's own."""
    nominal, values = foot.values(), changed.values()
    raised = {name: values[name] / nominal[name] for name in nominal if nominal[name] > 0}
    name = max(raised, key=lambda n: raised[n], default="")
    if not name or raised[name] <= 1:
        return "lower a stiffness or a damping, or raise the frequency"
    return f"lower {name}, {values[name]:.4g} {foot.parameters[name].unit}, {raised[name]:.3g} times the model's own"


def _settled(foot: Foot, f: float, amplitudes: Array, count: int) -> Motion:
    """The periodic motion at `f` [Hz] under (H,) harmonics with `count` steps a period, a multiple of `FRAMES`."""
    changed = foot.with_values({}, step=1 / (f * count))
    linear = discretise(changed)
    start = (amplitudes @ linear.states(f * np.arange(1, amplitudes.size + 1))).real
    n = changed.model.nv
    batch = Batch(changed, 1, threads=1)
    controls = harmonics(f, amplitudes, 1 / f).controls(changed.step, count)[None]
    q, v, a = np.split(start, [n, 2 * n])
    q = q + linear.rest
    began = time.process_time()
    for _ in range(PERIODS):
        if time.process_time() - began > PATIENCE:
            raise _Unsettled(f"{foot.name}: the motion at {f:g} Hz has not settled in {PATIENCE:g} s; add damping.")
        out = batch.run(controls, changed.step, q, v, a)
        joints = np.delete(out.qpos[0], foot.base, axis=1)  # the base travels further than they do at low frequencies
        gap = float(np.abs(joints[-1] - joints[0]).max() / max(np.ptp(joints, axis=0).max(), FLOOR))
        if gap < PERIODIC:
            break
        q, v, a = out.qpos[0, -1].copy(), out.qvel[0, -1].copy(), out.act[0, -1].copy()
        q[foot.base], v[foot.base] = out.qpos[0, 0, foot.base], out.qvel[0, 0, foot.base]  # the base must not drift
    else:
        raise _Unsettled(f"{foot.name}: the motion at {f:g} Hz does not settle within {PERIODS} periods; add damping.")
    w = np.exp(-2j * np.pi * np.arange(count) / count)
    pick = np.arange(0, count, count // FRAMES)
    shown = _shown(changed, out, pick, 1 / f, linear.transmissibility(CURVE))
    if not np.any(amplitudes):
        return replace(shown, gap=gap, periodic=True)
    ratio = complex(out.malleolus[0] @ w / (out.base[0] @ w))
    return replace(shown, gap=gap, periodic=True, ratio=abs(ratio), phase=float(np.degrees(np.angle(ratio))))


def transient_motion(
    foot: Foot, settings: Settings, base: BaseMotion, shown: tuple[float, float] = (0.0, np.inf)
) -> Motion:
    """The motion from rest under any base motion: a sweep, a recording.

    Args:
        foot: the model. settings: of the sliders. base: what drives it. shown: first and last second that are shown.
    """
    changed = settings.apply(foot)
    count = round(base.duration / changed.step)
    return _stable(foot, changed, count, lambda steps: _from_rest(changed, base, shown, steps))


def _from_rest(foot: Foot, base: BaseMotion, shown: tuple[float, float], count: int) -> Motion:
    """The transient with `count` steps. Slow motion is taken out of the table and of what moves on it alike."""
    changed = foot.with_values({}, step=base.duration / count)
    controls = base.controls(changed.step, count)[None]
    out = Batch(changed, 1, threads=1).run(controls, changed.step, standing(changed))
    stride = max(1, int(1 / (RATE * changed.step)))
    pick = np.arange(0, count, stride)
    whole = _shown(changed, out, pick, base.duration, discretise(changed).transmissibility(CURVE))
    step = base.duration / len(pick)
    up = np.array(foot.up)
    relative = whole.bodies.copy()
    relative[..., :3] -= out.qpos[0, pick, foot.base][:, None, None] * up
    bodies = without_drift(relative, step)
    bodies[..., :3] += without_drift(whole.base, step, twice=True)[:, None, None] * up
    keep = slice(int(shown[0] / step), int(np.ceil(min(shown[1] / step, len(pick)))))
    seen = replace(
        whole, bodies=bodies[keep], time=whole.time[keep], base=whole.base[keep], malleolus=whole.malleolus[keep],
        loops={label: values[:, keep] for label, values in whole.loops.items()},
    )  # fmt: skip
    return replace(seen, duration=step * len(seen.time))


def without_drift(values: Array, step: float, twice: bool = False, lowest_hz: float = 3.0) -> Array:
    """Values (n, ...) without what is slower than `lowest_hz`, so that the picture stays.

    Args:
        values: one row a time step [any unit]. step: [s]. twice: integrate twice, an acceleration to a displacement.
        lowest_hz: half of the amplitude at this frequency is left.
    """
    padded = 2 * len(values)
    spectrum, f = np.fft.rfft(values, padded, axis=0), np.fft.rfftfreq(padded, step)
    keep = f**4 / (f**4 + lowest_hz**4)
    if twice:
        keep[1:] *= -1 / (2 * np.pi * f[1:]) ** 2
    return np.asarray(
        np.fft.irfft(spectrum * keep.reshape(-1, *[1] * (values.ndim - 1)), padded, axis=0)[: len(values)]
    )


def watched(model: mujoco.MjModel) -> dict[str, list[tuple[str, int]]]:
    """What a model has of `LOOPS`: label -> kind ("joint" or "tendon") and number of each element."""
    found: dict[str, list[tuple[str, int]]] = {}
    for label, wanted in LOOPS.items():
        for kind in ("joint", "tendon"):
            there = names(model, kind)
            found.setdefault(label, []).extend((kind, getattr(model, kind)(n).id) for n in wanted if n in there)
    return {label: elements for label, elements in found.items() if elements}


def loop_point(model: mujoco.MjModel, data: mujoco.MjData, kind: str, i: int) -> tuple[float, float]:
    """Extension [m] and tensile force [N] of a joint or tendon: spring, damper, law, and actuators that act on it."""
    if kind == "joint":
        q, v = model.jnt_qposadr[i], model.jnt_dofadr[i]
        x, x_dot, spring = data.qpos[q] - model.qpos_spring[q], data.qvel[v], data.qpos[q] - model.qpos_spring[q]
        rows = model.jnt_stiffness[i], model.jnt_stiffnesspoly[i], model.dof_damping[v], model.dof_dampingpoly[v]
        user, through = model.jnt_user, mujoco.mjtTrn.mjTRN_JOINT
    else:
        x, x_dot = data.ten_length[i] - model.tendon_length0[i], data.ten_velocity[i]
        low, high = model.tendon_lengthspring[i]
        spring = data.ten_length[i] - np.clip(data.ten_length[i], low, high)
        rows = (model.tendon_stiffness[i], model.tendon_stiffnesspoly[i],
                model.tendon_damping[i], model.tendon_dampingpoly[i])  # fmt: skip
        user, through = model.tendon_user, mujoco.mjtTrn.mjTRN_TENDON
    k, more_k, c, more_c = (np.ravel(row) for row in rows)
    force = _polynomial(k[0], more_k, spring) + _polynomial(c[0], more_c, x_dot)
    if user.shape[1]:
        force -= algebraic_force(user[i], x, x_dot, float(c[0]))
    on = np.flatnonzero((model.actuator_trntype == through) & (model.actuator_trnid[:, 0] == i))
    outputs = model.actuator_outadr[on]  # such as the branch of the aponeurosis, or a pad with a memory
    return float(x), float(force - np.sum(data.actuator_force[outputs] * model.actuator_gear[outputs, 0]))


def _polynomial(first: float, more: Array, x: float) -> float:
    """MuJoCo's force of a spring or damper: first x + more_0 x^2 + more_1 x^3, as the signs are."""
    return float(x * (first + sum(factor * x**power for power, factor in enumerate(more, 1))))


def _shown(foot: Foot, out: Simulation, pick: Array, duration: float, curve: Array) -> Motion:
    """Poses and forces of the picked steps, as a transient."""
    model, data = foot.model, mujoco.MjData(foot.model)
    rest = rest_frames(model)
    bodies = list(rest)[1:]  # without the world
    index = np.arange(1, model.nbody)
    position, quaternion = np.empty((len(pick), len(bodies), 3)), np.empty((len(pick), len(bodies), 4))
    found = watched(model)
    loops = {label: np.empty((2, len(pick))) for label in found}
    with callbacks():
        for row, k in enumerate(pick):
            data.qpos[:], data.qvel[:], data.act[:] = out.qpos[0, k], out.qvel[0, k], out.act[0, k]
            mujoco.mj_forward(model, data)
            position[row], quaternion[row] = data.xpos[index], data.xquat[index]
            for label, elements in found.items():
                rows = [loop_point(model, data, kind, i) for kind, i in elements]
                loops[label][:, row] = np.mean([x for x, _ in rows]), np.sum([force for _, force in rows])
    still = np.tile([rest[name].quaternion for name in bodies], (len(pick), 1))
    turned = Rotation.from_quat(quaternion.reshape(-1, 4), scalar_first=True)  # about the world's axes
    turn = (turned * Rotation.from_quat(still, scalar_first=True).inv()).as_rotvec().reshape(position.shape)
    shift = position - np.array([rest[name].position for name in bodies])
    return Motion(
        time=(out.time[0, pick] - out.time[0, 0]), duration=duration, bodies=np.concatenate([shift, turn], -1),
        names=bodies, base=out.base[0, pick], malleolus=out.malleolus[0, pick], loops=loops, transmissibility=curve,
        ratio=None, phase=None, gap=0.0, periodic=False,
    )  # fmt: skip
