"""A point fixed to the shank, seen by two markers: into the shank's frame and back.

The frame has its origin in the lower marker and its z axis through the upper one; it does not turn about that axis
(its y axis stays in the plane of progression), as two markers cannot show that. Baines, Schwab and van Soest (2018),
Fig. 1.
"""

import numpy as np


def frames(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) from the shank's frame into the plate's; NaN where a marker is hidden.

    Args:
        lower, upper: (n, 3) positions [m], z up.
    """
    from scipy.spatial.transform import Rotation

    along = upper - lower
    with np.errstate(invalid="ignore", divide="ignore"):
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        psi = np.arcsin(along[:, 0])  # about y
        phi = np.arctan2(-along[:, 1], along[:, 2])  # about x
    return Rotation.from_euler("XY", np.column_stack([phi, psi])).as_matrix()


def into(point: np.ndarray, lower: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Points (n, 3) [m] of the plate's frame, in the shank's."""
    return np.einsum("nji,nj->ni", rotations, point - lower)


def out_of(local: np.ndarray, lower: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Path (n, 3) [m] in the plate's frame of a point (3,) that is fixed in the shank's."""
    return lower + rotations @ local
