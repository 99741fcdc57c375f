"""Recordings, their conditions, and studies: folders of recordings with a description."""

import json
import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fasbody.exceptions import InputFileError, RecordingError
from fasbody.readers import column, read_csv, read_table
from fasbody.subjects import foot_mass, shank_mass

#: The three columns that a recording needs, and one that it may have.
HEADER = ("time_s", "base_m_s2", "malleolus_m_s2", "tuberosity_m_s2")


#: What a person and a load on the knee can weigh.
_MASS_LIMITS_KG = {"body": (20, 300), "added": (0, 100)}
#: Origin of a bare file, which says nothing about itself.
UNSTATED = "of unstated origin"


@dataclass(frozen=True)
class Condition:
    """Under what a recording was made. `frequency_hz` is None for broadband excitation, masses None if unknown."""

    subject: str = ""
    posture: str = "midstance"
    added_mass_kg: float = 0.0
    body_mass_kg: float | None = None
    frequency_hz: float | None = None

    @property
    def masses(self) -> dict[str, float]:
        """m_S (in the arch m_T) and m_F [kg] of section 4.5; empty if the body mass is unknown."""
        if self.body_mass_kg is None:
            return {}
        shank = shank_mass(self.body_mass_kg, self.added_mass_kg)
        return {"m_S": shank, "m_T": shank, "m_F": foot_mass(self.body_mass_kg)}


@dataclass(frozen=True, eq=False)
class Recording:
    """Accelerations of one trial, uniformly sampled.

    Attributes:
        time_s: (n,) sample times [s].
        base_m_s2: (n,) base acceleration; malleolus_m_s2: (n,) medial malleolus [m/s^2].
        tuberosity_m_s2: (n,) tibial tuberosity [m/s^2], if recorded.
        condition: how it was made.
        file: where it came from, for messages.
        origin: "measured", "synthetic" or "of unstated origin" (a bare file).
        warnings: what the checks found that does not forbid its use.
    """

    time_s: np.ndarray
    base_m_s2: np.ndarray
    malleolus_m_s2: np.ndarray
    tuberosity_m_s2: np.ndarray | None = None
    condition: Condition = field(default_factory=Condition)
    file: str = "recording"
    origin: str = UNSTATED
    warnings: tuple[str, ...] = ()

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]."""
        return float((self.time_s.size - 1) / (self.time_s[-1] - self.time_s[0]))

    def __str__(self) -> str:
        at = "broadband" if self.condition.frequency_hz is None else f"{self.condition.frequency_hz:g} Hz"
        return f"{self.file}: {self.origin}, {at}, {self.time_s.size} samples at {self.rate_hz:g} Hz"

    @classmethod
    def read(
        cls, file: Path | str, condition: Condition | None = None, label: str = "", origin: str = UNSTATED
    ) -> "Recording":
        """Read a CSV file with the header ``time_s,base_m_s2,malleolus_m_s2[,tuberosity_m_s2]`` (units may differ).

        Args:
            file: the file.
            condition: what is known of the trial.
            label: what to call it in messages, default the file's name.
            origin: "measured" or "synthetic", if that is known.

        Raises:
            InputFileError: no such file, or it is not such a table; the message names line and column.
        """
        channels = read_csv(Path(file))
        return cls(
            time_s=channels[HEADER[0]],
            base_m_s2=channels[HEADER[1]],
            malleolus_m_s2=channels[HEADER[2]],
            tuberosity_m_s2=channels.get(HEADER[3]),
            condition=condition or Condition(),
            file=label or Path(file).name,
            origin=origin,
            warnings=_remarks(Path(file).with_suffix(".json")),
        )

    def write(self, file: Path) -> None:
        """Write as CSV, numbers as short as they are exact to 1e-6."""
        from fasbody.console import write_whole

        columns = {name: getattr(self, name) for name in HEADER if getattr(self, name) is not None}
        digits = 3 + math.ceil(math.log10(max(1.0, self.rate_hz)))  # a sample's time to a thousandth of the interval
        frame = pd.DataFrame({k: np.round(v, digits if k == "time_s" else 6) for k, v in columns.items()})
        write_whole(file, frame.to_csv(index=False))


@dataclass(frozen=True)
class Study:
    """A folder of recordings.

    Attributes:
        name: its title. origin: "measured" or "synthetic". description: one paragraph. recordings: in table order.
    """

    name: str
    origin: str
    description: str
    recordings: tuple[Recording, ...]

    def __iter__(self) -> Iterator[Recording]:
        return iter(self.recordings)

    def __str__(self) -> str:
        return f"{self.name}: {len(self.recordings)} {self.origin} recordings"

    @classmethod
    def read(cls, folder: Path | str, only: Path | None = None) -> "Study":
        """Read `study.toml`, `subjects.csv` and `recordings.csv` of a folder, and every recording they list.

        Args:
            folder: the study.
            only: read just this one of its recordings.

        Raises:
            InputFileError: a file is missing or has a wrong place in it.
        """
        root = Path(folder)
        about, channels = _describe(root / "study.toml")
        subjects = read_table(root / "subjects.csv", ("subject", "mass_kg"))
        masses = dict(
            zip(subjects["subject"].astype(str), column(root / "subjects.csv", subjects, "mass_kg"), strict=True)
        )
        file = root / "recordings.csv"
        table = read_table(file, ("file", "subject", "added_mass_kg"))
        added = column(file, table, "added_mass_kg")
        known = "frequency_hz" in table
        frequency = column(file, table, "frequency_hz", optional=True) if known else np.full(len(table), np.nan)
        recordings = []
        for i, row in enumerate(table.to_dict("records")):
            subject = str(row["subject"])
            if subject not in masses:
                raise InputFileError(file, f"subject {subject!r} is not in subjects.csv", line=i + 2)
            path = root / str(row["file"])
            if not path.resolve().is_relative_to(root.resolve()):
                raise InputFileError(file, f"{row['file']!r} lies outside the study's folder", line=i + 2)
            if only is not None and path.resolve() != only.resolve():
                continue
            _plausible(float(masses[subject]), "body", f"{root / 'subjects.csv'}: subject {subject}")
            _plausible(float(added[i]), "added", f"{file}, line {i + 2}")
            condition = Condition(
                subject=subject,
                posture=str(row.get("posture", "midstance")),
                added_mass_kg=float(added[i]),
                body_mass_kg=float(masses[subject]),
                frequency_hz=float(frequency[i]) if np.isfinite(frequency[i]) else None,
            )
            recording = Recording.read(path, condition, origin=about["origin"], label=f"{root.name}/{row['file']}")
            recordings.append(channels.apply(recording))
        if not recordings:
            missing = "lists no recording" if only is None else f"does not list {only.name}"
            raise InputFileError(file, missing, "one row a recording is needed")
        return cls(about["name"], about["origin"], about["description"], tuple(recordings))


def _remarks(file: Path) -> tuple[str, ...]:
    """What acquisition found worth a warning (docs/acquisition.md); none if the recording has no such file by it."""
    if not file.is_file():
        return ()
    try:
        found = json.loads(file.read_text())["warnings"]
    except (ValueError, KeyError, TypeError, OSError):
        return ()
    return tuple(text for text in found if isinstance(text, str)) if isinstance(found, list) else ()


def _describe(file: Path) -> tuple[dict[str, str], "_Corrections"]:
    """The [study] table with defaults, and the corrections of the [channels.*] tables."""
    if not file.is_file():
        raise InputFileError(file, "no such file", "a study folder needs study.toml, subjects.csv and recordings.csv")
    try:
        document = tomllib.loads(file.read_text())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputFileError(file, f"is not TOML ({error})") from None
    about = {"name": file.parent.resolve().name, "origin": "measured", "description": ""}
    about |= {key: str(value) for key, value in _table(file, document, "study").items() if key in about}
    if about["origin"] not in ("measured", "synthetic"):
        raise InputFileError(file, f"origin is {about['origin']!r}", 'valid: "measured", "synthetic"')
    return about, _Corrections.from_toml(file, _table(file, document, "channels"))


def _table(file: Path, document: Any, name: str) -> dict[str, Any]:
    """A table of a TOML document, empty if it is not there."""
    table = document.get(name, {})
    if not isinstance(table, dict):
        raise InputFileError(file, f"{name} is {table!r}", f"it must be a table, [{name}]")
    return table


@dataclass(frozen=True)
class _Corrections:
    """Sign, sensitivity and delay of each channel, as study.toml gives them."""

    factor: dict[str, float]
    delay: dict[str, float]

    @classmethod
    def from_toml(cls, file: Path, tables: dict[str, Any]) -> "_Corrections":
        names = [name.removesuffix("_m_s2") for name in HEADER[1:]]
        factor, delay = {}, {}
        for name in tables:
            if name not in names:
                raise InputFileError(file, f"describes the channel {name!r}", f"valid: {', '.join(names)}")
            table = _table(file, tables, name)
            valid = ("unit", "sign", "sensitivity", "delay_s")
            for key, value in table.items():
                number = isinstance(value, int | float) and math.isfinite(value)
                if key not in valid or (key != "unit" and not number):
                    here = f"channels.{name}.{key} = {value!r}"
                    raise InputFileError(file, here, f"valid: {', '.join(valid)}, with finite numbers")
            sensitivity = float(table.get("sensitivity", 1.0))
            if sensitivity == 0:
                raise InputFileError(file, f"channels.{name}.sensitivity is zero", "give recorded unit per m/s^2")
            factor[name] = float(table.get("sign", 1.0)) / sensitivity
            delay[name] = float(table.get("delay_s", 0.0))
        return cls(factor, delay)

    def apply(self, recording: Recording) -> Recording:
        """Scale the channels and undo known delays (band-limited shift by a spline)."""
        from scipy.interpolate import CubicSpline

        changed = {}
        for name in self.factor:
            key = f"{name}_m_s2"
            values = getattr(recording, key)
            if values is None:
                continue
            values = values * self.factor[name]
            if self.delay[name]:
                values = CubicSpline(recording.time_s, values)(recording.time_s + self.delay[name])
            changed[key] = values
        return replace(recording, **changed) if changed else recording


def read_file(file: Path) -> Recording:
    """A recording with its conditions where it lies in a study that lists it, else as a bare file.

    Raises:
        InputFileError: it, or the study around it, cannot be read.
    """
    for folder in file.resolve().parents[:2]:
        table = folder / "recordings.csv"
        if (folder / "study.toml").is_file() and table.is_file():
            listed = {(folder / str(name)).resolve() for name in read_table(table, ("file",))["file"]}
            if file.resolve() in listed:
                return Study.read(folder, only=file).recordings[0]
    return Recording.read(file)


def _plausible(mass_kg: float, name: str, here: str) -> None:
    low, high = _MASS_LIMITS_KG[name]
    if not low <= mass_kg <= high:
        raise RecordingError(f"{here}: the {name} mass is {mass_kg:g} kg; it must lie between {low} and {high} kg.")


def with_masses(recording: Recording, body_mass_kg: float | None, added_mass_kg: float | None) -> Recording:
    """The recording with masses given on the command line in place of its own.

    Raises:
        RecordingError: a mass is not a plausible number.
    """
    condition = recording.condition
    for name, value in (("body", body_mass_kg), ("added", added_mass_kg)):
        if value is not None:
            _plausible(value, name, recording.file)
            condition = replace(condition, **{f"{name}_mass_kg": value})  # type: ignore[arg-type]
    return replace(recording, condition=condition)
