"""What stands above the numbers of a text: headings, their parts and units, statements, and where the numbers begin."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from fasbody.exceptions import shown
from fasbody.presentation import counted
from fasbody.recording.channels import KNOWN_UNITS, TIME_UNITS, Layout
from fasbody.recording.formats.series import FormatError, stated_rate
from fasbody.recording.text import COMMENT, SEPARATORS, lines, numeric, offset, split

#: A line of measured numbers, which is no header.
_SAMPLES = re.compile(r"[\s\d.,;|eE+-]*\.[\s\d.,;|eE+-]*")
#: A time of the day, with or without its date before it; without its hour it has decimals.
STAMP = re.compile(
    r"(?:[\d./-]{8,10}[T ]+)?(?:(\d{1,2}):(?=\d\d:\d\d)|(?=\d\d:\d\d[.,]))(\d\d):(\d\d(?:[.,]\d+)?)"
    r"(?:Z|[+-]\d\d:?\d\d|\s*([AaPp])\.?[Mm]\.?)?"
)
#: Lines in which a header is looked for, and rows of headings, units and counts at most.
_HEADER_LINES, _HEADING_ROWS = 200, 12
#: What stands in front of a row of names, or of statements below them, and is no name.
_TITLED = re.compile(r"[A-Z]+_NAMES|\w+=", re.IGNORECASE)
_KEY = re.compile(r"[A-Za-z]\w+=?")
#: A name, its unit perhaps, and a number with its unit, as ``Sampling frequency [Hz],1000`` or ``Interval= 0.001 s``.
_STATED = re.compile(
    r"^\W*(?P<name>[A-Za-z][A-Za-z_ -]*?)\s*(?:[\[(](?P<of>[^\])]*)[\])])?\s*[=:;,\t ]+(?:analog:)?\s*"
    r"(?P<number>\d[\d.]*(?:e[-+]?\d+)?)\s*(?P<unit>[a-zµ/]*)",
    re.IGNORECASE,
)
#: The same of BIOPAC and ActiGraph, the number first.
_TURNED = (
    ("dt", re.compile(r"^(?P<number>\d[\d.]*)\s*(?P<unit>msec|sec|ms|s)/sample", re.IGNORECASE)),
    ("fs", re.compile(r"date format .* at (?P<number>\d+)\s*(?P<unit>hz)\b", re.IGNORECASE)),
)
_FREQUENCIES = {"hz": 1.0, "khz": 1e3, "": 1.0}
#: What texts call a rate or an interval besides; Qualisys alone means it by FREQUENCY, which others have of their sine.
_RATES = ("rate", "sample_frequency", "scan_rate", "data_rate", "acquisition_rate", "abtastrate", "abtastfrequenz")
_STEPS = ("interval", "sample_interval", "sample_period", "sampling_period", "sample_time", "time_step", "delta_x")
_OTHER_NAMES = dict.fromkeys(_RATES, "fs") | dict.fromkeys(_STEPS, "dt")


@dataclass(frozen=True)
class Headings:
    """The headings of a text.

    Attributes:
        separator: of its columns.
        names: of the columns.
        units: of the columns, "" where no row states it.
        line: number of the line of the names, 0 without.
        first: how many lines stand above the numbers.
        skipped: rows that are in no use, in words.
        rate_hz: the sampling rate that a line states.
        remarks: on statements that differ between the channels, in sentences without the file's name.
    """

    separator: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    line: int
    first: int
    skipped: tuple[str, ...] = ()
    rate_hz: float | None = None
    remarks: tuple[str, ...] = ()


def header(text: str, score: Callable[[Sequence[str]], int]) -> tuple[int, str, list[str]]:
    """Where the header is, below whatever a program wrote first: number of its line, separator, names.

    Args:
        text: of the file.
        score: how many of a line's cells are known names; the first line with most of them wins,
            and without any the first line that is not a comment.
    """
    best, result = 0, (1, ",", [""])
    for place, line in enumerate(islice(lines(text), _HEADER_LINES), 1):
        if best and _SAMPLES.fullmatch(line):
            continue
        bare = re.sub(r"^\s*(#|%|//)\s*", "", line)  # some programs write the header as a comment
        for separator in SEPARATORS:
            if separator not in bare:
                continue
            names = split(bare, separator)
            if score(names) > best:
                best, result = score(names), (place, separator, names)
        if not best and not result[2][0] and line.strip() and not COMMENT.match(line):
            separator = next((s for s in SEPARATORS if s in line.strip()), ",")
            result = (place, separator, split(line, separator))
    return result


def stated(above: Sequence[str]) -> tuple[float | None, tuple[str, ...]]:
    """The sampling rate [Hz] that lines state, None without or where two of them disagree; and the other lines."""
    statements, others = list[tuple[str, float | None]](), list[str]()
    for line in above:
        rate = _rate(line)
        statements += [] if rate is None else [rate]
        others += [" ".join(line.split())] if rate is None and line.strip(' \t,;#%/-"') else []
    try:
        return stated_rate(statements), tuple(others)
    except FormatError:
        return None, tuple(line.strip() for line in above if line.strip())


def _rate(line: str) -> tuple[str, float] | None:
    """A line's statement of a rate or interval: its name as in `stated_rate`, and the number in Hz or s."""
    match = _STATED.match(line)
    turned = ((name, hit) for name, pattern in _TURNED if (hit := pattern.search(line)))
    name, match = (match["name"], match) if match else next(turned, ("", None))
    if match is None:
        return None
    unit = (match["unit"] or match.groupdict().get("of") or "").lower()
    key = re.sub(r"[ _-]+", "_", name.strip().lower())
    key = "fs" if name == "FREQUENCY" else _OTHER_NAMES.get(key, key)
    scale = {**_FREQUENCIES, **TIME_UNITS}.get(unit)
    try:
        value = float(match["number"])
        known = stated_rate([(key, value)])
    except (ValueError, ZeroDivisionError):
        return None
    return None if known is None or scale is None else (key, scale * value)


def headless(
    text: str, names: Sequence[str], line: int, separator: str, layout: Layout
) -> tuple[int, str, int] | None:  # fmt: skip
    """Line, separator and width of the first row of numbers where no line is a header, None where one is.

    Args:
        text: whole.
        names: headings by `header`.
        line: number of their line.
        separator: between them.
        layout: where study.toml names the columns, lines of words above as many numbers are a
            preamble.
    """
    if all(value(cell) for cell in names if cell):
        return line, separator, len(names)
    meant = [index for index, name in enumerate(layout.columns) if layout.known([name])]
    rows_of_numbers = _rows_of_numbers(text, meant) if layout.columns else iter(())
    return next((row for row in rows_of_numbers if row[2] == len(layout.columns)), None)


def _rows_of_numbers(text: str, meant: Sequence[int] = ()) -> Iterator[tuple[int, str, int]]:
    """Line, separator and width of the first rows with samples in the columns of study.toml, or in all."""
    for place, row in enumerate(islice(lines(text), _HEADER_LINES), 1):
        separator = next((s for s in SEPARATORS if s in row.strip()), ",")
        cells = split(row, separator)
        some = [cells[index] for index in meant if index < len(cells)] if len(meant) > 1 else cells
        if row.strip() and not COMMENT.match(row) and all(map(value, some)) and len(cells) > 1:
            yield place, separator, len(cells)


def above_numbers(text: str) -> tuple[int, str, list[str]] | None:
    """The row of headings above the first row of samples, and above its units: line, separator, names.

    A row of units is the headings where none stands above it.
    """
    for first, separator, width in _rows_of_numbers(text):
        units = None
        for place, row in reversed(list(enumerate(islice(lines(text), first - 1), 1))):
            names = split(row, separator)
            if len(names) < width or any(map(numeric, names)):
                continue
            if not any(bare(name).lower() in KNOWN_UNITS for name in names):
                return place, separator, names
            units = units or (place, separator, names)
        return units
    return None


def without_footer(text: str) -> tuple[str, tuple[str, ...]]:
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


def bare(cell: str) -> str:
    """A unit without the brackets around it."""
    match = re.fullmatch(r"\[\s*(.*?)\s*\]|\(\s*([^()]*?|[^()]*\([^()]*\)[^()]*?)\s*\)", cell)
    return (match[1] or match[2] or "") if match else cell


def value(cell: str) -> bool:
    """Whether a cell is a sample: a number or a time of the day."""
    return numeric(cell) or STAMP.fullmatch(cell) is not None


def headed(text: str, line: int, separator: str, names: Sequence[str]) -> Headings:
    """The rows of headings from one line to the first row of numbers: names, parts of names, units, counts.

    Args:
        text: from its first line on.
        line: number of the line of headings, by `header`.
        separator: between them.
        names: the headings.
    """
    names, rows_above = list(names), line
    body = first_samples(text, line, separator)
    titled = bool(_TITLED.fullmatch(names[0]))
    if titled and len(names) == len(body) + 1:  # as Qualisys: CHANNEL_NAMES in front of the names
        names = names[1:]
    names = _merged(names, body)
    above = _above(text, line, separator, names)
    if above is not None:
        names = [f"{group} {name}".strip() for group, name in zip(_merged(above, body), names, strict=True)]
    units, skipped, statements = [""] * len(names), list[str](), list[str]()
    while rows_above < line + _HEADING_ROWS:
        cells = (row_after(text, rows_above, separator) + [""] * len(names))[: len(names)]
        texts = [bare(cell) for cell in cells]
        numbers = any(map(numeric, cells))
        if not numbers and _parts(cells, names):
            units = [unit if names.count(name) == 1 else "" for name, unit in zip(names, texts, strict=True)]
            names = [f"{name} {part}".strip() if names.count(name) > 1 else name
                     for name, part in zip(names, cells, strict=True)]  # fmt: skip
        elif _of_units(texts, numbers):
            units = ["" if numeric(unit) else unit for unit in texts]
            statements += [f"{name} = {cell}" for name, cell in zip(names, cells, strict=True) if numeric(cell)]
            while len(units) > len(body) and not units[-1]:  # as Rigol: the increment behind the last unit
                names, units = names[:-1], units[:-1]
        elif numbers and _counts(cells, body):
            skipped.append(f"a row of counts ({shown(separator.join(cells))})")
        elif titled and _KEY.fullmatch(cells[0]):
            statements.append(" ".join(row_after(text, rows_above, separator)))
        else:
            break
        rows_above = _line_of_row(text, rows_above)
    preamble = [row for row in islice(lines(text), line - 1 - (above is not None)) if row.strip()]
    rate, others = stated([*preamble, *statements])
    count = counted(len(others), "line")
    skipped += [f"{count} beside the headings ({shown('; '.join(others))})"] if others else []
    unequal = tuple(_unequal(statements))
    return Headings(separator, tuple(names), tuple(units), line, rows_above, tuple(skipped), rate, unequal)


def _unequal(statements: Sequence[str]) -> Iterator[str]:
    """A sentence on each gain that a row states, not alike, for the channels."""
    for row in statements:
        key, *cells = row.split()
        if re.search(r"gain|scale|factor|sensitivity", key, re.IGNORECASE) and len(set(filter(numeric, cells))) > 1:
            yield (
                f"the row {shown(row)!r} states factors that differ between the channels, and is not applied; if the "
                "numbers do not contain them yet, give study.toml a sensitivity for each channel"
            )


def _of_units(cells: Sequence[str], numbers: bool) -> bool:
    """Whether most cells of a row are units; one with numbers beside them begins with a word."""
    words = [cell.lower() for cell in cells if cell and not numeric(cell)]
    known = sum(word in KNOWN_UNITS for word in words)
    return known > 0 and 2 * known >= len(words) and not (numbers and value(cells[0]))


def first_samples(text: str, line: int, separator: str) -> list[str]:
    """The cells of the fullest of the first rows of numbers below a line."""
    fullest: list[str] = []
    for row in islice(lines(text, offset(text, line)), _HEADING_ROWS):
        cells = [] if COMMENT.match(row) else split(row, separator)
        if _fullness(cells) > _fullness(fullest):
            fullest = cells
    while fullest and not fullest[-1]:
        fullest.pop()
    return fullest


def _fullness(cells: Sequence[str]) -> tuple[int, int]:
    """How many samples a row has, and fewest words beside them."""
    count = sum(map(value, cells))
    return count, count - sum(map(bool, cells))


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
    """Whether a row of words holds parts of the names above it: another for each column under a merged name."""
    repeated = [(name, cell) for name, cell in zip(names, cells, strict=True) if name and names.count(name) > 1]
    return bool(repeated) and all(cell for _, cell in repeated) and len(set(repeated)) == len(repeated)


def _counts(cells: Sequence[str], body: Sequence[str]) -> bool:
    """Whether a row holds counts of samples: one whole number in all cells, and none where samples have one."""
    distinct = {cell for cell in cells if cell}
    lacking = any(not cell and index < len(body) and value(body[index]) for index, cell in enumerate(cells))
    return lacking and len(distinct) == 1 and distinct.pop().isdigit()


def _line_of_row(text: str, after: int) -> int:
    """The number of the first line that holds cells after so many lines."""
    for place, row in enumerate(lines(text, offset(text, after)), after + 1):
        if row.strip() and not COMMENT.match(row):
            return place
    return after + 1


def row_after(text: str, after: int, separator: str) -> list[str]:
    """The cells of the first row after so many lines."""
    below = (line for line in lines(text, offset(text, after)) if line.strip() and not COMMENT.match(line))
    return split(next(below, ""), separator)
