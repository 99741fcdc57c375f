"""Three engines, one arch: mass matrix and velocity terms from the equations, from Pinocchio and from MuJoCo.

The equations are those of Appendix B with the constants of the compiled model. MuJoCo and Pinocchio compute the
matrices of the tree, which are projected onto the coordinates of the equations (tree.py). Pinocchio's model
is built from the compiled one, body by body, because its MJCF reader silently drops unknown elements.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Array, rest
from fasbody.arch.lagrange import mass_and_bias
from fasbody.arch.mjcf import JOINTS, nonlinear_laws, numbers
from fasbody.arch.motion import move
from fasbody.arch.ode import solve
from fasbody.arch.tree import project, tree_jacobian, tree_position
from fasbody.exceptions import ModelError, required
from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import harmonics

ENGINES = ("analytic", "pinocchio", "mujoco")
#: Largest relative difference that still counts as agreement.
AGREEMENT = 1e-8
#: The same for the stepped motion, as a share of its peak.
MOTION_AGREEMENT = 1e-3
#: Table of the stepped motion: frequencies [Hz], acceleration [m/s^2] and duration [s].
TABLE_HZ, TABLE_PEAK, TABLE_SECONDS = (10.0, 20.0, 30.0, 40.0, 50.0), 8.95, 0.1
#: Random poses lie within this of rest [rad], and rates below the second [rad/s and m/s].
REACH, RATE = 0.3, 5.0


@dataclass(frozen=True)
class Dynamics:
    """Malleolus acceleration of the stepped arch against the reduced ODE of the equations, from rest, table at a sine.

    Attributes:
        frequency_hz: of the table [Hz].
        difference: largest, over the peak.
        accurate: the same, extrapolated from this step and half of it.
        step: of MuJoCo [s].
        note: what had to be changed to step at all.
    """

    frequency_hz: float
    difference: float
    accurate: float
    step: float
    note: str


@dataclass(frozen=True)
class Crosscheck:
    """Largest relative differences between engines, by quantity and pair ("analytic-pinocchio", ...).

    Attributes:
        model: name or file.
        samples: number of random configurations.
        seed: of the random numbers.
        mass_matrix: of Eq. (4.11) at the random configurations.
        bias: centrifugal and Coriolis terms there.
        linear_mass_matrix: of Eq. (4.12), at rest.
        note: what of the model the equations have only in a linear form; empty if nothing.
        constants: of the model, as the equations take them, by thesis symbol [SI units, rad].
        dynamics: stepped MuJoCo against the integrated equations, if requested.
    """

    model: str
    samples: int
    seed: int
    mass_matrix: dict[str, float]
    bias: dict[str, float]
    linear_mass_matrix: dict[str, float]
    note: str
    constants: dict[str, float]
    dynamics: list[Dynamics] | None = None

    @property
    def agrees(self) -> bool:
        """All pairs of all quantities within `AGREEMENT`, every motion within `MOTION_AGREEMENT`."""
        quantities = (self.mass_matrix, self.bias, self.linear_mass_matrix)
        moves = all(motion.difference < MOTION_AGREEMENT for motion in self.dynamics or ())
        return moves and all(value < AGREEMENT for quantity in quantities for value in quantity.values())

    def document(self) -> dict[str, Any]:
        """The result as plain data for --json."""
        plain = {key: value for key, value in vars(self).items() if key != "dynamics"}
        return plain if self.dynamics is None else plain | {"dynamics": [vars(motion) for motion in self.dynamics]}

#: What passes an iterable on.
Tracked = Callable[[Sequence[float]], Iterable[float]]


def crosscheck(
    model: str | Path = "foot_arch", samples: int = 1000, seed: int = 0, dynamics: bool = False,
    tracked: Tracked = iter,
) -> Crosscheck:
    """Compare the three engines on one model.

    Args:
        model: name of a shipped arch or an MJCF file.
        samples: random configurations.
        seed: of the random numbers.
        dynamics: also compare the motion, see `compare_motion`.
        tracked: passes the frequencies of the motion on, such as a progress bar.

    Raises:
        InputFileError: the model cannot be loaded.
        ModelError: it is no five-body arch.
        FasError: Pinocchio is not installed.
    """
    foot = load(model)
    arch = Arch(**numbers(foot.model, foot.name))  # gravity is compared, too
    q, q_dot = random_poses(arch, np.random.default_rng(seed), samples)
    at_rest = rest(arch)[None]
    nonlinear = _all_engines(foot.model, foot.name, arch, q, q_dot)
    linear = _all_engines(foot.model, foot.name, arch, at_rest, np.zeros_like(at_rest))
    return Crosscheck(
        foot.name, samples, seed,
        mass_matrix=_pairs({engine: A for engine, (A, _) in nonlinear.items()}),
        bias=_pairs({engine: bias for engine, (_, bias) in nonlinear.items()}),
        linear_mass_matrix=_pairs({engine: A for engine, (A, _) in linear.items()}),
        note=_note(foot.model), constants=asdict(arch),
        dynamics=compare_motion(foot, arch, tracked(TABLE_HZ)) if dynamics else None,
    )  # fmt: skip


def compare_motion(foot: Foot, arch: Arch, frequencies_hz: Iterable[float] = TABLE_HZ) -> list[Dynamics]:
    """Step the model and integrate the equations (Radau IIA, relative tolerance 1e-9) under the same table.

    A model with gravity starts with a jump, which the plain mode, of first order, resolves to about 1 % only.

    Args:
        foot: foot_arch or an edited copy.
        arch: its constants.
        frequencies_hz: of the table [Hz].

    Raises:
        SimulationError: one of both cannot be integrated.
    """
    results, gravity = [], -float(foot.model.opt.gravity[1])
    for frequency in frequencies_hz:
        motion = harmonics(frequency, [-1j * TABLE_PEAK], TABLE_SECONDS)
        plain, accurate = (move(foot, motion, accurate=is_accurate) for is_accurate in (False, True))
        omega = 2 * np.pi * frequency
        table = lambda t, omega=omega: TABLE_PEAK * np.sin(omega * t)  # noqa: E731
        exact = solve(arch, table, plain.time, gravity=gravity, tolerance=1e-9).malleolus
        off, off_accurate = (np.abs(run.malleolus - exact).max() / np.abs(exact).max() for run in (plain, accurate))
        results.append(Dynamics(frequency, float(off), float(off_accurate), plain.step, plain.note))
    return results


def _note(model: mujoco.MjModel) -> str:
    laws = nonlinear_laws(model)
    if not laws:
        return ""
    return f"the equations are linear where the model has a nonlinear law: {', '.join(laws)}; they take it as at rest."


def random_poses(arch: Arch, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Random closed poses about rest and rates, each of shape (count, 6); z within 10 mm, x within 2 mm."""
    reach = np.array([0.01, 0.01, REACH, REACH, REACH, 0.002])
    lengths = np.array([arch.L_2, arch.L_3, arch.L_4])
    q = np.empty((0, 6))
    while len(q) < count:
        tried = rest(arch) + rng.uniform(-reach, reach, (count, 6))
        height = np.cos(tried[:, 2:5]) @ lengths
        q = np.concatenate([q, tried[(height < 0.98 * arch.L_1) & (height > -0.98 * arch.L_1)]])
    return q[:count], rng.uniform(-RATE, RATE, (count, 6))


def _all_engines(
    model: mujoco.MjModel, name: str, arch: Arch, q: Array, q_dot: Array
) -> dict[str, tuple[Array, Array]]:
    """Mass matrix (n, 5, 5) and bias (n, 5) of each engine in the coordinates of the equations; x has neither."""
    tree = tree_position(arch, q)
    velocity = np.einsum("nij,nj->ni", tree_jacobian(arch, q), q_dot)
    results = {"analytic": mass_and_bias(arch, q, q_dot, gravity=-float(model.opt.gravity[1]))}
    for engine, run in (("pinocchio", pinocchio_tree), ("mujoco", mujoco_tree)):
        results[engine] = project(arch, q, q_dot, *run(model, name, tree, velocity))
    return {engine: (A[:, :5, :5], bias[:, :5]) for engine, (A, bias) in results.items()}


def _pairs(values: dict[str, Array]) -> dict[str, float]:
    """Entry by entry, largest difference over that entry's largest value, so that none hides behind another."""
    differences = {}
    for one, other in combinations(ENGINES, 2):
        scale = np.abs(values[one]).max(axis=0)
        scale = np.where(scale > 0, scale, 1)
        differences[f"{one}-{other}"] = float(np.max(np.abs(values[one] - values[other]) / scale))
    return differences


def mujoco_tree(model: mujoco.MjModel, name: str, tree: Array, velocity: Array) -> tuple[Array, Array]:
    """Mass matrices (n, 6, 6) and biases (n, 6) of the tree, in the order of `JOINTS`.

    Args:
        model: the compiled model.
        name: what to call it in messages.
        tree: joint positions, shape (n, 6).
        velocity: joint velocities, shape (n, 6).
    """
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    dofs = [int(model.jnt_dofadr[model.joint(joint).id]) for joint in JOINTS]
    places = [int(model.jnt_qposadr[model.joint(joint).id]) for joint in JOINTS]
    masses, biases = [], []
    for position, rate in zip(tree, velocity, strict=True):
        data.qpos[places], data.qvel[dofs] = position, rate
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_fullM(model, data, full)
        bias = np.zeros(model.nv)
        mujoco.mj_rne(model, data, 0, bias)
        masses.append(full[np.ix_(dofs, dofs)])
        biases.append(bias[dofs])
    return np.array(masses), np.array(biases)


def pinocchio_tree(model: mujoco.MjModel, name: str, tree: Array, velocity: Array) -> tuple[Array, Array]:
    """The same from Pinocchio: composite rigid body algorithm and nonlinear effects."""
    pin = import_pinocchio()
    built = build_pinocchio(model, name)
    data = built.createData()
    dofs = [built.joints[built.getJointId(joint)].idx_v for joint in JOINTS]
    q, v = pin.neutral(built), np.zeros(built.nv)
    masses, biases = [], []
    for position, rate in zip(tree, velocity, strict=True):
        q[dofs], v[dofs] = position, rate
        upper = np.triu(pin.crba(built, data, q))
        full = upper + np.triu(upper, 1).T
        masses.append(full[np.ix_(dofs, dofs)])
        biases.append(pin.nonLinearEffects(built, data, q, v)[dofs].copy())
    return np.array(masses), np.array(biases)


def build_pinocchio(model: mujoco.MjModel, name: str = "model") -> Any:
    """A Pinocchio model of a compiled tree of hinges and slides, at most one to a body.

    Args:
        model: the compiled model.
        name: what to call it in messages.

    Raises:
        ModelError: the model has other joints, or the built one differs in size or mass.
    """
    pin = import_pinocchio()
    built = pin.Model()
    built.gravity.linear = model.opt.gravity.copy()
    # MuJoCo body -> the Pinocchio joint that carries it, and its frame in that joint's
    carrier, frame = {0: 0}, {0: pin.SE3.Identity()}
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        placement = frame[parent] * pin.SE3(_rotation(model.body_quat[body]), model.body_pos[body].copy())
        carrier[body], frame[body] = carrier[parent], placement
        if model.body_jntnum[body] > 1:
            raise ModelError(f"{name}: body {model.body(body).name!r} has several joints; give each a body of its own.")
        if model.body_jntnum[body] == 1:
            j = int(model.body_jntadr[body])
            make = {
                mujoco.mjtJoint.mjJNT_HINGE: pin.JointModelRevoluteUnaligned,
                mujoco.mjtJoint.mjJNT_SLIDE: pin.JointModelPrismaticUnaligned,
            }.get(mujoco.mjtJoint(model.jnt_type[j]))
            if make is None:
                raise ModelError(f"{name}: joint {model.joint(j).name!r} is neither a hinge nor a slide.")
            anchor = pin.SE3(np.eye(3), model.jnt_pos[j].copy())
            axis = model.jnt_axis[j].copy()
            joint = built.addJoint(carrier[parent], make(axis), placement * anchor, model.joint(j).name)
            built.armature[built.joints[joint].idx_v] = model.dof_armature[model.jnt_dofadr[j]]
            carrier[body], frame[body] = joint, anchor.inverse()
        R = _rotation(model.body_iquat[body])
        inertia = pin.Inertia(
            float(model.body_mass[body]), model.body_ipos[body].copy(), R @ np.diag(model.body_inertia[body]) @ R.T
        )
        built.appendBodyToJoint(carrier[body], inertia, frame[body])
    mass = sum(inertia.mass for inertia in built.inertias)
    if (built.nq, built.nv) != (model.nq, model.nv) or abs(mass - model.body_mass.sum()) > 1e-12 * mass:
        raise ModelError(
            f"{name}: Pinocchio's copy has nq {built.nq}, nv {built.nv}, {mass:.6g} kg, MuJoCo's nq {model.nq}, "
            f"nv {model.nv}, {model.body_mass.sum():.6g} kg."
        )
    return built


def _rotation(quaternion: Array) -> Array:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def import_pinocchio() -> Any:
    """Pinocchio.

    Raises:
        MissingPackageError: it is not installed.
    """
    with required("Pinocchio", "crosscheck"):
        import pinocchio
    return pinocchio
