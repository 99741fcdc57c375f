"""Hysteresis loops of ankle and fat pad over one cycle, and the energy that goes through the foot.

The loops are Eq. (4.42) along the periodic orbit that the recording's own base motion drives: force against relative
displacement. Their areas are what ankle and pad dissipate a cycle. What the shaker puts in is computed without any
damper's force, and in a closed cycle the two must be equal: the imbalance is printed with every cycle.

- The two-mass foot: the compiled twin's orbit. The shaker's force is the rate of change of the momentum on the base.
- Any other MJCF foot with a `talocrural` and a `fat_pad` (joint or tendon, or the pads of foot_arch): MuJoCo's orbit.
  The force of each part comes from the model with all other parts silenced, so any law that MuJoCo or our callbacks
  know will do; the shaker's is that of its actuator, less what moves the base's own armature.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from scipy.signal import resample

from fasbody.exceptions import ModelError, SimulationError
from fasbody.foot.engine import callbacks
from fasbody.foot.model import Foot
from fasbody.foot.parameters import names
from fasbody.foot.simulate import Batch
from fasbody.foot.two_dof import TwoDof, path, periodic
from fasbody.recording.recording import Recording
from identification.domains import resolved
from identification.engines.engine import LONGEST_STEP, Excitation
from identification.engines.mujoco import Coordinates, Rollouts
from identification.engines.twin import twin_applies
from identification.periodic import Line
from identification.space import DELAY

#: Points of a stored loop.
POINTS = 48
#: Newton steps to a closed orbit.
_PASSES = 30
#: Relative gap at which an orbit counts as closed.
CLOSED = 1e-9
#: Names of the parts, first choice first; several elements work side by side.
PARTS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "ankle": (("talocrural",),),
    "fat_pad": (("fat_pad",), ("heel_pad", "forefoot_pad")),
}
_PASSIVE = tuple(
    f"{element}_{quantity}{kind}"
    for element, quantity in (("jnt", "stiffness"), ("dof", "damping"), ("tendon", "stiffness"), ("tendon", "damping"))
    for kind in ("", "poly")
)


@dataclass(frozen=True, eq=False)
class Loop:
    """Displacement (n,) [m] (extension positive), force (n,) [N] and dissipated energy [J] of one part in one cycle."""

    displacement_m: np.ndarray
    force_n: np.ndarray
    dissipated_j: float

    def document(self) -> dict[str, Any]:
        """As plain data, with `POINTS` points of the loop."""
        curves = {"displacement_m": self.displacement_m, "force_n": self.force_n}
        return {k: _short(resample(v, POINTS)) for k, v in curves.items()} | {"dissipated_j": self.dissipated_j}


@dataclass(frozen=True, eq=False)
class Cycle:
    """One closed cycle.

    Attributes:
        ankle, fat_pad: their loops. dissipated_j: by the whole model, which may have other dampers.
        shaker_work_j: by the base on the foot. malleolus_m_s2: (n,) its acceleration.
    """

    ankle: Loop
    fat_pad: Loop
    dissipated_j: float
    shaker_work_j: float
    malleolus_m_s2: np.ndarray

    @property
    def imbalance(self) -> float:
        """Share of the shaker's work that the dampers do not account for."""
        return (self.shaker_work_j - self.dissipated_j) / self.shaker_work_j

    def __str__(self) -> str:
        return (
            f"ankle {1e3 * self.ankle.dissipated_j:.3g} mJ, fat pad {1e3 * self.fat_pad.dissipated_j:.3g} mJ a cycle, "
            f"imbalance {100 * self.imbalance:.2g} %"
        )


def _short(values: np.ndarray) -> list[float]:
    """As a list of numbers of six digits: a thousandth of a line's width, and half the file."""
    return [float(f"{v:.6g}") for v in values]


def cycle(foot: Foot, excitation: Excitation, values: Mapping[str, float], twin: bool) -> Cycle:
    """The cycle of a foot with the given parameter values; `twin`: the compiled two-mass model is this foot.

    Raises:
        SimulationError: no periodic motion. ModelError: the model has no ankle or no fat pad by these names.
    """
    excitation = resolved(excitation, foot, values, twin)
    return _twin_cycle(excitation, values) if twin else _mujoco_cycle(foot, excitation, values)


def _twin_cycle(e: Excitation, values: Mapping[str, float]) -> Cycle:
    foot = TwoDof.from_values({**values, **e.masses})
    model = (foot.theta, foot.m_S, foot.m_F, e.half_steps, e.step)
    malleolus, _, start, _, gap = periodic(np.zeros(4), *model, CLOSED, _PASSES)
    if not gap < CLOSED:
        raise SimulationError(f"no periodic motion at {e.frequency_hz:g} Hz for {foot}.")
    x = path(start, *model).T
    F_T, F_F = foot.forces(x)  # Eq. (4.42)
    ankle, fat_pad = _loop(x[0], x[2], F_T, e), _loop(x[1], x[3], F_F, e)
    base = _base_velocity(e)
    momentum = foot.m_S * (x[2] + x[3] + base) + foot.m_F * (x[3] + base)
    work = float(np.mean(_rate(momentum, e) * base)) / e.frequency_hz
    return Cycle(ankle, fat_pad, ankle.dissipated_j + fat_pad.dissipated_j, work, malleolus)


def _base_velocity(e: Excitation) -> np.ndarray:
    """Velocity of the base at the steps of one period (n,), without a mean [m/s]."""
    omega = 2j * np.pi * e.frequency_hz * np.arange(1, e.amplitudes.size + 1)
    t = e.step * np.arange(e.steps)
    return (np.exp(np.multiply.outer(t, omega)) @ (e.amplitudes / omega)).real


def _rate(values: np.ndarray, e: Excitation) -> np.ndarray:
    """Time derivative of a periodic signal (n,), by its harmonics."""
    spectrum = np.fft.rfft(values)
    omega = 2j * np.pi * e.frequency_hz * np.arange(spectrum.size)
    if values.size % 2 == 0:
        omega[-1] = 0.0  # the phase of the highest line is unknown
    return np.fft.irfft(omega * spectrum, values.size)


def _loop(x: np.ndarray, x_dot: np.ndarray, force: np.ndarray, e: Excitation) -> Loop:
    """The work of a closed loop is its power averaged over a period: exact for the harmonics the steps resolve."""
    return Loop(x, force, float(np.mean(force * x_dot)) / e.frequency_hz)


def _mujoco_cycle(foot: Foot, excitation: Excitation, values: Mapping[str, float]) -> Cycle:
    """The cycle of a foot with the given parameter values; see `cycle`."""
    found = _run(foot, excitation, values)
    if foot.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        return found
    # the implicit integrators are of first order, so half the step shows the error and takes it away
    finer = replace(excitation, longest_step=0.5 * excitation.step)
    return _extrapolated(found, _run(foot, finer, values))


def _extrapolated(coarse: Cycle, fine: Cycle) -> Cycle:
    """Richardson's extrapolation of everything in a cycle from steps h and h/2."""

    def loop(a: Loop, b: Loop) -> Loop:
        x, force = 2 * b.displacement_m[::2] - a.displacement_m, 2 * b.force_n[::2] - a.force_n
        return Loop(x, force, 2 * b.dissipated_j - a.dissipated_j)

    return Cycle(
        loop(coarse.ankle, fine.ankle),
        loop(coarse.fat_pad, fine.fat_pad),
        2 * fine.dissipated_j - coarse.dissipated_j,
        2 * fine.shaker_work_j - coarse.shaker_work_j,
        2 * fine.malleolus_m_s2[::2] - coarse.malleolus_m_s2,
    )


def _run(foot: Foot, e: Excitation, values: Mapping[str, float]) -> Cycle:
    parts = {part: _elements(foot, part) for part in PARTS}
    engine = Rollouts(foot, [e], ())
    malleolus, _ = engine.orbit(0, values, (), CLOSED)
    controls = e.controls
    declared = {k: v for k, v in {**values, **e.masses}.items() if k in foot.parameters}
    tuned = foot.with_values(declared, e.step)
    run = Batch(tuned, 1).run(controls[None], e.step, *Coordinates(foot).unpack(engine.start(0)[None]))
    states = [run.qpos[0, :-1], run.qvel[0, :-1], run.act[0, :-1]]
    tied = (tuned.model.eq_solref < 0).all(axis=1)
    tuned.model.eq_solref[tied] = -0.25 / e.step**2, -1 / e.step  # as every rollout has it (simulate.py)
    model, base = tuned.model, int(foot.model.jnt_dofadr[foot.model.joint("base").id])
    alone = {
        (part, i): mujoco.MjData(_silenced(model, *element))
        for part, row in parts.items()
        for i, element in enumerate(row)
    }
    x = {key: np.empty((3, e.steps)) for key in alone}  # displacement, velocity, force
    power, reaction = np.empty(e.steps), np.empty(e.steps)
    data = mujoco.MjData(model)
    with callbacks():
        for k in range(e.steps):
            data.qpos[:], data.qvel[:], data.act[:] = (each[k] for each in states)
            data.ctrl[foot.shaker : foot.shaker + controls.shape[1]] = controls[k]
            data.time = controls[k, 0]
            mujoco.mj_forward(model, data)
            force = data.qfrc_passive + data.qfrc_actuator + data.qfrc_constraint
            power[k] = -np.delete(force * data.qvel, base).sum()
            reaction[k] = data.qfrc_actuator[base] - model.dof_armature[base] * data.qacc[base]
            for (part, i), silent in alone.items():
                silent.qpos[:], silent.qvel[:], silent.act[:] = data.qpos, data.qvel, data.act
                mujoco.mj_forward(silent.model, silent)
                x[part, i][:, k] = _state(silent, *parts[part][i])
    velocity = states[1][:, base] - states[1][:, base].mean()
    loops = {}
    for part, row in parts.items():
        own = [x[part, i] for i in range(len(row))]
        work = sum(np.mean(F * x_dot) for _, x_dot, F in own) / e.frequency_hz
        loops[part] = Loop(np.mean([z for z, _, _ in own], axis=0), np.sum([F for *_, F in own], axis=0), float(work))
    energies = (float(np.mean(power) / e.frequency_hz), float(np.mean(reaction * velocity) / e.frequency_hz))
    return Cycle(loops["ankle"], loops["fat_pad"], *energies, malleolus)


def _elements(foot: Foot, part: str) -> list[tuple[str, int]]:
    """Kind and number of the joints or tendons that are this part."""
    for wanted in PARTS[part]:
        for kind in ("joint", "tendon"):
            found = names(foot.model, kind)
            if set(wanted) <= set(found):
                return [(kind, found.index(name)) for name in wanted]
    valid = " or ".join(" and ".join(each) for each in PARTS[part])
    raise ModelError(f"{foot.name}: no joint or tendon is called {valid}, so it has no {part.replace('_', ' ')} loop.")


def _silenced(model: mujoco.MjModel, kind: str, number: int) -> mujoco.MjModel:
    """A copy in which only one joint or tendon has springs, dampers and laws."""
    silent = copy.copy(model)
    keep = {("jnt" if kind == "joint" else "tendon"): number}
    if kind == "joint":
        keep["dof"] = int(model.jnt_dofadr[number])
    for field in (*_PASSIVE, "jnt_user", "tendon_user"):
        rows = getattr(silent, field)
        mine = keep.get(field.partition("_")[0])
        rows[[i for i in range(len(rows)) if i != mine]] = 0.0
    return silent


def _state(data: mujoco.MjData, kind: str, number: int) -> tuple[float, float, float]:
    """Extension, its rate and the force [N] with which a part pulls its ends together, all others being silent."""
    model = data.model
    if kind == "joint":
        q, v = int(model.jnt_qposadr[number]), int(model.jnt_dofadr[number])
        x, x_dot, pull = data.qpos[q] - model.qpos0[q], data.qvel[v], -data.qfrc_passive[v]
    else:
        row = slice(model.ten_J_rowadr[number], model.ten_J_rowadr[number] + model.ten_J_rownnz[number])
        J, at = data.ten_J[row], model.ten_J_colind[row]
        x, x_dot = data.ten_length[number] - model.tendon_length0[number], data.ten_velocity[number]
        pull = -float(J @ data.qfrc_passive[at]) / float(J @ J)
    return float(x), float(x_dot), float(pull) - _driven(data, kind, number)


def _driven(data: mujoco.MjData, kind: str, number: int) -> float:
    """Force [N] of the actuators on a part: the pad law 4.22 has a memory, so it is one."""
    model = data.model
    through = mujoco.mjtTrn.mjTRN_JOINT if kind == "joint" else mujoco.mjtTrn.mjTRN_TENDON
    mine = (model.actuator_trntype == through) & (model.actuator_trnid[:, 0] == number)
    outputs = model.actuator_outadr[np.flatnonzero(mine)]
    return float(np.sum(data.actuator_force[outputs] * model.actuator_gear[outputs, 0]))


def cycles(
    result: Mapping[str, Any], foot: Foot, recordings: Sequence[Recording | Line], twin: bool | None = None
) -> list[dict[str, Any]]:
    """The cycles of a fit as plain data: one entry a recording and branch.

    Loops are of both branches, as all fits of a subject together may decide for the other one later.

    Args:
        result: `FitResult.document()`.
        foot: the model. recordings: those of the fit, checked, or their harmonics. twin: whether the compiled twin is
            this model, where that is known already.

    Returns:
        Entries with file, frequency_hz, added_mass_kg, branch, chosen, ankle, fat_pad, dissipated_j, shaker_work_j,
        imbalance and transmissibility (measured, model). Recordings that are not periodic have no entry.
    """
    twin = twin_applies(foot) if twin is None else twin
    step = min(LONGEST_STEP, foot.step)
    entries = []
    for given in recordings:
        if isinstance(given, Recording) and given.condition.frequency_hz is None:
            continue
        line = given if isinstance(given, Line) else Line.of(given)
        condition = line.recording.condition
        e = Excitation(line.base.frequency_hz, line.base.amplitudes, condition.masses, step)
        for number, branch in enumerate(result["branches"]):
            values = values_of(branch, foot)
            found = cycle(foot, e, {**foot.values(), **values}, twin)
            entries.append({
                "file": line.recording.file, "frequency_hz": line.base.frequency_hz,
                "added_mass_kg": condition.added_mass_kg, "branch": branch["name"], "chosen": number == 0,
                "ankle": found.ankle.document(), "fat_pad": found.fat_pad.document(),
                "dissipated_j": found.dissipated_j, "shaker_work_j": found.shaker_work_j, "imbalance": found.imbalance,
                "transmissibility": _transmissibility(line, found, values.get(DELAY.name, 0.0)),
            })  # fmt: skip
    return entries


def values_of(branch: Mapping[str, Any], foot: Foot) -> dict[str, float]:
    """The branch's parameter values by name, those that hold if the model is true: with them it moves as recorded."""
    name_of = {item.key: name for name, item in {**foot.parameters, DELAY.name: DELAY}.items()}
    told = {key: e.get("if_model_true") or e for key, e in branch["parameters"].items()}
    return {name_of[key]: e["value"] for key, e in told.items()}


def _transmissibility(line: Line, found: Cycle, delay: float) -> dict[str, list[float]]:
    """Malleolus over base at the excitation, measured and modelled, as real and imaginary part."""
    Y = 2 / found.malleolus_m_s2.size * np.fft.rfft(found.malleolus_m_s2)[1]
    Y *= np.exp(-2j * np.pi * line.base.frequency_hz * delay)
    base = line.base.amplitudes[0]
    each = {"measured": line.malleolus.amplitudes[0] / base, "model": Y / base}
    return {name: _short(np.array([H.real, H.imag])) for name, H in each.items()}
