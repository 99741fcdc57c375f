"""TDMS of National Instruments by npTDMS: every numeric channel, its unit, increment and start."""

from dataclasses import replace
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.recording.channels import Channels
from fasbody.recording.formats.series import FormatError, Series, check_size, number_of, remarks, step_of
from fasbody.recording.statements import statements_of, texts_of

LIBRARY = "nptdms"


def decode(file: Path) -> list[Series]:
    """Numeric channels, named as in the file."""
    from nptdms import TdmsFile

    with file.open("rb") as start:
        if start.read(4) != b"TDSm":
            raise FormatError("is not a TDMS file: it does not begin with TDSm")
    series, total = [], 0
    stamps, offsets = list[Any](), list[float | None]()
    with TdmsFile.open(str(file)) as source:
        channels = [c for group in source.groups() for c in group.channels()]
        remarked = [remark for one in (source, *source.groups()) for remark in remarks(dict(one.properties))]
        check_size(0, len(channels))
        for channel in channels:
            total += len(channel)
            check_size(total)
            if len(channel) < 2:
                continue
            values = np.asarray(channel[:])
            if values.dtype.kind not in "fiu":
                continue
            unit = channel.properties.get("unit_string", "")
            step = number_of(channel.properties.get("wf_increment"))
            rate = 1 / step if step and step > 0 else None
            stamps.append(channel.properties.get("wf_start_time"))
            offsets.append(number_of(channel.properties.get("wf_start_offset")))
            about = {key: v for key, v in channel.properties.items() if key[:3].lower() not in ("wf_", "ni_")}
            one = Series(channel.name, str(unit), values.astype(float), rate, group=channel.group_name)
            series.append(replace(one, stated=statements_of(about), about=texts_of(about)))
    starts = _starts(stamps, offsets)
    return [replace(s, start_s=start) for s, start in zip(series, starts, strict=True)] + remarked


def _starts(stamps: list[Any], offsets: list[float | None]) -> list[float | None]:
    """Start of each channel [s] after the first: its `wf_start_time` and the `wf_start_offset` after that."""
    kinds = np.datetime64 | datetime
    dated: list[Any] = [np.datetime64(stamp) if isinstance(stamp, kinds) else None for stamp in stamps]
    first = min((stamp for stamp in dated if stamp is not None), default=None)
    if first is None:  # no date at all: offsets alone, 0 where there is none
        return [None if offsets.count(None) == len(offsets) else offset or 0.0 for offset in offsets]
    return [
        None if stamp is None else float((stamp - first) / np.timedelta64(1, "ns")) * 1e-9 + (offset or 0.0)
        for stamp, offset in zip(dated, offsets, strict=True)
    ]


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
