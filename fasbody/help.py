"""The help of commands: words for types, and examples below the options."""

from typing import Any

import typer

#: What stands in a help for a value of a type.
_VALUES = {"Path": "PATH", "float": "NUMBER", "int": "N", "bool": "", "str": "TEXT"}
_EXAMPLES = "\n\nExamples:\n"


def readable(command: Any) -> Any:
    """A command whose help is for a reader.

    Args:
        command: of click, as Typer makes it; it is changed.
    """
    for one in (command, *getattr(command, "commands", {}).values()):
        text, heading, examples = (one.help or "").partition(_EXAMPLES)
        one.help = "\n\n".join(map(_filled, text.split("\n\n")))
        if heading:
            lines = [line for line in examples.splitlines() if line.strip()]
            one.epilog = "\n".join(["Examples:", *lines])
        for parameter in (*one.params, one.get_help_option(typer.Context(one))):
            if parameter.param_type_name == "argument" or getattr(parameter, "metavar", None) is None:
                parameter.display_type_rich = _value(parameter)
    return command


def _filled(paragraph: str) -> str:
    """A paragraph in one line, which the terminal breaks where it ends; what is indented or listed stays."""
    lines = paragraph.splitlines()
    return paragraph if any(line[:1] in (" ", "-", "*") for line in lines) else " ".join(lines)


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
