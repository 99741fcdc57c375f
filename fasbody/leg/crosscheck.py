"""Three engines, one leg: matrices and stepped response from the equations, from Pinocchio and from MuJoCo."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from fasbody.arch.crosscheck import build_pinocchio, import_pinocchio
from fasbody.foot import damper
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
#: A step of Runge-Kutta that is fine enough for `RESPONSES` [s].
FINE = 2.5e-4
#: Where a law is not linear: the matrices' tolerance, the stretch [m] and rate [m/s] of their differences, and how much
#: smaller the table's motion is.
BY_DIFFERENCES, STRETCH, RATE, SMALLER = 1e-8, 1e-6, 1e-3, 1e-4
#: Central difference of fourth order: nudge, weight.
DIFFERENCES = ((-2.0, 1 / 12), (-1.0, -8 / 12), (1.0, 8 / 12), (2.0, -1 / 12))
#: Seconds before the last period is read, in which transients of the step's error decay.
SETTLING = 0.6


@dataclass(frozen=True)
class Crosscheck:
    """Largest differences between engines.

    Attributes:
        model: name or file.
        added_mass_kg: on the leg [kg].
        matrices: quantity and pair -> largest difference over the largest entry.
        responses: table [Hz] -> largest difference of the stepped response at the sensors, over the response.
        curved: joints whose law is not linear: there all is compared for small motion, as the equations are for it.
    """

    model: str
    added_mass_kg: float
    matrices: dict[str, float]
    responses: dict[float, float]
    curved: tuple[str, ...] = ()

    @property
    def limit(self) -> float:
        """Largest difference of a matrix: `MATRICES`, or `BY_DIFFERENCES` where a law is not linear."""
        return BY_DIFFERENCES if self.curved else MATRICES

    @property
    def peak(self) -> float:
        """Acceleration of the table [m/s^2]."""
        return TABLE_PEAK * (SMALLER if self.curved else 1.0)

    @property
    def note(self) -> str:
        """What was compared for small motion alone; empty if nothing."""
        if not self.curved:
            return ""
        laws = ", ".join(repr(joint) for joint in self.curved)
        return (
            f"The law of {laws} is not linear and the equations are for small motion: compared by differences over "
            f"{STRETCH * 1e6:g} um and {RATE * 1e3:g} mm/s, and with the table at {self.peak:.2e} m/s^2."
        )

    @property
    def agrees(self) -> bool:
        """Matrices within `limit`, responses within `RESPONSES`."""
        return max(self.matrices.values()) < self.limit and max(self.responses.values()) < RESPONSES


def crosscheck(model: str | Path = "leg", added_mass_kg: float | None = None, step: float | None = None) -> Crosscheck:
    """Compare the three engines on one model.

    Args:
        model: name of a shipped leg or an MJCF file.
        added_mass_kg: on the leg [kg], in place of what is there; None is what the file has.
        step: of MuJoCo [s], default the model's, at most `FINE`.

    Raises:
        InputFileError: the model cannot be loaded.
        ModelError: it is no leg.
        FasError: Pinocchio is not installed.
    """
    foot = load(model)
    leg = Leg.from_model(foot.model, foot.name)
    if added_mass_kg is not None:
        leg = leg.with_added(added_mass_kg)
    step = step or min(foot.step, FINE)
    foot = foot.with_values({"added_mass": leg.added} if leg.carrier is not None else {}, step)
    M, C, K = leg.matrices()
    curved = tuple(joint for joint in leg.names if _is_curved(foot.model, foot.model.joint(joint).id))
    stepped_M, stepped_C, stepped_K = mujoco_matrices(foot, leg, bool(curved))
    pairs = {
        "mass matrix, equations-mujoco": (M, stepped_M),
        "mass matrix, equations-pinocchio": (M, pinocchio_mass(foot, leg)),
        "damping, equations-mujoco": (C, stepped_C),
        "stiffness, equations-mujoco": (K, stepped_K),
    }
    matrices = {name: float(np.abs(a - b).max() / np.abs(a).max()) for name, (a, b) in pairs.items()}
    result = Crosscheck(foot.name, leg.added, matrices, {}, curved)
    for f in TABLE_HZ:
        exact = {
            s: leg.at(s, np.array([f]))[0] for s in names(foot.model, "sensor") if s in leg.site and leg.site[s] >= 0
        }
        stepped = stepped_response(foot, leg, f, tuple(exact), result.peak)
        result.responses[f] = float(max(abs(T / exact[s] - 1) for s, T in stepped.items()))
    return result


def _is_curved(model: mujoco.MjModel, joint: int) -> bool:
    """Whether a joint's law is more than a linear damper."""
    user = model.jnt_user[joint] if model.jnt_user.shape[1] else np.zeros(1)
    return bool(user[0]) and not (user[0] == damper.DAMPER and not user[2:].any())


def _dofs(model: mujoco.MjModel, leg: Leg) -> list[int]:
    return [int(model.jnt_dofadr[model.joint(joint).id]) for joint in leg.names]


def mujoco_matrices(foot: Foot, leg: Leg, small: bool = False) -> tuple[Array, Array, Array]:
    """Mass, damping and stiffness, each (n, n), from what MuJoCo does with stretches and rates.

    Args:
        foot: the model.
        leg: its equations.
        small: take differences of fourth order about rest, for laws that are not linear, in place
            of unit nudges.
    """
    model, data, dofs = foot.model, mujoco.MjData(foot.model), _dofs(foot.model, leg)
    M, n = np.zeros((model.nv, model.nv)), len(dofs)
    C, K = np.zeros((n, n)), np.zeros((n, n))
    with callbacks():
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        for j, dof in enumerate(dofs):
            for state, matrix, nudge in (("qpos", K, STRETCH), ("qvel", C, RATE)):
                for times, weight in DIFFERENCES if small else ((1.0, 1.0),):
                    data.qpos[:], data.qvel[:] = model.qpos0, 0.0
                    getattr(data, state)[dof] += times * (nudge if small else 1.0)
                    mujoco.mj_forward(model, data)
                    matrix[:, j] -= data.qfrc_passive[dofs] * weight / (nudge if small else 1.0)
    return M[np.ix_(dofs, dofs)], C, K


def pinocchio_mass(foot: Foot, leg: Leg) -> Array:
    """Mass matrix (n, n) from Pinocchio's composite rigid body algorithm."""
    pin = import_pinocchio()
    built = build_pinocchio(foot.model, foot.name)
    upper = np.triu(pin.crba(built, built.createData(), pin.neutral(built)))
    dofs = [built.joints[built.getJointId(joint)].idx_v for joint in leg.names]
    return (upper + np.triu(upper, 1).T)[np.ix_(dofs, dofs)]


def stepped_response(
    foot: Foot, leg: Leg, frequency_hz: float, sites: tuple[str, ...], peak: float = TABLE_PEAK
) -> dict[str, complex]:
    """Acceleration at sensors over that of the table, from the last period of a stepped sine.

    Args:
        foot: the model.
        leg: its equations, from which the motion starts.
        frequency_hz: of the table [Hz].
        sites: sensors of the model.
        peak: acceleration of the table [m/s^2].
    """
    omega, period = 2 * np.pi * frequency_hz, 1 / frequency_hz
    count = int(np.ceil(period / foot.step))
    step, periods = period / count, int(np.ceil(SETTLING * frequency_hz)) + 1
    dofs, qpos, qvel = _dofs(foot.model, leg), foot.model.qpos0.copy(), np.zeros(foot.model.nv)
    z = -1j * peak * leg.stretch(np.array([frequency_hz]))[0]  # a = Re(-j A exp(j w t)) = A sin(w t)
    qpos[[int(foot.model.jnt_qposadr[foot.model.joint(joint).id]) for joint in leg.names]] += z.real
    qvel[dofs] = (1j * omega * z).real
    motion = harmonics(frequency_hz, [-1j * peak], periods * period)
    out = Batch(foot, 1).run(motion.controls(step, periods * count)[None], step, qpos, qvel)
    data = mujoco.MjData(foot.model)
    readings: dict[str, list[float]] = {s: [] for s in sites}
    first = (periods - 1) * count
    with callbacks():
        controls = motion.controls(step, periods * count)[first:]
        for k in range(count):
            data.qpos[:], data.qvel[:] = out.qpos[0, first + k], out.qvel[0, first + k]
            data.time = controls[k, 0]
            data.ctrl[foot.shaker : foot.shaker + controls.shape[1]] = controls[k]
            mujoco.mj_forward(foot.model, data)
            for s in sites:
                readings[s].append(float(foot.sensors[s].read(data.sensordata)))
    wave = np.exp(-1j * omega * step * np.arange(first, first + count)) * 2 / count
    return {s: complex(np.array(values) @ wave / (-1j * peak)) for s, values in readings.items()}
