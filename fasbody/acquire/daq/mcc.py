"""Devices of Measurement Computing on Linux and macOS (uldaq), such as the USB-1608FS-Plus and USB-1808: `--board mcc`.

The calls are those of the uldaq documentation: get_daq_device_inventory, DaqDevice, AiDevice.a_in_scan in the
background with ScanOption.CONTINUOUS, and get_scan_status for what the circular buffer holds.
"""

import time
from typing import Any

import numpy as np

from fasbody.acquire.daq import Daq
from fasbody.acquire.port import WAIT_S, Unplugged
from fasbody.exceptions import MissingPackageError

try:
    import uldaq
except ImportError:  # the extra is not installed
    raise MissingPackageError("uldaq", "mcc") from None
except OSError:  # its library in C is not
    raise Unplugged("uldaq finds no libuldaq; build it from github.com/mccdaq/uldaq, or use brew install.") from None

#: The circular buffer holds so much [s].
_BUFFER_S = 10.0
#: More than this share of it not yet read means that it was overwritten, or soon is.
_FULL = 0.9


class MCC(Daq):
    """A device of Measurement Computing; `device` is its serial number, `inputs` are neighbours such as 0 and 1."""

    errors = (uldaq.ULException, OSError)
    _device: Any = None
    _ai: Any = None

    def start(self) -> float:
        """One scan of the inputs into a circular buffer, running."""
        wiring = self.wiring
        low, high = int(wiring.inputs[0]), int(wiring.inputs[-1])
        if [int(name) for name in wiring.inputs] != list(range(low, high + 1)):
            raise Unplugged(f"{self.name}: inputs must be neighbours, such as 0 and 1, in the order of the sensors.")
        devices = uldaq.get_daq_device_inventory(uldaq.InterfaceType.ANY)
        fitting = [one for one in devices if wiring.device in ("", one.unique_id)]
        if len(fitting) != 1:
            listed = ", ".join(f"{one.product_name} {one.unique_id}" for one in devices) or "none"
            raise Unplugged(f"{self.name}: is none of, or not the only one of, the devices that are there: {listed}.")
        self._device = uldaq.DaqDevice(fitting[0])
        self._device.connect()
        self._ai = ai = self._device.get_ai_device()
        if wiring.iepe:
            for channel in range(low, high + 1):
                ai.get_config().set_chan_iepe_mode(channel, uldaq.IepeMode.ENABLED)
        mode = uldaq.AiInputMode.SINGLE_ENDED
        ranges = {range_.name: range_ for range_ in ai.get_info().get_ranges(mode)}
        name = f"BIP{wiring.range_v:g}VOLTS"
        if name not in ranges:
            raise Unplugged(f"{self.name}: has no range of +-{wiring.range_v:g} V; it has {', '.join(ranges)}.")
        size = round(_BUFFER_S * wiring.rate_hz)
        self._buffer, self._taken = uldaq.create_float_buffer(high - low + 1, size), 0
        return float(
            ai.a_in_scan(
                low, high, mode, ranges[name], size, wiring.rate_hz, uldaq.ScanOption.CONTINUOUS,
                uldaq.AInScanFlag.DEFAULT, self._buffer,
            )
        )  # fmt: skip

    def take(self) -> np.ndarray:
        """What the buffer has beyond what was taken."""
        time.sleep(WAIT_S)
        status, transfer = self._ai.get_scan_status()
        if status != uldaq.ScanStatus.RUNNING:
            raise Unplugged(f"{self.name}: its scan has ended.")
        channels = len(self.wiring.inputs)
        size, come = len(self._buffer) // channels, transfer.current_scan_count
        if come - self._taken > _FULL * size:
            raise Unplugged(f"{self.name}: the computer was too late for its buffer of {_BUFFER_S:g} s.")
        rows = np.arange(self._taken, come) % size
        self._taken = come
        return np.frombuffer(self._buffer, float).reshape(size, channels)[rows]

    def stop(self) -> None:
        """See `Daq`."""
        if self._ai is not None:
            self._ai.scan_stop()
        if self._device is not None:
            self._device.disconnect()
            self._device.release()
