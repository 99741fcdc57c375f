"""What the tests of misprints in Chapter 4 share: one random arch, entry by entry comparison, one constant alone."""

from dataclasses import replace

import numpy as np

from fasbody.arch.bones import DAMPERS, SPRINGS, Arch
from fasbody.arch.kinematics import rest
from simulator.arch import poses

ARCH = Arch.draw(np.random.default_rng(0))
REST = rest(ARCH)
POSE = poses(ARCH, np.random.default_rng(1), 1)[0][0]
UNIT = np.eye(6)


def differing(ours: np.ndarray, right: np.ndarray) -> set[tuple[int, ...]]:
    """Places, from 1, at which two arrays differ by more than rounding."""
    wrong = np.abs(ours - right) > 1e-9 * np.abs(right).max()
    return {tuple(int(i) + 1 for i in place) for place in np.argwhere(wrong)}


def only(name: str) -> Arch:
    """ARCH with one of the 13 constants left (c_1 cannot be zero, so it is made negligible)."""
    others = dict.fromkeys(SPRINGS + DAMPERS, 0.0) | {"c_1": 1e-300}
    return replace(ARCH, **others | {name: getattr(ARCH, name)})
