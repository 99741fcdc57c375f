"""A recording's channels from a file and into one, whatever its format: CSV here, instruments' files in formats/."""

import importlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from fasbody.console import write_whole
from fasbody.exceptions import InputFileError, shown
from fasbody.recording.channels import NAMES, TIME_UNITS, Channel, Channels, Layout, name_and_unit
from fasbody.recording.clock import counter_fault, straightened
from fasbody.recording.columns import Columns, Use, assign, has_channels
from fasbody.recording.csv import FIRST, TextTable, read_table, several_takes
from fasbody.recording.formats import ENDINGS, READ, ending, ending_removed
from fasbody.recording.formats.reader import read_series
from fasbody.recording.formats.series import REMARK, FormatError, Series, named_by, need
from fasbody.recording.long import long_series
from fasbody.recording.statements import (
    Statements,
    differing,
    is_amount,
    is_answered,
    is_treated,
    of_lines,
    quoted,
    refuse_unapplied,
    statements_of,
    texts_of,
    thinned,
)
from fasbody.recording.text import number, numeric, read_text
from fasbody.sentences import Sentence, called

#: Endings of tables that no reader here opens.
_SHEETS = (".xls", ".xlsb", ".ods", ".numbers")
#: Endings of text files, which are read as CSV.
TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")




@dataclass(frozen=True, eq=False)
class _SeriesTable:
    """The series of an instrument's file as columns."""

    file: Path
    columns: Columns
    skipped: tuple[str, ...] = ()
    takes: int = 1
    notes: tuple[str, ...] = ()

    @classmethod
    def open(cls, file: Path, layout: Layout) -> "_SeriesTable":
        """The series of a file, those of one take where study.toml names it."""
        if not file.exists():
            raise InputFileError(file, "no such file or folder", "give a study folder or recordings")
        if ending(file) not in READ:
            listed = f"valid: {', '.join((*TEXTS, *READ))}, each also with .gz"
            if ending(file) in _SHEETS:
                listed = "save the sheet as .xlsx or as .csv, with time_s, base_m_s2, malleolus_m_s2 above its columns"
            raise InputFileError(file, f"no format has the ending {ending(file)!r}", listed)
        return cls.of(file, read_series(file), layout)

    @classmethod
    def of(cls, file: Path, series: Sequence[Series], layout: Layout) -> "_SeriesTable":
        """The series of one take where study.toml names it."""
        passed = [f"{s.name!r} is {s.what}" for s in series if s.what not in ("", REMARK)]
        notes = tuple(line for s in series if s.what for line in s.about.get("text", "").splitlines())
        series = [s for s in series if not s.what]
        groups = list(dict.fromkeys(s.group for s in series))
        skipped = (f"the other takes ({len(groups) - 1})",)
        parts = [[replace(s, name=s.name.removeprefix(f"{group}/")) for s in series if s.group == group]
                 for group in groups if len(groups) > 1]  # fmt: skip
        tables = [cls(file, Columns(part, passed), skipped, len(groups), notes) for part in parts]
        takes = [table for table in tables if has_channels(table.columns, layout)]
        if len(takes) > 1 and layout.take is None:
            raise several_takes(file, len(takes), ", ".join(repr(take.columns.series[0].group) for take in takes))
        return layout.one_of(file, takes) if len(takes) > 1 else cls(file, Columns(series, passed), notes=notes)

    @property
    def tabular(self) -> bool:
        """Whether words stand above the numbers, as in a text."""
        return ending(self.file) in (".xlsx", ".xlsm")

    def numbers(self, indices: Mapping[str, int]) -> Channels:
        return {key: self.columns.series[index].values for key, index in indices.items()}

    def sample(self) -> list[np.ndarray]:
        """The first numbers of each column."""
        return [s.values[:FIRST] for s in self.columns.series]

    def words(self, uses: Mapping[str, Use]) -> list[str]:
        """What the file says beside the numbers of the columns in use, line by line."""
        about = (
            pair for use in uses.values() for pair in self.columns.series[use.index].about.items()
        )
        return [*self.notes, *(f"{name}: {text}" for name, text in about)]

    def stated(self, uses: Mapping[str, Use]) -> tuple[dict[str, Statements], list[str]]:
        used = {key.removesuffix("_m_s2"): self.columns.series[use.index] for key, use in uses.items()}
        remarked, vague = of_lines(self.notes, "\t", {name: s.name for name, s in used.items()})
        return {name: s.stated | remarked[name] for name, s in used.items()}, vague


_Source = TextTable | _SeriesTable


@dataclass(frozen=True, eq=False)
class Reading:
    """What a file gave.

    Attributes:
        channels: ``time_s``, ``base_m_s2``, ``malleolus_m_s2`` and perhaps more, (n,) each, delays undone.
        used: on each channel its column, unit and clock, in words.
        unused: what else the file holds.
        warnings: what was decided and could have been otherwise, in sentences without the file's name.
    """

    channels: Channels
    used: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def reading(file: Path, layout: Layout | None = None) -> Reading:
    """A recording in any format, by the file's ending, with what became of each of its columns.

    Args:
        layout: what study.toml says of its channels.
    """
    by_study = (layout or Layout()).of(file)
    layout = beside(file, by_study)
    source = _opened(file, layout)
    columns = source.columns
    uses, decided = assign(file, columns, layout)
    numbers = _numbers(source, uses, layout)
    uses = {key: use for key, use in uses.items() if key in numbers}
    is_timed = bool({"time", "time_s"} & uses.keys())
    sensors = {key: columns.series[use.index] for key, use in uses.items() if not key.startswith("time")}
    stamped = source.tabular and "time_s" in uses
    rate = None if stamped else _rate(file, columns, sensors, is_timed, layout)
    rate, overruled = _overruled(file, rate, sensors, layout)
    line = thinned(source.words(uses), rate) if rate and layout.rate_hz is None and not is_timed else ""
    if line:
        rated = f"states a rate of {rate:.6g} Hz and {shown(line)!r}"
        problem = f"{rated}, and not which of them is of its samples"
        raise InputFileError(file, problem, Sentence("give ", called("sampling_rate_hz")))
    stated, vague = source.stated({key: uses[key] for key in sensors})
    names = {key.removesuffix("_m_s2"): s.name for key, s in sensors.items()}
    about = {name: s.about for name, s in zip(names, sensors.values(), strict=True)}
    for name, about_one in _of_bids(file, names, layout).items():
        about[name], stated[name] = about[name] | texts_of(about_one), stated[name] | statements_of(about_one)
    by_columns, changing = _stated_by_columns(source, uses, names)
    stated = {name: by_columns.get(name, {}) | statements for name, statements in stated.items()}
    vague += changing
    vague += [name for name in names.values() if is_amount(name)]
    vague = [line for line in vague if not is_answered(line, layout, names)]
    refuse_unapplied(file, stated, names, layout, alike=source.tabular)
    if not is_timed:
        _counted(source, uses, rate, layout)
    numbers, places = _without_gaps(source, uses, numbers)
    channels = {key: numbers.pop(key) for key in uses}
    channels |= {key: use.factor * channels[key] for key, use in uses.items() if use.factor != 1}
    if places and not is_timed:
        counts = (places[key][-1] + 1 if key in places else values.size for key, values in channels.items())
        channels["time_s"] = np.arange(max(counts)) / (rate or layout.rate_hz or 1.0)
    if is_timed or places:
        channels = layout.timed(file, channels, rate)
    clocks = _clocks(source, uses, channels, layout, rate)
    uses = {key: use if key in clocks else replace(use, clock=None) for key, use in uses.items()}
    clocks |= {key: channels["time_s"][rows] for key, rows in places.items() if key not in clocks}
    if "base_m_s2" in clocks:
        shared = channels.pop("time_s", None)
        clocks |= {} if shared is None else {key: shared for key in channels if key not in clocks}
        channels = {"time_s": clocks.pop("base_m_s2")} | channels
    channels = layout.timed(file, channels, rate)
    if not clocks and source.takes == 1:
        channels = _one_take(file, channels, layout)
    time_s = channels["time_s"]
    if time_s.size < 2:
        raise InputFileError(file, f"holds {time_s.size} samples", "a recording needs at least two")
    if time_s[-1] < time_s[0]:
        raise _backwards(file, time_s)
    remarks = [*decided, *overruled, *quoted(vague), *differing(about, stated, layout)]
    remarks += _denied(source, time_s) if is_timed else []
    titles = dict.fromkeys((ending_removed(file), *(s.group for s in sensors.values())))
    treated = (title for title in titles if is_treated(title))
    changed = "says that its numbers were changed, and nothing is undone"
    remarks += [
        f"the name {shown(title)!r} {changed}"
        for title in treated if not is_answered(title, layout, names)
    ]  # fmt: skip
    remarks += _other_clocks(source, uses, time_s)
    clocks |= _stated_clocks(file, sensors, time_s, is_timed, rate)
    if clocks:
        channels["time_s"] = straightened(time_s)
    channels, unlike = layout.aligned(file, channels, clocks)
    used, unused = _ledger(source, uses)
    if not is_timed and (rate or layout.rate_hz) and "base_m_s2" not in clocks:
        by = "the file" if rate else "study.toml" if by_study.rate_hz else "its .json"
        used = (f"time: counted at {rate or layout.rate_hz:.6g} Hz, as {by} says", *used)
    return Reading(channels, used, unused, (*remarks, *filter(None, [unlike])))


def _overruled(
    file: Path, rate_hz: float | None, sensors: Mapping[str, Series], layout: Layout
) -> tuple[float | None, list[str]]:  # fmt: skip
    """The rate [Hz] that a file states, None if study.toml states another; and a remark on that."""
    ours = layout.rate_hz
    if not rate_hz or not ours or abs(rate_hz / ours - 1) <= _SAME_RATE:
        return rate_hz, []
    if len({s.rate_hz for s in sensors.values() if s.rate_hz}) > 1:
        problem = f"states rates of its channels, {rate_hz:.6g} Hz among them, and study.toml {ours:.6g} Hz"
        raise InputFileError(file, problem, "delete that of study.toml, or resample them to one rate")
    return None, [f"its rate is {ours:.6g} Hz as study.toml says, though the file says {rate_hz:.6g} Hz"]


#: Two rates are alike within this share: a nominal one, and that of a clock.
_SAME_RATE = 1e-3


def _backwards(file: Path, time_s: np.ndarray) -> InputFileError:
    """A sentence on a time (n,) [s] that ends before it begins."""
    steps = np.diff(time_s)
    falls = np.flatnonzero(steps < 0)
    if falls.size > 1:
        problem = f"its time runs backwards ({time_s[0]:g} s first, {time_s[-1]:g} s last)"
        return InputFileError(file, problem, "sort the rows by time")
    place, back = falls[0], float(np.median(steps) - steps[falls[0]])
    why = "a counter began anew" if abs(back / 2**32 * 1e6 - 1) < 1e-2 else "its clock was set back"
    problem = f"its time falls from {time_s[place]:.7g} to {time_s[place + 1]:.7g} s at sample {place + 2}: {why}"
    return InputFileError(file, problem, f"add {back:.7g} s to the times from there on; do not sort them")


def _opened(file: Path, layout: Layout, strict: bool = True) -> _Source:
    if ending(file) in TEXTS:
        series = [] if layout.columns else long_series(file)
        return _SeriesTable.of(file, series, layout) if series else TextTable.open(file, layout, strict)
    return _SeriesTable.open(file, layout)


def _numbers(source: _Source, uses: Mapping[str, Use], layout: Layout) -> Channels:
    """The columns in use; without the further sensors where one of those is no column of numbers."""
    every = {key: use.index for key, use in uses.items()}
    needed = ("time", "time_s", *(f"{name}_m_s2" for name in (*NAMES, *layout.channels)))
    try:
        return source.numbers(every)
    except InputFileError:
        required = {key: index for key, index in every.items() if key in needed}
        if required == every:
            raise
        return source.numbers(required)


def _without_gaps(
    source: _Source, uses: Mapping[str, Use], numbers: Channels
) -> tuple[Channels, dict[str, np.ndarray]]:
    """Columns without their empty cells, and the rows that a slower channel has of those that share one time."""
    time = next((numbers[key] for key in ("time_s", "time") if key in numbers), None)
    ends = {key: _end(values) for key, values in numbers.items()}
    shared = [ends[key] for key, use in uses.items() if use.clock is None]
    size = max(shared, default=0) if time is None else _end(time)
    made, places = dict[str, np.ndarray](), dict[str, np.ndarray]()
    for key, values in numbers.items():
        end = ends[key]
        made[key] = values if end == values.size else values[:end]
        good = np.isfinite(made[key])
        rows = np.flatnonzero(good)
        if good.all() and (end == size or uses[key].clock is not None or not isinstance(source, TextTable)):
            continue
        gaps = np.diff(rows)  # even ones of two or more are those of a slower channel
        is_slower = rows.size > 8 and gaps.min() >= 2 and np.ptp(gaps) <= 1 and size - end <= gaps[0]
        if uses[key].clock is None and is_slower:
            made[key], places[key] = values[rows], rows
        elif isinstance(source, TextTable):
            raise source.refuse_gap(key, uses[key].index)
    return made, places


def _end(values: np.ndarray) -> int:
    """How many values (n,) there are without the empty ones at the end."""
    return int(np.flatnonzero(~np.isnan(values)).max(initial=-1)) + 1


#: Samples of a take at least, and the share of its length within which its time begins as the first.
_TAKE, _ANEW = 50, 0.1


def _one_take(file: Path, channels: Channels, layout: Layout) -> Channels:
    """The channels of one take, where the time begins anew."""
    t = channels["time_s"]
    back = np.flatnonzero(np.diff(t) < 0) + 1
    edges = [0, *back.tolist(), t.size]
    anew = back.size and all(abs(t[i] - t[0]) < _ANEW * np.ptp(t) for i in back) and np.diff(edges).min() >= _TAKE
    takes = [slice(*pair) for pair in pairwise(edges)] if anew else [slice(None)]
    if len(takes) > 1 and layout.take is None:
        listed = ", ".join(map(str, edges[1:-1]))
        raise several_takes(file, len(takes), f"its time begins anew at sample {listed}")
    one = layout.one_of(file, takes)
    return channels if len(takes) == 1 else {key: values[one] for key, values in channels.items()}


def _clocks(
    source: _Source, uses: Mapping[str, Use], channels: Channels, layout: Layout, rate_hz: float | None
) -> Channels:  # fmt: skip
    """Times [s] of the channels that have a column of times for themselves; one that does not rise is no clock."""
    clocks: Channels = {}
    for key, index in ((key, use.clock) for key, use in uses.items() if use.clock is not None):
        times, name = _rising(source, index, channels[key].size), source.columns.names[index]
        if times is None and layout.channels.get(key.removesuffix("_m_s2"), Channel()).clock:
            what = f"{name!r} is no clock of {key}: its numbers do not rise from row to row"
            raise InputFileError(source.file, what, "correct clock in study.toml")
        if times is None:
            continue
        behind = TIME_UNITS.get(name.lower().rpartition("_")[2])
        unit = TIME_UNITS.get(source.columns.claimed(index).lower(), behind)
        if unit is None and "time_s" in uses:
            unit = uses["time_s"].factor
        elif unit is None and (rate := rate_hz or layout.rate_hz):  # that with which they run so fast
            counted = (times.size - 1) / float(times[-1] - times[0])
            unit = next((u for u in TIME_UNITS.values() if abs(counted / u / rate - 1) < 1e-2), None)
        if unit is None:
            hint = Sentence("write it behind the name (time_s, time [ms]), or give ", called("sampling_rate_hz"))
            raise InputFileError(source.file, f"{name!r}, the times of {key}, have no unit", hint)
        clocks[key] = unit * times
    return clocks


#: Words of a heading that counts samples.
_COUNTER = re.compile(r"frame|sample|index|counter|packet|scan", re.IGNORECASE)


def _counted(source: _Source, uses: Mapping[str, Use], rate_hz: float | None, layout: Layout) -> None:
    """Refuse a rate that a column of counted samples contradicts."""
    taken = {use.index for use in uses.values()} | {use.clock for use in uses.values()}
    for index, name in enumerate(source.columns.names):
        if index in taken or not _COUNTER.search(name):
            continue
        values = _column(source, index)
        if values.size > 2 and np.isfinite(values).all() and (fault := counter_fault(values, rate_hz is not None)):
            raise InputFileError(
                source.file, f"has a rate of {rate_hz or layout.rate_hz or 0:g} Hz, and its column {name!r} {fault}",
                "write the time of each row (time_s), correct the rate, or delete a column that counts something else",
            )  # fmt: skip


def _column(source: _Source, index: int) -> np.ndarray:
    """The numbers of a column, none if it holds words."""
    try:
        return source.numbers({"": index})[""]
    except InputFileError:
        return np.empty(0)


def _rising(source: _Source, index: int, size: int) -> np.ndarray | None:
    """A column of as many numbers (n,) that rise from row to row, once they are not rounded any more; else None."""
    times = _column(source, index)
    times = straightened(times[: _end(times)])
    return times if times.size == size > 2 and np.diff(times).min() > 0 else None


def _denied(source: _Source, time_s: np.ndarray) -> list[str]:
    """A remark on a rate that a line above the numbers states and their time denies."""
    rate, span = source.columns.series[0].rate_hz if source.tabular else None, float(time_s[-1] - time_s[0])
    counted = (time_s.size - 1) / span if span > 0 else 0.0
    if not rate or not counted or abs(counted / rate - 1) < 1e-2:
        return []
    return [f"a line above its numbers states {rate:g} Hz, and its time runs at {counted:.6g} Hz, which counts"]


def _other_clocks(source: _Source, uses: Mapping[str, Use], time_s: np.ndarray) -> list[str]:
    """Columns of times that are in no use, stand with no other column, and differ from those in use."""
    columns, remarks = source.columns, []
    taken = {use.index for use in uses.values()} | {use.clock for use in uses.values()}
    rising = {index for index, values in enumerate(source.sample()) if _like_a_time(values, time_s)}
    for index in sorted({*columns.times, *rising}):
        next_one = index + 1
        of_another = columns.line and next_one < len(columns.names) and next_one not in {*taken, *columns.times}
        groups = {columns.series[i].group for i in taken if i is not None}
        if index in taken or of_another or columns.series[index].group not in groups:
            continue
        times = _rising(source, index, time_s.size)
        if times is None:
            continue
        scale = (time_s[-1] - time_s[0]) / (times[-1] - times[0])
        off = scale * (times - times[0]) - (time_s - time_s[0])
        late = times[0] - time_s[0]
        shifted = abs(scale - 1) < 1e-3 and 1e-9 < abs(late) < time_s[-1] - time_s[0]
        if shifted or np.abs(off).max() > 0.5 * (time_s[1] - time_s[0]):
            remarks.append(
                f"{columns.names[index]!r} is another time, and nothing says of which channel; study.toml can "
                f"([channels.malleolus] clock = {columns.names[index]!r})"
            )
    return remarks


def _ledger(source: _Source, uses: Mapping[str, Use]) -> tuple[tuple[str, ...], tuple[str, ...]]:
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


def _rate(
    file: Path, columns: Columns, sensors: Mapping[str, Series], is_timed: bool, layout: Layout
) -> float | None:  # fmt: skip
    """The rate [Hz] that a file states for the base, else for any channel in use, else for any."""
    for key, source in sensors.items():
        _one_scale(file, key.removesuffix("_m_s2"), source, layout)
    rates = {key: s.rate_hz for key, s in sensors.items() if s.rate_hz}
    if len(set(rates.values())) > 1 and is_timed:
        listed = ", ".join(f"{rate:g}" for rate in sorted(set(rates.values())))
        problem = f"its channels have different rates ({listed} Hz) and one time"
        raise InputFileError(file, problem, "resample them to one rate")
    every = [*rates.values(), *(s.rate_hz for s in columns.series)]
    return rates.get("base_m_s2") or next(filter(None, every), None)


def _stated_clocks(
    file: Path, sensors: Mapping[str, Series], time_s: np.ndarray, is_timed: bool, rate_hz: float | None
) -> Channels:  # fmt: skip
    """Times (n,) [s] of channels that start later than another or have another rate, by the file."""
    known = _starts(file, sensors, is_timed)
    first, unlike = min(known.values(), default=0.0), {s.rate_hz for s in sensors.values() if s.rate_hz}
    if len(unlike) < 2:
        late = np.ptp([*known.values(), first])
        return {key: time_s + start - first for key, start in known.items()} if late else {}
    return {
        key: np.arange(s.values.size) / (s.rate_hz or rate_hz or 1.0) + known.get(key, first) - first
        for key, s in sensors.items()
    }


def _like_a_time(values: np.ndarray, time_s: np.ndarray) -> bool:
    """Whether the first values (n,) of a column rise as evenly as a time in s, ms or us does."""
    rise, step = np.diff(values), float(np.median(np.diff(time_s[: max(2, values.size)])))
    even = rise.size > 8 and bool(rise.min() > 0) and np.ptp(rise) < 0.1 * np.median(rise)
    return (
        even
        and step > 0
        and any(abs(np.median(rise) / step / unit - 1) < 1e-2 for unit in (1, 1e3, 1e6))
    )


def read_one(
    file: Path, channel: str, layout: Layout | None = None, named: str = ""
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Time [s] and one channel [m/s^2], (n,) each, of a file that holds no other, and warnings of what it states.

    Args:
        channel: "base" or "malleolus".
        layout: of study.toml.
        named: the column, if it is named otherwise.
    """
    layout = (layout or Layout()).of(file)
    stated = layout.channels.get(channel, Channel())
    column = named or stated.column
    if named and (columns := columns_of(file, layout)).names:
        others = [name for index, name in enumerate(columns.names) if index not in columns.times]
        if not any(columns.called(index, named) for index in range(len(columns.names))):
            hint = f"name the column as in the header: --{channel} {others[0]}" if others else ""
            raise InputFileError(file, f"has no column {named!r} for {channel} ({columns.listed})", hint)
    if not column:  # that which begins with the channel's name
        names = columns_of(file, layout).names if ending(file) in (*TEXTS, *READ) else ()
        column = next((name for name in names if name_and_unit(name)[0] == channel), channel)
    pair = {name: replace(stated, column=column) for name in ("base", "malleolus")}
    time = {"time": layout.channels["time"]} if "time" in layout.channels else {}
    whole = reading(file, replace(layout, channels=pair | time))
    warnings = tuple(f"{file.name}: {text}." for text in whole.warnings)
    return whole.channels["time_s"], whole.channels[f"{channel}_m_s2"], warnings


def columns_of(file: Path, layout: Layout | None = None) -> Columns:
    """The columns of a recording, whatever they are; none of a text without a header that study.toml does not name.

    Args:
        layout: what study.toml says of its channels.
    """
    return _opened(file, beside(file, layout or Layout()), strict=False).columns


def beside(file: Path, layout: Layout) -> Layout:
    """The layout with what BIDS writes beside a .tsv.

    Rate and columns stand in its JSON, names and units in _channels.tsv.
    """
    if ending(file) != ".tsv":
        return layout
    sidecar = file.with_name(f"{_bids_stem(file)}.json")
    if not sidecar.is_file():
        return layout
    try:
        document = json.loads(read_text(sidecar))
        rate, columns = document.get("SamplingFrequency"), document.get("Columns", [])
        units = [str((document.get(name) or {}).get("Units", "")) for name in columns]
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
    if not columns:
        _, rows = _bids_channels(file)
        columns, units = ([row[key] for row in rows] for key in ("name", "units"))
    units = ["" if unit.lower() == "n/a" else unit for unit in units]
    if columns and layout.columns:
        return replace(layout, rate_hz=rate or layout.rate_hz)
    return replace(layout, rate_hz=rate or layout.rate_hz, columns=tuple(columns), units=tuple(units))


def _bids_stem(file: Path) -> str:
    return file.name.removesuffix(".gz").removesuffix(".tsv")


def _bids_channels(file: Path) -> tuple[Path, list[dict[str, str]]]:
    """The _channels.tsv beside a .tsv of BIDS, and its rows; none where there is no such table."""
    table = file.with_name(f"{_bids_stem(file).rpartition('_')[0]}_channels.tsv")
    if ending(file) != ".tsv" or table == file or not table.is_file():
        return table, []
    rows = read_table(table, ("name", "units")).values()
    return table, [{key: cell or "" for key, cell in row.items()} for row in rows]


def _of_bids(file: Path, names: Mapping[str, str], layout: Layout) -> dict[str, dict[str, str]]:
    """What the _channels.tsv of BIDS says of each channel; refused if that is bad, or has another rate."""
    table, listed = _bids_channels(file)
    rows = {row["name"]: row for row in listed}
    made = {channel: rows[name] for channel, name in names.items() if name in rows}
    for channel, about in made.items():
        if about.get("status", "").lower() == "bad":
            why = about.get("status_description", "")
            problem = f"says that {names[channel]} is bad" + (f" ({shown(why)})" if why else "")
            raise InputFileError(table, problem, "leave the recording out, or correct its status")
        stated = about.pop("sampling_frequency", "")
        if layout.rate_hz and numeric(stated) and abs(number(stated) / layout.rate_hz - 1) > 1e-3:
            two = f"a sampling_frequency of {stated} Hz, and its rate is {layout.rate_hz:g} Hz"
            problem = f"says {names[channel]} has {two}"
            raise InputFileError(table, problem, "correct one of them")
    return made


def _stated_by_columns(
    source: _Source, uses: Mapping[str, Use], names: Mapping[str, str]
) -> tuple[dict[str, Statements], list[str]]:  # fmt: skip
    """Statements by columns of one number, malleolus_gain, and the headings of those whose number changes."""
    taken = {use.index for use in uses.values()} | {use.clock for use in uses.values()}
    constant, changing = dict[str, float](), list[str]()
    for index, heading in enumerate(source.columns.names):
        if index in taken or index in source.columns.times or not any(named_by(n, [(heading, 1.0)]) for n in names):
            continue
        values = _column(source, index)
        values = values[np.isfinite(values)]
        if values.size and np.ptp(values) == 0:
            constant[heading] = float(values[0])
        elif values.size:
            changing.append(heading)
    return {name: named_by(name, constant.items()) for name in names}, changing


def _one_scale(file: Path, channel: str, source: Series, layout: Layout) -> None:
    """Refuse a scale of the file that may be applied twice."""
    stated = layout.channels.get(channel)
    sensitivity = bool(stated and stated.sensitivity != 1.0)
    if source.scaled and sensitivity and stated and not stated.volts:
        raise InputFileError(
            file, f"scales {source.name!r} itself ({source.scaled}), and study.toml gives "
            f"channels.{channel}.sensitivity = {stated.sensitivity:g}", "keep one of them",
        )  # fmt: skip


def _starts(file: Path, sources: Mapping[str, Series], with_time: bool) -> dict[str, float]:
    """When each channel's first sample was taken [s], by the file; all start together where it states none."""
    known = {name: s.start_s for name, s in sources.items() if s.start_s is not None}
    listed = ", ".join(f"{sources[name].name} {start:.6g} s" for name, start in known.items())
    if known and len(known) < len(sources):
        lacking = next(s.name for name, s in sources.items() if name not in known)
        raise InputFileError(
            file, f"says when some channels start ({listed}) and not when {lacking!r} does",
            "valid: a start time for every channel, or for none",
        )  # fmt: skip
    if with_time and known and max(known.values()) - min(known.values()) > 1e-9:
        raise InputFileError(
            file, f"its channels have one time and start at different times ({listed})",
            "valid: one time for all channels, or start times without it",
        )  # fmt: skip
    return known


def write(file: Path, channels: Channels, matlab: str = "5") -> None:
    """Write channels in the format of the file's ending.

    Args:
        file: to write.
        channels: as `reading` gives them.
        matlab: version of a .mat file, "5" or "7.3".
    """
    end = file.suffix.lower()
    if end not in ENDINGS:
        raise InputFileError(
            file, f"no format has the ending {end!r} for writing", f"valid: .csv, {', '.join(ENDINGS)}"
        )
    is_matlab_7 = end == ".mat" and matlab == "7.3"
    module = importlib.import_module(f"fasbody.recording.formats.{'hdf5' if is_matlab_7 else ENDINGS[end]}")
    need(module.LIBRARY)
    try:
        content = module.encode(channels, matlab=True) if is_matlab_7 else module.encode(channels)
    except FormatError as error:
        raise InputFileError(file, str(error)) from None
    write_whole(file, content)
