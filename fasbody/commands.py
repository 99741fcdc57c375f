"""The map of all commands, for the command `fasbody` and for `python -m fasbody`.

A row of commands.csv says all that it takes to show and to start a command, so that the map imports none of them and
needs no extra.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path

import fasbody
from fasbody.exceptions import SettingError, unknown


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        group: what it is for.
        words: what follows `fasbody`, "" for the map itself.
        module: what `python -m` runs.
        name: its sub-command, "" for none.
        at: the module that holds its Typer app, where that is not the one that runs.
        needs: a room above that does the work, where it is not the one that runs.
        does: the first line of its help.
    """

    group: str
    words: str
    module: str
    name: str
    at: str
    needs: str
    does: str

    @property
    def call(self) -> str:
        """What to type."""
        return f"fasbody {self.words}".rstrip()

    @property
    def home(self) -> str:
        """The module that holds its Typer app."""
        return self.at or (f"{self.module}.__main__" if _folder(self.module).is_dir() else self.module)

    @property
    def installed(self) -> bool:
        """Whether it is there; those of a checkout only are not, once the packages are installed."""
        place = _folder(self.module)
        if self.needs and not _folder(self.needs).is_dir():
            return False
        return (place / "__main__.py").is_file() or place.with_suffix(".py").is_file()


def _folder(module: str) -> Path:
    return Path(fasbody.__file__).parent.parent.joinpath(*module.split("."))


@cache
def _table() -> list[Command]:
    """Every command there may be, in the order in which one meets them."""
    with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        return [Command(**row) for row in csv.DictReader(file)]


def commands() -> list[Command]:
    """Every installed command, in the map's order."""
    return [command for command in _table() if command.installed]


def resolve(arguments: Sequence[str]) -> tuple[Command, list[str]]:
    """The command that the first words of a command line name, and the arguments that are left for it.

    Raises:
        SettingError: no command is called so.
    """
    known = {tuple(command.words.split()): command for command in commands() if command.words}
    for count in range(min(len(arguments), max(map(len, known))), 0, -1):
        if command := known.get(tuple(arguments[:count])):
            return command, list(arguments[count:])
    typed = " ".join(arguments)
    if any(command.words and f"{typed} ".startswith(f"{command.words} ") for command in _table()):
        raise SettingError(f"{typed!r} runs in a clone of the project only; it is not part of the installed package.")
    listed = [words for words in map(" ".join, known) if words.split()[0] == arguments[0]]
    if listed:
        raise SettingError(f"{unknown('command', ' '.join(arguments[:2]), listed)}.")
    names = list(dict.fromkeys(word for words in known for word in (words[0], " ".join(words))))
    near = get_close_matches(arguments[0], names, n=3, cutoff=0.6)
    hint = f", did you mean {' or '.join(map(repr, near))}?" if near else ";"
    raise SettingError(f"unknown command {arguments[0]!r}{hint} `fasbody` alone lists all {len(known)}.")
