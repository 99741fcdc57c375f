"""Units of acceleration, voltage and time as files, boards and data sheets write them, and what they are in SI.

Which column of a file is which channel, and what turns its numbers into m/s^2: units, sensitivity, sign, delay.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fasbody.constants import GRAVITY
from fasbody.exceptions import InputFileError, shown
from fasbody.presentation import Tabled
from fasbody.recording.clock import rate_of
from fasbody.recording.known import Known
from fasbody.recording.study_toml import SENSITIVITIES, ChannelTable, FileTable, validated
from fasbody.sentences import Sentence, called

#: Units that a CSV header or a board may carry behind a channel's name, and what they are in SI.
UNITS = {"m_s2": 1.0, "g": GRAVITY, "mg": 1e-3 * GRAVITY, "mm_s2": 1e-3, "cm_s2": 1e-2}
TIME_UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "sec": 1.0, "second": 1.0, "seconds": 1.0,
    "msec": 1e-3, "milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9, "min": 60.0, "minutes": 60.0,
    "h": 3600.0, "d": 86400.0, "days": 86400.0,
}  # fmt: skip
#: Those and what else instruments write into their files.
ACCELERATIONS = UNITS | {
    "m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "m/s**2": 1.0, "m/s/s": 1.0, "m s-2": 1.0, "m s^-2": 1.0, "m*s^-2": 1.0,
    "m/(s^2)": 1.0, "gn": GRAVITY,
}  # fmt: skip
_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "dm": 0.1, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "ft": 0.3048, "in": 0.0254}
ACCELERATIONS |= {f"{name}/{squared}": m for name, m in _LENGTHS.items() for squared in ("s^2", "s2", "s²")}
_VELOCITY = re.compile(r"[a-zµμ]+ ?/ ?(?:s|sec|min|h)", re.IGNORECASE)
VOLTAGES = {"v": 1.0, "mv": 1e-3, "uv": 1e-6, "µv": 1e-6, "μv": 1e-6, "volt": 1.0, "volts": 1.0}
#: Numbers of a converter, or shares of its range, which a sensitivity makes accelerations.
RAW = re.compile(r"counts?|cts|raw|lsb|adc|adu|digits?|1|(?:%|percent).*|fs", re.IGNORECASE)
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
    return stem, unit[2:] if unit[:2] in ("x_", "y_", "z_") else unit  # an axis is no unit


def heading(name: str) -> tuple[str, str]:
    """A column's name as study.toml may give it, and the unit that its heading claims: ``AI0 [g]``, ``acc_x_mm_s2``."""
    stem, unit = name_and_unit(name)
    if unit in KNOWN_UNITS and name.strip().strip('"')[-1:] in ")]":
        return stem, unit
    name = name.strip()
    units = [unit for unit in sorted(UNITS | VOLTAGES, key=len, reverse=True) if name.lower().endswith(f"_{unit}")]
    if units == ["v"] and not name.endswith("V"):  # acc_v may be vertical
        units = []
    return name.lower(), next(iter(units), "")


def factor(file: Path, channel: str, unit: str, valid: Mapping[str, float], line: int | None = None) -> float:
    """What turns a column's numbers into SI."""
    if unit.lower() in valid:
        return valid[unit.lower()]
    if "g" in valid and _VELOCITY.fullmatch(unit):
        problem = f"{channel} is in {unit}, a velocity"
        raise InputFileError(file, problem, "differentiate it over time, and write it in m/s^2", line=line)
    # a unit that is near is another unit
    hint = next((f", did you mean {name!r}?" for name in valid if plain(name) == plain(unit)), "")
    listed = ", ".join({size: name for name, size in reversed(list(valid.items()))}.values())
    problem = f"unknown unit of the column {channel!r}: {shown(unit)!r}{hint} (valid: {listed})"
    raise InputFileError(file, problem, line=line)


def plain(unit: str) -> str:
    """A unit in one of its spellings."""
    return re.sub(r"[\W_]|(?<=s)ec", "", unit.lower().replace("²", "2"))


def volts_per_m_s2(file: Path, name: str, text: str) -> float:
    """Sensitivity in V per m/s^2 from a data sheet's "100 mV/g"."""
    try:
        number, unit, _, per = _SENSITIVITY.fullmatch(text).groups()  # type: ignore[union-attr]
        volts = float(number) * VOLTAGES[unit.lower()]
        if not 0 < abs(volts) < np.inf:
            raise ValueError
        return volts / (GRAVITY if per.lower() == "g" else 1.0)
    except (AttributeError, ValueError):
        place = f"channels.{name}.sensitivity = {text!r}"
        raise InputFileError(file, place, f"valid: {SENSITIVITIES}") from None


Channels = dict[str, np.ndarray]

#: The accelerometers of section 2.2.2; the first two are needed. Others are known by their unit, or by study.toml.
NAMES = ("base", "malleolus", "tuberosity")
#: Names of further sensors.
SENSOR_NAME = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")


@dataclass(frozen=True)
class Channel(Tabled):
    """One channel of study.toml.

    Attributes:
        column: its name in the files, or its number from 1; default the channel's name.
        unit: of the numbers, if the files state none or a wrong one.
        clock: the column of its times, if it has one.
        stated: what study.toml states of it.
        sign: +1 or -1.
        sensitivity: recorded unit per m/s^2, or in V per m/s^2 if `volts`.
        delay_s: how late it is.
        gain_std: relative standard uncertainty of the sensitivity, mounting included.
        delay_std_s: that of the delay.
    """

    column: str = ""
    unit: str = ""
    sign: float = 1.0
    sensitivity: float = 1.0
    volts: bool = False
    delay_s: float = 0.0
    gain_std: float = 0.0
    delay_std_s: float = 0.0
    clock: str = ""
    stated: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout(Tabled):
    """The channels of a study's files.

    Attributes:
        channels: by name, "time" included; those not listed are found by name and unit in the file.
        rate_hz: sampling rate of files that have no time.
        columns: names of the columns of text files without a header.
        units: of those columns, if known apart.
        beyond: measured or excluded by the laboratory beyond the recordings.
        take: which recording of a file with several, from 1.
        apart: patterns of file names, and the layout of the files that fit one.
    """

    channels: Mapping[str, Channel] = field(default_factory=dict)
    rate_hz: float | None = None
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    beyond: Known = field(default_factory=Known)
    take: int | None = None
    apart: tuple[tuple[str, "Layout"], ...] = field(default=(), repr=False)

    def one_of(self, file: Path, takes: "Sequence[_Take]") -> "_Take":
        """The take of study.toml, the first unless it names one."""
        if self.take is not None and self.take > len(takes):
            count = f"{len(takes)} takes" if len(takes) > 1 else "one take"
            raise InputFileError(file, f"holds {count}, and take {self.take} is asked for", "name another, or none")
        return takes[(self.take or 1) - 1]

    def of(self, file: Path) -> "Layout":
        """The layout of one file: that of the pattern that its name fits, else this one."""
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
        settings: FileTable | None = None,
        known: Mapping[str, Any] | None = None,
    ) -> "Layout":
        """From tables of study.toml.

        Args:
            file: of the study, for messages.
            tables: its [channels.*].
            rate_hz: sampling rate, where there are no settings.
            settings: those of [study] that are also those of [layouts.NAME].
            known: its [known].
        """
        channels = {}
        for name, table in tables.items():
            near = get_close_matches(name, (*NAMES, "time"), cutoff=0.75)
            is_sensor = SENSOR_NAME.fullmatch(name) and not near and table
            if name not in (*NAMES, "time") and not is_sensor:
                listed = f"valid: {', '.join(NAMES)}, time, or a sensor of the model, in small letters"
                raise InputFileError(file, f"describes the channel {name!r}", listed)
            channels[name] = _channel(file, name, table)
        settings = settings or validated(FileTable, file, {"sampling_rate_hz": rate_hz}, "study")
        for key in ("gain_std", "delay_std_s"):
            twice = [f"[channels.{name}]" for name, table in tables.items() if key in table]
            if key in (known or {}) and twice:
                problem = f"states {key} in [known] and in {', '.join(twice)}"
                raise InputFileError(file, problem, "keep one of them")
        beyond, columns = Known.from_toml(file, known or {}), tuple(settings.columns)
        return cls(channels, settings.sampling_rate_hz, columns, beyond=beyond, take=settings.take)

    def known(self, names: Sequence[str]) -> int:
        """How many of a line's cells are channels by their names, or begin the name of one."""
        columns = [c.column.strip().lower() for c in self.channels.values() if c.column]

        def is_one(name: str) -> bool:
            plain = name.strip().lower()
            begins = len(plain) > 2 and any(column.startswith(f"{plain} ") for column in columns)
            return {plain, name_and_unit(name)[0]} & {"time", *NAMES, *columns} != set() or begins

        return sum(map(is_one, names))

    def timed(self, file: Path, channels: Channels, rate_hz: float | None = None) -> Channels:
        """The channels with ``time_s``: that of the file, or counted from a sampling rate.

        Args:
            channels: with ``time_s``, with ``time`` of unknown unit, or without.
            rate_hz: sampling rate that the file states, unless study.toml overrules it.
        """
        rate = rate_hz or self.rate_hz
        channels = dict(channels)
        time = channels.pop("time", channels.get("time_s"))
        if time is None:
            if not rate:
                hint = Sentence("give ", called("sampling_rate_hz"))
                raise InputFileError(file, "has neither a time nor a sampling rate", hint)
            return {"time_s": np.arange(channels["base_m_s2"].size) / rate} | channels
        stated = (
            f"states {rate:.6g} Hz" if rate_hz else f"is said by study.toml to have sampling_rate_hz = {rate or 0:.6g}"
        )
        span = float(time[-1] - time[0]) if time.size > 1 else 0.0
        counted = (time.size - 1) / span if np.isfinite(span) and span > 0 else 0.0
        tolerance = max(_SAME_RATE, 2 / max(1, time.size))
        if "time_s" not in channels:
            units = [unit for unit in TIME_UNITS.values() if rate and abs(counted / unit / rate - 1) <= tolerance]
            if not units:
                raise InputFileError(
                    file, f"{stated}, and the steps of its time (without unit) are {1 / counted if counted else 0:.6g}",
                    "correct one of them, and name the column time_s, time_ms or time_us",
                )  # fmt: skip
            return {"time_s": time * units[0]} | channels
        if rate and counted and abs(counted / rate - 1) > tolerance:
            raise InputFileError(
                file, f"{stated}, and its time runs at {counted:.6g} Hz", "correct one of them, or delete the rate"
            )
        return channels

    def aligned(
        self, file: Path, channels: Channels, times: Mapping[str, np.ndarray] | None = None
    ) -> tuple[Channels, str]:
        """The channels on the fastest clock, known delays undone, over the time that all cover; and what that took.

        Splines of the seventh degree bring a sine from one clock to another: they are wrong by 2 (f / rate)^8.

        Args:
            channels: with ``time_s``, the base's clock.
            times: (n,) of the channels that have a separate clock [s].
        """
        t = channels["time_s"]
        delays = {f"{name}_m_s2": c.delay_s for name, c in self.channels.items() if name != "time" and c.delay_s}
        taken = {name: at - delays.get(name, 0.0) for name, at in (times or {}).items()}
        taken |= {name: t - delay for name, delay in delays.items() if name in channels and name not in taken}
        taken = {name: at for name, at in taken.items() if at.size != t.size or np.abs(at - t).max() > 1e-9}
        every = (t, *taken.values())
        if not taken or any(at.size < 2 or not np.isfinite(at).all() or np.diff(at).min() <= 0 for at in every):
            return channels, ""  # the checks refuse such a time
        first, last = max(at[0] for at in every), min(at[-1] for at in every)
        if last - first < (1 - _LONGEST_DELAY) * (t[-1] - t[0]):
            late = ", ".join(f"{name.removesuffix('_m_s2')} {t[0] - at[0]:.6g} s" for name, at in taken.items())
            starts = "the start times of its channels and " if times else ""
            raise InputFileError(
                file, f"lasts {t[-1] - t[0]:.4g} s, too short for {starts}delay_s of study.toml ({late})",
                f"valid: delays that leave {100 - 100 * _LONGEST_DELAY:.0f} % of a recording",
            )  # fmt: skip
        rates = {name: rate_of(taken.get(name, t)) for name in channels if name != "time_s"}
        fast = max(rates, key=lambda name: rates[name])
        slow = {name: rate for name, rate in rates.items() if rate < (1 - _SAME_CLOCK) * rates[fast]}
        listed = ", ".join(f"{name.removesuffix('_m_s2')} at {rate:.6g} Hz" for name, rate in rates.items())
        if any(channels[name].size == channels[fast].size for name in slow):
            raise InputFileError(
                file, f"its channels have different rates ({listed}) and as many samples: a clock is wrong",
                "correct it, or resample them to one rate",
            )  # fmt: skip
        if slow and fast in taken:
            taken |= {name: t for name in rates if name not in taken}
            t = taken.pop(fast)
        if slow:  # where splines end they swing
            edge = min(_SWINGS, _SWINGING * min(channels[name].size for name in slow)) / min(slow.values())
            first, last = first + edge, last - edge
        rounding = 1e-9 * (t[-1] - t[0])
        covered = t[(t >= first - rounding) & (t <= last + rounding)]
        made = {name: _brought(taken.get(name, t), values, covered) for name, values in channels.items()
                if name != "time_s"}  # fmt: skip
        remark = (
            f"its channels have different rates ({listed}), resampled to the highest by a spline, with an error of "
            f"less than 0.1 % below {min(slow.values()) / 2.6:.3g} Hz"
        ) if slow else ""  # fmt: skip
        return {"time_s": covered} | made, remark


_Take = TypeVar("_Take")


def _brought(time_s: np.ndarray, values: np.ndarray, to_s: np.ndarray) -> np.ndarray:
    """Values (n,) at other times, by a spline unless they are so large that it would overflow."""
    from scipy.interpolate import make_interp_spline

    if values.size != time_s.size or np.abs(values).max() >= _SPLINED:
        return values[: to_s.size]
    places = np.searchsorted(time_s, to_s).clip(max=time_s.size - 1)
    if np.array_equal(time_s[places], to_s):
        return values[places]
    order = next(k for k in (7, 5, 3, 1) if values.size > 2 * k or k == 1)
    return make_interp_spline(time_s, values, order)(to_s.clip(time_s[0], time_s[-1]))


#: Two clocks run alike within this share: crystals do, and sensors that send by radio nearly.
_SAME_CLOCK = 1e-2
#: Slow samples at each end that a spline gives wrong, and the share of them that is given up at most.
_SWINGS, _SWINGING = 8, 0.05
#: Larger numbers are of no body and overflow a spline; the checks refuse them, and what is no number.
_SPLINED = 1e100
#: Delays may take this share of a recording.
_LONGEST_DELAY = 0.1
#: Two sampling rates are the same within this share: a nominal rate and a logger's clock.
_SAME_RATE = 1e-3


def _channel(file: Path, name: str, stated: object) -> Channel:
    table = validated(ChannelTable, file, stated, f"channels.{name}")
    about = table.model_dump(exclude_none=True)
    if isinstance(table.sensitivity, str):
        about |= {"sensitivity": volts_per_m_s2(file, name, table.sensitivity), "volts": True}
    if isinstance(table.column, int):
        about["column"] = f"#{table.column}"
    if table.unit and (name == "time" or not RAW.fullmatch(table.unit)):
        factor(file, name, table.unit, TIME_UNITS if name == "time" else ACCELERATIONS | VOLTAGES)
    return Channel(**about, stated=tuple(sorted(table.model_fields_set)))
