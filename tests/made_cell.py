"""A made-up result of the cell, whose modes are written down in one line, for the tests of its page."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

#: Frequencies of the made-up result [Hz].
HZ = (18.0, 27.0, 2500.0)


def write(folder: Path, **changes: Any) -> Path:
    """A result in the format of `write_browser`: a hemisphere of 40 x 40 x 20 um with a round nucleus, three modes."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20)
    dome = trimesh.Trimesh(np.maximum(ball.vertices, (-20, 0, -20)), ball.faces, process=False)  # flat below
    core = trimesh.creation.icosphere(subdivisions=1, radius=4).apply_translation([0, 6, 0])
    vertices = np.vstack([dome.vertices, core.vertices])
    x, y = vertices[:, 0], vertices[:, 1]
    still = np.zeros_like(y)
    modes = np.array([np.c_[still, still, y / 20], np.c_[y / 20, still, still], np.c_[still, x * y / 400, still]])
    labels = ("z sway", "x sway", "rocking")
    content = {
        "vertices_um": vertices, "faces": dome.faces, "nucleus_faces": core.faces + len(dome.vertices),
        "modes": modes, "frequencies_hz": np.array(HZ),
        "document": json.dumps({
            "preset": "si", "modulus_pa": 100.0, "shape_um": [40.0, 40.0, 20.0], "estimated_error": None,
            "modes": [{"label": label, "nucleus_share": 0.02} for label in labels],
        }),
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / "cell.npz", **(content | changes))
    return folder
