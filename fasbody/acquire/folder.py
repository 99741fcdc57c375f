"""The study folder that recordings are put into: its names, its tables, and what they already say."""

import csv
import io
import json
import math
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path

from fasbody.acquire.capture import SUFFIX
from fasbody.console import write_whole
from fasbody.exceptions import InputFileError
from fasbody.recording import Condition

CAPTURES, RECORDINGS = "captures", "recordings"


def free_stem(study: Path, stem: str) -> str:
    """A name that neither captures nor recordings have yet: stem, stem_2, stem_3 ..."""
    number, name = 1, stem
    while any((study / place).exists() for place in (f"{CAPTURES}/{name}{SUFFIX}", f"{RECORDINGS}/{name}.csv")):
        number += 1
        name = f"{stem}_{number}"
    return name


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
