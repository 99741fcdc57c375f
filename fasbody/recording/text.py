"""The text of a file, whole or in pieces of whole lines, whatever its encoding and the ends of its lines."""

import codecs
import csv
import gzip
import io
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO

from fasbody.exceptions import InputFileError

#: Larger files are refused before they are read [bytes].
_LARGEST = 500_000_000
#: Characters of a piece: much less than a large file, and enough for a parser to be fast.
PIECE = 16_000_000
#: Bytes in which a word is looked for before a file is read.
_START = 65_536
#: What separates columns, in the order in which they are tried; a blank stands for any run of them.
SEPARATORS = ("\t", ";", "|", ",", " ")
#: A line that begins so is a comment.
COMMENT = re.compile(r"\s*(#|%|//)")
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1f]")
_CONTROL = bytes([*range(0x09), *range(0x0E, 0x20)])  # the same, before they are letters
_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
#: So many zero bytes behind a text are what a disk leaves of a file that was cut off.
_ZEROS = 8
_BRACKETED = re.compile(r"\[.*\]|\(.*\)")
_QUOTE = "opens a quotation mark that nothing closes"


def read_text(file: Path) -> str:
    """The text of a file in UTF-8, UTF-16, the Latin alphabet of Windows or Shift-JIS, lines ended by a line feed."""
    return "".join(piece for _, piece in Passage(file).pieces())


@dataclass(frozen=True)
class Passage:
    """Lines of a file.

    Attributes:
        file: the file.
        first: how many lines stand above it.
        last: the number of its last line, None for that of the file.
    """

    file: Path
    first: int = 0
    last: int | None = None

    @cached_property
    def encoding(self) -> str:
        """Of the file, in which all of it is text."""
        return _encoding(self.file)

    def pieces(self) -> Iterator[tuple[int, str]]:
        """How many lines of the file stand above each piece of whole lines, and the piece."""
        at, last, encoding = 0, self.last, self.encoding
        with _opened(self.file) as raw, io.TextIOWrapper(raw, encoding) as text:
            while (piece := text.read(PIECE)) and (last is None or at < last):
                piece += text.readline()
                count = piece.count("\n")
                start = offset(piece, self.first - at) if at < self.first else 0
                stop = len(piece) if last is None or at + count <= last else offset(piece, last - at)
                if start < stop:
                    yield max(at, self.first), piece[start:stop]
                at += count


def begins_with(file: Path, word: str) -> bool:
    """Whether a word stands near the beginning of a file, whatever its encoding and its case."""
    try:
        with _opened(file) as raw:
            start = raw.read(_START).replace(b"\0", b"")
    except (OSError, EOFError, zlib.error):
        return False
    return word.encode() in start.lower()


def _opened(file: Path) -> IO[bytes]:
    return gzip.open(file, "rb") if file.suffix.lower() == ".gz" else file.open("rb")  # type: ignore[return-value]


def _encoding(file: Path) -> str:
    """The first encoding in which all of a file is text."""
    if not file.is_file():
        raise InputFileError(file, "no such file" if not file.is_dir() else "is a folder, not a file")
    if file.stat().st_size > _LARGEST:
        raise InputFileError(file, f"is larger than {_LARGEST // 1_000_000} MB", "split it into recordings")
    try:
        with _opened(file) as raw:
            start = raw.read(400)
        chosen = next((encoding for encoding in _encodings(start) if _reads(file, encoding)), None)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise InputFileError(file, "is not a sound .gz file; it is damaged, cut off, or of another format") from None
    except OSError as error:
        raise InputFileError(file, f"cannot be read ({error.strerror})") from None
    if chosen is None:
        with _opened(file) as raw:
            head = raw.read(PIECE)
        if head.endswith(bytes(_ZEROS)) and 0 not in (words := head.rstrip(b"\0")) and words:
            line = words.count(b"\n") + 1
            raise InputFileError(file, "holds zero bytes behind its text", "it was cut off; delete them", line)
        raise InputFileError(file, "is not a text file", "a CSV file with a header line is needed")
    return chosen


def _encodings(start: bytes) -> tuple[str, ...]:
    if start.startswith(_MARKS):
        return ("utf-16",)
    for first, name in ((1, "utf-16-le"), (0, "utf-16-be")):  # without its mark every other byte is still zero
        if len(start) >= 8 and start[first::2].count(0) > 0.9 * len(start[first::2]) and 0 not in start[1 - first :: 2]:
            return (name,)
    return ("utf-8-sig", "cp1252", "cp932")


def _reads(file: Path, encoding: str) -> bool:
    """Whether all bytes of a file are letters in an encoding."""
    decoder, two_byte, size, data = codecs.getincrementaldecoder(encoding)(), encoding.startswith("utf-16"), 0, b" "
    with _opened(file) as raw:
        while data:
            data = raw.read(PIECE)
            size += len(data)
            if size > _LARGEST:
                raise InputFileError(
                    file, f"unpacks to more than {_LARGEST // 1_000_000} MB", "split it into recordings"
                )
            try:
                text = decoder.decode(data, final=not data)
            except UnicodeDecodeError:
                return False
            clear = not two_byte and len(data.translate(None, _CONTROL)) == len(data)
            if not clear and _BINARY.search(text):
                return False
    return True


def split(line: str, separator: str) -> list[str]:
    """The cells of one line without blanks and quotation marks around them."""
    if separator == " ":
        cells = [cell.strip('"') for cell in line.split()]
        return _with_units(cells) if "[" in line or "(" in line else cells
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
    except csv.Error:  # a cell longer than the module reads
        return [cell.strip() for cell in line.split(separator)]


def _with_units(cells: list[str]) -> list[str]:
    """Words with the unit in brackets behind them, as ``Zeit [s]``; a row of units stays."""
    joined: list[str] = []
    for cell in cells:
        is_unit = _BRACKETED.fullmatch(cell) is not None
        if is_unit and joined and not _BRACKETED.fullmatch(joined[-1]):
            joined[-1] += f" {cell}"
        else:
            joined.append(cell)
    return joined


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


def separator_of(line: str) -> str:
    """The first of `SEPARATORS` in a line, a comma where there is none."""
    return next((s for s in SEPARATORS if s in line.strip()), ",")


def rows_below(text: str, line: int, separator: str) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of each line below one, without comments and empty lines."""
    for number, row in enumerate(lines(text, offset(text, line)), line + 1):
        if row.strip() and not COMMENT.match(row):
            yield number, split(row, separator)


def rows(file: Path, body: str, separator: str, after: int) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of each line of a body, without comments and empty lines.

    Args:
        body: the lines.
        separator: of their cells.
        after: how many lines of the file stand above.
    """
    for number, line in enumerate(body.split("\n"), after + 1):
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


def numeric(cell: str) -> bool:
    """Whether a cell is a number, with decimal point or comma."""
    try:
        number(cell)
    except ValueError:
        return False
    return True
