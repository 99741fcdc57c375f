"""Excel's .xlsx by openpyxl: the columns below each sheet's header, units in brackets or in a row.

Rows above the header, words beside the numbers and notes of cells are read as comments of a text.
"""

import re
from dataclasses import replace
from datetime import datetime, time, timedelta
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.recording.channels import KNOWN_UNITS
from fasbody.recording.formats.series import REMARK, FormatError, Series, check_size, passed_over
from fasbody.recording.headings import read_statements

LIBRARY = "openpyxl"
#: Rows above which a sheet has its header.
_HEADER_ROWS = 200
#: So many words beside the numbers are read.
_WORDS = 1000
_NOTES = "http://schemas.openxmlformats.org/officeDocument/2006/relationships/comments"


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
        columns = _columns(sheet.title, rows, _notes(book, sheet))
        series += [replace(column, group=sheet.title) for column in columns]
    return series


def _notes(book: Any, sheet: Any) -> list[tuple[int, str]]:
    """The index of the column and the text of each note at a cell."""
    from openpyxl.comments.comment_sheet import CommentSheet
    from openpyxl.packaging.relationship import get_dependents, get_rels_path
    from openpyxl.utils.cell import column_index_from_string, coordinate_from_string
    from openpyxl.xml.functions import fromstring

    archive, path = book._archive, get_rels_path(sheet._worksheet_path)
    parts = get_dependents(archive, path).find(_NOTES) if path in archive.namelist() else ()
    notes = [
        note
        for part in parts
        for note in CommentSheet.from_tree(fromstring(archive.read(part.target))).comments
    ]
    places = [column_index_from_string(coordinate_from_string(place)[0]) - 1 for place, _ in notes]
    # one of a thread has its text behind a hint for older programs
    texts = [note.text.rpartition("Comment:\n")[2] for _, note in notes]
    return list(zip(places, texts, strict=True))


def _columns(sheet: str, rows: list[tuple[Any, ...]], notes: list[tuple[int, str]]) -> list[Series]:
    """Below the last row of texts before the first row of numbers; a row of units may stand between."""
    filled = [i for i, row in enumerate(islice(rows, _HEADER_ROWS)) if sum(map(_numeric, row)) >= 2]
    # one that begins with a word is a statement, unless all do
    first = next(
        (i for i in filled if not isinstance(next(filter(None, rows[i]), 0), str)),
        next(iter(filled), None),
    )
    if first is None:
        worded = next((i for i, row in enumerate(rows[:_HEADER_ROWS]) if sum(map(_number_in_words, row)) >= 2), None)
        if worded is None:
            text = " ".join(
                str(cell) for row in rows[:_HEADER_ROWS] for cell in row if cell is not None
            )
            return [passed_over(f"the sheet {sheet}", "no table of numbers", text)] if text else []
        raise FormatError(
            f"the sheet {sheet!r} keeps its numbers as text (row {worded + 1}); make them numbers in Excel"
        )
    above = [row for row in rows[:first] if any(cell is not None for cell in row)]
    heads = [i for i, row in enumerate(above) if sum(isinstance(cell, str) for cell in row) >= 2]
    if not heads:
        raise FormatError(f"the sheet {sheet!r} has no header row; write time_s, base_m_s2, ... above its numbers")
    header = above.pop(heads[-1])
    units: list[str] = [""] * len(rows[first])
    bare = [str(cell or "").strip(" []()") for cell in header]
    if len(heads) > 1 and any(cell.lower() in KNOWN_UNITS for cell in bare):
        units, header = (bare + units)[: len(units)], above.pop(heads[-2])
    rate, lines = read_statements(
        ["\t".join(str(cell) for cell in row if cell is not None) for row in above]
    )
    body = rows[first:]
    while body and not any(cell is not None for cell in body[-1]):
        body.pop()
    series, words = list[Series](), dict[str, None]()
    for index, unit in enumerate(units):
        cells = [row[index] if index < len(row) else None for row in body]
        name = header[index] if index < len(header) else None
        words |= dict.fromkeys(islice((cell for cell in cells if isinstance(cell, str)), _WORDS))
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
        series.append(Series(str(name), unit, values, rate))
    named = (f"{header[i] or ''}: {text}" if i < len(header) else text for i, text in notes)
    texts = (
        "\t".join(" ".join(cell.split()) for cell in line.split("\t"))
        for line in (*lines, *words, *named)
    )
    return [*series, passed_over(sheet, REMARK, "\n".join(texts))]


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
