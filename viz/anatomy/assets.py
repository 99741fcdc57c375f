"""The files of the foot's meshes: `mjcf/assets/anatomy.npz` for the browser, and skins (.skn) of MuJoCo.

Two forms of the same meshes; skins bend with the bodies of an edited model too. The frame is the models': metres, x
towards the toes, y up, z to the right.
"""

import io
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import mjcf
from fasbody.console import write_whole
from viz.anatomy import bones
from viz.anatomy.rest import SEGMENT_BODIES, Frame, segment_frames

Array = np.ndarray

#: Groups of one MuJoCo skin each.
TISSUES = {"bone": None, "pad": ("heel_pad", "forefoot_pad"), "aponeurosis": ("aponeurosis",), "skin": ("skin",)}
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
        weights: (n, segments) share of each of `bones.SEGMENTS` in the motion of a vertex; each row
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
        return bones.SEGMENTS[int(one[0])] if rigid else None


def colour(code: str) -> Array:
    """SRGB (3,) in 0 to 1 of ``#rrggbb``."""
    return np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255


def pack(parts: list[Part]) -> bytes:
    """The browser's file: integers only, no pickle."""
    arrays: dict[str, Array] = {"names": np.array([part.name for part in parts])}
    for part in parts:
        arrays[f"{part.name}.vertices"] = np.round(part.vertices / GRAIN).astype(np.int16)
        arrays[f"{part.name}.normals"] = np.round(127 * part.normals).astype(np.int8)
        arrays[f"{part.name}.faces"] = part.faces.astype(np.uint16)
        arrays[f"{part.name}.colours"] = np.round(255 * part.colours).astype(np.uint8)
        arrays[f"{part.name}.weights"] = np.round(255 * part.weights).astype(np.uint8)
    file = io.BytesIO()
    np.savez_compressed(file, allow_pickle=False, **arrays)
    return file.getvalue()


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


def skin_file(parts: list[Part], bodies: dict[str, str], frames: dict[str, Frame]) -> bytes:
    """MuJoCo's skin format: vertices and faces, then each body with its bind pose, vertices and weights.

    Args:
        parts: drawn as one skin.
        bodies: segment -> body of the model.
        frames: bind pose of each body.
    """
    vertices = np.vstack([part.vertices for part in parts]).astype("<f4")
    offset = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.vstack([part.faces + o for part, o in zip(parts, offset, strict=False)]).astype("<i4")
    weights = np.vstack([part.weights for part in parts])
    used = list(dict.fromkeys(bodies.values()))
    owners = np.array([bodies[segment] for segment in bones.SEGMENTS])
    by_body = {body: weights[:, owners == body].sum(1) for body in used}
    body_rows = {body: np.flatnonzero(share > 0.004) for body, share in by_body.items()}
    body_rows = {body: rows for body, rows in body_rows.items() if rows.size}
    out = struct.pack("<4i", len(vertices), 0, len(faces), len(body_rows)) + vertices.tobytes() + faces.tobytes()
    for body, rows in body_rows.items():
        frame = frames[body]
        out += body.encode().ljust(40, b"\0") + np.array([*frame.position, *frame.quaternion], "<f4").tobytes()
        out += struct.pack("<i", rows.size) + rows.astype("<i4").tobytes() + by_body[body][rows].astype("<f4").tobytes()
    return out


def write(parts: list[Part], folder: Path) -> list[Path]:
    """Write the browser's file and one skin a tissue and shipped model."""
    written = [write_whole(folder / "anatomy.npz", pack(parts))]
    for model, bodies in SEGMENT_BODIES.items():
        frames = segment_frames(model)
        for tissue_name, names in TISSUES.items():
            chosen = [p for p in parts if (p.segment is not None if names is None else p.name in names)]
            written.append(write_whole(folder / f"{model}_{tissue_name}.skn", skin_file(chosen, bodies, frames)))
    return written
