"""A study folder proposed from a folder of recordings: names scanned, one file of each kind read, tables to fill in."""

import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fasbody.console import write_whole
from fasbody.exceptions import FasError, InputFileError, SettingError, unknown
from fasbody.recording.channels import KNOWN_UNITS, NAMES, TIME_UNITS, VOLTAGES, Layout, heading, name_and_unit
from fasbody.recording.condition import POSTURES
from fasbody.recording.csv import TextTable
from fasbody.recording.files import TEXTS, beside, columns_of
from fasbody.recording.formats import READ, ending
from fasbody.recording.formats.reader import read_series
from fasbody.recording.recording import Recording
from fasbody.recording.trials import parsed

#: What a pattern of file names may hold; {any} is what says nothing.
FIELDS = ("subject", "posture", "load", "frequency", "any")
TABLES = ("study.toml", "subjects.csv", "recordings.csv")
_NUMBER = r"\d+(?:[.,p]\d+)?"
_MATCHES = {
    "load": _NUMBER,
    "frequency": _NUMBER,
    "subject": r"[^\W_]+",  # names with accents, too
    "posture": r"[A-Za-z]+",
    "any": r"[^/]*?",
}
#: How file names say what they are, in the order in which they are looked for.
_SIGNS = (
    ("frequency", re.compile(rf"({_NUMBER})(?=[ _-]?hz)", re.IGNORECASE)),
    ("load", re.compile(rf"({_NUMBER})(?=[ _-]?kg)", re.IGNORECASE)),
    ("posture", re.compile(rf"({'|'.join(POSTURES)})", re.IGNORECASE)),
    (
        "subject",
        re.compile(r"(?<![A-Za-z])(?:subject|subj|sub|s|p|vp|id)[ _-]?(\d+)(?![\d.]*[ _-]?(?:hz|kg))", re.IGNORECASE),
    ),
)
#: More than this in a name is a body mass [kg].
_MOST_LOAD_KG = 25.0
#: Words that headings use for each channel.
_WORDS = {
    "base": ("base", "table", "shaker", "platform", "plate"),
    "malleolus": ("malleol", "ankle"),
    "tuberosity": ("tuberos", "tibia", "knee"),
}


def load_in_name(name: str) -> float | None:
    """The load [kg] that a file's name states, "rec_20hz_2.3kg.csv" for example; None where it states none.

    A name with several says nothing, and neither does one above what a knee carries: that is a body mass.
    """
    mass = _mass_in_name(name)
    return mass if mass is not None and mass <= _MOST_LOAD_KG else None


def body_mass_in_name(name: str) -> float | None:
    """The body mass [kg] that a file's name states, "anna_61kg.csv" for example; None where it states none."""
    mass = _mass_in_name(name)
    return mass if mass is not None and mass > _MOST_LOAD_KG else None


def _mass_in_name(name: str) -> float | None:
    masses = {float(_plain(match.group(1).lower())) for match in dict(_SIGNS)["load"].finditer(name)}
    return masses.pop() if len(masses) == 1 else None


@dataclass(frozen=True)
class Proposal:
    """What a folder of recordings could be as a study.

    Attributes:
        folder: of the study. pattern: of the names. tables: text of each of `TABLES`.
        count: recordings listed. left_out: files that the pattern does not match. missing: what is still to be given.
    """

    folder: Path
    pattern: str
    tables: dict[str, str]
    count: int
    left_out: tuple[str, ...]
    missing: tuple[str, ...]

    def write(self) -> None:
        """Write the three tables.

        Raises:
            InputFileError: one of them is there already.
        """
        _free(self.folder)
        for name, text in self.tables.items():
            write_whole(self.folder / name, text)


def propose(folder: Path, pattern: str | None = None) -> Proposal:
    """Look at a folder's file names and at one file of each kind.

    Args:
        folder: with recordings, also in folders of its own. pattern: of their names without ending, such as
            ``S{subject}_{frequency}Hz_{load}kg``; with a / it holds folders, too. None guesses it.

    Raises:
        InputFileError: no such folder, no recordings in it, none that match, or it is a study already.
        SettingError: the pattern has a field that does not exist, or none.
    """
    if not folder.is_dir():
        raise InputFileError(folder, "is no folder", "give the folder that holds the recordings")
    _free(folder)
    found = sorted(
        (p for p in folder.rglob("*") if p.is_file() and ending(p) in (*TEXTS, *READ) and not _aside(p, folder)),
        key=lambda p: [int(x) if x.isdigit() else x for x in re.split(r"(\d+)", p.relative_to(folder).as_posix())],
    )
    if not found:
        listed = ", ".join((*TEXTS, *READ))
        raise InputFileError(folder, "holds no recording", f"valid endings: {listed}, and .gz behind any")
    stems = {p: _stem(p, folder) for p in found}
    pattern = pattern or Counter(map(_template, stems.values())).most_common(1)[0][0]
    match = _compiled(pattern)
    told = {
        p: m for p, stem in stems.items() if (m := match.fullmatch(stem if "/" in pattern else stem.split("/")[-1]))
    }
    if not told:
        raise InputFileError(folder, f"no file is named {pattern}", f"the first is {stems[found[0]]}")
    missing: list[str] = []
    toml = _toml(folder, list({ending(p): p for p in reversed(told)}.values())[::-1], missing)
    rows = [{name: value for name, value in m.groupdict().items() if value} for m in told.values()]
    subjects = list(dict.fromkeys(row.get("subject", "") for row in rows))
    for field, column in (("subject", "subject"), ("load", "added_mass_kg")):
        if not all(field in row for row in rows):
            missing.append(f"recordings.csv: {column}, which the names do not say")
    if not any("frequency" in row for row in rows):
        missing.append("recordings.csv: frequency_hz of sines (leave it empty for sweeps and random input)")
    missing.append(f"subjects.csv: mass_kg of {len(subjects)} subject{'s' * (len(subjects) > 1)}")
    table = [
        f"# Proposed from the names {pattern}; an empty frequency_hz is found in the recording.",
        "file,subject,posture,added_mass_kg,frequency_hz",
    ]
    for p, row in zip(told, rows, strict=True):
        name = p.relative_to(folder).as_posix()
        cells = [
            row.get("subject", ""),
            row.get("posture", "").lower(),
            *(_plain(row.get(k, "")) for k in ("load", "frequency")),
        ]
        table.append(",".join([f'"{name}"' if "," in name else name, *cells]))
    people = ["# mass_kg is needed; age_yr and height_m may stay empty.", "subject,age_yr,height_m,mass_kg"]
    people += [f"{subject or '?'},,," for subject in subjects]
    texts = (toml, "\n".join(people) + "\n", "\n".join(table) + "\n")
    left = tuple(p.relative_to(folder).as_posix() for p in found if p not in told)
    return Proposal(folder, pattern, dict(zip(TABLES, texts, strict=True)), len(told), left, tuple(missing))


def _free(folder: Path) -> None:
    for name in TABLES:
        if (folder / name).exists():
            raise InputFileError(folder / name, "exists, and nothing is overwritten", "delete it to have it made anew")


def _aside(file: Path, folder: Path) -> bool:
    """What lies in a folder of recordings and is none: hidden files, tables of BIDS, notes."""
    hidden = any(part.startswith(".") for part in file.relative_to(folder).parts)
    name = file.name.lower()
    return hidden or name.endswith(("_channels.tsv", "participants.tsv", "_scans.tsv")) or name.startswith("readme")


def _stem(file: Path, folder: Path) -> str:
    name = file.relative_to(folder).as_posix().removesuffix(".gz")
    return name[: len(name) - len(Path(name).suffix)]


def _template(stem: str) -> str:
    """The pattern that a name follows: what is known by its sign, and any other number as {any}."""
    for field, sign in _SIGNS:
        if m := sign.search(stem):
            stem = f"{stem[: m.start(1)]}{{{field}}}{stem[m.end(1) :]}"
    return re.sub(r"\d+", "{any}", stem)


def _compiled(pattern: str) -> re.Pattern[str]:
    parts = re.split(r"\{(\w*)\}", pattern)
    for field in parts[1::2]:
        if field not in FIELDS:
            raise SettingError(f"--pattern {pattern}: {unknown('field', field, FIELDS)}.")
        if field != "any" and parts[1::2].count(field) > 1:
            raise SettingError(f"--pattern {pattern} names {{{field}}} twice; valid: once, and {{any}} for the rest.")
    text = "".join(
        re.escape(part) if i % 2 == 0 else f"(?:{_MATCHES[part]})" if part == "any" else f"(?P<{part}>{_MATCHES[part]})"
        for i, part in enumerate(parts)
    )
    return re.compile(text, re.IGNORECASE)


def _plain(number: str) -> str:
    """A number of a name with a decimal point: 2p3 and 2,3 are 2.3."""
    return f"{float(re.sub('[,p]', '.', number)):g}" if number else ""


def _toml(folder: Path, kinds: Sequence[Path], missing: list[str]) -> str:
    """The text of study.toml from one file of each kind; what it cannot say is added to `missing`."""
    lines = ["[study]", f"name = {json.dumps(folder.resolve().name)}", 'origin = "measured"  # or "synthetic"']
    for file in kinds:
        layout = "" if file is kinds[0] else f"layouts.{ending(file)[1:]}."
        if layout:
            packed = [json.dumps(f"*{ending(file)}{end}") for end in ("", ".gz")]
            lines += ["", f"[{layout[:-1]}]  # the files that are otherwise", f"files = [{', '.join(packed)}]"]
        lines += _of_one(file, layout, missing)
    if not missing:
        for file in kinds:
            missing += _unread(folder, file, "\n".join(lines))
    return "\n".join(lines) + "\n"


def _of_one(file: Path, layout: str, missing: list[str]) -> list[str]:
    """The lines of one file's rate, columns and channels. `layout` stands before the names of its tables."""
    lines: list[str] = []
    names, units, rate = _columns(file)
    if not names:
        lines.append('# columns = ["time_s", "base_g", ...]  # of files without a header')
        missing.append(f"study.toml: columns, for {file.name} has no header")
    has_time = any(name_and_unit(name)[0] == "time" for name in names)
    clock = None if has_time or rate is not None else _clock(file, names, units)
    if clock is not None:
        name, unit = names[clock], units[clock] or name_and_unit(names[clock])[1]
        lines += ["", f"[{layout}channels.time]", f"column = {json.dumps(name, ensure_ascii=False)}"]
        if unit.lower() not in TIME_UNITS:
            lines.append('# unit = "s"  # or ms, us: the heading does not say')
            missing.append(f"study.toml: {layout}channels.time.unit, for {name!r} rises evenly and does not say")
        has_time = True
    if rate is None and not has_time:
        lines.append("# sampling_rate_hz = 1000  # needed: the files have neither time nor rate")
        missing.append("study.toml: sampling_rate_hz, for the files have neither time nor rate")
    if rate is None and has_time and clock is None:
        time, unit = next((n, u) for n, u in zip(names, units, strict=True) if name_and_unit(n)[0] == "time")
        if not {unit.lower(), name_and_unit(time)[1]} & TIME_UNITS.keys():
            lines += ["", f"[{layout}channels.time]", '# unit = "s"  # or ms, us: the heading does not say']
            missing.append(f"study.toml: {layout}channels.time.unit, for {time!r} does not say")
    lines += ["", f"# Columns of {file.name}: {', '.join(names) or 'unnamed'}"]
    for channel in NAMES:
        column = _column(channel, names)
        if column is None and channel == "tuberosity":
            continue
        lines.append(f"[{layout}channels.{channel}]")
        if column is None:
            lines.append('# column = "..."  # needed: one of the columns above')
            missing.append(f"study.toml: {layout}channels.{channel}.column")
            continue
        name, unit = names[column], units[column]
        if name_and_unit(name)[0] != channel:
            lines.append(f"column = {json.dumps(name, ensure_ascii=False)}")
        claimed = unit or name_and_unit(name)[1] or heading(name)[1]
        if claimed.lower() in VOLTAGES:
            lines.append('# sensitivity = "100 mV/g"  # needed: the column is in volts')
            missing.append(f"study.toml: {layout}channels.{channel}.sensitivity, for {name!r} is in {claimed}")
        elif claimed.lower() not in KNOWN_UNITS:
            lines.append('# unit = "m/s^2"  # needed, or g, mg, V ...: the file does not say')
            missing.append(f"study.toml: {layout}channels.{channel}.unit, for {name!r} does not say")
        lines.append("# sign = -1, delay_s = 0.0, gain_std = 0.0, delay_std_s = 0.0  # one a line, if known")
    return lines


def _columns(file: Path) -> tuple[list[str], list[str], float | None]:
    """Names, units and rate of a file's columns."""
    if ending(file) in TEXTS:
        layout = beside(file, Layout())
        columns = columns_of(file, layout)
        return list(columns.names), list(columns.units), layout.rate_hz
    series = [s for s in read_series(file) if not s.what]
    return [s.name for s in series], [s.unit for s in series], next((s.rate_hz for s in series if s.rate_hz), None)


def _clock(file: Path, names: Sequence[str], units: Sequence[str]) -> int | None:
    """The only column that rises evenly from row to row, as time does under whatever name; one in a unit of time first.

    Text alone has no rate of its own.
    """
    if ending(file) not in TEXTS or not names:
        return None
    columns = TextTable.open(file, beside(file, Layout())).sample()
    rising = []
    for index, values in enumerate(columns):
        steps = np.diff(values)
        if steps.size > 8 and steps.min() >= 0 and np.ptp(values) > 0 and np.median(steps) > 0:
            typical = float(np.median(steps))
            rising += [index] if np.mean(np.abs(steps - typical) <= 0.51 * typical) > 0.9 else []
    told = [i for i in rising if {units[i].lower(), name_and_unit(names[i])[1]} & TIME_UNITS.keys()]
    kept = told or rising
    return kept[0] if len(kept) == 1 else None


def _column(channel: str, names: Sequence[str]) -> int | None:
    """The only column that is a channel by its name, or by a word in it."""
    exact = [i for i, name in enumerate(names) if name_and_unit(name)[0] == channel]
    near = exact or [i for i, name in enumerate(names) if any(word in name.lower() for word in _WORDS[channel])]
    return near[0] if len(near) == 1 else None


def _unread(folder: Path, file: Path, toml: str) -> list[str]:
    """Why a file cannot be read as proposed, if so."""
    try:
        Recording.read(file, layout=parsed(folder / "study.toml", toml)[1])
    except FasError as error:
        return [f"study.toml: {error}".rstrip(".")]
    return []
