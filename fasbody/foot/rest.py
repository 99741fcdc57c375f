"""The pose in which a foot stands: gravity and springs that pull at rest are balanced, the table held."""

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.steady_state import Balance, check_dampers


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
