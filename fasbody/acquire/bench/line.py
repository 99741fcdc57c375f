"""A serial line without hardware: the far end of a pseudo-terminal that can be unplugged, and noise for its bytes."""

import contextlib
import os
import threading
import time
import tty
from pathlib import Path

import numpy as np

#: How late a host may be [s]: Linux keeps 640 kB of a real port for it, of a pseudo-terminal only some kB, so the
#: bench keeps the rest. Nothing is kept for a host that is not there.
LATE_S = 5.0


class Line:
    """The host's end of a serial line: a pseudo-terminal under a name that stays the same when it is replugged.

    One thread may pull the plug while another sends.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master = self._slave = -1
        self._waiting, self._taken = b"", 0.0
        self._lock = threading.Lock()  # what is written after a close may go to another file of the same number

    def plug(self) -> None:
        """Make the port appear."""
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        spare = self.link.with_name(f".{self.link.name}")
        spare.symlink_to(os.ttyname(slave))
        spare.replace(self.link)
        with self._lock:
            self._waiting = b""
            self.master, self._slave = master, slave

    def unplug(self) -> None:
        """Make it vanish."""
        self.link.unlink(missing_ok=True)
        with self._lock:
            master, self.master = self.master, -1
            self._waiting = b""
            os.close(self._slave)
            os.close(master)

    def send(self, data: bytes) -> None:
        """What the host does not begin to fetch within LATE_S is dropped, as on a real line."""
        now = time.monotonic()
        with self._lock, contextlib.suppress(OSError):
            if self.master < 0:
                return
            self._waiting = self._waiting + data if now - self._taken < LATE_S else data
            done = os.write(self.master, self._waiting)
            self._waiting = self._waiting[done:]
            self._taken = now

    def receive(self) -> bytes:
        """What the host sent."""
        with self._lock, contextlib.suppress(OSError):
            return os.read(self.master, 4096)
        return b""


def corrupt(data: bytes, share: float, rng: np.random.Generator) -> bytes:
    """Replace a share of the bytes by other ones."""
    raw = np.frombuffer(data, np.uint8).copy()
    hit = rng.random(raw.size) < share
    raw[hit] ^= rng.integers(1, 256, int(hit.sum()), dtype=np.uint8)
    return raw.tobytes()
