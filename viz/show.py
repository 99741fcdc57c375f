"""What one viewer shows: the feet, their scene, and answers to the page's settings. Knows nothing of sockets."""

from collections.abc import Mapping
from dataclasses import replace
from math import degrees
from typing import Any

import mujoco
import numpy as np

import mjcf
from fasbody.arch import Arch
from fasbody.exceptions import FasError, SettingError
from fasbody.model import Foot, check, load
from viz import assets, scene
from viz.bones import SEGMENTS
from viz.excitation import Excitation
from viz.hub import Hub
from viz.motion import CARRIERS, CURVE, Motion, Settings, displacement, periodic_motion, transient_motion
from viz.rest import Carried, Frame, carried, frames, segment_bodies

#: Names of the feet in the scene: the model, the one it is compared with, and what was measured.
MODEL, OTHER, MEASURED = "a", "b", "measured"


def load_foot(name: str) -> Foot:
    """A model by name or file; ``foot_arch@25`` is the arch with its bones spread to a rest height of 25 mm.

    Raises:
        InputFileError: no such model. ModelError: the model has no such arch. SettingError: the height is no number.
    """
    model, at, height = name.partition("@")
    if not at:
        return load(model)
    try:
        metres = 1e-3 * float(height)
    except ValueError:
        raise SettingError(f"{name}: the arch height {height!r} is no number in mm, such as foot_arch@25.") from None
    foot = load(model)
    arch = Arch.from_model(foot.model, name).with_height(metres)
    file = str(mjcf.path(model)) if model in mjcf.names() else model
    spec = mujoco.MjSpec.from_file(file)
    turns = {
        "calcaneus_talus": -arch.theta_10, "navicular": arch.theta_10 + arch.theta_20,
        "cuneiforms": arch.theta_30 - arch.theta_20, "metatarsals": arch.theta_40 - arch.theta_30,
    }  # fmt: skip
    for body, angle in turns.items():
        spec.body(body).alt.euler = [0, 0, degrees(angle) if spec.compiler.degree else angle]
    spec.body("apex").pos = [0, arch.height_0, 0]
    heel = -arch.L_1 * np.sin(arch.theta_10)
    for site, x in (("heel_ground", heel), ("forefoot_ground", heel + arch.l_0)):
        spec.site(site).pos = [x, *spec.site(site).pos[1:]]
    return check(spec.compile(), name)


class Show:
    """The feet of one viewer, their scene, and the answers to its pages.

    Args:
        models: one model, or two to compare, by name or file.
        excitation: of the base. settings: at the start. look: `slow` and `amplify`, times.
    """

    page = "foot.html"

    def __init__(
        self, models: list[str], excitation: Excitation | None = None, settings: Settings | None = None,
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
        self.feet = {name: load_foot(model) for name, model in zip((MODEL, OTHER), models, strict=False)}
        for name in self.feet:
            self._place(name)
        if self.excitation.recording is not None:
            self._place(MEASURED)
        for name in self.settings.values:
            self.feet[MODEL].parameters[name]  # refuses an unknown one

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

    def reload(self) -> None:
        """Load the first model again after its file has changed; a broken one leaves the last good one in place."""
        try:
            fresh = load_foot(self.models[0])
        except FasError as error:
            self.error = str(error)
            raise
        self.error = ""
        now, before = _frames_of_meshes(fresh), _frames_of_meshes(self.feet[MODEL])
        self.feet[MODEL] = fresh
        if now is None or now != before:
            for name in {MODEL, MEASURED} & set(self.drawn):
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
                    "name": p.name, "unit": p.unit, "lower": p.lower, "upper": p.upper, "source": p.source,
                    "nominal": values[p.name], "value": given.values.get(p.name, values[p.name]),
                    "logarithmic": p.logarithmic,
                }
                for p in foot.parameters.values()
            ],
            "settings": {
                "frequency": given.frequency, "peak_to_peak": given.peak_to_peak, "added_mass": given.added_mass,
            },
            "can_add_mass": any(name in foot.parameters for name in CARRIERS),
            "periodic": self.excitation.base is None,
            "excitation": self.excitation.base.name if self.excitation.base else "sine",
            "curve_hz": CURVE.round(3).tolist(),
            "look": self.look,
            "error": self.error,
        }  # fmt: skip

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
        shown = {}
        for name, foot in self.feet.items():
            own = settings if name == MODEL else replace(settings, values=_known(foot, settings.values))
            base = self.excitation.base
            shown[name] = periodic_motion(foot, own) if base is None else transient_motion(foot, own, base)
        return shown

    def answer(self, settings: Settings) -> dict[str, Any]:
        """The motions as one document for the page."""
        motions = self.motions(settings)
        document = {name: _document(motion) for name, motion in motions.items()}
        if self.excitation.recording is not None:
            document[MEASURED] = self._measured(motions[MODEL], document[MODEL])
        return {"type": "motion", "feet": document}

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


def _known(foot: Foot, values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if name in foot.parameters}


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
