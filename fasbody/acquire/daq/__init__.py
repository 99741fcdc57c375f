"""Data acquisition devices: volts of a vendor's library become the frames of a board.

A driver is a child of `Daq` with four short methods; the file of its vendor is the only one that imports the library.
"""

import contextlib
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, Field

from fasbody.acquire.documents import SettingsFile
from fasbody.acquire.frames import SAMPLES, Frames
from fasbody.acquire.port import Unplugged
from fasbody.exceptions import AcquisitionError, InputFileError
from fasbody.recording.channels import volts_per_m_s2

#: A read that gives nothing for so long means that the device is gone [s].
_GONE_S = 3.0


_Positive = Annotated[float, Field(gt=0, description="a positive number")]
_Input = Annotated[str, BeforeValidator(str)]


@dataclass(frozen=True)
class Wiring(SettingsFile):
    """What is connected to a device; a JSON file.

    Attributes:
        device: its name or serial number; empty for the only one.
        inputs: of base and malleolus, and of a tuberosity if there is a third.
        sensitivity: of each sensor, as "100 mV/g", "10.2 mV/(m/s^2)" or V per m/s^2.
        rate_hz: samples per second of each.
        range_v: of the inputs [V], +-.
        iepe: the device supplies the sensors with a constant current.
    """

    device: Annotated[str, Field(description="its name, or its serial number as a text")] = ""
    inputs: Annotated[
        tuple[_Input, ...],
        Field(min_length=2, max_length=3, description="two or three inputs: base, malleolus, tuberosity"),
    ] = ("0", "1")
    sensitivity: Annotated[
        tuple[str | float, ...], Field(min_length=2, max_length=3, description="one for each input")
    ] = (0.1, 0.1)
    rate_hz: _Positive = 2000.0
    range_v: _Positive = 10.0
    iepe: Annotated[bool, Field(description="true or false")] = False

    TITLE = "wiring of a device"
    VALID = (
        'valid: {"device": "Dev1", "inputs": ["ai0", "ai1"], "sensitivity": ["100 mV/g", '
        '"100 mV/g"], "rate_hz": 2000, "range_v": 5, "iepe": true}'
    )

    @classmethod
    def read(cls, file: Path) -> Self:
        """From a file; a sensitivity has a unit that is known."""
        wiring = super().read(file)
        if len(wiring.sensitivity) != len(wiring.inputs):
            raise InputFileError(file, "needs a sensitivity for each input", cls.VALID)
        for sensitivity in wiring.sensitivity:
            if isinstance(sensitivity, str):
                volts_per_m_s2(file, "sensitivity", sensitivity)
        return wiring

    @property
    def volts(self) -> np.ndarray:
        """Sensitivities (channels,) [V per m/s^2]."""
        values = (volts_per_m_s2(Path("sensitivity"), "sensitivity", s) if isinstance(s, str) else s
                  for s in self.sensitivity)  # fmt: skip
        return np.array(list(values), float)

    def at_corner(self, channel: int) -> float:
        """Of an input's high-pass [Hz]: none that is known."""
        return 0.0

    def with_scale(self, channel: int, scale_m_s2: float) -> Self:
        """The same with a sensor for which full scale is this acceleration [m/s^2]."""
        values = list(self.sensitivity)
        values[channel] = self.range_v / scale_m_s2
        return replace(self, sensitivity=tuple(values))


class Daq(ABC):
    """A device as a source of frames.

    Args:
        wiring: what is connected.
    """

    #: What a library raises.
    errors: ClassVar[tuple[type[Exception], ...]] = ()

    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        self._rest = np.zeros((0, len(wiring.inputs)))
        try:
            self._rate_hz = self.start()
        except BaseException as error:
            self.close()
            if isinstance(error, self.errors):
                problem = f"cannot be opened ({_first_line(error)})"
                raise Unplugged(f"{self.name}: {problem}.") from None
            raise
        self._frames = Frames(self.name, self._rate_hz, wiring.range_v / wiring.volts)
        self.events = self._frames.events
        self._came = time.monotonic()

    @classmethod
    def settings(cls, file: Path) -> Wiring:
        """From a file."""
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
        while len(self._rest) >= SAMPLES:
            scans, self._rest = self._rest[:SAMPLES], self._rest[SAMPLES:]
            if np.isnan(scans).any():
                self._frames.skip("skipped scans")
            else:
                out += self._frames.frame(scans / self.wiring.range_v)
        return out

    def write(self, data: bytes) -> None:
        """A query of the computer: a hello replies to it."""
        self._frames.greet()

    def close(self) -> None:
        """End; a device that is gone is closed too."""
        with contextlib.suppress(*self.errors):
            self.stop()

    @classmethod
    def listen(cls, wiring: Wiring, seconds: float) -> tuple[np.ndarray, float]:
        """Both sensors in shares of full scale (n, 2), and their rate [Hz]: for a calibration."""
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
