"""A recording's channels from a file and into one, whatever its format: CSV here, instruments' files in formats/."""

import importlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fasbody.console import write_whole
from fasbody.exceptions import InputFileError
from fasbody.recording.channels import NAMES, TIME_UNITS, Channel, Channels, Layout, name_and_unit
from fasbody.recording.clock import straightened
from fasbody.recording.columns import Columns, Use, assign
from fasbody.recording.csv import TextTable, read_table, read_text
from fasbody.recording.formats import ENDINGS, READ, ending
from fasbody.recording.formats.reader import read_series
from fasbody.recording.formats.series import FormatError, Series, need

#: Endings of tables that no reader here opens.
_SHEETS = (".xls", ".xlsb", ".ods", ".numbers")
#: Endings of text files, which are read as CSV.
TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")


@dataclass(frozen=True, eq=False)
class Reading:
    """What a file gave.

    Attributes:
        channels: ``time_s``, ``base_m_s2``, ``malleolus_m_s2`` and perhaps more, each (n,), delays undone.
        used: on each channel its column, unit and clock, in words. unused: what else the file holds.
        warnings: what was decided that could have been otherwise, in sentences without the file's name.
    """

    channels: Channels
    used: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def read(file: Path, layout: Layout | None = None) -> Channels:
    """The channels of a recording in any format, as `reading` gives them."""
    return reading(file, layout).channels


def reading(file: Path, layout: Layout | None = None) -> Reading:
    """A recording in any format, by the file's ending, with what became of each of its columns.

    Args:
        file: the file. layout: what study.toml says of its channels.

    Raises:
        InputFileError: what is wrong with the file, in one sentence.
    """
    layout = (layout or Layout()).of(file)
    source: TextTable | _SeriesTable
    if ending(file) in TEXTS:
        layout = beside(file, layout)
        source = TextTable.open(file, layout)
    else:
        source = _SeriesTable.open(file)
    columns = source.columns
    found = assign(file, columns, layout)
    numbers = _numbers(source, found.uses, layout)
    uses = {key: use for key, use in found.uses.items() if key in numbers}
    channels = {key: numbers[key] * use.factor for key, use in uses.items()}
    rate = source.rate_hz(uses, layout)
    if {"time", "time_s"} & channels.keys():
        channels = layout.timed(file, channels, rate)
    clocks = _clocks(source, uses, channels, layout, rate)
    uses = {key: use if key in clocks else replace(use, clock=None) for key, use in uses.items()}
    if "base_m_s2" in clocks:
        shared = channels.pop("time_s", None)
        clocks |= {} if shared is None else {key: shared for key in channels if key not in clocks}
        channels = {"time_s": clocks.pop("base_m_s2")} | channels
    channels = layout.timed(file, channels, rate)
    others = _other_clocks(source, uses, channels["time_s"])
    clocks |= source.starts(uses, channels["time_s"])
    if clocks:
        channels["time_s"] = straightened(channels["time_s"])
    channels = layout.aligned(file, channels, clocks)
    if channels["time_s"].size < 2:
        raise InputFileError(file, f"holds {channels['time_s'].size} samples", "a recording needs at least two")
    return Reading(channels, *_ledger(source, uses), (*found.remarks, *others))


def _numbers(source: "TextTable | _SeriesTable", uses: Mapping[str, Use], layout: Layout) -> Channels:
    """The columns in use; without the further sensors where one of those is no column of numbers."""
    every = {key: use.index for key, use in uses.items()}
    needed = ("time", "time_s", *(f"{name}_m_s2" for name in (*NAMES, *layout.channels)))
    try:
        return source.numbers(every)
    except InputFileError:
        own = {key: index for key, index in every.items() if key in needed}
        if own == every:
            raise
        return source.numbers(own)


def _clocks(
    source: "TextTable | _SeriesTable", uses: Mapping[str, Use], channels: Channels, layout: Layout,
    rate_hz: float | None,
) -> Channels:  # fmt: skip
    """Times [s] of the channels that have a column of times for themselves; one that does not rise is no clock.

    Raises:
        InputFileError: its unit is not known; or study.toml calls it a clock, and it does not rise.
    """
    apart = {key: use.clock for key, use in uses.items() if use.clock is not None}
    found: Channels = {}
    for key, index in apart.items():
        times = _rising(source, index, channels[key].size)
        if times is None and layout.channels.get(key.removesuffix("_m_s2"), Channel()).clock:
            what = f"{source.columns.names[index]!r} is no clock of {key}: its numbers do not rise from row to row"
            raise InputFileError(source.file, what, "correct clock in study.toml")
        if times is None:
            continue
        unit = TIME_UNITS.get(source.columns.claimed(index).lower())
        if unit is None:
            unit = uses["time_s"].factor if "time_s" in uses else _unit_by_rate(times, rate_hz or layout.rate_hz)
        if unit is None:
            raise InputFileError(
                source.file, f"{source.columns.names[index]!r}, the times of {key}, have no unit",
                "write it behind the name (time_s, time [ms]), or give study.toml a sampling_rate_hz",
            )  # fmt: skip
        found[key] = unit * times
    return found


def _rising(source: "TextTable | _SeriesTable", index: int, size: int) -> np.ndarray | None:
    """A column of as many numbers (n,) that rise from row to row, once they are not rounded any more; else None."""
    try:
        times = straightened(source.numbers({"time": index})["time"])
    except InputFileError:  # words
        return None
    return times if times.size == size > 2 and np.diff(times).min() > 0 else None


def _unit_by_rate(times: np.ndarray, rate_hz: float | None) -> float | None:
    """The unit of times (n,), in seconds, with which they run at a known rate."""
    counted = (times.size - 1) / float(times[-1] - times[0])
    return next((unit for unit in TIME_UNITS.values() if rate_hz and abs(counted / unit / rate_hz - 1) < 1e-2), None)


def _other_clocks(source: "TextTable | _SeriesTable", uses: Mapping[str, Use], time_s: np.ndarray) -> list[str]:
    """Columns of times that are in no use, stand with no other column, and tell another time than those that are."""
    columns, told = source.columns, []
    taken = {use.index for use in uses.values()} | {use.clock for use in uses.values()}
    for index in columns.times:
        next_one = index + 1
        of_another = next_one < len(columns.names) and not columns.groups and next_one not in {*taken, *columns.times}
        groups = {columns.groups[i] for i in taken if i is not None} if columns.groups else {""}
        if index in taken or of_another or (columns.groups and columns.groups[index] not in groups):
            continue
        times = _rising(source, index, time_s.size)
        if times is None:
            continue
        scale = (time_s[-1] - time_s[0]) / (times[-1] - times[0])
        off = scale * (times - times[0]) - (time_s - time_s[0])
        late = times[0] - time_s[0]
        shifted = abs(scale - 1) < 1e-3 and 1e-9 < abs(late) < time_s[-1] - time_s[0]
        if shifted or np.abs(off).max() > 0.5 * (time_s[1] - time_s[0]):
            told.append(
                f"{columns.names[index]!r} is another time, and nothing says of which channel; study.toml can "
                f"([channels.malleolus] clock = {columns.names[index]!r})"
            )
    return told


def _ledger(source: "TextTable | _SeriesTable", uses: Mapping[str, Use]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What each channel was made of, and which columns were not used, in words."""
    names = [name or f"column {index + 1}" for index, name in enumerate(source.columns.names)]
    taken = {use.index for use in uses.values()} | {use.clock for use in uses.values()}
    used = tuple(
        f"{key.removesuffix('_m_s2').removesuffix('_s')}: {names[use.index]!r}"
        + (f" in {use.unit}" if use.unit else "")
        + (f", its times {names[use.clock]!r}" if use.clock is not None else "")
        for key, use in uses.items()
    )
    unused = tuple(name for index, name in enumerate(names) if index not in taken)
    return used, (*unused, *source.columns.passed, *source.skipped)


@dataclass(frozen=True, eq=False)
class _SeriesTable:
    """The series of an instrument's file as columns."""

    file: Path
    series: tuple[Series, ...]
    passed: tuple[str, ...]
    skipped: tuple[str, ...] = ()

    @classmethod
    def open(cls, file: Path) -> "_SeriesTable":
        if ending(file) not in READ:
            listed = f"valid: {', '.join((*TEXTS, *READ))}, and .gz behind any"
            if ending(file) in _SHEETS:
                listed = "save the sheet as .xlsx or as .csv, with time_s, base_m_s2, malleolus_m_s2 above its columns"
            raise InputFileError(file, f"no format has the ending {ending(file)!r}", listed)
        found = read_series(file)
        passed = tuple(f"{s.name!r} is {s.what}" for s in found if s.what)
        return cls(file, tuple(s for s in found if not s.what), passed)

    @property
    def columns(self) -> Columns:
        names, groups = [s.name for s in self.series], [s.group for s in self.series]
        units = [s.unit.partition(" since ")[0] for s in self.series]  # a date is of no interest
        clocked = any(s.rate_hz for s in self.series)
        sizes = [s.values.size for s in self.series]
        return Columns(names, units, groups, sizes, self.passed, clocked=clocked)

    def numbers(self, wanted: Mapping[str, int]) -> Channels:
        return {key: self.series[index].values for key, index in wanted.items()}

    def rate_hz(self, uses: Mapping[str, Use], layout: Layout) -> float | None:
        """The rate [Hz] that the file states for the channels in use, else for any.

        Raises:
            InputFileError: two of them, or a scale that may be applied twice or not at all.
        """
        sources = self._sources(uses)
        for key, source in sources.items():
            _one_scale(self.file, key.removesuffix("_m_s2"), source, layout)
        rates = {s.rate_hz for s in sources.values() if s.rate_hz}
        if len(rates) > 1:
            listed = ", ".join(f"{rate:g}" for rate in sorted(rates))
            raise InputFileError(
                self.file, f"its channels have different rates ({listed} Hz)", "resample them to one rate"
            )
        return next(iter(rates), None) or next((s.rate_hz for s in self.series if s.rate_hz), None)

    def starts(self, uses: Mapping[str, Use], time_s: np.ndarray) -> Channels:
        """Times (n,) [s] of channels that the file says to start later than another."""
        sources = self._sources(uses)
        known = _starts(self.file, sources, bool({"time", "time_s"} & uses.keys()))
        first = min(known.values(), default=0.0)
        return {key: time_s + start - first for key, start in known.items()} if np.ptp([*known.values(), first]) else {}

    def _sources(self, uses: Mapping[str, Use]) -> dict[str, Series]:
        return {key: self.series[use.index] for key, use in uses.items() if not key.startswith("time")}


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
    names = columns_of(file, layout).names if ending(file) in (*TEXTS, *READ) else ()
    return next((name for name in names if name_and_unit(name)[0] == channel), channel)


def columns_of(file: Path, layout: Layout | None = None) -> Columns:
    """The columns of a recording, whatever they are; none of a text without a header that study.toml does not name.

    Args:
        file: the file. layout: what study.toml says of its channels.

    Raises:
        InputFileError: it cannot be read.
    """
    if ending(file) in TEXTS:
        return TextTable.open(file, beside(file, layout or Layout()), strict=False).columns
    return _SeriesTable.open(file).columns


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
