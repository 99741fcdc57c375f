"""A serial port: the only place that knows pyserial."""

import contextlib
import errno
import os
import termios
from dataclasses import dataclass
from pathlib import Path

from fasbody.exceptions import AcquisitionError, MissingPackageError

try:
    import serial
    from serial.tools import list_ports
except ImportError:  # the extra is not installed
    raise MissingPackageError("pyserial", "acquire") from None

#: Longest wait for bytes [s]: what a kill can cost at most, and how soon the live view hears of silence.
WAIT_S = 0.02
BAUD_RATES = (921600, 460800, 230400, 115200, 57600, 38400, 19200, 9600)


class Unplugged(AcquisitionError):
    """The port went away."""


@dataclass(frozen=True)
class PortInfo:
    """A port of this computer."""

    device: str
    description: str
    hardware: str

    def __str__(self) -> str:
        return f"{self.device}  {self.description}  {self.hardware}"


def ports() -> list[PortInfo]:
    """All serial ports of this computer."""
    return [PortInfo(p.device, p.description or "", p.hwid or "") for p in sorted(list_ports.comports())]


def _why(name: str, error: Exception) -> str:
    """Why a port cannot be opened, in the user's words."""
    number = getattr(error, "errno", None)
    for one in (error, error.__context__):  # pyserial puts it into words only
        if isinstance(one, termios.error):
            number = one.args[0]
    path = Path(name)
    if path.is_dir() or path.is_file() or number in (errno.ENOTTY, errno.EINVAL, errno.ENODEV):
        kind = "a folder" if path.is_dir() else "a file" if path.is_file() else "some other device"
        return f"is no serial port but {kind}"
    if number == errno.ENOENT:
        return "there is no such port"
    if number in (errno.EACCES, errno.EPERM):
        return "you may not use this port (join the group dialout)"
    if number in (errno.EBUSY, errno.EAGAIN):
        return "another program uses this port"
    reason = os.strerror(number) if number else str(error).rstrip(".")
    return f"cannot be opened ({reason})"


class Port:
    """An open serial port.

    Args:
        name: device, such as /dev/ttyACM0. baud: baud rate.

    Raises:
        Unplugged: there is no such port, it is in use, or it cannot run at that rate.
    """

    def __init__(self, name: str, baud: int) -> None:
        self.name, self.baud = name, baud
        try:
            self._serial = serial.Serial(name, baud, timeout=WAIT_S, write_timeout=1.0, exclusive=True)
            self._serial.reset_input_buffer()
        except (serial.SerialException, OSError, termios.error, ValueError) as error:
            known = ", ".join(port.device for port in ports()) or "none"
            raise Unplugged(f"{name}: {_why(name, error)}; ports of this computer: {known}.") from None

    def read(self) -> bytes:
        """What has arrived, after at most WAIT_S.

        Raises:
            Unplugged: the port went away.
        """
        try:
            data = self._serial.read(1)
            if data:
                data += self._serial.read(self._serial.in_waiting)
        except (serial.SerialException, OSError, termios.error, TypeError):  # TypeError: closed in mid-read elsewhere
            raise Unplugged(f"{self.name}: the port went away.") from None
        return bytes(data)

    def write(self, data: bytes) -> None:
        """Hand bytes to the system; waiting until it has sent them would have no end on a line that stands still.

        Raises:
            Unplugged: the port went away, or takes nothing.
        """
        try:
            self._serial.write(data)
        except (serial.SerialException, OSError, termios.error):
            raise Unplugged(f"{self.name}: the port went away or takes no bytes.") from None

    def fileno(self) -> int:
        """The open file, for a process that is to have it too."""
        return int(self._serial.fileno())

    def close(self) -> None:
        """Close; a port that went away is closed too."""
        with contextlib.suppress(OSError, termios.error):
            self._serial.close()
