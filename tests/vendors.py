"""Vendors' libraries as a driver calls them, with a signal behind them: what each call takes and gives is theirs.

`python tests/vendors.py FOLDER` compares every signature with the real packages, unpacked in a folder.
"""

import ast
import ctypes
import enum
import inspect
import sys
import time
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest


class Signal:
    """A sine of 20 Hz in volts, 0.1 V per m/s^2, on all inputs; it grows with the clock, from `begin` on."""

    def __init__(self) -> None:
        self.rate = 1000.0
        self.began = 0.0
        self.given = 0
        self.calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        self.broken = ""

    def begin(self, rate: float) -> float:
        self.rate, self.began, self.given = rate, time.monotonic(), 0
        return rate

    def come(self) -> int:
        return round((time.monotonic() - self.began) * self.rate)

    def volts(self, first: int, last: int, channels: int) -> np.ndarray:
        wt = 2 * np.pi * 20 * np.arange(first, last) / self.rate
        return np.column_stack([0.5 * np.sin(wt), 0.6 * np.sin(wt - 0.4), 0.3 * np.sin(wt)])[:, :channels]

    def log(self, name: str, *args: Any, **kwargs: Any) -> None:
        self.calls.append((name, args, kwargs))


def nidaqmx(signal: Signal) -> dict[str, types.ModuleType]:
    """nidaqmx with its Task: read() gives lists by channel, and raises DaqReadError once the buffer was overwritten."""
    module, constants, errors = (types.ModuleType(f"nidaqmx{end}") for end in ("", ".constants", ".errors"))

    class Error(Exception):
        pass

    class DaqError(Error):
        def __init__(self, message: str, error_code: int, task_name: str = "") -> None:
            super().__init__(message)
            self.error_code = error_code

    names = {
        "AcquisitionType": "FINITE CONTINUOUS", "AccelUnits": "G METERS_PER_SECOND_SQUARED",
        "AccelSensitivityUnits": "MILLIVOLTS_PER_G VOLTS_PER_METERS_PER_SECOND_SQUARED",
        "ExcitationSource": "INTERNAL EXTERNAL", "TerminalConfiguration": "DEFAULT RSE", "Edge": "RISING FALLING",
        "VoltageUnits": "VOLTS",
    }  # fmt: skip
    for name, members in names.items():
        setattr(constants, name, enum.Enum(name, members))
    constants.READ_ALL_AVAILABLE = -1  # type: ignore[attr-defined]
    c: Any = constants

    class AIChannelCollection:
        def __init__(self) -> None:
            self.names: list[str] = []

        def add_ai_accel_chan(
            self, physical_channel, name_to_assign_to_channel="", terminal_config=c.TerminalConfiguration.DEFAULT,
            min_val=-5.0, max_val=5.0, units=c.AccelUnits.G, sensitivity=1000.0,
            sensitivity_units=c.AccelSensitivityUnits.MILLIVOLTS_PER_G,
            current_excit_source=c.ExcitationSource.INTERNAL, current_excit_val=0.004, custom_scale_name="",
        ):  # fmt: skip
            signal.log("accel", physical_channel, current=current_excit_val, sensitivity=sensitivity, max=max_val)
            self.names.append(physical_channel)

        def add_ai_voltage_chan(
            self, physical_channel, name_to_assign_to_channel="", terminal_config=c.TerminalConfiguration.DEFAULT,
            min_val=-5.0, max_val=5.0, units=c.VoltageUnits.VOLTS, custom_scale_name="",
        ):  # fmt: skip
            signal.log("voltage", physical_channel, min=min_val, max=max_val)
            self.names.append(physical_channel)

    class Timing:
        samp_clk_rate = 0.0

        def cfg_samp_clk_timing(
            self, rate, source="", active_edge=c.Edge.RISING, sample_mode=c.AcquisitionType.FINITE, samps_per_chan=1000
        ):
            signal.log("timing", rate, sample_mode=sample_mode.name, samps_per_chan=samps_per_chan)
            self.samp_clk_rate = rate

    class Task:
        def __init__(self, new_task_name="", *, grpc_options=None):
            if signal.broken == "open":
                raise DaqError("Device identifier is invalid.\n\nStatus Code: -200220", -200220)
            self.ai_channels, self.timing = AIChannelCollection(), Timing()

        def start(self):
            signal.begin(self.timing.samp_clk_rate)

        def read(self, number_of_samples_per_channel=1, timeout=10.0):
            if signal.broken == "overrun":
                raise DaqError("The application is not able to keep up.\nStatus Code: -200279", -200279)
            assert number_of_samples_per_channel == constants.READ_ALL_AVAILABLE
            last = signal.come()
            rows = signal.volts(signal.given, last, len(self.ai_channels.names)).T.tolist()
            signal.given = last
            return rows

        def close(self):
            signal.log("close")

    module.Task, module.constants, module.errors = Task, constants, errors  # type: ignore[attr-defined]
    errors.Error, errors.DaqError = Error, DaqError  # type: ignore[attr-defined]
    return {"nidaqmx": module, "nidaqmx.constants": constants, "nidaqmx.errors": errors}


def uldaq(signal: Signal) -> dict[str, types.ModuleType]:
    """uldaq: a scan in the background writes into a circular buffer of doubles, channel by channel."""
    module: Any = types.ModuleType("uldaq")
    module.InterfaceType = enum.IntEnum("InterfaceType", {"USB": 1, "ANY": 7})
    module.AiInputMode = enum.IntEnum("AiInputMode", "DIFFERENTIAL SINGLE_ENDED")
    module.Range = enum.IntEnum("Range", {"BIP10VOLTS": 5, "BIP5VOLTS": 6})
    module.ScanOption = enum.IntEnum("ScanOption", {"DEFAULTIO": 0, "CONTINUOUS": 8})
    module.AInScanFlag = enum.IntEnum("AInScanFlag", {"DEFAULT": 0})
    module.ScanStatus = enum.IntEnum("ScanStatus", {"IDLE": 0, "RUNNING": 1})
    module.IepeMode = enum.IntEnum("IepeMode", {"DISABLED": 1, "ENABLED": 2})

    class ULException(Exception):
        def __init__(self, error_code: int) -> None:
            super().__init__(f"{error_code}: Device not found")

    class TransferStatus:
        current_scan_count = 0

    class AiInfo:
        def get_ranges(self, input_mode):
            return list(module.Range)

    class AiConfig:
        def set_chan_iepe_mode(self, channel, mode):
            signal.log("iepe", channel, mode.name)

    class AiDevice:
        def get_info(self):
            return AiInfo()

        def get_config(self):
            return AiConfig()

        def a_in_scan(
            self, low_channel, high_channel, input_mode, analog_range, samples_per_channel, rate, options, flags, data
        ):
            assert options == module.ScanOption.CONTINUOUS and flags == module.AInScanFlag.DEFAULT
            assert len(data) == samples_per_channel * (high_channel - low_channel + 1)
            signal.log("scan", low_channel, high_channel, analog_range.name)
            self.data, self.channels, self.done = data, high_channel - low_channel + 1, 0
            return signal.begin(rate)

        def get_scan_status(self):
            if signal.broken == "overrun":
                raise ULException(24)
            last, size = signal.come(), len(self.data) // self.channels
            for i, scan in zip(range(self.done, last), signal.volts(self.done, last, self.channels), strict=True):
                at = i % size * self.channels
                self.data[at : at + self.channels] = scan.tolist()
            self.done = last
            status = TransferStatus()
            status.current_scan_count = last
            return module.ScanStatus.RUNNING, status

        def scan_stop(self):
            signal.log("scan_stop")

    class DaqDevice:
        def __init__(self, daq_device_descriptor):
            self.descriptor = daq_device_descriptor

        def connect(self, connection_code=0):
            if signal.broken == "open":
                raise ULException(15)

        def get_ai_device(self):
            return AiDevice()

        def disconnect(self):
            signal.log("disconnect")

        def release(self):
            signal.log("close")

    there = [types.SimpleNamespace(product_name="USB-1808", unique_id="01D8")]
    module.get_daq_device_inventory = lambda interface_type, number_of_devices=100: there
    module.create_float_buffer = lambda number_of_channels, samples_per_channel: (
        ctypes.c_double * (number_of_channels * samples_per_channel)
    )()
    for kind in (ULException, TransferStatus, AiInfo, AiConfig, AiDevice, DaqDevice):
        setattr(module, kind.__name__, kind)
    return {"uldaq": module}


def labjack(signal: Signal) -> dict[str, types.ModuleType]:
    """labjack.ljm: eStreamRead waits for scansPerRead scans, all channels interleaved."""
    package, ljm = types.ModuleType("labjack"), types.ModuleType("labjack.ljm")
    m: Any = ljm

    class LJMError(Exception):
        def __init__(self, errorCode=None, errorAddress=None, errorString=None):
            super().__init__(errorString)

    def openS(deviceType="ANY", connectionType="ANY", identifier="ANY"):
        if signal.broken == "open":
            raise LJMError(errorCode=1227, errorString="LJME_DEVICE_NOT_FOUND")
        return 1

    def eStreamStart(handle, scansPerRead, numAddresses, aScanList, scanRate):
        signal.log("stream", scansPerRead, aScanList)
        m.size, m.channels = scansPerRead, numAddresses
        return signal.begin(scanRate)

    def eStreamRead(handle):
        if signal.broken == "overrun":
            raise LJMError(errorCode=1301, errorString="LJME_STREAM_BUFFER_FULL")
        first, signal.given = signal.given, signal.given + m.size
        time.sleep(max(0.0, signal.began + signal.given / signal.rate - time.monotonic()))
        scans = signal.volts(first, signal.given, m.channels)
        if signal.broken == "skip":
            scans[3:7], signal.broken = m.constants.DUMMY_VALUE, ""
        return scans.ravel().tolist(), 0, 0

    def namesToAddresses(numFrames, aNames, aAddresses=None, aDataTypes=None):
        return [2 * int(name[3:]) for name in aNames], [3] * numFrames

    def eWriteName(handle, name, value):
        signal.log("write", name, value)

    def eStreamStop(handle):
        signal.log("stop")

    def close(handle):
        signal.log("close")

    m.constants = types.SimpleNamespace(DUMMY_VALUE=-9999)
    for each in (LJMError, openS, eStreamStart, eStreamRead, namesToAddresses, eWriteName, eStreamStop, close):
        setattr(m, each.__name__, each)
    package.ljm = ljm  # type: ignore[attr-defined]
    return {"labjack": package, "labjack.ljm": ljm}


FAKES = {"ni": nidaqmx, "mcc": uldaq, "labjack": labjack}


def install(monkeypatch: pytest.MonkeyPatch, name: str) -> Signal:
    """A fake library in place of the vendor's, until the test ends."""
    signal = Signal()
    for module, fake in FAKES[name](signal).items():
        monkeypatch.setitem(sys.modules, module, fake)
    monkeypatch.delitem(sys.modules, f"fasbody.acquire.daq.{name}", raising=False)
    return signal


def differences(folder: Path) -> list[str]:
    """Methods and functions of the fakes whose arguments are not those of the real packages' source."""
    real: dict[str, set[tuple[str, ...]]] = {}
    for file in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.FunctionDef):
                a = node.args
                real.setdefault(node.name, set()).add(tuple(arg.arg for arg in (*a.args, *a.kwonlyargs)))
    out = []
    for fake in FAKES.values():
        for node in ast.walk(ast.parse(inspect.getsource(fake))):
            if isinstance(node, ast.FunctionDef) and node.name not in (fake.__name__, "__init__"):
                mine = tuple(arg.arg for arg in (*node.args.args, *node.args.kwonlyargs))
                if mine not in real.get(node.name, ()):
                    out.append(f"{fake.__name__}.{node.name}{mine}: {real.get(node.name)}")
    return out


if __name__ == "__main__":
    found = differences(Path(sys.argv[1]))
    print("\n".join(found) or "all as in the packages")
    sys.exit(bool(found))
