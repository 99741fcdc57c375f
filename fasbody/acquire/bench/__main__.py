"""`fasbody board|generator`: the two processes of a bench."""

import contextlib
import json
import select
import socket
import sys
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from fasbody.acquire.bench import FOLDER
from fasbody.acquire.bench.board import RANGE_M_S2, VirtualFrames, VirtualLines
from fasbody.acquire.bench.foot import ShakenFoot
from fasbody.acquire.bench.generator import VirtualGenerator
from fasbody.acquire.bench.line import Line, corrupt
from fasbody.console import command_line

LinkArgument = Annotated[Path, typer.Argument(help="name of the port to make, a link to a terminal")]
CableArgument = Annotated[Path, typer.Argument(help="socket from the generator to the board, made by the board")]
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def board(
    link: LinkArgument,
    cable: CableArgument,
    rate: Annotated[float, typer.Option(help="samples per second")] = 1000.0,
    channels: Annotated[int, typer.Option(help="2, or 3 with the tuberosity")] = 2,
    bits: Annotated[int, typer.Option(help="bits of a sample in a frame; 0 for text lines")] = 16,
    added_mass: Annotated[float, typer.Option(help="mass on the knee in kg")] = 0.0,
    seed: Annotated[int, typer.Option(help="seed of noise and damage")] = 1,
    damage: Annotated[float, typer.Option(help="share of the received bytes that are wrong")] = 0.0,
    one_mass: Annotated[
        float, typer.Option(help="both sensors on the base, the malleolus' with this gain; 0 for a foot")
    ] = 0.0,
) -> None:
    """Simulate the accelerometer board: sample the virtual foot and send frames (with --bits 0: text lines).

    Runs until its standard input is closed.

    Examples:
      fasbody board /tmp/board /tmp/cable

      fasbody board /tmp/board /tmp/cable --rate 4000 --channels 3 --damage 0.01
    """
    rng = np.random.default_rng(seed)
    foot = ShakenFoot(rate, added_mass, rng, one_mass)
    speaker = VirtualFrames(rate, channels, bits, seed) if bits else VirtualLines(rate, channels)
    n = speaker.samples
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.bind(str(cable))
    line = Line(link)
    line.plug()
    start, sent, stalled = time.monotonic(), 0, False
    chunk = max(1, round(0.016 * rate / n))  # frames a step: 16 ms
    while True:
        due = start + (sent + chunk) * n / rate
        wait = 1.0
        while wait > 0:  # once at least, for a board that is behind also takes the generator's orders
            wait = due - time.monotonic()
            for ready in select.select([listener, sys.stdin], [], [], max(0.0, wait))[0]:
                if ready is sys.stdin:
                    return _leave(link, cable)
                order = json.loads(listener.recv(4096))
                stalled = _fault(str(order.get("fault")), line, stalled)
                foot.drive(order)
        if line.receive():
            line.send(speaker.hello)  # a query of its identity
        shares = foot.advance(chunk * n)[:, :channels] / RANGE_M_S2
        out = b"".join(speaker.frame(part) for part in np.split(shares, chunk))
        sent += chunk
        if stalled:
            out = b""
        line.send(corrupt(out, damage, rng) if damage else out)


@app.command()
def generator(link: LinkArgument, cable: CableArgument) -> None:
    """Simulate the function generator: a small SCPI instrument that drives the shaker.

    Runs until its standard input is closed.

    Examples:
      fasbody generator /tmp/generator /tmp/cable
    """
    line = Line(link)
    line.plug()
    instrument = VirtualGenerator()
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


def _fault(name: str, line: Line, stalled: bool) -> bool:
    """Pull the plug, put it back, or make the firmware hang."""
    if name == "unplug" and line.master >= 0:
        line.unplug()
    if name == "plug" and line.master < 0:
        line.plug()
    return {"stall": True, "resume": False}.get(name, stalled)


def _leave(*files: Path) -> None:
    """Whoever started the bench is gone; if it was killed, nobody else clears up."""
    for file in files:
        file.unlink(missing_ok=True)
    if files[0].parent.name.startswith(FOLDER):
        with contextlib.suppress(OSError):  # the other process still has something there, or was the last one
            files[0].parent.rmdir()


if __name__ == "__main__":
    command_line(app)
