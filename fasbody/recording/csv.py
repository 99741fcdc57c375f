"""CSV files as programs and countries write them: recordings, small tables, and any columns at all.

Encoding, separator, decimal comma, comments and quotes are understood, and what is wrong is named with its place.
"""

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO, StringIO
from itertools import islice, zip_longest
from pathlib import Path

import numpy as np

from fasbody.exceptions import InputFileError, shown
from fasbody.recording import headings, text
from fasbody.recording.channels import TIME_UNITS, Channels, Layout
from fasbody.recording.columns import Columns, Use, has_channels
from fasbody.recording.formats.series import Series
from fasbody.recording.headings import Headings
from fasbody.recording.statements import Statements, of_lines
from fasbody.sentences import Sentence

#: So many numbers show whether a column rises as a time does.
FIRST = 500
#: Longer texts are parsed by pandas, several times as fast as numpy's parser; importing it costs what this long takes.
_LONG = 5_000_000
#: So many comments between the numbers are read.
_COMMENTS = 1000
_PLAIN = b"0123456789+-.eE,;|\t\n "


@dataclass(frozen=True, eq=False)
class TextTable:
    """A recording's text: headings, and below them the numbers, which are parsed when they are needed.

    Attributes:
        passage: its lines in the file.
        head: the first piece of them.
        headings: what stands above the numbers, its lines counted from the first of the passage.
        passed: what else the file holds, in words.
        takes: how many tables of the file hold the channels.
        footer: lines of words behind the numbers, once these are read.
        comments: between the numbers, once these are read.
    """

    passage: text.Passage
    head: str
    headings: Headings
    passed: tuple[str, ...] = ()
    takes: int = 1
    tabular = True
    footer: list[str] = field(default_factory=list)
    comments: dict[str, None] = field(default_factory=dict)

    @classmethod
    def open(cls, file: Path, layout: Layout, strict: bool = True) -> "TextTable":
        """Find the headings, their units and where the numbers begin.

        Args:
            layout: its columns by study.toml.
            strict: refuse columns without names.
        """
        tables = list(_sections(file, layout, strict))
        if len(tables) == 1:
            return tables[0]
        takes = [table for table in tables if has_channels(table.columns, layout)] or tables[:1]
        if layout.take is None and len(takes) > 1:
            places = ", ".join(str(table.passage.first + 1) for table in takes)
            raise several_takes(file, len(takes), f"tables with the channels begin in lines {places}")
        taken = layout.one_of(file, takes)
        others = (
            f"the table from line {table.passage.first + 1} on ({shown(', '.join(table.names))})"
            for table in tables if table is not taken
        )  # fmt: skip
        return cls(taken.passage, taken.head, taken.headings, tuple(others), len(takes))

    @property
    def file(self) -> Path:
        """For messages."""
        return self.passage.file

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns."""
        return self.headings.names

    @cached_property
    def columns(self) -> Columns:
        """Its columns; a time of the day is in seconds."""
        cells = [*self.first_row, *[""] * len(self.names)]
        units = ["s" if index in self.stamped else unit or headings.unit_behind(cells[index])
                 for index, unit in enumerate(self.headings.units)]  # fmt: skip
        line, rate = self.passage.first + (self.headings.line or 1), self.headings.rate_hz
        made = [
            Series(name, unit, np.empty(0), rate)
            for name, unit in zip(self.names, units, strict=True)
        ]
        return Columns(made, line=line, first=cells)

    @property
    def skipped(self) -> tuple[str, ...]:
        """What of the text is in no use, in words."""
        comments = tuple(f"a comment ({shown(comment)})" for comment in self.comments)
        footer = (f"a footer ({shown(line)})" for line in self.footer)
        return (*self.headings.skipped, *comments, *footer, *self.passed)

    def words(self, _uses: Mapping[str, Use]) -> list[str]:
        """The lines of words beside the numbers."""
        return [*self.headings.beside, *self.comments, *self.footer]

    def stated(self, uses: Mapping[str, Use]) -> tuple[dict[str, Statements], list[str]]:
        """Statements of the channels in use by lines of words; and remarks on lines that are not understood."""
        names = {key.removesuffix("_m_s2"): self.names[use.index] for key, use in uses.items()}
        return of_lines(self.words(uses), self.headings.separator, names)

    @cached_property
    def first_row(self) -> list[str]:
        """The cells of the first row of numbers."""
        below = text.rows_below(self.head, self.headings.first, self.headings.separator)
        return next((cells for _, cells in below), [])

    @cached_property
    def stamped(self) -> frozenset[int]:
        """Columns of times of the day."""
        cells = self.first_row[: len(self.names)]
        return frozenset(i for i, cell in enumerate(cells) if headings.STAMP.fullmatch(cell))

    def numbers(self, indices: Mapping[str, int]) -> Channels:
        """Columns as floats (n,), NaN where a cell is empty, times of the day in seconds: by name, from their index."""
        _no_narrower(self)
        times = {name: index for name, index in indices.items() if index in self.stamped}
        rest = {name: index for name, index in indices.items() if index not in self.stamped}
        parts: dict[str, list[np.ndarray]] = {name: [] for name in indices}
        for after, body in self.bodies():
            for name, values in _numbers(self, body, after, rest).items() if rest else ():
                parts[name].append(values)
            for name, index in times.items():
                parts[name].append(_seconds(self.file, body, self.headings.separator, index, after))
        columns = {name: np.concatenate(parts.pop(name) or [np.empty(0)]) for name in indices}  # the pieces go
        for name, index in rest.items():
            _no_thousands(self, name, index, columns[name])
        for name, index in times.items():
            following = self.names[index + 1 : index + 2]
            beside = TIME_UNITS.get(following[0].lower()) if following else None
            if beside and not (columns[name] % 1).any():  # whole seconds, and the rest in a column called ms
                columns[name] = columns[name] + beside * self.numbers({"": index + 1})[""]
            columns[name] = headings.past_midnight(columns[name])
        return columns

    def bodies(self) -> Iterator[tuple[int, str]]:
        """How many lines of the file stand above each piece of the numbers, and the piece, without a footer."""
        above, pieces = self.passage.first + self.headings.first, self.passage.pieces()
        following = next(pieces, None)
        while following is not None:
            (at, piece), following = following, next(pieces, None)
            piece = piece[text.offset(piece, above - at) :] if at < above else piece
            if following is None:
                piece, self.footer[:] = headings.without_footer(piece, self.headings.separator)
            yield max(at, above), piece

    def sample(self) -> np.ndarray:
        """The first rows of numbers, (columns, rows); NaN where a cell is none."""
        below = (cells for _, cells in text.rows_below(self.head, self.headings.first, self.headings.separator))
        whole = (cells for cells in below if len(cells) == len(self.names) and any(map(text.numeric, cells)))
        kept = [[text.number(cell) if text.numeric(cell) else np.nan for cell in cells]
                for cells in islice(whole, FIRST)]  # fmt: skip
        return np.array(kept, float).reshape(len(kept), len(self.names)).T

    def refuse_gap(self, name: str, index: int) -> InputFileError:
        """A sentence on the first empty cell of a column."""
        line = next((line for line, cell in self.cells(index) if not cell), None)
        return InputFileError(self.file, f"{name} is '', not a number", line=line)

    def cells(self, index: int) -> Iterator[tuple[int, str]]:
        """Line and text of each cell of a column."""
        for after, body in self.bodies():
            for line, cells in text.rows(self.file, body, self.headings.separator, after):
                yield line, _at(cells, index)


def several_takes(file: Path, count: int, where: str) -> InputFileError:
    """A sentence on a file with more than one recording."""
    return InputFileError(
        file, f"holds {count} takes ({where})",
        f"say which one is meant: --take 1 to {count} (study.toml: [study] take = 1); fasbody recording "
        "convert --take writes one as a file of its own",
    )  # fmt: skip


def _sections(file: Path, layout: Layout, strict: bool) -> Iterator[TextTable]:
    """The tables of a text, one below the other: each begins with its headings."""
    passage: text.Passage | None = text.Passage(file)
    while passage is not None:
        table, passage = _table(passage, layout, strict), None
        if len(table.head) < text.PIECE and (end := _end(table)) is not None:
            passage = text.Passage(file, end)
            table = _table(text.Passage(file, table.passage.first, end), layout, strict)
        yield table


#: A line that begins with a letter.
_WORDED = re.compile(r"^[ \t\"',;|]*[^\W\d_][^\n]*$", re.MULTILINE)


def _end(table: TextTable) -> int | None:
    """How many lines of the file stand above the next headings below the numbers, None where there are none."""
    head, separator = table.head, table.headings.separator
    start = text.offset(head, table.headings.first)
    if _WORDED.match(head, start):
        return None  # each row begins with a word
    for match in _WORDED.finditer(head, start):
        if not any(map(headings.is_sample, text.split(match[0], separator))):
            if headings.header_above_numbers(head[match.start() :]) is None:
                return None
            return table.passage.first + head.count("\n", 0, match.start())
    return None


def _table(passage: text.Passage, layout: Layout, strict: bool) -> TextTable:
    """The headings of a passage, and where its numbers begin."""
    file, head = passage.file, next((piece for _, piece in passage.pieces()), "")
    header = headings.find_header(head, layout.known)
    hint = "the first line must be time_s,base_m_s2,malleolus_m_s2"
    if not any(header.names):
        raise InputFileError(file, "is empty", hint)
    known = layout.known(header.names)
    numbers = headings.first_number_row(head, header, layout) if layout.columns or not known else None
    if numbers is None:
        if not known and any(channel.column[:1] == "#" for channel in layout.channels.values()):
            header = headings.header_above_numbers(head) or header
        return TextTable(passage, head, headings.read_headings(head, header))
    if strict and not layout.columns:
        columns = ", or --columns time_s,base_g,... (study.toml: columns) must name its columns"
        remedy = Sentence(hint, Sentence(columns, on_page="; write it above the numbers"))
        raise InputFileError(file, "has no header line", remedy)
    line, separator, cells = numbers
    if layout.columns and not headings.fits(cells, layout.columns):
        listed = shown(", ".join(layout.columns))
        problem = f"has {len(cells)} columns, and {len(layout.columns)} are named ({listed})"
        raise InputFileError(file, problem, "name every column, with any word for those that are no channel", line)
    rate, others = headings.read_statements([row for row in islice(text.lines(head), line - 1) if row.strip()])
    units = layout.units or ("",) * len(layout.columns)
    skipped = tuple(f"a line above the numbers ({shown(' '.join(row.split()))})" for row in others)
    return TextTable(passage, head, Headings(separator, layout.columns, units, 0, line - 1, skipped, rate, others))


#: A last heading over cells that are written where there is something to say.
_REMARK = re.compile(r"comment|note|remark|marker|event|bemerkung|kommentar", re.IGNORECASE)


def _no_narrower(table: TextTable) -> None:
    """Refuse headings that are more than the cells below them, unless the last are of remarks."""
    body = headings.first_samples(table.head, table.headings.first, table.headings.separator)
    surplus = len(table.names) - len(body)
    while surplus > 0 and (not (last := table.names[len(body) + surplus - 1]) or _REMARK.search(last)):
        surplus -= 1
    if not body or surplus <= 0 or not table.headings.line:
        return
    raise InputFileError(
        table.file, f"names {len(body) + surplus} columns ({shown(', '.join(table.names))}), and its rows have "
        f"{len(body)} cells: which heading is whose cannot be known",
        "delete the heading that is none, or name the columns in study.toml (columns) and delete the header",
        table.columns.line,
    )  # fmt: skip


#: Thousands as a mark of three digits writes them; 0,125 is none.
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:[.,]\d{3})+")


def _no_thousands(table: TextTable, name: str, index: int, values: np.ndarray) -> None:
    """Refuse a column in which a mark between thousands would be taken for that of decimals: 8,100 beside 950."""
    if not all(map(_like_thousands, (values[:10_000], values))):
        return
    marked = bare = ""
    for _, cell in table.cells(index):
        if _THOUSANDS.fullmatch(cell):
            marked = marked or cell
        elif re.search(r"[.,eE]", cell):
            return
        elif cell and abs(float(cell)) >= 1:
            bare = bare or cell
    if marked and bare:
        raise InputFileError(
            table.file, f"{name} is {marked!r} and {bare!r}: a mark between thousands would be read as that of "
            "decimals", "write numbers without marks between thousands, or all with their decimals",
        )  # fmt: skip


def _like_thousands(values: np.ndarray) -> bool:
    """Whether numbers (n,) have three decimals or none, and none of the first kind is below 1."""
    thousandths = np.round(1e3 * values[np.isfinite(values)])
    if np.abs(1e3 * values[np.isfinite(values)] - thousandths).max(initial=0.0) > 1e-6:
        return False
    marked = thousandths[thousandths % 1000 != 0]
    return values.size > 0 and bool(np.abs(marked).min(initial=np.inf) >= 1000)


def _numbers(table: TextTable, body: str, after: int, indices: Mapping[str, int]) -> Channels:
    """The columns of these indices in a piece: fast for a sound one, else line by line to find the error."""
    separator, width = table.headings.separator, len(table.names)
    sample = table.first_row
    decimal = "," if any("," in sample[i] for i in indices.values() if i < len(sample)) else "."
    units = {headings.unit_behind(sample[i]) for i in indices.values() if i < len(sample)} - {""}
    for unit in units:
        behind = rf"(?<=\d)\s+{re.escape(unit)}(?=\"?\s*(?:{re.escape(separator)}|$))"
        body = re.sub(behind, "", body, flags=re.MULTILINE)
    if any(mark in body for mark in ("#", "%", "//")):  # a search by pattern takes as long as the parser
        body = _without_comments(table, body)
    data = body.encode()
    _no_wider(table, body, data, after)
    order = list(indices.values())
    try:
        columns = _parsed(data, separator, decimal, order, max(width, len(sample)))
        return dict(zip(indices, columns, strict=True))
    except (ValueError, TypeError):  # pandas' errors are ValueErrors, too
        pass
    kept: list[list[float]] = []
    for line, cells in text.rows(table.file, body, separator, after):
        named = [(name, _at(cells, index)) for name, index in indices.items()]
        kept.append([_number(table.file, name, cell, line) if cell else np.nan for name, cell in named])
    return dict(zip(indices, np.array(kept, float).reshape(-1, len(indices)).T.copy(), strict=True))


def _without_comments(table: TextTable, body: str) -> str:
    """A piece with an empty line for each comment, and without those at the ends of rows."""
    end = re.compile(rf"{re.escape(table.headings.separator)}\s*(#[^\t;,]*)$")
    kept, comments = list[str](), list[str]()
    for line in body.split("\n"):
        is_whole = text.COMMENT.match(line)
        match = None if is_whole else end.search(line)
        comments += [line.strip()] if is_whole else [match[1]] if match else []
        kept.append("" if is_whole else line[: match.start()] if match else line)
    room = max(0, _COMMENTS - len(table.comments))
    table.comments.update(dict.fromkeys(islice(comments, room)))
    return "\n".join(kept)


def _parsed(data: bytes, separator: str, decimal: str, order: Sequence[int], width: int) -> list[np.ndarray]:
    """Columns (n,) of a sound table, in this order, NaN where a cell is empty."""
    if not data.strip():
        return [np.empty(0) for _ in order]
    # pandas takes for numbers, or for none, what numpy refuses: 1_0, NA; where it is not needed it gets plain numbers
    plain = "pandas" in sys.modules and not data.translate(None, _PLAIN)
    if len(data) < _LONG and not plain:
        body = data.decode().replace(",", ".") if decimal == "," else data.decode()
        delimiter = None if separator == " " else separator
        table = np.loadtxt(StringIO(body), delimiter=delimiter, usecols=order, ndmin=2, comments=None, quotechar='"')
        if not np.isfinite(table).all():
            raise ValueError
        return list(table.T.copy())
    import pandas as pd

    # from 3.1 on pandas reads every digit by itself
    exact = tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1)
    frame = pd.read_csv(
        BytesIO(data), sep=r"\s+" if separator == " " else separator, decimal=decimal, header=None,
        names=list(range(width)), usecols=sorted(order), index_col=False, skipinitialspace=True,
        float_precision=None if exact else "round_trip", keep_default_na=False, na_values=[""],
    )  # fmt: skip
    columns = [frame.pop(index) if order.count(index) == 1 else frame[index] for index in order]
    if any(column.dtype.kind not in "fiu" or np.isinf(column).any() for column in columns):
        raise ValueError
    return [column.to_numpy(float).copy() for column in columns]


def _seconds(file: Path, body: str, separator: str, index: int, after: int) -> np.ndarray:
    """A column of times of the day (n,) [s]."""
    seconds = []
    for line, cells in text.rows(file, body, separator, after):
        cell = _at(cells, index)
        time = headings.seconds_of(cell)
        if time is None:
            raise InputFileError(file, f"time is {shown(cell)!r}, not a time of the day as above it", line=line)
        seconds.append(time)
    return np.array(seconds, float)


def _no_wider(table: TextTable, body: str, data: bytes, after: int) -> None:
    """Refuse a row with more cells than the header: its numbers would get into wrong columns."""
    separator, width = table.headings.separator, len(table.names)
    if _widest(data, separator) <= width:
        return
    for line, cells in text.rows(table.file, body, separator, after):
        if any(cells[width:]):
            hint = "if its decimals have commas, separate the columns by ;" if separator == "," else ""
            raise InputFileError(table.file, f"has {len(cells)} cells, and the header {width}", hint, line)


def _widest(data: bytes, separator: str) -> int:
    """Cells of the line with most of them, those in quotes counted apart."""
    if separator == " ":
        return max(len(line.split()) for line in data.split(b"\n"))
    letters = np.frombuffer(data + b"\n", np.uint8)
    ends, cuts = (np.flatnonzero(letters == ord(letter)) for letter in ("\n", separator))
    return int(np.diff(np.searchsorted(cuts, ends), prepend=0).max()) + 1


def _at(cells: Sequence[str], index: int) -> str:
    return cells[index] if index < len(cells) else ""


def _number(file: Path, name: str, cell: str, line: int) -> float:
    try:
        value = text.number(cell)
    except ValueError:
        hint = ""
        if re.fullmatch(r"[-+\d.,'’  \u202f]*\d[-+\d.,'’  \u202f]*", cell):
            hint = "write numbers without marks between thousands"
        if "∞" in cell:
            hint = "the instrument was out of its range; record with a larger one"
        raise InputFileError(file, f"{name} is {shown(cell)!r}, not a number", hint, line) from None
    if not np.isfinite(value):
        raise InputFileError(file, f"{name} is {shown(cell)!r}", "every sample must be finite", line=line)
    return value


#: A small table: line number -> column -> cell, None where it is empty.
Rows = dict[int, dict[str, str | None]]


def read_table(file: Path, needed: Sequence[str]) -> Rows:
    """Read a small table as text."""
    whole = text.read_text(file)
    line, separator, names = headings.find_header(whole, lambda cells: len(set(cells) & set(needed)))
    if not any(names):
        raise InputFileError(file, "is empty", f"its header must name {', '.join(needed)}")
    for name in needed:
        if name not in names:
            raise InputFileError(file, f"has no column {name!r} (found: {shown(', '.join(names))})", line=line)
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputFileError(file, f"has two columns {shown(twice)!r}", "keep one of them", line=line)
    records: Rows = {}
    for place, cells in text.rows(file, whole[text.offset(whole, line) :], separator, line):
        if any(cells[len(names) :]):
            raise InputFileError(file, f"has {len(cells)} cells, and the header {len(names)}", line=place)
        records[place] = {name: cell or None for name, cell in zip_longest(names, cells[: len(names)])}
    return records


def column(file: Path, table: Rows, name: str, optional: bool = False) -> np.ndarray:
    """One column of a table as numbers (n,); an empty cell, or a column that is not there, is NaN if `optional`."""
    cells = {line: row.get(name) or "" for line, row in table.items()}
    rows = [np.nan if optional and not cell else _number(file, name, cell, line) for line, cell in cells.items()]
    return np.array(rows, float)
