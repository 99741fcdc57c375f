"""LabJack T4, T7 and T8 (LJM): `--board labjack`.

The calls are those of LJM's documentation (support.labjack.com, LJM User's Guide): openS, namesToAddresses,
eStreamStart, eStreamRead, whose scans that the device skipped are all -9999.
"""

import math
from typing import Any

import numpy as np

from fasbody.acquire.daq import Daq
from fasbody.acquire.port import WAIT_S
from fasbody.exceptions import MissingPackageError

try:
    from labjack import ljm
except ImportError:  # the extra is not installed
    raise MissingPackageError("labjack-ljm", "labjack") from None


class LabJack(Daq):
    """A LabJack; `device` is its serial number, name or address, `inputs` such as AIN0 and AIN1.

    It has no constant current for IEPE sensors. A T7 takes its inputs one after the other: measure the delay.
    """

    errors = (ljm.LJMError, OSError)
    _handle: Any = None

    def start(self) -> float:
        """One stream of the inputs, running."""
        wiring = self.wiring
        if wiring.iepe:
            raise OSError("it supplies no IEPE sensors; put a conditioner between, and say iepe false")
        self._handle = handle = ljm.openS("ANY", "ANY", wiring.device or "ANY")
        names = [name if name.upper().startswith("AIN") else f"AIN{name}" for name in wiring.inputs]
        for name in names:
            ljm.eWriteName(handle, f"{name}_RANGE", wiring.range_v)
        addresses, _ = ljm.namesToAddresses(len(names), names)
        scans = math.ceil(WAIT_S * wiring.rate_hz)
        return float(ljm.eStreamStart(handle, scans, len(names), addresses, wiring.rate_hz))

    def take(self) -> np.ndarray:
        """The next scans, once they are there."""
        data, _, _ = ljm.eStreamRead(self._handle)
        scans = np.array(data, float).reshape(-1, len(self.wiring.inputs))
        scans[(scans == ljm.constants.DUMMY_VALUE).any(axis=1)] = np.nan
        return scans

    def stop(self) -> None:
        """See `Daq`."""
        if self._handle is not None:
            try:
                ljm.eStreamStop(self._handle)
            finally:
                ljm.close(self._handle)
