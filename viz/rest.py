"""Which body of a model carries which segment of the foot, and where bodies rest."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

import mjcf

#: Segment of the foot -> body, for the shipped models; edited copies keep the names.
SEGMENT_BODIES: dict[str, dict[str, str]] = {
    "foot_arch": {
        name: name for name in ("calcaneus_talus", "navicular", "cuneiforms", "metatarsals", "tibia", "base")
    },
    "two_dof": {
        **dict.fromkeys(("calcaneus_talus", "navicular", "cuneiforms", "metatarsals"), "foot"),
        "tibia": "shank", "base": "base",
    },
}  # fmt: skip


@dataclass(frozen=True)
class Frame:
    """Position (3,) [m] and quaternion (4,) (w, x, y, z) of a body in the world."""

    position: np.ndarray
    quaternion: np.ndarray


def frames(model: mujoco.MjModel) -> dict[str, Frame]:
    """Rest frame of every body of a compiled model, by name."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    names = [model.body(i).name for i in range(model.nbody)]
    return {name: Frame(data.xpos[i].copy(), data.xquat[i].copy()) for i, name in enumerate(names) if name}


def segment_frames(shipped: str) -> dict[str, Frame]:
    """Rest frames of a shipped model: the pose in which the meshes are made."""
    return frames(mujoco.MjModel.from_xml_path(str(mjcf.path(shipped))))


def segment_bodies(model: mujoco.MjModel) -> tuple[str, Mapping[str, str]] | None:
    """The shipped model whose body names a model has, with segment -> body; None if it has neither's."""
    there = {model.body(i).name for i in range(model.nbody)}
    return next(((name, b) for name, b in SEGMENT_BODIES.items() if set(b.values()) <= there), None)
