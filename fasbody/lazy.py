"""Names of a package that are imported when they are first asked for (PEP 562), so that importing it costs nothing."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any


def attribute(package: str, homes: Mapping[str, str], name: str) -> Any:
    """What a package exports under a name, from its home.

    Args:
        package: its `__name__`.
        homes: name -> the module that has it, with the name there behind a colon where that is another one.
        name: what is asked for.

    Raises:
        AttributeError: it exports no such name.
    """
    if name not in homes:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    home, _, there = homes[name].partition(":")
    return getattr(import_module(home), there or name)
