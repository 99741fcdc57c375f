"""Zip files: a study of the recordings on the page, the results of a fit, and what was dropped on the page as one."""

import csv
import io
import json
import lzma
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from fasbody.exceptions import InputFileError, SettingError
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording

#: Entries of study.toml that still apply to a channel in m/s^2, its sign and delay corrected.
_UNCERTAIN = ("gain_std", "delay_std_s")

#: Errors of a broken archive, or of one with a password.
_BROKEN = (zipfile.BadZipFile, RuntimeError, EOFError, OSError, ValueError, zlib.error, lzma.LZMAError)


def packed(files: Mapping[str, bytes]) -> bytes:
    """Files by their names inside, in one."""
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return memory.getvalue()


def unpacked(name: str, content: bytes, largest: int, most: int, count: int) -> Iterator[tuple[str, bytes]]:
    """The files of a dropped archive, one at a time, with their names; hidden files are skipped.

    Args:
        name: of the archive.
        content: of it.
        largest, most: bytes of a file, and of all.
        count: of files.

    Raises:
        InputFileError: it is no zip file, or holds more than it may.
    """
    try:
        archive = zipfile.ZipFile(io.BytesIO(content))
    except (zipfile.BadZipFile, ValueError, OverflowError):
        raise InputFileError(name, "is no zip file", "give one, or the files themselves") from None
    with archive:
        inside = [e for e in archive.infolist() if not e.is_dir() and not e.filename.startswith("__MACOSX/")]
        inside = [e for e in inside if not PurePosixPath(e.filename).name.startswith(".")]
        if len(inside) > count or sum(e.file_size for e in inside) > most or any(e.file_size > largest for e in inside):
            valid = f"valid: {count} files of {largest // 1_000_000} MB, {most // 1_000_000} MB in all"
            raise InputFileError(name, "holds more than a session does", valid)
        for entry in inside:
            try:
                with archive.open(entry) as file:
                    data = file.read(entry.file_size + 1)  # the declared size may be wrong
            except _BROKEN:
                raise InputFileError(name, f"{entry.filename} in it cannot be unpacked", "zip it anew") from None
            yield entry.filename, data[: entry.file_size]


def study(name: str, recordings: Sequence[Recording], folder: Path) -> dict[str, bytes]:
    """A study folder of recordings as they were read, in m/s^2, by the names of its files.

    Args:
        name: of the study.
        recordings: to keep.
        folder: for what is being written.

    Raises:
        SettingError: one of them has no body mass.
    """
    bare = [r.file for r in recordings if r.condition.body_mass_kg is None]
    if bare:
        others = f" and {len(bare) - 1} more" if len(bare) > 1 else ""
        raise SettingError(f"{bare[0]}{others} has no body mass, which a study needs; type it in the table.")
    files, rows, names, masses = {}, [], set[str](), dict[str, float]()
    spare = folder / ".study.csv"
    for recording in recordings:
        condition, stem = recording.condition, PurePosixPath(recording.file).name.partition(".csv")[0]
        file = next(f for f in (f"recordings/{stem}{end}.csv" for end in ("", *(f"_{k}" for k in range(2, 1000))))
                    if f not in names)  # fmt: skip
        names.add(file)
        mass = float(condition.body_mass_kg or 0.0)
        subject = condition.subject or f"{mass:g}kg"
        subject = subject if masses.get(subject, mass) == mass else f"{subject}_{mass:g}kg"
        masses[subject] = mass
        hz = "" if condition.frequency_hz is None else f"{condition.frequency_hz:g}"
        rows.append((file, subject, condition.posture, f"{condition.added_mass_kg:g}", hz))
        recording.write(spare)
        files[file] = spare.read_bytes()
        spare.unlink()
    people = [(subject, f"{mass:g}") for subject, mass in masses.items()]
    return {
        "study.toml": _toml(name, recordings, [row[0] for row in rows]).encode(),
        "subjects.csv": _table(("subject", "mass_kg"), people),
        "recordings.csv": _table(("file", "subject", "posture", "added_mass_kg", "frequency_hz"), rows),
    } | files


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    return text.getvalue().encode()


def _toml(name: str, recordings: Sequence[Recording], files: Sequence[str]) -> str:
    """study.toml: where the recordings come from, and how sure their channels are."""
    known = Known.of_all([r.known for r in recordings])
    sizes = {key: getattr(known, key) for key in ("mass_std", *_UNCERTAIN, "load_share")}
    about: dict[str, Any] = {key: value for key, value in sizes.items() if value is not None}
    about |= dict.fromkeys(sorted(known.excluded), "as the recordings' own study says")
    origin = "synthetic" if any(r.origin == "synthetic" for r in recordings) else "measured"
    lines = _lines("study", {"name": name, "origin": origin}) + _lines("known", about)
    for k, (recording, file) in enumerate(zip(recordings, files, strict=True)):
        channels = {
            channel: {key: value for key in _UNCERTAIN if (value := getattr(calibration, key)) and key not in about}
            for channel, calibration in recording.calibration.items()
        }
        if any(channels.values()):
            lines += _lines(f"layouts.file_{k}", {"files": [file]})
            for channel, table in channels.items():
                lines += _lines(f"layouts.file_{k}.channels.{channel}", table)
    return "\n".join(lines) + "\n"


def _lines(name: str, table: Mapping[str, Any]) -> list[str]:
    """One table of TOML, whose strings are written as those of JSON; none where it is empty."""
    pairs = [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in table.items()]
    return [f"[{name}]", *pairs, ""] if pairs else []
