"""Reading tables and CSV recordings, with the line and column of whatever is wrong."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from fasbody.channels import Channels, Layout
from fasbody.exceptions import InputFileError

#: Larger files are refused before they are read [bytes].
_LARGEST = 500_000_000


def read_csv(file: Path, layout: Layout | None = None) -> Channels:
    """Read one recording.

    The header names the columns with their units, ``time_s,base_m_s2,malleolus_m_s2[,tuberosity_m_s2]``; other columns
    are ignored. Units may also be ms or us, g, mm_s2 or cm_s2. Comma, semicolon, tab or blank separate the columns.

    Args:
        file: the file. layout: what study.toml says of its columns.

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
    layout = layout or Layout()
    wanted = layout.find(file, names, [""] * len(names), line=1)
    columns = _numbers(file, text, separator, len(names), {name: index for name, (index, _) in wanted.items()})
    channels = {name: columns[name] * factor for name, (_, factor) in wanted.items()}
    if layout.rate_hz and "time_s" not in channels:
        channels["time_s"] = np.arange(channels["base_m_s2"].size) / layout.rate_hz
    return channels


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
