"""Input, output and sample time of one recording, checked: from arrays, any CSV file or a study folder."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from fasbody.exceptions import InputFileError, RecordingError, SettingError, unknown
from fasbody.presentation import Tabled
from fasbody.recording.channels import TIME_UNITS
from fasbody.recording.csv import UNNAMED, numeric, read_columns
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study

if TYPE_CHECKING:
    import pandas as pd

SHORTEST = 20  # samples; below this not even a first-order model and its initial state can be validated
#: Structures that can be estimated, and those that are unless others are named.
ALL = ("arx", "armax", "bj", "oe", "ss", "hw", "narx")
DEFAULT = ("arx", "armax", "oe", "bj", "ss", "hw")
INPUT_OUTPUT = ("base_m_s2", "malleolus_m_s2")  # of a foot's recording
#: A header of time, alone or with a unit: time_s, "Time (ms)", t [us], timestamp.
TIME_HEADER = re.compile(r"(?:time\s*stamp|time|t)(?:[\s_.,:/\[(]+(?P<unit>\w+)[\s\])]*)?", re.IGNORECASE)
INPUT_NAMES = (INPUT_OUTPUT[0], "u", "input")
OUTPUT_NAMES = (INPUT_OUTPUT[1], "y", "output")


@dataclass(frozen=True, eq=False)
class Series(Tabled):
    """One recording of a single-input single-output system.

    Attributes:
        u: input, shape (N,).
        y: output, shape (N,).
        sample_time: seconds between samples.
        name: what to call it in tables and messages.
        channels: names of input and output.
        part: whether it was cut from a whole recording, which alone must be excited: a step or a pulse
            leaves parts without excitation.

    Raises:
        RecordingError: the arrays cannot identify anything; one sentence states why.
    """

    u: np.ndarray
    y: np.ndarray
    sample_time: float
    name: str = "recording"
    channels: tuple[str, str] = ("input", "output")
    part: bool = False

    def __post_init__(self) -> None:
        """Keep the arrays as read-only floats and check them."""
        for field in ("u", "y"):
            values = np.array(getattr(self, field), dtype=float)
            values.setflags(write=False)
            object.__setattr__(self, field, values)
        roles = ("input", "output")
        names = [role if role == name else f"{role} {name!r}" for role, name in zip(roles, self.channels, strict=True)]
        problem = _fault(self.u, self.y, self.sample_time, names)
        problem = problem or ("" if self.part else _problem(self.u, self.y, names))
        if problem:
            raise RecordingError(f"{self.name}: {problem}.")

    def __len__(self) -> int:
        return len(self.u)

    @property
    def time(self) -> np.ndarray:
        """Seconds from the first sample, shape (N,)."""
        return np.arange(len(self)) * self.sample_time

    def cut(self, start: int, stop: int) -> Self:
        """The samples from `start` up to, not including, `stop`."""
        return replace(self, u=self.u[start:stop], y=self.y[start:stop], part=True)

    def split(self, fraction: float = 0.5) -> tuple[Self, Self]:
        """The first `fraction` for estimation and the rest for validation, both less the means of the first.

        Raises:
            SettingError: `fraction` leaves one part shorter than any model needs.
            RecordingError: the input does nothing in the first part, or the output nothing in one of them.
        """
        middle = split_point(len(self), fraction)
        u_mean, y_mean = self.u[:middle].mean(), self.y[:middle].mean()
        centred = replace(self, u=self.u - u_mean, y=self.y - y_mean)
        parts = centred.cut(0, middle), centred.cut(middle, len(self))
        for silent, label in (
            (_constant(self.u[:middle]), "input is constant in the estimation part"),
            (_constant(self.y[:middle]), "output is constant in the estimation part"),
            (_constant(self.y[middle:]), "output is constant in the held-out part"),
        ):
            if silent:
                first, last = (1, middle) if "estimation" in label else (middle + 1, len(self))
                other = "smaller" if "held-out" in label else "larger"
                raise RecordingError(
                    f"{self.name}: the {label} (samples {first} to {last} of {len(self)}), though not in the whole "
                    f"record; choose a {other} --split than {fraction:g}."
                )
        return parts

    def centred(self) -> Self:
        """The recording less its means: linear models describe motion about the mean."""
        return replace(self, u=self.u - self.u.mean(), y=self.y - self.y.mean())


def split_point(samples: int, fraction: float) -> int:
    """The first sample of the held-out part.

    Raises:
        SettingError: `fraction` leaves one part shorter than any model needs.
    """
    middle = round(fraction * samples)
    if not SHORTEST <= middle <= samples - SHORTEST:
        raise SettingError(
            f"split {fraction:g} of {samples} samples leaves a part with fewer than {SHORTEST} samples; "
            "choose a fraction nearer to 0.5 or a longer recording."
        )
    return middle


def _constant(signal: np.ndarray) -> bool:
    return bool(np.ptp(signal) <= 1e-12 * np.abs(signal).max(initial=1e-300))


def not_finite(name: str, signal: np.ndarray) -> str:
    """Where a signal (N,) is no finite number, and what to do, as a clause; empty where all are."""
    finite = np.isfinite(signal)
    if finite.all():
        return ""
    if not finite.any():
        return f"{name} has no finite number in {len(signal)} samples; name another column or check the file"
    first, count = int(np.argmin(finite)) + 1, len(signal) - int(finite.sum())
    return f"{name} is not a finite number at sample {first} ({count} of {len(signal)}); cut or mend the gap first"


def _fault(u: np.ndarray, y: np.ndarray, sample_time: float, names: Sequence[str]) -> str:
    """What makes these arrays (N,) no recording at all, as a clause, or an empty string."""
    if u.ndim != 1 or u.shape != y.shape:
        return f"input and output must be two columns of equal length, not of shapes {u.shape} and {y.shape}"
    if not (np.isfinite(sample_time) and sample_time > 0):
        return f"the sample time must be a positive number of seconds, not {sample_time}"
    if len(u) < SHORTEST:
        return f"{len(u)} samples are too few; at least {SHORTEST} are needed"
    return not_finite(f"the {names[0]}", u) or not_finite(f"the {names[1]}", y)


def _problem(u: np.ndarray, y: np.ndarray, names: Sequence[str]) -> str:
    """What makes a sound whole recording (N,) useless for identification, as a clause, or an empty string."""
    if _constant(u):
        what = f"constant ({u[0]:g} in all {len(u)} samples)" if u.any() else "zero throughout: an output without input"
        return (
            f"the {names[0]} is {what}, so no response to it can be seen; name the column of what was moved, or record "
            "while it moves"
        )
    if _constant(y):
        return (
            f"the {names[1]} is constant ({y[0]:g} in all {len(y)} samples), so it shows no response; check the sensor "
            "and the column"
        )
    if np.array_equal(u, y):
        return "input and output are the same signal; name two different columns or sensors"
    if _grows_without_bound(u, y):
        return (
            "the output grows from beginning to end while the input does not, as of an unstable system; free "
            "simulation cannot be judged on it, so cut the recording to its stationary part"
        )
    return ""


def _grows_without_bound(u: np.ndarray, y: np.ndarray) -> bool:
    """Whether the output's level rises by a fifth or more in every tenth of the record, the input's not."""
    blocks = 10
    size = len(y) // blocks
    levels = [
        np.sqrt(np.mean((signal[: blocks * size].reshape(blocks, size) - signal[:size].mean()) ** 2, axis=1))
        for signal in (y, u)
    ]
    growth = [level[1:] / np.maximum(level[:-1], 1e-300) for level in levels]
    return bool(np.all(growth[0] > 1.2) and not np.all(growth[1] > 1.1))


def from_recording(recording: Recording) -> Series:
    """A foot's recording as a system from base to malleolus acceleration."""
    name = Path(recording.file).stem
    return Series(recording.base_m_s2, recording.malleolus_m_s2, 1 / recording.rate_hz, name, INPUT_OUTPUT)


def read(path: Path, *, input: str = "", output: str = "", sample_time: float | None = None) -> list[Series]:
    """Every recording at `path`: a CSV file, or a study folder (base to malleolus).

    Raises:
        InputFileError: nothing readable is there.
    """
    if path.is_dir():
        return [from_recording(recording) for recording in Study.read(path)]
    return [read_csv(path, input=input, output=output, sample_time=sample_time)]


def read_csv(path: Path, *, input: str = "", output: str = "", sample_time: float | None = None) -> Series:
    """A `Series` from a CSV file with named columns, or with two (input, output) or three (time first) columns.

    A column called time or t gives the sample time, in the unit its name carries (s, ms or us; seconds without one). A
    first column that rises from row to row is never taken for the input unless named.

    Args:
        path: the file; the first row may name the columns.
        input: name or 1-based number of the input column; default: a usual name, else the first after time.
        output: the same for the output; default: a usual name, else the one after the input.
        sample_time: seconds; default: from the time column.

    Raises:
        InputFileError: the file, a column or the time column cannot be used.
        RecordingError: the signals cannot identify anything.
    """
    table = read_columns(path)
    names = list(table.columns)
    time_name, unit = _time_column(path, table, names, sample_time)
    signals = [name for name in names if name != time_name]
    if not (input and output) and len(signals) > 2 and not {*INPUT_OUTPUT} <= {*signals}:
        _never_guess(path, signals, input, output)
    input_name = _column(path, names, signals, input, INPUT_NAMES, "input")
    others = [name for name in signals if name != input_name]
    output_name = _column(path, names, others, output, OUTPUT_NAMES, "output")
    if sample_time is None:
        if time_name is None:
            raise InputFileError(path, "has no time column", "name one 'time_s' or give --sample-time in seconds")
        sample_time = _sample_time(path, _numbers(path, table, time_name) * unit)
    u, y = _numbers(path, table, input_name), _numbers(path, table, output_name)
    return replace(Series(u, y, sample_time, str(path), (input_name, output_name)), name=path.stem)


def _never_guess(path: Path, signals: list[str], input: str, output: str) -> None:
    """Refuse a file with more signals than two when the names do not identify them."""
    if (input or {*INPUT_NAMES} & {*signals}) and (output or {*OUTPUT_NAMES} & {*signals}):
        return
    u = [name for name in signals if re.fullmatch(r"(?:u|in|input)[\s_]?\d+", name, re.IGNORECASE)]
    y = [name for name in signals if re.fullmatch(r"(?:y|out|output)[\s_]?\d+", name, re.IGNORECASE)]
    example = f"--input {','.join(u)} --output {','.join(y)}" if u and y else "--input and --output"
    raise InputFileError(
        path, f"has {len(signals)} signals ({', '.join(signals[:8])}), and it does not say which is the input",
        f"name them: {example}",
    )  # fmt: skip


def _time_column(
    path: Path, table: "pd.DataFrame", names: list[str], sample_time: float | None
) -> tuple[str | None, float]:
    """Name of the time column and its unit in seconds."""
    for name in names:
        header = TIME_HEADER.fullmatch(name)
        if header:
            unit = (header["unit"] or "s").lower().replace("µ", "u").replace("sec", "s")
            if unit in TIME_UNITS:
                return name, TIME_UNITS[unit]
            if sample_time is None:
                sentence = unknown(f"unit of the time column {name!r}:", unit, TIME_UNITS)
                raise InputFileError(path, sentence, "or give --sample-time in seconds")
            return name, 1.0
    import pandas as pd

    first = pd.to_numeric(table[names[0]], errors="coerce").to_numpy(dtype=float)
    if len(first) < 3 or not np.all(np.diff(first) > 0):
        return None, 1.0
    if sample_time is None and names[0] != UNNAMED.format(1):
        raise InputFileError(
            path, f"its first column {names[0]!r} rises from row to row as a time does, but has no known name or unit",
            "call it time_s, time_ms or time_us, or give --sample-time in seconds",
        )  # fmt: skip
    return names[0], 1.0


def _column(path: Path, names: list[str], free: list[str], option: str, usual: tuple[str, ...], role: str) -> str:
    if option:
        if option in names:
            return option
        if option.isdigit() and 1 <= int(option) <= len(names):
            return names[int(option) - 1]
        raise InputFileError(path, unknown(f"{role} column", option, names))
    for name in usual:
        if name in free:
            return name
    if not free:
        raise InputFileError(path, f"has no column left for the {role}", "two signals are needed, input and output")
    return free[0]


def _numbers(path: Path, table: "pd.DataFrame", name: str) -> np.ndarray:
    import pandas as pd

    values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
    wrong = np.isnan(values) & table[name].notna().to_numpy()
    if wrong.any():
        row = int(np.argmax(wrong))
        cell = str(table[name].iloc[row])
        comma = numeric(cell)
        remedy = "write it with a decimal point" if comma else "remove the row or mark it with #"
        raise InputFileError(path, f"column {name!r} holds {cell[:40]!r} in data row {row + 1}, not a number", remedy)
    return values


def _sample_time(path: Path, time: np.ndarray) -> float:
    steps = np.diff(time)
    if len(steps) == 0 or not np.isfinite(steps).all() or steps.min() <= 0:
        raise InputFileError(path, "its time column does not increase from row to row", "give --sample-time instead")
    step = float((time[-1] - time[0]) / len(steps))
    if np.abs(steps - step).max() > 0.01 * step + 2e-6:  # 2 us: times written with few decimals
        raise InputFileError(path, "is not sampled uniformly", "resample it, or give --sample-time if it is")
    return step
