"""The text wire format, for simple boards: the CSV of docs/recordings.md, line by line, below a line on the board.

For example:

    # fas board=uno rate_hz=1000 range_m_s2=39.2 crc=1
    time_us,base_m_s2,malleolus_m_s2
    1000,0.12,-0.38*53E1
"""

import math

import numpy as np

from fasbody.acquire.frames import crc_ccitt
from fasbody.acquire.messages import ROLES, Block, Channel, Damage, Hello, Message
from fasbody.channels import TIME_UNITS, UNITS

#: Longest line [bytes]; what is longer is damage, so memory stays bounded.
LONGEST_LINE = 256
_WRAP_US = 2.0**32


class LineReader:
    """Turns bytes, in pieces of any size, into messages; nothing it is fed makes it fail or grow.

    Attributes:
        hello: the board's description, once it came. preamble: the bytes that said it.
    """

    def __init__(self) -> None:
        self.hello: Hello | None = None
        self.preamble = b""
        self._about: dict[str, str] | None = None
        self._about_line = ""
        self._scale: np.ndarray | None = None
        self._time_unit = 1.0
        self._last_us = -1.0
        self._turns = 0
        self._sequence = -1
        self.fresh()

    def fresh(self) -> None:
        """Forget an unfinished line: the next bytes may begin in the middle of one."""
        self._rest = b""
        self._skip = False
        self._first = True

    def feed(self, data: bytes) -> list[Message]:
        """Messages completed by these bytes."""
        messages: list[Message] = []
        lines = (self._rest + data).split(b"\n")
        self._rest = lines.pop()
        for line in lines:
            skip, self._skip = self._skip, False
            if skip or not line.strip():
                continue
            message = Damage("line too long", len(line)) if len(line) > LONGEST_LINE else self._line(line.strip())
            if message is not None and not (self._first and isinstance(message, Damage)):
                messages.append(message)  # the first piece may be the tail of a line: that is no damage
            self._first = False
        if len(self._rest) > LONGEST_LINE:
            if not self._skip:
                messages.append(Damage("no end of line", len(self._rest)))
            self._rest, self._skip, self._first = b"", True, False
        return messages

    def _line(self, line: bytes) -> Message | None:
        try:
            text = line.decode("ascii")
        except UnicodeDecodeError:
            return Damage("not text", len(line))
        if text.startswith("# fas "):
            self._about, self._about_line = dict(word.partition("=")[::2] for word in text[6:].split()), text
            return None
        if text.startswith("#"):
            return None
        if text.startswith("time_"):
            return self._header(text) or Damage("header not understood", len(line))
        if self._scale is None or self.hello is None:
            return None
        return self._data(text) or Damage("line not understood", len(line))

    def _header(self, text: str) -> Hello | None:
        """The columns; a hello if the line before them said enough."""
        if self._about is None:
            return None
        names = text.split(",")
        parts = [name.strip().partition("_")[::2] for name in names]
        rate, span = _number(self._about.get("rate_hz", "")), _number(self._about.get("range_m_s2", "inf"))
        known = all(role in ROLES and unit in UNITS for role, unit in parts[1:]) and 2 <= len(parts) <= 17
        if not known or parts[0][1] not in TIME_UNITS or not 0 < rate <= 1e6 or not span > 0:
            return None
        self._time_unit = TIME_UNITS[parts[0][1]]
        self._scale = np.array([UNITS[unit] for _, unit in parts[1:]])
        channels = tuple(Channel(role, span) for role, _ in parts[1:])
        self.hello = Hello(self._about.get("board", "text board")[:32], rate, channels)
        self.preamble = f"{self._about_line}\n{text}\n".encode()
        return self.hello

    def _data(self, text: str) -> Block | None:
        assert self._scale is not None and self.hello is not None and self._about is not None
        body, star, check = text.partition("*")
        if star:
            if check.upper() != f"{crc_ccitt(body.encode()):04X}":
                return None
        elif self._about.get("crc") == "1":
            return None
        values = [_number(cell) for cell in body.split(",")]
        if len(values) != 1 + self._scale.size or not all(math.isfinite(value) for value in values):
            return None
        if not 0 <= values[0] * self._time_unit < 1e9:
            return None
        time_us = 1e6 * self._time_unit * values[0]
        if self._time_unit == 1e-6 and time_us < self._last_us - _WRAP_US / 2:
            self._turns += 1  # micros() of a 32-bit clock starts again after 71 minutes
        self._last_us = time_us
        full = time_us + self._turns * _WRAP_US
        sequence = round(full * 1e-6 * self.hello.rate_hz)
        if sequence == self._sequence:
            return None  # two lines for one sample: the stamps are not the samples' own
        self._sequence = sequence
        samples = (np.array(values[1:]) * self._scale)[None]
        over = (np.abs(samples) >= np.array([c.range_m_s2 for c in self.hello.channels])).sum(axis=0)
        return Block(sequence % 2**32, round(full) % 2**32, samples, over)


def encode_header(board: str, rate_hz: float, roles: tuple[str, ...], range_m_s2: float) -> bytes:
    """The two lines that a text board prints at its start and every second."""
    columns = ",".join(["time_us", *(f"{role}_m_s2" for role in roles)])
    return f"# fas board={board} rate_hz={rate_hz:g} range_m_s2={range_m_s2:g} crc=1\n{columns}\n".encode()


def encode_line(time_us: int, values: np.ndarray) -> bytes:
    """One sample (channels,) [m/s^2] with its check."""
    body = ",".join([str(time_us), *(f"{value:.4f}" for value in values)])
    return f"{body}*{crc_ccitt(body.encode()):04X}\n".encode()


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
