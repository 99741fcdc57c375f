"""`python -m fasbody`: the map of all commands."""

from dataclasses import asdict
from itertools import groupby
from typing import Annotated

import typer
from rich.table import Table

from fasbody.commands import commands
from fasbody.console import command_line, print_json, results

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(json_: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False) -> None:
    """Show what there is: every command of the project, and what it does.

    Example: python -m fasbody
    """
    found = commands()
    if json_:
        print_json([asdict(command) for command in found])
        return
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column()
    for number, (_, group) in enumerate(groupby(found, lambda command: command.module.split(".")[0])):
        if number:
            table.add_row()
        for command in group:
            table.add_row(command.call, command.does)
    results.print(table)
    results.print("\nEach has --help with examples, and most --json.")


if __name__ == "__main__":
    command_line(app)
