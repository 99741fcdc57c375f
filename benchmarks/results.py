"""RESULTS.md: one table of all topics, each measured when its line says; other topics' rows stay until they are."""

import os
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from benchmarks.rows import HEADER

_LIBRARIES = ("mujoco", "numba", "numpy", "scipy")
_TOPIC = re.compile(r"(\w+) (\d{4}-\d\d-\d\d) \(load ([\d.]+)\)")
_TEXT = """# Benchmarks

Printed by `make bench`; each topic runs alone, too: `python -m benchmarks.accuracy`; `python -m benchmarks accuracy`
puts its rows here. *Times better* compares two measurements: how many times faster or more accurate than the other way
named before it. *Margin* compares with a requirement that we set ourselves: 1 just meets it, below 1 is a NO. Times are
CPU times unless they say otherwise, so other programs disturb them little, though not by nothing.

"""


@dataclass(frozen=True)
class Topic:
    """The rows of one topic as text, when they were measured, and the load average before."""

    name: str
    when: str
    load: float
    rows: Sequence[Sequence[str]]


def machine() -> str:
    """Processor, cores and versions in one sentence."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text().splitlines() if cpu.is_file() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    libraries = ", ".join(f"{name} {version(name)}" for name in _LIBRARIES)
    return (
        f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores; "
        f"{platform.system()}, Python {platform.python_version()}, {libraries}"
    )


def read(text: str, where: str) -> dict[str, Topic]:
    """The topics of a RESULTS.md; none if it comes from another machine or other versions."""
    if f"Machine: {where}.\n" not in text:
        return {}
    cells = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    padded = [[*row, *[""] * (len(HEADER) + 1 - len(row))] for row in cells[1:]]
    return {
        name: Topic(name, when, float(load), [[cell.strip() for cell in row[1:]] for row in padded if row[0] == name])
        for name, when, load in _TOPIC.findall(text)
    }


def markdown(topics: Mapping[str, Topic], where: str) -> str:
    """The text of RESULTS.md."""
    measured = ", ".join(f"{topic.name} {topic.when} (load {topic.load:.1f})" for topic in topics.values())
    lines = [
        f"Machine: {where}.", "", f"Measured, with the load average before: {measured}.", "",
        "| topic | " + " | ".join(HEADER) + " |", "|---|---|---|---|---:|---:|---|",
        *("| " + " | ".join([topic.name, *row]) + " |" for topic in topics.values() for row in topic.rows), "",
    ]  # fmt: skip
    return _TEXT + "\n".join(lines)
