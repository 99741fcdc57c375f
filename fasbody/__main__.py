"""`python -m fasbody`: the map of all commands."""

import re
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

import fasbody
from fasbody.commands import commands
from fasbody.console import command_line, print_json, results

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False) -> None:
    """Show what there is: every command of the project, and what it does.

    Examples:
      python -m fasbody
    """
    found = commands()
    if json_:
        print_json([asdict(command) | {"group": command.group} for command in found])
        return
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column()
    for number, (title, group) in enumerate(groupby(found, lambda command: command.group)):
        if number:
            table.add_row()
        table.add_row(f"[bold]{title}[/]")
        for command in group:
            table.add_row(command.call, command.does)
    results.print(table)
    results.print("\nEach has --help with examples, and most --json.")
    if makefile := _makefile():
        targets = re.findall(r"^(\w+):.*  ##", makefile, re.MULTILINE)
        results.print(f"Each of make {', '.join(targets)} sets up its environment first.", highlight=False)


def _makefile() -> str:
    """The text of the Makefile; empty where the package is installed without its checkout."""
    file = Path(fasbody.__file__).parent.parent / "Makefile"
    return file.read_text(encoding="utf-8") if file.is_file() else ""


if __name__ == "__main__":
    command_line(app)
