"""Studies: folders of recordings with a description."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.exceptions import FasError, InputFileError
from fasbody.presentation import Sheet, Tabled
from fasbody.recording.channels import Layout
from fasbody.recording.checks import PERIODIC_SHARE, Checked, frequency_tolerance, understood
from fasbody.recording.file_names import condition_in_name
from fasbody.recording.formats import ending_removed
from fasbody.recording.harmonics import find_frequency, narrow_share
from fasbody.recording.recording import Recording
from fasbody.recording.report import excerpt
from fasbody.recording.together import out_of_line
from fasbody.recording.trials import Trial, describe, is_listed, listed

#: Folder of the study that ships with the package: synthetic recordings of subject 16, nine of 10 to 50 Hz
#: without load, and three under 2.3 kg.
BUNDLED = Path(str(files("fasbody"))) / "studies" / "synthetic_subject_16"


@dataclass(frozen=True)
class StudyFolder(Tabled):
    """A study on disk: its tables are read, its recordings one at a time when they are needed.

    Attributes:
        name: its title.
        origin: "measured" or "synthetic".
        description: one paragraph.
        trials: what recordings.csv lists.
        layout: the channels by study.toml.
    """

    name: str
    origin: str
    description: str
    trials: tuple[Trial, ...]
    layout: Layout

    @classmethod
    def open(cls, folder: Path | str, only: Path | None = None) -> "StudyFolder":
        """Read `study.toml`, `subjects.csv` and `recordings.csv` of a folder.

        Args:
            folder: the study.
            only: list just this one of its recordings.

        Raises:
            InputFileError: a file is missing or has a wrong place in it.
            RecordingError: a mass is not a plausible number.
        """
        about, layout = describe(Path(folder) / "study.toml")
        return cls(about.name, about.origin, about.description, listed(Path(folder), only), layout)

    def read(self, trial: Trial) -> Recording:
        """The recording of one trial, corrected as study.toml states."""
        return Recording.read(trial.path, trial.condition, trial.label, self.origin, self.layout)


@dataclass(frozen=True, repr=False)
class Study(Tabled):
    """A folder of recordings, all in memory.

        study = Study.read("my_study")
        study.check()

    Attributes:
        name: its title.
        origin: "measured" or "synthetic".
        description: one paragraph.
        recordings: in table order.
    """

    name: str
    origin: str
    description: str
    recordings: tuple[Recording, ...]

    def __iter__(self) -> Iterator[Recording]:
        return iter(self.recordings)

    def __str__(self) -> str:
        return f"{self.name}: {len(self.recordings)} {self.origin} recordings"

    def __repr__(self) -> str:
        return str(self)

    def sheet(self) -> Sheet:
        """One row per recording."""
        rows = []
        for r in self.recordings:
            c, at = r.condition, r.condition.frequency_hz
            about = (r.file, c.subject, c.posture, f"{c.added_mass_kg:g}", "broadband" if at is None else f"{at:g}")
            rows.append((*about, str(r.time_s.size), f"{r.rate_hz:.6g}"))
        columns = ("file", "subject", "posture", "added mass [kg]", "frequency [Hz]", "samples", "rate [Hz]")
        return Sheet(str(self), columns, rows)

    def under(self, added_mass_kg: float) -> "Study":
        """The recordings with this mass on the knee alone."""
        kept = tuple(r for r in self.recordings if r.condition.added_mass_kg == added_mass_kg)
        return replace(self, recordings=kept)

    def check(self) -> Checked:
        """Results of the checks of each recording: errors, and the channels and conditions read."""
        rows = tuple(understood(recording) for recording in self.recordings)
        return Checked(self.name, rows, tuple(out_of_line(rows)))

    @classmethod
    def read(cls, folder: Path | str, only: Path | None = None) -> "Study":
        """Open a study folder as `StudyFolder.open` does, and read every recording it lists."""
        study = StudyFolder.open(folder, only)
        recordings = tuple(study.read(trial) for trial in study.trials)
        sensors = {name for recording in recordings for name in recording.sensors}
        for name in study.layout.channels if only is None else ():
            if name != "base" and name != "time" and name not in sensors:
                stated = study.layout.channels[name].column
                column = f"a column {stated!r}" if stated else "a column of that name"
                listed = f"sensors found: {', '.join(sorted(sensors)) or 'none'}"
                problem = f"describes the channel {name!r}, and no recording has {column}"
                raise InputFileError(Path(folder) / "study.toml", problem, listed)
        return cls(study.name, study.origin, study.description, recordings)


def understood_trial(task: tuple[StudyFolder, Trial, bool]) -> dict[str, Any]:
    """What was understood of one trial of a study, and whose it is, perhaps with an excerpt; a task of a process."""
    folder, trial, drawn = task
    try:
        recording = folder.read(trial)
        row = understood(recording) | ({"excerpt": excerpt(recording)} if drawn else {})
    except FasError as error:
        row = {"file": trial.label, "problem": error.sentence, "subject": trial.condition.subject}
    return row


def bundled() -> Study:
    """The study that ships with the package (`BUNDLED`)."""
    return Study.read(BUNDLED)


def read_truth(folder: Path) -> dict[str, float]:
    """Known parameters of a synthetic study by name, with segment masses [kg] and the delay of its instrument [s].

    There are none if it states none.

    Raises:
        InputFileError: its truth.json is not one.
    """
    file = folder / "truth.json"
    if not file.is_file():
        return {}
    try:
        document = json.loads(file.read_text())
        weighed = {name: v for name, v in document.get("masses", {}).items() if name in ("m_S", "m_F")}
        known = {**document["parameters"], **weighed, "delay": document["instrument"]["delay_s"]}
        return {name: float(v) for name, v in known.items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputFileError(file, "is not the truth.json of a synthetic study", "make it anew or delete it") from None


def read_file(file: Path, study: Path | None = None) -> Recording:
    """A recording with its conditions where a study lists it, else with those of the file's name.

    Args:
        file: the recording.
        study: study.toml with its channels, if it is in no study.

    Raises:
        InputFileError: it, or the study around it, cannot be read.
    """
    if not file.exists():
        raise InputFileError(file, "no such file", "give a recording or a study folder that exists")
    if study is not None:
        return read_bare(file, describe(study)[1])
    for folder in file.resolve().parents[:2]:
        if is_listed(file, folder):
            return Study.read(folder, only=file).recordings[0]
    return read_bare(file)


def read_bare(file: Path, layout: Layout | None = None) -> Recording:
    """A recording that no study lists: its name states subject, posture, load and frequency.

    A frequency at which the base does not vibrate gives a warning, and does not count.

    Args:
        file: the recording.
        layout: of its columns.
    """
    named = condition_in_name(ending_removed(file))
    recording = Recording.read(file, replace(named, frequency_hz=None), layout=layout)
    t, base, stated_hz = recording.time_s, recording.base_m_s2, named.frequency_hz
    sound = np.isfinite(t).all() and np.isfinite(base).all() and t.size >= 50
    if not stated_hz or not sound or np.diff(t).min() <= 0 or stated_hz > 0.4 * recording.rate_hz:
        return recording  # a larger one is that of the samples
    centred = base - base.mean()
    hz = find_frequency(t, centred)
    if narrow_share(t, centred, hz) < PERIODIC_SHARE:
        return recording
    if abs(hz - stated_hz) <= frequency_tolerance(recording, stated_hz):
        return replace(recording, condition=named)
    remark = f"{file.name}: its name states {stated_hz:g} Hz, and its base vibrates at {hz:.4g} Hz."
    return replace(recording, warnings=(*recording.warnings, remark))
