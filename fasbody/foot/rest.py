"""The pose in which a foot stands: gravity and springs that pull at rest are balanced, the table held."""

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.damper import DAMPER
from fasbody.foot.model import Foot
from fasbody.foot.steady_state import Balance


def standing(foot: Foot) -> np.ndarray:
    """The pose (nq,) of rest: from the pose of the file, or from where the foot falls to.

    Raises:
        SimulationError: there is none, or a damper is negative there.
    """
    balance = Balance(foot)
    x = balance.rest({})
    if x is None:
        raise SimulationError(f"{foot.name}: nothing carries it: no pose was found in which it rests.")
    q, _ = balance.state(x)
    check_dampers(foot, q[None], foot.model.jnt_user[None])
    return q


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


def check_dampers(foot: Foot, qpos: np.ndarray, laws: np.ndarray) -> None:
    """Refuse poses about which a damper of the law 4.25 drives what it damps: its cosine is below zero there.

    Args:
        foot: the model.
        qpos: (n, nq) of rest, or about which motions go on.
        laws: (n or 1, njnt, 8) of the joints.

    Raises:
        SimulationError: by the joint's name.
    """
    model = foot.model
    for j in np.flatnonzero(model.jnt_user[:, :1] == DAMPER):
        q = model.jnt_qposadr[j]
        stretch, c_3 = np.broadcast_arrays(np.abs(qpos[:, q] - model.qpos_spring[q]), laws[:, j, 3])
        worst = int(np.argmax(c_3 * stretch))
        if c_3[worst] * stretch[worst] > np.pi / 2:
            raise SimulationError(
                f"{foot.name}: joint {model.joint(j).name!r} stands {1e3 * stretch[worst]:.3g} mm from its spring's "
                f"rest, where its damper is negative: c_3 = {c_3[worst]:g} of its law 4.25 allows "
                f"{500 * np.pi / c_3[worst]:.3g} mm. Lower c_3, or what pulls the foot."
            )
