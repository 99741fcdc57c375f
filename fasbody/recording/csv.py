"""CSV files as programs and countries write them: recordings, small tables, and any columns at all.

Encoding, separator, decimal comma, comments and quotes are understood, and what is wrong is named with its place.
"""

import codecs
import csv
import gzip
import re
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO, StringIO
from itertools import islice, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fasbody.exceptions import InputFileError, shown
from fasbody.recording.channels import KNOWN_UNITS, Channels, Layout
from fasbody.recording.columns import Columns, Use

if TYPE_CHECKING:
    import pandas as pd

#: Larger files are refused before they are read [bytes].
_LARGEST = 500_000_000
#: What separates columns, in the order in which they are tried; a blank stands for any run of them.
SEPARATORS = ("\t", ";", "|", ",", " ")
#: A column of a file without a header, by its number.
UNNAMED = "column {}"
#: A line that begins so is a comment.
COMMENT = re.compile(r"\s*(#|%|//)")
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1f]")
_CONTROL = bytes([*range(0x09), *range(0x0E, 0x20)])  # the same, before they are letters
#: A line of measured numbers, which is no header.
_SAMPLES = re.compile(r"[\s\d.,;|eE+-]*\.[\s\d.,;|eE+-]*")
_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
#: A time of the day, with or without its date before it.
_STAMP = re.compile(
    r"(?:[\d./-]{8,10}[T ]+)?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)(?:Z|[+-]\d\d:?\d\d|\s*([AaPp])\.?[Mm]\.?)?"
)
#: Longer texts are parsed by pandas, several times as fast as numpy's parser; importing it costs what this long takes.
_LONG = 5_000_000
_PLAIN = b"0123456789+-.eE,;|\t\n "
_QUOTE = "opens a quotation mark that nothing closes"


def read_text(file: Path) -> str:
    """The text of a file in UTF-8, UTF-16 or the Latin alphabet of Windows, lines ended by a line feed.

    Raises:
        InputFileError: no such file, too large, or no text.
    """
    if not file.is_file():
        raise InputFileError(file, "no such file" if not file.is_dir() else "is a folder, not a file")
    if file.stat().st_size > _LARGEST:
        raise InputFileError(file, f"is larger than {_LARGEST // 1_000_000} MB", "split it into recordings")
    try:
        if file.suffix.lower() == ".gz":
            with gzip.open(file, "rb") as packed:
                data = packed.read(_LARGEST + 1)
        else:
            data = file.read_bytes()
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise InputFileError(file, "is not a sound .gz file; it is damaged, cut off, or of another format") from None
    except OSError as error:
        raise InputFileError(file, f"cannot be read ({error.strerror})") from None
    if len(data) > _LARGEST:
        raise InputFileError(file, f"unpacks to more than {_LARGEST // 1_000_000} MB", "split it into recordings")
    for encoding in _encodings(data):
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        clear = not encoding.startswith("utf-16") and len(data.translate(None, _CONTROL)) == len(data)
        if clear or not _BINARY.search(text):
            return text.replace("\r\n", "\n").replace("\r", "\n")
    raise InputFileError(file, "is not a text file", "a CSV file with a header line is needed")


def _encodings(data: bytes) -> tuple[str, ...]:
    if data.startswith(_MARKS):
        return ("utf-16",)
    start = data[:400]
    for first, name in ((1, "utf-16-le"), (0, "utf-16-be")):  # without its mark every other byte is still zero
        if len(start) >= 8 and start[first::2].count(0) > 0.9 * len(start[first::2]) and 0 not in start[1 - first :: 2]:
            return (name,)
    return ("utf-8-sig", "cp1252")


def split(line: str, separator: str) -> list[str]:
    """The cells of one line without blanks and quotation marks around them."""
    if separator == " ":
        return [cell.strip('"') for cell in line.split()]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
    except csv.Error:  # a cell longer than the module reads
        return [cell.strip() for cell in line.split(separator)]


def header(text: str, score: Callable[[Sequence[str]], int]) -> tuple[int, str, list[str]]:
    """Where the header is, below whatever a program wrote first: number of its line, separator, names.

    Args:
        text: of the file. score: how many of a line's cells are known names; the first line with most of them wins,
            and without any the first line that is not a comment.
    """
    best, found = 0, (1, ",", [""])
    for number, line in enumerate(islice(lines(text), 200), 1):
        if best and _SAMPLES.fullmatch(line):
            continue
        bare = re.sub(r"^\s*(#|%|//)\s*", "", line)  # some programs write the header as a comment
        for separator in SEPARATORS:
            if separator not in bare:
                continue
            names = split(bare, separator)
            if score(names) > best:
                best, found = score(names), (number, separator, names)
        if not best and not found[2][0] and line.strip() and not COMMENT.match(line):
            separator = next((s for s in SEPARATORS if s in line.strip()), ",")
            found = (number, separator, split(line, separator))
    return found


def lines(text: str, at: int = 0, longest: int = 20_000) -> Iterator[str]:
    """The lines of a text from a place on, each cut off where it is longer than any sensible one."""
    while at <= len(text):
        end = text.find("\n", at)
        end = len(text) if end < 0 else end
        yield text[at : min(end, at + longest)]
        at = end + 1


def offset(text: str, count: int) -> int:
    """Where the line after so many begins."""
    at = 0
    for _ in range(count):
        at = text.find("\n", at) + 1
        if not at:
            return len(text)
    return at


def rows(file: Path, text: str, separator: str, after: int) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of each line after one, without comments and empty lines.

    Raises:
        InputFileError: a quotation mark is never closed.
    """
    for number, line in enumerate(text.split("\n")[after:], after + 1):
        if not line.strip() or COMMENT.match(line):
            continue
        if line.count('"') % 2:
            raise InputFileError(file, _QUOTE, line=number)
        yield number, split(line, separator)


def number(cell: str) -> float:
    """A cell as a number, with decimal point or comma.

    Raises:
        ValueError: it is none.
    """
    if "_" in cell or ("," in cell and "." in cell):
        raise ValueError(cell)
    return float(cell.replace(",", "."))


@dataclass(frozen=True, eq=False)
class TextTable:
    """A recording's text: rows of headings, and below them the numbers, which are parsed when they are asked for.

    Attributes:
        file: for messages. text: whole. separator: of its columns. names, units: of the columns, a unit "" if no row
            says it. line: of the headings, 0 without. first: how many lines stand above the numbers.
        skipped: rows among the headings that were not used, in words.
    """

    file: Path
    text: str
    separator: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    line: int
    first: int
    skipped: tuple[str, ...] = ()

    @classmethod
    def open(cls, file: Path, layout: Layout, strict: bool = True) -> "TextTable":
        """Find the headings, their units and where the numbers begin.

        Args:
            file: the file. layout: what study.toml says of its columns. strict: refuse columns without names.

        Raises:
            InputFileError: it is no text or empty; or it has no header, and study.toml names its columns wrongly.
        """
        text, skipped = _without_footer(read_text(file))
        line, separator, names = header(text, layout.known)
        if not any(names):
            raise InputFileError(file, "is empty", "the first line must be time_s,base_m_s2,malleolus_m_s2")
        bare = None if layout.known(names) and not layout.columns else _headless(text, names, line, separator, layout)
        if bare is None:
            if not layout.known(names) and any(c.column[:1] == "#" for c in layout.channels.values()):
                line, separator, names = _above_numbers(text) or (line, separator, names)
            return _headed(file, text, line, separator, names, skipped)
        line, separator, width = bare
        if strict and not layout.columns:
            raise InputFileError(
                file, "has no header line",
                "the first line must be time_s,base_m_s2,malleolus_m_s2, or --columns time_s,base_g,... (study.toml: "
                "columns) must name its columns",
            )  # fmt: skip
        if layout.columns and width != len(layout.columns):
            listed = shown(", ".join(layout.columns))
            raise InputFileError(
                file, f"has {width} columns, and {len(layout.columns)} are named ({listed})",
                "name every column, with any word for those that are no channel", line,
            )  # fmt: skip
        units = layout.units or ("",) * len(layout.columns)
        return cls(file, text, separator, layout.columns, units, 0, line - 1, skipped)

    @property
    def columns(self) -> Columns:
        """Its columns; a time of the day is in seconds."""
        units = ["s" if index in self.stamped else unit for index, unit in enumerate(self.units)]
        return Columns(self.names, units, line=self.line or 1)

    def rate_hz(self, uses: Mapping[str, Use], layout: Layout) -> None:
        """A text states no rate."""

    def starts(self, uses: Mapping[str, Use], time_s: np.ndarray) -> Channels:
        """A text states no start."""
        return {}

    @cached_property
    def stamped(self) -> frozenset[int]:
        """Columns of times of the day."""
        cells = _row(self.text, self.first, self.separator)
        return frozenset(i for i, cell in enumerate(cells[: len(self.names)]) if _STAMP.fullmatch(cell))

    def numbers(self, wanted: Mapping[str, int]) -> Channels:
        """Columns as floats (n,), times of the day in seconds: by name, from their index.

        Raises:
            InputFileError: a cell is no finite number; a row has more cells than headings, or fewer.
        """
        times = {name: index for name, index in wanted.items() if index in self.stamped}
        rest = {name: index for name, index in wanted.items() if index not in self.stamped}
        _no_narrower(self, wanted)
        found = _numbers(self.file, self.text, self.separator, self.names, rest, self.first) if rest else {}
        for name, values in found.items():
            _no_thousands(self, name, rest[name], values)
        clocks = {name: _seconds(self.file, self.text, self.separator, i, self.first) for name, i in times.items()}
        return {name: (clocks | found)[name] for name in wanted}

    def sample(self, most: int = 500) -> np.ndarray:
        """The first rows of numbers, (columns, rows); NaN where a cell is none."""
        kept: list[list[float]] = []
        for row in lines(self.text, offset(self.text, self.first)):
            cells = [] if COMMENT.match(row) else split(row, self.separator)
            if len(kept) < most and len(cells) == len(self.names) and any(map(numeric, cells)):
                kept.append([number(cell) if numeric(cell) else np.nan for cell in cells])
        return np.array(kept, float).reshape(-1, len(self.names)).T


def _headless(
    text: str, names: Sequence[str], line: int, separator: str, layout: Layout
) -> tuple[int, str, int] | None:  # fmt: skip
    """Line, separator and width of the first row of numbers where no line is a header, None where one is.

    Args:
        text: whole. names, line, separator: what `header` took for headings.
        layout: where study.toml names the columns, lines of words above as many numbers are a preamble.
    """
    if all(_value(cell) for cell in names if cell):
        return line, separator, len(names)
    rows_of_numbers = _rows_of_numbers(text) if layout.columns else iter(())
    return next((row for row in rows_of_numbers if row[2] == len(layout.columns)), None)


def _rows_of_numbers(text: str) -> Iterator[tuple[int, str, int]]:
    """Line, separator and width of the first rows of samples alone."""
    for number, row in enumerate(islice(lines(text), 200), 1):
        separator = next((s for s in SEPARATORS if s in row.strip()), ",")
        cells = split(row, separator)
        if row.strip() and not COMMENT.match(row) and all(map(_value, cells)) and len(cells) > 1:
            yield number, separator, len(cells)


def _above_numbers(text: str) -> tuple[int, str, list[str]] | None:
    """The row of headings above the first row of samples, and above its units: line, separator, names."""
    for first, separator, width in _rows_of_numbers(text):
        above = list(enumerate(islice(lines(text), first - 1), 1))
        for number, row in reversed(above):
            names = split(row, separator)
            worded = len(names) > width // 2 and not any(map(numeric, names))
            if worded and not any(_bare(name).lower() in KNOWN_UNITS for name in names):
                return number, separator, names
        return None
    return None


def _without_footer(text: str) -> tuple[str, tuple[str, ...]]:
    """The text without lines of words behind the last number, and what was left out."""
    end, words = len(text), list[str]()
    while end > 0 and len(words) < _HEADING_ROWS:
        start = text.rfind("\n", 0, end - 1) + 1
        line = text[start:end].strip()
        if COMMENT.match(line) or any(map(numeric, re.split(r"[,;|\s]+", line))):
            break
        words += [line] if line else []
        end = start
    if not words or end == 0:
        return text, ()
    return text[:end], tuple(f"a footer ({shown(word)})" for word in reversed(words))


def _bare(cell: str) -> str:
    """A unit without the brackets around it."""
    return re.sub(r"^[\[(]\s*|\s*[\])]$", "", cell)


def _value(cell: str) -> bool:
    """Whether a cell is a sample: a number or a time of the day."""
    return numeric(cell) or _STAMP.fullmatch(cell) is not None


def _headed(
    file: Path, text: str, line: int, separator: str, names: Sequence[str], footer: Sequence[str]
) -> TextTable:  # fmt: skip
    """The rows of headings from one line to the first row of numbers: names, parts of names, units, counts."""
    names, rows_above = list(names), line
    body = _first_samples(text, line, separator)
    width = len(body)
    if len(names) == width + 1 and _TITLED.fullmatch(names[0]):  # as Qualisys: CHANNEL_NAMES in front of the names
        names = names[1:]
    names = _merged(names, body)
    above = _above(text, line, separator, names)
    if above is not None:
        names = [f"{group} {name}".strip() for group, name in zip(_merged(above, body), names, strict=True)]
    units, skipped = [""] * len(names), list(footer)
    while rows_above < line + _HEADING_ROWS:
        cells = (_row(text, rows_above, separator) + [""] * len(names))[: len(names)]
        bare = [_bare(cell) for cell in cells]
        if any(map(numeric, cells)):
            if not _counts(text, cells, body, rows_above, separator):
                break
            skipped.append(f"a row of counts ({shown(separator.join(cells))})")
        elif any(cell.lower() in KNOWN_UNITS for cell in bare):
            units = bare
        elif not any(units) and _parts(cells, names):
            names = [f"{name} {part}".strip() for name, part in zip(names, cells, strict=True)]
        else:
            break
        rows_above = _line_of_row(text, rows_above)
    return TextTable(file, text, separator, tuple(names), tuple(units), line, rows_above, tuple(skipped))


#: Rows of headings, units and counts at most.
_HEADING_ROWS = 12
#: What stands in front of a row of names and is none.
_TITLED = re.compile(r"[A-Z]+_NAMES", re.IGNORECASE)


def _first_samples(text: str, line: int, separator: str) -> list[str]:
    """The cells of the fullest of the first rows of numbers below a line."""
    found: list[str] = []
    for row in islice(lines(text, offset(text, line)), _HEADING_ROWS):
        cells = [] if COMMENT.match(row) else split(row, separator)
        if sum(map(_value, cells)) > sum(map(_value, found)):
            found = cells
    while found and not found[-1]:
        found.pop()
    return found


def _merged(names: Sequence[str], body: Sequence[str]) -> list[str]:
    """Names with that of a merged cell over each of its columns, as far as these hold numbers."""
    filled: list[str] = []
    for index, name in enumerate(names):
        over = not name and index < len(body) and numeric(body[index]) and any(filled)
        filled.append(filled[-1] if over else name)
    return filled


def _above(text: str, line: int, separator: str, names: Sequence[str]) -> list[str] | None:
    """The row of merged cells above headings that repeat themselves, as X, Y, Z, X, Y, Z."""
    some = [name for name in names if name]
    if line < 2 or len(set(some)) == len(some):
        return None
    cells = split(next(lines(text, offset(text, line - 2))), separator)
    cells = (cells + [""] * len(names))[: len(names)]
    return cells if any(cells) and not any(map(numeric, cells)) and "" in cells else None


def _parts(cells: Sequence[str], names: Sequence[str]) -> bool:
    """Whether a row of words holds parts of the names above it: one for each column under a merged name."""
    repeated = [cell for name, cell in zip(names, cells, strict=True) if name and names.count(name) > 1]
    return bool(repeated) and all(repeated)


def _counts(text: str, cells: Sequence[str], body: Sequence[str], line: int, separator: str) -> bool:
    """Whether a row holds counts of samples: one whole number in all cells, and none where samples have one."""
    given = {cell for cell in cells if cell}
    lacking = any(not cell and index < len(body) and _value(body[index]) for index, cell in enumerate(cells))
    return lacking and len(given) == 1 and given.pop().isdigit()


def _line_of_row(text: str, after: int) -> int:
    """The number of the first line that holds cells after so many lines."""
    for number, row in enumerate(lines(text, offset(text, after)), after + 1):
        if row.strip() and not COMMENT.match(row):
            return number
    return after + 1


def _no_narrower(table: TextTable, wanted: Mapping[str, int]) -> None:
    """Refuse headings that are more than the cells below them, unless a time of its name shows which are which."""
    body = _first_samples(table.text, table.first, table.separator)
    surplus = len(table.names) - len(body)
    while surplus > 0 and not table.names[len(body) + surplus - 1]:
        surplus -= 1
    if not body or surplus <= 0 or not table.line or "time_s" in wanted or "time" in wanted:
        return
    raise InputFileError(
        table.file, f"names {len(body) + surplus} columns ({shown(', '.join(table.names))}), and its rows have "
        f"{len(body)} cells: which heading is whose cannot be known",
        "delete the heading that is none, or name the columns in study.toml (columns) and delete the header",
        table.line,
    )  # fmt: skip


#: Thousands as a mark of three digits writes them; 0,125 is none.
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:[.,]\d{3})+")


def _no_thousands(table: TextTable, name: str, index: int, values: np.ndarray) -> None:
    """Refuse a column in which a mark between thousands would be taken for that of decimals: 8,100 beside 950."""
    thousandths = np.round(1e3 * values)
    whole = thousandths % 1000 == 0
    if whole.all() or not whole.any() or np.abs(1e3 * values - thousandths).max() > 1e-6:
        return  # numbers with other than three decimals
    if np.abs(values[~whole]).min() < 1:
        return
    marked = bare = ""
    for _, cells in rows(table.file, table.text, table.separator, table.first):
        cell = cells[index]
        if _THOUSANDS.fullmatch(cell):
            marked = marked or cell
        elif re.search(r"[.,eE]", cell):
            return
        elif abs(float(cell)) >= 1:
            bare = bare or cell
    if marked and bare:
        raise InputFileError(
            table.file, f"{name} is {marked!r} and {bare!r}: a mark between thousands would be read as that of "
            "decimals", "write numbers without marks between thousands, or all with their decimals",
        )  # fmt: skip


def _row(text: str, after: int, separator: str) -> list[str]:
    """The cells of the first row after so many lines."""
    found = (line for line in lines(text, offset(text, after)) if line.strip() and not COMMENT.match(line))
    return split(next(found, ""), separator)


def numeric(cell: str) -> bool:
    """Whether a cell is a number, with decimal point or comma."""
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
    marked = any(mark in body for mark in ("#", "%", "//"))  # a search by pattern takes as long as the parser
    if marked and (COMMENT.match(body) or re.search(rf"\n{COMMENT.pattern}", body)):
        body = "\n".join(line for line in body.split("\n") if not COMMENT.match(line))
    order = list(wanted.values())
    try:
        table = _parsed(body, separator, decimal, order, max(len(names), len(sample)))
        if order and np.isfinite(table).all():
            return dict(zip(wanted, table.T.copy(), strict=True))
    except (ValueError, TypeError):  # pandas' errors are ValueErrors, too
        pass
    kept: list[list[float]] = []
    for line, cells in rows(file, text, separator, first):
        kept.append([_cell(file, name, cells, index, line) for name, index in wanted.items()])
    table = np.array(kept, float).reshape(-1, len(wanted))
    return dict(zip(wanted, table.T, strict=True))


def _parsed(body: str, separator: str, decimal: str, order: Sequence[int], width: int) -> np.ndarray:
    """Columns of a sound table (n, columns), in this order.

    Raises:
        ValueError, TypeError: something in them is no number.
    """
    if not body.strip():
        return np.empty((0, len(order)))
    # pandas takes for numbers, or for none, what numpy refuses: 1_0, NA; where it is not needed it gets plain numbers
    plain = "pandas" in sys.modules and not body.encode().translate(None, _PLAIN)
    if len(body) < _LONG and not plain:
        body = body.replace(",", ".") if decimal == "," else body
        delimiter = None if separator == " " else separator
        return np.loadtxt(StringIO(body), delimiter=delimiter, usecols=order, ndmin=2, comments=None, quotechar='"')
    import pandas as pd

    frame = pd.read_csv(
        BytesIO(body.encode()), sep=r"\s+" if separator == " " else separator, decimal=decimal, header=None,
        names=list(range(width)), usecols=sorted(order), index_col=False, skipinitialspace=True,
        float_precision=None if _exact(pd.__version__) else "round_trip",
    )  # fmt: skip
    return np.column_stack([frame[index].to_numpy(float) for index in order])


def _exact(version: str) -> bool:
    """Whether pandas reads every digit by itself, as it does from 3.1 on."""
    return tuple(map(int, version.split(".")[:2])) >= (3, 1)


def _seconds(file: Path, text: str, separator: str, index: int, first: int) -> np.ndarray:
    """A column of times of the day (n,) [s]; a recording may pass midnight."""
    found = []
    for line, cells in rows(file, text, separator, first):
        cell = cells[index] if index < len(cells) else ""
        stamp = _STAMP.fullmatch(cell)
        if stamp is None:
            raise InputFileError(file, f"time is {shown(cell)!r}, not a time of the day as above it", line=line)
        hour = int(stamp[1]) if stamp[4] is None else int(stamp[1]) % 12 + 12 * (stamp[4] in "Pp")
        found.append(3600 * hour + 60 * int(stamp[2]) + float(stamp[3].replace(",", ".")))
    times = np.array(found)
    passed = np.concatenate([[0], np.cumsum(np.diff(times) < -43_200)]) if times.size else times
    return times + 86_400 * passed


def _no_wider(file: Path, text: str, separator: str, width: int, first: int) -> None:
    """Refuse a row with more cells than the header: its numbers would get into wrong columns."""
    if _widest(text[offset(text, first) :], separator) <= width:
        return
    for line, cells in rows(file, text, separator, first):
        if any(cells[width:]):
            hint = "if its decimals have commas, separate the columns by ;" if separator == "," else ""
            raise InputFileError(file, f"has {len(cells)} cells, and the header {width}", hint, line)


def _widest(body: str, separator: str) -> int:
    """Cells of the line with most of them, those in quotes counted apart."""
    if separator == " ":
        return max(len(line.split()) for line in body.split("\n"))
    letters = np.frombuffer(f"{body}\n".encode(), np.uint8)
    ends, cuts = (np.flatnonzero(letters == ord(letter)) for letter in ("\n", separator))
    return int(np.diff(np.searchsorted(cuts, ends), prepend=0).max()) + 1


def _cell(file: Path, name: str, cells: Sequence[str], index: int, line: int) -> float:
    cell = cells[index] if index < len(cells) else ""
    try:
        value = number(cell)
    except ValueError:
        hint = "write numbers without marks between thousands" if re.fullmatch(r"[-+\d.,]*\d[-+\d.,]*", cell) else ""
        raise InputFileError(file, f"{name} is {shown(cell)!r}, not a number", hint, line) from None
    if not np.isfinite(value):
        raise InputFileError(file, f"{name} is {shown(cell)!r}", "every sample must be finite", line=line)
    return value


#: A small table: line number -> column -> cell, None where it is empty.
Rows = dict[int, dict[str, str | None]]


def read_table(file: Path, needed: Sequence[str]) -> Rows:
    """Read a small table as text.

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
    found: Rows = {}
    for place, cells in rows(file, text, separator, line):
        if any(cells[len(names) :]):
            raise InputFileError(file, f"has {len(cells)} cells, and the header {len(names)}", line=place)
        found[place] = {name: cell or None for name, cell in zip_longest(names, cells[: len(names)])}
    return found


def column(file: Path, table: Rows, name: str, optional: bool = False) -> np.ndarray:
    """One column of a table as numbers (n,); an empty cell, or a column that is not there, is NaN if `optional`."""
    cells = {line: row.get(name) for line, row in table.items()}
    return np.array(
        [np.nan if optional and not cell else _cell(file, name, [cell or ""], 0, line) for line, cell in cells.items()],
        float,
    )


def read_columns(file: Path) -> "pd.DataFrame":
    """Read all columns of any table, under the names of its first line, or as `UNNAMED` where that holds numbers.

    Raises:
        InputFileError: it is no table, or a row has more cells than the header.
    """
    import pandas as pd

    text = read_text(file)
    _, separator, names = header(text, lambda cells: 0)
    headed = not all(numeric(cell) for cell in names if cell)
    try:
        table = pd.read_csv(
            StringIO(text), sep=r"\s+" if separator == " " else separator, header=0 if headed else None,
            skipinitialspace=True, comment="#",
        )  # fmt: skip
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise InputFileError(file, f"cannot be read as CSV ({reason})", "give rows of numbers") from None
    if not isinstance(table.index, pd.RangeIndex):
        raise InputFileError(
            file, "its rows have more cells than its header",
            "write decimal points where there are decimal commas, or separate the columns by semicolons",
        )  # fmt: skip
    columns = map(str, table.columns) if headed else (UNNAMED.format(n) for n in range(1, table.shape[1] + 1))
    return table.set_axis([name.strip() for name in columns], axis=1)
