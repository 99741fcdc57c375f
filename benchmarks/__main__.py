"""`python -m benchmarks`: every topic in one table, written to RESULTS.md."""

import os
import platform
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from benchmarks import accuracy, arch, callbacks, coverage, fitting, study, viewer
from benchmarks.rows import HEADER, Row, table
from fasbody.console import command_line, console, print_json, write_whole

RESULTS = Path(__file__).with_name("RESULTS.md")
_LIBRARIES = ("mujoco", "numba", "numpy", "scipy")

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


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


def markdown(rows: list[Row], where: str, when: str, loads: tuple[float, float]) -> str:
    """RESULTS.md."""
    lines = [
        "# Benchmarks", "",
        "Printed by `make bench`; each topic runs alone as `python -m benchmarks.accuracy` (`callbacks`, `arch`,",
        "`fitting`, `coverage`, `study`; with tables of their own `black_box` and `cell`). The ratio says how many",
        "times better than required, or how many times faster. Times are CPU times unless they say otherwise, so",
        "other programs disturb them little, though not by nothing.", "",
        f"{when}. {where}. Load average before and after: {loads[0]:.1f}, {loads[1]:.1f}.", "",
        "| " + " | ".join(HEADER) + " |", "|---|---|---|---:|---|",
        *("| " + " | ".join(row.cells) + " |" for row in rows), "",
    ]  # fmt: skip
    return "\n".join(lines)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(help="noise seeds of the coverage study; 200 for the real one")] = 20,
    jobs: Annotated[int, typer.Option(help="processes of the coverage study, 0 for all cores")] = 0,
    scipy_limit: Annotated[int, typer.Option(help="trial points allowed to scipy (at most what our fit took)")] = 200,
    out: Annotated[Path, typer.Option(help="file to write", show_default="benchmarks/RESULTS.md")] = RESULTS,
    json_: Annotated[bool, typer.Option("--json", help="print the rows on stdout instead of a table")] = False,
) -> None:
    """Measure everything: accuracy, callbacks, arch, fits, coverage, a study. Takes some minutes, most of them scipy's.

    Examples:
      python -m benchmarks

      python -m benchmarks --seeds 200
    """
    before = os.getloadavg()[0]
    topics: dict[str, Callable[[], list[Row]]] = {
        "accuracy": accuracy.measure,
        "callbacks": callbacks.measure,
        "arch": arch.measure,
        "fitting": lambda: fitting.measure(scipy_limit=scipy_limit),
        "coverage": lambda: coverage.measure(seeds, jobs),
        "study": lambda: study.measure(scipy_limit=scipy_limit),
        "viewer": viewer.measure,
    }
    rows = []
    for number, (name, measure) in enumerate(topics.items(), 1):
        console.print(f"{name} ({number} of {len(topics)})")
        rows += measure()
    where, when = machine(), datetime.now(UTC).strftime("%Y-%m-%d")
    if json_:
        print_json({"machine": where, "date": when, "rows": [asdict(row) for row in rows]})
    else:
        console.print(table(where, rows))
    write_whole(out, markdown(rows, where, when, (before, os.getloadavg()[0])))
    console.print(f"written to {out}", soft_wrap=True)


if __name__ == "__main__":
    command_line(app)
