"""Instruments by their VISA name, such as TCPIP0::192.168.1.5::5025::SOCKET or USB0::0x0957::0x2C07::MY1::INSTR.

`opened` gives a serial port or such an instrument, by the name. Only this file knows PyVISA; which library speaks is
PyVISA's own choice (PYVISA_LIBRARY), pyvisa-py where no vendor's is installed.
"""

import contextlib
from typing import Any

from fasbody.acquire.port import Port, Unplugged
from fasbody.exceptions import required

_OPENS_MS, _CHUNK = 3000, 4096


class VisaPort:
    """An open instrument; what `Generator` needs of a `Port`.

    Args:
        name: VISA resource.
        baud: of a serial one.

    Raises:
        Unplugged: there is no such instrument, or it does not reply.
    """

    def __init__(self, name: str, baud: int) -> None:
        with required("pyvisa", "visa"):
            import pyvisa
        self.name, self.baud = name, baud
        # PyVISA's own errors, those of its libraries, and those of a socket or a USB device below them
        self._errors = (pyvisa.errors.Error, OSError, ValueError)
        self._timeout = pyvisa.constants.StatusCode.error_timeout
        try:
            self._manager = pyvisa.ResourceManager()
            self._session: Any = self._manager.open_resource(name, open_timeout=_OPENS_MS)
            self._session.read_termination = "\n"
            if name.upper().startswith("ASRL"):
                self._session.baud_rate = baud
        except self._errors as error:
            raise Unplugged(f"{name}: cannot be opened ({str(error).rstrip('.')}).") from None

    def read(self) -> bytes:
        """Nothing: an instrument that is read without a query counts that as an error."""
        return b""

    def write(self, data: bytes) -> None:
        """Each line is one message."""
        try:
            for line in filter(None, data.split(b"\n")):
                self._session.write_raw(line + b"\n")
        except self._errors as error:
            raise Unplugged(f"{self.name}: unplugged, or takes nothing ({str(error).rstrip('.')}).") from None

    def ask(self, question: bytes, patience: float) -> tuple[str, bool]:
        """The reply, and whether it came within `patience` [s]."""
        self.write(question)
        try:
            self._session.timeout = round(1000 * patience)
            answer = self._session.read_raw(_CHUNK)
        except self._errors as error:
            if getattr(error, "error_code", None) != self._timeout:
                raise Unplugged(f"{self.name}: unplugged, or gives nothing ({str(error).rstrip('.')}).") from None
            with contextlib.suppress(*self._errors, NotImplementedError):
                self._session.clear()  # a late reply must not be taken for the next query's
            return "", False
        return answer.decode("ascii", "replace").strip(), True

    def fileno(self) -> int:
        """None that another process could use."""
        return -1

    def close(self) -> None:
        """Close; an instrument that is gone is closed too."""
        with contextlib.suppress(*self._errors):
            self._session.close()


def is_visa(name: str) -> bool:
    """Whether this is a VISA name, and no serial port's."""
    return "::" in name


def opened(name: str, baud: int) -> Port | VisaPort:
    """The port or instrument of this name."""
    return VisaPort(name, baud) if is_visa(name) else Port(name, baud)
