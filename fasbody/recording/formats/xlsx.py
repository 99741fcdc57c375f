"""Excel's .xlsx by openpyxl: the columns below each sheet's header, units in brackets or in a row."""

import re
from dataclasses import replace
from datetime import datetime, time, timedelta
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.recording.channels import KNOWN_UNITS
from fasbody.recording.formats.series import FormatError, Series, check_size, passed_over

LIBRARY = "openpyxl"
#: Rows above which a sheet has its header.
_HEADER_ROWS = 200


def decode(file: Path) -> list[Series]:
    """Numeric columns of all sheets."""
    from openpyxl import load_workbook

    book = load_workbook(file, read_only=True, data_only=True)
    series, total = list[Series](), 0
    for sheet in book.worksheets:
        rows = []
        for row in sheet.iter_rows(values_only=True):
            total += len(row)
            check_size(total)
            rows.append(row)
        series += [replace(column, group=sheet.title) for column in _columns(sheet.title, rows)]
    return series


def _columns(sheet: str, rows: list[tuple[Any, ...]]) -> list[Series]:
    """Below the last row of texts before the first row of numbers; a row of units may stand between."""
    first = next((i for i, row in enumerate(islice(rows, _HEADER_ROWS)) if sum(map(_numeric, row)) >= 2), None)
    if first is None:
        worded = next((i for i, row in enumerate(rows[:_HEADER_ROWS]) if sum(map(_number_in_words, row)) >= 2), None)
        if worded is None:
            notes = " ".join(str(cell) for row in rows[:_HEADER_ROWS] for cell in row if cell is not None)
            return [passed_over(f"the sheet {sheet}", "no table of numbers", notes)] if notes else []
        raise FormatError(
            f"the sheet {sheet!r} keeps its numbers as text (row {worded + 1}); make them numbers in Excel"
        )
    above = [row for row in rows[:first] if sum(isinstance(cell, str) for cell in row) >= 2]
    if not above:
        raise FormatError(f"the sheet {sheet!r} has no header row; write time_s, base_m_s2, ... above its numbers")
    units: list[str] = [""] * len(rows[first])
    bare = [str(cell or "").strip(" []()") for cell in above[-1]]
    if len(above) > 1 and any(cell.lower() in KNOWN_UNITS for cell in bare):
        units = (bare + units)[: len(units)]
        above.pop()
    body = rows[first:]
    while body and not any(cell is not None for cell in body[-1]):
        body.pop()
    series = []
    for index, (name, unit) in enumerate(zip(above[-1], units, strict=False)):
        cells = [row[index] if index < len(row) else None for row in body]
        if name is None:
            continue
        if all(cell is None for cell in cells):
            series.append(passed_over(str(name), "empty (formulas have values once Excel has saved them)"))
            continue
        if any(isinstance(cell, datetime | time | timedelta) for cell in cells):
            cells, unit = _seconds(cells), "s"
        odd = next((i for i, cell in enumerate(cells) if not _numeric(cell) and cell is not None), None)
        if odd is not None:
            series.append(passed_over(str(name), f"no column of numbers (row {first + odd + 1})"))
            continue
        values = np.array([np.nan if cell is None else float(cell) for cell in cells])
        series.append(Series(str(name), unit, values))
    return series


def _numeric(cell: Any) -> bool:
    return isinstance(cell, int | float | datetime | time | timedelta) and not isinstance(cell, bool)


def _number_in_words(cell: Any) -> bool:
    return isinstance(cell, str) and re.fullmatch(r"\s*[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?\s*", cell) is not None


def _seconds(cells: list[Any]) -> list[Any]:
    """Dates and times of the day as seconds after the first."""
    day = datetime(2000, 1, 1)
    dated = [
        datetime.combine(day, c) if isinstance(c, time) else day + c if isinstance(c, timedelta) else c for c in cells
    ]
    start = next((c for c in dated if isinstance(c, datetime)), day)
    return [(c - start).total_seconds() if isinstance(c, datetime) else c for c in dated]
