"""The click commands behind `python -m module ...`, as Typer makes them."""

import importlib
from functools import cache
from typing import Any

import typer

from fasbody.commands import commands

#: Module -> the module that holds its Typer app.
HOMES = {command.module: command.home for command in commands()}


@cache
def click_command(module: str) -> Any:
    """The command or group that `python -m module` runs."""
    return typer.main.get_command(importlib.import_module(HOMES[module]).app)


def sub_commands(module: str) -> dict[str, Any]:
    """Sub-commands by name; empty for a command without."""
    return dict(getattr(click_command(module), "commands", {}))
