"""The help of commands: words for types, examples below the options, and the command as it was started."""

import re
from typing import Any

import typer

from fasbody.commands import commands

#: What stands in a help for a value of a type.
_VALUES = {"Path": "PATH", "float": "NUMBER", "int": "N", "bool": "", "str": "TEXT"}
_EXAMPLES = "\n\nExamples:\n"


def readable(command: Any, *, short: bool) -> Any:
    """A command whose help is for a reader.

    Args:
        command: of click, as Typer makes it; it is changed.
        short: whether it was started as `fasbody fit`, not as `python -m identification.fit`.
    """
    for one in (command, *getattr(command, "commands", {}).values()):
        text = _short(one.help or "") if short else one.help or ""
        one.help, heading, examples = text.partition(_EXAMPLES)
        if heading:
            lines = [line for line in examples.splitlines() if line.strip()]
            one.epilog = "\n".join(["Examples:", *lines])
        for parameter in (*one.params, one.get_help_option(typer.Context(one))):
            if short and getattr(parameter, "help", None):
                parameter.help = _short(parameter.help)
            if parameter.param_type_name == "argument" or getattr(parameter, "metavar", None) is None:
                parameter.display_type_rich = _value(parameter)
    return command


def _value(parameter: Any) -> Any:
    """What shows the type of a parameter; a choice shows its own words."""
    described = getattr(parameter, "type_descriptor", None)
    if described is None or described.is_choice:
        return getattr(parameter, "display_type_rich", None)
    kind = str(getattr(described.annotation, "__name__", described.annotation))
    if kind == "list":
        kind = str(described.annotation)
    word = next((word for name, word in _VALUES.items() if name in kind), "VALUE")
    return lambda ctx: word


def _short(text: str) -> str:
    """A text with `fasbody fit` in place of `python -m identification.fit`."""
    known = {command.call: command.words for command in reversed(commands()) if command.words}
    modules = {command.module: command.words for command in reversed(commands()) if command.words}
    known |= {f"python -m {module}": words for module, words in modules.items() if f"python -m {module}" not in known}
    calls = "|".join(map(re.escape, sorted(known, key=len, reverse=True)))
    return re.sub(rf"({calls})\b(?![.\w])", lambda match: f"fasbody {known[match[1]]}", text)
