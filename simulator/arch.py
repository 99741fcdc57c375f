"""Random poses of the arch, and its model with other constants."""

import copy
from dataclasses import replace

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.mjcf import BRANCH, FASCIA, PADS, SPRUNG
from fasbody.foot.damper import DAMPER
from fasbody.foot.model import Foot


def poses(arch: Arch, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random closed poses within 0.3 rad of rest and rates up to 5 rad/s, each of shape (count, 6)."""
    low, high = np.array([-0.01, -0.01, -0.3, -0.3, -0.3, -0.002]), np.array([0.01, 0.01, 0.3, 0.3, 0.3, 0.002])
    q = rng.uniform(low, high, (count, 6))
    q[:, 2:5] += [arch.theta_20, arch.theta_30, arch.theta_40]
    return q, rng.uniform(-5, 5, (count, 6))


def with_constants(foot: Foot, arch: Arch) -> Foot:
    """A copy of the foot with the 13 spring and damper constants of `arch`, its geometry and masses kept.

    Args:
        foot: foot_arch or an edited copy.
        arch: whose constants it gets.
    """
    model = copy.copy(foot.model)
    for symbol, joint in SPRUNG.items():
        j, c = model.joint(joint).id, getattr(arch, f"c_{symbol}")
        model.jnt_stiffness[j] = getattr(arch, f"k_{symbol}")
        model.dof_damping[model.joint(joint).dofadr[0]] = c
        model.jnt_user[j, :4] = (DAMPER, c, 0, 0)
    for pad in PADS:
        t = model.tendon(pad).id
        model.tendon_stiffness[t], model.tendon_damping[t] = arch.k_F / 2, arch.c_F / 2
        model.tendon_user[t, :4] = (DAMPER, arch.c_F / 2, 0, 0)
    model.tendon_stiffness[model.tendon(FASCIA).id] = arch.k_11
    branch = model.actuator(BRANCH).id
    model.actuator_gainprm[branch, 0], model.actuator_dynprm[branch, 0] = 1 / arch.c_1, arch.c_1 / arch.k_12
    return replace(foot, model=model)
