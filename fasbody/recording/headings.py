"""What stands above the numbers of a text: words, names of columns, their units; where the numbers begin.

Programs write, in this order and with all but the names left out at will::

    Logger 4711; Interval= 0.001 s     a preamble, which may state the sampling rate
    Base,,,Ankle,,                     merged cells over several columns
    X,Y,Z,X,Y,Z                        the names, on the line of the header
    g,g,g,g,g,g                        parts of the names, units, counts of samples, statements
    0.1,0.2,0.9,0.1,0.3,0.8            the numbers
    End of file                        a footer

`find_header` finds the line of the header, `read_headings` reads from there to the numbers, and
`read_statements` the preamble.
"""

import contextlib
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np

from fasbody.exceptions import shown
from fasbody.presentation import counted
from fasbody.recording import text as texts
from fasbody.recording.channels import KNOWN_UNITS, TIME_UNITS, Layout
from fasbody.recording.formats.series import FormatError, stated_rate

#: A line of measured numbers, which is no header.
_SAMPLES = re.compile(r"[\s\d.,;|eE+-]*\.[\s\d.,;|eE+-]*")
#: A time of the day, with or without its date before it; without its hour it has decimals.
STAMP = re.compile(
    r"(?:(?:[\d./-]{8,10}|\d{1,2}-[A-Za-z]{3}-\d{4})[T ]+)?"
    r"(?:(\d{1,2}):(?=\d\d:\d\d)|(?=\d\d:\d\d[.,]))(\d\d):(\d\d(?:[.,]\d+)?)"
    r"(?:Z|[+-]\d\d:?\d\d|\s*([AaPp])\.?[Mm]\.?)?"
)
#: A number with its unit behind it: ``0.001 sec``.
_MEASURED = re.compile(r"([-+]?[\d.,]+(?:e[-+]?\d+)?)\s+(\D\S*)", re.IGNORECASE)
#: Units of a time that counts from 1970, by the power of ten in the years 2001 to 2286.
_EPOCHS = {9: "s", 12: "ms", 15: "us", 18: "ns"}
#: Lines in which a header is looked for, and rows of headings, units and counts at most.
_HEADER_LINES, _HEADING_ROWS = 200, 12
#: What Excel reads of a separator.
_OF_EXCEL = re.compile(r'"?sep=', re.IGNORECASE)
#: What stands in front of a row of names (Qualisys: CHANNEL_NAMES), or of statements below them.
_TITLE = re.compile(r"[A-Z]+_NAMES|\w+=", re.IGNORECASE)
_KEY = re.compile(r"[A-Za-z][\w ]+[=.:]?")
#: A name, perhaps its unit, and a number with its unit: ``Sampling frequency [Hz],1000``.
_STATEMENT = re.compile(
    r"^\W*(?P<name>[A-Za-z][A-Za-z_ -]*?)\s*(?:[\[(](?P<of>[^\])]*)[\])])?\s*"
    r"[=:;,\t ]+(?:analog:)?\s*(?P<number>\d[\d.]*(?:e[-+]?\d+)?)\s*(?P<unit>[a-zµ/]*)",
    re.IGNORECASE,
)
#: The same of BIOPAC and ActiGraph, the number first.
_NUMBER_FIRST = {
    "dt": re.compile(r"^(?P<number>\d[\d.]*)\s*(?P<unit>msec|sec|ms|s)/sample", re.IGNORECASE),
    "fs": re.compile(r"date format .* at (?P<number>\d+)\s*(?P<unit>hz)\b", re.IGNORECASE),
}
_STATED_UNITS = {"hz": 1.0, "khz": 1e3, "": 1.0} | TIME_UNITS
#: Behind a rate that is not that of the samples in the file, and a number whose mark may be one of thousands.
_NOT_STORED = re.compile(r"every|decimat|stored|original|reduc|downsampl|resampl|^[.,]?\d", re.IGNORECASE)
_THOUSANDS = re.compile(r"\d{1,3}\.\d{3}")
#: What texts call a sampling rate (fs) or interval (dt), besides the names of `stated_rate`.
_STATED_NAMES = dict.fromkeys(
    ("rate", "sample_frequency", "scan_rate", "data_rate", "acquisition_rate", "abtastrate",
     "abtastfrequenz"), "fs"
) | dict.fromkeys(
    ("interval", "sample_interval", "sample_period", "sampling_period", "sample_time",
     "time_step", "delta_x"), "dt"
)  # fmt: skip


#: Lists of JSON that only name the columns.
_NAMING = frozenset(("column", "label", "sensor", "channel", "name"))


class Header(NamedTuple):
    """The row with the names of the columns: its line in the text, from 1, what separates them, and they."""

    line: int
    separator: str
    names: list[str]


@dataclass(frozen=True)
class Headings:
    """What a text says of its columns.

    Attributes:
        separator: between cells.
        names: of the columns.
        units: of the columns, "" where no row states it.
        line: number of the line of the names, 0 without.
        first: how many lines stand above the numbers.
        skipped: rows that are in no use, in words.
        rate_hz: the sampling rate that a line states.
        beside: lines that may state something of a channel.
    """

    separator: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    line: int
    first: int
    skipped: tuple[str, ...] = ()
    rate_hz: float | None = None
    beside: tuple[str, ...] = ()


def find_header(text: str, score: Callable[[Sequence[str]], int]) -> Header:
    """The line with most known names, and with as many cells as the numbers; without any the first that is no comment.

    Args:
        text: of the file.
        score: how many of a line's cells are known names.
    """
    best, header, rows = (0, False), Header(1, ",", [""]), _usual_row(text)
    for number, line in enumerate(islice(texts.lines(text), _HEADER_LINES), 1):
        if (best[0] and _SAMPLES.fullmatch(line)) or _OF_EXCEL.match(line):
            continue
        uncommented = re.sub(r"^\s*(#|%|//)\s*", "", line)  # some write the header as a comment
        for separator in _separators(uncommented, *rows):
            names = texts.split(uncommented, separator)
            rank = score(names), (separator, len(names)) == rows
            if rank[0] and rank > best:
                best, header = rank, Header(number, separator, names)
        if not best[0] and not header.names[0] and line.strip() and not texts.COMMENT.match(line):
            separator = texts.separator_of(line)
            header = Header(number, separator, texts.split(line, separator))
    return header


def _usual_row(text: str) -> tuple[str, int]:
    """What separates the cells of most rows of numbers, and how many there are."""
    rows = Counter[tuple[str, int]]()
    for line in islice(texts.lines(text), _HEADER_LINES):
        separator = texts.separator_of(line)
        cells = texts.split(line, separator)
        samples = sum(map(is_sample, cells))
        if samples > 1 and 2 * samples > sum(map(bool, cells)) and not texts.COMMENT.match(line):
            rows[separator, len(cells)] += 1
    return max(rows, key=lambda row: rows[row], default=(",", 0))


def _separators(line: str, usual: str, count: int) -> list[str]:
    """By what a line may be separated: only as the rows of numbers are, if that makes as many cells."""
    if usual in line and len(texts.split(line, usual)) == count:
        return [usual]
    return [separator for separator in texts.SEPARATORS if separator in line]


def first_number_row(text: str, header: Header, layout: Layout) -> Header | None:
    """The first row of numbers of a text without a header, in its place; None where there is a header.

    Args:
        text: whole.
        header: by `find_header`.
        layout: where study.toml names the columns, words above as many numbers are a preamble.
    """
    if all(is_sample(cell) for cell in header.names if cell):
        return header
    channels = [index for index, name in enumerate(layout.columns) if layout.known([name])]
    rows = list(_rows_of_numbers(text, channels)) if layout.columns else []
    fitting = [row for row in rows if fits(row.names, layout.columns)]
    ends = [
        i
        for i, (row, following) in enumerate(pairwise(fitting), 1)
        if following.line > row.line + 1
    ]
    runs = list(pairwise([0, *ends, len(fitting)])) if fitting else []
    longest = max(
        runs, key=lambda run: run[1] - run[0], default=None
    )  # shorter ones are of the preamble
    return None if longest is None else fitting[longest[0]]


def fits(cells: Sequence[str], columns: Sequence[str]) -> bool:
    """Whether there is a cell for each column, and perhaps an empty one behind the last."""
    return len(cells) == len(columns) or (len(cells) == len(columns) + 1 and not cells[-1])


def _rows_of_numbers(text: str, needed: Sequence[int] = ()) -> Iterator[Header]:
    """The rows with samples in the needed columns, all unless two are named."""
    for number, line in enumerate(islice(texts.lines(text), _HEADER_LINES), 1):
        cells = texts.split(line, texts.separator_of(line))
        samples = [cells[i] for i in needed if i < len(cells)] if len(needed) > 1 else cells
        if len(cells) > 1 and not texts.COMMENT.match(line) and all(map(is_sample, samples)):
            yield Header(number, texts.separator_of(line), cells)


def header_above_numbers(text: str) -> Header | None:
    """The row of headings above the first row of samples, and above its units.

    A row of units is the header where no other row of words stands above it.
    """
    first = next(_rows_of_numbers(text), None)
    if first is None:
        return None
    units, separator = None, first.separator
    for number, row in reversed(list(enumerate(islice(texts.lines(text), first.line - 1), 1))):
        names = texts.split(row, separator)
        if len(names) < len(first.names) or any(map(texts.numeric, names)):
            continue
        if not any(without_brackets(name).lower() in KNOWN_UNITS for name in names):
            return Header(number, separator, names)
        units = units or Header(number, separator, names)
    return units


def read_headings(text: str, header: Header) -> Headings:
    """Names, units and statements from the header's line to the first row of numbers.

    Args:
        text: from its first line on.
        header: by `find_header`.
    """
    line, separator, names = header
    samples = first_samples(text, line, separator)
    titled = bool(_TITLE.fullmatch(names[0])) or (
        bool(names[0]) and bool(samples) and not samples[0]
    )
    if titled and len(names) == len(samples) + 1:
        names = names[1:]
    names = _spread(names, samples)
    groups = _merged_cells_above(text, header, names)
    if groups:
        groups = _spread(groups, samples)
        names = [f"{group} {name}".strip() for group, name in zip(groups, names, strict=True)]
    units, first = [""] * len(names), line
    skipped, statements, words, ranges = list[str](), list[str](), list[str](), list[str]()
    for number, row in texts.rows_below(text, line, separator):
        cells = _fitted(row, len(names))
        if number > line + _HEADING_ROWS:
            break
        if _are_parts(cells, names):
            repeated = [names.count(name) > 1 for name in names]
            units = ["" if again else without_brackets(cell)
                     for again, cell in zip(repeated, cells, strict=True)]  # fmt: skip
            names = [f"{name} {cell}".strip() if again else name
                     for again, name, cell in zip(repeated, names, cells, strict=True)]  # fmt: skip
        elif _are_units(cells) and not (titled and any(units)):
            statements += [f"{name} = {cell}" for name, cell in zip(names, cells, strict=True)
                           if texts.numeric(cell)]  # fmt: skip
            units = ["" if texts.numeric(cell) else without_brackets(cell) for cell in cells]
            while units and len(units) > len(samples) and not units[-1]:
                names, units = names[:-1], units[:-1]  # as Rigol: the increment behind the units
        elif _are_counts(cells, samples):
            skipped.append(f"a row of counts ({shown(separator.join(cells))})")
        elif (
            not titled
            and len(row) in (1, len(names))
            and _are_words(cells)
            and 1 < len(names) == len(samples)
        ):
            skipped.append(f"a row of words ({shown(separator.join(cells))})")
            words.append(separator.join(row))
        elif titled and _KEY.fullmatch(cells[0]):
            statements.append(separator.join(dict.fromkeys(row)))
            spans = [unit_behind(cell) for cell in cells[1:]]
            ranges = ["", *spans] if spans and all(spans) else ranges
        else:
            break
        first = number
    units = units if any(units) or not ranges else ranges
    above = islice(texts.lines(text), line - (2 if groups else 1))
    rate, others = read_statements([*(row for row in above if row.strip()), *statements])
    if others:
        count = counted(len(others), "line")
        listed = "; ".join(" ".join(line.split()) for line in others)
        skipped.append(f"{count} beside the headings ({shown(listed)})")
    return Headings(
        separator, tuple(names), tuple(units), line, first, tuple(skipped), rate, (*others, *words)
    )


def read_statements(above: Sequence[str]) -> tuple[float | None, tuple[str, ...]]:
    """The sampling rate [Hz] that lines state, and the lines that state none.

    Where two lines disagree, neither counts.
    """
    rates, others = list[tuple[str, float | None]](), list[str]()
    for line in (part for whole in above for part in _of_json(whole) or [whole]):
        rate = _stated_rate(line)
        if rate is not None:
            rates.append(rate)
        elif line.strip(' \t,;#%/-"'):
            others.append(line.rstrip())
    try:
        return stated_rate(rates), tuple(others)
    except FormatError:
        return None, tuple(line.rstrip() for line in above if line.strip())


def _of_json(line: str) -> list[str]:
    """A line for each name of a comment that is JSON, unless it has tables in a list, or none."""
    match = re.fullmatch(r"[\s#%/]*(\{.*\})\s*", line)
    made = list[str]()

    def gather(table: dict[str, object]) -> None:
        for key, value in table.items():
            cells = [str(cell) for cell in (value if isinstance(value, list) else [value])]
            if len(cells) == 1 or key.lower().rstrip("s") not in _NAMING:
                made.append(f"{key}: {cells[0]}" if len(cells) == 1 else " ".join([key, *cells]))

    if match and not re.search(r"\[\s*\{", line):
        with contextlib.suppress(ValueError, RecursionError):
            json.loads(match[1], object_hook=gather)
    return made


def _stated_rate(line: str) -> tuple[str, float] | None:
    """The name of a rate or interval as in `stated_rate`, and its number in Hz or s."""
    match = _STATEMENT.match(line)
    if match and match["name"] == "FREQUENCY":  # of Qualisys; others have one of their sine
        key = "fs"
    elif match:
        key = re.sub(r"[ _-]+", "_", match["name"].strip().lower())
    else:
        hits = ((key, pattern.search(line)) for key, pattern in _NUMBER_FIRST.items())
        key, match = next((hit for hit in hits if hit[1]), ("", None))
    if match is None:
        return None
    if _NOT_STORED.search(line[match.end() :].strip(" \t;([")):
        return None
    key = _STATED_NAMES.get(key, key)
    unit = (match["unit"] or match.groupdict().get("of") or "").lower()
    try:
        number = float(match["number"])
        known = stated_rate([(key, number)]) is not None
    except (ValueError, ZeroDivisionError):
        return None
    if key == "fs" and unit == "hz" and _THOUSANDS.fullmatch(match["number"]):
        return None
    return (key, _STATED_UNITS[unit] * number) if known and unit in _STATED_UNITS else None


def without_footer(text: str, separator: str) -> tuple[str, tuple[str, ...]]:
    """The text without lines behind the last row with a number in a cell, and what was left out."""
    end, words = len(text), list[str]()
    while end > 0 and len(words) < _HEADING_ROWS:
        start = text.rfind("\n", 0, end - 1) + 1
        line = text[start:end].strip()
        if texts.COMMENT.match(line) or any(map(texts.numeric, texts.split(line, separator))):
            break
        words += [line] if line else []
        end = start
    if not words or end == 0:
        return text, ()
    return text[:end], tuple(reversed(words))


def without_brackets(cell: str) -> str:
    """A unit without the brackets around it; those within it, as of m/(s^2), stay."""
    match = re.fullmatch(r"\[\s*(.*?)\s*\]|\(\s*([^()]*?|[^()]*\([^()]*\)[^()]*?)\s*\)", cell)
    return (match[1] or match[2] or "") if match else cell


def is_sample(cell: str) -> bool:
    """Whether a cell is a number, perhaps with its unit, or a time of the day."""
    return texts.numeric(cell) or STAMP.fullmatch(cell) is not None or bool(unit_behind(cell))


def unit_behind(cell: str) -> str:
    """The unit behind a number in the same cell; "" where there is none."""
    match = _MEASURED.fullmatch(cell)
    return match[2] if match and texts.numeric(match[1]) and match[2].lower() in KNOWN_UNITS else ""


def unit_of_epoch(cell: str) -> str:
    """The unit of a time that counts from 1970, "" of any other."""
    digits = len(cell.partition(".")[0]) - 1 if re.fullmatch(r"\d+(?:\.\d*)?", cell) else 0
    return _EPOCHS.get(digits, "")


def seconds_of(cell: str) -> float | None:
    """A time of the day [s]; None of another cell."""
    stamp = STAMP.fullmatch(cell)
    if stamp is None:
        return None
    hour = int(stamp[1] or 0)
    if stamp[4] is not None:
        hour = hour % 12 + 12 * (stamp[4] in "Pp")
    return 3600 * hour + 60 * int(stamp[2]) + float(stamp[3].replace(",", "."))


def past_midnight(times: np.ndarray) -> np.ndarray:
    """Times of the day (n,) [s] that go on after midnight."""
    return times + 86_400 * np.cumsum(np.diff(times, prepend=times[:1]) < -43_200)


def first_samples(text: str, line: int, separator: str) -> list[str]:
    """The cells of the fullest of the first rows of numbers below a line."""
    rows = [cells for _, cells in islice(texts.rows_below(text, line, separator), _HEADING_ROWS)]
    # that with most samples, and fewest words beside them
    fullest = max([[], *rows], key=lambda cells: (sum(map(is_sample, cells)), -sum(map(bool, cells))))
    while fullest and not fullest[-1]:
        fullest.pop()
    return fullest


def _fitted(cells: Sequence[str], width: int) -> list[str]:
    return [*cells, *[""] * width][:width]


def _spread(names: Sequence[str], samples: Sequence[str]) -> list[str]:
    """Names with that of a merged cell over each of its columns, as far as these hold numbers."""
    filled: list[str] = []
    for index, name in enumerate(names):
        merged = not name and any(filled) and index < len(samples) and texts.numeric(samples[index])
        filled.append(filled[-1] if merged else name)
    return filled


def _merged_cells_above(text: str, header: Header, names: Sequence[str]) -> list[str]:
    """The row of merged cells above names that repeat themselves, as X, Y, Z, X, Y, Z."""
    filled = [name for name in names if name]
    if header.line < 2 or len(set(filled)) == len(filled):
        return []
    above = next(texts.lines(text, texts.offset(text, header.line - 2)))
    cells = _fitted(texts.split(above, header.separator), len(names))
    return cells if any(cells) and "" in cells and not any(map(texts.numeric, cells)) else []


def _are_parts(cells: Sequence[str], names: Sequence[str]) -> bool:
    """Whether words are parts of the names above: another for each column under a merged name."""
    pairs = zip(names, cells, strict=True)
    repeated = [(name, cell) for name, cell in pairs if name and names.count(name) > 1]
    words = not any(map(texts.numeric, cells)) and all(cell for _, cell in repeated)
    return bool(repeated) and words and len(set(repeated)) == len(repeated)


def _are_units(cells: Sequence[str]) -> bool:
    """Whether most words of a row are units; one with numbers beside them begins with a word."""
    units = [without_brackets(cell).lower() for cell in cells]
    words = [unit for unit in units if unit and not texts.numeric(unit)]
    known = sum(word in KNOWN_UNITS for word in words)
    mixed = any(map(texts.numeric, cells)) and is_sample(units[0])
    return known > 0 and 2 * known >= len(words) and not mixed


def _are_words(cells: Sequence[str]) -> bool:
    """Whether a row is of words, or of amounts behind a word or an empty cell."""
    numbers = any(texts.numeric(cell) or STAMP.fullmatch(cell) for cell in cells)
    return not numbers and not unit_behind(cells[0]) and any(re.search(r"[^\W\d]", cell) for cell in cells)


def _are_counts(cells: Sequence[str], samples: Sequence[str]) -> bool:
    """Whether a row is one whole number again and again, with gaps where samples have none."""
    distinct = {cell for cell in cells if cell}
    gaps = any(not cell and is_sample(sample) for cell, sample in zip(cells, samples, strict=False))
    return gaps and len(distinct) == 1 and distinct.pop().isdigit()
