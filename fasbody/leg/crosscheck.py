"""Three engines, one leg: matrices and stepped response from the equations, from Pinocchio and from MuJoCo."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from fasbody.arch.crosscheck import build_pinocchio, import_pinocchio
from fasbody.foot.engine import callbacks
from fasbody.foot.model import Foot, load
from fasbody.foot.parameters import names
from fasbody.foot.shaker import harmonics
from fasbody.foot.simulate import Batch
from fasbody.leg.chain import Array, Leg

#: Largest relative difference of a matrix and of a response that still counts as agreement.
MATRICES, RESPONSES = 1e-12, 1e-5
#: Table of the stepped response [Hz], and its acceleration [m/s^2].
TABLE_HZ, TABLE_PEAK = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0), 8.95
#: Seconds before the last period is read: transients from the step's own error fade.
SETTLING = 0.6


@dataclass(frozen=True)
class Crosscheck:
    """Largest differences between engines.

    Attributes:
        model: name or file.
        added_mass_kg: on the leg [kg].
        matrices: quantity and pair -> largest difference over the largest entry.
        responses: table [Hz] -> largest difference of the stepped response at the sensors, over the response.
    """

    model: str
    added_mass_kg: float
    matrices: dict[str, float]
    responses: dict[float, float]

    @property
    def agrees(self) -> bool:
        """Matrices within `MATRICES`, responses within `RESPONSES`."""
        return max(self.matrices.values()) < MATRICES and max(self.responses.values()) < RESPONSES


def crosscheck(model: str | Path = "leg", added_mass_kg: float = 0.0, step: float | None = None) -> Crosscheck:
    """Compare the three engines on one model.

    Args:
        model: name of a shipped leg or an MJCF file.
        added_mass_kg: on the leg [kg].
        step: of MuJoCo [s], default the model's.

    Raises:
        InputFileError: the model cannot be loaded.
        ModelError: it is no leg.
        FasError: Pinocchio is not installed.
    """
    foot = load(model)
    leg = Leg.from_model(foot.model, foot.name).with_added(added_mass_kg)
    foot = foot.with_values({"added_mass": added_mass_kg} if added_mass_kg else {}, step)
    M, C, K = leg.matrices()
    stepped_M, stepped_C, stepped_K = mujoco_matrices(foot, leg)
    pairs = {
        "mass matrix, equations-mujoco": (M, stepped_M),
        "mass matrix, equations-pinocchio": (M, pinocchio_mass(foot, leg)),
        "damping, equations-mujoco": (C, stepped_C),
        "stiffness, equations-mujoco": (K, stepped_K),
    }
    matrices = {name: float(np.abs(a - b).max() / np.abs(a).max()) for name, (a, b) in pairs.items()}
    responses = {}
    for f in TABLE_HZ:
        exact = {s: leg.at(s, np.array([f]))[0] for s in names(foot.model, "sensor") if s in leg.site and s != "base"}
        responses[f] = max(abs(T / exact[s] - 1) for s, T in stepped_response(foot, leg, f, tuple(exact)).items())
    return Crosscheck(foot.name, added_mass_kg, matrices, {f: float(d) for f, d in responses.items()})


def _dofs(model: mujoco.MjModel, leg: Leg) -> list[int]:
    return [int(model.jnt_dofadr[model.joint(joint).id]) for joint in leg.names]


def mujoco_matrices(foot: Foot, leg: Leg) -> tuple[Array, Array, Array]:
    """Mass, damping and stiffness, each (n, n), from what MuJoCo does with unit stretches and rates."""
    model, data, dofs = foot.model, mujoco.MjData(foot.model), _dofs(foot.model, leg)
    M, n = np.zeros((model.nv, model.nv)), len(dofs)
    C, K = np.zeros((n, n)), np.zeros((n, n))
    with callbacks():
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        for j, dof in enumerate(dofs):
            for rate, matrix in ((0.0, K), (1.0, C)):
                data.qpos[:], data.qvel[:] = model.qpos0, 0.0
                (data.qvel if rate else data.qpos)[dof] += 1.0
                mujoco.mj_forward(model, data)
                matrix[:, j] = -data.qfrc_passive[dofs]
    return M[np.ix_(dofs, dofs)], C, K


def pinocchio_mass(foot: Foot, leg: Leg) -> Array:
    """Mass matrix (n, n) from Pinocchio's composite rigid body algorithm."""
    pin = import_pinocchio()
    built = build_pinocchio(foot.model, foot.name)
    upper = np.triu(pin.crba(built, built.createData(), pin.neutral(built)))
    dofs = [built.joints[built.getJointId(joint)].idx_v for joint in leg.names]
    return (upper + np.triu(upper, 1).T)[np.ix_(dofs, dofs)]


def stepped_response(foot: Foot, leg: Leg, frequency_hz: float, sites: tuple[str, ...]) -> dict[str, complex]:
    """Acceleration at sensors over that of the table, from the last period of a stepped sine.

    Args:
        foot: the model. leg: its equations, from which the motion starts.
        frequency_hz: of the table [Hz]. sites: sensors of the model.
    """
    omega, period = 2 * np.pi * frequency_hz, 1 / frequency_hz
    count = int(np.ceil(period / foot.step))
    step, periods = period / count, int(np.ceil(SETTLING * frequency_hz)) + 1
    dofs, qpos, qvel = _dofs(foot.model, leg), foot.model.qpos0.copy(), np.zeros(foot.model.nv)
    z = -1j * TABLE_PEAK * leg.stretch(np.array([frequency_hz]))[0]  # a = Re(-j A exp(j w t)) = A sin(w t)
    qpos[[int(foot.model.jnt_qposadr[foot.model.joint(joint).id]) for joint in leg.names]] += z.real
    qvel[dofs] = (1j * omega * z).real
    motion = harmonics(frequency_hz, [-1j * TABLE_PEAK], periods * period)
    out = Batch(foot, 1).run(motion.controls(step, periods * count)[None], step, qpos, qvel)
    data = mujoco.MjData(foot.model)
    found: dict[str, list[float]] = {s: [] for s in sites}
    first = (periods - 1) * count
    with callbacks():
        controls = motion.controls(step, periods * count)[first:]
        for k in range(count):
            data.qpos[:], data.qvel[:] = out.qpos[0, first + k], out.qvel[0, first + k]
            data.time = controls[k, 0]
            data.ctrl[foot.shaker : foot.shaker + controls.shape[1]] = controls[k]
            mujoco.mj_forward(foot.model, data)
            for s in sites:
                found[s].append(float(data.sensordata[foot.model.sensor(s).adr[0] + 1]))
    wave = np.exp(-1j * omega * step * np.arange(first, first + count)) * 2 / count
    return {s: complex(np.array(values) @ wave / (-1j * TABLE_PEAK)) for s, values in found.items()}
