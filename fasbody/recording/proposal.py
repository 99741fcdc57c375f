"""A study folder proposed from a folder of recordings: names scanned, one file of each kind read, tables to fill in."""

import csv
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from fasbody.console import write_whole
from fasbody.exceptions import FasError, InputFileError
from fasbody.presentation import counted
from fasbody.recording.channels import (
    KNOWN_UNITS,
    NAMES,
    RAW,
    TIME_UNITS,
    VOLTAGES,
    Layout,
    name_and_unit,
)
from fasbody.recording.columns import Columns
from fasbody.recording.csv import TextTable, read_table
from fasbody.recording.file_names import common_value, patterns_of, plain_number, stated
from fasbody.recording.files import TEXTS, beside, columns_of
from fasbody.recording.formats import READ, ending, ending_removed
from fasbody.recording.headings import find_header
from fasbody.recording.recording import Recording
from fasbody.recording.text import read_text
from fasbody.recording.trials import parsed

TABLES = ("study.toml", "subjects.csv", "recordings.csv")
#: Words that headings use for each channel.
_WORDS = {
    "base": ("base", "table", "shaker", "platform", "plate"),
    "malleolus": ("malleol", "ankle"),
    "tuberosity": ("tuberos", "tibia", "knee"),
}


@dataclass(frozen=True)
class Proposal:
    """What a folder of recordings could be as a study.

    Attributes:
        folder: of the study.
        pattern: of the names, or several.
        tables: text of each of `TABLES`; where the folder is a study, those that have grown.
        count: recordings listed, without those of a study that is there.
        left_out: files that no pattern matches.
        missing: what is still to be given.
    """

    folder: Path
    pattern: str
    tables: dict[str, str]
    count: int
    left_out: tuple[str, ...]
    missing: tuple[str, ...]

    def write(self) -> None:
        """Write the tables; a study that is there gets new lines only."""
        _listed(self.folder)
        for name, text in self.tables.items():
            write_whole(self.folder / name, text)


def propose(folder: Path, pattern: str | None = None) -> Proposal:
    """Look at a folder's file names and at one file of each kind; of a study that is there, at files not listed yet.

    Args:
        folder: with recordings, also in subfolders.
        pattern: of their names without ending, such as ``S{subject}_{frequency}Hz_{load}kg``; with
            a / it holds folders, too. None guesses it, or several.

    Raises:
        InputFileError: no such folder, no recordings in it, none that match, or tables of a study that are not whole.
        SettingError: the pattern has a field that does not exist, or none.
    """
    if not folder.is_dir():
        raise InputFileError(folder, "is not a folder", "give the folder that holds the recordings")
    known = _listed(folder)
    files = sorted(
        (p for p in folder.rglob("*") if p.is_file() and ending(p) in (*TEXTS, *READ) and not _aside(p, folder)),
        key=lambda p: [int(x) if x.isdigit() else x for x in re.split(r"(\d+)", p.relative_to(folder).as_posix())],
    )
    if not files:
        listed = ", ".join((*TEXTS, *READ))
        raise InputFileError(folder, "holds no recording", f"valid endings: {listed}, each also with .gz")
    stems = {p: (p.relative_to(folder).parent / ending_removed(p)).as_posix() for p in files}
    patterns = [pattern] if pattern else patterns_of(list(stems.values()))
    rows = {p: row for p, stem in stems.items() if (row := stated(patterns, stem)) is not None}
    if not rows:
        raise InputFileError(folder, f"no file is named {patterns[0]}", f"the first is {stems[files[0]]}")
    new = {p: row for p, row in rows.items() if known is None or p.relative_to(folder).as_posix() not in known}
    if known is None and not any("subject" in row for row in rows.values()):
        rows = new = {p: {"subject": "1", **row} for p, row in rows.items()}
        missing = ["recordings.csv: subject, if these are not all of one person, who is called 1"]
    else:
        missing = []
    tables = {} if known is not None else {
        "study.toml": _toml(folder, list({ending(p): p for p in reversed(rows)}.values())[::-1], missing)
    }  # fmt: skip
    missing += _unsaid(list(new.values()))
    people, more = _people(folder, list(new.values()), known is not None)
    missing += more
    tables |= people | (_recordings(folder, new, " or ".join(patterns), known is not None) if new else {})
    left = tuple(p.relative_to(folder).as_posix() for p in files if p not in rows)
    return Proposal(folder, " or ".join(patterns), tables, len(new), left, tuple(missing))


def _unsaid(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """What the names of recordings leave open."""
    missing = [
        f"recordings.csv: {column}, which the names do not say"
        for field, column in (("subject", "subject"), ("load", "added_mass_kg"))
        if not all(field in row for row in rows)
    ]
    if rows and not any("frequency" in row for row in rows):
        missing.append("recordings.csv: frequency_hz of sines (leave it empty for sweeps and random input)")
    return missing


def _people(folder: Path, rows: Sequence[Mapping[str, str]], grows: bool) -> tuple[dict[str, str], list[str]]:
    """subjects.csv with the new subjects and the body masses that names state, and what it lacks."""
    file = folder / "subjects.csv"
    listed = {row["subject"] for row in read_table(file, ("subject", "mass_kg")).values()} if grows else set()
    named = dict[str, set[float]]()
    for row in rows:
        mass = plain_number(row.get("mass", ""))
        named.setdefault(row.get("subject", ""), set()).update({float(mass)} if mass else ())
    masses = {name: common_value(kg) for name, kg in named.items() if name not in listed}
    if not masses:
        return {}, []
    lines = [{"subject": name or "?", "mass_kg": "" if kg is None else f"{kg:g}"} for name, kg in masses.items()]
    about = "# mass_kg is needed; age_yr and height_m may stay empty."
    lacking = [kg for kg in masses.values() if kg is None]
    missing = [f"subjects.csv: mass_kg of {counted(len(lacking), 'subject')}"] if lacking else []
    return {file.name: _table(file, about, ("subject", "age_yr", "height_m", "mass_kg"), lines, grows)}, missing


def _recordings(folder: Path, rows: Mapping[Path, Mapping[str, str]], pattern: str, grows: bool) -> dict[str, str]:
    """recordings.csv with a line for each new file."""
    names = ("file", "subject", "posture", "added_mass_kg", "frequency_hz")
    lines = [
        {
            "file": path.relative_to(folder).as_posix(), "subject": row.get("subject", ""),
            "posture": row.get("posture", "").lower(), "added_mass_kg": plain_number(row.get("load", "")),
            "frequency_hz": plain_number(row.get("frequency", "")),
        }
        for path, row in rows.items()
    ]  # fmt: skip
    about = f"# Proposed from the names {pattern}; an empty frequency_hz is found in the recording."
    return {"recordings.csv": _table(folder / "recordings.csv", about, names, lines, grows)}


def _table(file: Path, about: str, names: Sequence[str], rows: list[dict[str, str]], grows: bool) -> str:
    """A new table, or the one that is there, with these rows."""
    above = f"{about}\n{','.join(names)}"
    if grows:
        above = read_text(file).rstrip("\n")
        _, separator, names = find_header(above, lambda cells: len({*cells} & {"file", "subject"}))
        if separator != ",":
            raise InputFileError(file, "is not separated by commas", "save it so, and its new lines are added")
    out = StringIO()
    csv.DictWriter(out, names, extrasaction="ignore", lineterminator="\n").writerows(rows)
    return f"{above}\n{out.getvalue()}"


def _listed(folder: Path) -> set[str] | None:
    """The files that a study lists, None where there is none yet."""
    tables = [name for name in TABLES if (folder / name).exists()]
    if tables and len(tables) < len(TABLES):
        raise InputFileError(folder / tables[0], "exists, and nothing is overwritten", "delete it to have it made anew")
    if not tables:
        return None
    return {row["file"] or "" for row in read_table(folder / "recordings.csv", ("file", "subject")).values()}


def _aside(file: Path, folder: Path) -> bool:
    """Files in a folder of recordings that are none: hidden files, tables of BIDS, notes."""
    if file.name in TABLES and file.parent == folder:
        return True
    hidden = any(part.startswith(".") for part in file.relative_to(folder).parts)
    name = file.name.lower()
    return hidden or name.endswith(("_channels.tsv", "participants.tsv", "_scans.tsv")) or name.startswith("readme")


def _toml(folder: Path, kinds: Sequence[Path], missing: list[str]) -> str:
    """The text of study.toml from one file of each kind; what is unknown is added to `missing`."""
    lines = ["[study]", f"name = {json.dumps(folder.resolve().name)}", 'origin = "measured"  # or "synthetic"']
    for file in kinds:
        layout = "" if file is kinds[0] else f"layouts.{ending(file)[1:]}."
        if layout:
            packed = [json.dumps(f"*{ending(file)}{end}") for end in ("", ".gz")]
            lines += ["", f"[{layout[:-1]}]  # the files that are otherwise", f"files = [{', '.join(packed)}]"]
        lines += _of_one(file, layout, missing)
    text = "\n".join(lines) + "\n"
    for file in kinds if not missing else ():
        try:
            Recording.read(file, layout=parsed(folder / "study.toml", tomllib.loads(text))[1])
        except FasError as error:
            missing.append(f"study.toml: {error}".rstrip("."))
    return text


def _of_one(file: Path, layout: str, missing: list[str]) -> list[str]:
    """The lines of one file's rate, columns and channels; `missing` gets what it does not say."""
    lines: list[str] = []
    described = beside(file, Layout(take=1))
    columns = columns_of(file, described)
    names = columns.names
    rate = next(filter(None, (described.rate_hz, *(s.rate_hz for s in columns.series))), None)

    def lack(line: str, key: str, reason: str = "") -> None:
        lines.append(line)
        missing.append(f"study.toml: {key}" + (f", for {reason}" if reason else ""))

    def quoted(name: str) -> str:
        return f"column = {json.dumps(name, ensure_ascii=False)}"

    if not names:
        example = '# columns = ["time_s", "base_g", ...]  # of files without a header'
        lack(example, "columns", f"{file.name} has no header")
    time = next((i for i, name in enumerate(names) if name_and_unit(name)[0] == "time"), None)
    clock = None if time is not None or rate is not None or ending(file) not in TEXTS else _clock(file, columns)
    place = clock if time is None else time
    if rate is None and place is None:
        line = "# sampling_rate_hz = 1000  # needed: the files have neither time nor rate"
        lack(line, "sampling_rate_hz", "the files have neither time nor rate")
    elif rate is None and place is not None:
        unstated = not _in_time(columns, place)
        lines += ["", f"[{layout}channels.time]"] if clock is not None or unstated else []
        lines += [quoted(names[place])] if clock is not None else []
        if unstated:
            rises = "rises evenly and " if clock is not None else ""
            lack('# unit = "s"  # or ms, us: the heading does not say', f"{layout}channels.time.unit",
                 f"{names[place]!r} {rises}does not say")  # fmt: skip
    lines += ["", f"# Columns of {file.name}: {', '.join(names) or 'unnamed'}"]
    for channel in NAMES:
        column, table = _column(channel, names), f"{layout}channels.{channel}"
        if column is None and channel == "tuberosity":
            continue
        lines.append(f"[{table}]")
        if column is None:
            lack('# column = "..."  # needed: one of the columns above', f"{table}.column")
            continue
        name, claimed = names[column], columns.claimed(column)
        lines += [quoted(name)] if name_and_unit(name)[0] != channel else []
        if claimed.lower() in VOLTAGES:
            line = '# sensitivity = "100 mV/g"  # needed: the column is in volts'
            lack(line, f"{table}.sensitivity", f"{name!r} is in {claimed}")
        elif RAW.fullmatch(claimed):
            line = "# sensitivity = 208.8  # needed: how many of them make 1 m/s^2"
            lack(line, f"{table}.sensitivity", f"{name!r} is in {claimed}")
        elif claimed.lower() not in KNOWN_UNITS:
            line = '# unit = "m/s^2"  # needed, or g, mg, V ...: the file does not say'
            lack(line, f"{table}.unit", f"{name!r} does not say")
        lines.append("# sign = -1, delay_s = 0.0, gain_std = 0.0, delay_std_s = 0.0  # one a line, if known")
    return lines


def _in_time(columns: Columns, place: int) -> bool:
    """Whether a column has a unit of time."""
    return bool({columns.units[place].lower(), name_and_unit(columns.names[place])[1]} & TIME_UNITS.keys())


def _clock(file: Path, columns: Columns) -> int | None:
    """The only column that rises evenly from row to row, as time does under any name; one in a unit of time first."""
    rising = []
    table = TextTable.open(file, beside(file, Layout(take=1)), strict=False)
    for index, values in enumerate(table.sample()):
        steps = np.diff(values)
        if steps.size > 8 and steps.min() >= 0 and np.ptp(values) > 0 and np.median(steps) > 0:
            typical = float(np.median(steps))
            rising += [index] if np.mean(np.abs(steps - typical) <= 0.51 * typical) > 0.9 else []
    kept = [i for i in rising if _in_time(columns, i)] or rising
    return kept[0] if len(kept) == 1 else None


def _column(channel: str, names: Sequence[str]) -> int | None:
    """The only column that is a channel by its name, or by a word in it."""
    exact = [i for i, name in enumerate(names) if name_and_unit(name)[0] == channel]
    near = exact or [i for i, name in enumerate(names) if any(word in name.lower() for word in _WORDS[channel])]
    return near[0] if len(near) == 1 else None
