"""Messages of a board in either wire format: its description (Hello), samples (Block), and unreadable bytes (Damage).

A stream of bytes is cut into pieces at an end mark, and each piece is read as a message. `Decoder` finds out by
listening which of the two formats a board speaks. docs/acquisition.md describes both for firmware.

Binary frames are stuffed by COBS and carry two CRC-16. One lets one damaged frame in 65 536 pass: on a bad line that
is a wrong sample every few minutes. Two with different polynomials together miss one in 2^31.

Text lines, for simple boards, are the CSV of docs/recordings.md below a line on the board. A header whose lines carry
a check is accepted at once. One without may have been changed on its way, so after the first it must come twice before
it changes anything.
"""

import binascii
import math
import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fasbody.recording.channels import TIME_UNITS, UNITS

#: Channel roles; base and malleolus are needed, the others optional.
ROLES = ("base", "malleolus", "tuberosity", "other")
#: Longest payload, frame on the wire and line [bytes]; what is longer is damage, so memory stays bounded.
LONGEST = 1024
LONGEST_WIRE = LONGEST + 4 + 6
LONGEST_LINE = 256
_LARGEST_BOARD_NAME = 32
#: Bytes in a full block of the stuffing, after which no zero stands.
_BLOCK = 254
_VERSION, _OVER_RANGE = 1, 1
#: So many channels have a flag each.
_FLAGGED = 7
_HELLO, _DATA = ord("H"), ord("D")
_HELLO_HEAD, _CHANNEL, _DATA_HEAD = struct.Struct("<BBBBHIH"), struct.Struct("<Bff"), struct.Struct("<BBII")


@dataclass(frozen=True)
class Channel:
    """One accelerometer.

    Attributes:
        role: one of ROLES.
        range_m_s2: it shows so much either way.
        counts_per_m_s2: its sensitivity; 1 if it sends m/s^2.
    """

    role: str
    range_m_s2: float = float("inf")
    counts_per_m_s2: float = 1.0


@dataclass(frozen=True)
class Hello:
    """A board's description of itself.

    Attributes:
        board: its name.
        rate_hz: sampling rate.
        channels: in the order of the samples.
        bits: 16 or 24 for binary frames, 0 for text lines.
        frame_samples: samples a channel in each frame.
        boot: a number that changes when the board restarts.
    """

    board: str
    rate_hz: float
    channels: tuple[Channel, ...]
    bits: int = 0
    frame_samples: int = 1
    boot: int = 0

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the channels, in order."""
        return tuple(channel.role for channel in self.channels)

    def beyond(self, samples: np.ndarray) -> np.ndarray:
        """Which of the samples (n, channels) [m/s^2] reach their channel's range."""
        return np.abs(samples) >= np.array([channel.range_m_s2 for channel in self.channels])

    def reach(self, channel: int) -> float:
        """Highest acceleration +-[m/s^2] that a channel can show, by its range and its converter."""
        one = self.channels[channel]
        rail = (2 ** (self.bits - 1) - 1) / abs(one.counts_per_m_s2) if self.bits else float("inf")
        return min(one.range_m_s2, rail)

    def __str__(self) -> str:
        kind = f"{self.bits}-bit frames of {self.frame_samples}" if self.bits else "text lines"
        return f"{self.board}: {', '.join(self.roles)} at {self.rate_hz:g} Hz, {kind}"


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples.

    Attributes:
        sequence: number of this frame, modulo 2^32.
        time_us: device time of its first sample [us], modulo 2^32.
        samples: (n, channels) accelerations [m/s^2].
        over: (channels,) how many of them are over range.
    """

    sequence: int
    time_us: int
    samples: np.ndarray
    over: np.ndarray


@dataclass(frozen=True)
class Damage:
    """Bytes that are no message: why, and how many."""

    why: str
    size: int


Message = Hello | Block | Damage


class Decoder:
    """Reads both formats until a hello comes in one of them, and only that one from then on.

    Args:
        preamble: the bytes of an earlier hello, for a stream that is known.

    Attributes:
        bytes: how many it was fed.
    """

    def __init__(self, preamble: bytes = b"") -> None:
        self._readers: list[FrameReader | LineReader] = [FrameReader(), LineReader()]
        self.bytes = 0
        self.feed(preamble)
        self.fresh()
        self.bytes = 0

    @property
    def hello(self) -> Hello | None:
        """The board's description, once it came."""
        return self._readers[0].hello if len(self._readers) == 1 else None

    @property
    def preamble(self) -> bytes:
        """The bytes of the hello."""
        return self._readers[0].preamble if self.hello else b""

    def fresh(self) -> None:
        """Forget unfinished messages, as after unplugging."""
        for reader in self._readers:
            reader.fresh()

    def feed(self, data: bytes) -> list[Message]:
        """Messages completed by these bytes; before the hello, damage in either format means nothing."""
        self.bytes += len(data)
        for reader in tuple(self._readers):
            messages = reader.feed(data)
            if len(self._readers) == 1:
                return messages
            if reader.hello is not None:
                self._readers = [reader]
                return [message for message in messages if not isinstance(message, Damage)]
        return []


class PieceReader(ABC):
    """Turns bytes, in pieces of any size, into messages; nothing it is fed makes it fail or grow.

    A format defines what ends a piece and how long one can be, and overrides `read`.

    Attributes:
        hello: the board's description, once it came.
        preamble: the bytes of the hello.
    """

    END: bytes
    LONGEST: int

    def __init__(self) -> None:
        self.hello: Hello | None = None
        self.preamble = b""
        self.fresh()

    def fresh(self) -> None:
        """Forget an unfinished piece: the next bytes may begin in the middle of one."""
        self._rest = b""
        self._skip = False
        self._first = True

    @property
    def kept(self) -> int:
        """Bytes of the unfinished piece, never more than LONGEST."""
        return len(self._rest)

    @abstractmethod
    def read(self, piece: bytes) -> Message | None:
        """One whole piece without its end; None for an incomplete message."""

    def feed(self, data: bytes) -> list[Message]:
        """Messages completed by these bytes."""
        messages: list[Message] = []
        pieces = (self._rest + data).split(self.END)
        self._rest = pieces.pop()
        for piece in pieces:
            skip, self._skip = self._skip, False
            if skip or not piece:
                continue
            message = self.read(piece) if len(piece) <= self.LONGEST else Damage("too long", len(piece))
            if message is not None and not (self._first and isinstance(message, Damage)):
                messages.append(message)  # the first piece may be the tail of one: that is no damage
            self._first = False
        if len(self._rest) > self.LONGEST:
            if not self._skip:
                messages.append(Damage("no end", len(self._rest)))
            self._rest, self._skip, self._first = b"", True, False
        return messages


class FrameReader(PieceReader):
    """Reads binary frames."""

    END, LONGEST = b"\0", LONGEST_WIRE

    def read(self, piece: bytes) -> Message | None:
        """One frame; None for data before the first hello."""
        raw = unstuff(piece)
        if raw is None:
            return Damage("COBS", len(piece))
        payload = raw[:-4]
        if len(payload) < 2 or raw[-4:] != _checks(payload):
            return Damage("CRC", len(piece))
        if payload[0] == _HELLO:
            hello = _read_hello(payload)
            if hello is None:
                return Damage("hello not understood", len(piece))
            self.hello, self.preamble = hello, piece + b"\0"
            return hello
        if payload[0] != _DATA:
            return Damage("unknown type", len(piece))
        if self.hello is None:
            return None
        return _read_data(payload, self.hello) or Damage("length", len(piece))


def _read_hello(payload: bytes) -> Hello | None:
    if len(payload) < _HELLO_HEAD.size:
        return None
    _, version, bits, count, frame_samples, rate, boot = _HELLO_HEAD.unpack_from(payload)
    end = _HELLO_HEAD.size + count * _CHANNEL.size
    sound = version == _VERSION and bits in (16, 24) and 1 <= count <= 16 and frame_samples and rate
    if not sound or end > len(payload) or len(payload) - end > _LARGEST_BOARD_NAME:
        return None
    channels = []
    for role, span, sensitivity in _CHANNEL.iter_unpack(payload[_HELLO_HEAD.size : end]):
        if not (role < len(ROLES) and 0 < span < math.inf and 0 < abs(sensitivity) < math.inf):
            return None
        channels.append(Channel(ROLES[role], span, sensitivity))
    board = payload[end:].decode(errors="replace")
    return Hello(board, rate / 1000, tuple(channels), bits, frame_samples, boot)


def _read_data(payload: bytes, hello: Hello) -> Block | None:
    """Samples of a data frame; None if its length is not the one that the hello frame promised."""
    width, count = hello.bits // 8, hello.frame_samples * len(hello.channels)
    if len(payload) != _DATA_HEAD.size + width * count:
        return None
    _, flags, sequence, time_us = _DATA_HEAD.unpack_from(payload)
    if width == 2:
        counts = np.frombuffer(payload, "<i2", offset=_DATA_HEAD.size).astype(np.int32)
    else:
        padded = np.zeros((count, 4), np.uint8)
        padded[:, 1:] = np.frombuffer(payload, np.uint8, offset=_DATA_HEAD.size).reshape(-1, 3)
        counts = padded.view("<i4").ravel() >> 8  # the shift brings the sign down
    counts = counts.reshape(hello.frame_samples, -1)
    samples = counts / np.array([c.counts_per_m_s2 for c in hello.channels])
    rail = 2 ** (hello.bits - 1)
    over = (hello.beyond(samples) | (counts >= rail - 1) | (counts <= -rail)).sum(axis=0)
    if flags & _OVER_RANGE:
        named = flags >> 1 + np.arange(over.size) & 1
        over = np.maximum(over, named if named.any() else 1)
    return Block(sequence, time_us, samples, over)


def encode_hello(hello: Hello) -> bytes:
    """The hello frame."""
    head = _HELLO_HEAD.pack(
        _HELLO, _VERSION, hello.bits, len(hello.channels), hello.frame_samples, round(1000 * hello.rate_hz), hello.boot
    )
    body = b"".join(_CHANNEL.pack(ROLES.index(c.role), c.range_m_s2, c.counts_per_m_s2) for c in hello.channels)
    return wrap(head + body + hello.board.encode()[:_LARGEST_BOARD_NAME])


def encode_data(sequence: int, time_us: int, counts: np.ndarray, bits: int, flags: int = 0) -> bytes:
    """A data frame of counts (n, channels)."""
    head = _DATA_HEAD.pack(_DATA, flags, sequence % 2**32, time_us % 2**32)
    if bits == 16:
        return wrap(head + counts.astype("<i2").tobytes())
    octets = counts.astype("<i4").reshape(-1, 1).view(np.uint8)
    return wrap(head + octets[:, :3].tobytes())


def over_range(channels: np.ndarray) -> int:
    """Flags of a data frame in which some channels (c,), true or false, were over range: bit 0, and one for each."""
    which = sum(2 << i for i, one in enumerate(channels[:_FLAGGED]) if one)
    return _OVER_RANGE | which if np.any(channels) else 0


def wrap(payload: bytes) -> bytes:
    """A payload as it goes over the wire: with both CRCs, stuffed, between two zero bytes.

    The first zero keeps a frame readable after one whose last zero is missing.
    """
    return b"\0" + stuff(payload + _checks(payload)) + b"\0"


def stuff(data: bytes) -> bytes:
    """Consistent overhead byte stuffing (Cheshire and Baker, 1999): the same content without a zero byte."""
    out = bytearray()
    for run in data.split(b"\0"):
        full, rest = divmod(len(run), _BLOCK)
        for start in range(0, full * _BLOCK, _BLOCK):
            out += b"\xff" + run[start : start + _BLOCK]
        out += bytes([rest + 1]) + run[full * _BLOCK :]
    return bytes(out)


def unstuff(piece: bytes) -> bytes | None:
    """What was stuffed; None where a block is longer than what is there, or holds a zero."""
    out, start = bytearray(), 0
    while start < len(piece):
        end = start + piece[start]
        if piece[start] == 0 or end > len(piece) or 0 in piece[start:end]:
            return None
        out += piece[start + 1 : end]
        if piece[start] <= _BLOCK and end < len(piece):
            out.append(0)
        start = end
    return bytes(out)


def _checks(payload: bytes) -> bytes:
    return struct.pack("<HH", crc_ccitt(payload), crc_modbus(payload))


def crc_ccitt(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF; of b"123456789" it is 0x29B1."""
    return binascii.crc_hqx(data, 0xFFFF)


def crc_modbus(data: bytes) -> int:
    """CRC-16/MODBUS: polynomial 0x8005 reflected, start 0xFFFF; of b"123456789" it is 0x4B37."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _MODBUS[(crc ^ byte) & 0xFF]
    return crc


def _modbus(crc: int) -> int:
    for _ in range(8):
        crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


_MODBUS = [_modbus(byte) for byte in range(256)]


class LineReader(PieceReader):
    """Reads text lines. Their blocks are numbered as they come: only their time stamps show which are missing."""

    END, LONGEST = b"\n", LONGEST_LINE

    def __init__(self) -> None:
        super().__init__()
        self._board_line = ""  # the latest line on the board
        self._doubted = ""  # a header that differs from the one in use, without a check
        self._crc = False  # whether every line promises one
        self._scale: np.ndarray | None = None
        self._time_unit = 1.0
        self._sequence = -1

    def read(self, piece: bytes) -> Message | None:
        """One line; None for comments, and for data before the first hello."""
        try:
            text = piece.strip().decode("ascii")
        except UnicodeDecodeError:
            return Damage("not text", len(piece))
        if text.startswith("# fas "):
            self._board_line = text
            return None
        if not text or text.startswith("#"):
            return None
        if text.startswith("time_"):
            return self._header(text) or Damage("header not understood", len(piece))
        if self._scale is None or self.hello is None:
            return None
        return self._data(text, self._scale, self.hello) or Damage("line not understood", len(piece))

    def _header(self, text: str) -> Hello | None:
        """The columns; a hello if the line before them completes it."""
        about_line, about_sure = _checked(self._board_line)
        columns, columns_sure = _checked(text)
        if not about_line or not columns:
            return None
        about = dict(word.partition("=")[::2] for word in about_line[6:].split())
        parts = [name.strip().partition("_")[::2] for name in columns.split(",")]
        rate, span = _number(about.get("rate_hz", "")), _number(about.get("range_m_s2", "inf"))
        known = all(role in ROLES and unit in UNITS for role, unit in parts[1:]) and 2 <= len(parts) <= 17
        if not known or parts[0][1] not in TIME_UNITS or not 0 < rate <= 1e6 or not span > 0:
            return None
        lines = f"{self._board_line}\n{text}\n"
        changed = self.hello is not None and lines.encode() != self.preamble
        if changed and not (about_sure and columns_sure) and lines != self._doubted:
            self._doubted = lines
            return None
        self._doubted = ""
        self._crc = about.get("crc") == "1"
        self._time_unit = TIME_UNITS[parts[0][1]]
        self._scale = np.array([UNITS[unit] for _, unit in parts[1:]])
        channels = tuple(Channel(role, span) for role, _ in parts[1:])
        self.hello = Hello(about.get("board", "text board")[:_LARGEST_BOARD_NAME], rate, channels)
        self.preamble = lines.encode()
        return self.hello

    def _data(self, text: str, scale: np.ndarray, hello: Hello) -> Block | None:
        body, sure = _checked(text)
        if not body or (self._crc and not sure):
            return None
        values = [_number(cell) for cell in body.split(",")]
        if len(values) != 1 + scale.size or not all(math.isfinite(value) for value in values):
            return None
        if not 0 <= values[0] * self._time_unit < 1e9:
            return None
        self._sequence += 1
        samples = (np.array(values[1:]) * scale)[None]
        over = hello.beyond(samples).sum(axis=0)
        return Block(self._sequence % 2**32, round(1e6 * self._time_unit * values[0]) % 2**32, samples, over)


def _checked(text: str) -> tuple[str, bool]:
    """A line without its check, and whether that vouches for it; nothing if the check is wrong."""
    body, star, check = text.rpartition("*")
    if not star:
        return text, False
    return (body, True) if check.upper() == _check(body) else ("", False)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def encode_header(board: str, rate_hz: float, roles: tuple[str, ...], range_m_s2: float) -> bytes:
    """The two lines that a text board prints at its start and every second."""
    columns = ",".join(["time_us", *(f"{role}_m_s2" for role in roles)])
    about = f"# fas board={board} rate_hz={rate_hz:g} range_m_s2={range_m_s2:g} crc=1"
    return _with_check(about) + _with_check(columns)


def encode_line(time_us: int, values: np.ndarray) -> bytes:
    """One sample (channels,) [m/s^2] with its check."""
    return _with_check(",".join([str(time_us), *(f"{value:.4f}" for value in values)]))


def _with_check(body: str) -> bytes:
    return f"{body}*{_check(body)}\n".encode()


def _check(body: str) -> str:
    return f"{crc_ccitt(body.encode()):04X}"
