"""The mode shapes of a cell, or of any elastic body, as `fasbody.cell` wrote them, and the scene that shows them."""

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.exceptions import FasError, InputFileError, SettingError
from viz import scene
from viz.scene import Hub
from viz.settings import Settings

Array = np.ndarray

#: Longest extent of the cell in the scene, in scene units.
SIZE = 2.6
#: Share of the height below which a corner belongs to the clamped base.
BASE = 1e-3
SOURCE = "give the folder of fasbody cell --out FOLDER, or of its command modes, or the .npz in it"
#: Files of a result: of a cell, and of any other body.
FILES = ("cell.npz", "body.npz")
#: Length units of a body's page: name, micrometres, up to which size it is used [um].
UNITS = (("µm", 1.0, 2e3), ("mm", 1e3, 2e6), ("m", 1e6, float("inf")))


@dataclass(frozen=True, eq=False)
class ModeShapes:
    """What the page draws.

    Args:
        file: where it was read.
        vertices_um: (v, 3), y up.
        faces: (f, 3) of the outer surface.
        nucleus_faces: (g, 3).
        modes: (c, v, 3), largest displacement 1.
        frequencies_hz: (c,).
        document: of ``fasbody cell --json``.
    """

    file: Path
    vertices_um: Array
    faces: Array
    nucleus_faces: Array
    modes: Array
    frequencies_hz: Array
    document: dict[str, Any]

    @classmethod
    def read(cls, result: Path) -> "ModeShapes":
        """Read a result folder, or the file in it.

        Raises:
            InputFileError: there is none, or it is not such a result.
        """
        present = [result / name for name in FILES if (result / name).is_file()]
        file = (present or [result / FILES[0]])[0] if result.is_dir() else result
        if not file.is_file():
            raise InputFileError(file, "there is no such file", SOURCE)
        names = ("vertices_um", "faces", "nucleus_faces", "modes", "frequencies_hz")
        try:
            with file.open("rb") as opened, np.load(opened, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in names}
                shapes = cls(file, **arrays, document=json.loads(str(stored["document"])))
            labels = [mode["label"] for mode in shapes.document["modes"]]
        except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile):
            raise InputFileError(file, "is not a result of the cell", SOURCE) from None
        if not shapes._sound(len(labels)):
            raise InputFileError(file, "holds numbers that do not fit together", "write it again")
        return shapes

    def _sound(self, labels: int) -> bool:
        v, c = len(self.vertices_um), len(self.frequencies_hz)
        corners = np.concatenate([self.faces.ravel(), self.nucleus_faces.ravel()])
        return (
            c == labels > 0
            and self.vertices_um.shape == (v, 3)
            and self.modes.shape == (c, v, 3)
            and self.faces.shape == (len(self.faces), 3)
            and self.nucleus_faces.shape == (len(self.nucleus_faces), 3)
            and len(self.faces) > 0
            and bool((corners >= 0).all() and (corners < v).all())
            and all(np.isfinite(a).all() for a in (self.vertices_um, self.modes, self.frequencies_hz))
            and bool((self.frequencies_hz > 0).all() and np.ptp(self.vertices_um, axis=0).all())
        )

    @property
    def body(self) -> str:
        """Name of the body; empty for a cell, which stands on its dish and may have a nucleus."""
        return Path(str(self.document.get("body", ""))).name

    @property
    def stands(self) -> bool:
        """Whether its lowest plane is clamped."""
        return not self.body or self.document.get("support") == "base"

    @property
    def unit(self) -> tuple[str, float]:
        """The unit of lengths on the page, and its micrometres."""
        size = np.ptp(self.vertices_um, axis=0).max()
        return next((name, um) for name, um, most in UNITS if size <= most)

    @property
    def scale(self) -> float:
        """Scene units in a micrometre."""
        return float(SIZE / np.ptp(self.vertices_um, axis=0).max())

    def parts(self) -> dict[str, tuple[Array, Array, Array]]:
        """Vertices (p, 3) in the scene, triangles and modes (c, p, 3) of free wall, clamped base and nucleus.

        Wall and base share no vertices, so that their normals differ at the rim.
        """
        low, high = self.vertices_um.min(axis=0), self.vertices_um.max(axis=0)
        origin = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
        on_base = (self.vertices_um[:, 1] < low[1] + BASE * (high[1] - low[1]))[self.faces].all(axis=1) & self.stands
        surfaces = {"wall": self.faces[~on_base], "base": self.faces[on_base], "nucleus": self.nucleus_faces}
        parts = {}
        for name, faces in surfaces.items():
            used, renumbered = np.unique(faces, return_inverse=True)
            corners = self.scale * (self.vertices_um[used] - origin)
            parts[name] = (corners, renumbered.reshape(-1, 3), self.modes[:, used])
        return {name: part for name, part in parts.items() if len(part[1])}

    def title(self) -> str:
        """Cell or body in one line."""
        d, size = self.document, self.document.get("shape_um")
        if self.body:
            name, um = self.unit
            lengths = " × ".join(f"{x:.3g}" for x in np.ptp(self.vertices_um, axis=0) / um)
            held = {"free": "free", "base": "held at its base"}.get(str(d.get("support")), "held at a region")
            return f"{self.body}, {lengths} {name}, {held}"
        body = " × ".join(f"{x:g}" for x in size) + " µm" if size else "own mesh"
        return f"{body}, {d['modulus_pa']:g} Pa, preset {d['preset']}" if "modulus_pa" in d and "preset" in d else body


class ModeShow:
    """The cell or body of one viewer: its scene and the description that its pages get.

    Args:
        result: folder or file of the result.
        mode: shown first, from 1.

    Raises:
        InputFileError: no such result. SettingError: no such mode.
    """

    page = "cell.html"

    def __init__(self, result: Path, mode: int = 1) -> None:
        self.shapes = ModeShapes.read(result)
        count = len(self.shapes.frequencies_hz)
        if not 1 <= mode <= count:
            raise SettingError(f"--mode is {mode}, but the result holds the modes 1 to {count}.")
        self.mode = mode
        self.error = ""
        self.hub = Hub()
        self._visualizer = scene.stage(self.hub, "cell")
        self._place()

    def _place(self) -> None:
        for name in ("base", "nucleus", "dish"):  # the next result may have none
            self.hub.put({"type": "delete", "path": f"/meshcat/cell/{name}"})
        scene.add_cell(self.hub, self._visualizer, self.shapes.parts(), self.shapes.stands)

    def description(self) -> dict[str, Any]:
        """Frequencies, words and sizes."""
        shapes = self.shapes
        errors = shapes.document.get("estimated_error") or [None] * len(shapes.frequencies_hz)
        along = "along " if shapes.body else ""  # of a cell the label says what the mode is
        return {
            "type": "model",
            "title": shapes.title(),
            "parts": list(shapes.parts()),
            "modes": [
                {
                    "hz": float(hz),
                    "error": error,
                    "label": along + mode["label"],
                    "nucleus_share": mode.get("nucleus_share"),
                }
                for hz, error, mode in zip(shapes.frequencies_hz, errors, shapes.document["modes"], strict=True)
            ],
            "mode": min(self.mode, len(shapes.frequencies_hz)),
            "scale": shapes.scale,
            "body": shapes.body,
            "unit": list(shapes.unit),
            "height_um": float(np.ptp(shapes.vertices_um[:, 1])),
            "error": self.error,
        }

    def answer(self, settings: Settings) -> dict[str, Any]:
        """Nothing is simulated here.

        Raises:
            SettingError: always.
        """
        raise SettingError("the modes of this cell are computed already; run fasbody cell for another one.")

    def exported(self, live: bool = False) -> dict[str, Any]:
        """The document of an exported page."""
        return {"model": self.description()}

    def files(self) -> list[Path]:
        """The file of the result."""
        return [self.shapes.file.resolve()]

    def reload(self) -> None:
        """Read the result again after it has been written again; a broken one leaves the last good one in place."""
        try:
            self.shapes = ModeShapes.read(self.shapes.file)
        except FasError as error:
            self.error = str(error)
            raise
        self.error = ""
        self._place()
