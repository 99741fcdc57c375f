"""Long tables: a row is one sample of one sensor, as InfluxDB and R's melt write them."""

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from fasbody.exceptions import InputFileError, shown
from fasbody.recording import text
from fasbody.recording.channels import name_and_unit
from fasbody.recording.formats.series import REMARK, Series, passed_over
from fasbody.recording.headings import past_midnight, seconds_of
from fasbody.recording.statements import statements_of

#: Headings of the column that names the sensor, and of the one with the numbers.
_SENSORS = ("_field", "field", "variable", "sensor", "channel", "signal", "series", "metric")
_VALUES = ("_value", "value")
_TIMES = ("time", "_time", "timestamp")
#: Lines in which the headings are looked for, and comments that are read.
_LINES = 200


def long_series(file: Path) -> list[Series]:
    """A time and the numbers of each sensor, a group for each; none of a table that is not long.

    Args:
        file: a text.
    """
    head = next((piece for _, piece in text.Passage(file).pieces()), "")
    for number, line in enumerate(islice(text.lines(head), _LINES), 1):
        separator = text.separator_of(line)
        names = text.split(line, separator)
        lower = [name.lower() for name in names]
        sensor, value = (
            next((lower.index(x) for x in known if x in lower), None)
            for known in (_SENSORS, _VALUES)
        )
        time = next(
            (
                i
                for i, name in enumerate(lower)
                if name_and_unit(name)[0] in _TIMES or name in _TIMES
            ),
            None,
        )
        if sensor is not None and value is not None and time is not None:
            first = next((cells for _, cells in text.rows_below(head, number, separator)), [])
            if len(first) > max(sensor, value, time) and not text.numeric(first[sensor]):
                comments = [
                    line for line in islice(text.lines(head), _LINES) if text.COMMENT.match(line)
                ]
                remarks = [passed_over("comment", REMARK, comment) for comment in comments]
                return _series(file, number, separator, names, (sensor, value, time)) + remarks
    return []


def _series(
    file: Path, line: int, separator: str, names: Sequence[str], places: tuple[int, int, int]
) -> list[Series]:  # fmt: skip
    """The columns of each sensor from a line on; other columns are what the file says of it."""
    sensor, value, time = places
    times, values = dict[str, list[float]](), dict[str, list[float]]()
    about = dict[str, list[set[str]]]()
    stamped = False
    for after, piece in text.Passage(file, line).pieces():
        for number, cells in text.rows(file, piece, separator, after):
            if cells == list(names):  # once more, above another part
                continue
            cells = [*cells, *[""] * len(names)][: len(names)]
            seconds = seconds_of(cells[time])
            stamped = stamped or seconds is not None
            for cell in (cells[value], *([cells[time]] if seconds is None else [])):
                if not text.numeric(cell):
                    raise InputFileError(
                        file, f"its value or time is {shown(cell)!r}, not a number", line=number
                    )
            which = cells[sensor]
            times.setdefault(which, []).append(
                text.number(cells[time]) if seconds is None else seconds
            )
            values.setdefault(which, []).append(text.number(cells[value]))
            for known, cell in zip(
                about.setdefault(which, [set() for _ in names]), cells, strict=True
            ):
                if len(known) < 2:
                    known.add(cell)
    made = list[Series]()
    for which, numbers in values.items():
        pairs = (
            (name, next(iter(known)))
            for name, known in zip(names, about[which], strict=True)
            if len(known) == 1
        )
        says = {name: cell for name, cell in pairs if name and cell and name != names[sensor]}
        unit = next(
            (says.pop(name) for name in list(says) if name.lower() in ("unit", "units")), ""
        )
        clock = np.array(times[which])
        clock = past_midnight(clock) if stamped else clock
        split = [
            name for index, (name, known) in enumerate(zip(names, about[which], strict=True))
            if index not in places and len(known) > 1 and not any(map(text.numeric, known))
        ]  # fmt: skip
        if split and clock.size > 1 and np.diff(clock).min() <= 0:
            by = f"which the column {shown(split[0])!r} distinguishes"
            problem = f"{shown(which)!r} is several channels, {by}"
            raise InputFileError(file, problem, "keep the rows of one of them")
        made.append(
            Series("time" if stamped else names[time], "s" if stamped else "", clock, group=which)
        )
        made.append(
            Series(
                which, unit, np.array(numbers), stated=statements_of(says), about=says, group=which
            )
        )
    return made
