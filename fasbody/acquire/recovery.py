"""Which capture files belong together: each recording has its own, and a second one only if its disk became full."""

from collections.abc import Sequence
from pathlib import Path

from fasbody.acquire import capture
from fasbody.exceptions import InputFileError

#: The rest of a recording begins so soon after what the full disk took [s]: a replug may lie between.
_SOON_S = 60.0


def grouped(files: Sequence[Path]) -> list[tuple[Path, ...]]:
    """The files of each recording.

    A file that begins with a plan is a recording. One without is the rest of the one that it continues in time; alone,
    it is a capture whose plan is damaged.

    Raises:
        InputFileError: no capture file, one that is given twice, or one that continues none of the others.
    """
    seen: set[Path] = set()
    plans: dict[Path, float] = {}  # when the last record came [s]
    rests: dict[Path, tuple[float, float]] = {}
    for file in files:
        records = list(capture.read(file))
        if file.resolve() in seen:
            raise InputFileError(file, "is given twice", "name each capture file once")
        seen.add(file.resolve())
        times = [record.host for record in records] or [float("nan")]
        if any(record.kind == "M" for record in records) or len(files) == 1:
            plans[file] = times[-1]
        else:
            rests[file] = times[0], times[-1]
    groups = {file: [file] for file in plans}
    for rest, (first, last) in sorted(rests.items(), key=lambda item: item[1]):
        before = [file for file, end in plans.items() if 0 <= first - end < _SOON_S]
        if len(before) != 1:
            raise InputFileError(
                rest, "has no plan of its own and continues none of the other files",
                "give a rest together with the capture that it continues, and any other file by itself",
            )  # fmt: skip
        groups[before[0]].append(rest)
        plans[before[0]] = last
    return [tuple(group) for group in groups.values()]
