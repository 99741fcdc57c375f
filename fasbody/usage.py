"""What is wrong with the words of a command, in one sentence: the option, its value, and what would be valid."""

import re
from collections.abc import Sequence
from typing import Any

from fasbody.exceptions import FasError, shown, unknown

#: So many options are listed where one does not exist; of more, the nearest is named.
_LISTED = 8


def sentence(error: Any) -> str:
    """The sentence for an error of click, whose classes Typer does not export.

    Args:
        error: what a command raises without standalone mode: a value that does not fit, an unknown option, ...
    """
    command = getattr(getattr(error, "ctx", None), "command", None)
    message, parameter = str(error.message).rstrip("."), getattr(error, "param", None)
    if (option := getattr(error, "option_name", None)) is not None:
        return _option(option, message, command)
    if hasattr(error, "param_type") and parameter is not None:
        help_text = (getattr(parameter, "help", None) or "").replace(r"\[", "[")  # the screen's own mark
        return f"{_name(parameter)} is missing" + (f": {help_text}." if help_text else ".")
    if parameter is not None:
        return f"{_name(parameter)} {_value(error, message)}."
    if commands := list(getattr(command, "commands", ())):
        asked = re.search(r"'([^']*)'", message)
        return f"{unknown('command', asked[1], commands)}." if asked else f"name one of {', '.join(commands)}."
    if extra := re.search(r"extra argument(?:s|\(s\))? \((.*)\)", message):
        taken = [_name(known) for known in command.params if known.param_type_name == "argument"] if command else []
        return f"unexpected argument {shown(extra[1])!r}; beside options it takes {' and '.join(taken) or 'nothing'}."
    return f"{message}."


def option_of(error: FasError, words: Sequence[str]) -> str:
    """The option of the setting that an error is about, if one of the words of the command line set it; else ""."""
    option = "--" + error.setting.replace("_", "-")
    return option if error.setting and any(word.partition("=")[0] == option for word in words) else ""


def _name(parameter: Any) -> str:
    """An option as it is typed, an argument as the help calls it."""
    option = parameter.param_type_name == "option"
    return max(parameter.opts, key=len) if option else f"the argument {parameter.name!r}"


def _option(name: str, message: str, command: Any) -> str:
    """An option that lacks its value, takes none, or does not exist."""
    if "requires" in message:
        return f"{name} needs a value."
    if "not take" in message:
        return f"{name} takes no value."
    known = [text for p in getattr(command, "params", ()) for text in (*p.opts, *p.secondary_opts) if text[0] == "-"]
    refusal = unknown("option", shown(name), [*known, "--help"])
    if len(known) < _LISTED:
        return f"{refusal}."
    near = refusal.rpartition(" (valid: ")[0]
    return f"{near} For all options see --help." if near.endswith("?") else f"{near}; for all options see --help."


def _value(error: Any, message: str) -> str:
    cause = error.__cause__
    if not hasattr(cause, "errors"):  # a sentence of ours, or of a Typer that checks values itself
        return message
    first = cause.errors()[0]
    kind, value, limits = first["type"], shown(str(first["input"])), first.get("ctx", {})
    if kind == "int_parsing":
        return f"is {value!r}, not a whole number"
    if kind == "float_parsing":
        point = value.replace(",", ".", 1)
        meant = point != value and re.fullmatch(r"[+-]?\d*\.\d+", point)
        return f"is {value!r}, not a number" + (f"; write {point}" if meant else " such as 72.5 or 1e-4")
    if kind == "greater_than_equal":
        return f"is {value}; it must be {limits['ge']:g} or more"
    if kind == "less_than_equal":
        return f"is {value}; it must be {limits['le']:g} or less"
    return f"is {value!r}: {message[:1].lower()}{message[1:]}"
