"""Which body of a model carries which segment of the foot, and where bodies and segments rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

import mjcf

if TYPE_CHECKING:
    import mujoco
    from scipy.spatial.transform import Rotation

#: Height of the table under heel and heads; foot_arch.xml and two_dof.xml have it there too.
TABLE = -20.0
#: Segments of the drawn foot, in the order of the skinning weights; the table comes last. The arch has no joint for
#: toes, which move with its metatarsals but stay level where an edited arch turns those.
SEGMENTS = ("calcaneus_talus", "navicular", "cuneiforms", "metatarsals", "toes", "tibia", "base")

#: Bases and heads of the five metatarsals, great toe first, with the radius of base, shaft and head.
METATARSALS = (
    ((39, -22, 23), (97, -27, 4.5), 12.0, 6.6, 10.3),
    ((35, -7, 30), (103, -9, 3.5), 8.8, 4.4, 7.3),
    ((37, 7, 26), (99, 7, 2.5), 8.2, 4.1, 6.9),
    ((30, 19, 19), (92, 22, 1.5), 7.8, 3.9, 6.6),
    ((25, 31, 11), (83, 35, 1.0), 8.0, 4.1, 6.3),
)

#: Segment of the foot -> body, for the shipped models; edited copies keep the names.
SEGMENT_BODIES: dict[str, dict[str, str]] = {
    "foot_arch": {
        **{name: name for name in ("calcaneus_talus", "navicular", "cuneiforms", "metatarsals", "tibia", "base")},
        "toes": "metatarsals",
    },
    "two_dof": {
        **dict.fromkeys(("calcaneus_talus", "navicular", "cuneiforms", "metatarsals", "toes"), "foot"),
        "tibia": "shank", "base": "base",
    },
}  # fmt: skip

#: Models with the meshes of another one: name -> the other, segment -> body, and the other's body in whose place a
#: body rests. The shank of the mounted arch begins at the apex.
BORROWED: dict[str, tuple[str, dict[str, str], dict[str, str]]] = {
    "mounted_arch": ("foot_arch", SEGMENT_BODIES["foot_arch"] | {"tibia": "shank"}, {"shank": "apex"}),
}

#: Geoms (name, body) of other shipped models that the meshes replace: the lower end of the tibia, in leg.xml.
_MESHED = {("malleolus", "malleolus")}


@dataclass(frozen=True)
class Frame:
    """Position (3,) [m] and quaternion (4,) (w, x, y, z) of a body in the world."""

    position: np.ndarray
    quaternion: np.ndarray


def frames(model: mujoco.MjModel) -> dict[str, Frame]:
    """Rest frame of every body of a compiled model in their order, by name; one without a name has its number."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {name_of(model, i): Frame(data.xpos[i].copy(), data.xquat[i].copy()) for i in range(model.nbody)}


def name_of(model: mujoco.MjModel, body: int) -> str:
    """A body's name, or its number."""
    return str(model.body(body).name) or f"body {body}"


def segment_frames(shipped: str) -> dict[str, Frame]:
    """Rest frames of a shipped model: the pose in which the meshes are made."""
    return frames(_shipped(shipped))


def segment_bodies(model: mujoco.MjModel) -> tuple[str, Mapping[str, str]] | None:
    """The shipped model whose body names a model has, with segment -> body; None if it has neither's."""
    present = {model.body(i).name for i in range(model.nbody)}
    known = SEGMENT_BODIES | {name: bodies for name, (_, bodies, _) in BORROWED.items()}
    return next(((name, b) for name, b in known.items() if set(b.values()) <= present), None)


@dataclass(frozen=True)
class ExtraGeoms:
    """Geoms and colours of an edited model that the shipped meshes do not show.

    Attributes:
        geoms: numbers of the geoms that are no bone of a shipped model.
        tints: body -> RGB (3,) of a bone whose colour was changed.
    """

    geoms: tuple[int, ...]
    tints: Mapping[str, np.ndarray]


def extra_geoms(model: mujoco.MjModel) -> ExtraGeoms:
    """The geoms that the meshes do not replace: all of them where the bodies have other names."""
    match = segment_bodies(model)
    geoms = [
        (i, model.geom(i).name, model.body(model.geom_bodyid[i]).name)
        for i in range(model.ngeom)
        if model.geom_rgba[i, 3] > 0
    ]
    if match is None:
        return ExtraGeoms(tuple(i for i, _, _ in geoms), {})
    shipped = _shipped(match[0])
    known = {
        (shipped.geom(i).name, shipped.body(shipped.geom_bodyid[i]).name): shipped.geom_rgba[i]
        for i in range(shipped.ngeom)
        if shipped.body(shipped.geom_bodyid[i]).name in match[1].values()
    }
    tints = {
        body: model.geom_rgba[i, :3].copy()
        for i, name, body in geoms
        if (name, body) in known and np.abs(known[name, body] - model.geom_rgba[i]).max() > 1e-6
    }
    return ExtraGeoms(tuple(i for i, name, body in geoms if (name, body) not in {*known, *_MESHED}), tints)


def reach(model: mujoco.MjModel, geoms: Sequence[int]) -> list[list[float]]:
    """The box about geoms at rest: lowest and highest place (3,) each [m]; empty without geoms."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turned = data.geom_xmat[list(geoms)].reshape(-1, 3, 3)
    centre, half = np.split(model.geom_aabb[list(geoms)].reshape(-1, 6), 2, axis=1)
    middle = data.geom_xpos[list(geoms)] + np.einsum("nij,nj->ni", turned, centre)
    room = np.einsum("nij,nj->ni", np.abs(turned), half)
    return [(middle - room).min(axis=0).tolist(), (middle + room).max(axis=0).tolist()] if len(geoms) else []


@cache
def _shipped(name: str) -> mujoco.MjModel:
    import mujoco

    return mujoco.MjModel.from_xml_path(str(mjcf.path(name)))


@dataclass(frozen=True)
class Carried:
    """One drawn segment: the body that carries it, the frame its mesh is made in, and where that frame rests."""

    body: str
    bind: Frame
    rest: Frame


def carried(model: mujoco.MjModel) -> dict[str, Carried] | None:
    """Every segment of the foot on a model; None where its bodies have other names.

    Toes keep the attitude of their mesh, so that they stay on the table under an arch that was made flatter: their
    frame is moved by as much as the heads of the metatarsals are, and not turned.
    """
    match = segment_bodies(model)
    if match is None:
        return None
    other, _, place = BORROWED.get(match[0], (match[0], {}, {}))
    made, rest = segment_frames(other), frames(model)
    segments = {name: Carried(body, made[place.get(body, body)], rest[body]) for name, body in match[1].items()}
    toes, heads = segments["toes"], np.mean([head for _, head, *_ in METATARSALS], 0)[[0, 2, 1]] * (1e-3, 1e-3, -1e-3)
    turn = _rotation(toes.rest) * _rotation(toes.bind).inv()
    moved = toes.rest.position + turn.apply(heads - toes.bind.position) - heads
    level = Frame(toes.rest.position - moved, toes.rest.quaternion)
    return segments | {"toes": Carried(toes.body, level, toes.rest)}


def _rotation(frame: Frame) -> Rotation:
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(frame.quaternion, scalar_first=True)
