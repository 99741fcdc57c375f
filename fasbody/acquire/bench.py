"""A virtual bench: an accelerometer board and a function generator as processes of their own on pseudo-terminals.

They speak the same bytes as real ones. Behind the board stands the MuJoCo foot in real time, shaken by what the
generator process says over a local socket, the cable of this bench. `Bench` starts both and can pull the plug.
"""

import contextlib
import json
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any

import numpy as np
import typer

from fasbody.acquire.frames import encode_data, encode_hello
from fasbody.acquire.line import Line, corrupt
from fasbody.acquire.lines import encode_header, encode_line
from fasbody.acquire.messages import Channel, Hello
from fasbody.acquire.shaken import Shaken, Shaker
from fasbody.console import command_line
from fasbody.exceptions import AcquisitionError

RANGE_M_S2 = 39.2
FRAME_SAMPLES = 16
_STARTS_WITHIN_S = 60.0
_FOLDER = "fas_bench_"

LinkArgument = Annotated[Path, typer.Argument(help="name of the port to make, a link to a terminal")]
CableArgument = Annotated[Path, typer.Argument(help="socket from the generator to the board, made by the board")]
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def board(
    link: LinkArgument,
    cable: CableArgument,
    rate: Annotated[float, typer.Option(help="samples a second")] = 1000.0,
    channels: Annotated[int, typer.Option(help="2, or 3 with the tuberosity")] = 2,
    bits: Annotated[int, typer.Option(help="of a sample in a frame; 0 for text lines")] = 16,
    added_mass: Annotated[float, typer.Option(help="on the knee in kg")] = 0.0,
    seed: Annotated[int, typer.Option(help="seed of noise and damage")] = 1,
    damage: Annotated[float, typer.Option(help="share of bytes that arrive wrong")] = 0.0,
) -> None:
    """The accelerometer board: samples the shaken foot and sends frames (or, with --bits 0, text lines).

    Runs until its standard input is closed.

    Examples:
      python -m fasbody.acquire.bench board /tmp/board /tmp/cable

      python -m fasbody.acquire.bench board /tmp/board /tmp/cable --rate 4000 --channels 3 --damage 0.01
    """
    rng = np.random.default_rng(seed)
    foot = Shaken(rate, added_mass, rng)
    roles = ("base", "malleolus", "tuberosity")[:channels]
    counts_per = 2 ** (bits - 1) / RANGE_M_S2 if bits else 1.0
    span = float(np.float32(RANGE_M_S2 * 0.9999))  # a hair inside the rails
    n = FRAME_SAMPLES if bits else 1
    hello = Hello("virtual board", rate, tuple(Channel(r, span, counts_per) for r in roles), bits, n, seed)
    greeting = encode_hello(hello) if bits else encode_header("virtual", rate, roles, span)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.bind(str(cable))
    line = Line(link)
    line.plug()
    start, sent, stalled = time.monotonic(), 0, False
    per_second = round(rate / n)
    chunk = max(1, round(0.016 * rate / n))  # frames a step: 16 ms
    while True:
        due = start + (sent + chunk) * n / rate
        while (wait := due - time.monotonic()) > 0:
            for ready in select.select([listener, sys.stdin], [], [], wait)[0]:
                if ready is sys.stdin:
                    return _leave(link, cable)
                order = json.loads(listener.recv(4096))
                stalled = _fault(order, line, stalled)
                foot.drive(order)
        if line.receive():
            line.send(greeting)  # it was asked who it is
        values = foot.advance(chunk * n)[:, : len(roles)]
        out = b""
        for i in range(chunk):
            part = values[i * n : (i + 1) * n]
            if (sent + i) % per_second == 0:
                out += greeting
            stamp = round((sent + i) * n / rate * 1e6)
            if bits:
                rail = 2 ** (bits - 1)
                counts = np.clip(np.round(part * counts_per), -rail, rail - 1).astype(np.int32)
                out += encode_data(sent + i, stamp, counts, bits)
            else:
                out += encode_line(stamp, part[0])
        sent += chunk
        if stalled:
            out = b""
        line.send(corrupt(out, damage, rng) if damage else out)


def _leave(*files: Path) -> None:
    """Whoever started the bench is gone; if it was killed, nobody else clears up."""
    for file in files:
        file.unlink(missing_ok=True)
    if files[0].parent.name.startswith(_FOLDER):
        with contextlib.suppress(OSError):  # the other process still has something there, or was the last one
            files[0].parent.rmdir()


def _fault(order: dict[str, Any], line: Line, stalled: bool) -> bool:
    """Pull the plug, put it back, or make the firmware hang."""
    fault = order.get("fault")
    if fault == "unplug" and line.master >= 0:
        line.unplug()
    if fault == "plug" and line.master < 0:
        line.plug()
    return {"stall": True, "resume": False}.get(str(fault), stalled)


@app.command()
def generator(link: LinkArgument, cable: CableArgument) -> None:
    """The function generator: a small SCPI instrument whose output drives the shaker.

    Runs until its standard input is closed.

    Examples:
      python -m fasbody.acquire.bench generator /tmp/generator /tmp/cable
    """
    line = Line(link)
    line.plug()
    instrument = Shaker()
    speaker = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    buffer = b""
    while True:
        ready = select.select([line.master, sys.stdin], [], [])[0]
        if sys.stdin in ready:
            return _leave(link)
        buffer += line.receive()
        *commands, buffer = buffer[-4096:].split(b"\n")
        for command in commands:
            answer = instrument.do(command.decode("ascii", "replace").strip())
            if answer is not None:
                line.send(answer.encode() + b"\n")
        if commands:
            with contextlib.suppress(OSError):  # the shaker may not be connected
                speaker.sendto(json.dumps(instrument.output()).encode(), str(cable))


class Bench:
    """Both processes, started and stopped.

    Args:
        rate_hz, channels, bits, added_mass_kg, seed, damage: as the options of `board`.

    Attributes:
        board_port, generator_port: names to open.
    """

    def __init__(
        self, rate_hz: float = 1000.0, channels: int = 2, bits: int = 16, added_mass_kg: float = 0.0, seed: int = 1,
        damage: float = 0.0,
    ) -> None:  # fmt: skip
        self._folder = tempfile.TemporaryDirectory(prefix=_FOLDER, ignore_cleanup_errors=True)
        root = Path(self._folder.name)
        self.board_port, self.generator_port = str(root / "board"), str(root / "generator")
        self._cable = str(root / "cable")
        options = ["--rate", rate_hz, "--channels", channels, "--bits", bits, "--added-mass", added_mass_kg]
        options += ["--seed", seed, "--damage", damage]
        self._processes = [
            self._start("board", self.board_port, self._cable, *map(str, options)),
            self._start("generator", self.generator_port, self._cable),
        ]

    def __enter__(self) -> "Bench":
        deadline = time.monotonic() + _STARTS_WITHIN_S
        while not (Path(self.board_port).exists() and Path(self.generator_port).exists()):
            if time.monotonic() > deadline or any(process.poll() is not None for process in self._processes):
                self.close()
                raise AcquisitionError("the virtual bench did not start.")
            time.sleep(0.02)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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

    @staticmethod
    def _start(*words: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "fasbody.acquire.bench", *words]
        return subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True)

    def close(self) -> None:
        """Stop both."""
        for process in self._processes:
            if process.stdin is not None:
                process.stdin.close()
        for process in self._processes:
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                process.wait()
        self._folder.cleanup()


if __name__ == "__main__":
    command_line(app)
