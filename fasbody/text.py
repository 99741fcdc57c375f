"""Text files as programs and countries write them: encoding, separator, decimal comma, comments, quotes."""

import codecs
import csv
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

from fasbody.exceptions import InputFileError

#: Larger files are refused before they are read [bytes].
_LARGEST = 150_000_000
#: What separates columns, in the order in which they are tried; a blank stands for any run of them.
SEPARATORS = ("\t", ";", "|", ",", " ")
#: A line that begins so is a comment.
COMMENT = re.compile(r"\s*(#|%|//)")
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1f]")
_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
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
        data = file.read_bytes()
    except OSError as error:
        raise InputFileError(file, f"cannot be read ({error.strerror})") from None
    for encoding in _encodings(data):
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not _BINARY.search(text):
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
        bare = re.sub(r"^\s*(#|%|//)\s*", "", line)  # some programs write the header as a comment
        for separator in SEPARATORS:
            if separator not in bare:
                continue
            names = split(bare, separator)
            if score(names) > best:
                best, found = score(names), (number, separator, names)
        if not best and not found[2][0] and line.strip() and not COMMENT.match(line):
            separator = next((s for s in (",", ";", "\t", "|", " ") if s in line.strip()), ",")
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


def shown(text: str) -> str:
    """A cell or a list of names for a message: printable and short."""
    clean = "".join(c if c.isprintable() else "?" for c in text)
    return clean if len(clean) <= 120 else clean[:117] + "..."
