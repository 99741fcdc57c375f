"""`python -m benchmarks`: every topic in one table, written to RESULTS.md."""

import json
import os
import subprocess
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.results import Topic, machine, markdown, read
from benchmarks.rows import Row, table
from fasbody.console import command_line, console, print_json, write_whole

RESULTS = Path(__file__).with_name("RESULTS.md")
#: Topics in the order of the table; each is a module with a command, run in a process of its own on one thread.
TOPICS = (
    "accuracy", "callbacks", "arch", "fitting", "coverage", "black_box", "cell", "study", "trend", "viewer", "acquire",
    "peak_to_peak", "study_end_to_end", "heel",
)  # fmt: skip

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def measure(topic: str, *options: str) -> list[Row]:
    """The rows of one topic, by its own command."""
    command = [sys.executable, "-m", f"benchmarks.{topic}", *options, "--json"]
    done = subprocess.run(
        command, check=False, stdout=subprocess.PIPE, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    if done.returncode:
        console.print(f"[bold red]{topic}: no rows, `{' '.join(command[1:])}` ended with {done.returncode}[/]")
        return []
    return [Row(**row) for row in json.loads(done.stdout)["rows"]]


@app.command()
def main(
    only: Annotated[list[str] | None, typer.Argument(help=f"some of {', '.join(TOPICS)} (default: all)")] = None,
    seeds: Annotated[int, typer.Option(help="noise seeds of the coverage study; 200 for the real one")] = 20,
    jobs: Annotated[int, typer.Option(help="processes of the coverage study, 0 for all cores")] = 0,
    scipy_limit: Annotated[int, typer.Option(help="trial points allowed to scipy (at most what our fit took)")] = 200,
    with_peers: Annotated[bool, typer.Option("--peers/--no-peers", help="install and run SIPPY and pysib, too")] = True,
    out: Annotated[Path, typer.Option(help="file to write", show_default="benchmarks/RESULTS.md")] = RESULTS,
    json_: Annotated[bool, typer.Option("--json", help="print the rows on stdout instead of a table")] = False,
) -> None:
    """Measure everything that the documentation states, into one table. Takes about half an hour.

    Rows of topics that are not measured now stay, unless they come from another machine or other versions.

    Examples:
      python -m benchmarks

      python -m benchmarks accuracy callbacks

      python -m benchmarks --seeds 200
    """
    topics = only or list(TOPICS)
    for name in topics:
        if name not in TOPICS:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(TOPICS)}")
    options = {
        "fitting": ["--scipy-limit", f"{scipy_limit}"], "coverage": ["--seeds", f"{seeds}", "--jobs", f"{jobs}"],
        "black_box": ["--peers" if with_peers else "--no-peers"],
    }  # fmt: skip
    where, when = machine(), datetime.now(UTC).strftime("%Y-%m-%d")
    known = read(out.read_text(), where) if out.is_file() else {}
    rows = []
    for number, name in enumerate(topics, 1):
        console.print(f"{name} ({number} of {len(topics)})")
        load = os.getloadavg()[0]
        found = measure(name, *options.get(name, []))
        if found:
            known[name] = Topic(name, when, load, [row.cells for row in found])
            write_whole(out, markdown({name: known[name] for name in TOPICS if name in known}, where))
        rows += found
    if json_:
        print_json({"machine": where, "date": when, "rows": [asdict(row) for row in rows]})
    else:
        console.print(table(where, rows))
    console.print(f"written to {out}", soft_wrap=True)


if __name__ == "__main__":
    command_line(app)
