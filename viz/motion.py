"""What the viewer shows of one foot: a periodic motion under a sine, or a transient under any base motion.

Works for every MJCF that the commands accept. Harmonic balance gives the periodic motion and small motion the curve of
the transmissibility, so that neither has a time step; MuJoCo steps what is not smooth and what does not repeat. Beside
the poses stand the loops, force over extension of fat pad, ankle and fascia.
"""

import threading
import time
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import Event
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from fasbody.exceptions import PeriodicMotionError, SimulationError, UnstableError
from fasbody.foot.engine import callbacks
from fasbody.foot.harmonic_balance import Fourier
from fasbody.foot.hysteresis import Element
from fasbody.foot.linear import Linear
from fasbody.foot.model import Foot
from fasbody.foot.parameters import names
from fasbody.foot.shaker import BaseMotion, harmonics
from fasbody.foot.simulate import ACCEPTED, Batch, Simulation
from fasbody.foot.steady_state import Balance, Orbit
from viz.anatomy.rest import frames as rest_frames
from viz.settings import Settings

Array = np.ndarray

#: Joints and tendons whose force loop is worth a plot, by what they stand for.
LOOPS = {"fat pad": ("fat_pad", "heel_pad"), "ankle": ("talocrural",), "fascia": ("plantar_aponeurosis",)}
#: Frames of one shown period; a transient has at least `RATE` frames a second: 12 a cycle at `HIGHEST` [Hz].
FRAMES = 64
HIGHEST, PER_CYCLE = 50.0, 12
RATE = PER_CYCLE * HIGHEST
#: The motion counts as periodic when its joints will change by less than this share of their travel, as their changes
#: of the last two periods let expect.
PERIODIC = 1e-4
#: Travel of the joints [m or rad] below which the motion counts as rest.
FLOOR = 1e-7
#: A settled orbit is tried for at most so many periods, and the step halved at most so often.
PERIODS, HALVINGS = 120, 8
#: Most steps of a halved period; more would take too long for a slider.
STEPS = 2**14
#: Computing time [s] after which no further period or smaller step is tried.
PATIENCE = 20.0
#: Set by whoever waits for a motion no longer.
UNWANTED: ContextVar[Event | None] = ContextVar("unwanted", default=None)
#: The transmissibility curve [Hz].
CURVE = np.linspace(1.0, 60.0, 119)


class UnwantedError(Exception):
    """Nobody waits for the motion any longer."""


def still_wanted() -> None:
    """Go on unless nobody waits.

    Raises:
        UnwantedError: nobody does.
    """
    unwanted = UNWANTED.get()
    if unwanted is not None and unwanted.is_set():
        raise UnwantedError


@dataclass(frozen=True, eq=False)
class Motion:
    """One shown motion of one foot.

    Attributes:
        time: (n,) [s]; a periodic motion starts again after `duration`.
        duration: [s].
        bodies: (n, bodies, 6) displacement [m] and rotation vector [rad] of each body from rest, in
            order of `names`.
        names: bodies of the model.
        base: (n,) base acceleration;
        malleolus: (n,) its acceleration [m/s^2].
        loops: what -> (2, n) extension [m] and force [N], both positive in extension.
        transmissibility: complex malleolus over base of small motion at `CURVE`.
        ratio: |T| of the shown motion at its frequency, None for a transient or a table at rest.
        phase: of it [deg].
        gap: change of the joints that is still to come, as a share of their travel.
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


def periodic_motion(foot: Foot, settings: Settings, amplitudes: Array | None = None) -> Motion:
    """The motion under a sine, or under several harmonics, as it repeats itself once everything has settled.

    Harmonic balance finds it without a time step. Where something touches, stops or slips, or what balance finds would
    not last, MuJoCo runs whole periods until they repeat, and halves the step until that changes them no more.

    Args:
        foot: the model.
        settings: of the sliders.
        amplitudes: (H,) complex of the base acceleration at the multiples of the settings'
            frequency [m/s^2]; None for the settings' sine.

    Raises:
        SettingError: settings outside their bounds. SimulationError: unstable, or it does not settle.
    """
    values = tuple(sorted(settings.values.items()))
    changed, balance = _changed(foot, values, settings.added_mass, threading.get_ident())
    if amplitudes is None:  # the base moves as sin(w t)
        amplitudes = np.array([-0.5j * settings.peak_to_peak])
    f, U = settings.frequency, amplitudes
    if np.any(U):
        try:
            orbit = balance.orbit(f, U)
        except PeriodicMotionError:
            pass
        else:
            if orbit.stable:
                return _balanced(changed, orbit)
    try:
        return _settled(changed, f, U)
    except UnstableError:
        raise _too_stiff(foot, changed) from None


@lru_cache(maxsize=2)
def _changed(foot: Foot, values: tuple[tuple[str, float], ...], added_mass: float, thread: int) -> tuple[Foot, Balance]:
    """The foot with the parameters of the sliders, kept while only the shaker's change; a balance is of one thread."""
    changed = Settings(values=dict(values), added_mass=added_mass).apply(foot)
    return changed, Balance(changed)


@lru_cache(maxsize=2)
def _linear(foot: Foot, balance: Balance) -> Linear:
    return Linear(foot, balance)


def _balanced(foot: Foot, orbit: Orbit) -> Motion:
    shaken, series = orbit.shaken, Fourier(orbit.series.harmonics, FRAMES)
    position, velocity, acceleration = shaken.motion(series, orbit.solution.x)
    n, f = foot.model.nv, shaken.frequency_hz
    harmonics = orbit.harmonics()
    motion = _posed(
        _linear(foot, shaken.balance), States(foot.model.qpos0 + position[:, :n], velocity[:, :n], position[:, n:]),
        np.arange(FRAMES) / (f * FRAMES), 1 / f, acceleration[:, foot.base], series.at(series.real(harmonics))[0],
    )  # fmt: skip
    return _repeats(motion, harmonics[0], shaken.base[0])


def _repeats(motion: Motion, malleolus: complex, base: complex, gap: float = 0.0) -> Motion:
    """A motion that repeats, with the ratio of the fundamentals (complex) where the table moves with it."""
    ratio = malleolus / base if base else None
    phase = None if ratio is None else float(np.degrees(np.angle(ratio)))
    return replace(motion, gap=gap, periodic=True, ratio=None if ratio is None else abs(ratio), phase=phase)


def _too_stiff(foot: Foot, changed: Foot) -> SimulationError:
    return SimulationError(
        f"{foot.name}: too stiff or too damped for the smallest time step that a slider waits for; "
        f"{_advice(foot, changed)}."
    )


def _advice(foot: Foot, changed: Foot) -> str:
    """Which parameter to lower: the one that was raised most over the model's value."""
    nominal, values = foot.values(), changed.values()
    raised = {name: values[name] / nominal[name] for name in nominal if nominal[name] > 0}
    name = max(raised, key=lambda n: raised[n], default="")
    if not name or raised[name] <= 1:
        return "lower a stiffness or a damping, or raise the frequency"
    return f"lower {name}, {values[name]:.4g} {foot.parameters[name].unit}, {raised[name]:.3g} times the model's own"


def _settled(foot: Foot, f: float, amplitudes: Array) -> Motion:
    """The periodic motion at f [Hz], with a step so short that half of it changes little."""
    began, batch = time.process_time(), Batch(foot, 1, threads=1)
    linear = Linear(foot)
    first = start = linear.start(f, amplitudes)
    count, coarse = FRAMES * int(np.ceil(1 / (f * foot.step * FRAMES))), None
    reason: SimulationError = UnstableError(foot.name)
    for halving in range(HALVINGS + 1):
        if halving and (count * 2 > STEPS or time.process_time() - began > PATIENCE):
            break
        count *= 2 if halving else 1
        try:
            run, gap = _repeated(batch, f, amplitudes, count, start, began)
        except _UnsettledError as error:
            reason, coarse, start = error, None, first
            if halving >= HALVINGS // 2:
                break
            continue
        except (SimulationError, np.linalg.LinAlgError):
            coarse, start = None, first
            continue
        off, sensor, _ = batch.step_error(coarse, run, periodic=True) if coarse else (np.inf, "", np.inf)
        if off <= ACCEPTED:
            return _period(linear, run, f, gap, moves=bool(np.any(amplitudes)))
        if coarse:
            reason = SimulationError(
                f"{foot.name}: at {f:g} Hz steps of {2 / (f * count):.2g} s put sensor {sensor!r} off by "
                f"{100 * off:.2g} %, and shorter ones take too long; give what touches or stops a softer solref."
            )
        coarse, start = run, _begins(foot, run)
    raise reason


class _UnsettledError(SimulationError):
    """Stable, but not periodic within `PERIODS`."""


def _repeated(
    batch: Batch, f: float, amplitudes: Array, count: int, start: tuple[Array, Array, Array], began: float
) -> tuple[Simulation, float]:
    """The first period of `count` steps that repeats, and the change that is still to come.

    Impacts on a grid of steps can make every second period differ by less than the step's error; that settles.
    """
    foot, h, before = batch.foot, 1 / (f * count), np.inf
    controls, last = harmonics(f, amplitudes, 1 / f).controls(h, count)[None], None
    for _ in range(PERIODS):
        still_wanted()
        if time.process_time() - began > PATIENCE:
            message = f"{foot.name}: the motion at {f:g} Hz has not settled in {PATIENCE:g} s; add damping."
            raise _UnsettledError(message)
        out = batch.run(controls, h, *start)
        joints = np.delete(out.qpos[0], foot.base, axis=1)  # the base travels further than they do at low frequencies
        travel = max(np.ptp(joints, axis=0).max(), FLOOR)
        change = float(np.abs(joints[-1] - joints[0]).max() / travel)
        twice = float(np.abs(joints[-1] - last).max() / travel) if last is not None else np.inf
        if twice < PERIODIC * change:
            if change < ACCEPTED:
                return out, change
            break
        shrinks = change / before
        gap = change if change == 0 else change * max(1, shrinks / (1 - shrinks)) if shrinks < 1 else np.inf
        if gap < PERIODIC:
            return out, gap
        before, start, last = change, _begins(foot, out), joints[0]
    if twice < ACCEPTED < change:
        text = f"{foot.name}: the motion at {f:g} Hz repeats itself every second period only, which is not shown"
        raise _UnsettledError(f"{text}; change the amplitude, the frequency or the damping.")
    raise _UnsettledError(f"{foot.name}: the motion at {f:g} Hz does not settle within {PERIODS} periods; add damping.")


def _begins(foot: Foot, out: Simulation) -> tuple[Array, Array, Array]:
    """Where the period after this one begins; the base must not drift."""
    q, v = out.qpos[0, -1].copy(), out.qvel[0, -1].copy()
    q[foot.base], v[foot.base] = out.qpos[0, 0, foot.base], out.qvel[0, 0, foot.base]
    return q, v, out.act[0, -1].copy()


def _period(linear: Linear, out: Simulation, f: float, gap: float, moves: bool) -> Motion:
    count = out.time.shape[1]
    motion = _stepped(linear, out, np.arange(0, count, count // FRAMES), 1 / f)
    w = 2 / count * np.exp(-2j * np.pi * np.arange(count) / count)
    return _repeats(motion, complex(out.malleolus[0] @ w), complex(out.base[0] @ w) if moves else 0.0, gap)


def transient_motion(
    foot: Foot, settings: Settings, base: BaseMotion, window: tuple[float, float] = (0.0, np.inf)
) -> Motion:
    """The motion from rest under any base motion: a sweep, a recording.

    Args:
        foot: the model.
        settings: of the sliders.
        base: what drives it.
        window: first and last second that are shown.
    """
    changed = settings.apply(foot)
    count = round(base.duration / changed.step)
    changed = changed.with_values({}, step=base.duration / count)
    linear = Linear(changed)
    try:
        out = Batch(changed, 1, threads=1).run_checked([base], changed.step)
    except UnstableError:
        raise _too_stiff(foot, changed) from None
    return _from_rest(linear, base, window, out)


def _from_rest(linear: Linear, base: BaseMotion, window: tuple[float, float], out: Simulation) -> Motion:
    """What is shown of a transient. Slow motion is taken out of the table and of what moves on it alike."""
    changed, count = linear.foot, out.time.shape[1]
    stride = max(1, int(1 / (RATE * changed.step)))
    pick = np.arange(0, count, stride)
    whole = _stepped(linear, out, pick, base.duration)
    step = base.duration / len(pick)
    up = np.array(changed.up)
    relative = whole.bodies.copy()
    relative[..., :3] -= out.qpos[0, pick, changed.base][:, None, None] * up
    bodies = without_drift(relative, step)
    bodies[..., :3] += without_drift(whole.base, step, twice=True)[:, None, None] * up
    keep = slice(int(window[0] / step), int(np.ceil(min(window[1] / step, len(pick)))))
    seen = replace(
        whole, bodies=bodies[keep], time=whole.time[keep], base=whole.base[keep], malleolus=whole.malleolus[keep],
        loops={label: values[:, keep] for label, values in whole.loops.items()},
    )  # fmt: skip
    return replace(seen, duration=step * len(seen.time))


def without_drift(values: Array, step: float, twice: bool = False, lowest_hz: float = 3.0) -> Array:
    """Values (n, ...) without what is slower than `lowest_hz`, so that the picture stays.

    Args:
        values: one row a time step [any unit].
        step: [s].
        twice: integrate twice, an acceleration to a displacement.
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
    by_label: dict[str, list[tuple[str, int]]] = {}
    for label, candidates in LOOPS.items():
        for kind in ("joint", "tendon"):
            present = names(model, kind)
            by_label.setdefault(label, []).extend(
                (kind, getattr(model, kind)(n).id) for n in candidates if n in present
            )
    return {label: elements for label, elements in by_label.items() if elements}


class States(NamedTuple):
    """Positions (n, nq), velocities (n, nv) and activations (n, na) that are shown."""

    qpos: Array
    qvel: Array
    act: Array


def _stepped(linear: Linear, out: Simulation, pick: Array, duration: float) -> Motion:
    states = States(out.qpos[0, pick], out.qvel[0, pick], out.act[0, pick])
    time = out.time[0, pick] - out.time[0, 0]
    return _posed(linear, states, time, duration, out.base[0, pick], out.malleolus[0, pick])


def _posed(linear: Linear, states: States, time: Array, duration: float, base: Array, malleolus: Array) -> Motion:
    """Poses and forces of states at times (n,), as a transient; beside them the curve of small motion."""
    model, data = linear.foot.model, mujoco.MjData(linear.foot.model)
    rest = rest_frames(model)
    bodies = list(rest)[1:]  # without the world
    index = np.arange(1, model.nbody)
    position, quaternion = np.empty((len(time), len(bodies), 3)), np.empty((len(time), len(bodies), 4))
    elements = {label: [Element(model, *one) for one in of] for label, of in watched(model).items()}
    loops = {label: np.empty((2, len(time))) for label in elements}
    with callbacks():
        for row, (qpos, qvel, act) in enumerate(zip(*states, strict=True)):
            data.qpos[:], data.qvel[:], data.act[:] = qpos, qvel, act
            mujoco.mj_forward(model, data)
            position[row], quaternion[row] = data.xpos[index], data.xquat[index]
            for label, parts in elements.items():
                x, _, pull = zip(*(part.stretched(data) for part in parts), strict=True)
                loops[label][:, row] = sum(x) / len(x), sum(pull)
    still = np.tile([rest[name].quaternion for name in bodies], (len(time), 1))
    turned = Rotation.from_quat(quaternion.reshape(-1, 4), scalar_first=True)  # about the world's axes
    turn = (turned * Rotation.from_quat(still, scalar_first=True).inv()).as_rotvec().reshape(position.shape)
    shift = position - np.array([rest[name].position for name in bodies])
    return Motion(
        time=time, duration=duration, bodies=np.concatenate([shift, turn], -1), names=bodies, base=base,
        malleolus=malleolus, loops=loops, transmissibility=linear.transmissibility(CURVE),
        ratio=None, phase=None, gap=0.0, periodic=False,
    )  # fmt: skip
