"""A serial line without hardware: the far end of a pseudo-terminal that can be unplugged, and noise for its bytes.

What the virtual bench is made of: an SCPI instrument, a shaker, and a MuJoCo foot stepped piece by piece.

A virtual bench: an accelerometer board and a function generator as processes of their own on pseudo-terminals.

They speak the same bytes as real ones. Behind the board stands the MuJoCo foot in real time, shaken by what the
generator process says over a local socket, the cable of this bench. `Bench` starts both and can pull the plug.
"""

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
import tty
from collections import deque
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, ClassVar

import numpy as np
import typer

from fasbody.acquire.wire import Channel, Hello, encode_data, encode_header, encode_hello, encode_line
from fasbody.console import command_line
from fasbody.exceptions import AcquisitionError
from fasbody.foot.shaker import BaseMotion
from fasbody.recording.condition import SUBJECTS, foot_mass, shank_mass

#: How late a host may be [s]: Linux keeps 640 kB of a real port for it, of a pseudo-terminal only some kB, so the
#: bench keeps the rest. Nothing is kept for a host that is not there.
LATE_S = 2.0


class Line:
    """The host's end of a serial line: a pseudo-terminal under a name that stays the same when it is replugged."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master = self._slave = -1
        self._waiting, self._taken = b"", 0.0

    def plug(self) -> None:
        """Make the port appear."""
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        spare = self.link.with_name(f".{self.link.name}")
        spare.symlink_to(os.ttyname(slave))
        spare.replace(self.link)
        self._waiting = b""
        self.master, self._slave = master, slave  # last: another thread may use it at once, and must not block in it

    def unplug(self) -> None:
        """Make it vanish."""
        self.link.unlink(missing_ok=True)
        master, self.master = self.master, -1
        self._waiting = b""
        os.close(self._slave)
        os.close(master)

    def send(self, data: bytes) -> None:
        """What the host does not begin to fetch within LATE_S is lost, as on a real line."""
        if self.master < 0:
            return
        now = time.monotonic()
        self._waiting = self._waiting + data if now - self._taken < LATE_S else data
        with contextlib.suppress(OSError):
            done = os.write(self.master, self._waiting)
            self._waiting = self._waiting[done:]
            self._taken = now

    def receive(self) -> bytes:
        """What the host sent."""
        try:
            return os.read(self.master, 4096) if self.master >= 0 else b""
        except OSError:
            return b""


def corrupt(data: bytes, share: float, rng: np.random.Generator) -> bytes:
    """Replace a share of the bytes by other ones."""
    raw = np.frombuffer(data, np.uint8).copy()
    hit = rng.random(raw.size) < share
    raw[hit] ^= rng.integers(1, 256, int(hit.sum()), dtype=np.uint8)
    return raw.tobytes()


#: The subject whose masses the virtual foot has.
SUBJECT = 16
BODY_MASS_KG = SUBJECTS[SUBJECT].mass_kg
#: Base acceleration a volt at the amplifier's gain [m/s^2 per V], its lag [s], harmonics of the shaker over the first.
GAIN, LAG_S, DISTORTION = 14.0, 0.03, ((2, 0.015, 0.7), (3, 0.008, 1.9))
NOISE_BASE, NOISE_MALLEOLUS = 0.03, 0.05


class Shaker:
    """State of the SCPI generator. `do` takes one command and returns the answer to a query."""

    LIMITS: ClassVar = {"FREQ": (1e-3, 1e6), "VOLT": (0.0, 20.0), "VOLT:OFFS": (-10.0, 10.0)}

    def __init__(self) -> None:
        self.errors: deque[str] = deque(maxlen=20)
        self._reset()

    def _reset(self) -> None:
        self.values = {"FREQ": 1000.0, "VOLT": 0.1, "VOLT:OFFS": 0.0}
        self.on = False

    def do(self, command: str) -> str | None:
        """Execute one line."""
        head, _, value = command.upper().partition(" ")
        if head.endswith("?"):
            return self._answer(head[:-1])
        if head in self.LIMITS:
            self._set(head, value)
        elif head == "OUTP" and value in ("ON", "1", "OFF", "0"):
            self.on = value in ("ON", "1")
        elif head == "*CLS":
            self.errors.clear()
        elif head == "*RST":
            self._reset()
        elif command and (head, value) not in (("FUNC", "SIN"), ("VOLT:UNIT", "VPP")):
            self.errors.append('-113,"Undefined header"')
        return None

    def _set(self, head: str, value: str) -> None:
        low, high = self.LIMITS[head]
        try:
            number = float(value)
        except ValueError:
            self.errors.append('-104,"Data type error"')
            return
        if low <= number <= high:
            self.values[head] = number
        else:
            self.errors.append('-222,"Data out of range"')

    def _answer(self, head: str) -> str | None:
        if head == "*IDN":
            return "FAS,virtual generator,0,1"
        if head == "SYST:ERR":
            return self.errors.popleft() if self.errors else '0,"No error"'
        if head == "OUTP":
            return "1" if self.on else "0"
        if head in self.values:
            return f"{self.values[head]:g}"
        self.errors.append('-113,"Undefined header"')
        return None

    def output(self) -> dict[str, Any]:
        """What comes out: amplitude [V peak to peak] and frequency."""
        return {"frequency_hz": self.values["FREQ"], "volts": self.values["VOLT"] if self.on else 0.0}


class Shaken:
    """A foot on the shaker, in steps of real time.

    Args:
        rate_hz: sampling rate. added_mass_kg: on the knee. rng: noise of the sensors.
    """

    def __init__(self, rate_hz: float, added_mass_kg: float, rng: np.random.Generator) -> None:
        from fasbody.foot.model import load
        from fasbody.foot.simulate import Batch
        from fasbody.laboratory.foot import TRUTH

        masses = {"m_S": shank_mass(BODY_MASS_KG, added_mass_kg), "m_F": foot_mass(BODY_MASS_KG)}
        self.foot = load("two_dof").with_values({**TRUTH, **masses})
        self._stride = max(1, int(np.ceil(1 / rate_hz / self.foot.step - 1e-9)))
        self._step = 1 / rate_hz / self._stride
        self._batch = Batch(self.foot, 1, 1)
        self._qpos, self._qvel = self.foot.model.qpos0.copy(), np.zeros(self.foot.model.nv)
        self._rng = rng
        self._omega, self._phase = 2 * np.pi * 20.0, 0.0
        self._amplitude = self._wanted = 0.0  # [m/s^2], of the first harmonic
        self.advance(4)  # compiles

    def drive(self, order: dict[str, Any]) -> None:
        """The generator's output changed."""
        if "volts" in order:
            self._omega = 2 * np.pi * float(order["frequency_hz"])
            self._wanted = 0.5 * GAIN * float(order["volts"])

    def advance(self, samples: int) -> np.ndarray:
        """The next samples: (n, 3) base, malleolus and tuberosity (on the same rigid shank), with noise [m/s^2]."""
        count = samples * self._stride
        length = count * self._step
        controls = self._motion(length).controls(self._step, count)[None]
        out = self._batch.run(controls, self._step, self._qpos, self._qvel)
        self._qpos, self._qvel = out.qpos[0, -1].copy(), out.qvel[0, -1].copy()
        base = self.foot.base
        self._qpos[base] = self._qvel[base] = 0.0  # the foot does not feel them, and they would drift
        self._phase = (self._phase + self._omega * length) % (2 * np.pi)
        self._amplitude = self._wanted + (self._amplitude - self._wanted) * np.exp(-length / LAG_S)
        y = out.malleolus[0, :: self._stride]
        clean = np.column_stack([out.base[0, :: self._stride], y, y])
        return clean + self._rng.normal(size=clean.shape) * [NOISE_BASE, NOISE_MALLEOLUS, NOISE_MALLEOLUS]

    def _motion(self, length: float) -> BaseMotion:
        """Base motion from now on: the amplitude follows its set value with the amplifier's lag."""
        w, p, wanted, gap = self._omega, self._phase, self._wanted, self._amplitude - self._wanted
        lines = ((1, 1.0, 0.0), *DISTORTION)

        def acceleration(t: np.ndarray) -> np.ndarray:
            wave = sum(size * np.sin(h * (p + w * t) + late) for h, size, late in lines)
            return (wanted + gap * np.exp(-t / LAG_S)) * wave

        def jerk(t: np.ndarray) -> np.ndarray:
            wave = sum(size * np.sin(h * (p + w * t) + late) for h, size, late in lines)
            slope = sum(size * h * w * np.cos(h * (p + w * t) + late) for h, size, late in lines)
            fade = gap * np.exp(-t / LAG_S)
            return (wanted + fade) * slope - fade / LAG_S * wave

        return BaseMotion("virtual shaker", length, acceleration, jerk)


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
