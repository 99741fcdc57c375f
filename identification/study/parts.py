"""The cycle of any MJCF foot with a `talocrural` and a `fat_pad`, in MuJoCo.

The force of each part comes from the model with all other parts silenced, so any law that MuJoCo or our callbacks know
will do; the shaker's force is that of its actuator, less what moves the base's own armature.
"""

import copy
from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np

from fasbody.exceptions import ModelError
from fasbody.foot.engine import callbacks
from fasbody.foot.model import Foot
from fasbody.foot.parameters import names
from fasbody.foot.simulate import Batch
from identification.engines.engine import Excitation
from identification.engines.mujoco import Coordinates, Rollouts
from identification.study.cycle import Cycle, Loop

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


def mujoco_cycle(foot: Foot, excitation: Excitation, values: Mapping[str, float]) -> Cycle:
    """The cycle of a foot with the given parameter values; see `loops.cycle`."""
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
    controls = e.motion.controls(e.step, e.steps)
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
