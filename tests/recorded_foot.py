"""Recordings of the linear two-mass foot for the tests of the black box."""

import linear_foot as foot
import numpy as np

from identification.blackbox.data import Series


def record(base: np.ndarray, seed: int = 0, noise: float = 0.25, name: str = "foot") -> Series:
    """The foot's answer to `base` with white noise."""
    e = noise * np.random.default_rng(seed).standard_normal(len(base))
    return Series(base, foot.linear_output(base) + e, foot.SAMPLE_TIME, name)
