"""Devices of National Instruments (NI-DAQmx), such as the USB-4431 and the NI 9234: `--board ni`.

The calls are those of the nidaqmx documentation (nidaqmx-python.readthedocs.io): Task, add_ai_accel_chan or
add_ai_voltage_chan, cfg_samp_clk_timing, read.
"""

import time

import numpy as np

from fasbody.acquire.daq import Daq
from fasbody.acquire.port import WAIT_S
from fasbody.exceptions import AcquisitionError, MissingPackageError

try:
    import nidaqmx
    import nidaqmx.constants
    import nidaqmx.errors
except ImportError:  # the extra is not installed
    raise MissingPackageError("nidaqmx", "ni") from None

#: The driver keeps so much for a late computer [s].
_BUFFER_S = 10.0
#: Current of an IEPE supply [A]: the library's default, and what USB-443x and NI 923x have.
_IEPE_A = 0.004
#: With AccelUnits.METERS_PER_SECOND_SQUARED and 1 V per m/s^2, a reading is in volts whatever the sensor.
_VOLT_PER_M_S2 = 1.0


class NI(Daq):
    """A device of National Instruments; `device` is its name in NI MAX, such as Dev1, `inputs` such as ai0 and ai1."""

    errors = (nidaqmx.errors.Error, OSError)
    _task = None

    def start(self) -> float:
        """One task with all inputs on one sample clock, running."""
        wiring, constants = self.wiring, nidaqmx.constants
        if not wiring.device:
            raise AcquisitionError('NI: which device? Give its name, such as "device": "Dev1".')
        self._task = task = nidaqmx.Task()
        for name in wiring.inputs:
            channel, limits = f"{wiring.device}/{name}", {"min_val": -wiring.range_v, "max_val": wiring.range_v}
            if wiring.iepe:
                task.ai_channels.add_ai_accel_chan(
                    channel, **limits, units=constants.AccelUnits.METERS_PER_SECOND_SQUARED,
                    sensitivity=_VOLT_PER_M_S2,
                    sensitivity_units=constants.AccelSensitivityUnits.VOLTS_PER_METERS_PER_SECOND_SQUARED,
                    current_excit_source=constants.ExcitationSource.INTERNAL, current_excit_val=_IEPE_A,
                )  # fmt: skip
            else:
                task.ai_channels.add_ai_voltage_chan(channel, **limits)
        task.timing.cfg_samp_clk_timing(
            wiring.rate_hz, sample_mode=constants.AcquisitionType.CONTINUOUS,
            samps_per_chan=round(_BUFFER_S * wiring.rate_hz),
        )  # fmt: skip
        task.start()
        return float(task.timing.samp_clk_rate)

    def take(self) -> np.ndarray:
        """All that the driver has; one that overran raises, and is opened anew."""
        time.sleep(WAIT_S)
        assert self._task is not None
        rows = self._task.read(number_of_samples_per_channel=nidaqmx.constants.READ_ALL_AVAILABLE)
        return np.array(rows, float).reshape(len(self.wiring.inputs), -1).T

    def stop(self) -> None:
        """See `Daq`."""
        if self._task is not None:
            self._task.close()
