"""What one viewer shows: the feet, their scene, and motions for the page's settings. The network is in server.py."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.exceptions import FasError, SettingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.checks import UNIT_IN_DOUBT, judged, unit_in_doubt
from fasbody.sentences import Sentence
from identification.criteria import fit_percent
from identification.engines.twin import twin_applies
from viz import live as sliders
from viz import scene
from viz.anatomy import assets
from viz.anatomy.rest import SEGMENTS, Carried, ExtraGeoms, Frame, carried, extra_geoms, frames, name_of, reach
from viz.excitation import Excitation
from viz.load import files_of, load_foot
from viz.motion import (
    CURVE,
    FRAMES,
    Motion,
    periodic_motion,
    still_wanted,
    transient_motion,
    watched,
    without_drift,
)
from viz.scene import Hub
from viz.settings import WORDS, Settings, can_add_mass

#: Names of the feet in the scene: the model, the one it is compared with, and what was measured.
MODEL, OTHER, MEASURED = "a", "b", "measured"
#: Colours of the rings at the malleolus: the model's, and the measured one.
RINGS = {MODEL: "#ffb454", OTHER: "#6cb6ff", MEASURED: "#7ee0a1"}
#: Half the height of the slice of the shank that a ring goes around, its gap to that, and its thickness [m].
SLICE, GAP, THICK = 0.004, 0.006, 0.0022
_STILL = Frame(np.zeros(3), np.array([1.0, 0, 0, 0]))


class Show:
    """The feet of one viewer, their scene, and their motions for its pages.

    Args:
        models: one model, or two to compare, by name or file, or loaded.
        excitation: of the base.
        settings: at the start.
        look: the factors `slow` and `amplify`; `amplify` None for as much as shows the deformation and
            keeps the foot in the picture.
        fit: what a fit found (`viz.fitted`).
    """

    page = "foot.html"

    def __init__(
        self, models: Sequence[str | Foot], excitation: Excitation | None = None, settings: Settings | None = None,
        look: Mapping[str, float | None] | None = None, fit: Mapping[str, Any] | None = None,
    ) -> None:  # fmt: skip
        self.models = list(models)
        self.look = {"slow": 20.0, "amplify": None} | dict(look or {})
        self.fit = dict(fit or {})
        self.error = ""
        self.hub = Hub()
        self._visualizer = scene.stage(self.hub)
        self._parts = assets.read()
        self._placed: dict[str, Any] = {}
        self._loaded = self._load()
        self.settings = settings or Settings()
        self.drive(excitation or Excitation(), self.settings)
        for name, foot in self.feet.items():
            self._settings_of(name, self.settings).apply(foot)  # refuses what they cannot have

    def _load(self) -> dict[str, Foot]:
        loaded = (model if isinstance(model, Foot) else load_foot(model) for model in self.models)
        return dict(zip((MODEL, OTHER), loaded, strict=False))

    def drive(self, excitation: Excitation, settings: Settings | None = None) -> None:
        """Shake the feet by something else; a recording brings the masses that it was made with."""
        self.excitation = excitation
        recording = excitation.recording
        if settings is None:
            load = recording.condition.added_mass_kg if recording and recording.condition.body_mass_kg else 0.0
            settings = replace(self.settings, added_mass=load)
        if excitation.steady is not None:
            settings = replace(settings, frequency=excitation.steady.frequency_hz)
        self.settings = settings
        self.feet = {name: self._weighed(foot) for name, foot in self._loaded.items()}
        for name in [*self._placed]:
            if name not in self.drawn:
                self.hub.put({"type": "delete", "path": f"/meshcat/foot/{name}"})
                del self._placed[name]
        for name in self.drawn:
            self._place(name)

    def _weighed(self, foot: Foot) -> Foot:
        """The foot of the person who was recorded, without the load; as it is where nothing is known of them."""
        recording = self.excitation.recording
        if recording is None:
            return foot
        masses = replace(recording.condition, added_mass_kg=0.0).masses
        return foot.with_values({name: masses[name] for name in masses if name in foot.parameters})

    def _place(self, name: str) -> None:
        """Put a foot into the scene, unless it is there as it should be."""
        model = self.feet.get(name, self.feet[MODEL]).model
        segments, mine = carried(model), extra_geoms(model)
        recorded = self.excitation.recording is not None
        looks = (
            None if segments is None else {s: on.bind.position.round(9).tolist() for s, on in segments.items()},
            [(name_of(model, model.geom_bodyid[i]), model.geom_type[i], *np.concatenate(
                [model.geom_size[i], model.geom_pos[i], model.geom_quat[i], model.geom_rgba[i]]).round(9))
             for i in mine.geoms],
            {body: rgb.round(6).tolist() for body, rgb in mine.tints.items()}, recorded, "fascia" in watched(model),
        )  # fmt: skip
        if self._placed.get(name) == looks:
            return
        self._placed[name] = looks
        self.hub.put({"type": "delete", "path": f"/meshcat/foot/{name}"})
        if name != MEASURED:
            self._dress(name, model, segments, mine)
        if recorded:
            self._ring(name, segments)

    def _dress(self, name: str, model: Any, segments: Mapping[str, Carried] | None, mine: ExtraGeoms) -> None:
        if segments is not None:
            bind = {segment: on.bind for segment, on in segments.items()}
            tints = {segment: mine.tints[on.body] for segment, on in segments.items() if on.body in mine.tints}
            parts = [part for part in self._parts if part.name in self._soft(name) or part.segment is not None]
            scene.add_foot(self.hub, self._visualizer, name, parts, bind, name != MODEL, tints)
        body = {i: name_of(model, model.geom_bodyid[i]) for i in mine.geoms}
        dressed = segments is not None
        nodes = {i: (f"own {at}" if dressed and at != "world" else at).replace("/", " ") for i, at in body.items()}
        scene.add_geoms(self._visualizer, name, model, nodes)

    def _ring(self, name: str, segments: Mapping[str, Carried] | None) -> None:
        """A ring about the shank at the height of the accelerometer."""
        foot = self.feet.get(name, self.feet[MODEL])
        site = foot.model.site("malleolus")
        centre, radius = np.array(site.pos), 0.04
        shank = None if segments is None else segments["tibia"]
        carrier = frames(foot.model)[self._shank(foot)]
        if shank is not None and np.allclose(shank.rest.quaternion, carrier.quaternion):
            vertices = np.vstack([part.vertices for part in self._parts if part.segment == "tibia"])
            # in the frame of the body with the accelerometer: the shank, or a malleolus below it
            vertices = vertices - shank.bind.position + shank.rest.position - carrier.position
            level = np.abs(vertices[:, 1] - (centre[1] + 0.03)) < SLICE
            if level.any():
                low, high = vertices[level].min(0), vertices[level].max(0)
                centre, radius = 0.5 * (low + high), 0.5 * float(np.max((high - low)[[0, 2]])) + GAP
        thick = THICK if name == MEASURED else 0.5 * THICK
        scene.add_ring(self._visualizer, name, centre, radius, RINGS[name], thick)

    @staticmethod
    def _shank(foot: Foot) -> str:
        return name_of(foot.model, int(foot.model.site("malleolus").bodyid[0]))

    def _soft(self, name: str) -> list[str]:
        """Soft parts that are drawn: the skin of the model alone, and the aponeurosis of a model that has one."""
        fascia = "fascia" in watched(self.feet[name].model)
        return [
            part.name
            for part in self._parts
            if part.segment is None
            and not (part.name == "skin" and name != MODEL)
            and (fascia or part.name != "aponeurosis")
        ]

    def exported(self, live: bool = False) -> dict[str, Any]:
        """The documents of an exported page; `live` with what its sliders need (`viz.live`)."""
        documents = {"model": self.description(), "motion": self.answer(self.settings)}
        if not live:
            return documents
        return documents | {"live": sliders.of(self.feet, self.excitation, self.settings, self.answer)}

    def files(self) -> list[Path]:
        """The files of the models, with what they include."""
        named = [model for model in self.models if isinstance(model, str)]
        return sorted(set().union(*map(files_of, named)))

    def reload(self) -> None:
        """Load the models again after a file has changed; a broken one leaves the last good ones in place."""
        try:
            fresh = self._load()
            self.show(fresh)
        except FasError as error:
            self.error = str(error)
            raise
        self.error = ""

    def show(self, feet: Mapping[str, Foot]) -> None:
        """Show other feet under the same excitation."""
        self._loaded = dict(feet)
        self.drive(self.excitation, self.settings)

    def description(self) -> dict[str, Any]:
        """What a page needs before any motion: the feet, their bodies at rest, the parameters and their bounds."""
        foot = self.feet[MODEL]
        values, settings, recording = foot.values(), self.settings, self.excitation.recording
        return {
            "type": "model",
            "name": str(self.models[0].name if isinstance(self.models[0], Foot) else self.models[0]),
            "quick": twin_applies(foot),
            "feet": {name: self._rest(name) for name in self.drawn},
            "parameters": [
                {
                    "name": p.name, "words": WORDS.get(p.name, ""), "unit": p.unit, "source": p.source,
                    "lower": p.lower, "upper": p.upper,
                    "nominal": values[p.name], "value": settings.values.get(p.name, values[p.name]),
                    "logarithmic": p.logarithmic,
                }
                for p in foot.parameters.values()
            ],
            "settings": {
                "frequency": settings.frequency, "peak_to_peak": settings.peak_to_peak,
                "added_mass": settings.added_mass, "delay_s": settings.delay_s,
            },
            "can_add_mass": can_add_mass(self.feet.values()),
            "periodic": self.excitation.periodic,
            "recorded": recording is not None,
            "excitation": self.excitation.title,
            "about": self._about(),
            "curve_hz": CURVE.round(3).tolist(),
            "look": self.look,
            "fit": self.fit,
            "error": self.error,
        }  # fmt: skip

    def _about(self) -> str:
        excitation = self.excitation
        if excitation.recording is None:
            return ""
        if excitation.steady is not None:
            s = excitation.steady
            return f"mean of {s.periods:.0f} periods at {s.frequency_hz:.4g} Hz; {100 * s.noise:.2g} % is not periodic"
        first, last = excitation.window
        return f"{first:.3g} to {last:.3g} s of it, slower than 3 Hz taken out"

    @property
    def models_called(self) -> list[str]:
        """Names of the models, as they were given."""
        return [foot.name for foot in self.feet.values()]

    @property
    def drawn(self) -> list[str]:
        """Names of the feet in the scene."""
        return [*self.feet, *([MEASURED] if self.excitation.recording is not None else [])]

    def _rest(self, name: str) -> dict[str, Any]:
        foot = self.feet.get(name, self.feet[MODEL])
        rest, bones, mine = frames(foot.model), carried(foot.model), extra_geoms(foot.model)
        bodies, base = list(rest)[1:], name_of(foot.model, int(foot.model.joint("base").bodyid[0]))
        shank = self._shank(foot)
        still = {"ring": Carried(shank, _STILL, rest[shank])} if self.excitation.recording is not None else {}
        if name == MEASURED:  # its two bodies: the table and the accelerometer
            segments, bones, bodies = still, None, [base, shank]
        elif bones is None:
            segments = {body.replace("/", " "): Carried(body, _STILL, rest[body]) for body in bodies} | still
        else:
            segments = {segment: bones[segment] for segment in SEGMENTS}
            worn = {name_of(foot.model, foot.model.geom_bodyid[i]) for i in mine.geoms} - {"world"}
            still |= {f"own {body}".replace("/", " "): Carried(body, _STILL, rest[body]) for body in worn}
        answer: dict[str, Any] = {
            "title": foot.name if name != MEASURED else f"measured: {self.excitation.title}",
            "ghost": name != MODEL, "bodies": bodies, "table": bodies.index(base), "dressed": bones is not None,
            "soft": self._soft(name) if bones else [], "reach": reach(foot.model, mine.geoms),
        }  # fmt: skip
        for kind, group in (("segments", segments), ("worn", still if bones else {})):
            answer[kind] = [
                {
                    "name": segment, "body": bodies.index(on.body),
                    "bind": [*on.bind.position.tolist(), *on.bind.quaternion.tolist()],
                    "rest": [*on.rest.position.tolist(), *on.rest.quaternion.tolist()],
                }
                for segment, on in group.items()
            ]  # fmt: skip
        return answer

    def motions(self, settings: Settings) -> dict[str, Motion]:
        """The motion of every model under these settings.

        Raises:
            SettingError: outside their bounds. SimulationError: unstable.
        """
        try:
            return self._motions(settings)
        except SimulationError as error:
            recording = self.excitation.recording
            doubt = "" if recording is None else unit_in_doubt([judged(recording)["warnings"]])
            if not doubt:
                raise
            text = Sentence(doubt, f" With this unit {self.feet[MODEL].name} cannot be simulated.")
            raise SimulationError(text, code=UNIT_IN_DOUBT) from error

    def _motions(self, settings: Settings) -> dict[str, Motion]:
        motions, excitation = {}, self.excitation
        for name, foot in self.feet.items():
            still_wanted()
            mine = self._settings_of(name, settings)
            if excitation.base is not None:
                motions[name] = transient_motion(foot, mine, excitation.base, excitation.window)
            elif excitation.steady is not None:
                at = replace(mine, frequency=excitation.steady.frequency_hz)
                motions[name] = periodic_motion(foot, at, excitation.steady.base)
            else:
                motions[name] = periodic_motion(foot, mine)
        return motions

    def _settings_of(self, name: str, settings: Settings) -> Settings:
        """Parameters of the compared foot change by the model's factors, within its bounds."""
        if name == MODEL:
            return settings
        mine, other = self.feet[MODEL].values(), self.feet[name].values()
        values = {
            p: other[p] * value / mine[p] if mine[p] else other[p] + value
            for p, value in settings.values.items()
            if p in other and p in mine
        }
        return replace(settings, values=values).held(self.feet[name])

    def answer(self, settings: Settings) -> dict[str, Any]:
        """The motions as one document for the page; `held` are parameters that a bound has stopped."""
        if self.excitation.doubt:
            raise SettingError(self.excitation.doubt)
        asked, settings = settings, settings.held(self.feet[MODEL])
        motions = self.motions(settings)
        document = {name: _document(motion) for name, motion in motions.items()}
        if self.excitation.recording is not None:
            document[MEASURED] = self._measured(motions[MODEL], settings.delay_s)
        held = {p: v for p, v in settings.values.items() if abs(v - asked.values[p]) > 1e-9 * abs(v)}
        return {"type": "motion", "feet": document, "held": held, "other": self._other_values(settings)}

    def _other_values(self, settings: Settings) -> dict[str, float]:
        """Parameters in which the compared foot differs from the model now."""
        if OTHER not in self.feet:
            return {}
        mine = self.feet[MODEL].values() | dict(settings.values)
        other = self.feet[OTHER].values() | dict(self._settings_of(OTHER, settings).values)
        return {p: other[p] for p in other if p in mine and abs(other[p] - mine[p]) > 1e-6 * abs(mine[p])}

    def _measured(self, model: Motion, delay_s: float) -> dict[str, Any]:
        """Table and malleolus as measured, displaced by the same rule as the model's."""
        recording, steady = self.excitation.recording, self.excitation.steady
        assert recording is not None
        bodies = np.zeros((len(model.time), 2, 6))
        bodies[:, 0] = model.bodies[:, list(model.names).index(self._table())]
        answer: dict[str, Any] = {
            "frames": len(model.time), "duration": model.duration, "periodic": model.periodic,
            "base": _flat(model.base, 4), "loops": {}, "ratio": None, "phase": None,
        }  # fmt: skip
        if steady is not None:
            bodies[:, 1, 1] = steady.period(steady.malleolus, FRAMES, -2, delay_s)
            answer["malleolus"] = _flat(steady.period(steady.malleolus, FRAMES, 0, delay_s), 4)
            ratio = steady.ratio(delay_s)
            answer |= {"ratio": abs(ratio), "phase": float(np.degrees(np.angle(ratio)))}
            time, values = self.excitation.folded()
            late = (time - delay_s) % model.duration
            order = np.argsort(late)
            answer["points"] = {"time": _flat(late[order], 7), "malleolus": _flat(values[order], 4)}
            spectrum = np.fft.rfft(model.malleolus) / FRAMES
            turns = np.exp(2j * np.pi * np.outer(late[order] / model.duration, np.arange(1, FRAMES // 2)))
            followed = 2 * (turns @ spectrum[1 : FRAMES // 2]).real
            answer["fit_percent"] = fit_percent(values[order], followed)
        else:
            time = recording.time_s - recording.time_s[0]
            even = np.arange(time[0], time[-1], model.time[1] - model.time[0])
            lift = without_drift(np.interp(even, time, recording.malleolus_m_s2), even[1] - even[0], twice=True)
            bodies[:, 1, 1] = np.interp(model.time + delay_s, even, lift)
            measured = np.interp(model.time + delay_s, time, recording.malleolus_m_s2)
            answer |= {"malleolus": _flat(measured, 4), "fit_percent": fit_percent(measured, model.malleolus)}
        if self.excitation.refused:
            answer["fit_percent"] = None
        return answer | {"bodies": _flat(bodies, 8)}

    def _table(self) -> str:
        model = self.feet[MODEL].model
        return name_of(model, int(model.joint("base").bodyid[0]))


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
