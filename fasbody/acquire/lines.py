"""The text wire format, for simple boards: the CSV of docs/recordings.md, line by line, below a line on the board.

For example:

    # fas board=uno rate_hz=1000 range_m_s2=39.2 crc=1*92D8
    time_us,base_m_s2,malleolus_m_s2*1531
    1000,0.12,-0.38*53E1

A header whose lines carry a check is believed at once. One without may have been changed on its way, so after the
first it must come twice before it changes anything.
"""

import math

import numpy as np

from fasbody.acquire.frames import crc_ccitt
from fasbody.acquire.messages import ROLES, Block, Channel, Damage, Hello, Message
from fasbody.acquire.pieces import PieceReader
from fasbody.units import TIME_UNITS, UNITS

#: Longest line [bytes]; what is longer is damage, so memory stays bounded.
LONGEST_LINE = 256


class LineReader(PieceReader):
    """Reads text lines. Their blocks are numbered as they come: which are missing, only their time stamps tell."""

    END, LONGEST = b"\n", LONGEST_LINE

    def __init__(self) -> None:
        super().__init__()
        self._heard = ""  # the latest line on the board
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
            self._heard = text
            return None
        if not text or text.startswith("#"):
            return None
        if text.startswith("time_"):
            return self._header(text) or Damage("header not understood", len(piece))
        if self._scale is None or self.hello is None:
            return None
        return self._data(text) or Damage("line not understood", len(piece))

    def _header(self, text: str) -> Hello | None:
        """The columns; a hello if the line before them said enough."""
        about_line, about_sure = _checked(self._heard)
        columns, columns_sure = _checked(text)
        if not about_line or not columns:
            return None
        about = dict(word.partition("=")[::2] for word in about_line[6:].split())
        parts = [name.strip().partition("_")[::2] for name in columns.split(",")]
        rate, span = _number(about.get("rate_hz", "")), _number(about.get("range_m_s2", "inf"))
        known = all(role in ROLES and unit in UNITS for role, unit in parts[1:]) and 2 <= len(parts) <= 17
        if not known or parts[0][1] not in TIME_UNITS or not 0 < rate <= 1e6 or not span > 0:
            return None
        lines = f"{self._heard}\n{text}\n"
        changed = self.hello is not None and lines.encode() != self.preamble
        if changed and not (about_sure and columns_sure) and lines != self._doubted:
            self._doubted = lines
            return None
        self._doubted = ""
        self._crc = about.get("crc") == "1"
        self._time_unit = TIME_UNITS[parts[0][1]]
        self._scale = np.array([UNITS[unit] for _, unit in parts[1:]])
        channels = tuple(Channel(role, span) for role, _ in parts[1:])
        self.hello = Hello(about.get("board", "text board")[:32], rate, channels)
        self.preamble = lines.encode()
        return self.hello

    def _data(self, text: str) -> Block | None:
        assert self._scale is not None and self.hello is not None
        body, sure = _checked(text)
        if not body or (self._crc and not sure):
            return None
        values = [_number(cell) for cell in body.split(",")]
        if len(values) != 1 + self._scale.size or not all(math.isfinite(value) for value in values):
            return None
        if not 0 <= values[0] * self._time_unit < 1e9:
            return None
        self._sequence += 1
        samples = (np.array(values[1:]) * self._scale)[None]
        over = self.hello.beyond(samples).sum(axis=0)
        return Block(self._sequence % 2**32, round(1e6 * self._time_unit * values[0]) % 2**32, samples, over)


def encode_header(board: str, rate_hz: float, roles: tuple[str, ...], range_m_s2: float) -> bytes:
    """The two lines that a text board prints at its start and every second."""
    columns = ",".join(["time_us", *(f"{role}_m_s2" for role in roles)])
    about = f"# fas board={board} rate_hz={rate_hz:g} range_m_s2={range_m_s2:g} crc=1"
    return _with_check(about) + _with_check(columns)


def encode_line(time_us: int, values: np.ndarray) -> bytes:
    """One sample (channels,) [m/s^2] with its check."""
    return _with_check(",".join([str(time_us), *(f"{value:.4f}" for value in values)]))


def _check(body: str) -> str:
    return f"{crc_ccitt(body.encode()):04X}"


def _with_check(body: str) -> bytes:
    return f"{body}*{_check(body)}\n".encode()


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
