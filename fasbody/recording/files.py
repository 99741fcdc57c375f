"""A recording's channels from a file and into one, whatever its format: CSV here, instruments' files in formats/."""

import importlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from fasbody.console import write_whole
from fasbody.exceptions import InputFileError
from fasbody.recording.channels import Channel, Channels, Layout, name_and_unit
from fasbody.recording.csv import headings, read_csv, read_table, read_text
from fasbody.recording.formats import ENDINGS, READ, ending
from fasbody.recording.formats.reader import read_series
from fasbody.recording.formats.series import FormatError, Series, need

#: Endings of tables that no reader here opens.
_SHEETS = (".xls", ".xlsb", ".ods", ".numbers")
#: Endings of text files, which are read as CSV.
TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")


def read(file: Path, layout: Layout | None = None) -> Channels:
    """The channels of a recording in any format, by the file's ending.

    Args:
        file: the file. layout: what study.toml says of its channels.

    Returns:
        ``time_s``, ``base_m_s2``, ``malleolus_m_s2`` and perhaps ``tuberosity_m_s2``, each (n,), delays undone.

    Raises:
        InputFileError: what is wrong with the file, in one sentence.
    """
    layout = (layout or Layout()).of(file)
    end = ending(file)
    if end in TEXTS:
        layout = beside(file, layout)
        return _long_enough(file, layout.aligned(file, read_csv(file, layout)))
    if end not in READ:
        listed = f"valid: {', '.join((*TEXTS, *READ))}, and .gz behind any"
        if end in _SHEETS:
            listed = "save the sheet as .xlsx or as .csv, with time_s, base_m_s2, malleolus_m_s2 above its columns"
        raise InputFileError(file, f"no format has the ending {end!r}", listed)
    found = read_series(file)
    series = [s for s in found if not s.what]
    passed = [f"{s.name!r} is {s.what}" for s in found if s.what]
    stated = {s.rate_hz for s in series} - {None}
    wanted = layout.find(
        file, [s.name for s in series], [s.unit for s in series], None, passed, [s.values.size for s in series],
        clocked=bool(stated),
    )  # fmt: skip
    channels = {name: series[index].values * factor for name, (index, factor) in wanted.items()}
    sources = {name: series[index] for name, (index, _) in wanted.items() if not name.startswith("time")}
    for name, source in sources.items():
        _one_scale(file, name.removesuffix("_m_s2"), source, layout)
    rates = {s.rate_hz for s in sources.values() if s.rate_hz}
    rates = rates or {rate for rate in (next((s.rate_hz for s in series if s.rate_hz), None),) if rate}
    if len(rates) > 1:
        listed = ", ".join(f"{rate:g}" for rate in sorted(rates))
        raise InputFileError(file, f"its channels have different rates ({listed} Hz)", "resample them to one rate")
    own = bool({"time", "time_s"} & channels.keys())
    channels = layout.timed(file, channels, next(iter(rates), None))
    return _long_enough(file, layout.aligned(file, channels, _starts(file, sources, own)))


def read_one(file: Path, channel: str, layout: Layout | None = None, named: str = "") -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and one channel [m/s^2], (n,) each, of a file that holds no other.

    Args:
        file: the file. channel: "base" or "malleolus". layout: what study.toml says. named: the column, if it is named
            otherwise.

    Raises:
        InputFileError: as `read`.
    """
    layout = (layout or Layout()).of(file)
    told = layout.channels.get(channel, Channel())
    column = named or told.column or _named_like(file, channel, layout)
    both = {name: replace(told, column=column) for name in ("base", "malleolus")}
    time = {"time": layout.channels["time"]} if "time" in layout.channels else {}
    found = read(file, replace(layout, channels=both | time))
    return found["time_s"], found[f"{channel}_m_s2"]


def _named_like(file: Path, channel: str, layout: Layout) -> str:
    """The heading of the column that a channel's own name begins."""
    if ending(file) in TEXTS:
        names = headings(file, beside(file, layout))[0]
    else:
        names = [s.name for s in read_series(file) if not s.what] if ending(file) in READ else []
    return next((name for name in names if name_and_unit(name)[0] == channel), channel)


def beside(file: Path, layout: Layout) -> Layout:
    """The layout with what BIDS writes beside a .tsv: rate and columns in its JSON, names and units in _channels.tsv.

    Raises:
        InputFileError: that file is broken, or its rate is not that of study.toml.
    """
    if ending(file) != ".tsv":
        return layout
    stem = file.name.removesuffix(".gz").removesuffix(".tsv")
    sidecar, table = file.with_name(f"{stem}.json"), file.with_name(f"{stem.rpartition('_')[0]}_channels.tsv")
    if not sidecar.is_file():
        return layout
    try:
        told = json.loads(read_text(sidecar))
        rate, columns = told.get("SamplingFrequency"), told.get("Columns", [])
        units = [str((told.get(name) or {}).get("Units", "")) for name in columns]
        good = all(isinstance(name, str) for name in columns) and isinstance(rate, int | float | None)
    except (ValueError, AttributeError, TypeError):
        good = False
    if not good or (rate is not None and not 0 < rate < 1e9):
        raise InputFileError(sidecar, "is no sidecar of BIDS", "valid: SamplingFrequency, a number, and Columns, names")
    if rate and layout.rate_hz and abs(rate / layout.rate_hz - 1) > 1e-3:
        raise InputFileError(
            sidecar, f"SamplingFrequency is {rate:g} Hz, and study.toml says sampling_rate_hz = {layout.rate_hz:g}",
            "correct one of them",
        )  # fmt: skip
    if not columns and table.is_file() and table != file:
        listed = read_table(table, ("name", "units"))
        columns, units = ([row[key] or "" for row in listed.values()] for key in ("name", "units"))
    units = ["" if unit.lower() == "n/a" else unit for unit in units]
    if columns and layout.columns:
        return replace(layout, rate_hz=rate or layout.rate_hz)
    return replace(layout, rate_hz=rate or layout.rate_hz, columns=tuple(columns), units=tuple(units))


def _one_scale(file: Path, channel: str, source: Series, layout: Layout) -> None:
    """Refuse a scale of the file that may be applied twice, or not at all."""
    told = layout.channels.get(channel)
    sensitivity = bool(told and told.sensitivity != 1.0)
    if source.scaled and sensitivity and told and not told.volts:
        raise InputFileError(
            file, f"scales {source.name!r} itself ({source.scaled}), and study.toml gives "
            f"channels.{channel}.sensitivity = {told.sensitivity:g}", "keep one of them",
        )  # fmt: skip
    if source.unclear and not sensitivity:
        raise InputFileError(
            file, f"says {source.unclear} with {source.name!r}, and not whether its numbers contain it",
            f"give study.toml channels.{channel}.sensitivity, or delete the attribute (scale_factor is applied)",
        )  # fmt: skip


def _starts(file: Path, sources: Mapping[str, Series], own_time: bool) -> dict[str, float]:
    """When each channel's first sample was taken [s], as the file says; all start together if it says nothing."""
    known = {name: s.start_s for name, s in sources.items() if s.start_s is not None}
    listed = ", ".join(f"{sources[name].name} {start:.6g} s" for name, start in known.items())
    if known and len(known) < len(sources):
        lacking = next(s.name for name, s in sources.items() if name not in known)
        raise InputFileError(
            file, f"says when some channels start ({listed}) and not when {lacking!r} does",
            "valid: a start time for every channel, or for none",
        )  # fmt: skip
    if own_time and known and max(known.values()) - min(known.values()) > 1e-9:
        raise InputFileError(
            file, f"its channels have one time and start at different times ({listed})",
            "valid: one time for all channels, or start times without it",
        )  # fmt: skip
    return known


def _long_enough(file: Path, channels: Channels) -> Channels:
    if channels["time_s"].size < 2:
        raise InputFileError(file, f"holds {channels['time_s'].size} samples", "a recording needs at least two")
    return channels


def write(file: Path, channels: Channels, matlab: str = "5") -> None:
    """Write channels in the format of the file's ending.

    Args:
        file: to write. channels: as `read` gives them. matlab: version of a .mat file, "5" or "7.3".

    Raises:
        InputFileError: no such format, or the folder cannot be written.
    """
    end = file.suffix.lower()
    if end not in ENDINGS:
        raise InputFileError(
            file, f"no format has the ending {end!r} for writing", f"valid: .csv, {', '.join(ENDINGS)}"
        )
    name = "mat73" if end == ".mat" and matlab == "7.3" else ENDINGS[end]
    module = importlib.import_module(f"fasbody.recording.formats.{name}")
    need(module.LIBRARY)
    try:
        content = module.encode(channels)
    except FormatError as error:
        raise InputFileError(file, str(error)) from None
    write_whole(file, content)
