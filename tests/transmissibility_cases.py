"""A recording whose transmissibilities are known, and a small virtual study."""

from pathlib import Path

import numpy as np

from fasbody.laboratory.study import Plan, make
from fasbody.recording.recording import Condition, Recording

KEYS = {
    "file", "subject", "posture", "added_mass_kg", "frequency_hz", "pair", "transmissibility", "transmissibility_std",
    "phase_deg", "phase_std_deg", "transmissibility_peak_to_peak", "method", "distortion_std", "resolution_bias",
}  # fmt: skip


def recording(f: float = 20.0, seed: int = 0, noise: float = 0.02, second: float = 0.2, n: int = 10_000) -> Recording:
    """Known MB 1.3 at -40 degrees, TB 1.1 at -75 degrees; n ms, noise and second harmonic as shares."""
    t, rng = np.arange(n) / 1000, np.random.default_rng(seed)
    turn = 8.95 * np.exp(2j * np.pi * f * t + 1j)
    H = {"base": 1.0, "malleolus": 1.3 * np.exp(-1j * np.radians(40)), "tuberosity": 1.1 * np.exp(-1j * np.radians(75))}
    channels = {
        f"{name}_m_s2": (h * turn).real
        + (second * abs(h) * turn**2 / 8.95).real * (name != "base")
        + noise * 8.95 * rng.normal(size=t.size)
        for name, h in H.items()
    }
    return Recording(t, **channels, condition=Condition("7", "midstance", 2.3, 70.0, f), file=f"{f:g}.csv")


def virtual_study(folder: Path, subjects: int) -> Path:
    """Virtual subjects under every condition of Chapter 2, 1 s each."""
    return make(folder / "study", Plan(subjects=subjects, seconds=1.0, file_format="h5"), processes=1)
