"""Data acquisition devices: volts of a vendor's library become the frames of a board.

A driver is a child of `Daq` with four short methods; the file of its vendor is the only one that imports the library.
"""

import contextlib
import json
import math
import time
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from fasbody.acquire.port import Unplugged
from fasbody.acquire.wire import ROLES, Channel, Hello, encode_data, encode_hello
from fasbody.console import to_json, write_whole
from fasbody.exceptions import AcquisitionError, InputFileError
from fasbody.recording.channels import volts_per_m_s2

#: Samples of a frame, and its bits.
_SAMPLES, _BITS = 16, 24
_RAIL = 2 ** (_BITS - 1)
#: So much below the range counts as over it.
_RAIL_SHARE = 1 - 1e-4
#: A read that gives nothing for so long means that the device is gone [s].
_GONE_S = 3.0


@dataclass(frozen=True)
class Wiring:
    """What is connected to a device; a JSON file.

    Attributes:
        device: its name or serial number; empty for the only one.
        inputs: of base and malleolus, and of a tuberosity if there is a third.
        sensitivity: of each sensor, as "100 mV/g", "10.2 mV/(m/s^2)" or V per m/s^2.
        rate_hz: samples per second of each.
        range_v: of the inputs [V], +-.
        iepe: the device supplies the sensors with a constant current.
    """

    device: str = ""
    inputs: tuple[str, ...] = ("0", "1")
    sensitivity: tuple[str | float, ...] = (0.1, 0.1)
    rate_hz: float = 2000.0
    range_v: float = 10.0
    iepe: bool = False

    @classmethod
    def read(cls, file: Path) -> Self:
        """From a file.

        Raises:
            InputFileError: which value is wrong, and what would be valid.
        """
        try:
            known: Any = json.loads(file.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputFileError(file, f"cannot be read ({error.strerror})", _EXAMPLE) from None
        except ValueError:
            raise InputFileError(file, "is no JSON document", _EXAMPLE) from None
        if not isinstance(known, dict) or set(known) - set(cls.__dataclass_fields__):
            raise InputFileError(file, "describes no device", _EXAMPLE)
        values: dict[str, Any] = {k: tuple(value) if isinstance(value, list) else value for k, value in known.items()}
        made = cls(**values)
        if problem := made._problem():
            raise InputFileError(file, problem, _EXAMPLE)
        for sensitivity in made.sensitivity:
            if isinstance(sensitivity, str):
                volts_per_m_s2(file, "sensitivity", sensitivity)
        return made

    def write(self, file: Path) -> None:
        """As JSON."""
        write_whole(file, to_json(asdict(self)) + "\n")

    def _problem(self) -> str:
        numbers = (self.rate_hz, self.range_v)
        if not all(isinstance(n, int | float) and not isinstance(n, bool) and 0 < n < math.inf for n in numbers):
            return "needs positive numbers as rate_hz and range_v"
        if not (isinstance(self.inputs, tuple) and 2 <= len(self.inputs) <= 3 and all(map(str, self.inputs))):
            return "needs two or three inputs: base, malleolus, tuberosity"
        if not (isinstance(self.sensitivity, tuple) and len(self.sensitivity) == len(self.inputs)):
            return "needs a sensitivity for each input"
        return "" if isinstance(self.device, str) and isinstance(self.iepe, bool) else "names no device, or no iepe"

    @property
    def volts(self) -> np.ndarray:
        """Sensitivities (channels,) [V per m/s^2]."""
        values = (volts_per_m_s2(Path("sensitivity"), "sensitivity", s) if isinstance(s, str) else s
                  for s in self.sensitivity)  # fmt: skip
        return np.array(list(values), float)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """As a board describes them."""
        return tuple(
            Channel(role, _RAIL_SHARE * self.range_v / abs(volts), _RAIL * volts / self.range_v)
            for role, volts in zip(ROLES, self.volts, strict=False)
        )

    def at_corner(self, channel: int) -> float:
        """Of an input's high-pass [Hz]: none that is known."""
        return 0.0

    def with_scale(self, channel: int, scale_m_s2: float) -> Self:
        """The same with a sensor for which full scale is this acceleration [m/s^2]."""
        values = list(self.sensitivity)
        values[channel] = self.range_v / scale_m_s2
        return replace(self, sensitivity=tuple(values))


_EXAMPLE = ('valid: {"device": "Dev1", "inputs": ["ai0", "ai1"], "sensitivity": ["100 mV/g", "100 mV/g"], '
            '"rate_hz": 2000, "range_v": 5, "iepe": true}')  # fmt: skip


class Daq(ABC):
    """A device as a source of frames.

    Args:
        wiring: what is connected.

    Raises:
        Unplugged: it cannot be opened.
    """

    #: What a library raises.
    errors: ClassVar[tuple[type[Exception], ...]] = ()

    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        self._rest = np.zeros((0, len(wiring.inputs)))
        self._frame = self._last_hello = 0
        self._events: list[str] = []
        self._hello_now = True
        try:
            self._rate_hz = self.start()
        except BaseException as error:
            self.close()
            if isinstance(error, self.errors):
                raise Unplugged(f"{self.name}: cannot be opened ({_first_line(error)}).") from None
            raise
        self._hello = encode_hello(
            Hello(self.name[:32], self._rate_hz, wiring.channels, _BITS, _SAMPLES, int(time.time()) % 65536)
        )
        self._came = time.monotonic()

    @classmethod
    def settings(cls, file: Path) -> Wiring:
        """From a file.

        Raises:
            InputFileError: it is none.
        """
        return Wiring.read(file)

    known = settings

    @property
    def name(self) -> str:
        """For messages."""
        return f"{type(self).__name__} {self.wiring.device}".strip()

    @abstractmethod
    def start(self) -> float:
        """Open and scan; the actual rate [Hz]."""

    @abstractmethod
    def take(self) -> np.ndarray:
        """Scans (n, channels) [V] that have come, after about `port.WAIT_S`; rows of NaN where some are missing."""

    @abstractmethod
    def stop(self) -> None:
        """End and close; also what was only half opened."""

    def read(self) -> bytes:
        """Frames of what has come.

        Raises:
            Unplugged: the device, or its library, gives no more: samples missing then are a gap.
        """
        try:
            volts = self.take()
        except self.errors as error:
            raise Unplugged(f"{self.name}: {_first_line(error)}.") from None
        now = time.monotonic()
        if len(volts):
            self._came = now
        elif now - self._came > _GONE_S:
            raise Unplugged(f"{self.name}: no scan for {_GONE_S:g} s.")
        self._rest = np.concatenate([self._rest, volts])
        out = b""
        while len(self._rest) >= _SAMPLES:
            scans, self._rest = self._rest[:_SAMPLES], self._rest[_SAMPLES:]
            out += self._frame_of(scans)
        return out

    def _frame_of(self, scans: np.ndarray) -> bytes:
        """A frame, behind a hello once a second; nothing, but its number, where a scan is missing."""
        second, self._frame = int(self._frame * _SAMPLES / self._rate_hz), self._frame + 1
        if np.isnan(scans).any():
            self._events.append("skipped scans")
            return b""
        hello = self._hello if self._hello_now or second != self._last_hello else b""
        self._hello_now, self._last_hello = False, second
        counts = np.clip(np.round(_RAIL * scans / self.wiring.range_v), -_RAIL, _RAIL - 1).astype(np.int32)
        number = self._frame - 1
        return hello + encode_data(number, round(1e6 * number * _SAMPLES / self._rate_hz), counts, _BITS)

    def write(self, data: bytes) -> None:
        """A query of the computer: a hello replies to it."""
        self._hello_now = True

    def events(self) -> list[str]:
        """What happened to the device since the last call."""
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """End; a device that is gone is closed too."""
        with contextlib.suppress(*self.errors):
            self.stop()

    @classmethod
    def listen(cls, wiring: Wiring, seconds: float) -> tuple[np.ndarray, float]:
        """Both sensors in shares of full scale (n, 2), and their rate [Hz]: for a calibration.

        Raises:
            AcquisitionError: the device loses scans. Unplugged: it is gone.
        """
        device = cls(wiring)
        pieces: list[np.ndarray] = []
        try:
            while sum(map(len, pieces)) < seconds * device._rate_hz:
                pieces.append(device.take())
        except cls.errors as error:
            raise Unplugged(f"{device.name}: {_first_line(error)}.") from None
        finally:
            device.close()
        volts = np.concatenate(pieces)
        if np.isnan(volts).any():
            raise AcquisitionError(f"{device.name}: it lost scans; close other programs, or lower rate_hz.")
        return volts[:, :2] / wiring.range_v, device._rate_hz


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")
