"""The firmware on simavr: compiled as the Arduino IDE does, run cycle by cycle, its UART on a pseudo-terminal."""

import contextlib
import json
import shutil
import signal as signal_
import subprocess
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from fasbody.acquire.bench.foot import BODY_MASS_KG
from fasbody.acquire.firmware import SKETCH
from fasbody.acquire.port import Port, Unplugged
from fasbody.acquire.wire import Block, FrameReader, Hello
from fasbody.exceptions import AcquisitionError
from fasbody.foot.shaker import sine
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.foot import TRUTH, exact
from fasbody.laboratory.instrument import Instrument
from fasbody.recording.condition import foot_mass, shank_mass
from simulator.departure import GRAVITY

HOST = Path(__file__).with_name("simavr_board.c")
BAUD = 500_000
CLOCK_HZ = 16_000_000
#: Debian packages that bring what is compiled here.
PACKAGES = "gcc-avr, avr-libc, gcc, libsimavr-dev and libelf-dev"
#: Sampling rate of the signals that the sensors feel [Hz].
SIGNAL_HZ = 8000.0
#: What tells which sensor the firmware is for.
SENSORS = {"ANALOG": 335, "ADXL345": 345, "ADXL355": 355}
_FLAGS = (
    "-mmcu=atmega328p",
    f"-DF_CPU={CLOCK_HZ}UL",
    "-Os",
    "-std=gnu++11",
    "-fno-exceptions",
    "-fno-threadsafe-statics",
)


def missing() -> str:
    """What this computer lacks to compile and run the firmware; empty if nothing."""
    header = Path("/usr/include/simavr/sim_avr.h")
    absent = [name for name in ("avr-g++", "gcc") if shutil.which(name) is None]
    absent += [] if header.is_file() else ["libsimavr-dev"]
    return f"{', '.join(absent)} missing; apt install {PACKAGES}" if absent else ""


def compile_firmware(
    folder: Path, sensor: str = "ANALOG", rate_hz: int = 1000, changed: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
) -> Path:  # fmt: skip
    """The firmware of a board: the shipped sketch for one sensor, with text or constants replaced."""
    elf = folder / f"fas_{sensor}_{rate_hz}.elf"
    text = SKETCH.read_text()
    for old, new in (changed or {}).items():
        if old not in text:
            raise AcquisitionError(f"the sketch has no {old!r}.")
        text = text.replace(old, new)
    options = ["-x", "c++", f"-DSENSOR={sensor}", f"-DRATE_HZ={rate_hz}", "-Wall", "-Wextra", "-Werror"]
    options += [f"-D{name}={value}" for name, value in (constants or {}).items()]
    subprocess.run(["avr-g++", *_FLAGS, *options, "-", "-o", str(elf)], check=True, input=text, text=True)
    return elf


def compile_host(folder: Path) -> Path:
    """The program that simulates the board."""
    program = folder / "simavr_board"
    libraries = ["-lsimavr", "-lelf", "-lutil", "-lm"]
    subprocess.run(["gcc", "-O2", "-Wall", str(HOST), "-o", str(program), *libraries], check=True)
    return program


class SimulatedBoard:
    """The board in use.

    Args:
        host: what `compile_host` gave.
        elf: what `compile_firmware` gave.
        folder: for the port and the signal.
        signal: (n, 2) accelerations of base and malleolus [m/s^2] at SIGNAL_HZ, repeated for ever; None counts.
        seconds: of the board's time.
        real: in real time; otherwise as fast as it is read.
        fault: "dead1" cuts the cable of the malleolus.

    Attributes:
        port: name to open.
        report: what the simulator saw, once it has ended.
    """

    def __init__(
        self, host: Path, elf: Path, folder: Path, signal: np.ndarray | None = None, seconds: float = 3600.0,
        real: bool = True, fault: str = "",
    ) -> None:  # fmt: skip
        self.port = str(folder / f"{elf.stem}_{time.monotonic_ns()}")
        self.report: dict[str, Any] = {}
        name = "count"
        if signal is not None:
            name = f"{self.port}.signal"
            Path(name).write_bytes(signal.astype("<f4").tobytes())
        words = [str(host), str(elf), self.port, str(SENSORS[elf.stem.split("_")[1]]), f"{seconds:g}", name]
        words += [f"{SIGNAL_HZ:g}", "real" if real else "fast", fault]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> Self:
        deadline = time.monotonic() + 300.0
        while not Path(self.port).exists():
            if self._process.poll() is not None or time.monotonic() > deadline:
                raise AcquisitionError("the simulated board did not start.")
            time.sleep(0.01)
        return self

    def __exit__(self, *error: object) -> None:
        self.end()

    def end(self) -> None:
        """Switch it off and read its report."""
        if not self.report:
            self.pause(False)  # where a test left it standing still
            output, _ = self._process.communicate("")
            self.report = json.loads(output)

    def pause(self, paused: bool = True) -> None:
        """Let it stand still, or go on."""
        self._process.send_signal(signal_.SIGSTOP if paused else signal_.SIGCONT)

    def bytes(self) -> Iterator[bytes]:
        """All that it sends until its time is over, as it comes; for a board that is not in real time."""
        port = Port(self.port, BAUD)
        with contextlib.closing(port), contextlib.suppress(Unplugged):  # it goes away at its end
            while True:
                yield port.read()


def readings(samples: int, rate_hz: int) -> np.ndarray:
    """(samples, 2) counts that a board which counts its conversions must send."""
    turns = 8000 // rate_hz
    code = (230 + np.arange(samples * turns) * 7919 % 563).reshape(samples, turns)
    base = np.array([0, 1, 1, 0, 1, 0, 0, 1][:turns]) == 0  # the order of the conversions, as the sketch has it
    return np.column_stack([code[:, base].sum(1), code[:, ~base].sum(1)]) - 512 * turns // 2


def sent(
    host: Path, elf: Path, folder: Path, signal: np.ndarray, seconds: float
) -> tuple[Hello, np.ndarray, dict[str, Any]]:
    """What a board that feels a signal sends in so much of its time: its hello, samples (n, 2) and the report.

    Raises:
        AcquisitionError: it says nothing.
    """
    reader, blocks = FrameReader(), []
    with SimulatedBoard(host, elf, folder, signal=signal, seconds=seconds, real=False) as board:
        for data in board.bytes():
            blocks += [message.samples for message in reader.feed(data) if isinstance(message, Block)]
    if reader.hello is None or not blocks:
        raise AcquisitionError(f"the simulated board said nothing: {board.report}.")
    return reader.hello, np.concatenate(blocks), board.report


def foot(hz: float, peak_to_peak: float = 17.9) -> tuple[np.ndarray, complex]:
    """One second of what both sensors on the virtual foot feel upright in gravity, by DOP853, and its transmissibility.

    Args:
        hz: a whole number, so that the second can be repeated.
        peak_to_peak: of the base [m/s^2].
    """
    masses = {"m_S": shank_mass(BODY_MASS_KG, 0.0), "m_F": foot_mass(BODY_MASS_KG)}
    instrument = Instrument(delay_s=0.0, rate_hz=SIGNAL_HZ)
    true = exact(TwoDof.from_values({**TRUTH, **masses}), sine(hz, 5.0, peak_to_peak), 1.0, instrument, settle=2.0)
    felt = np.column_stack([true.base_m_s2, true.malleolus_m_s2])
    base, malleolus = lines(felt, SIGNAL_HZ, hz)
    return felt + GRAVITY, complex(malleolus / base)


def lines(values: np.ndarray, rate_hz: float, hz: float) -> np.ndarray:
    """Complex amplitudes of each column (n, c) at `hz`, by least squares."""
    t = np.arange(len(values)) / rate_hz
    basis = np.column_stack([np.ones(t.size), np.exp(2j * np.pi * hz * t), np.exp(-2j * np.pi * hz * t)])
    return np.asarray(np.linalg.lstsq(basis, values.astype(complex), rcond=None)[0][1])
