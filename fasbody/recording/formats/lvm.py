"""LabVIEW's measurement files, .lvm: text of one segment or several, with increments, starts and units."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np

from fasbody.recording.formats.series import FormatError, Series, check_size, remarks

#: Statements of the header that people write.
_SAYS = ("Description", "Notes", "Project", "Test_Name", "Test_Numbers")
LIBRARY = "numpy"
_END = "***End_of_Header***"


def decode(file: Path) -> list[Series]:
    """The channels of each segment, named by the row below its header; a group for each where there are several."""
    text = file.read_bytes().decode("utf-8-sig", "replace").replace("\r\n", "\n").replace("\r", "\n")
    if not text.startswith("LabVIEW Measurement"):
        raise FormatError("is not a LabVIEW measurement file: it does not begin with those words")
    lines = text.split("\n")
    comma = any(line.split(",")[:2] == ["Separator", "Comma"] for line in lines[:40])
    table = [line.split("," if comma else "\t") for line in lines]
    ends = [i for i, row in enumerate(table) if row[0].strip() == _END]
    if not ends:
        raise FormatError("is cut off: its header has no end")
    about = _statements(table[: ends[0]])
    heads = [i for i, row in enumerate(table) if i > ends[0] and row[0].strip() == "Channels"]
    if len(heads) != len(ends) - 1 or not heads:
        raise FormatError(f"has {len(heads)} headers of segments, and {len(ends) - 1} ends of them")
    channels = list[Series]()
    for k, (head, end, stop) in enumerate(zip(heads, ends[1:], [*heads[1:], len(table)], strict=True), 1):
        series = _segment(about, _statements(table[head:end]), table[end + 1], table[end + 2 : stop])
        group = f"segment {k}" if len(heads) > 1 else ""
        channels += [replace(s, name=f"{group}/{s.name}".lstrip("/"), group=group) for s in series]
    return channels


def _statements(rows: Sequence[Sequence[str]]) -> dict[str, list[str]]:
    return {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows}


def _segment(
    about: Mapping[str, list[str]],
    header: Mapping[str, list[str]],
    heading: Sequence[str],
    rows: Sequence[Sequence[str]],
) -> list[Series]:
    """The channels of one segment."""
    decimal = about.get("Decimal_Separator", ["."])[0]
    x_columns = about.get("X_Columns", ["One"])[0].lower()
    names = [cell.strip() for cell in heading]
    if x_columns == "multi":  # an empty cell over each column of times
        apart = {key: len(cells) > 2 and not any(cells[1::2]) for key, cells in header.items()}
        header = {key: cells[::2] if apart[key] else cells for key, cells in header.items()}
    count = int(header.get("Channels", ["0"])[0] or 0)
    body = [row for row in rows if any(cell.strip() for cell in row)]
    check_size(len(body) * max(1, len(names)), len(names))
    first = [2 * i + 1 for i in range(count)] if x_columns == "multi" else [i + 1 for i in range(count)]
    if not 0 < count < len(names) + 1 or first[-1] >= len(names):
        raise FormatError(f"announces {count} channels and names {len(names)}")

    def column(index: int) -> np.ndarray:
        cells = [row[index] if index < len(row) else "" for row in body]
        try:
            return np.array([float(cell.replace(decimal, ".")) for cell in cells])
        except ValueError:
            raise FormatError(f"the column {names[index]!r} holds something other than numbers") from None

    def value(key: str, place: int) -> float | None:
        cells = header.get(key, [])
        try:
            return float(cells[place].replace(decimal, "."))
        except (IndexError, ValueError):
            return None

    remarked = {key: " ".join(cells) for key, cells in {**about, **header}.items() if key in _SAYS}
    if names[-1] == "Comment":
        remarked["Comment"] = "; ".join(row[-1] for row in body if len(row) == len(names))
    units, clocks = header.get("Y_Unit_Label", []), header.get("Time", [])
    days = [_day(cell) for cell in header.get("Date", [])]
    starts = [_seconds(clocks[i], decimal) if i < len(clocks) else 0.0 for i in range(count)]
    if len(days) >= count:
        starts = [start + 86_400 * (day - days[0]) for start, day in zip(starts, days, strict=False)]
    channels = [Series("time", "s", column(0))] if x_columns == "one" else []
    for i, place in enumerate(first):  # X_Value stands first, also where its cells are empty
        step = value("Delta_X", i)
        rate = 1 / step if step and step > 0 else None
        start = None if x_columns == "one" and len(set(starts)) == 1 else starts[i] + (value("X0", i) or 0.0)
        if x_columns == "multi":
            channels.append(Series(f"time {i + 1}", "s", column(place - 1) + starts[i] - starts[0]))
            start = None
        channels.append(Series(names[place], units[i] if i < len(units) else "", column(place), rate, start_s=start))
    return channels + remarks(remarked)


def _day(date: str) -> int:
    """The number of a day, as 2026/03/02; 0 of another form."""
    try:
        return datetime.strptime(date, "%Y/%m/%d").toordinal()
    except ValueError:
        return 0


def _seconds(clock: str, decimal: str) -> float:
    try:
        hours, minutes, seconds = (float(part.replace(decimal, ".")) for part in clock.split(":"))
    except ValueError:
        raise FormatError(f"states the time {clock!r}, which is no time of the day") from None
    return 3600 * hours + 60 * minutes + seconds
