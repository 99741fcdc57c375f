"""The meshes as files in two forms: `anatomy.npz` for the browser, and skins (.skn) on the bodies of a MuJoCo model."""

import io
import struct
from pathlib import Path

import numpy as np

from fasbody.console import write_whole
from viz.anatomy.assets import GRAIN, Array, Part
from viz.anatomy.rest import SEGMENT_BODIES, SEGMENTS, Frame, segment_frames

#: Groups of one MuJoCo skin each.
TISSUES = {"bone": None, "pad": ("heel_pad", "forefoot_pad"), "aponeurosis": ("aponeurosis",), "skin": ("skin",)}


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
    owners = np.array([bodies[segment] for segment in SEGMENTS])
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
