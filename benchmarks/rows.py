"""Rows of the benchmark table: what was measured, what it must reach or is compared with, and by how much."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from fasbody.console import console, print_json


@dataclass(frozen=True)
class Row:
    """One claim.

    Attributes:
        what: the claim's subject. measured: what came out, with its unit. against: the requirement, or what it is
            compared with. ratio: how many times better than something else that was measured, too.
        holds: whether the requirement is met, None where nothing is required.
        margin: how many times better than the requirement: limit over value, or value over least.
    """

    what: str
    measured: str
    against: str
    ratio: float | None = None
    holds: bool | None = None
    margin: float | None = None

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as text, by `HEADER`."""
        ratio, margin = ("" if value is None else f"{value:.3g}" for value in (self.ratio, self.margin))
        return self.what, self.measured, self.against, ratio, margin, {None: "", True: "yes", False: "NO"}[self.holds]


#: The option that every topic has.
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]
#: Load average, as a share of the cores, beyond which they are not idle; one program alone makes at most one.
BUSY = 0.75
HEADER = ("what", "measured", "required or compared with", "times better", "margin", "met")


def at_most(what: str, value: float, limit: float, unit: str = "") -> Row:
    """A number that must not exceed a limit; its margin is limit over value."""
    holds, against = bool(value <= limit), f"at most {_number(limit, unit)}"
    return Row(what, _number(value, unit), against, holds=holds, margin=_over(limit, value))


def at_least(what: str, value: float, limit: float, unit: str = "") -> Row:
    """A number that must reach a limit; its margin is value over limit."""
    holds, against = bool(value >= limit), f"at least {_number(limit, unit)}"
    return Row(what, _number(value, unit), against, holds=holds, margin=_over(value, limit))


def between(what: str, value: float, low: float, high: float, unit: str = "") -> Row:
    """A number that must lie in a range."""
    holds = bool(low <= value <= high)
    return Row(what, _number(value, unit), f"{_number(low)} to {_number(high, unit)}", None, holds)


def faster(what: str, seconds: float, other_seconds: float, other: str, wanted: float | None = None) -> Row:
    """A time beside that of something else; its ratio is how many times faster."""
    ratio = _over(other_seconds, seconds)
    required = "" if wanted is None else f", at least {wanted:g} times"
    holds = None if wanted is None else ratio is not None and ratio >= wanted
    return Row(what, _duration(seconds), f"{other}: {_duration(other_seconds)}{required}", ratio, holds)


def _over(a: float, b: float) -> float | None:
    return float(a / b) if b > 0 and np.isfinite(a / b) else None


def _number(value: float, unit: str = "") -> str:
    return f"{value:.3g} {unit}".strip()


def _duration(seconds: float) -> str:
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "us")):
        if seconds * factor >= 1:
            return f"{seconds * factor:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def judged_if_idle(row: Row, load: float) -> Row:
    """A row about idle cores: told without a verdict where it was measured on busy ones (load average before it)."""
    if load < BUSY * (os.cpu_count() or 1):
        return row
    return replace(row, what=f"{row.what} (not judged: cores busy, load {load:.1f})", holds=None)


def interleaved(
    works: Sequence[Callable[[], object]], repeats: int, clock: Callable[[], float] = time.process_time
) -> np.ndarray:
    """Times (repeats, works) [s] of several works taken in turn, so that a busy machine is equally unkind to all.

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


def table(title: str, rows: Sequence[Row]) -> Table:
    """A table for the terminal."""
    out = Table(title=title, title_justify="left")
    for name in HEADER:
        out.add_column(name, justify="right" if name in ("times better", "margin") else "left")
    for row in rows:
        out.add_row(*row.cells, style="bold red" if row.holds is False else None)
    return out


def report(title: str, rows: Sequence[Row], as_json: bool) -> None:
    """Print the rows of a topic that runs alone."""
    if as_json:
        print_json({"title": title, "rows": [asdict(row) for row in rows]})
    else:
        console.print(table(title, rows))
