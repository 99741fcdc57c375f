"""One door for all boards: `--board NAME`, for acquire, calibrate and plan run alike.

A package adds a device by an entry point in its pyproject.toml:

    [project.entry-points."fasbody.devices"]
    mine = "my_package:Mine"

`Mine` has the four methods of `fasbody.acquire.port.Source`, and a class method `settings(file)` that reads what
`--calibration FILE` names (or refuses it before anything moves) and whose result its constructor takes. It may have
`output(settings, source)`, a generator on the same device, and `listed()`, what this computer has.
"""

import importlib
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Self

from fasbody.acquire.board import Board
from fasbody.acquire.generator import Excitation, Generator
from fasbody.acquire.port import Source, Unplugged, swapped
from fasbody.acquire.visa import is_visa
from fasbody.exceptions import AcquisitionError, SettingError, unknown

GROUP, SERIAL = "fasbody.devices", "serial"
#: What ships: name, module, class, and the file of its settings where none is given.
_SHIPPED = {
    "audio": ("fasbody.acquire.audio", "SoundCard", "sound_card.json"),
    "ni": ("fasbody.acquire.daq.ni", "NI", "ni.json"),
    "mcc": ("fasbody.acquire.daq.mcc", "MCC", "mcc.json"),
    "labjack": ("fasbody.acquire.daq.labjack", "LabJack", "labjack.json"),
}
#: How long a device may take for its first sample [s]; a sound server on a busy computer takes seconds.
_STARTS_S = 40.0


def names() -> list[str]:
    """All that --board takes."""
    return [SERIAL, *_SHIPPED, *sorted({entry.name for entry in entry_points(group=GROUP)} - set(_SHIPPED))]


def kind(name: str) -> Any:
    """The class of a device."""
    if name in _SHIPPED:
        module, cls, _ = _SHIPPED[name]
        return getattr(importlib.import_module(module), cls)
    for entry in entry_points(group=GROUP):
        if entry.name == name:
            return entry.load()
    raise SettingError(f"{unknown('--board', name, names())}.")


def file_of(name: str, settings: Path | None) -> Path:
    """The file of a device's settings."""
    return settings or Path(_SHIPPED[name][2] if name in _SHIPPED else f"{name}.json")


def opened(device: Any, settings: Any) -> tuple[Board, Excitation | None]:
    """A board on a device, and the device's own output if it has one."""
    sources: list[Source] = []

    def opener(name: str, baud: int) -> Source:
        sources[:] = [device(settings)]
        return sources[0]

    board = Board(getattr(settings, "device", "") or device.__name__, 0, opener=opener)
    output = getattr(device, "output", None)
    return board, None if output is None else output(settings, lambda: sources[0])


@dataclass(frozen=True)
class Equipment:
    """What a laboratory has on its bench.

    Attributes:
        board: one of `names()`.
        port: of a serial board.
        baud: its rate.
        generator: port or VISA name of a generator; None for the board's own output, or none.
        generator_baud: its rate.
        settings: file of a device that is no serial board.
    """

    board: str = SERIAL
    port: str | None = None
    baud: int = 921600
    generator: str | None = None
    generator_baud: int = 115200
    settings: Path | None = None

    @classmethod
    def simulated(cls, stack: ExitStack, **options: float) -> Self:
        """A virtual bench with these options; the stack ends it."""
        from fasbody.acquire.bench import Bench

        bench = stack.enter_context(Bench(**options))
        return cls(port=bench.board_port, generator=bench.generator_port)

    def check(self) -> None:
        """Refuse what does not fit together, before anything is opened."""
        if self.board == SERIAL:
            if self.settings is not None:
                raise SettingError("--calibration belongs to a device: add --board, or leave it out.")
            if self.port is None:
                raise SettingError("give --port (fasbody record --list shows them), --board or --simulate.")
        elif self.port is not None:
            raise SettingError(f"--board {self.board} is no serial port: leave out --port.")
        else:
            kind(self.board).settings(file_of(self.board, self.settings))

    @property
    def excites(self) -> bool:
        """Whether there is an output for the excitation."""
        return self.generator is not None or (self.board != SERIAL and hasattr(kind(self.board), "output"))

    def open(self, stack: ExitStack) -> tuple[Board, Excitation | None]:
        """Board and generator, both known to be what they should be; the stack closes them."""
        if self.board != SERIAL:
            return self._device(stack)
        assert self.port is not None
        try:
            with ExitStack() as inner:
                board = Board(self.port, self.baud)
                inner.callback(board.close)
                board.wait_for_hello()
                source = inner.enter_context(Generator(self.generator, self.generator_baud)) if self.generator else None
                stack.push(inner.pop_all())
                return board, source
        except Unplugged:
            raise
        except AcquisitionError:
            names = self.port, self.baud, self.generator or "", self.generator_baud
            if self.generator and not is_visa(self.generator) and (sentence := swapped(*names)):
                raise SettingError(sentence) from None
            raise

    def _device(self, stack: ExitStack) -> tuple[Board, Excitation | None]:
        device = kind(self.board)
        board, output = opened(device, device.settings(file_of(self.board, self.settings)))
        stack.callback(board.close)
        try:
            board.wait_for_hello(_STARTS_S)
        except Unplugged:
            raise
        except AcquisitionError:
            raise AcquisitionError(
                f"{board.reader.port_name}: it is open and gave no sample in {_STARTS_S:g} s; does another program use "
                "it, and can it do that rate?"
            ) from None
        if self.generator:
            output = Generator(self.generator, self.generator_baud)
        if output is not None:
            stack.enter_context(output)  # type: ignore[arg-type]
        return board, output
