"""`python -m benchmarks`: every topic in one table, on a page of this machine; RESULTS.md with --commit only."""

import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.table import Topic, cells, markdown, read, refreshed, table
from fasbody.console import command_line, console, print_json, write_whole
from fasbody.exceptions import SettingError
from fasbody.runner import ROOT
from reproduction.check import Check, machine

#: The page that the documentation rests on, and the folder of the pages of readers' machines.
RESULTS, PAGES = Path(__file__).with_name("RESULTS.md"), ROOT / "results" / "benchmarks"
#: What the documentation shows of it.
SPEED = ROOT / "docs" / "speed.md"
LIBRARIES = ("mujoco", "numba", "numpy", "scipy")
#: Topics in the order of the table; each is a module with a command, run in a separate process on one thread.
TOPICS = (
    "accuracy", "callbacks", "arch", "fitting", "coverage", "reality", "rivals", "sensors", "black_box", "cell",
    "study", "study_population", "viewer", "acquire", "peak_to_peak", "responses", "study_end_to_end", "heel", "mutate",
)  # fmt: skip

#: How much of each study a run takes that is to end within the hour; `--full` takes the whole.
PART: Mapping[str, Sequence[str]] = {
    "coverage": ("--seeds", "20"), "reality": ("--seeds", "2"), "rivals": ("--seeds", "2"),
    "sensors": ("--feet", "5"), "study_population": ("--count", "2"), "responses": ("--seeds", "4"),
    "heel": ("--persons", "10"), "acquire": ("--minutes", "10"),
}  # fmt: skip
#: Topics that keep their rows in a file, to go on from.
KEPT = ("reality", "rivals", "sensors")

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def measure(topic: str, *options: str) -> list[Check]:
    """The checks of one topic, by its command."""
    command = [sys.executable, "-m", f"benchmarks.{topic}", *options, "--json"]
    done = subprocess.run(
        command, check=False, stdout=subprocess.PIPE, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    if done.returncode:
        console.print(f"[bold red]{topic}: no rows, `{' '.join(command[1:])}` ended with {done.returncode}[/]")
        return []
    return [replace(Check.of(row), source=topic) for row in json.loads(done.stdout)["rows"]]


def machine_page() -> Path:
    """The page of this machine."""
    host = re.sub(r"[^A-Za-z0-9.-]+", "-", platform.node()).strip(".-") or "machine"
    return PAGES / f"{host}.md"


def committed(page: Mapping[str, Topic], now: Mapping[str, Topic], where: str) -> dict[str, Topic]:
    """The topics of RESULTS.md with those measured now in their place; of another machine's, all of this one's page.

    Raises:
        SettingError: RESULTS.md is of another machine or other versions, and topics of it would be lost.
    """
    text = RESULTS.read_text() if RESULTS.is_file() else ""
    topics = dict(read(text, where) or page) | dict(now)
    if missing := set(read(text)) - set(topics):
        raise SettingError(
            f"--commit: {RESULTS.name} comes from another machine or other versions and would lose "
            f"{', '.join(name for name in TOPICS if name in missing)}; measure these, too."
        )
    return topics


@app.command()
def main(
    only: Annotated[list[str] | None, typer.Argument(help=f"some of {', '.join(TOPICS)} (default: all)")] = None,
    full: Annotated[bool, typer.Option("--full", help="every study at its full size, about four hours")] = False,
    with_peers: Annotated[bool, typer.Option("--peers/--no-peers", help="install and run SIPPY and pysib, too")] = True,
    out: Annotated[Path | None, typer.Option(help="page to write", show_default="results/benchmarks/HOST.md")] = None,
    commit: Annotated[
        bool, typer.Option("--commit", help="put the rows into benchmarks/RESULTS.md and docs/speed.md, too")
    ] = False,
    json_: Annotated[bool, typer.Option("--json", help="print the rows on stdout instead of a table")] = False,
) -> None:
    """Measure everything that the documentation states, and write one table. Takes about an hour.

    Coverage and decisions are counted over a part of their seeds; --full counts all.

    Rows of topics that are not measured now stay on the page, unless they are of another machine or other versions.
    The committed page, RESULTS.md, changes with --commit only, and keeps all its topics.

    Examples:
      python -m benchmarks

      python -m benchmarks accuracy callbacks

      python -m benchmarks --full --commit
    """
    topics = only or list(TOPICS)
    for name in topics:
        if name not in TOPICS:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(TOPICS)}")
    out = out or machine_page()
    options = {name: [*(() if full else PART.get(name, ()))] for name in TOPICS}
    for name in KEPT:
        options[name] += ["--state", str(out.with_name(f"{name}.jsonl"))]
    options["black_box"].append("--peers" if with_peers else "--no-peers")
    where, when = machine(*LIBRARIES), datetime.now(UTC).strftime("%Y-%m-%d")
    page, now = read(out.read_text(), where) if out.is_file() else {}, {}
    if commit:  # refuse before the work a page that would lose rows
        committed(page, {name: Topic(name, when, 0.0, []) for name in topics}, where)
    checks = []
    for number, name in enumerate(topics, 1):
        console.print(f"{name} ({number} of {len(topics)})")
        load = os.getloadavg()[0]
        measured = measure(name, *options[name])
        if measured:
            now[name] = Topic(name, when, load, [cells(check) for check in measured])
            write_whole(out, markdown(_ordered(page | now), where))
        checks += measured
    if commit:
        write_whole(RESULTS, markdown(_ordered(committed(page, now, where)), where))
        write_whole(SPEED, refreshed(SPEED.read_text(), RESULTS.read_text()))
    if json_:
        print_json({"machine": where, "date": when, "rows": [check.document() for check in checks]})
    else:
        console.print(table(where, checks))
    console.print(f"written to {out}{f' and {RESULTS}' if commit else ''}", soft_wrap=True)


def _ordered(topics: Mapping[str, Topic]) -> dict[str, Topic]:
    return {name: topics[name] for name in TOPICS if name in topics}


if __name__ == "__main__":
    command_line(app)
