"""The study folder that recordings are put into: its names, its tables, and what they already say."""

import csv
import io
import json
import math
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fasbody.acquire.capture import SUFFIX
from fasbody.console import to_json, write_whole
from fasbody.exceptions import InputFileError
from fasbody.recording.recording import Condition

CAPTURES, RECORDINGS, TRUTH = "captures", "recordings", "truth.json"


def free_stem(study: Path, stem: str) -> str:
    """A name that neither captures nor recordings have yet: stem, stem_2, stem_3 ..."""
    number, name = 1, stem
    while any((study / place).exists() for place in (f"{CAPTURES}/{name}{SUFFIX}", f"{RECORDINGS}/{name}.csv")):
        number += 1
        name = f"{stem}_{number}"
    return name


def stem_of(study: Path, capture: Path, started: str | None) -> str:
    """Name for the recording of a capture: the one it has already, else the first that is nobody else's.

    Args:
        capture: its file. started: when it began, by its first record; tells two captures of one name apart.
    """
    base = capture.name.removesuffix(SUFFIX)
    number, name = 1, base
    while True:
        table, origin = study / RECORDINGS / f"{name}.csv", study / CAPTURES / f"{name}{SUFFIX}"
        if table.exists():
            mine = _made_from(table.with_suffix(".json"), study, capture, started)
        else:
            mine = not origin.exists() or origin.resolve() == capture.resolve()
        if mine:
            return name
        number += 1
        name = f"{base}_{number}"


def _made_from(file: Path, study: Path, capture: Path, started: str | None) -> bool:
    """Whether a recording's JSON says that it was made from this capture."""
    try:
        details = json.loads(file.read_text())
        first, began = details["captures"][0], details.get("started_utc")
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return False
    if began is not None or started is not None:
        return bool(began == started)
    return (study / str(first)).resolve() == capture.resolve()


def check_folder(study: Path) -> None:
    """Refuse a file where the study should be.

    Raises:
        InputFileError: it is one.
    """
    if study.exists() and not study.is_dir():
        raise InputFileError(study, "is a file where the study cannot be written", "name a folder")


def check_truth(study: Path, truth: Mapping[str, Any]) -> None:
    """Refuse a synthetic study of another truth.

    Raises:
        InputFileError: it has one already, which differs.
    """
    file = study / TRUTH
    if not file.is_file():
        return
    try:
        same = json.loads(file.read_text()) == json.loads(to_json(truth))
    except (OSError, ValueError):
        same = False
    if not same:
        raise InputFileError(file, "is the truth of another study than the virtual bench's", "name another folder")


def enter_truth(study: Path, truth: Mapping[str, Any]) -> None:
    """Write the truth of a synthetic study."""
    check_truth(study, truth)
    write_whole(study / TRUTH, to_json(truth) + "\n")


def check_writable(study: Path) -> None:
    """Make the folders of a study, and write to each.

    Raises:
        InputFileError: one cannot be written.
    """
    for place in (study / CAPTURES, study / RECORDINGS):
        try:
            place.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=place) as trial:
                trial.write(b"\0" * 4096)
        except OSError as error:
            raise InputFileError(place, f"cannot be written ({error.strerror})", "name a writable folder") from None


def check_origin(study: Path, origin: str) -> None:
    """Refuse to mix measured and synthetic recordings.

    Raises:
        InputFileError: the study is of the other kind.
    """
    file = study / "study.toml"
    if not file.is_file():
        return
    try:
        found = tomllib.loads(file.read_text()).get("study", {}).get("origin", "measured")
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputFileError(file, f"is not TOML ({error})") from None
    if found != origin:
        raise InputFileError(file, f"is not {origin} data", f"name another folder for {origin} recordings")


def enter(study: Path, name: str, condition: Condition, origin: str, usable: bool) -> None:
    """Enter a recording into study.toml, subjects.csv and, if it is usable, recordings.csv."""
    if not (study / "study.toml").is_file():
        title = json.dumps(study.resolve().name)
        text = f'[study]\nname = {title}\norigin = "{origin}"\ndescription = "Recorded by python -m fasbody.acquire."\n'
        write_whole(study / "study.toml", text)
    subject = {"subject": condition.subject, "mass_kg": _text(condition.body_mass_kg)}
    _put(study / "subjects.csv", "subject", ("subject", "mass_kg"), subject, keep=True)
    row = {
        "file": name, "subject": condition.subject, "posture": condition.posture,
        "added_mass_kg": _text(condition.added_mass_kg), "frequency_hz": _text(condition.frequency_hz),
    }  # fmt: skip
    _put(study / "recordings.csv", "file", tuple(row), row if usable else None, drop=name)


def _put(
    file: Path,
    key: str,
    columns: Sequence[str],
    row: dict[str, str] | None,
    keep: bool = False,
    drop: str | None = None,
) -> None:
    """Add or replace one row of a table; other rows and columns stay as they are."""
    rows: list[dict[str, str]] = []
    if file.is_file():
        reader = csv.DictReader(io.StringIO(file.read_text()))
        columns = list(reader.fieldnames or columns)
        rows = [entry for entry in reader if drop is None or entry.get(key) != drop]
    if row is not None and not (keep and any(entry.get(key) == row[key] for entry in rows)):
        rows.append(row)
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(file, out.getvalue())


def body_mass(study: Path, subject: str) -> float | None:
    """Body mass [kg] of a subject that the study knows already."""
    file = study / "subjects.csv"
    if file.is_file():
        for row in csv.DictReader(io.StringIO(file.read_text())):
            if row.get("subject") == subject and row.get("mass_kg"):
                try:
                    return float(row["mass_kg"])
                except ValueError:
                    raise InputFileError(file, f"mass_kg is {row['mass_kg']!r}, not a number") from None
    return None


def differ(known: float | None, given: float | None) -> bool:
    """Whether two body masses [kg] are not the same, one of them as the table prints it."""
    return known is not None and given is not None and not math.isclose(known, given, rel_tol=1e-5)


def check_mass(study: Path, condition: Condition) -> None:
    """Refuse a body mass that contradicts the study's.

    Raises:
        InputFileError: subjects.csv says another one.
    """
    known = body_mass(study, condition.subject)
    if differ(known, condition.body_mass_kg):
        problem = f"subject {condition.subject!r} has {known:g} kg, and {condition.body_mass_kg:g} kg are given"
        raise InputFileError(study / "subjects.csv", problem, "give the same, or correct the table")


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
