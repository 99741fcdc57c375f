"""A virtual bench: an accelerometer board and a function generator as separate processes on pseudo-terminals.

They send the same bytes as real ones. Behind the board stands the MuJoCo foot in real time, shaken by what the
generator's process sends over a local socket, the cable of this bench. `Bench` starts both and can pull the plug.
"""

import json
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Self

from fasbody.exceptions import AcquisitionError

#: The folder of a bench begins so; its processes remove it if whoever started them is gone.
FOLDER = "fas_bench_"
_STARTS_WITHIN_S = 300.0


class Bench:
    """Both processes, started and stopped.

    Args:
        options: those of the command `board`, such as rate=4000, channels=3, bits=0, added_mass=2.3, seed, damage.

    Attributes:
        board_port: name to open.
        generator_port: name to open.
    """

    def __init__(self, **options: float) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix=FOLDER, ignore_cleanup_errors=True)
        root = Path(self._folder.name)
        self.board_port, self.generator_port = str(root / "board"), str(root / "generator")
        self._cable = str(root / "cable")
        words = [word for name, value in options.items() for word in (f"--{name.replace('_', '-')}", str(value))]
        self._processes = [
            subprocess.Popen(
                [sys.executable, "-m", "fasbody.acquire.bench", *command], stdin=subprocess.PIPE, start_new_session=True
            )
            for command in (
                ("board", self.board_port, self._cable, *words),
                ("generator", self.generator_port, self._cable),
            )
        ]

    def __enter__(self) -> Self:
        deadline = time.monotonic() + _STARTS_WITHIN_S
        while not (Path(self.board_port).exists() and Path(self.generator_port).exists()):
            if time.monotonic() > deadline or any(process.poll() is not None for process in self._processes):
                self.close()
                raise AcquisitionError("the virtual bench did not start.")
            time.sleep(0.02)
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def fault(self, name: str) -> None:
        """Do to the board: unplug, plug, stall, resume."""
        self._tell({"fault": name})

    def shake(self, frequency_hz: float, volts: float) -> None:
        """Drive the shaker without the generator: amplitude [V peak to peak]."""
        self._tell({"frequency_hz": frequency_hz, "volts": volts})

    def _tell(self, order: dict[str, Any]) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as speaker:
            speaker.sendto(json.dumps(order).encode(), self._cable)

    def close(self) -> None:
        """Stop both."""
        for process in self._processes:
            if process.stdin is not None:
                process.stdin.close()
        for process in self._processes:
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._folder.cleanup()
