"""A study of heel strikes on disk: raw volts and markers (NPZ, one file a person), or force over compression (CSV).

`study.toml` says `kind = "heel strikes"` and `origin = "measured"` or `"synthetic"`. A folder of raw files has tables
[plate], [markers] and [sha256]; a folder of CSV has `strikes.csv` with the columns file, subject, speed, and files with
`time_s,force_n,compression_m`. What cannot be read is one sentence, and the rest goes on.
"""

import hashlib
import io
import re
import tomllib
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.exceptions import FasError, InputFileError, RecordingError, unknown
from fasbody.heel.plate import Plate
from fasbody.heel.strike import THRESHOLD_N, Published, Steps, Strike, Trial, contact_and_peak, corrected, heel_strike
from fasbody.presentation import Tabled

#: What study.toml calls such a study.
KIND = "heel strikes"
#: The study that is shipped.
BUNDLED = Path(__file__).parent.parent / "studies" / "heel_strikes"
_TABLES = {
    "study": ("name", "kind", "origin", "licence", "doi", "source", "description", "threshold_n"),
    "plate": tuple(field.name for field in fields(Plate)),
    "markers": ("rate_hz",),
    "sha256": (),
}
_TRIAL = re.compile(r"([^_]+)_(\w+)_force_volts")
#: Markers nearer to each other than this were not there [m]: a torn file has zeros.
_APART_M = 0.01
#: Samples that a strike from a CSV file needs.
_FEWEST = 10
#: No heel is pressed deeper [m]; a larger compression is of another unit.
_DEEPEST_M = 0.1


@dataclass(frozen=True)
class HeelStudy(Tabled):
    """Strikes of people, all read.

    Attributes:
        name, origin, licence, doi, description: what study.toml says.
        strikes: in the order of the files.
        problems: one sentence for each person, file or strike that could not be used.
        body_weight_n: by subject, where it is known.
        digest: of everything that was read.
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
        by_person: dict[tuple[str, str], tuple[Strike, ...]] = {}
        for strike in self.strikes:
            key = strike.subject, strike.speed
            by_person[key] = (*by_person.get(key, ()), strike)
        return by_person

    @classmethod
    def read(cls, folder: Path | str = BUNDLED) -> "HeelStudy":
        """Read a study of heel strikes.

        Raises:
            InputFileError: study.toml is missing or wrong, or nothing in the folder can be used.
        """
        folder = Path(folder)
        file = folder / "study.toml"
        document = _document(file)
        about = {
            "name": folder.resolve().name,
            "licence": "",
            "doi": "",
            "description": "",
            **document.get("study", {}),
        }
        if about.get("origin") not in ("measured", "synthetic"):
            raise InputFileError(
                file, f"origin is {about.get('origin')!r}", 'say origin = "measured" or "synthetic" under [study]'
            )
        raw = sorted(folder.glob("*.npz"))
        if raw:
            outcomes, weights = _raw(raw, document)
        else:
            threshold = _number(file, "threshold_n", about.get("threshold_n", THRESHOLD_N))
            outcomes, weights = list(_tables(folder, threshold, about["origin"])), {}
        strikes = tuple(outcome for outcome in outcomes if isinstance(outcome, Strike))
        problems = tuple(outcome for outcome in outcomes if isinstance(outcome, str))
        if not strikes:
            raise InputFileError(folder, f"no heel strike can be used ({problems[0] if problems else 'no files'})")
        digest = hashlib.sha256()
        for strike in strikes:
            for field in fields(strike):
                value = getattr(strike, field.name)
                content = (
                    np.ascontiguousarray(value).tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
                )
                digest.update(field.name.encode() + content)
        return cls(
            about["name"], about["origin"], about["licence"], about["doi"], about["description"].strip(), strikes,
            problems, weights, digest.hexdigest(),
        )  # fmt: skip


def is_heel_study(folder: Path) -> bool:
    """Whether the study.toml of a folder says that it is one of heel strikes."""
    try:
        document = tomllib.loads((folder / "study.toml").read_text("utf-8"))
    except (OSError, ValueError):
        return False
    table = document.get("study", {})
    return isinstance(table, dict) and table.get("kind") == KIND


def _document(file: Path) -> dict[str, Any]:
    """study.toml, its tables and keys known."""
    if not file.is_file():
        raise InputFileError(file, "no such file", f'a study of heel strikes needs study.toml with kind = "{KIND}"')
    try:
        document = tomllib.loads(file.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputFileError(file, f"is not TOML ({error})") from None
    for table, content in document.items():
        if table not in _TABLES:
            raise InputFileError(file, unknown("table", table, _TABLES))
        for key in content if isinstance(content, dict) else ():
            if _TABLES[table] and key not in _TABLES[table]:
                raise InputFileError(file, unknown(f"key of [{table}]", key, _TABLES[table]))
    if not isinstance(document.get("study"), dict) or document["study"].get("kind") != KIND:
        raise InputFileError(file, "is no study of heel strikes", f'say kind = "{KIND}" under [study]')
    return document


def _raw(files: list[Path], document: dict[str, Any]) -> tuple[list[Strike | str], dict[str, float]]:
    """Strikes and sentences of raw files, and the body weights [N]."""
    plate, rate, known = _plate(document)
    outcomes: list[Strike | str] = [f"{name}: is listed in study.toml and is not there."
                                 for name in known if name not in {file.name for file in files}]  # fmt: skip
    weights = {}
    for file in files:
        subject = file.stem.rpartition("_")[2]
        try:
            person = Person.read(file, plate, rate, known.get(file.name))
            weights[subject] = person.body_weight_n
            outcomes += person.strikes()
        except RecordingError as error:
            outcomes.append(f"{file.name}: {error}")
        except (ValueError, TypeError, IndexError, KeyError) as error:  # an array of another kind or shape
            outcomes.append(
                f"{file.name}: holds arrays that no raw file has ({error}); see README.md of the bundled study."
            )
        except FasError as error:
            outcomes.append(str(error))
    return outcomes, weights


def _plate(document: dict[str, Any]) -> tuple[Plate, float, dict[str, str]]:
    """The plate, the markers' rate [Hz] and the digests that study.toml gives."""
    settings: dict[str, Any] = {}
    for key, value in document.get("plate", {}).items():
        where = Path("study.toml")
        if isinstance(value, list):
            if len(value) != 2:
                raise InputFileError(where, f"[plate] {key} has {len(value)} numbers", "give two, [x, y]")
            settings[key] = tuple(_number(where, f"[plate] {key}", coordinate) for coordinate in value)
        else:
            settings[key] = _number(where, f"[plate] {key}", value)
    rate = _number(Path("study.toml"), "[markers] rate_hz", document.get("markers", {}).get("rate_hz", 1293.5))
    return Plate(**settings), rate, document.get("sha256", {})


def _number(file: Path, name: str, value: object) -> float:
    """A number of study.toml that is above or below zero.

    Raises:
        InputFileError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputFileError(file, f"{name} is {value!r}", "give a number")
    return float(value)


@dataclass(frozen=True, eq=False)
class Person(Tabled):
    """The raw file of one person.

    Attributes:
        subject: the file's number.
        plate, gain: what makes newtons of volts.
        rate_hz: of the markers. lower_first:
        whether the first marker is the lower one on the standing person.
        distance_m: between the two, NaN if that is
        not known.
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
        plate, rate, known = _plate(_document(BUNDLED / "study.toml"))
        file = BUNDLED / f"subject_{subject}.npz"
        if not file.is_file():
            raise InputFileError(file, "no such file", "valid: 02 to 13")
        return cls.read(file, plate, rate, known.get(file.name))

    @classmethod
    def read(cls, file: Path, plate: Plate, rate_hz: float, sha256: str | None = None) -> "Person":
        """Read a raw file; a wrong digest, a broken file and a missing calibration are errors."""
        arrays = _arrays(file, sha256)
        gain = plate.gain(arrays.get("calibration_volts", np.array([])))
        weight = gain * float(np.mean(arrays.get("standing_volts", np.array([np.nan]))))
        lower_first, distance = _standing(arrays.get("standing_markers_mm"))
        return cls(file.stem.rpartition("_")[2], plate, gain, rate_hz, lower_first, distance, weight, arrays)

    def names(self) -> list[tuple[str, str]]:
        """Speed and number of each trial."""
        return [match.groups() for match in map(_TRIAL.fullmatch, self.arrays) if match]  # type: ignore[misc]

    def trial(self, speed: str, number: str) -> Trial:
        """One trial.

        Raises:
            RecordingError: its arrays have shapes that no trial has.
        """
        stem = f"{speed}_{number}"
        force = np.asarray(self.arrays[f"{stem}_force_volts"], float)
        markers = 1e-3 * np.asarray(self.arrays.get(f"{stem}_markers_mm", np.empty((0, 6))), float)
        if force.ndim != 2 or force.shape[1] != 8 or markers.ndim != 2 or markers.shape[1] != 6:
            raise RecordingError(
                f"subject {self.subject}, {speed}, trial {number}: the arrays have shapes {force.shape} and "
                f"{markers.shape}; valid: (n, 8) volts and (m, 6) millimetres."
            )
        needed = ["offset_volts", "first_force_sample", *(["first_marker_frame"] if len(markers) else [])]
        missing = [name for name in needed if f"{stem}_{name}" not in self.arrays]
        if missing:
            raise RecordingError(
                f"subject {self.subject}, {speed}, trial {number}: no {stem}_{missing[0]}, without which "
                "force and markers do not belong together."
            )
        offset = np.asarray(self.arrays[f"{stem}_offset_volts"], float)
        if offset.shape != (8,):
            raise RecordingError(
                f"subject {self.subject}, {speed}, trial {number}: the offsets have shape {offset.shape}, not (8,)."
            )
        pairs = markers.reshape(-1, 2, 3)
        return Trial(
            self.subject, speed, number, force, offset, int(self.arrays[f"{stem}_first_force_sample"]),
            pairs if self.lower_first else pairs[:, ::-1], int(self.arrays.get(f"{stem}_first_marker_frame", 0)),
        )  # fmt: skip

    def steps(self, speed: str, number: str) -> Steps:
        """What each correction made of a trial."""
        return corrected(self.trial(speed, number), self.plate, self.gain, self.distance_m, self.rate_hz)

    def strikes(self) -> list[Strike | str]:
        """Every strike, or the sentence on why it cannot be used; trials without markers share one."""
        outcomes: list[Strike | str] = []
        without = 0
        for speed, number in self.names():
            try:
                trial = self.trial(speed, number)
                if not len(trial.markers_m):
                    without += 1
                    continue
                outcomes.append(heel_strike(trial, self.plate, self.gain, self.distance_m, self.rate_hz))
            except RecordingError as error:
                outcomes.append(str(error))
        if without:
            outcomes.append(
                f"subject {self.subject}: {without} trials have no markers, so they have a force and no compression."
            )
        return outcomes


def _arrays(file: Path, sha256: str | None) -> dict[str, np.ndarray]:
    """The arrays of an NPZ file without pickles, its digest checked where study.toml has one."""
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InputFileError(file, f"cannot be read ({error.strerror})") from None
    if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
        raise InputFileError(file, "is not the file that study.toml lists (its SHA-256 differs)", "fetch it again")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as content:
            return {name: content[name] for name in content.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputFileError(
            file, f"cannot be read ({str(error) or type(error).__name__})", "an NPZ file is needed"
        ) from None


def _standing(markers_mm: np.ndarray | None) -> tuple[bool, float]:
    """Whether the first marker is the lower one on the standing person, and how far apart they are [m]."""
    if markers_mm is None or not markers_mm.size:
        return True, np.nan
    pairs = 1e-3 * np.asarray(markers_mm, float).reshape(-1, 2, 3)
    apart = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
    seen = np.isfinite(apart) & (apart > _APART_M)
    if not seen.any():
        return True, np.nan
    return bool(np.median(pairs[seen, 1, 2] - pairs[seen, 0, 2]) > 0), float(np.median(apart[seen]))


def _tables(folder: Path, threshold_n: float, origin: str) -> Iterator[Strike | str]:
    """Strikes of `strikes.csv`, or the sentence on each that could not be used."""
    import pandas as pd

    file = folder / "strikes.csv"
    try:
        table = pd.read_csv(file, dtype=str, keep_default_na=False)
    except FileNotFoundError:
        raise InputFileError(
            file, "no such file", "a study needs strikes.csv (file, subject, speed) or NPZ files"
        ) from None
    except (OSError, ValueError) as error:
        raise InputFileError(file, f"cannot be read ({error})") from None
    missing = [name for name in ("file", "subject", "speed") if name not in table]
    if missing:
        raise InputFileError(file, f"has no column {missing[0]!r}", "valid: file, subject, speed")
    for number, row in enumerate(table.itertuples(), 1):
        try:
            yield read_csv(folder / str(row.file), str(row.subject), str(row.speed), str(number), threshold_n, origin)
        except FasError as error:
            yield str(error)


def read_csv(
    file: Path | str, subject: str = "1", speed: str = "", number: str = "1", threshold_n: float = THRESHOLD_N,
    origin: str = "measured",
) -> Strike:  # fmt: skip
    """A strike from a CSV file with `time_s,force_n,compression_m`: a walker's, or a drop test's.

    Contact and peak are found as for the raw files; the compression counts from the contact. Nothing is filtered.

    Args:
        file: the table.
        subject, speed, number: what to call it.
        threshold_n: force that only the strike makes [N].
        origin: "measured" or "synthetic".

    Raises:
        InputFileError: it cannot be read, a column is missing, or the clock does not run.
        RecordingError: it holds no strike.
    """
    import pandas as pd

    names = ("time_s", "force_n", "compression_m")
    try:
        table = pd.read_csv(file, comment="#")
    except FileNotFoundError:
        raise InputFileError(file, "no such file") from None
    except (OSError, ValueError) as error:
        raise InputFileError(file, f"cannot be read ({error})", f"valid: a CSV file with {','.join(names)}") from None
    table.columns = [str(name).strip() for name in table.columns]
    for name in names:
        if name not in table:
            raise InputFileError(file, f"has no column {name!r}", f"valid: {','.join(names)}")
    numbers = [np.asarray(pd.to_numeric(table[name], errors="coerce"), float) for name in names]
    wrong = [int(np.flatnonzero(~np.isfinite(values))[0]) for values in numbers if not np.isfinite(values).all()]
    if wrong:
        raise InputFileError(file, "a cell is no number", "time, force and compression must be finite", min(wrong) + 2)
    t, F, x = numbers
    if t.size < _FEWEST or not (np.diff(t) > 0).all():
        raise InputFileError(file, "the clock does not run, or there are fewer than ten samples", "time_s must rise")
    try:
        contact, peak = contact_and_peak(F, threshold_n)
    except RecordingError as error:
        raise RecordingError(f"{file}: {error}") from None
    t, F, x = t[contact:] - t[contact], F[contact:], x[contact:] - x[contact]
    v, k = np.gradient(x, t), peak - contact
    if x[k] <= 0.0:
        raise RecordingError(f"{file}: the compression falls while the force rises; pressing must be positive.")
    if np.abs(x).max() > _DEEPEST_M:
        raise RecordingError(
            f"{file}: the compression reaches {np.abs(x).max():.3g} m, more than a heel has; give metres."
        )
    back = np.flatnonzero(v[k:] <= 0.0)
    stand = k + int(back[0]) if back.size else t.size - 1
    published = Published(
        float(x[k]), float(x[stand]), float(np.trapezoid(F[: k + 1], x[: k + 1])),
        float(np.trapezoid(F[: stand + 1], x[: stand + 1])), float(v[0]), float(t[k]), float(t[stand]), float(F[k]),
        bool(back.size),
    )  # fmt: skip
    return Strike(subject, speed, number, t, F, x, v, k, stand, origin, published)
