"""Reading tables and CSV recordings, with the line and column of whatever is wrong."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from fasbody.exceptions import InputFileError, unknown

Channels = dict[str, np.ndarray]

#: Units that a header may carry behind a channel's name, and what they are in SI.
UNITS = {"m_s2": 1.0, "g": 9.80665, "mm_s2": 1e-3, "cm_s2": 1e-2}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_CHANNELS = ("base", "malleolus", "tuberosity")
#: Larger files are refused before they are read [bytes].
_LARGEST = 500_000_000


def read_csv(file: Path) -> Channels:
    """Read one recording.

    The header names the columns with their units, ``time_s,base_m_s2,malleolus_m_s2[,tuberosity_m_s2]``; other columns
    are ignored. Units may also be ms or us, g, mm_s2 or cm_s2. Comma, semicolon, tab or blank separate the columns.

    Returns:
        name in SI (``time_s``, ``base_m_s2``, ...) -> (n,) values.

    Raises:
        InputFileError: with file, line and column.
    """
    text = _text(file)
    first = text.split("\n", 1)[0].strip()
    if not first:
        raise InputFileError(file, "is empty", "the first line must be time_s,base_m_s2,malleolus_m_s2")
    separator = _separator(first)
    names = [
        name.strip().strip('"').lower() for name in (first.split(separator) if separator != " " else first.split())
    ]
    wanted: dict[str, tuple[int, float]] = {}
    for index, name in enumerate(names):
        stem, _, unit = name.partition("_")
        if stem == "time" and unit in TIME_UNITS:
            _once(file, wanted, "time_s")
            wanted["time_s"] = (index, TIME_UNITS[unit])
        elif stem in _CHANNELS:
            if unit not in UNITS:
                raise InputFileError(file, unknown(f"unit of the column {stem!r}:", unit, UNITS), line=1)
            _once(file, wanted, f"{stem}_m_s2")
            wanted[f"{stem}_m_s2"] = (index, UNITS[unit])
    missing = [name for name in ("time_s", "base_m_s2", "malleolus_m_s2") if name not in wanted]
    if missing:
        found = ", ".join(names)[:120]
        raise InputFileError(
            file, f"has no column {missing[0]!r} (found: {found})", "units may also be g or ms", line=1
        )
    frame = _numbers(file, text, separator, len(names), {name: index for name, (index, _) in wanted.items()})
    return {name: frame[name] * scale for name, (_, scale) in wanted.items()}


def _once(file: Path, wanted: dict[str, tuple[int, float]], name: str) -> None:
    if name in wanted:
        raise InputFileError(file, f"has two columns for {name.removesuffix('_m_s2')}", "keep one of them", line=1)


def read_table(file: Path, needed: Sequence[str]) -> pd.DataFrame:
    """Read a small CSV table as text, and check that it has the needed columns."""
    text = _text(file)
    try:
        from io import StringIO

        table = pd.read_csv(StringIO(text), dtype=str, skipinitialspace=True)
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        raise InputFileError(file, f"is not a table ({str(error).strip()})") from None
    for name in needed:
        if name not in table:
            raise InputFileError(file, f"has no column {name!r} (found: {', '.join(map(str, table))})", line=1)
    return table


def column(file: Path, table: pd.DataFrame, name: str, optional: bool = False) -> np.ndarray:
    """One column of a table as numbers (n,); an empty cell is NaN if `optional`."""
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
    wrong = ~np.isfinite(values) & ~(table[name].isna().to_numpy() if optional else False)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise InputFileError(file, f"{name} is {table[name].iloc[row]!r}, not a number", line=row + 2)
    return values


def _text(file: Path) -> str:
    if not file.is_file():
        raise InputFileError(file, "no such file" if not file.is_dir() else "is a folder, not a file")
    if file.stat().st_size > _LARGEST:
        raise InputFileError(file, f"is larger than {_LARGEST // 1_000_000} MB", "split it into recordings")
    try:
        text = file.read_text(encoding="utf-8-sig")
        if "\0" in text:
            raise InputFileError(file, "is not a text file", "a CSV file with a header line is needed")
        return text
    except UnicodeDecodeError:
        raise InputFileError(file, "is not a text file", "a CSV file with a header line is needed") from None
    except OSError as error:
        raise InputFileError(file, f"cannot be read ({error.strerror})") from None


def _separator(line: str) -> str:
    for candidate in (",", ";", "\t"):
        if candidate in line:
            return candidate
    return " "


def _numbers(file: Path, text: str, separator: str, width: int, wanted: dict[str, int]) -> Channels:
    """The wanted columns as floats: fast for a sound file, and line by line to find what is wrong with another."""
    from io import StringIO

    try:
        options = {"sep": r"\s+"} if separator == " " else {"sep": separator}
        frame = pd.read_csv(
            StringIO(text),
            header=0,
            names=list(range(width)),
            usecols=sorted(wanted.values()),
            index_col=False,
            **options,
        )
        values = {name: frame[index].to_numpy(float) for name, index in wanted.items()}
        if all(np.isfinite(v).all() for v in values.values()):
            return values
    except (ValueError, TypeError, pd.errors.ParserError):
        pass
    rows = text.splitlines()
    reader = (r.split() for r in rows) if separator == " " else csv.reader(rows, delimiter=separator)
    kept: list[list[float]] = []
    for line, row in enumerate(reader, 1):
        if line == 1 or not row:
            continue
        numbers = []
        for name, index in wanted.items():
            cell = row[index].strip() if index < len(row) else ""
            try:
                number = float(cell)
            except ValueError:
                raise InputFileError(file, f"{name} is {cell!r}, not a number", line=line) from None
            if not np.isfinite(number):
                raise InputFileError(file, f"{name} is {cell!r}", "every sample must be finite", line=line)
            numbers.append(number)
        kept.append(numbers)
    table = np.array(kept).reshape(-1, len(wanted))
    return dict(zip(wanted, table.T, strict=True))
