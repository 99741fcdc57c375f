"""Random poses of the arch."""

import numpy as np

from fasbody.arch.bones import Arch


def poses(arch: Arch, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random closed poses within 0.3 rad of rest and rates up to 5 rad/s, each of shape (count, 6)."""
    low, high = np.array([-0.01, -0.01, -0.3, -0.3, -0.3, -0.002]), np.array([0.01, 0.01, 0.3, 0.3, 0.3, 0.002])
    q = rng.uniform(low, high, (count, 6))
    q[:, 2:5] += [arch.theta_20, arch.theta_30, arch.theta_40]
    return q, rng.uniform(-5, 5, (count, 6))
