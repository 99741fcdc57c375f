"""Which column of a file is which channel, in which unit and by which clock, and which columns are none."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fasbody.exceptions import InputFileError, shown
from fasbody.presentation import Tabled
from fasbody.recording import channels
from fasbody.recording.channels import Channel, Layout
from fasbody.recording.formats.series import Series
from fasbody.recording.headings import unit_of_epoch
from fasbody.sentences import Sentence, called, for_page

#: So many letters as a first word are no unit: min_base is a minimum, second_foot a foot.
_SHORT = 6
#: A heading that ends with a unit, known or not: in square brackets, or with a sign of units within round ones.
_UNIT = re.compile(r"\[[^\[\]]+\]$|\([^()]*[/%.^²][^()]*\)$")
#: Words of a heading that holds times.
_TIMES = re.compile(r"(?:^|[\W_\d])(times?|timestamps?|zeit|temps|tiempo|tempo|t|clock)(?=$|[\W_\d])")


@dataclass(frozen=True)
class Columns:
    """A file's columns.

    Attributes:
        series: what the file says of each; those of a text have no values yet.
        passed: what else the file holds and why it is no column.
        line: of the headings, None if it is no text.
        first: cells of the first row of numbers of a text.
    """

    series: Sequence[Series]
    passed: Sequence[str] = ()
    line: int | None = None
    first: Sequence[str] = ()

    @cached_property
    def names(self) -> list[str]:
        """Of the columns."""
        return [s.name for s in self.series]

    @cached_property
    def units(self) -> list[str]:
        """Of the columns, "" where only the name may state it; the date behind one of time is of no interest."""
        return [s.unit.partition(" since ")[0] for s in self.series]

    @property
    def clocked(self) -> bool:
        """Whether the file states a rate."""
        return any(s.rate_hz for s in self.series)

    def called(self, index: int, column: str) -> bool:
        """Whether study.toml means a column: by name, by name without its unit, with `` 2`` if two are called so, or by
        its number.
        """
        stated, plain = column.strip().lower(), [name.strip().lower() for name in self.names]
        repeated = f"{plain[index]} {plain[: index + 1].count(plain[index])}"
        stem, unit = channels.heading(self.names[index])
        bare = stem.removesuffix(f"_{unit}") if unit and stated not in plain else stem
        return stated in (plain[index], stem, bare, repeated, f"#{index + 1}")

    def claimed(self, index: int) -> str:
        """The unit of a column by itself, or by its heading."""
        name = self.names[index]
        return self.units[index] or channels.heading(name)[1] or channels.name_and_unit(name)[1]

    @property
    def listed(self) -> str:
        """All headings, for messages."""
        passed = f"; passed over: {shown(', '.join(self.passed))}" if self.passed else ""
        return f"found: {shown(', '.join(self.names)) or 'nothing'}{passed}"

    @cached_property
    def times(self) -> list[int]:
        """The columns that are times by their unit, or by their name where no unit denies it."""
        times = []
        for index, name in enumerate(name.strip().lower() for name in self.names):
            behind = channels.name_and_unit(name)[1]
            unit = self.units[index].lower() or (behind if name[-1:] in ")]" else _time_within(name))
            named = behind not in channels.UNITS and _TIMES.search(name)
            times += [index] if (unit in channels.TIME_UNITS if unit else named) else []
        return times


    @property
    def epoch(self) -> tuple[int, str] | None:
        """The first column of times that counts from 1970, without a unit, and its unit by size."""
        for index in self.times:
            values = self.series[index].values
            cell = self.first[index] if self.first else f"{values[0]:.0f}" if values.size else ""
            if not self.units[index] and (unit := unit_of_epoch(cell)):
                return index, unit
        return None


@dataclass(frozen=True)
class Use(Tabled):
    """What a column is used for.

    Attributes:
        index: of the column.
        factor: to SI.
        unit: what its numbers are in.
        clock: index of the column of its times, None for the time of all channels.
    """

    index: int
    factor: float
    unit: str = ""
    clock: int | None = None


#: Index of the column of each channel, and the unit of its numbers.
_Chosen = dict[str, tuple[int, str]]


def assign(file: Path, columns: Columns, layout: Layout) -> tuple[dict[str, Use], tuple[str, ...]]:
    """Find the channels among a file's columns: those of section 2.2.2, and every other that is an acceleration.

    Args:
        columns: of the file.
        layout: of study.toml.

    Returns:
        Uses by the channel's name, ``time_s``, ``base_m_s2`` ..., ``time`` if that has no unit and a rate is known; and
        what was decided between the file and study.toml, in sentences without the file's name.
    """
    remarks: list[str] = []
    chosen: _Chosen = {}
    for channel in ("time", *channels.NAMES):
        column = _column_of(file, columns, layout, channel, remarks)
        if column is not None:
            index, unit = column
            key = f"{channel}_m_s2" if channel != "time" else "time_s" if unit else "time"
            chosen[key] = (index, unit)
    bare = chosen.pop("time", None)  # a time without a unit, which a known rate gives
    named = _by_unit(columns) or (None if columns.clocked or layout.rate_hz else columns.epoch)
    if bare and named is None and not columns.clocked and layout.rate_hz is None:
        hint = Sentence("name the column time_s, time_ms or time_us, or give ", called("channels.time.unit", "s"))
        raise InputFileError(file, f"{columns.names[bare[0]]!r} has no unit", hint, line=columns.line)
    if bare and (named is None or columns.clocked or layout.rate_hz is not None):
        chosen["time"] = bare
    elif "time_s" not in chosen and named is not None:
        chosen["time_s"] = named
    _complete(file, columns, layout, chosen)
    chosen |= _others(columns, layout, chosen)
    clocks = _clocks(file, columns, layout, chosen)
    _one_length(file, columns, chosen, clocks)
    uses = {
        key: Use(index, _factor(file, columns, layout, key, unit), unit, clocks.get(key))
        for key, (index, unit) in chosen.items()
    }
    return uses, tuple(remarks)


def has_channels(columns: Columns, layout: Layout) -> bool:
    """Whether base and malleolus are among a file's columns."""
    try:
        assign(Path(), columns, layout)
    except InputFileError:
        return False
    return True


def _column_of(
    file: Path, columns: Columns, layout: Layout, channel: str, remarks: list[str]
) -> tuple[int, str] | None:  # fmt: skip
    """The column of a channel, and the unit of its numbers."""
    stated = layout.channels.get(channel, Channel())
    candidates: list[tuple[int, str]] = []
    for index, name in enumerate(columns.names):
        stem, behind = channels.name_and_unit(name)
        if stated.column:
            bracketed = behind if _UNIT.search(name) else channels.heading(name)[1]
            behind = behind if stem == channel else bracketed
        mine = stem == channel and (channel == "time" or index not in columns.times)
        if not (columns.called(index, stated.column) if stated.column else mine):
            continue
        unit = _unit(file, channel, behind, columns.units[index], stated.unit, remarks, _UNIT.search(name) is not None)
        if channel == "time" and unit and unit.lower() not in channels.TIME_UNITS and not stated.column:
            continue
        candidates.append((index, unit))
    last = (*columns.times, len(columns.names))
    apart = all(i - 1 not in columns.times and i + 1 not in last for i, _ in candidates[1:])
    several = len({columns.series[i].group for i, _ in candidates}) > 1
    if len(candidates) > 1 and not (channel == "time" and (apart or several)):  # a clock of each sensor, or group
        numbers = " or ".join(f"column = {index + 1}" for index, _ in candidates[:3])
        hint = f"keep one of them, or say which in study.toml ([channels.{channel}] {numbers})"
        raise InputFileError(file, f"has two columns for {channel}", hint, line=columns.line)
    if stated.column and not candidates:
        hint = Sentence(
            "name the column as in the header; for files of several kinds, fasbody convert makes them alike",
            on_page=f"name its columns with {for_page(called(f'channels.{channel}.column'))}",
        )
        column = repr(stated.column) if stated.column[:1] != "#" else f"number {stated.column[1:]}"
        raise InputFileError(file, f"has no column {column} for {channel} ({columns.listed})", hint)
    return candidates[0] if candidates else None


def _unit(
    file: Path, channel: str, behind: str, beside: str, stated: str, remarks: list[str], bracketed: bool
) -> str:  # fmt: skip
    """The unit of a channel's numbers: of study.toml, which may overrule the file, or of the file."""
    valid = channels.TIME_UNITS if channel == "time" else channels.ACCELERATIONS | channels.VOLTAGES
    known = [unit for unit in (beside, behind) if unit.lower() in valid]
    if not stated and len(known) == 2 and not _same(valid, *known):
        raise InputFileError(
            file, f"{channel} is in {beside} (a unit with the column), and its heading says {behind}",
            f"correct one of them, or say which in study.toml ([channels.{channel}] unit = ...)",
        )  # fmt: skip
    claimed = beside or (behind if behind.lower() in channels.KNOWN_UNITS or bracketed else "")
    # the standard heading may stand over numbers in volts
    plain = stated.lower() in channels.VOLTAGES and claimed.lower() == "m_s2"
    if stated and claimed and not plain and not _same(valid, stated, claimed):
        by = Sentence(" as study.toml says", on_page=" as was said here")
        by_file = shown(claimed.rstrip("."))
        remarks.append(Sentence(f"{channel} is in {stated}", by, f", though the file says {by_file}"))
    return stated or beside or behind


def _same(valid: Mapping[str, float], one: str, other: str) -> bool:
    one, other = one.lower(), other.lower()
    if channels.plain(one) == channels.plain(other):
        return True
    return valid.get(one) == valid.get(other) and (one in channels.VOLTAGES) == (other in channels.VOLTAGES)


def _by_unit(columns: Columns) -> tuple[int, str] | None:
    """The first column that has a unit of time under whatever name, and the unit."""
    # beside the name, in brackets behind it, behind the name of a time (timestamp_ms), or first (seconds_elapsed)
    for index, name in enumerate(columns.names):
        stem, behind = channels.name_and_unit(name)
        bracketed = behind if name.strip()[-1:] in ")]" else _time_within(name)
        last = name.lower().rpartition("_")[2]  # time_base_s
        units = [
            columns.units[index] or bracketed,
            *((behind, last) if index in columns.times else ()),
            stem,
        ]
        known = (u for u in units if u.lower() in channels.TIME_UNITS and (u != stem or len(u) > _SHORT))
        if unit := next(known, ""):
            return index, unit
    return None


def _time_within(name: str) -> str:
    """A unit of time in brackets within a heading of times: ``Time (s) Run #1``."""
    units = (unit for unit in re.findall(r"[(\[]\s*([^()\[\]]*?)\s*[)\]]", name) if unit in channels.TIME_UNITS)
    return next(units, "") if _TIMES.search(name.lower()) else ""


def _complete(file: Path, columns: Columns, layout: Layout, chosen: _Chosen) -> None:
    """Refuse a file that lacks a channel, or a time where it states no rate."""
    if columns.line and not chosen:  # text, perhaps in another language
        listed = ", ".join(f'[channels.{name}] column = "..."' for name in ("time", "base", "malleolus"))
        raise InputFileError(
            file, f"names no channel ({columns.listed})",
            Sentence(
                "call its columns time_s, base_m_s2, malleolus_m_s2, or say ",
                Sentence(f"in study.toml which is which: {listed}", on_page="with “…” which is which"),
            ),
            line=columns.line,
        )  # fmt: skip
    clock = ("time_s",) if columns.line and layout.rate_hz is None and not columns.clocked else ()
    for name in (*clock, "base_m_s2", "malleolus_m_s2"):
        if name not in chosen:
            key = f"channels.{'time' if name in clock else name.removesuffix('_m_s2')}.column"
            column = called(key)
            hint = (
                Sentence(column, " can name it, or give ", called("sampling_rate_hz"))
                if name in clock
                else Sentence(
                    "its unit may also be g, as in base_g, and ", column, " can name the column",
                    Sentence(" (fasbody study init FOLDER writes study.toml)", on_page=""),
                )
            )
            missing = f"has no column {name!r} ({columns.listed})"
            raise InputFileError(file, missing, hint, line=columns.line, code=f"no {name}", setting=key)


def _others(columns: Columns, layout: Layout, chosen: _Chosen) -> _Chosen:
    """Further accelerometers: those of study.toml, and columns with a unit of acceleration."""
    taken = {index for index, _ in chosen.values()}
    size = columns.series[chosen["base_m_s2"][0]].values.size
    others: _Chosen = {}
    for index, (name, unit) in enumerate(zip(columns.names, columns.units, strict=True)):
        plain, claimed = channels.heading(name)
        stem = plain.removesuffix(f"_{claimed}") if claimed else plain
        named = (other for other, c in layout.channels.items() if c.column and columns.called(index, c.column))
        channel = next(named, stem)
        stated = layout.channels.get(channel)
        acceleration = (unit or claimed).lower() in channels.ACCELERATIONS and channels.SENSOR_NAME.fullmatch(channel)
        if index in taken or channel.partition("_")[0] in (*channels.NAMES, "time") or not (stated or acceleration):
            continue
        if stated or columns.series[index].values.size == size:
            others.setdefault(f"{channel}_m_s2", (index, (stated.unit if stated else "") or unit or claimed))
    return others


def _clocks(file: Path, columns: Columns, layout: Layout, chosen: _Chosen) -> dict[str, int]:
    """The column of times of each channel that does not share the time of the file."""
    # a table repeats its time in front of each sensor, a file with groups in each of them, and names share a word
    main = next((chosen[key][0] for key in ("time_s", "time") if key in chosen), None)
    times = sorted({*columns.times, *(() if main is None else (main,))})
    clocks: dict[str, int] = {}
    for key, (index, _) in chosen.items():
        if key in ("time_s", "time"):
            continue
        stated = layout.channels.get(key.removesuffix("_m_s2"), Channel()).clock
        if stated:
            named = next((i for i in range(len(columns.names)) if columns.called(i, stated)), None)
            if named is None:
                raise InputFileError(file, f"has no column {stated!r} for the times of {key} ({columns.listed})")
            clocks[key] = named
        elif times:
            clocks[key] = _clock_of(columns, index, key, [i for i in times if i != index], main)
    return {key: index for key, index in clocks.items() if index != main}


def _one_length(file: Path, columns: Columns, chosen: _Chosen, clocks: Mapping[str, int]) -> None:
    """Refuse channels of other lengths than the others that share their time."""
    used = {key: columns.series[index] for key, (index, _) in chosen.items()}
    sizes = {key: s.values.size for key, s in used.items()}
    odd = {key for key, size in sizes.items() if key in clocks and columns.series[clocks[key]].values.size == size}
    if len({s.rate_hz for s in used.values()}) > 1:  # a clock for each rate
        odd |= {key for key, s in used.items() if s.rate_hz}
    shared = {key: size for key, size in sizes.items() if key not in odd}
    if len(set(shared.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in shared.items())
        raise InputFileError(file, f"its channels have different lengths ({listed})", "resample them to one rate")


def _clock_of(columns: Columns, index: int, key: str, times: Sequence[int], main: int | None) -> int:
    """The column of times of one column: of its group, by a word that both names have, or the one in front of it."""
    times = [i for i in times if columns.series[i].group == columns.series[index].group] or times
    words = {i: _words(columns.names[i]) for i in times}
    if not all(any(word.isdigit() for word in tokens) for tokens in words.values()):  # t1 and t2, not time and time 2
        words = {i: {word for word in tokens if not word.isdigit()} for i, tokens in words.items()}
    mine = _words(columns.names[index]) | {key.removesuffix("_m_s2")}
    alike = [i for i, tokens in words.items() if tokens and all(_begins(token, mine) for token in tokens)]
    if len(alike) == 1 and len(times) > 1:
        return alike[0]
    before = [i for i in times if i < index] or times[:1]
    run = [before[-1]]
    while run[0] - 1 in before:  # times side by side are of the same rows
        run.insert(0, run[0] - 1)
    return main if main is not None and main in run else run[0]


def _begins(token: str, words: set[str]) -> bool:
    """Whether a word, or number, is among others, or begins one, as mal does malleolus."""
    return token in words or (len(token) > 2 and any(word.startswith(token) for word in words))


def _words(name: str) -> set[str]:
    """Words and numbers that distinguish a heading, without those of time and units."""
    stem = channels.name_and_unit(name)[0] if name.strip()[-1:] in ")]" else name.lower()
    words = set(re.findall(r"[^\W\d_]+|\d+", stem))
    return {word for word in words if (word.isdigit() or len(word) > 2) and not _TIMES.fullmatch(word)}


def _factor(file: Path, columns: Columns, layout: Layout, key: str, unit: str) -> float:
    if key == "time":
        return 1.0
    if key == "time_s":
        return channels.factor(file, "time", unit, channels.TIME_UNITS, columns.line)
    channel = key.removesuffix("_m_s2")
    stated = layout.channels.get(channel, Channel())
    if not unit:
        si_unit = called(f"channels.{channel}.unit", "m/s^2")
        hint = Sentence(f"name the column {channel}_m_s2 or {channel}_g, or give ", si_unit)
        raise InputFileError(file, f"{channel} has no unit", hint, line=columns.line)
    if channels.RAW.fullmatch(unit):
        if "sensitivity" not in stated.stated or stated.volts:
            key = Sentence(
                f"in study.toml ([channels.{channel}] sensitivity = 208.8)",
                on_page="as its sensitivity",
            )
            hint = Sentence("give how many of them make 1 m/s^2, a number, ", key)
            raise InputFileError(
                file, f"{channel} is in {shown(unit)}, no unit of acceleration", hint, columns.line
            )
        scale = 1.0
    elif unit.lower() in channels.VOLTAGES:
        if stated.sensitivity == 1.0 and not stated.volts:
            hint = Sentence("give ", called(f"channels.{channel}.sensitivity", "100 mV/g"))
            symbol = {"v": "V", "mv": "mV"}.get(unit.lower(), unit)  # of a heading in lower case
            raise InputFileError(file, f"{channel} is in {symbol}", hint)
        scale = channels.VOLTAGES[unit.lower()] if stated.volts else 1.0
    else:
        scale = channels.factor(file, channel, unit, channels.ACCELERATIONS, columns.line)
        if stated.volts:
            raise InputFileError(file, f"{channel} is in {unit}, and study.toml gives a sensitivity in volts")
    return stated.sign * scale / stated.sensitivity
