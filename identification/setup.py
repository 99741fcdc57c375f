"""What a fit is to do: settings, and the recordings, model and constants that they open."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib.metadata import PackageNotFoundError, version
from platform import python_version
from typing import Any

import numpy as np

from fasbody.exceptions import RecordingError, SettingError, unknown
from fasbody.foot.model import Foot
from fasbody.presentation import Tabled
from fasbody.recording.checks import apart, checked, gathered
from fasbody.recording.known import Known
from fasbody.recording.recording import Channel, Recording
from fasbody.sentences import Sentence, called
from identification import branches, sensors, steady
from identification.engines.twin import FOOT, SHANK, carriers
from identification.harmonics import Line
from identification.parameters import MASSES, Space, space_of, without_delay
from identification.residual import Problem
from identification.sensors import MALLEOLUS

_PEOPLE = "The recordings are of {n} people or feet ({names}), and one set of constants is fitted to all of them."
DOMAINS = ("auto", "periodic", "time")
#: Scatter of the fundamental between parts of a recording beyond which it is not steady.
STEADY = 0.05
#: Packages whose versions a reader needs to repeat a fit.
_PACKAGES = ("fasbody", "mujoco", "numpy", "scipy", "numba")


@dataclass(frozen=True)
class Settings(Tabled):
    """How to fit.

    Attributes:
        free: parameters to estimate, None for all the model declares but the masses.
        bounds: name -> (lower, upper), None for the model's own.
        starts: random starts of each side of the mirror in a round of the search (default 12).
        seed: of the random starts (default 0).
        domain: "auto" (default), "periodic" or "time".
        delay: estimate the delay between the channels; None for where it can be told.
        threads: of the search, 0 for all cores (default).
        mass_std: relative standard deviation of the segment masses; None for what study.toml says, or 0.15 and 0.1.
        gain_std: that of the malleolus' gain; None for what study.toml says, or 0.01.
        delay_std_s: that of the delay between the channels [s]; None for what study.toml says, or a tenth of a sample.
        exclude: what cannot be beside the model, of `known.DEPARTURES`, or "all"; nothing unless given.
        sensors: accelerometers to fit, None for all that model and recordings have by the same name.
        departures: include errors of model and sensors; without, the model is assumed exact.
        replay: in the time domain, 0 leaves MuJoCo out where the compiled twin has shown to be the same model.

    In the time domain, steady recordings are explored on their harmonics, and fitted to every sample from there.
    """

    free: tuple[str, ...] | None = None
    bounds: Mapping[str, tuple[float, float]] | None = None
    starts: int = 12
    seed: int = 0
    domain: str = "auto"
    delay: bool | None = None
    threads: int = 0
    mass_std: float | None = None
    gain_std: float | None = None
    delay_std_s: float | None = None
    exclude: tuple[str, ...] = ()
    departures: bool = True
    sensors: tuple[str, ...] | None = None
    replay: int | None = 1


def with_settings(settings: Settings, chosen: Mapping[str, Any]) -> Settings:
    """Settings with some fields given as keywords."""
    known = [field.name for field in fields(Settings)]
    for name in chosen:
        if name not in known:
            raise SettingError(f"{unknown('setting', name, known)}.")
    free = chosen.get("free", settings.free)
    if isinstance(free, str):
        raise SettingError(f'free is {free!r}; give a list of names, for example free=["{free}"].')
    settings = replace(settings, **{**chosen, "free": None if free is None else tuple(free)})
    if isinstance(settings.sensors, str):
        raise SettingError(f'sensors is {settings.sensors!r}; give a list of names, ["malleolus", "foot"] for example.')
    if isinstance(settings.exclude, str):
        raise SettingError(f'exclude is {settings.exclude!r}; give a list of names, for example exclude=["mount"].')
    for name, what, least in (
        ("starts", "number of starts", 1),
        ("seed", "seed", 0),
        ("threads", "number of threads", 0),
        ("replay", "number of recordings to replay", 0),
    ):
        value = getattr(settings, name)
        if name == "replay" and value is None:
            continue
        if not isinstance(value, int | np.integer) or value < least:
            raise SettingError(f"the {what} is {value!r}; give a whole number, {least} or more.", name)
    return settings


@dataclass(frozen=True, eq=False)
class Setup:
    """Recordings, model and free constants of a fit, before anything is fitted.

    Attributes:
        foot: the model.
        recordings: checked.
        sensors: that are fitted, the malleolus first.
        carriers: which mass each sensor of the two-mass foot reads, nothing for other models.
        name: of the domain, "periodic" or "time".
        space: the free constants; in the time domain the delay is one.
        delay: whether a delay is estimated.
        why_not: why there is no mirror image, or nothing.
        known: of what else may be true.
        warnings: so far.
    """

    foot: Foot
    recordings: list[Recording]
    sensors: tuple[str, ...]
    carriers: Mapping[str, str]
    name: str
    space: Space
    delay: bool
    why_not: str
    known: Known
    warnings: tuple[str, ...]

    @property
    def two_mass(self) -> bool:
        """Whether the model is the two-mass foot with its sensors on the two masses."""
        return self.carriers.get(MALLEOLUS[0]) == SHANK and all(name in self.carriers for name in self.sensors)

    @classmethod
    def of(cls, recordings: Sequence[Recording], foot: Foot, settings: Settings) -> "Setup":
        """Check the recordings, choose the domain, and open the space.

        Raises:
            RecordingError, SettingError: see `fit_foot`.
        """
        if not recordings:
            raise RecordingError("there is no recording to fit.")
        stated = {name: getattr(settings, name) for name in ("mass_std", "gain_std", "delay_std_s", "exclude")}
        known = Known.of_all([recording.known for recording in recordings]).overruled_by(**stated)
        apart(recordings)
        _loaded(recordings, foot)
        data = [_calibrated(checked(recording), known) for recording in recordings]
        warnings = gathered([text for recording in data for text in recording.warnings])
        people = list(dict.fromkeys(r.condition.subject for r in data))
        if len(people) > 1:
            names = ", ".join(person or "unnamed" for person in people)
            warnings.append(_PEOPLE.format(n=len(people), names=names))
        name, why = choose_domain(data, settings.domain)
        warnings += why
        none = known.delay_std_s == 0.0  # known exactly, so there is nothing to estimate
        delay = tells_delay(data) and not none if settings.delay is None else settings.delay
        if not delay and not none and settings.delay is None:
            warnings.append(
                "One frequency cannot separate a delay of the channels from damping; the delay is assumed to be zero."
            )
        fitted, passed_over = sensors.chosen(data, foot, settings.sensors)
        warnings += passed_over
        space = space_of(foot, settings.free, settings.bounds, delay and name == "time", fitted)
        if any("m_F" not in r.condition.masses for r in data) and set(MASSES) & set(foot.parameters):
            held = ", ".join(f"{n} {v:.3g} kg" for n, v in foot.values().items() if n in MASSES)
            masses = f"The body mass is unknown, so the model's own masses are used ({held}); give "
            warnings.append(Sentence(masses, called("body_mass"), "."))
        why_not = branches.has_mirror(space.names, foot.parameters)
        return cls(foot, data, fitted, carriers(foot), name, space, delay, why_not, known, tuple(warnings))

    def problem(self) -> Problem:
        """The one problem of its recordings, which are steady."""
        on = [self.carriers.get(sensor) == FOOT for sensor in self.sensors] if self.two_mass else None
        space = self.space if self.name == "periodic" else without_delay(self.space)
        return steady.problem_of(self.recordings, self.foot, space, self.known, self.sensors, on, self.delay)


#: Parameters to which a load on the knee adds.
_CARRY = ("m_S", "m_T", "added_mass")


def _loaded(recordings: Sequence[Recording], foot: Foot) -> None:
    """Refuse a load that the model has no place for: it would be left out in silence.

    Raises:
        RecordingError: one was recorded under a load, and no parameter of the model carries it.
    """
    loaded = next((r for r in recordings if r.condition.added_mass_kg > 0), None)
    if loaded is not None and not set(_CARRY) & set(foot.parameters):
        raise RecordingError(
            f"{loaded.file}: was recorded under {loaded.condition.added_mass_kg:g} kg, and no parameter of {foot.name} "
            f"carries a load ({', '.join(_CARRY)}); use a model made for that load, and 0 kg in study.toml."
        )


def _calibrated(recording: Recording, known: Known) -> Recording:
    """A recording whose channels are as alike as a laboratory or a user says, in place of what each channel states."""
    stated: dict[str, Any] = {
        name: value
        for name, value in (("gain_std", known.gain_std), ("delay_std_s", known.delay_std_s))
        if value is not None
    }
    if not stated:
        return recording
    base, malleolus = (recording.calibration.get(name, Channel()) for name in ("base", "malleolus"))
    none: dict[str, Any] = dict.fromkeys(stated, 0.0)
    exact = replace(base, **none)
    channels = {**recording.calibration, "base": exact, "malleolus": replace(malleolus, **stated)}
    return replace(recording, calibration=channels)


def tells_delay(data: Sequence[Recording]) -> bool:
    """Several frequencies, or broadband excitation, tell a delay from damping."""
    frequencies = {round(r.condition.frequency_hz, 1) if r.condition.frequency_hz else None for r in data}
    return len(frequencies) > 1 or None in frequencies


def choose_domain(recordings: Sequence[Recording], domain: str) -> tuple[str, list[str]]:
    """Periodic if every recording is steady, else time; the reason is said where it is not the usual one.

    Raises:
        SettingError: no such domain, or periodic for a recording that is not.
    """
    if domain not in DOMAINS:
        raise SettingError(f"the domain is {domain!r} (valid: {', '.join(DOMAINS)}).")
    if domain == "time":
        return "time", []
    aperiodic = [recording.file for recording in recordings if recording.condition.frequency_hz is None]
    if aperiodic:
        if domain == "periodic":
            text = f"{aperiodic[0]} is not periodic, so it cannot be fitted on harmonics; use "
            raise SettingError(Sentence(text, called("domain", "time"), "."))
        return "time", []
    scatter, file = _worst(recordings)
    if scatter > STEADY:
        text = f"{file} is not steady: its amplitude scatters by {100 * scatter:.0f} % (drift or beating)"
        if domain == "periodic":
            return "periodic", [f"{text}; the weights follow the scatter."]
        return "time", [f"{text}, so all recordings are fitted in the time domain."]
    return "periodic", []


def _worst(recordings: Sequence[Recording]) -> tuple[float, str]:
    """Largest scatter of a fundamental, and in which recording."""
    lines = [Line.of(recording) for recording in recordings]
    return max((max(line.base.scatter, line.malleolus.scatter), line.recording.file) for line in lines)


def is_steady(recordings: Sequence[Recording]) -> bool:
    """Whether all recordings are in a steady state, so that their harmonics say all that they hold."""
    periodic = all(recording.condition.frequency_hz is not None for recording in recordings)
    return periodic and _worst(recordings)[0] <= STEADY


def provenance(settings: Settings, space: Space, recordings: Sequence[Recording]) -> dict[str, Any]:
    """What is needed to make a result again: settings with the seed, bounds, versions, digests of the files."""
    bounds = {
        item.key: [float(low), float(high)]
        for item, low, high in zip(space.free, space.lower, space.upper, strict=True)
    }
    chosen = asdict(settings)
    chosen["wide"] = chosen.pop("departures")  # its key in result.json
    return {
        "seed": settings.seed,
        "settings": {name: value for name, value in chosen.items() if name not in ("bounds", "seed")},
        "bounds": bounds,
        "versions": {"python": python_version()} | {name: _version(name) for name in _PACKAGES},
        "sha256": {recording.file: recording.digest for recording in recordings if recording.digest},
    }


@functools.cache  # each asks for files, and a study for hundreds of fits
def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a folder that was never installed
        return "not installed"
