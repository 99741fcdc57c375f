"""`fasbody`, or `python -m fasbody` in a clone: the map of all commands, and each of them by its words."""

import re
import runpy
import sys
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer

import fasbody
from fasbody import console
from fasbody.commands import Command, commands, resolve
from fasbody.completion import following, script
from fasbody.console import command_line, print_json, results, run_app

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
    version: Annotated[bool, typer.Option("--version", help="print the version")] = False,
    completion: Annotated[
        str | None, typer.Option(metavar="SHELL", help="print what completes fasbody in bash, zsh or fish")
    ] = None,
) -> None:
    """List all commands, and what they do.

    Examples:
      fasbody

      fasbody fit my_study --out results

      fasbody --completion bash
    """
    if version:
        results.print(fasbody.__version__)
        return
    if completion is not None:
        print(script(completion))
        return
    if json_:
        keys = ("words", "module", "name", "does", "home", "group")
        print_json([{key: getattr(command, key) for key in keys} for command in commands()])
        return
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column()
    for number, (title, group) in enumerate(groupby(commands(), lambda command: command.group)):
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
    file = Path(fasbody.__file__).parent.parent / "Makefile"
    return file.read_text(encoding="utf-8") if file.is_file() else ""


def _typed() -> str:
    """How it was started: as an installed command, or in a clone."""
    return "fasbody" if Path(sys.argv[0]).stem == "fasbody" else "python -m fasbody"


def page() -> None:
    """One page on what there is: each command by its first word, with the words that may follow."""
    from rich.table import Table

    families: dict[str, list[Command]] = {}
    for command in commands():
        if command.words:
            families.setdefault(command.words.split()[0], []).append(command)
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column()
    for first, family in families.items():
        does = [command.does for command in family if command.words == first or len(family) == 1]
        others = [command.words.removeprefix(f"{first} ") for command in family if command.words != first]
        also = f"{'Also' if does else 'One of'}: {first} {', '.join(others)}." if others else ""
        table.add_row(first, " ".join([*does, *([also] if also else [])]))
    results.print("Usage: fasbody COMMAND [OPTIONS]\n", markup=False)
    results.print(table)
    results.print("\nEach command has --help with examples. fasbody alone lists them in groups.")
    results.print('Completion in a shell: eval "$(fasbody --completion bash)", or zsh, fish.', highlight=False)
    results.print("\nExamples:\n  fasbody fit my_study --out results\n  fasbody view", highlight=False)


def run() -> None:
    """What `fasbody` does: the command that its first words name, as `python -m` runs it, or else the map."""
    words = sys.argv[1:]
    known = commands()
    group = [command for command in known if words and command.words.startswith(f"{words[0]} ")]
    alone = bool(group) and not any(command.words == words[0] for command in known)
    if words[:1] == ["--following"]:  # what a shell asks to complete a line
        print("\n".join(following(words[1:])))
    elif words in (["--help"], ["-h"], ["help"]):
        page()
    elif words == ["--version"]:
        print(fasbody.__version__)
    elif alone and all(word.startswith("-") for word in words[1:]):
        for command in group:
            results.print(f"fasbody {command.words}: {command.does}", soft_wrap=True)
        results.print("\nEach has --help with examples.")
    elif words and not words[0].startswith("-"):
        command, rest = resolve(words)
        sys.argv[1:] = [command.name, *rest] if command.name else rest
        console.started = console.Started(f"{_typed()} {command.words}", command.name)
        try:
            runpy.run_module(command.module, run_name="__main__", alter_sys=True)
        finally:
            console.started = None
    else:
        run_app(app)


def start() -> None:
    """The entry point of the installed command."""
    for name, place in hidden().items():
        console.console.print(
            f"warning: {place} hides the package {name} of fasbody; install fasbody in an environment of its own.",
            markup=False, soft_wrap=True,
        )  # fmt: skip
    command_line(run)


def hidden() -> dict[str, str]:
    """Our top-level packages in whose place another one would be imported, and where that lies."""
    ours = Path(fasbody.__file__).parent.parent
    specs = {name: find_spec(name) for name in ("identification", "mjcf", "viz")}
    places = {name: Path(spec.origin).parent for name, spec in specs.items() if spec is not None and spec.origin}
    return {name: str(place) for name, place in places.items() if place.parent.resolve() != ours.resolve()}


if __name__ == "__main__":
    command_line(run)
