"""TDMS of National Instruments by npTDMS: every numeric channel, its `unit_string` and `wf_increment`."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.recording.channels import Channels
from fasbody.recording.formats.series import FormatError, Series, check_size, step_of

LIBRARY = "nptdms"


def decode(file: Path) -> list[Series]:
    """Numeric channels, named as in the file; with their group in front where two groups have the same name."""
    from nptdms import TdmsFile

    with file.open("rb") as start:
        if start.read(4) != b"TDSm":
            raise FormatError("is not a TDMS file: it does not begin with TDSm")
    found, total = [], 0
    with TdmsFile.open(str(file)) as source:
        channels = [c for group in source.groups() for c in group.channels()]
        check_size(0, len(channels))
        names = [c.name for c in channels]
        for channel in channels:
            total += len(channel)
            check_size(total)
            if len(channel) < 2:
                continue
            values = np.asarray(channel[:])
            if values.dtype.kind not in "fiu":
                continue
            name = channel.name if names.count(channel.name) == 1 else f"{channel.group_name}/{channel.name}"
            unit = channel.properties.get("unit_string", "")
            rate = _rate(channel.properties.get("wf_increment"))
            found.append(Series(name, str(unit), values.astype(float), rate))
    return found


def _rate(increment: Any) -> float | None:
    if isinstance(increment, int | float) and np.isfinite(increment) and increment > 0:
        return 1.0 / float(increment)
    return None


def encode(channels: Channels) -> bytes:
    """One group with one waveform channel an accelerometer."""
    from nptdms import ChannelObject, RootObject, TdmsWriter

    step = step_of(channels["time_s"])
    file = BytesIO()
    objects = [
        ChannelObject("foot", name, values, properties={"wf_increment": step, "unit_string": "m/s^2"})
        for name, values in channels.items()
        if name != "time_s"
    ]
    with TdmsWriter(file) as writer:
        writer.write_segment([RootObject(), *objects])
    return file.getvalue()
