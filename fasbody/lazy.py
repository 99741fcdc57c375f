"""What is imported by its name: a package's names on first use, commands of higher packages.

Importing a package costs nothing this way (PEP 562), and a command may be typed where a user looks for it.
"""

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from fasbody.exceptions import FasError

ROOT = Path(__file__).parent.parent


@cache
def _homes(package: str) -> dict[str, tuple[str, str]]:
    """Exported name -> module and name there: what a package imports for type checkers alone."""
    tree = ast.parse(Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8"))
    guard = next(node for node in tree.body if isinstance(node, ast.If))
    lines = [node for node in guard.body if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: (str(line.module), alias.name) for line in lines for alias in line.names}
    for node in guard.body:  # another name for what was imported
        if isinstance(node, ast.Assign):
            homes[ast.unparse(node.targets[0])] = homes.pop(ast.unparse(node.value))
    return homes


def attribute(package: str, name: str) -> Any:
    """What a package exports under a name, imported from the module that defines it; `__all__` are these names.

    Args:
        package: its `__name__`; it imports what it exports under `if TYPE_CHECKING`.
        name: of the attribute.

    Raises:
        AttributeError: it exports no such name.
    """
    homes = _homes(package)
    if name == "__all__":
        return sorted(homes)
    if name not in homes:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    home, original = homes[name]
    return getattr(import_module(home), original)


def command(home: str) -> Callable[..., None]:
    """The function of a command that stands in a room above: of `module:function`.

    Where that room is not installed, as it is of a checkout only, the command says so.
    """
    module, _, name = home.partition(":")
    if (ROOT / module.split(".")[0]).is_dir():
        function: Callable[..., None] = getattr(import_module(module), name)
        return function

    def missing() -> None:
        raise FasError(f"this needs {module}, which is not installed; run it in a checkout of the project.")

    missing.__doc__ = f"Only in a clone of the project, with its folder {module.split('.')[0]}; not installed here."
    return missing
