"""A recording on the workbench: which file, what its channels are, and the masses; read the same way by everyone.

The page corrects it, the worker fits it, and its line of Python reads it in a script.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fasbody.exceptions import InputFileError, SettingError
from fasbody.recording.channels import Layout
from fasbody.recording.condition import plausible
from fasbody.recording.files import columns_of
from fasbody.recording.recording import Recording, with_masses
from fasbody.recording.study import BUNDLED, read_file

#: What the form may say of a channel.
_SAID = {"column": str, "unit": str, "sign": float, "sensitivity": float, "delay_s": float}
#: Channels that the form has.
CHANNELS = ("time", "base", "malleolus", "tuberosity")


@dataclass(frozen=True)
class Source:
    """A file and what was said of it.

    Attributes:
        file: as it is called. folder: that it lies in. channels: as in study.toml, by name; empty where the file or its
            study says it. rate_hz: of a file without time. body_mass_kg, added_mass_kg: None for what the study says.
    """

    file: str
    folder: str
    channels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    rate_hz: float | None = None
    body_mass_kg: float | None = None
    added_mass_kg: float | None = None

    @property
    def path(self) -> Path:
        """Where it lies."""
        return Path(self.folder) / self.file

    def read(self) -> Recording:
        """The recording, corrected as was said.

        Raises:
            InputFileError: it cannot be read so. RecordingError: a mass is not a plausible number.
        """
        if self.channels or self.rate_hz is not None:
            layout = Layout.from_toml(Path(self.file), self.channels, self.rate_hz)
            recording = Recording.read(self.path, label=self.file, layout=layout)
        else:
            recording = read_file(self.path)
        return with_masses(recording, self.body_mass_kg, self.added_mass_kg)

    def line(self) -> str:
        """The Python expression that reads it."""
        if not (self.channels or self.rate_hz is not None):
            inside = f"BUNDLED / {self.file!r}" if Path(self.folder) == BUNDLED else f"Path({self.file!r})"
            text = f"read_file({inside})"
        else:
            tables = {name: dict(table) for name, table in self.channels.items()}
            layout = f"Layout.from_toml(Path({self.file!r}), {tables!r}, {self.rate_hz!r})"
            text = f"fb.Recording.read({self.file!r}, layout={layout})"
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

    def corrected(self, said: Mapping[str, Any]) -> "Source":
        """The same with what the page's form says.

        Raises:
            SettingError: it says what cannot be. RecordingError: a mass is not a plausible number.
        """
        channels: dict[str, dict[str, Any]] = {}
        for name, table in dict(said.get("channels") or {}).items():
            if name not in CHANNELS or not isinstance(table, dict):
                raise SettingError(f"the form describes the channel {name!r}; valid: {', '.join(CHANNELS)}.")
            told = {
                key: _said(key, value, kind)
                for key, kind in _SAID.items()
                if (value := table.get(key)) not in ("", None)
            }
            if told:
                channels[name] = told
        numbers = {key: _said(key, said[key], float) for key in ("rate_hz", "body_mass_kg", "added_mass_kg")
                   if said.get(key) not in ("", None)}  # fmt: skip
        for name in ("body", "added"):
            if f"{name}_mass_kg" in numbers:
                plausible(numbers[f"{name}_mass_kg"], name, self.file)
        return Source(self.file, self.folder, channels, **numbers)


def _said(key: str, value: Any, kind: type) -> Any:
    try:
        found = kind(value)
    except (TypeError, ValueError, OverflowError):
        raise SettingError(f"{key.replace('_', ' ')} is {value!r}; give a number.") from None
    if kind is float and not abs(found) < 1e12:
        raise SettingError(f"{key.replace('_', ' ')} is {value!r}; give a number.")
    return found


def script(
    sources: Sequence[Source], model: str, values: Mapping[str, float], settings: Mapping[str, Any],
    rivals: bool = False,
) -> str:  # fmt: skip
    """The lines of Python that repeat a fit, or a comparison of rivals."""
    lines = ["from pathlib import Path", "", "import fasbody as fb", "import identification as idn"]
    reads = [source.line() for source in sources]
    text = "\n".join(reads)
    if "Layout." in text:
        lines.append("from fasbody.recording.channels import Layout")
    if "with_masses(" in text:
        lines.append("from fasbody.recording.recording import with_masses")
    if "read_file(" in text:
        lines.append(f"from fasbody.recording.study import {'BUNDLED, ' if 'BUNDLED' in text else ''}read_file")
    if "Path(" not in text:
        lines = lines[2:]
    foot = f"load_foot({model!r})" if "@" in model else f"fb.load({model!r})"
    lines += ["from viz.load import load_foot"] if "@" in model else []
    foot += f".with_values({dict(values)!r})" if values else ""
    chosen = "".join(f", {name}={value!r}" for name, value in settings.items())
    lines += ["", "recordings = [", *(f"    {line}," for line in reads), "]"]
    verb = "compare_rivals" if rivals else "fit_foot"
    lines += [f"result = idn.{verb}(recordings, {foot}{chosen})", "print(result)", 'result.write("results")']
    return "\n".join(lines) + "\n"


def study_files(folder: Path) -> list[str]:
    """Recordings that a folder's recordings.csv lists, by name.

    Raises:
        InputFileError: it cannot be read.
    """
    from fasbody.recording.trials import listed

    if not (folder / "recordings.csv").is_file():
        raise InputFileError(folder / "recordings.csv", "there is no such file", "a study folder has one")
    return [trial.file for trial in listed(folder)]
