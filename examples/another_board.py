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
from fasbody.acquire.frames import SAMPLES, Frames
from fasbody.acquire.plan import Plan
from fasbody.acquire.session import Session
from fasbody.recording.recording import Condition

RATE_HZ, RANGE_M_S2 = 1000.0, 39.2


class Device:
    """Gives frames of samples; raise `fasbody.acquire.port.Unplugged` from `read` when the device is gone."""

    def __init__(self, name: str, baud: int) -> None:
        self.frames = Frames(name, RATE_HZ, (RANGE_M_S2, RANGE_M_S2))  # base and malleolus
        self.first, self.start = 0, time.monotonic()  # <- open the device, start its sample clock

    def read(self) -> bytes:
        """The next frame, once it is there."""
        self.first += SAMPLES
        time.sleep(max(0.0, self.start + self.first / RATE_HZ - time.monotonic()))  # <- wait for the device
        wave = 2 * np.pi * 20 * (self.first + np.arange(SAMPLES)) / RATE_HZ
        values = np.column_stack([9 * np.sin(wave), 12 * np.sin(wave - 0.3)])  # <- its samples [m/s^2]
        return self.frames.frame(values / RANGE_M_S2)  # <- or self.frames.skip("overrun"), where it lost a frame

    def write(self, data: bytes) -> None:
        """Bytes from the computer, which asks who this is."""
        self.frames.greet()

    def events(self) -> list[str]:
        """What was lost and why, in words; it is kept beside the recording."""
        return self.frames.events()

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
