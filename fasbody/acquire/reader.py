"""A thread that does nothing but read the board's port, so that no display and no fit can make it late."""

import contextlib
import threading
import time
from collections import deque
from dataclasses import dataclass

from fasbody.acquire.capture import Capture
from fasbody.acquire.port import WAIT_S, Port, Unplugged
from fasbody.exceptions import AcquisitionError

#: Bytes kept for a consumer that does not come; the capture file has them all.
LONGEST_QUEUE = 16_000_000
#: A pause between reads [s]: fewer wake-ups, and far below what the system's serial buffer holds.
_PAUSE_S = 0.005


@dataclass(frozen=True)
class Arrival:
    """Bytes (or, if `event`, what happened to the port) at a time of the host's clock [s]."""

    host: float
    data: bytes
    event: str = ""


class Reader(threading.Thread):
    """Reads a port until closed, writes to a capture file while there is one, and survives unplugging.

    Args:
        name: port. baud: its rate. patience: after unplugging, try to open it again for so long [s].

    Raises:
        Unplugged: the port cannot be opened now.
    """

    def __init__(self, name: str, baud: int, patience: float = 15.0) -> None:
        super().__init__(name=f"reader of {name}", daemon=True)
        self.port_name, self.baud, self.patience = name, baud, patience
        self._port: Port | None = Port(name, baud)
        self._queue: deque[Arrival] = deque()
        self._size = 0
        self._lock = threading.Lock()
        self._arrived = threading.Event()
        self._capture: Capture | None = None
        self._stop_now = threading.Event()
        self.failure: AcquisitionError | None = None
        self.looked = time.monotonic()  # when the port was last found to have, or not to have, sent something
        self.start()

    def record(self, capture: Capture | None) -> None:
        """From now on also write to this capture file, or to none."""
        with self._lock:
            self._capture = capture

    def take(self, wait: float = WAIT_S) -> list[Arrival]:
        """All that arrived since the last call, after waiting up to `wait` [s] for something.

        Raises:
            AcquisitionError: the port is gone for good, or nothing can be written any more.
        """
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
            while not self._stop_now.is_set():
                self._read_once()
        except AcquisitionError as error:
            self.failure = error
            self._arrived.set()
        finally:
            if self._port is not None:
                self._port.close()

    def _read_once(self) -> None:
        if self._port is None:
            return
        try:
            data = self._port.read()
        except Unplugged as gone:
            self._put(Arrival(time.monotonic(), b"", "unplugged"))
            self._port.close()
            self._port = None
            self._reopen(gone)
            return
        now = time.monotonic()
        if data:
            self._put(Arrival(now, data))
        self.looked = now
        if data:
            time.sleep(_PAUSE_S)

    def _reopen(self, gone: Unplugged) -> None:
        deadline = time.monotonic() + self.patience
        while not self._stop_now.wait(0.1):
            try:
                self._port = Port(self.port_name, self.baud)
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
            while self._size > LONGEST_QUEUE:
                self._size -= len(self._queue.popleft().data)
