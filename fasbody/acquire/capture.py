r"""The capture file: every byte as it came, append-only, readable up to the last whole record after any crash.

    8 bytes    FASCAP1\n
    records    0xFA 'R' | kind (1 byte) | host time (float64 [s]) | length (uint32) | content | CRC-32 from kind on

All little-endian. Kinds: M (JSON, what was to be recorded), B (bytes from the board), E (JSON, an event). Each record
is one `write` to the operating system, so a killed process loses only what it had not read yet.
"""

import contextlib
import json
import os
import struct
import threading
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fasbody.exceptions import InputFileError

MAGIC = b"FASCAP1\n"
_MARK = b"\xfaR"
_HEAD = struct.Struct("<cdI")
#: Bytes of a record around its content.
AROUND = len(_MARK) + _HEAD.size + 4
#: A record is never longer than this [bytes].
_LONGEST_RECORD = 1 << 20
SUFFIX = ".fascap"


@dataclass(frozen=True)
class Record:
    """One record.

    Attributes:
        kind: "M", "B" or "E".
        host: host time [s].
        content: its bytes.
    """

    kind: str
    host: float
    content: bytes

    def json(self) -> dict[str, Any]:
        """Content of an M or E record; empty if it is none."""
        try:
            document = json.loads(self.content)
        except ValueError:
            return {}
        return document if isinstance(document, dict) else {}


def pack(kind: str, host: float, content: bytes) -> bytes:
    """One record as bytes."""
    head = _HEAD.pack(kind.encode(), host, len(content))
    return _MARK + head + content + struct.pack("<I", zlib.crc32(head + content))


class Capture:
    """A capture file being written; safe to use from two threads.

    If its disk becomes full, it ends with the last whole record; `trouble` states it.

    Args:
        file: to create; it must not exist.

    Attributes:
        trouble: why nothing more is written; "" while it is.

    Raises:
        InputFileError: it cannot be created.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self.trouble = ""
        self._lock = threading.Lock()
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self._fd = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        except OSError as error:
            raise InputFileError(file, f"cannot be created ({error.strerror})", "name a writable folder") from None
        self._write(MAGIC)

    def add(self, kind: str, host: float, content: bytes | Mapping[str, Any]) -> None:
        """Append one record."""
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        with self._lock:
            for start in range(0, max(1, len(data)), _LONGEST_RECORD):
                self._write(pack(kind, host, data[start : start + _LONGEST_RECORD]))

    def close(self) -> None:
        """Bring everything to the disk and close."""
        with self._lock:
            if self._fd >= 0:
                try:
                    os.fsync(self._fd)
                except OSError as error:
                    self.trouble = self.trouble or f"{self.file}: {error.strerror}"
                os.close(self._fd)
                self._fd = -1

    def _write(self, data: bytes) -> None:
        if self._fd < 0 or self.trouble:
            return
        size = os.fstat(self._fd).st_size
        try:
            done = os.write(self._fd, data)
            if done == len(data) or done + os.write(self._fd, data[done:]) == len(data):
                return
            problem = "short write"
        except OSError as error:
            problem = error.strerror or str(error)
        self.trouble = f"{self.file}: cannot be written ({problem}); free some space"
        with contextlib.suppress(OSError):
            os.ftruncate(self._fd, size)  # no half record stays behind


def read(file: Path) -> Iterator[Record]:
    """The whole records of a capture file; torn and damaged ones are stepped over."""
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InputFileError(file, f"cannot be read ({error.strerror})", _valid(file)) from None
    if not data.startswith(MAGIC):
        raise InputFileError(file, "is not a capture file", _valid(file))
    place = len(MAGIC)
    while True:
        place = data.find(_MARK, place)
        start = place + len(_MARK)
        if place < 0 or start + _HEAD.size + 4 > len(data):
            return
        kind, host, length = _HEAD.unpack_from(data, start)
        end = start + _HEAD.size + length
        if length <= _LONGEST_RECORD and end + 4 <= len(data):
            (check,) = struct.unpack_from("<I", data, end)
            if check == zlib.crc32(data[start:end]):
                yield Record(kind.decode("latin-1"), host, data[start + _HEAD.size : end])
                place = end + 4
                continue
        place = start


def _valid(file: Path) -> str:
    """Which capture files there are around a path that is none."""
    around = [file, file / "captures", file.parent, file.parent / "captures", file.parent.parent / "captures"]
    for folder in around:
        if names := sorted(str(path) for path in folder.glob(f"*{SUFFIX}") if path != file):
            more = f" and {len(names) - 5} more" if len(names) > 5 else ""
            return f"valid: {', '.join(names[:5])}{more}"
    return f"acquisition writes them as STUDY/captures/NAME{SUFFIX}"
