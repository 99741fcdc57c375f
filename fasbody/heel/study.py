"""A study of heel strikes on disk: raw volts and markers (NPZ, one file a person), or CSV.

`study.toml` says `kind = "heel strikes"` and `origin = "measured"` or `"synthetic"`. A folder of
raw files has tables [plate], [markers] and [sha256]; a folder of CSV has `strikes.csv` with the
columns file, subject, speed, and files with `time_s,force_n,compression_m`. What cannot be read is
one sentence, and the rest goes on.
"""

import hashlib
import io
import re
import tomllib
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, create_model

from fasbody.exceptions import FasError, InputFileError, RecordingError
from fasbody.heel.plate import Plate
from fasbody.heel.strike import (
    THRESHOLD_N,
    Published,
    Steps,
    Strike,
    Trial,
    contact_and_peak,
    corrected,
    heel_strike,
)
from fasbody.presentation import Tabled
from fasbody.recording.csv import column, read_table
from fasbody.recording.study_toml import Table, read_toml, validated
from fasbody.runner import key

#: What study.toml calls such a study.
KIND = "heel strikes"
#: The study that is shipped.
BUNDLED = Path(__file__).parent.parent / "studies" / "heel_strikes"
_TRIAL = re.compile(r"([^_]+)_(\w+)_force_volts")
#: Markers nearer to each other than this were not there [m]: a torn file has zeros.
_APART_M = 0.01
#: Samples that a strike from a CSV file needs.
_FEWEST = 10
#: No heel is pressed deeper [m]; a larger compression is of another unit.
_DEEPEST_M = 0.1

_Text = Annotated[str, Field(description="text")]


class _Study(Table):
    kind: Literal["heel strikes"]
    origin: Literal["measured", "synthetic"] = Field(description='"measured", "synthetic"')
    name: _Text = ""
    licence: _Text = ""
    doi: _Text = ""
    source: _Text = ""
    description: _Text = ""
    threshold_n: float = Field(THRESHOLD_N, description="a force in N")


_Pair = Annotated[tuple[float, float], BeforeValidator(tuple), Field(description="two lengths in m")]
_Number = Annotated[float, Field(description="a number")]
_KINDS: dict[Any, Any] = {float: _Number, tuple[float, float]: _Pair}
_KEYS: Any = {field.name: (_KINDS[field.type], field.default) for field in fields(Plate)}
_Plate = create_model("_Plate", __base__=Table, **_KEYS)


class _Markers(Table):
    rate_hz: float = Field(1293.5, description="a number")


class _Document(Table):
    study: dict[str, Any] = Field({})
    plate: dict[str, Any] = Field({})
    markers: dict[str, Any] = Field({})
    sha256: dict[str, str] = Field({}, description="digests by file")


@dataclass(frozen=True)
class HeelStudy(Tabled):
    """Strikes of people, all read.

    Attributes:
        name: of study.toml, or of the folder.
        origin: "measured" or "synthetic".
        licence: of the data, from study.toml.
        doi: of the publication.
        description: of the study, in words.
        strikes: in the order of the files.
        problems: one sentence for each person, file or strike that could not be used.
        body_weight_n: by subject, where it is known.
        digest: of everything that was read.

    Example:
        >>> HeelStudy.read().strikes
    """

    name: str
    origin: str
    licence: str
    doi: str
    description: str
    strikes: tuple[Strike, ...]
    problems: tuple[str, ...]
    body_weight_n: Mapping[str, float]
    digest: str

    def __str__(self) -> str:
        people = len({strike.subject for strike in self.strikes})
        return f"{self.name}: {len(self.strikes)} {self.origin} heel strikes of {people} people"

    def groups(self) -> dict[tuple[str, str], tuple[Strike, ...]]:
        """The strikes of each person and speed, in order."""
        groups: dict[tuple[str, str], tuple[Strike, ...]] = {}
        for strike in self.strikes:
            group = strike.subject, strike.speed
            groups[group] = (*groups.get(group, ()), strike)
        return groups

    @classmethod
    def read(cls, folder: Path | str = BUNDLED) -> "HeelStudy":
        """Read a study of heel strikes.

        Raises:
            InputFileError: study.toml is missing or wrong, or nothing in the folder can be used.
        """
        folder = Path(folder)
        toml, weights = _About.read(folder / "study.toml"), dict[str, float]()
        about = toml.study
        if raw := sorted(folder.glob("*.npz")):
            outcomes = list(_raw(raw, toml, weights))
        else:
            outcomes = list(_tables(folder, about.threshold_n, about.origin))
        strikes = tuple(outcome for outcome in outcomes if isinstance(outcome, Strike))
        problems = tuple(outcome for outcome in outcomes if isinstance(outcome, str))
        if not strikes:
            why = problems[0] if problems else "no files"
            raise InputFileError(folder, f"no heel strike can be used ({why})")
        values = (value for strike in strikes for value in vars(strike).values())
        digest = key(*(v.tobytes() if isinstance(v, np.ndarray) else repr(v) for v in values))
        return cls(
            about.name or folder.resolve().name, about.origin, about.licence, about.doi,
            about.description.strip(), strikes, problems, weights, digest,
        )  # fmt: skip


def is_heel_study(folder: Path) -> bool:
    """Whether the study.toml of a folder says that it is one of heel strikes."""
    try:
        table = tomllib.loads((folder / "study.toml").read_text("utf-8")).get("study", {})
    except (OSError, ValueError):
        return False
    return isinstance(table, dict) and table.get("kind") == KIND


@dataclass(frozen=True)
class _About:
    """A study.toml: the study, its plate, the markers' rate [Hz], and digests of the files."""

    study: _Study
    plate: Plate
    rate_hz: float
    sha256: Mapping[str, str]

    @classmethod
    def read(cls, file: Path) -> "_About":
        """From a file, its tables, keys and values checked."""
        say = f'say kind = "{KIND}" under [study]'
        if not file.is_file():
            raise InputFileError(file, "no such file", f"a study of heel strikes needs one: {say}")
        content = read_toml(file)
        if not is_heel_study(file.parent):
            raise InputFileError(file, "is no study of heel strikes", say)
        tables = validated(_Document, file, content)
        plate = validated(_Plate, file, tables.plate, "plate")
        markers = validated(_Markers, file, tables.markers, "markers")
        study = validated(_Study, file, tables.study, "study")
        return cls(study, Plate(**dict(plate)), markers.rate_hz, tables.sha256)


def _raw(files: list[Path], about: _About, weights: dict[str, float]) -> Iterator[Strike | str]:
    """Strikes and sentences of raw files; body weights [N] go into `weights`."""
    for name in about.sha256.keys() - {file.name for file in files}:
        yield f"{name}: is listed in study.toml and is not there."
    for file in files:
        try:
            person = Person.read(file, about)
            weights[person.subject] = person.body_weight_n
            yield from person.strikes()
        except RecordingError as error:
            yield f"{file.name}: {error}"
        except FasError as error:
            yield str(error)
        except (ValueError, TypeError, IndexError, KeyError) as error:  # arrays of another kind
            yield (f"{file.name}: holds arrays that no raw file has ({error}); see README.md of the bundled study.")


@dataclass(frozen=True, eq=False)
class Person(Tabled):
    """The raw file of one person.

    Attributes:
        subject: the file's number.
        plate: what makes, with the gain, newtons of volts.
        gain: [N/V].
        rate_hz: of the markers.
        lower_first: whether the first marker is the lower one on the standing person.
        distance_m: between the two, NaN if that is not known.
        body_weight_n: NaN if it is not known.
        arrays: what the file holds.
    """

    subject: str
    plate: Plate
    gain: float
    rate_hz: float
    lower_first: bool
    distance_m: float
    body_weight_n: float
    arrays: Mapping[str, np.ndarray]

    @classmethod
    def bundled(cls, subject: str) -> "Person":
        """A person of the shipped study."""
        file = BUNDLED / f"subject_{subject}.npz"
        if not file.is_file():
            raise InputFileError(file, "no such file", "valid: 02 to 13")
        return cls.read(file, _About.read(BUNDLED / "study.toml"))

    @classmethod
    def read(cls, file: Path, about: _About) -> "Person":
        """Read a raw file.

        Raises:
            InputFileError: it is broken, or not the one that study.toml lists.
            RecordingError: there is no calibration.
        """
        arrays, plate = _arrays(file, about.sha256.get(file.name)), about.plate
        gain = plate.gain(arrays.get("calibration_volts", np.array([])))
        weight = gain * float(np.mean(arrays.get("standing_volts", np.array([np.nan]))))
        standing = _standing(arrays.get("standing_markers_mm"))
        subject = file.stem.rpartition("_")[2]
        return cls(subject, plate, gain, about.rate_hz, *standing, weight, arrays)

    def names(self) -> list[tuple[str, str]]:
        """Speed and number of each trial."""
        matches = [match for match in map(_TRIAL.fullmatch, self.arrays) if match]
        return [(match[1], match[2]) for match in matches]

    def trial(self, speed: str, number: str) -> Trial:
        """One trial.

        Raises:
            RecordingError: an array is missing, or has a shape that no trial has.
        """
        stem = f"{speed}_{number}"

        def array(name: str, columns: int, default: Any = None) -> np.ndarray:
            values = np.asarray(self.arrays.get(f"{stem}_{name}", default), float)
            if values.ndim == 0 or values.shape[-1] != columns:
                raise RecordingError(
                    f"subject {self.subject}, {speed}, trial {number}: {name} has shape "
                    f"{values.shape}, and {columns} columns are needed."
                )
            return values

        force = array("force_volts", 8)
        pairs = 1e-3 * array("markers_mm", 6, np.empty((0, 6))).reshape(-1, 2, 3)
        for name in ("first_force_sample", *(["first_marker_frame"] if len(pairs) else [])):
            if f"{stem}_{name}" not in self.arrays:
                raise RecordingError(
                    f"subject {self.subject}, {speed}, trial {number}: no {stem}_{name}, without "
                    "which force and markers do not belong together."
                )
        return Trial(
            self.subject, speed, number, force, array("offset_volts", 8),
            int(self.arrays[f"{stem}_first_force_sample"]),
            pairs if self.lower_first else pairs[:, ::-1],
            int(self.arrays.get(f"{stem}_first_marker_frame", 0)),
        )  # fmt: skip

    def steps(self, speed: str, number: str) -> Steps:
        """What each correction made of a trial."""
        trial = self.trial(speed, number)
        return corrected(trial, self.plate, self.gain, self.distance_m, self.rate_hz)

    def strike(self, trial: Trial) -> Strike:
        """Force over compression of a trial."""
        return heel_strike(trial, self.plate, self.gain, self.distance_m, self.rate_hz)

    def strikes(self) -> Iterator[Strike | str]:
        """Every strike, or why it cannot be used; trials without markers share a sentence."""
        without = 0
        for speed, number in self.names():
            try:
                trial = self.trial(speed, number)
                if len(trial.markers_m):
                    yield self.strike(trial)
                else:
                    without += 1
            except RecordingError as error:
                yield str(error)
        if without:
            yield (
                f"subject {self.subject}: {without} trials have no markers, so they have a force and no compression."
            )


def _arrays(file: Path, sha256: str | None) -> dict[str, np.ndarray]:
    """The arrays of an NPZ file without pickles, its digest checked where study.toml has one."""
    try:
        data = file.read_bytes()
        if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
            text = "is not the file that study.toml lists (its SHA-256 differs)"
            raise InputFileError(file, text, "fetch it again")
        with np.load(io.BytesIO(data), allow_pickle=False) as content:
            return {name: content[name] for name in content.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        text = f"cannot be read ({str(error) or type(error).__name__})"
        raise InputFileError(file, text, "an NPZ file is needed") from None


def _standing(markers_mm: np.ndarray | None) -> tuple[bool, float]:
    """Whether the first marker of the standing person is the lower one, and their distance [m]."""
    pairs = 1e-3 * np.asarray([] if markers_mm is None else markers_mm, float).reshape(-1, 2, 3)
    along = pairs[:, 1] - pairs[:, 0]
    apart = np.linalg.norm(along, axis=1)
    seen = np.isfinite(apart) & (apart > _APART_M)
    if not seen.any():
        return True, np.nan
    return bool(np.median(along[seen, 2]) > 0), float(np.median(apart[seen]))


def _tables(folder: Path, threshold_n: float, origin: str) -> Iterator[Strike | str]:
    """Strikes of `strikes.csv`, or the sentence on each that could not be used."""
    table = read_table(folder / "strikes.csv", ("file", "subject", "speed"))
    for number, row in enumerate(table.values(), 1):
        name, subject, speed = (row[key] or "" for key in ("file", "subject", "speed"))
        try:
            yield read_csv(folder / name, subject, speed, str(number), threshold_n, origin)
        except FasError as error:
            yield str(error)


def read_csv(
    file: Path | str, subject: str = "1", speed: str = "", number: str = "1",
    threshold_n: float = THRESHOLD_N, origin: str = "measured",
) -> Strike:  # fmt: skip
    """A strike from a CSV file with `time_s,force_n,compression_m`: a walker's, or a drop test's.

    Contact and peak are those of the raw files; the compression counts from the contact. Nothing
    is filtered.

    Args:
        file: the table.
        subject: what to call the person.
        speed: what to call it.
        number: of the strike.
        threshold_n: force that only the strike makes [N].
        origin: "measured" or "synthetic".

    Raises:
        InputFileError: it cannot be read, a column is missing, or the clock does not run.
        RecordingError: it holds no strike.
    """
    file, names = Path(file), ("time_s", "force_n", "compression_m")
    table = read_table(file, names)
    t, F, x = (column(file, table, name) for name in names)
    if t.size < _FEWEST or not (np.diff(t) > 0).all():
        text = "the clock does not run, or there are fewer than ten samples"
        raise InputFileError(file, text, "time_s must rise")
    try:
        contact, peak = contact_and_peak(F, threshold_n)
    except RecordingError as error:
        raise RecordingError(f"{file}: {error}") from None
    t, F, x = t[contact:] - t[contact], F[contact:], x[contact:] - x[contact]
    v, k, deepest = np.gradient(x, t), peak - contact, np.abs(x).max()
    if x[k] <= 0.0:
        text = "the compression falls while the force rises; pressing must be positive."
        raise RecordingError(f"{file}: {text}")
    if deepest > _DEEPEST_M:
        text = f"the compression reaches {deepest:.3g} m, more than a heel has; give metres."
        raise RecordingError(f"{file}: {text}")
    back = np.flatnonzero(v[k:] <= 0.0)
    stand = k + int(back[0]) if back.size else t.size - 1
    loading, whole = (float(np.trapezoid(F[: end + 1], x[: end + 1])) for end in (k, stand))
    published = Published(
        float(x[k]), float(x[stand]), loading, whole, float(v[0]), float(t[k]), float(t[stand]),
        float(F[k]), bool(back.size),
    )  # fmt: skip
    return Strike(subject, speed, number, t, F, x, v, k, stand, origin, published)
