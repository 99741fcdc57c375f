"""One closed cycle of a foot on the shaker: loops of its parts, energies, and whether they balance."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import resample

#: Points of a stored loop.
POINTS = 48


@dataclass(frozen=True, eq=False)
class Loop:
    """Displacement (n,) [m] (extension positive), force (n,) [N] and dissipated energy [J] of one part in one cycle."""

    displacement_m: np.ndarray
    force_n: np.ndarray
    dissipated_j: float

    def document(self, points: bool) -> dict[str, Any]:
        """As plain data, with `POINTS` points of the loop or without them."""
        if not points:
            return {"dissipated_j": self.dissipated_j}
        curves = {"displacement_m": self.displacement_m, "force_n": self.force_n}
        return {k: short(resample(v, POINTS)) for k, v in curves.items()} | {"dissipated_j": self.dissipated_j}


@dataclass(frozen=True, eq=False)
class Cycle:
    """One closed cycle.

    Attributes:
        ankle, fat_pad: their loops. dissipated_j: by the whole model, which may have other dampers.
        shaker_work_j: by the base on the foot. malleolus_m_s2: (n,) its acceleration.
    """

    ankle: Loop
    fat_pad: Loop
    dissipated_j: float
    shaker_work_j: float
    malleolus_m_s2: np.ndarray

    @property
    def imbalance(self) -> float:
        """Share of the shaker's work that the dampers do not account for."""
        return (self.shaker_work_j - self.dissipated_j) / self.shaker_work_j

    def __str__(self) -> str:
        return (
            f"ankle {1e3 * self.ankle.dissipated_j:.3g} mJ, fat pad {1e3 * self.fat_pad.dissipated_j:.3g} mJ a cycle, "
            f"imbalance {100 * self.imbalance:.2g} %"
        )


def short(values: np.ndarray) -> list[float]:
    """As a list of numbers of six digits: a thousandth of a line's width, and half the file."""
    return [float(f"{v:.6g}") for v in values]
