"""A recording on the workbench: which file, what its channels are, and the masses; read by one function.

The page corrects it, the worker fits it, and its line of Python reads it in a script.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fasbody.exceptions import FasError, InputFileError, SettingError
from fasbody.recording.channels import NAMES, VOLTAGES, Layout
from fasbody.recording.condition import plausible
from fasbody.recording.file_names import body_mass_in_name, load_in_name
from fasbody.recording.files import columns_of
from fasbody.recording.recording import Recording, with_masses
from fasbody.recording.study import BUNDLED, read_file
from fasbody.recording.trials import is_listed


def _sensitivity(value: Any) -> float | str:
    """A number, or a data sheet's text, which the reader judges."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return str(value)


#: Fields of a channel in the form, and their types.
_FIELDS: Mapping[str, Callable[[Any], Any]] = {
    "column": str,
    "unit": str,
    "sign": float,
    "sensitivity": _sensitivity,
    "delay_s": float,
}
#: Channels of the form.
CHANNELS = ("time", *NAMES)


@dataclass(frozen=True)
class Source:
    """A file with the corrections of its description.

    Attributes:
        file: as it is called.
        folder: that it lies in.
        channels: as in study.toml, by name; empty where the file or its study says it.
        rate_hz: of a file without time.
        body_mass_kg, added_mass_kg: None for what the study says.
        start_s, end_s: of what is used of it, from its first sample; None for all.
    """

    file: str
    folder: str
    channels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    rate_hz: float | None = None
    body_mass_kg: float | None = None
    added_mass_kg: float | None = None
    start_s: float | None = None
    end_s: float | None = None

    @property
    def path(self) -> Path:
        """Where it lies."""
        return Path(self.folder) / self.file

    @classmethod
    def bare(cls, file: str, folder: str) -> "Source":
        """A dropped file, with the masses that its name states where no study beside it does."""
        source, name = cls(file, folder), Path(file).name
        if any(is_listed(source.path, around) for around in source.path.resolve().parents[:2]):
            return source
        return replace(source, body_mass_kg=body_mass_in_name(name), added_mass_kg=load_in_name(name))

    @property
    def weighed(self) -> bool:
        """Whether both masses were stated here, so that the file need not be read for them."""
        return self.body_mass_kg is not None and self.added_mass_kg is not None

    @property
    def unit(self) -> str:
        """The unit that was given in the table, or the sensitivity in its place; empty where none was."""
        base = self.channels.get("base", {})
        return str(base.get("sensitivity") or base.get("unit", ""))

    def read(self) -> Recording:
        """The corrected recording.

        Raises:
            InputFileError: it cannot be read so. RecordingError: a mass is not a plausible number.
        """
        if self.channels or self.rate_hz is not None:
            recording = Recording.read(self.path, label=self.file, layout=self._layout())
        else:
            recording = read_file(self.path)
        return with_masses(recording.between(self.start_s, self.end_s), self.body_mass_kg, self.added_mass_kg)

    def _layout(self) -> Layout:
        return Layout.from_toml(Path(self.file), self.channels, self.rate_hz)

    def line(self) -> str:
        """The Python expression that reads it."""
        if not (self.channels or self.rate_hz is not None):
            inside = f"BUNDLED / {self.file!r}" if Path(self.folder) == BUNDLED else f"Path({self.file!r})"
            text = f"read_file({inside})"
        else:
            tables = {name: dict(table) for name, table in self.channels.items()}
            layout = f"Layout.from_toml(Path({self.file!r}), {tables!r}, {self.rate_hz!r})"
            text = f"fb.Recording.read({self.file!r}, layout={layout})"
        if self.start_s is not None or self.end_s is not None:
            text += f".between({self.start_s!r}, {self.end_s!r})"
        if self.body_mass_kg is None and self.added_mass_kg is None:
            return text
        return f"with_masses({text}, {self.body_mass_kg!r}, {self.added_mass_kg!r})"

    def columns(self) -> list[dict[str, str]]:
        """Names and units of the file's columns, for the form.

        Raises:
            InputFileError: nothing can be made of the file.
        """
        columns = columns_of(self.path)
        return [{"name": name, "unit": unit} for name, unit in zip(columns.names, columns.units, strict=True)]

    def corrected(self, changes: Mapping[str, Any]) -> "Source":
        """The source with the page's corrections: tables of channels, ``unit`` of all its accelerations, ``rate_hz``,
        masses, seconds. Entries that are not mentioned stay; for empty ones the file counts.

        Raises:
            SettingError: an entry is invalid. RecordingError: a mass is not a plausible number.
            InputFileError: there is no such unit, or sensitivity.
        """
        channels = {name: dict(table) for name, table in self.channels.items()}
        for name, table in dict(changes.get("channels") or {}).items():
            if name not in CHANNELS or not isinstance(table, dict):
                raise SettingError(f"the form describes the channel {name!r}; valid: {', '.join(CHANNELS)}.")
            fields = {
                key: _converted(key, value, kind)
                for key, kind in _FIELDS.items()
                if (value := table.get(key)) not in ("", None)
            }
            channels[name] = fields
        if "unit" in changes:
            unit_fields = self._unit(str(changes["unit"]).strip())
            for name in NAMES:
                kept = {key: v for key, v in channels.get(name, {}).items() if key not in ("unit", "sensitivity")}
                channels[name] = kept | unit_fields
        numbers: dict[str, Any] = {
            key: None if changes[key] in ("", None) else _converted(key, changes[key], float)
            for key in ("rate_hz", "body_mass_kg", "added_mass_kg", "start_s", "end_s")
            if key in changes
        }
        for name in ("body", "added"):
            if (mass := numbers.get(f"{name}_mass_kg")) is not None:
                plausible(mass, name, self.file)
        source = replace(self, channels={name: table for name, table in channels.items() if table}, **numbers)
        source._layout()
        if (source.start_s, source.end_s) != (self.start_s, self.end_s):
            part = source.read().part_s
            if part is not None:  # what lies beyond the ends is none of it
                first = source.start_s if source.start_s is not None and source.start_s > 0 else None
                source = replace(source, start_s=first, end_s=source.end_s if source.end_s == part[1] else None)
        return source

    def _unit(self, text: str) -> dict[str, str]:
        """Keys of a channel whose unit was given, or a data sheet's sensitivity: "100 mV/g" is of numbers in volts."""
        if not text[:1].isdigit():
            return {"unit": text} if text else {}
        columns = columns_of(self.path)
        in_volts = any(columns.claimed(k).lower() in VOLTAGES for k in range(len(columns.names)))
        return {"sensitivity": text} | ({} if in_volts else {"unit": "V"})


def on_page(error: FasError, folders: Iterable[str]) -> str:
    """An error in the words of the page.

    Args:
        error: of reading, checking or fitting a recording.
        folders: that are left out before the name of its file.
    """
    file = error.file
    for folder in folders:
        file = file.removeprefix(f"{folder}/")
    return error.on_page(file)


def _converted(key: str, value: Any, kind: Callable[[Any], Any]) -> Any:
    try:
        number = kind(value)
    except (TypeError, ValueError, OverflowError):
        raise SettingError(f"{key.replace('_', ' ')} is {value!r}; give a number.") from None
    if kind is float and not abs(number) < 1e12:
        raise SettingError(f"{key.replace('_', ' ')} is {value!r}; give a number.")
    return number


def study_files(folder: Path) -> list[str]:
    """Recordings that a folder's recordings.csv lists, by name.

    Raises:
        InputFileError: it cannot be read.
    """
    from fasbody.recording.trials import listed

    if not (folder / "recordings.csv").is_file():
        raise InputFileError(folder / "recordings.csv", "there is no such file", "a study folder has one")
    return [trial.file for trial in listed(folder)]
