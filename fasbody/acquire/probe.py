"""What speaks on a port: listen at each baud rate for both wire formats, then ask for an SCPI identity."""

import time
from dataclasses import dataclass

from fasbody.acquire.decoder import Decoder
from fasbody.acquire.port import BAUD_RATES, Port

_LISTEN_S, _ASK_S = 1.3, 0.5


@dataclass(frozen=True)
class Found:
    """What answered: kind ("board", "generator", "unknown bytes", "silence"), at which baud rate, who it says it is."""

    port: str
    kind: str
    baud: int
    identity: str

    def __str__(self) -> str:
        if self.kind == "silence":
            return f"{self.port}: silence; is it powered, and is its cable a data cable?"
        return f"{self.port}: {self.kind} at {self.baud} baud: {self.identity}"


def probe(name: str, rates: tuple[int, ...] = BAUD_RATES) -> Found:
    """Find out what speaks on a port.

    Raises:
        Unplugged: the port cannot be opened.
    """
    heard = Found(name, "silence", 0, "")
    for baud in rates:
        port = Port(name, baud)
        try:
            decoder = Decoder()
            port.write(b"\n?\n")
            deadline = time.monotonic() + _LISTEN_S
            while decoder.hello is None and time.monotonic() < deadline:
                decoder.feed(port.read())
            if decoder.hello is not None:
                return Found(name, "board", baud, str(decoder.hello))
            answer = _identity(port)
            if is_identity(answer):
                return Found(name, "generator", baud, answer)
            if decoder.bytes:
                heard = Found(name, "unknown bytes", baud, f"{decoder.bytes} bytes in {_LISTEN_S:g} s, no hello")
        finally:
            port.close()
    return heard


def is_identity(answer: str) -> bool:
    """Whether this answers *IDN?: maker, model, serial number (some leave it out) and version, between commas.

    A text board's lines are none: they begin with a number, or with the name of the time column.
    """
    names = answer.count(",") >= 2 and answer.isprintable() and answer[0].isalpha()
    return names and not answer.startswith("time_")


def swapped(board: str, board_baud: int, generator: str, generator_baud: int) -> str:
    """The sentence for two ports of which one is taken for the other; empty if both are, or may be, what they should.

    Both must be closed.
    """
    first, second = probe(board, (generator_baud,)), probe(generator, (board_baud,))
    if first.kind == "generator" and second.kind == "board":
        return f"{board} is the generator and {generator} the board: give --port {generator} --generator {board}."
    if first.kind == "generator":
        return f"--port {board} is a generator ({first.identity}); give the board's port."
    if second.kind == "board":
        return f"--generator {generator} is a board ({second.identity}); give the generator's port."
    return ""


def _identity(port: Port) -> str:
    port.write(b"*CLS\n*IDN?\n")
    answer, deadline = b"", time.monotonic() + _ASK_S
    while b"\n" not in answer and len(answer) < 4096 and time.monotonic() < deadline:
        answer += port.read()
    return answer.split(b"\n")[0].decode("ascii", "replace").strip()
