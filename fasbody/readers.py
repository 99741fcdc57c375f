"""Reading tables and CSV recordings, with the line and column of whatever is wrong."""

import re
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd

from fasbody.channels import Channels, Layout
from fasbody.exceptions import InputFileError
from fasbody.text import COMMENT, header, lines, number, offset, read_text, rows, shown, split
from fasbody.units import KNOWN_UNITS


def read_csv(file: Path, layout: Layout | None = None) -> Channels:
    """Read one recording.

    The header names the columns with their units, ``time_s,base_m_s2,malleolus_m_s2[,tuberosity_m_s2]``; other columns
    are ignored. Units may also be ms or us, g, mm_s2 or cm_s2, or stand in a row of their own below the names. Comma,
    semicolon, tab, bar or blank separate the columns; decimal commas, comments, and lines above the header are
    understood.

    Args:
        file: the file. layout: what study.toml says of its columns.

    Returns:
        name in SI (``time_s``, ``base_m_s2``, ...) -> (n,) values.

    Raises:
        InputFileError: with file, line and column.
    """
    text = read_text(file)
    layout = layout or Layout()
    line, separator, names = header(text, layout.known)
    if not any(names):
        raise InputFileError(file, "is empty", "the first line must be time_s,base_m_s2,malleolus_m_s2")
    if not layout.known(names) and all(_numeric(cell) for cell in names if cell):
        raise InputFileError(file, "has no header line", "the first line must be time_s,base_m_s2,malleolus_m_s2")
    units = _units(text, line, separator, names)
    first = line + (units is not None)
    wanted = layout.find(file, names, units or [""] * len(names), line=line)
    places = {name: index for name, (index, _) in wanted.items()}
    columns = _numbers(file, text, separator, names, places, first)
    channels = {name: columns[name] * factor for name, (_, factor) in wanted.items()}
    if layout.rate_hz and "time_s" not in channels:
        channels["time_s"] = np.arange(channels["base_m_s2"].size) / layout.rate_hz
    return channels


def _units(text: str, line: int, separator: str, names: Sequence[str]) -> list[str] | None:
    """Units in a row below the header: no number in it, and at least one unit that is known."""
    cells = [re.sub(r"^[\[(]\s*|\s*[\])]$", "", cell) for cell in _row(text, line, separator)]
    cells = (cells + [""] * len(names))[: len(names)]
    if not any(cell.lower() in KNOWN_UNITS for cell in cells) or any(_numeric(cell) for cell in cells):
        return None
    return cells


def _row(text: str, after: int, separator: str) -> list[str]:
    """The cells of the first row after so many lines."""
    found = (line for line in lines(text, offset(text, after)) if line.strip() and not COMMENT.match(line))
    return split(next(found, ""), separator)


def _numeric(cell: str) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True


def _numbers(
    file: Path, text: str, separator: str, names: Sequence[str], wanted: Mapping[str, int], first: int
) -> Channels:
    """The wanted columns as floats: fast for a sound file, and line by line to find what is wrong with another."""
    sample = _row(text, first, separator)
    decimal = "," if any("," in sample[i] for i in wanted.values() if i < len(sample)) else "."
    _no_wider(file, text, separator, len(names), first)
    body = text[offset(text, first) :]
    if COMMENT.match(body) or re.search(rf"\n{COMMENT.pattern}", body):
        body = "\n".join(line for line in body.split("\n") if not COMMENT.match(line))
    try:
        frame = pd.read_csv(
            BytesIO(body.encode()), sep=r"\s+" if separator == " " else separator, decimal=decimal, header=None,
            names=list(range(max(len(names), len(sample)))), usecols=sorted(wanted.values()), index_col=False,
            skipinitialspace=True,
        )  # fmt: skip
        numeric = all(frame[index].dtype.kind in "iuf" for index in wanted.values())
        values = {name: frame[index].to_numpy(float) for name, index in wanted.items()} if numeric else {}
        if values and all(np.isfinite(v).all() for v in values.values()):
            return values
    except (ValueError, TypeError, pd.errors.ParserError):
        pass
    kept: list[list[float]] = []
    for line, cells in rows(file, text, separator, first):
        kept.append([_cell(file, name, cells, index, line) for name, index in wanted.items()])
    table = np.array(kept, float).reshape(-1, len(wanted))
    return dict(zip(wanted, table.T, strict=True))


def _no_wider(file: Path, text: str, separator: str, width: int, first: int) -> None:
    """Refuse a row with more cells than the header: its numbers would get into wrong columns."""
    body = text[offset(text, first) :].split("\n")
    if max(len(line.split()) if separator == " " else line.count(separator) + 1 for line in body) <= width:
        return
    for line, cells in rows(file, text, separator, first):
        if any(cells[width:]):
            hint = "if its decimals have commas, separate the columns by ;" if separator == "," else ""
            raise InputFileError(file, f"has {len(cells)} cells, and the header {width}", hint, line)


def _cell(file: Path, name: str, cells: Sequence[str], index: int, line: int) -> float:
    cell = cells[index] if index < len(cells) else ""
    try:
        value = number(cell)
    except ValueError:
        raise InputFileError(file, f"{name} is {shown(cell)!r}, not a number", line=line) from None
    if not np.isfinite(value):
        raise InputFileError(file, f"{name} is {shown(cell)!r}", "every sample must be finite", line=line)
    return value


def read_table(file: Path, needed: Sequence[str]) -> pd.DataFrame:
    """Read a small table as text, indexed by line number; an empty cell is NaN.

    Raises:
        InputFileError: it is no table, or lacks a needed column.
    """
    text = read_text(file)
    line, separator, names = header(text, lambda cells: len(set(cells) & set(needed)))
    if not any(names):
        raise InputFileError(file, "is empty", f"its header must name {', '.join(needed)}")
    for name in needed:
        if name not in names:
            raise InputFileError(file, f"has no column {name!r} (found: {shown(', '.join(names))})", line=line)
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputFileError(file, f"has two columns {shown(twice)!r}", "keep one of them", line=line)
    found = {}
    for place, cells in rows(file, text, separator, line):
        if any(cells[len(names) :]):
            raise InputFileError(file, f"has {len(cells)} cells, and the header {len(names)}", line=place)
        found[place] = [cell or None for cell in (cells + [""] * len(names))[: len(names)]]
    return pd.DataFrame.from_dict(found, orient="index", columns=names, dtype=object)


def column(file: Path, table: pd.DataFrame, name: str, optional: bool = False) -> np.ndarray:
    """One column of a table as numbers (n,); an empty cell is NaN if `optional`."""
    values = []
    for line, cell in table[name].items():
        if optional and not cell:
            values.append(float("nan"))
        else:
            values.append(_cell(file, name, [cell or ""], 0, int(str(line))))
    return np.array(values)
