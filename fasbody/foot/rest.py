"""The pose in which a foot stands: gravity and springs that pull at rest are balanced, the table held."""

import mujoco
import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.engine import callbacks
from fasbody.foot.model import Foot
from fasbody.foot.model_fields import element_name
from fasbody.foot.steady_state import Balance, check_dampers

#: Growth of a motion from which a pose is unstable, and of what has no mass at the most [1/s].
_TOPPLES, _FASTEST = 0.1, 1e9


def standing(foot: Foot) -> np.ndarray:
    """The pose (nq,) of rest: from the pose of the file, or from where the foot falls to.

    Raises:
        SimulationError: there is none, the foot topples from it, or a damper is negative there.
    """
    balance = Balance(foot)
    x = resting(balance)
    slopes_at_rest(balance, x)
    return balance.state(x)[0]


def resting(balance: Balance) -> np.ndarray:
    """Coordinates and activations (n,) at rest, without the base's.

    Raises:
        SimulationError: there is no such pose.
    """
    x = balance.rest({})
    if x is None:
        loose = balance.loose({})
        raise SimulationError(loose.text if loose else f"{balance.foot.name}: no pose was found in which it rests.")
    return x


def slopes_at_rest(balance: Balance, x: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Derivatives (3, r, n) of the engine's rows about rest, and what is about to touch, stop or slip there.

    Args:
        balance: of the foot, with the parameters at which it rests.
        x: (n,) coordinates and activations at rest, without the base's.

    Raises:
        SimulationError: a damper is negative there; or the foot topples: something grows by more than `_TOPPLES`, and
            nothing is about to touch.
    """
    check_dampers(balance.foot, balance.state(x)[0][None], balance.model.jnt_user[None])
    motion = _at_rest(balance, x)
    with callbacks():
        slopes, kinks = balance.engine.exact_slopes(motion)[:, 0], balance.engine.kinks(motion)
        if not kinks:
            _check_stable(balance, motion, slopes)
    return slopes, kinks


def corners_at_rest(balance: Balance, x: np.ndarray) -> list[str]:
    """Joints about which a spring or damper has no slope at rest (n,); see `Engine.corners`."""
    with callbacks():
        return balance.engine.corners(_at_rest(balance, x))


def _at_rest(balance: Balance, x: np.ndarray) -> np.ndarray:
    """One instant (3, 1, c) of the engine, at rest."""
    motion = np.zeros((3, 1, balance.engine.size))
    motion[0, 0, balance.free] = x
    return motion


def _check_stable(balance: Balance, motion: np.ndarray, slopes: np.ndarray) -> None:
    growth, moves = _growth(balance, slopes)
    if growth <= _TOPPLES:
        return
    model, actuation = balance.model, int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    model.opt.disableflags |= actuation
    alone, _ = _growth(balance, balance.engine.exact_slopes(motion)[:, 0])
    model.opt.disableflags &= ~actuation
    part = f"{balance.foot.name}: it topples about {balance.part(moves)}"
    if alone <= _TOPPLES:
        others = np.flatnonzero(np.abs(model.actuator_ctrladr - balance.foot.shaker - 2) > 2)
        names = " or ".join(element_name(model, "actuator", int(a)) for a in others)
        raise SimulationError(f"{part}: {names} drives it away from rest; lower its gain, or turn its sign.")
    raise SimulationError(
        f"{part}: gravity and springs balance in an unstable pose only; make the joint stiffer than the weight above "
        "it."
    )


def _growth(balance: Balance, slopes: np.ndarray) -> tuple[float, int]:
    """How fast small motion grows at the most [1/s], and the coordinate that then moves most."""
    values, vectors = eigenvalues(slopes[:, balance.free][..., balance.free])
    fastest = int(values.real.argmax())
    return float(values[fastest].real), int(balance.free[np.abs(vectors[: len(balance.free), fastest]).argmax()])


def eigenvalues(slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (k,) [1/s] of K + s C + s^2 M (3, n, n) and their vectors (2 n, k); none of what has no mass."""
    from scipy.linalg import eig

    K, C, M = slopes
    none, one = np.zeros_like(K), np.eye(len(K))
    values, vectors = eig(np.block([[none, one], [-K, -C]]), np.block([[one, none], [none, M]]))
    moves = np.isfinite(values) & (np.abs(values) < _FASTEST)
    return values[moves], vectors[:, moves]


def carrier(foot: Foot) -> str:
    """The joint by which the foot stands on the table, for messages; the base where that is none of its own."""
    model = foot.model
    base = int(model.jnt_bodyid[model.joint("base").id])
    joints = [j for j in range(model.njnt) if model.body_parentid[model.jnt_bodyid[j]] == base]
    named = [model.joint(j).name for j in joints if model.jnt_stiffness[j] > 0]
    return " and ".join(named) or "base"


def mass_on_table(foot: Foot) -> float:
    """Mass [kg] of all that stands on the shaker's table."""
    model = foot.model
    base = int(model.jnt_bodyid[model.joint("base").id])
    return float(sum(model.body_subtreemass[b] for b in range(1, model.nbody) if model.body_parentid[b] == base))
