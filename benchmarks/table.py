"""The benchmark table: on the terminal, and as a page in which each topic's rows stay until it is measured again."""

import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from fasbody.console import console, print_json
from reproduction.check import Check, over, rounded

#: The option that every topic has.
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]
#: Load average, as a share of the cores, beyond which they are not idle; one program alone makes at most one.
BUSY = 0.75
HEADER = ("what", "measured", "required or compared with", "times better", "margin", "met")
_MISSED = re.compile(r"^\d+ rows(?= of \[RESULTS\.md\])", re.MULTILINE)
_TOPIC = re.compile(r"(\w+) (\d{4}-\d\d-\d\d) \(load ([\d.]+)\)")
_TEXT = """# Benchmarks

Printed by `make bench`; each topic runs alone, too: `python -m benchmarks.accuracy`. `python -m benchmarks accuracy`
writes a page like this one of your own machine, results/benchmarks/HOST.md; `--commit` puts the rows here, too.
*Times better* compares two measurements: how many times faster or more accurate than the other way named before it.
*Margin* compares with a requirement that we set ourselves: 1 just meets it, below 1 is a NO. Times are CPU times unless
they say otherwise, so other programs disturb them little, though not by nothing.

"""


def cells(check: Check) -> tuple[str, ...]:
    """A check as text, by `HEADER`."""
    ratio, margin = ("" if value is None else rounded(value) for value in (check.ratio, check.margin))
    return check.what, check.measured, check.against, ratio, margin, {None: "", True: "yes", False: "NO"}[check.met]


def faster(what: str, seconds: float, other_seconds: float, other: str, required: float | None = None) -> Check:
    """A time beside that of something else [s]; its ratio is how many times faster, at least `wanted`."""
    ratio = over(other_seconds, seconds)
    beside = f"{other}: {_duration(other_seconds)}" + ("" if required is None else f", at least {required:g} times")
    value, low = np.nan if ratio is None else ratio, -np.inf if required is None else required
    return Check(what, value, low, said=_duration(seconds), beside=beside, ratio=ratio, asked=required is not None)


def _duration(seconds: float) -> str:
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "us")):
        if seconds * factor >= 1:
            return f"{seconds * factor:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def judged_if_idle(check: Check, load: float) -> Check:
    """A check that needs idle cores: without a verdict where the load average before it was higher."""
    if load < BUSY * (os.cpu_count() or 1):
        return check
    what = f"{check.what} (not judged: cores busy, load {load:.1f})"
    return replace(check, what=what, beside=check.against, asked=False)


def interleaved(
    works: Sequence[Callable[[], object]], repeats: int, clock: Callable[[], float] = time.process_time
) -> np.ndarray:
    """Times (repeats, works) [s] of several works taken in turn, so that a busy machine disturbs all alike.

    Args:
        works: what to time; each runs once untimed first. repeats: how often. clock: by default the CPU time of this
            process, which other processes hardly disturb; `time.perf_counter` where waiting counts.
    """
    for work in works:
        work()
    times = np.empty((repeats, len(works)))
    for row in times:
        for i, work in enumerate(works):
            began = clock()
            work()
            row[i] = clock() - began
    return times


def table(title: str, checks: Sequence[Check]) -> Table:
    """A table for the terminal."""
    out = Table(title=title, title_justify="left")
    for name in HEADER:
        out.add_column(name, justify="right" if name in ("times better", "margin") else "left")
    for check in checks:
        out.add_row(*cells(check), style="bold red" if check.met is False else None)
    return out


def report(title: str, checks: Sequence[Check], as_json: bool) -> None:
    """Print the rows of a topic that runs alone."""
    if as_json:
        print_json({"title": title, "rows": [check.document() for check in checks]})
    else:
        console.print(table(title, checks))


@dataclass(frozen=True)
class Topic:
    """The rows of one topic as text, when they were measured, and the load average before."""

    name: str
    when: str
    load: float
    rows: Sequence[Sequence[str]]


def read(text: str, where: str = "") -> dict[str, Topic]:
    """The topics of such a page; none if a machine with its versions is named and the page comes from another."""
    if where and f"Machine: {where}.\n" not in text:
        return {}
    cells = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    padded = [[*row, *[""] * (len(HEADER) + 1 - len(row))] for row in cells[1:]]
    return {
        name: Topic(name, when, float(load), [[cell.strip() for cell in row[1:]] for row in padded if row[0] == name])
        for name, when, load in _TOPIC.findall(text)
    }


def markdown(topics: Mapping[str, Topic], where: str) -> str:
    """The text of the page."""
    measured = ", ".join(f"{topic.name} {topic.when} (load {topic.load:.1f})" for topic in topics.values())
    lines = [
        f"Machine: {where}.", "", f"Measured, with the load average before: {measured}.", "",
        "| topic | " + " | ".join(HEADER) + " |", "|---|---|---|---|---:|---:|---|",
        *("| " + " | ".join([topic.name, *row]) + " |" for topic in topics.values() for row in topic.rows), "",
    ]  # fmt: skip
    return _TEXT + "\n".join(lines)


def refreshed(page: str, results: str) -> str:
    """docs/speed.md with the numbers of RESULTS.md: each of its rows begins as one there does, and keeps its length.

    Its last section counts the rows that miss their requirement.
    """
    rows = [
        [cell.strip() for cell in line.strip("| ").split(" | ")] for line in results.splitlines() if line[:2] == "| "
    ]
    lines = page.splitlines()
    for number, line in enumerate(lines):
        what, *numbers = [cell.strip() for cell in line.strip("| ").split(" | ")] if line[:2] == "| " else [""]
        matches = [row for row in rows if len(row) > 2 and row[1].startswith(what)] if numbers else []
        if len(numbers) == 2:  # compared with something: how many times better
            matches = [row for row in matches if numbers[0] in row[3]]
            numbers = [numbers[0], matches[0][4]] if matches else numbers
        elif matches:  # measured, required, met
            met = matches[0][-1] if matches[0][-1] in ("yes", "NO") else "not judged"
            numbers = [matches[0][2], matches[0][3], met]
        if matches and what != "what":
            lines[number] = f"| {' | '.join([what, *numbers])} |"
    missed = sum(row[-1] == "NO" for row in rows)
    return _MISSED.sub(f"{missed} rows", "\n".join(lines) + "\n")
