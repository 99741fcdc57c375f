"""What the model's motion asks of the table, and what a foot that lifts would add to it: see contact.py."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from fasbody.foot.model import Foot
from fasbody.foot.simulate import Batch
from fasbody.foot.two_dof import NAMES
from fasbody.recording.recording import Recording
from identification.certification import Certified
from identification.contact import Contact
from identification.engines.engine import Excitation
from identification.engines.mujoco import Coordinates
from identification.periodic import PeriodicProblem

GRAVITY = 9.80665


def contacts(certified: Certified, foot: Foot, recordings: Sequence[Recording]) -> tuple[Contact, ...]:
    """The contact in each recording at a branch's end, where it was fitted on harmonics; else none.

    Args:
        certified: the branch. foot: the model. recordings: as fitted.
    """
    problem, z = certified.problem, certified.descent.z
    if not isinstance(problem, PeriodicProblem):
        return ()
    predicted, found = problem.predict(z), []
    for i, (recording, line) in enumerate(zip(recordings, problem.lines, strict=True)):
        e = problem.engine.drives[i]
        values = {**problem.space.values(problem.space.at(i, z)[0]), **e.masses}
        moving, weight = table_force(problem.engine.foot, values, e, problem.engine.start(i))
        static = recording.known.static_force_n
        held = weight if static is None else static
        force = moving + held
        Y = predicted[i][: line.count]
        added, beyond = None, None
        if line.count > 1 and set(NAMES) <= set(foot.parameters):
            lifted = lifting(values, e.frequency_hz, np.maximum(force, 0.0) - force, line.count)
            first = abs(line.malleolus.amplitudes[0])
            added = float(np.linalg.norm(lifted[1:]) / first)
            beyond = float(np.linalg.norm((line.malleolus.amplitudes - Y)[1:]) / first)
        time = np.arange(force.size) * e.step
        condition = recording.condition
        about = (recording.file, e.frequency_hz, condition.added_mass_kg, carrier(foot), held, static is not None)
        found.append(Contact(*about, time, force, added, beyond))
    return tuple(found)


def table_force(foot: Foot, values: Mapping[str, float], drive: Excitation, x0: np.ndarray) -> tuple[np.ndarray, float]:
    """The force of the table on what stands on it over one period (n,) without the static part, and its weight [N].

    Args:
        foot: the model. values: parameters by name; others than the model's are ignored. drive: one period.
        x0: (s,) states at its beginning.
    """
    tuned = foot.with_values({name: value for name, value in values.items() if name in foot.parameters})
    model, base = tuned.model, int(tuned.model.jnt_bodyid[tuned.model.joint("base").id])
    controls = drive.controls[None]
    run = Batch(tuned, 1, 1).run(controls, drive.step, *Coordinates(tuned).unpack(x0[None]))
    stands = [b for b in range(1, model.nbody) if model.body_parentid[b] == base]
    mass, data = model.body_subtreemass[stands], mujoco.MjData(model)
    momentum = np.empty(drive.steps)
    for k in range(drive.steps):
        data.qpos[:], data.qvel[:] = run.qpos[0, k], run.qvel[0, k]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_subtreeVel(model, data)
        momentum[k] = mass @ (data.subtree_linvel[stands] @ np.array(tuned.up))
    spectrum = np.fft.rfft(momentum) * 2j * np.pi * drive.frequency_hz * np.arange(drive.steps // 2 + 1)
    if drive.steps % 2 == 0:
        spectrum[-1] = 0.0
    return np.fft.irfft(spectrum, drive.steps), float(mass.sum() * GRAVITY)


def lifting(values: Mapping[str, float], frequency_hz: float, missing: np.ndarray, count: int) -> np.ndarray:
    """Harmonics (count,) of the malleolus [m/s^2] under a force on the foot's mass over a period (n,) [N], linearly.

    Args:
        values: of the two-mass model. frequency_hz: fundamental. missing: the force. count: how many harmonics.
    """
    h = np.arange(1, count + 1)
    F = 2 / missing.size * np.fft.rfft(missing)[h]
    s = 2j * np.pi * frequency_hz * h
    p_T, p_F = values["k_T"] + s * values["c_11"], values["k_F"] + s * values["c_21"]
    shank, both = values["m_S"] * s**2 + p_T, values["m_F"] * s**2 + p_T + p_F
    response: np.ndarray = s**2 * p_T * F / (shank * both - p_T**2)
    return response


def carrier(foot: Foot) -> str:
    """The joint by which the foot stands on the table, for messages; the base where that is none of its own."""
    model = foot.model
    base = int(model.jnt_bodyid[model.joint("base").id])
    joints = [j for j in range(model.njnt) if model.body_parentid[model.jnt_bodyid[j]] == base]
    named = [model.joint(j).name for j in joints if model.jnt_stiffness[j] > 0]
    return " and ".join(named) or "base"
