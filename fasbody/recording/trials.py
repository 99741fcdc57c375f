"""study.toml: a study's name, origin and channels.

What a study folder lists: one trial a row of recordings.csv, with its conditions.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from fasbody.exceptions import InputFileError
from fasbody.presentation import Tabled
from fasbody.recording.channels import Layout
from fasbody.recording.condition import POSTURES, Condition, plausible
from fasbody.recording.csv import column, read_table
from fasbody.recording.files import TEXTS
from fasbody.recording.formats import READ, ending
from fasbody.recording.study_toml import Document, FileTable, LayoutTable, StudyTable, read_toml, validated

if TYPE_CHECKING:
    import pandas as pd


def describe(file: Path) -> tuple[StudyTable, Layout]:
    """The [study] table of a study.toml with defaults, and the layout of its [channels.*] tables."""
    if not file.is_file():
        needs = "a study folder needs study.toml, subjects.csv and recordings.csv"
        raise InputFileError(file, "no such file", needs + _way_out(file))
    return parsed(file, read_toml(file))


def _way_out(file: Path) -> str:
    """What can be done with a folder of bare recordings without a study.toml; empty where it is no such folder."""
    folder = file.parent
    if file.name != "study.toml" or (folder / "recordings.csv").exists() or not folder.is_dir():
        return ""
    kinds = {path.suffix for path in folder.iterdir() if path.is_file() and ending(path) in (*TEXTS, *READ)}
    if not kinds:
        return ""
    named = " ".join(f"{quote(str(folder))}/*{kind}" for kind in sorted(kinds))
    return f" (fasbody study init {quote(str(folder))} makes them); or name the files, {named}"


def parsed(file: Path, content: Mapping[str, Any]) -> tuple[StudyTable, Layout]:
    """The same of a study.toml's content, whether it is written yet or not."""
    document = validated(Document, file, content)
    study = validated(StudyTable, file, document.study, "study")
    study.name = study.name or file.parent.resolve().name
    apart = list[tuple[str, Layout]]()
    for name, stated in document.layouts.items():
        table = validated(LayoutTable, file, stated, f"layouts.{name}")
        settings = FileTable(**{key: getattr(table, key) or getattr(study, key) for key in FileTable.model_fields})
        channels = document.channels | table.channels
        layout = Layout.from_toml(file, channels, settings=settings, known=document.known)
        apart += [(pattern, layout) for pattern in table.files]
    layout = Layout.from_toml(file, document.channels, settings=study, known=document.known)
    return study, replace(layout, apart=tuple(apart))


@dataclass(frozen=True)
class Trial(Tabled):
    """One row of recordings.csv: where the recording is, what the row and messages call it, and how it was made."""

    path: Path
    file: str
    label: str
    condition: Condition


def listed(folder: Path, only: Path | None = None) -> tuple[Trial, ...]:
    """The trials of `recordings.csv`, with the body masses of `subjects.csv`.

    Args:
        folder: the study.
        only: list just this one of its recordings.

    Raises:
        InputFileError: a table is missing, has a wrong place in it, or lists a recording or subject twice.
        RecordingError: a mass is not a plausible number.
    """
    for name in ("subjects.csv", "recordings.csv"):
        if not (folder / name).is_file():
            hint = f"fasbody study init {quote(str(folder))} makes it"
            raise InputFileError(folder / name, "no such file", hint)
    masses = _masses(folder / "subjects.csv")
    file = folder / "recordings.csv"
    table = read_table(file, ("file", "subject", "added_mass_kg"))
    added = column(file, table, "added_mass_kg")
    frequency = column(file, table, "frequency_hz", optional=True)
    trials, lines = [], dict[Path, int]()
    for i, (line, row) in enumerate(table.items()):
        subject, name = str(row["subject"] or ""), str(row["file"] or "")
        if not name:
            raise InputFileError(file, "names no file", line=line)
        if subject not in masses:
            raise InputFileError(file, f"subject {subject!r} is not in subjects.csv", line=line)
        path = (folder / name).resolve()
        if not path.is_relative_to(folder.resolve()):
            raise InputFileError(file, f"{name!r} lies outside the study's folder", line=line)
        if path in lines:
            raise InputFileError(file, f"{name!r} is listed in line {lines[path]} already", "keep one row", line)
        lines[path] = line
        if only is not None and path != only.resolve():
            continue
        mass_kg = masses[subject]
        if not np.isnan(mass_kg):
            plausible(mass_kg, "body", f"{folder / 'subjects.csv'}: subject {subject}")
        condition = Condition(
            subject=subject,
            posture=" ".join(str(row.get("posture") or "midstance").casefold().split()),
            body_mass_kg=None if np.isnan(mass_kg) else mass_kg,
            added_mass_kg=plausible(float(added[i]), "added", f"{file}, line {line}"),
            frequency_hz=float(frequency[i]) if np.isfinite(frequency[i]) else None,
            seating=" ".join(str(row.get("seating") or "").split()),
        )
        trials.append(Trial(folder / name, name, f"{folder.name}/{name}", condition))
    if not trials:
        missing = "lists no recording" if only is None else f"does not list {only.name}"
        raise InputFileError(file, missing, "one row a recording is needed")
    return tuple(trials)


def posture_remarks(trials: Sequence[Trial]) -> list[str]:
    """A sentence for each posture that may be a slip: a name near a known one, or one of a single recording."""
    counts = Counter(trial.condition.posture for trial in trials)
    remarks = []
    for posture, count in counts.items():
        near = get_close_matches(posture, [p for p in {*POSTURES, *counts} if counts[p] > count or p in POSTURES], n=1)
        if posture in POSTURES or not (near or (count == 1 and len(trials) > 1)):
            continue
        meant = f", was {near[0]!r} meant?" if near else ""
        rows = "1 row" if count == 1 else f"{count} rows"
        remarks.append(f"recordings.csv: the posture {posture!r} stands in {rows}{meant or ' only'}")
    return [remark if remark.endswith("?") else f"{remark}." for remark in remarks]


def _masses(file: Path) -> dict[str, float]:
    table = read_table(file, ("subject", "mass_kg"))
    lines: dict[str, int] = {}
    for line, row in table.items():
        subject = row["subject"] or ""
        if subject in lines:
            problem = f"subject {subject!r} is listed in line {lines[subject]} already"
            raise InputFileError(file, problem, "keep one row", line)
        lines[subject] = line
    masses = column(file, table, "mass_kg", optional=True)
    return dict(zip(lines, map(float, masses), strict=True))


def people(folder: Path) -> "pd.DataFrame":
    """The subjects of a study with all columns of subjects.csv: numbers as numbers, all else as text."""
    import pandas as pd

    table = pd.DataFrame(list(read_table(folder / "subjects.csv", ("subject", "mass_kg")).values()), dtype=object)
    for name in table.columns:
        if name != "subject":
            numbers = pd.to_numeric(table[name].str.replace(",", ".", regex=False), errors="coerce")
            if numbers.notna().sum() == table[name].notna().sum():
                table[name] = numbers
    return table


def is_listed(file: Path, folder: Path) -> bool:
    """Whether a study folder lists a file."""
    table = folder / "recordings.csv"
    if not (folder / "study.toml").is_file() or not table.is_file():
        return False
    names = [row["file"] for row in read_table(table, ("file",)).values()]
    return file.resolve() in {(folder / name).resolve() for name in names if name}
