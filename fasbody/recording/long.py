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

#: Headings of the column that names the sensor, of its numbers and of their times.
_SENSORS = {"_field", "field", "variable", "sensor", "channel", "signal", "series", "metric"}
_VALUES = {"_value", "value"}
_TIMES = {"time", "_time", "timestamp"}
#: Lines in which the headings are looked for, and comments that are read.
_LINES = 200


def long_series(file: Path) -> list[Series]:
    """A time and the numbers of each sensor, a group for each; none of a table that is not long.

    Args:
        file: a text.
    """
    if not text.begins_with(file, "value"):
        return []
    head = next((piece for _, piece in text.Passage(file).pieces()), "")
    lines = list(islice(text.lines(head), _LINES))
    for number, line in enumerate(lines, 1):
        separator = text.separator_of(line)
        names = text.split(line, separator)
        stems = [{name.lower(), name_and_unit(name)[0]} for name in names]
        known = (_SENSORS, _VALUES, _TIMES)
        places = [i for one in known for i in [i for i, stem in enumerate(stems) if stem & one][:1]]
        first = next((cells for _, cells in text.rows_below(head, number, separator)), [])
        if len(places) < len(known) or len(first) != len(names) or text.numeric(first[places[0]]):
            continue
        rows = _by_sensor(file, number, separator, names, places)
        notes = "\n".join(line for line in lines if text.COMMENT.match(line))
        series = [s for name in rows for s in _columns(file, name, names, places, rows[name])]
        return [*series, passed_over("comments", REMARK, notes)]
    return []


def _by_sensor(
    file: Path, line: int, separator: str, names: Sequence[str], places: Sequence[int]
) -> dict[str, list[list[str]]]:
    """The rows of each sensor from a line on."""
    rows = dict[str, list[list[str]]]()
    sensor, value, time = places
    for after, piece in text.Passage(file, line).pieces():
        for number, cells in text.rows(file, piece, separator, after):
            if cells == names:  # once more, above another part
                continue
            cells = [*cells, *[""] * len(names)][: len(names)]
            is_time = text.numeric(cells[time]) or seconds_of(cells[time]) is not None
            if not is_time or not text.numeric(cells[value]):
                odd = shown(cells[value] if is_time else cells[time])
                problem = f"its value or time is {odd!r}, not a number"
                raise InputFileError(file, problem, line=number)
            rows.setdefault(cells[sensor], []).append(cells)
    return rows


def _columns(
    file: Path, sensor: str, names: Sequence[str], places: Sequence[int], rows: list[list[str]]
) -> list[Series]:
    """Time and numbers of a sensor; what other columns have for it alone, the file says of it."""
    cells = list(zip(*rows, strict=True))
    _, value, time = places
    stamps = [seconds_of(cell) for cell in cells[time]]
    stamped = None not in stamps
    clock = np.array(stamps if stamped else [_number(cell) for cell in cells[time]], float)
    clock = past_midnight(clock) if stamped else clock
    rest = [(names[i], set(cells[i])) for i in range(len(names)) if i not in places]
    for name, distinct in rest:
        is_name = 1 < len(distinct) < len(rows) / 2 and not any(map(text.numeric, distinct))
        if is_name and np.diff(clock).min() <= 0:
            by = f"which the column {shown(name)!r} distinguishes"
            problem = f"{shown(sensor)!r} is several channels, {by}"
            raise InputFileError(file, problem, "keep the rows of one of them")
    says = {name: next(iter(distinct)) for name, distinct in rest if name and len(distinct) == 1}
    unit = next((says.pop(name) for name in [*says] if name.lower() in ("unit", "units")), "")
    numbers = np.array([text.number(cell) for cell in cells[value]])
    return [
        Series("time" if stamped else names[time], "s" if stamped else "", clock, group=sensor),
        Series(sensor, unit, numbers, stated=statements_of(says), about=says, group=sensor),
    ]


def _number(cell: str) -> float:
    return text.number(cell) if text.numeric(cell) else np.nan
