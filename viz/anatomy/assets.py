"""The meshes of the foot as `mjcf/assets/anatomy.npz` has them; `fasbody anatomy` made it, and the skins of MuJoCo.

The frame is the models': metres, x towards the toes, y up, z to the right.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import mjcf
from viz.anatomy.rest import SEGMENTS

Array = np.ndarray

#: Resolution of the stored positions [m].
GRAIN = 1e-5


@dataclass(frozen=True)
class Part:
    """One mesh of the foot, in the frame of the models.

    Attributes:
        name: anatomical name.
        vertices: (n, 3) [m].
        faces: (m, 3).
        normals: (n, 3).
        colours: (n, 3) sRGB, 0 to 1.
        weights: (n, segments) share of each of `rest.SEGMENTS` in the motion of a vertex; each row
            sums to 1.
    """

    name: str
    vertices: Array
    faces: Array
    normals: Array
    colours: Array
    weights: Array

    @property
    def segment(self) -> str | None:
        """The one segment that carries it, None for a soft part."""
        one = np.flatnonzero(self.weights[0] == 1)
        rigid = one.size == 1 and bool(np.all(self.weights[:, one[0]] == 1))
        return SEGMENTS[int(one[0])] if rigid else None


def colour(code: str) -> Array:
    """SRGB (3,) in 0 to 1 of ``#rrggbb``."""
    return np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255


def read(file: Path | None = None) -> list[Part]:
    """The parts as stored in the assets."""
    with np.load(file or mjcf.asset("anatomy.npz"), allow_pickle=False) as data:
        parts = []
        for name in map(str, data["names"]):
            normals, weights = (data[f"{name}.{key}"].astype(float) for key in ("normals", "weights"))
            parts.append(
                Part(
                    name, GRAIN * data[f"{name}.vertices"], data[f"{name}.faces"].astype(np.int64),
                    normals / np.linalg.norm(normals, axis=1, keepdims=True), data[f"{name}.colours"] / 255,
                    weights / weights.sum(1, keepdims=True),
                )
            )  # fmt: skip
    return parts
