"""Serial ports: the only place that imports pyserial.

`Port` is an open one. `Reader` is a thread that does nothing but read the board's, so that no display and no fit can
make it late. `probe` finds the device on a port: it waits until a board has started, listens at each baud rate for
both wire formats, then queries an SCPI identity.
"""

import contextlib
import errno
import os
import termios
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from fasbody.acquire.capture import Capture
from fasbody.acquire.wire import Decoder
from fasbody.exceptions import AcquisitionError, required

#: Longest wait for bytes [s]: what a kill can cost at most, and how soon the live view shows silence.
WAIT_S = 0.02
BAUD_RATES = (921600, 500000, 460800, 230400, 115200, 57600, 38400, 19200, 9600)
_LONGEST_ANSWER = 4096
#: Bytes kept for a consumer that does not come; the capture file has them all.
_LONGEST_QUEUE = 16_000_000
#: A pause between reads [s]: fewer wake-ups, and far below what the system's serial buffer holds.
_PAUSE_S = 0.005
#: A board sends its hello within so long after its port was opened [s]: that resets an Arduino, whose boot loader then
#: waits for two seconds, and whose sensors are tested for one.
HELLO_S = 5.0
#: One that runs repeats it every second [s].
_LISTEN_S, _ASK_S = 1.3, 0.5
#: What is raised when a port goes away; pyserial's own errors are OSErrors.
_GONE = (OSError, termios.error)


def pyserial() -> Any:
    """The package with its list of ports, imported when a port is opened: a plan needs none."""
    with required("pyserial", "acquire"):
        import serial
        import serial.tools.list_ports
    return serial


class Unplugged(AcquisitionError):
    """The port went away."""


class Source(Protocol):
    """What gives the bytes of a board: a serial port, a sound card, or a user's device (docs/acquisition.md)."""

    def read(self) -> bytes:
        """What has arrived, after at most WAIT_S; raises Unplugged if nothing can come any more."""

    def write(self, data: bytes) -> None:
        """Bytes to the board."""

    def events(self) -> list[str]:
        """Events since the last call, such as an unplugged port."""

    def close(self) -> None:
        """End."""


#: Opens one by name and baud rate, or raises Unplugged.
Opener = Callable[[str, int], Source]


class Port:
    """An open serial port.

    Args:
        name: device, such as /dev/ttyACM0.
        baud: baud rate.

    Raises:
        Unplugged: there is no such port, it is in use, or it cannot run at that rate.
    """

    def __init__(self, name: str, baud: int) -> None:
        self.name, self.baud = name, baud
        try:
            self._serial = pyserial().Serial(name, baud, timeout=WAIT_S, write_timeout=1.0, exclusive=True)
            self._serial.reset_input_buffer()
        except (*_GONE, ValueError) as error:
            known = ", ".join(port.device for port in ports()) or "none"
            raise Unplugged(f"{name}: {_why(name, error)}; ports of this computer: {known}.") from None

    def change(self, baud: int) -> None:
        """Go on at another baud rate."""
        try:
            self._serial.baudrate = self.baud = baud
            self._serial.reset_input_buffer()
        except (*_GONE, ValueError) as error:
            raise Unplugged(f"{self.name}: {_why(self.name, error)}, at {baud} baud.") from None

    def read(self) -> bytes:
        """What has arrived, after at most WAIT_S."""
        try:
            data = self._serial.read(1)
            if data:
                data += self._serial.read(self._serial.in_waiting)
        except (*_GONE, TypeError):  # TypeError: closed in mid-read elsewhere
            raise Unplugged(f"{self.name}: the port went away.") from None
        return bytes(data)

    def write(self, data: bytes) -> None:
        """Pass bytes to the system; waiting until it has sent them would have no end on a line that stands still."""
        try:
            self._serial.write(data)
        except _GONE:
            raise Unplugged(f"{self.name}: the port went away or takes no bytes.") from None

    def ask(self, question: bytes, patience: float) -> tuple[str, bool]:
        """The reply to a query, and whether it came to its end within `patience` [s]."""
        self.write(question)
        answer, deadline = b"", time.monotonic() + patience
        while not (whole := b"\n" in answer or len(answer) >= _LONGEST_ANSWER) and time.monotonic() <= deadline:
            answer += self.read()
        return answer.split(b"\n")[0].decode("ascii", "replace").strip(), whole

    def events(self) -> list[str]:
        """Nothing happens to a serial port but its bytes and its end."""
        return []

    def fileno(self) -> int:
        """The open file, for a process that is to have it too."""
        return int(self._serial.fileno())

    def close(self) -> None:
        """Close; a port that went away is closed too."""
        with contextlib.suppress(*_GONE):
            self._serial.close()


def _why(name: str, error: Exception) -> str:
    """Why a port cannot be opened, in the user's words."""
    number = getattr(error, "errno", None)
    for one in (error, error.__context__):  # pyserial puts it into words only
        if isinstance(one, termios.error):
            number = one.args[0]
    path = Path(name)
    if path.is_dir() or path.is_file() or number in (errno.ENOTTY, errno.EINVAL, errno.ENODEV):
        kind = "a folder" if path.is_dir() else "a file" if path.is_file() else "some other device"
        return f"is no serial port but {kind}"
    if number == errno.ENOENT:
        return "there is no such port"
    if number in (errno.EACCES, errno.EPERM):
        return "you may not use this port (join the group dialout)"
    if number in (errno.EBUSY, errno.EAGAIN):
        return "another program uses this port"
    reason = os.strerror(number) if number else str(error).rstrip(".")
    return f"cannot be opened ({reason})"


@dataclass(frozen=True)
class PortInfo:
    """A port of this computer."""

    device: str
    description: str
    hardware: str

    def __str__(self) -> str:
        return f"{self.device}  {self.description}  {self.hardware}"


def ports() -> list[PortInfo]:
    """All serial ports of this computer."""
    infos = pyserial().tools.list_ports.comports()
    return [PortInfo(p.device, p.description or "", p.hwid or "") for p in sorted(infos)]


@dataclass(frozen=True)
class Arrival:
    """Bytes (or, if `event`, what happened to the port) at a time of the host's clock [s]."""

    host: float
    data: bytes
    event: str = ""


class Reader(threading.Thread):
    """Reads a port until closed, writes to a capture file while there is one, and survives unplugging.

    Args:
        name: port.
        baud: its rate.
        patience: after unplugging, try to open it again for so long [s].
        opener: of the port.

    Attributes:
        failure: why nothing comes any more.
        looked: when the port was last found to have, or not to have, sent something.
    """

    def __init__(self, name: str, baud: int, patience: float = 15.0, opener: Opener = Port) -> None:
        super().__init__(name=f"reader of {name}", daemon=True)
        self.port_name, self.baud, self.patience = name, baud, patience
        self._open = opener
        self._port: Source | None = opener(name, baud)
        self._queue: deque[Arrival] = deque()
        self._size = 0
        self._lock = threading.Lock()
        self._arrived = threading.Event()
        self._capture: Capture | None = None
        self._stop_now = threading.Event()
        self.failure: AcquisitionError | None = None
        self.looked = time.monotonic()
        self.start()

    def record(self, capture: Capture | None) -> None:
        """From now on also write to this capture file, or to none."""
        with self._lock:
            self._capture = capture

    def take(self, wait: float = WAIT_S) -> list[Arrival]:
        """All that arrived since the last call, after waiting up to `wait` [s] for something."""
        self._arrived.wait(wait)
        with self._lock:
            out, self._size = list(self._queue), 0
            self._queue.clear()
            if not self.failure:
                self._arrived.clear()
        if not out and self.failure:
            raise self.failure
        return out

    def send(self, data: bytes) -> None:
        """Send bytes to the board if it is there."""
        port = self._port
        if port is not None:
            with contextlib.suppress(Unplugged):  # the reading side notices and reports it
                port.write(data)

    def close(self) -> None:
        """Stop reading and close the port."""
        self._stop_now.set()
        self.join(10.0)  # a read takes 20 ms, on a busy machine longer

    def run(self) -> None:
        """Read until closed."""
        try:
            while not self._stop_now.is_set() and self._port is not None:
                self._read_once(self._port)
        except AcquisitionError as error:
            self.failure = error
            self._arrived.set()
        finally:
            if self._port is not None:
                self._port.close()

    def _read_once(self, port: Source) -> None:
        try:
            data = port.read()
        except Unplugged as gone:
            self._put(Arrival(time.monotonic(), b"", "unplugged"))
            port.close()
            self._port = None
            self._reopen(gone)
            return
        now = time.monotonic()
        for event in port.events():
            self._put(Arrival(now, b"", event))
        if data:
            self._put(Arrival(now, data))
        self.looked = now
        if data:
            time.sleep(_PAUSE_S)

    def _reopen(self, gone: Unplugged) -> None:
        deadline = time.monotonic() + self.patience
        while not self._stop_now.wait(0.1):
            try:
                self._port = self._open(self.port_name, self.baud)
            except Unplugged:
                if time.monotonic() > deadline:
                    raise AcquisitionError(
                        f"{self.port_name}: unplugged, and not back after {self.patience:g} s; plug it in, start again."
                    ) from gone
                continue
            self._put(Arrival(time.monotonic(), b"", "replugged"))
            return

    def _put(self, arrival: Arrival) -> None:
        with self._lock:
            if self._capture is not None:
                if arrival.event:
                    self._capture.add("E", arrival.host, {"event": arrival.event})
                else:
                    self._capture.add("B", arrival.host, arrival.data)
            self._queue.append(arrival)
            self._size += len(arrival.data)
            self._arrived.set()
            while self._size > _LONGEST_QUEUE:
                self._size -= len(self._queue.popleft().data)


@dataclass(frozen=True)
class ProbeResult:
    """What answered on a port.

    Attributes:
        port: its name.
        kind: "board", "generator", "unknown bytes" or "silence".
        baud: at which baud rate.
        identity: as it states it.
    """

    port: str
    kind: str
    baud: int
    identity: str

    def __str__(self) -> str:
        if self.kind == "silence":
            return f"{self.port}: silence; is it powered, and is its cable a data cable?"
        return f"{self.port}: {self.kind} at {self.baud} baud: {self.identity}"


def probe(name: str, rates: tuple[int, ...] = BAUD_RATES) -> ProbeResult:
    """Find the device on a port."""
    result = ProbeResult(name, "silence", 0, "")
    with contextlib.closing(Port(name, rates[0])) as port:  # once: opening it resets an Arduino
        boots_until = time.monotonic() + HELLO_S
        for baud in rates:
            port.change(baud)
            decoder = Decoder()
            port.write(b"\n?\n")
            _listen(port, decoder)
            if decoder.hello is None:
                answer, _ = port.ask(b"*CLS\n*IDN?\n", _ASK_S)
                if is_identity(answer):
                    return ProbeResult(name, "generator", baud, answer)
            while not decoder.bytes and time.monotonic() < boots_until:
                decoder.feed(port.read())
                if decoder.bytes:
                    _listen(port, decoder)
            if decoder.hello is not None:
                return ProbeResult(name, "board", baud, str(decoder.hello))
            if decoder.bytes:
                result = ProbeResult(name, "unknown bytes", baud, f"{decoder.bytes} bytes, no hello")
    return result


def _listen(port: Port, decoder: Decoder) -> None:
    """For as long as a running board may take to send its hello."""
    deadline = time.monotonic() + _LISTEN_S
    while decoder.hello is None and time.monotonic() < deadline:
        decoder.feed(port.read())


def is_identity(answer: str) -> bool:
    """Whether this is a reply to *IDN?: maker, model, serial number (some leave it out) and version, between commas.

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
