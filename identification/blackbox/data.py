"""Inputs, outputs and sample time of one recording, checked: from arrays, any CSV file or a study folder."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Self

import numpy as np

from fasbody.exceptions import InputFileError, RecordingError, SettingError, unknown
from fasbody.presentation import Tabled, counted
from fasbody.recording import text
from fasbody.recording.channels import TIME_UNITS, Layout
from fasbody.recording.csv import TextTable
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study

MEASURED = 1e100  # what no sensor measures, and whose square is no number
SLOW = 1.0  # sample time [s] from which a time column without unit may be in another one
SHORTEST = 20  # samples; below this not even a first-order model can be validated
#: Structures that can be estimated, and those that are unless others are named.
ALL = ("arx", "armax", "bj", "oe", "ss", "hw", "narx")
DEFAULT = ("arx", "armax", "oe", "bj", "ss", "hw")
INPUT_OUTPUT = ("base_m_s2", "malleolus_m_s2")  # of a foot's recording
#: A header of time, alone or with a unit: time_s, "Time (ms)", t [us], timestamp.
TIME_HEADER = re.compile(r"(?:time\s*stamp|time|t)(?:[\s_.,:/\[(]+(?P<unit>\w+)[\s\])]*)?", re.IGNORECASE)
#: A column of a file without a header, by its number.
UNNAMED = "column {}"
INPUT_NAMES = (INPUT_OUTPUT[0], "u", "input")
OUTPUT_NAMES = (INPUT_OUTPUT[1], "y", "output")
Names = str | tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Series(Tabled):
    """One recording of a system with one input and one output, or with several.

    Attributes:
        u: input, shape (N,); several, shape (N, m).
        y: output, shape (N,); several, shape (N, p).
        sample_time: seconds between samples.
        name: what to call it in tables and messages.
        channels: name of the input and of the output; a tuple of names where there are several.
        part: whether it was cut from a whole recording, which alone must be excited: a step or a
            pulse leaves parts without excitation.
        remarks: sentences on how it was read.

    Raises:
        RecordingError: the arrays cannot identify anything; one sentence states why.

    Example:
        >>> u = np.random.default_rng(0).standard_normal(200)
        >>> len(Series(u, np.convolve(u, [0.0, 1.0, 0.5])[:200], sample_time=0.01))
        200
    """

    u: np.ndarray
    y: np.ndarray
    sample_time: float
    name: str = "recording"
    channels: tuple[Names, Names] = ("input", "output")
    part: bool = False
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Keep the arrays as read-only floats and check them."""
        for field in ("u", "y"):
            values = np.array(getattr(self, field), dtype=float)
            values.setflags(write=False)
            object.__setattr__(self, field, values)
        problem = self._fault() or ("" if self.part else self._useless())
        if problem:
            raise RecordingError(f"{self.name}: {problem}.")

    def __len__(self) -> int:
        return len(self.u)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return _tuple(self.channels[0])

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return _tuple(self.channels[1])

    @property
    def time(self) -> np.ndarray:
        """Seconds from the first sample, shape (N,)."""
        return np.arange(len(self)) * self.sample_time

    def cut(self, start: int, stop: int) -> Self:
        """The samples from `start` up to, not including, `stop`."""
        return replace(self, u=self.u[start:stop], y=self.y[start:stop], part=True)

    def split(self, fraction: float = 0.5) -> tuple[Self, Self]:
        """The first `fraction` for estimation and the rest for validation.

        Both are less the means of the first.

        Raises:
            SettingError: `fraction` leaves one part shorter than any model needs.
            RecordingError: the input does nothing in the first part, or the output in one of them.
        """
        middle = round(fraction * len(self))
        if not SHORTEST <= middle <= len(self) - SHORTEST:
            raise SettingError(
                f"split {fraction:g} of {len(self)} samples leaves a part with fewer than "
                f"{SHORTEST} samples; choose a fraction nearer to 0.5 or a longer recording.",
                setting="split",
            )
        u, y = self.u - self.u[:middle].mean(axis=0), self.y - self.y[:middle].mean(axis=0)
        for signal, role, first, last, part, other in (
            (u, "input", 0, middle, "estimation", "larger"),
            (y, "output", 0, middle, "estimation", "larger"),
            (y, "output", middle, len(self), "held-out", "smaller"),
        ):
            if any(map(_constant, _columns(signal[first:last]))):
                raise RecordingError(
                    f"{self.name}: the {role} is constant in the {part} part (samples {first + 1} "
                    f"to {last} of {len(self)}), though not in the whole record; choose a {other} "
                    f"--split than {fraction:g}."
                )
        centred = replace(self, u=u, y=y)
        return centred.cut(0, middle), centred.cut(middle, len(self))

    def pairs(self) -> list[Self]:
        """Each output with each input as a recording of its own, the outputs one after another."""
        u, y = _columns(self.u), _columns(self.y)
        return [
            replace(self, u=u[j], y=y[i], channels=(name, output), part=True)
            for i, output in enumerate(self.outputs) for j, name in enumerate(self.inputs)
        ]  # fmt: skip

    def centred(self) -> Self:
        """The recording less its means: linear models describe motion about the mean."""
        return replace(self, u=self.u - self.u.mean(axis=0), y=self.y - self.y.mean(axis=0))

    def _labels(self) -> list[str]:
        """What sentences call each signal: input, or output 'knee'."""
        named = [("input", name) for name in self.inputs] + [("output", n) for n in self.outputs]
        return [role if name == role else f"{role} {name!r}" for role, name in named]

    def _fault(self) -> str:
        """What makes these arrays no recording at all, as a clause; empty where nothing does."""
        u, y = self.u, self.y
        if min(u.ndim, y.ndim) < 1 or max(u.ndim, y.ndim) > 2 or len(u) != len(y):
            return f"input and output must be two columns of equal length, not of shapes {u.shape} and {y.shape}"
        if not (np.isfinite(self.sample_time) and self.sample_time > 0):
            return f"the sample time must be a positive number of seconds, not {self.sample_time}"
        if len(u) < SHORTEST:
            return f"{len(u)} samples are too few; at least {SHORTEST} are needed"
        for label, signal in zip(self._labels(), (*_columns(u), *_columns(y)), strict=True):
            missing = np.flatnonzero(~(np.abs(signal) < MEASURED))
            if len(missing) == len(signal):
                return (
                    f"the {label} has no finite number in {len(signal)} samples; name another column or check the file"
                )
            if len(missing):
                at, value = missing[0] + 1, signal[missing[0]]
                what = f"{value:g}, which nothing measures," if np.isfinite(value) else "not a finite number"
                many = f"({len(missing)} of {len(signal)})"
                return f"the {label} is {what} at sample {at} {many}; cut or mend the gap first"
        return ""

    def _useless(self) -> str:
        """What makes a sound whole recording useless for identification, as a clause."""
        inputs, outputs, labels = _columns(self.u), _columns(self.y), self._labels()
        names = (*self.inputs, *self.outputs)
        if len({*names}) < len(names):
            return f"a signal is named twice in {', '.join(names)}; name each once"
        for label, signal in zip(labels, inputs, strict=False):
            if _constant(signal):
                value = f"({signal[0]:g} in all {len(signal)} samples)"
                how = f"constant {value}" if signal.any() else "zero throughout: an output without input"
                return (
                    f"the {label} is {how}, so no response to it can be seen; name the column of "
                    "what was moved, or record while it moves"
                )
        for label, signal in zip(labels[len(inputs) :], outputs, strict=True):
            if _constant(signal):
                return (
                    f"the {label} is constant ({signal[0]:g} in all {len(signal)} samples), so it "
                    "shows no response; check the sensor and the column"
                )
            if any(np.array_equal(signal, u) for u in inputs):
                return "input and output are the same signal; name two different columns or sensors"
            if _grows(signal, 1.2) and not any(_grows(u, 1.1) for u in inputs):
                return (
                    f"the {label} grows from beginning to end while the input does not, as of an "
                    "unstable system; free simulation cannot be judged on it, so cut the recording "
                    "to its stationary part"
                )
        return ""


def listed(recordings: Series | Sequence[Series]) -> list[Series]:
    """One recording or many, as a list."""
    return [recordings] if isinstance(recordings, Series) else list(recordings)


def _tuple(names: Names) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else names


def _columns(signals: np.ndarray) -> Sequence[np.ndarray]:
    return [signals] if signals.ndim == 1 else list(signals.T)


def _constant(signal: np.ndarray) -> bool:
    return bool(np.ptp(signal) <= 1e-12 * np.abs(signal).max(initial=1e-300))


def _grows(signal: np.ndarray, factor: float) -> bool:
    """Whether the level of a signal (N,) rises by `factor` or more in every tenth of the record."""
    size = len(signal) // 10
    blocks = signal[: 10 * size].reshape(10, size) - signal[:size].mean()
    level = np.sqrt(np.mean(blocks**2, axis=1))
    return bool(np.all(level[1:] > factor * np.maximum(level[:-1], 1e-300)))


def from_recording(recording: Recording) -> Series:
    """A foot's recording as a system from base to malleolus acceleration."""
    name, seconds = Path(recording.file).stem, 1 / recording.rate_hz
    return Series(recording.base_m_s2, recording.malleolus_m_s2, seconds, name, INPUT_OUTPUT)


def read(path: Path, *, input: str = "", output: str = "", sample_time: float | None = None) -> list[Series]:
    """Every recording at `path`: a CSV file, or a study folder (base to malleolus).

    Raises:
        InputFileError: nothing readable is there.
    """
    if path.is_dir():
        return [from_recording(recording) for recording in Study.read(path)]
    return [read_csv(path, input=input, output=output, sample_time=sample_time)]


def read_csv(path: Path, *, input: str = "", output: str = "", sample_time: float | None = None) -> Series:
    """A `Series` from a CSV file with named columns, or with two (input, output) or three.

    A column called time or t gives the sample time, in the unit its name carries (s, ms or us; seconds without one). A
    first column that rises from row to row is never taken for the input unless named.

    Args:
        path: the file; the first row may name the columns.
        input: name or 1-based number of the input column, several with commas; default: a usual
            name, else the first after time.
        output: the same for the output; default: a usual name, else the one after the input.
        sample_time: seconds; default: from the time column.

    Raises:
        InputFileError: the file, a column or the time column cannot be used.
        RecordingError: the signals cannot identify anything.
    """
    table = TextTable.open(path, Layout(), strict=False)
    if not table.names:  # no header
        unnamed = (UNNAMED.format(n + 1) for n in range(len(table.first_row)))
        table = TextTable.open(path, Layout(columns=tuple(unnamed)), strict=False)
    names = list(table.names)
    time_name, unit = _time_column(table, names, sample_time)
    signals = [name for name in names if name != time_name]
    if not (input and output) and len(signals) > 2 and not {*INPUT_OUTPUT} <= {*signals}:
        _never_guess(path, signals, input, output)
    u_names = _chosen(path, names, signals, input, INPUT_NAMES, "input")
    others = [name for name in signals if name not in _tuple(u_names)]
    y_names = _chosen(path, names, others, output, OUTPUT_NAMES, "output")
    remarks: tuple[str, ...] = ()
    if sample_time is None:
        if time_name is None:
            valid = "name one 'time_s' or give --sample-time in seconds"
            raise InputFileError(path, "has no time column", valid)
        sample_time = _sample_time(table, _numbers(table, time_name) * unit)
        header = TIME_HEADER.fullmatch(time_name)
        if sample_time >= SLOW and not (header and header["unit"]):
            remarks = (f"{time_name!r} is read as seconds, {1 / sample_time:.3g} Hz; --sample-time overrides it",)
    u, y = _numbers(table, u_names), _numbers(table, y_names)
    whole = Series(u, y, sample_time, str(path), (u_names, y_names), remarks=remarks)
    return replace(whole, name=path.stem)


def _never_guess(path: Path, signals: list[str], input: str, output: str) -> None:
    """Refuse a file with more signals than two when the names do not identify them."""
    known = [option or {*usual} & {*signals} for option, usual in (
        (input, INPUT_NAMES), (output, OUTPUT_NAMES),
    )]  # fmt: skip
    if all(known):
        return
    u = [name for name in signals if re.fullmatch(r"(?:u|in|input)[\s_]?\d+", name, re.IGNORECASE)]
    y = [n for n in signals if re.fullmatch(r"(?:y|out|output)[\s_]?\d+", n, re.IGNORECASE)]
    example = f"--input {','.join(u)} --output {','.join(y)}" if u and y else "--input and --output"
    listing = ", ".join(signals[:8])
    raise InputFileError(
        path, f"has {len(signals)} signals ({listing}), and it does not say which is the input",
        f"name them: {example}",
    )  # fmt: skip


def _time_column(table: TextTable, names: list[str], sample_time: float | None) -> tuple[str | None, float]:
    """Name of the time column and its unit in seconds."""
    for name in names:
        header = TIME_HEADER.fullmatch(name)
        if header:
            unit = (header["unit"] or "s").lower().replace("µ", "u").replace("sec", "s")
            if unit not in TIME_UNITS and sample_time is None:
                sentence = unknown(f"unit of the time column {name!r}:", unit, TIME_UNITS)
                raise InputFileError(table.file, sentence, "or give --sample-time in seconds")
            return name, TIME_UNITS.get(unit, 1.0)
    try:
        first = _numbers(table, names[0])
    except InputFileError:  # words
        return None, 1.0
    if len(first) < 3 or not np.all(np.diff(first) > 0):
        return None, 1.0
    if sample_time is None and names[0] != UNNAMED.format(1):
        raise InputFileError(
            table.file,
            f"its first column {names[0]!r} rises from row to row as a time does, but has no known name or unit",
            "call it time_s, time_ms or time_us, or give --sample-time in seconds",
        )
    return names[0], 1.0


def _chosen(path: Path, names: list[str], free: list[str], option: str, usual: tuple[str, ...], role: str) -> Names:
    """The column that an option names, or the columns; without one a usual or the first free."""
    if option in names:
        return option
    if "," in option:
        every = [part.strip() for part in option.split(",") if part.strip()]
        return tuple(str(_chosen(path, names, free, one, usual, role)) for one in every)
    if option.isdigit() and 1 <= int(option) <= len(names):
        return names[int(option) - 1]
    if option:
        raise InputFileError(path, unknown(f"{role} column", option, names))
    if not free:
        valid = "two signals are needed, input and output"
        raise InputFileError(path, f"has no column left for the {role}", valid)
    return next((name for name in usual if name in free), free[0])


def _numbers(table: TextTable, name: Names) -> np.ndarray:
    chosen = _tuple(name)
    with np.errstate(over="ignore", invalid="ignore"):  # 1e308 times a thousand; refused below
        columns = table.numbers({one: table.names.index(one) for one in chosen})
    for one, values in columns.items():
        huge = np.flatnonzero(np.abs(values) >= MEASURED)
        if len(huge):
            problem = f"{one} is {values[huge[0]]:g}, which nothing measures"
            raise InputFileError(table.file, problem, "correct it or cut it off", _line(table, huge[0]))
    return columns[name] if isinstance(name, str) else np.column_stack([columns[n] for n in chosen])


def _line(table: TextTable, row: int) -> int:
    """Number of the line of a file with a row (from 0) of its numbers."""
    separator = table.headings.separator
    lines = (line for after, body in table.bodies() for line, _ in text.rows(table.file, body, separator, after))
    return next(islice(lines, int(row), None))


def _sample_time(table: TextTable, time: np.ndarray) -> float:
    steps = np.diff(time)
    if not len(steps):
        raise InputFileError(table.file, f"has {counted(len(time), 'row')} of numbers", f"{SHORTEST} are needed")
    back = ~(steps > 0)
    if back.any():
        k = int(np.argmax(back)) + 1
        problem = f"its time column does not increase from row to row: {time[k]:.9g} s after {time[k - 1]:.9g} s"
        raise InputFileError(table.file, problem, "give --sample-time instead", _line(table, k))
    step, usual = float((time[-1] - time[0]) / len(steps)), float(np.median(steps))
    if np.abs(steps - step).max() > 0.01 * step + 2e-6:  # 2 us: times written with few decimals
        k = int(np.argmax(np.abs(steps - usual))) + 1
        problem = f"is not sampled uniformly: a step of {steps[k - 1]:.4g} s, where {usual:.4g} s is usual"
        raise InputFileError(table.file, problem, "resample it, or give --sample-time if it is", _line(table, k))
    return step
