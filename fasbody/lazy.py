"""What is imported by its name: a package's names on first use, commands of higher packages.

Importing a package costs nothing this way (PEP 562), and a command may be typed where a user looks for it.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from fasbody.exceptions import FasError

ROOT = Path(__file__).parent.parent


def attribute(package: str, homes: Mapping[str, str], name: str) -> Any:
    """What a package exports under a name, imported from the module that defines it.

    Args:
        package: its `__name__`.
        homes: name -> the module that has it, with the name there behind a colon where that is another one.
        name: of the attribute.

    Raises:
        AttributeError: it exports no such name.
    """
    if name not in homes:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    home, _, alias = homes[name].partition(":")
    return getattr(import_module(home), alias or name)


def command(home: str) -> Callable[..., None]:
    """The function of a command that stands in a room above: of `module:function`.

    Where that room is not installed, as it is of a checkout only, the command says so.
    """
    module, _, name = home.partition(":")
    if (ROOT / module.split(".")[0]).is_dir():
        function: Callable[..., None] = getattr(import_module(module), name)
        return function

    def missing() -> None:
        """Not installed: a part of the project's checkout."""
        raise FasError(f"this needs {module}, which is not installed; run it in a checkout of the project.")

    return missing
