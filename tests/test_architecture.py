"""The shape of the project: rooms, imports that go one way, one door to each foreign package, equations listed."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("mjcf", "fasbody", "identification", "viz")
ALLOWED = {
    "mjcf": set(),
    "fasbody": {"mjcf"},
    "identification": {"fasbody", "mjcf"},
    "viz": {"fasbody", "identification", "mjcf"},
}
# package -> the only files that may import it
DOORS = {
    "pinocchio": {"fasbody/arch/crosscheck.py"},
    "serial": {"fasbody/acquire/port.py"},
    "sounddevice": {"fasbody/acquire/audio.py"},
    "pyvisa": {"fasbody/acquire/visa.py"},
    "meshcat": {"viz/scene.py"},
    "gmsh": {"fasbody/cell/mesher.py"},
    "dask": {"identification/study/cluster.py"},
    "distributed": {"identification/study/cluster.py"},
}


#: Import whatever they need, are imported by no package, and are not in the wheel.
ABOVE = ("benchmarks", "reproduction", "simulator")


def sources(packages: tuple[str, ...] = PACKAGES) -> list[Path]:
    return [file for package in packages for file in sorted((ROOT / package).rglob("*.py"))]


@cache
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text())


@cache
def imported(file: Path) -> set[str]:
    """Top-level names of every package that `file` imports, at any depth of the code."""
    found = set()
    for node in ast.walk(parsed(file)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module.split(".")[0])
    return found


def test_imports_go_downwards() -> None:
    for file in sources():
        package = file.relative_to(ROOT).parts[0]
        assert imported(file) & {*PACKAGES, *ABOVE} - {package} <= ALLOWED[package], file


@pytest.mark.parametrize("foreign", DOORS)
def test_one_door(foreign: str) -> None:
    files = sources((*PACKAGES, "reproduction"))
    users = {str(file.relative_to(ROOT)) for file in files if foreign in imported(file)}
    assert users <= DOORS[foreign]


#: The rooms of fasbody from the ground up: each imports from the rows above its own, never from beside it or below.
ROOMS = (
    ("cache", "constants", "sentences", "progress"), ("exceptions",), ("lazy",), ("usage", "commands"),
    ("help", "completion"),
    ("console",), ("presentation", "runner"), ("page",),
    ("foot",),
    ("arch", "recording", "cell"), ("heel", "laboratory", "transmissibility"), ("acquire", "leg"),
)  # fmt: skip
#: Commands look into every room, and no room looks at them.
ENTRANCES = (
    "__main__",
    "commands",
    "load_effect",
    "heel",
)


@cache
def graphs() -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """Module -> our modules that it imports, also inside functions; then with what only a type checker reads."""
    files = {".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f for f in sources()}
    run: dict[str, set[str]] = {module: set() for module in files}
    read: dict[str, set[str]] = {module: set() for module in files}
    for module, file in files.items():
        waiting: list[tuple[ast.AST, bool]] = [(parsed(file), True)]
        while waiting:  # statements alone: expressions are most of a file, and import nothing
            node, runs = waiting.pop()
            if isinstance(node, ast.ImportFrom) and node.module:
                names = {f"{node.module}.{alias.name}" for alias in node.names}
                needs = {name if name in files else node.module for name in names} & set(files) - {module}
                read[module] |= needs
                run[module] |= needs if runs else set()
            guard = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
            waiting += [(inner, runs and not guard) for inner in getattr(node, "body", ())]
            for block in ("orelse", "finalbody", "handlers", "cases"):
                waiting += [(inner, runs) for inner in getattr(node, block, ())]
    return run, read


def graph(typed: bool = False) -> dict[str, set[str]]:
    return graphs()[typed]


@pytest.mark.parametrize("typed", [False, True])
def test_no_import_circle(typed: bool) -> None:
    """Nor among types, save for packages that name what is in them to type checkers."""
    packages = {m for m in graph() if (ROOT.joinpath(*m.split(".")) / "__init__.py").is_file()} if typed else set()
    waiting = {module: needs - packages for module, needs in graph(typed).items() if module not in packages}
    while free := [module for module, needs in waiting.items() if not needs & set(waiting)]:
        for module in free:
            del waiting[module]
    assert not waiting, f"these import each other, or what does: {sorted(waiting)}"


def test_rooms_import_from_the_ground_up() -> None:
    level = {room: number for number, rooms in enumerate(ROOMS) for room in rooms}
    for module, needs in graph().items():
        package, _, rest = module.partition(".")
        room = rest.partition(".")[0]
        if package != "fasbody" or module.rpartition(".")[2] in ENTRANCES or not room:
            continue
        for need in needs:
            if need.startswith("fasbody.") and (other := need.split(".")[1]) != room:
                assert level[other] < level[room], f"{module} imports {need}"


def text_of(module: str) -> str:
    place = ROOT.joinpath(*module.split("."))
    return (place.with_suffix(".py") if place.with_suffix(".py").is_file() else place / "__init__.py").read_text()


def test_nothing_imports_a_command() -> None:
    """A file that starts a Typer app is imported by no other, but for a package's `__main__` that hands on to it."""
    apps = {module for module in graph() if re.search(r"^app(: [\w.]+)? = typer\.Typer", text_of(module), re.MULTILINE)}
    for module, needs in graph().items():
        if module.rpartition(".")[2] not in ENTRANCES:
            assert not needs & apps, f"{module} imports the command {sorted(needs & apps)}"


def test_results_of_the_arch_know_neither_command_nor_figure() -> None:
    for module, needs in graph().items():
        if module.startswith("fasbody.arch.") and not module.endswith((".__main__", ".figures")):
            assert not imported(ROOT.joinpath(*module.split(".")).with_suffix(".py")) & {"typer", "rich"}, module
            assert not needs & {"fasbody.arch.figures", "fasbody.arch.__main__"}, module


def equation_index() -> dict[tuple[str, ...], tuple[set[str], set[str]]]:
    """Equations of a section -> files and functions that docs/equations.md names under it."""
    index = {}
    for section in (ROOT / "docs" / "equations.md").read_text().split("\n### ")[1:]:
        number = re.match(r"Eq\. (\d)\.(\d+)(?:-\d\.(\d+))?: .+\n\n```math\n.+\n```", section, re.DOTALL)
        assert number, f"no formula: {section[:40]}"
        chapter, first, last = number.groups()
        (code,) = re.findall(r"^- Code: (.+)$", section, re.MULTILINE)
        spans = re.findall(r"`([^`]+)`", re.sub(r"\]\([^)]+\)", "", code))
        functions = {span for span in spans if not span.endswith(".py")}
        numbers = tuple(f"{chapter}.{n}" for n in range(int(first), int(last or first) + 1))
        index[numbers] = set(spans) - functions, functions
    return index


def test_equation_index_and_code_name_the_same_equations() -> None:
    """Every `Eq. (n.m)` in the code has a formula in docs/equations.md pointing to that file, and the reverse."""
    in_code: dict[str, set[str]] = {}
    for file in sources():
        for number in re.findall(r"Eqs?\. \((\d\.\d+)\)", file.read_text()):
            in_code.setdefault(number, set()).add(str(file.relative_to(ROOT)))
    index = equation_index()
    assert sorted(in_code) == sorted(number for numbers in index for number in numbers)
    for numbers, (files, _) in index.items():
        assert set().union(*(in_code[number] for number in numbers)) == files, numbers


def test_functions_of_the_equation_index_exist() -> None:
    """Each function that docs/equations.md names is defined in one of the files beside it."""
    for numbers, (files, functions) in equation_index().items():
        defined = set()
        for file in files:
            waiting = [("", node) for node in parsed(ROOT / file).body]
            while waiting:
                above, node = waiting.pop()
                if isinstance(node, ast.FunctionDef | ast.ClassDef):
                    defined.add(above + node.name)
                    waiting += [(f"{above}{node.name}.", child) for child in node.body]
        assert functions <= defined, f"Eq. {numbers}: {functions - defined}"


def test_no_path_of_a_developer_machine() -> None:
    for file in sources((*PACKAGES, *ABOVE)):
        assert not re.search(r"/(home|work|root|Users)/", file.read_text()), file


def test_public_functions_on_arrays_say_shapes_or_units() -> None:
    """At least 17 of 20: `(n,)`, `(n, 3)`, "shape ..." or a unit in brackets stands in the docstring."""
    silent, told = [], 0
    for file in sources():
        tree = parsed(file)
        bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
        for function in (node for body in bodies for node in body if isinstance(node, ast.FunctionDef)):
            arguments = [*function.args.args, *function.args.kwonlyargs]
            types = [ast.unparse(t) for t in (*(a.annotation for a in arguments), function.returns) if t]
            if function.name.startswith("_") or not re.search(r"ndarray|NDArray|\bArray\b", " ".join(types)):
                continue
            if re.search(r"\[[^\]]+\]|\([^)]*,[^)]*\)|shape", ast.get_docstring(function) or ""):
                told += 1
            else:
                silent.append(f"{file.relative_to(ROOT)}:{function.lineno} {function.name}")
    assert told > 200
    assert len(silent) <= told * 3 / 17, "\n".join(silent)


def test_files_that_go_first_are_there() -> None:
    from conftest import LONGEST

    assert [name for name in LONGEST if not (ROOT / "tests" / f"test_{name}.py").is_file()] == []
