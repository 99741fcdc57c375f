"""What one viewer shows: the feet, their scene, and answers to the page's settings. Knows nothing of sockets."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.exceptions import FasError
from fasbody.foot.model import Foot
from viz import scene
from viz.anatomy import assets
from viz.anatomy.bones import SEGMENTS
from viz.anatomy.rest import Carried, Frame, carried, frames, segment_bodies
from viz.load import files_of, load_foot
from viz.motion import CURVE, Motion, displacement, periodic_motion, transient_motion
from viz.scene import Hub
from viz.settings import CARRIERS, WORDS, Excitation, Settings

#: Names of the feet in the scene: the model, the one it is compared with, and what was measured.
MODEL, OTHER, MEASURED = "a", "b", "measured"


class Show:
    """The feet of one viewer, their scene, and the answers to its pages.

    Args:
        models: one model, or two to compare, by name or file, or loaded.
        excitation: of the base. settings: at the start. look: `slow` and `amplify`, times.
    """

    page = "foot.html"

    def __init__(
        self, models: Sequence[str | Foot], excitation: Excitation | None = None, settings: Settings | None = None,
        look: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        self.models = models
        self.excitation = excitation or Excitation()
        self.settings = settings or Settings()
        self.look = dict(look or {"slow": 20.0, "amplify": 10.0})
        self.error = ""
        self.hub = Hub()
        self._visualizer = scene.stage(self.hub)
        self._parts = assets.read()
        self.feet = self._load()
        for name in self.feet:
            self._place(name)
        if self.excitation.recording is not None:
            self._place(MEASURED)
        for name, foot in self.feet.items():
            self._own(name, self.settings).apply(foot)  # refuses what they cannot have

    def _load(self) -> dict[str, Foot]:
        loaded = (model if isinstance(model, Foot) else load_foot(model) for model in self.models)
        return dict(zip((MODEL, OTHER), loaded, strict=False))

    def _place(self, name: str) -> None:
        model = self.feet.get(name, self.feet[MODEL]).model
        self.hub.put({"type": "delete", "path": f"/meshcat/foot/{name}"})
        segments = carried(model)
        if segments is None:
            scene.add_plain(self._visualizer, name, model)
        else:
            bind = {segment: on.bind for segment, on in segments.items()}
            parts = [part for part in self._parts if name != MEASURED or part.segment == "tibia"]
            scene.add_foot(self.hub, self._visualizer, name, parts, bind, ghost=name != MODEL)

    def exported(self) -> dict[str, Any]:
        """The documents of an exported page."""
        return {"model": self.description(), "motion": self.answer(self.settings)}

    def files(self) -> list[Path]:
        """The files of the models, with what they include."""
        named = [model for model in self.models if isinstance(model, str)]
        return sorted(set().union(*map(files_of, named)))

    def reload(self) -> None:
        """Load the models again after a file has changed; a broken one leaves the last good ones in place."""
        try:
            fresh = self._load()
        except FasError as error:
            self.error = str(error)
            raise
        self.error = ""
        before, self.feet = self.feet, fresh
        for name in self.drawn:
            shown = name if name in fresh else MODEL
            now = _frames_of_meshes(fresh[shown])
            if now is None or now != _frames_of_meshes(before[shown]):
                self._place(name)

    def description(self) -> dict[str, Any]:
        """What a page needs before any motion: the feet, their bodies at rest, the parameters and their bounds."""
        foot = self.feet[MODEL]
        values, given = foot.values(), self.settings
        return {
            "type": "model",
            "feet": {name: self._rest(name) for name in self.drawn},
            "parameters": [
                {
                    "name": p.name, "words": WORDS.get(p.name, ""), "unit": p.unit, "source": p.source,
                    "lower": p.lower, "upper": p.upper,
                    "nominal": values[p.name], "value": given.values.get(p.name, values[p.name]),
                    "logarithmic": p.logarithmic,
                }
                for p in foot.parameters.values()
            ],
            "settings": {
                "frequency": given.frequency, "peak_to_peak": given.peak_to_peak, "added_mass": given.added_mass,
            },
            "can_add_mass": all(any(name in f.parameters for name in CARRIERS) for f in self.feet.values()),
            "periodic": self.excitation.base is None,
            "excitation": self.excitation.base.name if self.excitation.base else "sine",
            "curve_hz": CURVE.round(3).tolist(),
            "look": self.look,
            "error": self.error,
        }  # fmt: skip

    @property
    def models_called(self) -> list[str]:
        """Names of the models, as they were asked for."""
        return [foot.name for foot in self.feet.values()]

    @property
    def drawn(self) -> list[str]:
        """Names of the feet in the scene."""
        return [*self.feet, *([MEASURED] if self.excitation.recording is not None else [])]

    def _rest(self, name: str) -> dict[str, Any]:
        foot = self.feet.get(name, self.feet[MODEL])
        rest, found = frames(foot.model), carried(foot.model)
        bodies = list(rest)[1:]
        title = foot.name if name != MEASURED else f"measured: {self.excitation.recording}"
        answer: dict[str, Any] = {"title": title, "ghost": name != MODEL, "bodies": bodies}
        if found is None:
            own = Frame(np.zeros(3), np.array([1.0, 0, 0, 0]))
            segments = {body: Carried(body, own, rest[body]) for body in bodies}
        else:
            segments = {s: found[s] for s in SEGMENTS if name != MEASURED or s == "tibia"}
        answer["dressed"] = found is not None
        answer["segments"] = [
            {
                "name": segment, "body": bodies.index(on.body),
                "bind": [*on.bind.position.tolist(), *on.bind.quaternion.tolist()],
                "rest": [*on.rest.position.tolist(), *on.rest.quaternion.tolist()],
            }
            for segment, on in segments.items()
        ]  # fmt: skip
        soft = [part.name for part in self._parts if part.segment is None] if found and name != MEASURED else []
        answer["soft"] = [part for part in soft if not (name != MODEL and part == "skin")]
        return answer

    def motions(self, settings: Settings) -> dict[str, Motion]:
        """The motion of every model under these settings.

        Raises:
            SettingError: outside their bounds. SimulationError: unstable.
        """
        shown, base = {}, self.excitation.base
        for name, foot in self.feet.items():
            own = self._own(name, settings)
            shown[name] = periodic_motion(foot, own) if base is None else transient_motion(foot, own, base)
        return shown

    def _own(self, name: str, settings: Settings) -> Settings:
        """A foot's own settings. The other one keeps its own character: its parameters change by as many times as the
        model's do, so that nothing jumps where they differ, and stay within its bounds.
        """
        if name == MODEL:
            return settings
        mine, own = self.feet[MODEL].values(), self.feet[name].values()
        values = {
            p: own[p] * value / mine[p] if mine[p] else own[p] + value
            for p, value in settings.values.items()
            if p in own and p in mine
        }
        return replace(settings, values=values).held(self.feet[name])

    def answer(self, settings: Settings) -> dict[str, Any]:
        """The motions as one document for the page; `held` are parameters that a bound has stopped."""
        wanted, settings = settings, settings.held(self.feet[MODEL])
        motions = self.motions(settings)
        document = {name: _document(motion) for name, motion in motions.items()}
        if self.excitation.recording is not None:
            document[MEASURED] = self._measured(motions[MODEL], document[MODEL])
        held = {p: v for p, v in settings.values.items() if abs(v - wanted.values[p]) > 1e-9 * abs(v)}
        return {"type": "motion", "feet": document, "held": held, "other": self._other_values(settings)}

    def _other_values(self, settings: Settings) -> dict[str, float]:
        """Parameters in which the compared foot differs from the model now."""
        if OTHER not in self.feet:
            return {}
        mine = self.feet[MODEL].values() | dict(settings.values)
        own = self.feet[OTHER].values() | dict(self._own(OTHER, settings).values)
        return {p: own[p] for p in own if p in mine and abs(own[p] - mine[p]) > 1e-6 * abs(mine[p])}

    def _measured(self, model: Motion, document: dict[str, Any]) -> dict[str, Any]:
        """The model's foot with its lower leg where the accelerometer says."""
        recording = self.excitation.recording
        assert recording is not None
        time = recording.time_s - recording.time_s[0]
        measured = np.interp(model.time, time, recording.malleolus_m_s2)
        lift = displacement(measured, model.duration)
        bodies = model.bodies.copy()
        found = segment_bodies(self.feet[MODEL].model)
        if found is not None:
            bodies[:, list(model.names).index(found[1]["tibia"]), 1] = lift
        return document | {"bodies": _flat(bodies, 7), "malleolus": _flat(measured, 4), "loops": {}}


def _frames_of_meshes(foot: Foot) -> dict[str, list[float]] | None:
    """Where a foot's meshes are made, by segment; None for a foot that is drawn by its geoms."""
    segments = carried(foot.model)
    if segments is None:
        return None
    return {segment: on.bind.position.round(9).tolist() for segment, on in segments.items()}


def _flat(values: np.ndarray, digits: int) -> list[float]:
    return np.round(values, digits).ravel().tolist()


def _document(motion: Motion) -> dict[str, Any]:
    return {
        "frames": len(motion.time), "duration": motion.duration, "periodic": motion.periodic,
        "bodies": _flat(motion.bodies, 8), "base": _flat(motion.base, 4), "malleolus": _flat(motion.malleolus, 4),
        "loops": {label: {"x": _flat(x, 9), "force": _flat(force, 4)} for label, (x, force) in motion.loops.items()},
        "transmissibility": _flat(np.abs(motion.transmissibility), 4),
        "ratio": motion.ratio, "phase": motion.phase,
    }  # fmt: skip
