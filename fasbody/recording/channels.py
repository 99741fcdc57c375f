"""Units of acceleration, voltage and time as files, boards and data sheets write them, and what they are in SI.

Which column of a file is which channel, and what turns its numbers into m/s^2: units, sensitivity, sign, delay.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.exceptions import InputFileError, shown, unknown
from fasbody.presentation import Tabled
from fasbody.recording.known import Known

_G = 9.80665
#: Units that a CSV header or a board may carry behind a channel's name, and what they are in SI.
UNITS = {"m_s2": 1.0, "g": _G, "mg": 1e-3 * _G, "mm_s2": 1e-3, "cm_s2": 1e-2}
TIME_UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "sec": 1.0, "second": 1.0, "seconds": 1.0, "msec": 1e-3,
}  # fmt: skip
#: Those and what else instruments write into their files.
ACCELERATIONS = UNITS | {
    "m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "m/s**2": 1.0, "m/s/s": 1.0, "m s-2": 1.0, "m s^-2": 1.0, "m*s^-2": 1.0,
    "gn": _G, "mm/s^2": 1e-3, "mm/s2": 1e-3, "mm/s²": 1e-3, "cm/s^2": 1e-2, "cm/s2": 1e-2, "cm/s²": 1e-2,
}  # fmt: skip
VOLTAGES = {"v": 1.0, "mv": 1e-3, "volt": 1.0, "volts": 1.0}
KNOWN_UNITS = frozenset(ACCELERATIONS | VOLTAGES | TIME_UNITS)
_SENSITIVITY = re.compile(
    r"\s*([-+.\deE]+)\s*(m?V)\s*/\s*(?P<open>\()?\s*(g|m\s*/\s*s(?:(?:\^|\*\*)?2|²))\s*(?(open)\))\s*", re.IGNORECASE
)


def name_and_unit(name: str) -> tuple[str, str]:
    """Name and unit of a heading such as ``base_m_s2``, ``base [m/s^2]``, ``Base (g)``."""
    text = name.strip().strip('"').lower()
    match = re.fullmatch(r"([^\[\]()]+?)\s*[\[(]\s*([^\])]*?)\s*[\])]", text)
    if match:
        return match[1], match[2]
    stem, _, unit = text.partition("_")
    return stem, unit


def heading(name: str) -> tuple[str, str]:
    """A column's name as study.toml may give it, and the unit that its heading claims: ``AI0 [g]``, ``acc_x_mm_s2``."""
    stem, unit = name_and_unit(name)
    if unit in KNOWN_UNITS and name.strip().strip('"')[-1:] in ")]":
        return stem, unit
    behind = (unit for unit in sorted(UNITS, key=len, reverse=True) if name.strip().lower().endswith(f"_{unit}"))
    return name.strip().lower(), next(behind, "")


def factor(file: Path, channel: str, unit: str, valid: Mapping[str, float], line: int | None = None) -> float:
    """What turns a column's numbers into SI.

    Raises:
        InputFileError: the unit is none of `valid`.
    """
    if unit.lower() not in valid:
        raise InputFileError(file, unknown(f"unit of the column {channel!r}:", shown(unit), valid), line=line)
    return valid[unit.lower()]


def volts_per_m_s2(file: Path, name: str, text: str) -> float:
    """Sensitivity in V per m/s^2 from a data sheet's "100 mV/g".

    Raises:
        InputFileError: it says no such thing.
    """
    match = _SENSITIVITY.fullmatch(text)
    try:
        assert match is not None
        return float(match[1]) * VOLTAGES[match[2].lower()] / (_G if match[4].lower() == "g" else 1.0)
    except (AssertionError, ValueError):
        place = f"channels.{name}.sensitivity = {text!r}"
        raise InputFileError(file, place, 'valid: a number (unit per m/s^2), "100 mV/g" or "10.2 mV/(m/s^2)"') from None


Channels = dict[str, np.ndarray]

#: The accelerometers of section 2.2.2; the first two are needed. Others are known by their unit, or by study.toml.
NAMES = ("base", "malleolus", "tuberosity")
#: What a sensor of one's own may be called.
_OWN = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")
_KEYS = ("unit", "sign", "sensitivity", "delay_s", "column", "gain_std", "delay_std_s")


@dataclass(frozen=True)
class Channel(Tabled):
    """What study.toml says of one channel.

    Attributes:
        column: its name in the files, default the channel's own name. unit: of the numbers, if the files do not say.
        sign: +1 or -1. sensitivity: recorded unit per m/s^2, or in V per m/s^2 if `volts`. delay_s: how late it is.
        gain_std: relative standard uncertainty of the sensitivity, mounting included. delay_std_s: that of the delay.
    """

    column: str = ""
    unit: str = ""
    sign: float = 1.0
    sensitivity: float = 1.0
    volts: bool = False
    delay_s: float = 0.0
    gain_std: float = 0.0
    delay_std_s: float = 0.0


@dataclass(frozen=True)
class Layout(Tabled):
    """The channels of a study's files.

    Attributes:
        channels: by name, "time" included; those not listed are found by name and unit in the file.
        rate_hz: sampling rate of files that have no time.
        columns: names of the columns of text files without a header. units: of those columns, if known apart.
        beyond: what the laboratory knows beyond the recordings.
        apart: patterns of file names, and the layout of the files that fit one.
    """

    channels: Mapping[str, Channel] = field(default_factory=dict)
    rate_hz: float | None = None
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    beyond: Known = field(default_factory=Known)
    apart: tuple[tuple[str, "Layout"], ...] = field(default=(), repr=False)

    def of(self, file: Path) -> "Layout":
        """The layout of one file: that of the pattern that its name fits, else this one.

        Raises:
            InputFileError: it fits patterns of two layouts.
        """
        fitting = [(pattern, layout) for pattern, layout in self.apart if file.match(pattern)]
        if any(layout is not fitting[0][1] for _, layout in fitting):
            listed = " and ".join(pattern for pattern, _ in fitting)
            raise InputFileError(file, f"fits two layouts of study.toml ({listed})", "make their patterns exclusive")
        return fitting[0][1] if fitting else replace(self, apart=())

    @classmethod
    def from_toml(
        cls,
        file: Path,
        tables: Mapping[str, Any],
        rate_hz: object = None,
        columns: object = (),
        known: Mapping[str, Any] | None = None,
    ) -> "Layout":
        """From the [channels.*] tables of study.toml, and its [known].

        Raises:
            InputFileError: a channel, key or value that does not exist.
        """
        channels = {}
        for name, table in tables.items():
            known_as = get_close_matches(name, (*NAMES, "time"), cutoff=0.75)  # a slip of the pen is no sensor
            own = _OWN.fullmatch(name) and not known_as and isinstance(table, dict) and table
            if name not in (*NAMES, "time") and not own:
                listed = f"valid: {', '.join(NAMES)}, time, or a sensor of the model, in small letters"
                raise InputFileError(file, f"describes the channel {name!r}", listed)
            if not isinstance(table, dict):
                place = f"channels.{name}"
                raise InputFileError(file, f"{place} is {table!r}", f"it must be a table, [{place}]")
            channels[name] = _channel(file, name, table)
        if rate_hz is not None and not (_is_number(rate_hz) and 0 < rate_hz < 1e7):  # type: ignore[operator]
            raise InputFileError(file, f"sampling_rate_hz = {rate_hz!r}", "valid: a positive number")
        if not (isinstance(columns, list | tuple) and all(isinstance(name, str) for name in columns)):
            raise InputFileError(file, f"columns = {columns!r}", 'valid: a list of names, ["time_s", "base_g"]')
        for key in ("gain_std", "delay_std_s"):
            twice = [f"[channels.{name}]" for name, table in tables.items() if key in table]
            if key in (known or {}) and twice:
                raise InputFileError(file, f"states {key} in [known] and in {', '.join(twice)}", "keep one of them")
        rate = None if rate_hz is None else float(rate_hz)  # type: ignore[arg-type]
        return cls(channels, rate, tuple(columns), beyond=Known.from_toml(file, known or {}))

    def known(self, names: Sequence[str]) -> int:
        """How many of a file's columns are channels by their names."""
        told = {c.column.strip().lower() for c in self.channels.values() if c.column}
        return sum(name.strip().lower() in told or name_and_unit(name)[0] in ("time", *NAMES) for name in names)

    def find(
        self,
        file: Path,
        names: Sequence[str],
        units: Sequence[str],
        line: int | None = None,
        passed: Sequence[str] = (),
        sizes: Sequence[int] = (),
        clocked: bool = False,
    ) -> dict[str, tuple[int, float]]:
        """Which of the file's columns is which channel.

        Args:
            file: for messages. names, units: of the file's columns; a unit may also stand behind a name
                (``base_g``, ``base [g]``). line: of the header, for messages.
            passed: what else the file holds and why it is no channel, for messages.
            sizes: how many samples each column has, if they may differ. clocked: the file says its rate.

        Returns:
            ``time_s``, ``base_m_s2`` ... -> (index, factor to SI); ``time`` if that has no unit and a rate is known.
            Behind them every other column that is an acceleration by its unit, or a channel by study.toml.

        Raises:
            InputFileError: a unit is unknown, missing or contradicts study.toml; a channel is missing or there twice;
                channels of different lengths.
        """
        wanted: dict[str, tuple[int, str]] = {}
        listed = f"found: {shown(', '.join(names)) or 'nothing'}"
        listed += f"; passed over: {shown(', '.join(passed))}" if passed else ""
        for channel in ("time", *NAMES):
            told = self.channels.get(channel, Channel())
            for index, (name, unit) in enumerate(zip(names, units, strict=True)):
                stem, behind = name_and_unit(name)
                if told.column:
                    plain, claimed = heading(name)
                    behind = behind if stem == channel else claimed
                    stem = channel if told.column.strip().lower() in (name.strip().lower(), plain) else ""
                if stem != channel:
                    continue
                self._agree(file, channel, behind, unit, "its heading says", "a unit with the column says")
                self._agree(file, channel, told.unit, unit or behind, "study.toml says", "the file says")
                found = told.unit or unit or behind
                key = "time_s" if channel == "time" else f"{channel}_m_s2"
                if channel == "time" and not found:
                    key = "time"
                elif channel == "time" and found.lower() not in TIME_UNITS and not told.column:
                    continue
                if key in wanted:
                    raise InputFileError(file, f"has two columns for {channel}", "keep one of them", line=line)
                wanted[key] = (index, found)
            if told.column and not {channel, f"{channel}_s", f"{channel}_m_s2"} & wanted.keys():
                hint = "one study.toml is for files of one kind; python -m fasbody.recording convert makes them one"
                raise InputFileError(file, f"has no column {told.column!r} for {channel} ({listed})", hint)
        bare = wanted.pop("time", None)  # a time that does not say its unit; a known rate tells it
        if bare and "time_s" not in wanted:
            if not clocked and self.rate_hz is None:
                hint = 'name the column time_s, time_ms or time_us, or give study.toml [channels.time] unit = "s"'
                raise InputFileError(file, f"{names[bare[0]]!r} has no unit", hint, line=line)
            wanted["time"] = bare
        if line and not wanted:  # text, perhaps in another language
            columns = ", ".join(f'[channels.{name}] column = "..."' for name in ("time", "base", "malleolus"))
            raise InputFileError(
                file, f"names no channel ({listed})",
                f"call its columns time_s, base_m_s2, malleolus_m_s2, or say in study.toml which is which: {columns}",
                line=line,
            )  # fmt: skip
        clock = ("time_s",) if line and self.rate_hz is None else ()  # only text has no rate of its own
        for name in (*clock, "base_m_s2", "malleolus_m_s2"):
            if name not in wanted:
                hint = _CLOCK if name in clock else _HELP.format(name=name.removesuffix("_m_s2"))
                raise InputFileError(file, f"has no column {name!r} ({listed})", hint, line=line)
        wanted |= self._others(names, units, sizes, wanted)
        lengths = {name: sizes[index] for name, (index, _) in wanted.items()} if sizes else {}
        if len(set(lengths.values())) > 1:
            told_lengths = ", ".join(f"{name} {size}" for name, size in lengths.items())
            raise InputFileError(
                file, f"its channels have different lengths ({told_lengths})", "resample them to one rate"
            )
        return {key: (index, self._factor(file, key, unit, line)) for key, (index, unit) in wanted.items()}

    def _others(
        self, names: Sequence[str], units: Sequence[str], sizes: Sequence[int], wanted: Mapping[str, tuple[int, str]]
    ) -> dict[str, tuple[int, str]]:
        """Further accelerometers: those of study.toml, and columns that their unit says to be accelerations."""
        taken, size = {index for index, _ in wanted.values()}, sizes[wanted["base_m_s2"][0]] if sizes else 0
        columns = {c.column.strip().lower(): name for name, c in self.channels.items() if c.column}
        found: dict[str, tuple[int, str]] = {}
        for index, (name, unit) in enumerate(zip(names, units, strict=True)):
            plain, claimed = heading(name)
            stem = plain.removesuffix(f"_{claimed}") if claimed else plain
            channel = columns.get(name.strip().lower(), columns.get(plain, stem))
            told = self.channels.get(channel)
            acceleration = (unit or claimed).lower() in ACCELERATIONS and _OWN.fullmatch(channel)
            if index in taken or channel.partition("_")[0] in (*NAMES, "time") or not (told or acceleration):
                continue
            if not sizes or told or sizes[index] == size:
                found.setdefault(f"{channel}_m_s2", (index, (told.unit if told else "") or unit or claimed))
        return found

    def _factor(self, file: Path, key: str, unit: str, line: int | None) -> float:
        if key == "time":
            return 1.0
        if key == "time_s":
            return factor(file, "time", unit, TIME_UNITS, line)
        channel = key.removesuffix("_m_s2")
        told = self.channels.get(channel, Channel())
        if not unit:
            hint = f"name the column {channel}_m_s2 or {channel}_g, or give study.toml [channels.{channel}]"
            raise InputFileError(file, f"{channel} has no unit", f'{hint} unit = "m/s^2"', line=line)
        if unit.lower() in VOLTAGES:
            if told.sensitivity == 1.0 and not told.volts:
                raise InputFileError(
                    file, f"{channel} is in {unit}", f'study.toml must give channels.{channel}.sensitivity = "100 mV/g"'
                )
            scale = VOLTAGES[unit.lower()] if told.volts else 1.0
        else:
            scale = factor(file, channel, unit, ACCELERATIONS, line)
            if told.volts:
                raise InputFileError(file, f"{channel} is in {unit}, and study.toml gives a sensitivity in volts")
        return told.sign * scale / told.sensitivity

    @staticmethod
    def _agree(file: Path, channel: str, told: str, found: str, one: str, other: str) -> None:
        """Refuse two units of one column that are not the same; a text that is no unit says nothing."""
        by_file = other == "the file says"
        told, found = told.lower(), found.lower()
        if not told or not found or (told in VOLTAGES and found == "m_s2"):
            return  # the standard heading over numbers that study.toml makes m/s^2
        valid = TIME_UNITS if channel == "time" else ACCELERATIONS | VOLTAGES
        if told not in valid or (found not in valid and not by_file):
            return
        if valid[told] != valid.get(found) or (told in VOLTAGES) != (found in VOLTAGES):
            source = "" if by_file else f" ({other.removesuffix(' says')})"
            raise InputFileError(file, f"{channel} is in {found}{source}, and {one} {told}", "correct one of them")

    def timed(self, file: Path, channels: Channels, rate_hz: float | None = None) -> Channels:
        """The channels with ``time_s``: the file's own, or counted from a sampling rate.

        Args:
            file: for messages. channels: with ``time_s``, with ``time`` of unknown unit, or without.
            rate_hz: sampling rate that the file states.

        Raises:
            InputFileError: time, the file's rate and that of study.toml disagree, or there is none of them.
        """
        if rate_hz and self.rate_hz and abs(rate_hz / self.rate_hz - 1) > _SAME_RATE:
            raise InputFileError(
                file, f"states a sampling rate of {rate_hz:.6g} Hz, and study.toml sampling_rate_hz = "
                f"{self.rate_hz:.6g}", "correct or delete that of study.toml",
            )  # fmt: skip
        rate = rate_hz or self.rate_hz
        channels = dict(channels)
        time = channels.pop("time", None)
        if time is None:
            time = channels.get("time_s")
        if time is None:
            if not rate:
                raise InputFileError(
                    file, "has neither a time nor a sampling rate", "give sampling_rate_hz in study.toml"
                )
            return {"time_s": np.arange(channels["base_m_s2"].size) / rate} | channels
        said = (
            f"states {rate:.6g} Hz" if rate_hz else f"is said by study.toml to have sampling_rate_hz = {rate or 0:.6g}"
        )
        span = float(time[-1] - time[0]) if time.size > 1 else 0.0
        counted = (time.size - 1) / span if np.isfinite(span) and span > 0 else 0.0
        tolerance = max(_SAME_RATE, 2 / max(1, time.size))
        if "time_s" not in channels:
            units = [unit for unit in TIME_UNITS.values() if rate and abs(counted / unit / rate - 1) <= tolerance]
            if not units:
                raise InputFileError(
                    file, f"{said}, and the steps of its time (without unit) are {1 / counted if counted else 0:.6g}",
                    "correct one of them, and name the column time_s, time_ms or time_us",
                )  # fmt: skip
            return {"time_s": time * units[0]} | channels
        if rate and counted and abs(counted / rate - 1) > tolerance:
            raise InputFileError(
                file, f"{said}, and its time runs at {counted:.6g} Hz", "correct one of them, or delete the rate"
            )
        return channels

    def aligned(self, file: Path, channels: Channels, starts: Mapping[str, float] | None = None) -> Channels:
        """The channels with their known delays undone (by a spline), over the time that all of them cover.

        Args:
            file: for messages. channels: with ``time_s``. starts: when each channel's first sample was taken [s],
                where the file says so.

        Raises:
            InputFileError: a delay that takes more than a tenth of the recording.
        """
        from scipy.interpolate import CubicSpline

        first_of_all = min(starts.values(), default=0.0) if starts else 0.0
        late = {
            name: first_of_all - start for name, start in (starts or {}).items()
        }  # an early start is a late channel
        for name, c in self.channels.items():
            if name != "time":
                late[f"{name}_m_s2"] = late.get(f"{name}_m_s2", 0.0) + c.delay_s
        late = {name: delay for name, delay in late.items() if abs(delay) > 1e-9}
        t = channels["time_s"]
        if not late or t.size < 2 or np.any(np.diff(t) <= 0) or not np.isfinite(t).all():
            return channels  # the checks will say what is wrong with such a time
        late = {name: delay for name, delay in late.items() if name in channels}
        first, last = (float(limit(0.0, *late.values())) for limit in (min, max))
        if last - first > _LONGEST_DELAY * (t[-1] - t[0]):
            told = ", ".join(f"{name.removesuffix('_m_s2')} {delay:.6g} s" for name, delay in late.items())
            source = "the start times of its channels and " if starts and np.ptp(list(starts.values())) else ""
            raise InputFileError(
                file, f"lasts {t[-1] - t[0]:.4g} s, too short for {source}delay_s of study.toml ({told})",
                f"valid: delays that leave {100 - 100 * _LONGEST_DELAY:.0f} % of a recording",
            )  # fmt: skip
        # a channel that is late by d holds at t + d what the others hold at t; beyond its ends it holds nothing
        rounding = 1e-9 * (t[-1] - t[0])
        covered = (t + first >= t[0] - rounding) & (t + last <= t[-1] + rounding)
        return {
            name: CubicSpline(t, values)(t[covered] + late[name])
            if name in late and np.abs(values).max() < _SPLINED
            else values[covered]
            for name, values in channels.items()
        }


#: Larger numbers are of no body and overflow a spline; the checks refuse them, and what is no number.
_SPLINED = 1e100
#: Delays may take this share of a recording.
_LONGEST_DELAY = 0.1
#: Two sampling rates are the same within this share: a nominal rate and a logger's own clock.
_SAME_RATE = 1e-3
_CLOCK = "study.toml can name it ([channels.time] column = ...), or give sampling_rate_hz"
_HELP = "units may also be g or ms, and study.toml can name the column ([channels.{name}] column = ...)"


def _channel(file: Path, name: str, table: Mapping[str, Any]) -> Channel:
    for key, value in table.items():
        text = key in ("column", "unit") or (key == "sensitivity" and isinstance(value, str))
        right = isinstance(value, str) if text else _is_number(value) and np.isfinite(value)
        if key == "sign" and not (right and abs(value) == 1):
            raise InputFileError(file, f"channels.{name}.sign = {value!r}", "valid: 1, -1 (a gain is a sensitivity)")
        if right and key in ("gain_std", "delay_std_s") and not 0 <= value <= 1:
            raise InputFileError(file, f"channels.{name}.{key} = {value!r}", "valid: a standard deviation, 0 to 1")
        if key not in _KEYS or not right:
            raise InputFileError(
                file, f"channels.{name}.{key} = {value!r}", f"valid: {', '.join(_KEYS)}, with finite numbers"
            )
    given = table.get("sensitivity", 1.0)
    sensitivity, volts = (volts_per_m_s2(file, name, given), True) if isinstance(given, str) else (float(given), False)
    if sensitivity == 0:
        raise InputFileError(file, f"channels.{name}.sensitivity is zero", "give recorded unit per m/s^2")
    unit = str(table.get("unit", ""))
    if unit:
        factor(file, name, unit, TIME_UNITS if name == "time" else ACCELERATIONS | VOLTAGES)
    return Channel(
        str(table.get("column", "")), unit, float(table.get("sign", 1.0)), sensitivity, volts,
        float(table.get("delay_s", 0.0)), float(table.get("gain_std", 0.0)), float(table.get("delay_std_s", 0.0)),
    )  # fmt: skip


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
