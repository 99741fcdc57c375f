"""The map of all commands, read from the sources: no command runs, and no optional extra is needed.

A command is a module that ends in `command_line(...)`; what it does is the first line of its Typer help.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import fasbody

#: Where commands live; those of a checkout only are skipped where they are not installed.
PACKAGES = ("fasbody", "identification", "viz", "reproduction", "benchmarks")
#: The map: what for, and the modules in the order in which one meets them; a package stands for all of its modules.
GROUPS = {
    "A foot from its recordings": (
        "identification.fit", "fasbody.recording", "fasbody.transmissibility", "identification.study",
        "identification.blackbox", "fasbody.laboratory", "fasbody.acquire", "identification.heel",
    ),
    "The models": (
        "viz.foot", "fasbody.arch.sensitivity", "fasbody.arch.reduction", "fasbody.arch.load",
        "fasbody.arch.crosscheck", "fasbody.cell", "viz.cell", "viz.anatomy",
    ),
    "What holds it together": ("fasbody", "reproduction", "benchmarks"),
}  # fmt: skip
_ORDER = [module for modules in GROUPS.values() for module in modules]


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        module: what `python -m` runs. name: its sub-command, "" for none. does: the first line of its help.
        home: the module that holds its Typer app.
    """

    module: str
    name: str
    does: str
    home: str

    @property
    def call(self) -> str:
        """What to type."""
        return f"python -m {self.module} {self.name}".rstrip()

    @property
    def place(self) -> int:
        """Where the map has it: that of its module, or else of the package around it."""
        around = self.module
        while around not in _ORDER:
            around = around.rpartition(".")[0]
        return _ORDER.index(around)

    @property
    def group(self) -> str:
        """What it is for, one of `GROUPS`."""
        return next(title for title, modules in GROUPS.items() if _ORDER[self.place] in modules)

    def __str__(self) -> str:
        return f"{self.call}: {self.does}"


def commands(root: Path | None = None) -> list[Command]:
    """Every command of the packages below `root`, by default those installed beside `fasbody`, in the map's order."""
    root = root or Path(fasbody.__file__).parent.parent
    files = [file for package in PACKAGES for file in sorted((root / package).rglob("*.py"))]
    return sorted((command for file in files for command in _of(file, root)), key=lambda command: command.place)


def _of(file: Path, root: Path) -> Iterator[Command]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    guards = [node for node in tree.body if isinstance(node, ast.If) and "__main__" in ast.unparse(node.test)]
    if not any("command_line(" in ast.unparse(guard) for guard in guards):
        return
    module = ".".join(file.relative_to(root).with_suffix("").parts).removesuffix(".__main__")
    home, source = _home(file, tree, root)
    words = {_name(function, call): _help(source, function, call) for function, call in _decorated(source)}
    own = words.pop("", None)
    if own is None and len(words) == 1:
        own = words.popitem()[1]
    if own is not None:
        yield Command(module, "", own, home)
    for name, does in words.items():
        yield Command(module, name, does, home)


def _home(file: Path, tree: ast.Module, root: Path) -> tuple[str, ast.Module]:
    """The module that makes the app: the command's own, or the first that it imports late."""
    candidates = [file]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node not in tree.body:
            place = root.joinpath(*node.module.split("."))
            candidates += [place.with_suffix(".py"), *(place / f"{alias.name}.py" for alias in node.names)]
    for candidate in candidates:
        source = ast.parse(candidate.read_text(encoding="utf-8")) if candidate.is_file() else ast.Module([], [])
        if any("app" in ast.unparse(node).split("=")[0] for node in source.body if _makes_app(node)):
            return ".".join(candidate.relative_to(root).with_suffix("").parts), source
    raise LookupError(f"{file}: ends in command_line(...), but no module it imports makes a Typer app")


def _makes_app(node: ast.stmt) -> bool:
    return isinstance(node, ast.Assign | ast.AnnAssign) and "typer.Typer(" in ast.unparse(node)


def _decorated(source: ast.Module) -> Iterator[tuple[ast.FunctionDef, ast.Call]]:
    """The app's functions, each with its `@app.command(...)` or `@app.callback(...)`."""
    for function in source.body:
        for call in function.decorator_list if isinstance(function, ast.FunctionDef) else ():
            if isinstance(call, ast.Call) and ast.unparse(call.func) in ("app.command", "app.callback"):
                yield function, call  # type: ignore[misc]  # a FunctionDef, or there would be no decorators


def _name(function: ast.FunctionDef, call: ast.Call) -> str:
    """The sub-command's name, "" for the app's own callback."""
    if ast.unparse(call.func) == "app.callback":
        return ""
    return str(ast.literal_eval(call.args[0])) if call.args else function.name.replace("_", "-")


def _help(source: ast.Module, function: ast.FunctionDef, call: ast.Call) -> str:
    """The first line of the help: the decorator's `help`, a constant or its name, or else the docstring."""
    text = ast.get_docstring(function) or ""
    for keyword in call.keywords:
        if keyword.arg == "help":
            value = keyword.value
            if isinstance(value, ast.Name):
                assigned = {ast.unparse(n.targets[0]): n.value for n in source.body if isinstance(n, ast.Assign)}
                value = assigned[value.id]
            text = str(ast.literal_eval(value))
    return text.strip().splitlines()[0]
