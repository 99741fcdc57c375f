"""Recordings from CSV files, whatever their columns are called, and from study folders."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd

from fasbody.exceptions import InputFileError, RecordingError, unknown
from fasbody.recording.channels import TIME_UNITS
from fasbody.recording.study import Study
from identification.blackbox.data import INPUT_OUTPUT, Series, find_fault, find_problem, from_recording

#: A header of time, alone or with a unit: time_s, "Time (ms)", t [us], timestamp.
TIME_HEADER = re.compile(r"(?:time\s*stamp|time|t)(?:[\s_.,:/\[(]+(?P<unit>\w+)[\s\])]*)?", re.IGNORECASE)
UNNAMED = "column {}"  # of a file without a header
INPUT_NAMES = (INPUT_OUTPUT[0], "u", "input")
OUTPUT_NAMES = (INPUT_OUTPUT[1], "y", "output")


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
    first column that rises from row to row is never taken for the input unless asked for.

    Args:
        path: the file; the first row may name the columns.
        input: name or 1-based number of the input column; default: a usual name, else the first after time.
        output: the same for the output; default: a usual name, else the one after the input.
        sample_time: seconds; default: from the time column.

    Raises:
        InputFileError: the file, a column or the time column cannot be used.
        RecordingError: the signals cannot identify anything.
    """
    table = _table(path)
    names = [str(name) for name in table.columns]
    time_name, unit = _time_column(path, table, names, sample_time)
    signals = [name for name in names if name != time_name]
    input_name = _column(path, names, signals, input, INPUT_NAMES, "input")
    others = [name for name in signals if name != input_name]
    output_name = _column(path, names, others, output, OUTPUT_NAMES, "output")
    if sample_time is None:
        if time_name is None:
            raise InputFileError(path, "has no time column", "name one 'time_s' or give --sample-time in seconds")
        sample_time = _sample_time(path, _numbers(path, table, time_name) * unit)
    u, y = _numbers(path, table, input_name), _numbers(path, table, output_name)
    problem = find_fault(u, y, sample_time) or find_problem(u, y)
    if problem:
        raise RecordingError(f"{path}: {problem}.")
    return Series(u, y, sample_time, path.stem, (input_name, output_name))


def _time_column(
    path: Path, table: pd.DataFrame, names: list[str], sample_time: float | None
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
    first = pd.to_numeric(table[names[0]], errors="coerce").to_numpy(dtype=float)
    if len(first) < 3 or not np.all(np.diff(first) > 0):
        return None, 1.0
    if sample_time is None and names[0] != UNNAMED.format(1):
        raise InputFileError(
            path, f"its first column {names[0]!r} rises from row to row as a time does, but has no known name or unit",
            "call it time_s, time_ms or time_us, or give --sample-time in seconds",
        )  # fmt: skip
    return names[0], 1.0


def _table(path: Path) -> pd.DataFrame:
    try:
        with path.open(encoding="utf-8-sig") as file:
            first = file.readline()
        cells = [cell.strip() for cell in first.replace(";", ",").replace("\t", ",").split(",")]
        separator = next((mark for mark in (";", "\t") if mark in first), ",")
        headed = not all(_is_number(cell) for cell in cells if cell)
        table = pd.read_csv(path, sep=separator, header=0 if headed else None, skipinitialspace=True, comment="#")
    except (OSError, UnicodeDecodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0].rstrip(".")
        raise InputFileError(path, f"cannot be read as CSV ({reason})", "give rows of numbers") from error
    if not headed:
        table.columns = [UNNAMED.format(number) for number in range(1, table.shape[1] + 1)]
    if not isinstance(table.index, pd.RangeIndex):
        raise InputFileError(
            path, "its rows have more cells than its header",
            "write decimal points where there are decimal commas, or separate the columns by semicolons",
        )  # fmt: skip
    return table.rename(columns=lambda name: str(name).strip())


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _column(path: Path, names: list[str], free: list[str], asked: str, usual: tuple[str, ...], role: str) -> str:
    if asked:
        if asked in names:
            return asked
        if asked.isdigit() and 1 <= int(asked) <= len(names):
            return names[int(asked) - 1]
        raise InputFileError(path, unknown(f"{role} column", asked, names))
    for name in usual:
        if name in free:
            return name
    if not free:
        raise InputFileError(path, f"has no column left for the {role}", "two signals are needed, input and output")
    return free[0]


def _numbers(path: Path, table: pd.DataFrame, name: str) -> np.ndarray:
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
    wrong = np.isnan(values) & table[name].notna().to_numpy()
    if wrong.any():
        row = int(np.argmax(wrong))
        cell = str(table[name].iloc[row])
        comma = _is_number(cell.replace(",", ".", 1))
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
