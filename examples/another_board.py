"""A board of your own behind `Board`: `python examples/another_board.py [FOLDER]`.

Whatever gives samples (a device, a file, another program) becomes a board by one class with four methods. `Device`
stands for the maker's library here; replace what is marked. Needs `pip install 'fasbody[acquire]'`. For `--board`, see
fasbody/acquire/devices.py.
"""

import sys
import time
from pathlib import Path

import numpy as np

from fasbody.acquire.board import Board
from fasbody.acquire.folder import Converted
from fasbody.acquire.plan import Plan
from fasbody.acquire.session import Session
from fasbody.acquire.wire import Channel, Hello, encode_data, encode_hello
from fasbody.recording.recording import Condition

RATE_HZ, SAMPLES, COUNTS_PER_M_S2 = 1000.0, 16, 800.0
CHANNELS = (Channel("base", 39.2, COUNTS_PER_M_S2), Channel("malleolus", 39.2, COUNTS_PER_M_S2))


class Device:
    """Gives frames of samples; raise `fasbody.acquire.port.Unplugged` from `read` when the device is gone."""

    def __init__(self, name: str, baud: int) -> None:
        self.frame, self.start = 0, time.monotonic()  # <- open the device, start its sample clock
        self.hello = encode_hello(Hello(name, RATE_HZ, CHANNELS, 16, SAMPLES, boot=int(time.time()) % 65536))

    def read(self) -> bytes:
        """The next frame, once it is there; its number counts on over frames that the device lost."""
        first = self.frame * SAMPLES
        time.sleep(max(0.0, self.start + (first + SAMPLES) / RATE_HZ - time.monotonic()))  # <- wait for the device
        t = (first + np.arange(SAMPLES)) / RATE_HZ
        wave = 2 * np.pi * 20 * t
        values = np.column_stack([9 * np.sin(wave), 12 * np.sin(wave - 0.3)])  # <- its samples [m/s^2]
        counts = np.round(values * COUNTS_PER_M_S2).astype(np.int32)
        data = encode_data(self.frame, round(1e6 * first / RATE_HZ), counts, 16)  # <- or the device's own time [us]
        self.frame += 1
        return (self.hello if self.frame % 62 == 1 else b"") + data

    def write(self, data: bytes) -> None:
        """Bytes from the computer; this device has no use for them."""

    def events(self) -> list[str]:
        """What a frame cannot tell, in words, such as "overrun"; it is kept beside the recording."""
        return []

    def close(self) -> None:
        """<- stop and close the device."""


def main(folder: Path = Path("another_board_study"), seconds: float = 2.0) -> Converted:
    """Record so many seconds at 20 Hz, excited by hand, into a study folder; return what was made."""
    board = Board("my device", 0, opener=Device)
    board.wait_for_hello()
    condition = Condition("1", body_mass_kg=72.0)
    (made,) = Session(Plan(folder, (20.0,), condition, seconds, origin="synthetic"), board).run()
    board.close()
    return made


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
