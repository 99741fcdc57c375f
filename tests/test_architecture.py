"""The shape of the project: imports go downwards, one door to each foreign package, equations are listed."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("mjcf", "fasbody", "identification", "viz")
ALLOWED = {
    "mjcf": set(),
    "fasbody": {"mjcf"},
    "identification": {"fasbody", "mjcf"},
    "viz": {"fasbody", "mjcf"},
}
# package -> the only files (relative to the root, or a bare name for any file of that name) that may import it
DOORS = {
    "pinocchio": {"fasbody/arch/crosscheck.py"},
    "serial": {"fasbody/acquire/port.py"},
    "meshcat": {"viz/scene.py"},
    "gmsh": {"fasbody/cell/mesh.py"},
    "dask": {"identification/study/cluster.py"},
    "distributed": {"identification/study/cluster.py"},
    "matplotlib": {"figures.py"},
}


#: Import whatever they need, are imported by no package, and are not in the wheel.
ABOVE = ("benchmarks", "reproduction")


def sources(packages: tuple[str, ...] = PACKAGES) -> list[Path]:
    return [file for package in packages for file in sorted((ROOT / package).rglob("*.py"))]


def walk(node: ast.AST) -> Iterator[ast.AST]:
    """Every node at any depth, without what only a type checker runs."""
    yield node
    if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
        for child in ast.iter_child_nodes(node):
            yield from walk(child)


@cache
def modules(file: Path) -> frozenset[str]:
    """Modules that `file` imports, at any depth of the code, as a file or a package of this project has them."""
    found: set[str] = set()
    for node in walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            deeper = {f"{node.module}.{alias.name}" for alias in node.names}
            there = {name for name in deeper if ROOT.joinpath(*name.split(".")).with_suffix(".py").is_file()}
            found |= there or {node.module}
    return frozenset(found)


def imported(file: Path) -> set[str]:
    """Top-level names of every package that `file` imports, at any depth of the code."""
    return {name.split(".")[0] for name in modules(file)}


#: Rooms that are free of circles, also of those inside functions.
STRAIGHT = ("fasbody.foot", "fasbody.arch")


def test_no_import_circle() -> None:
    graph = {".".join(file.relative_to(ROOT).with_suffix("").parts): modules(file) for file in sources(("fasbody",))}

    def reached(start: str) -> set[str]:
        found, open_ = set(), list(graph[start])
        while open_:
            name = open_.pop()
            if name in graph and name not in found:
                found.add(name)
                open_ += graph[name]
        return found

    rooms = [name for name in graph if name.startswith(STRAIGHT)]
    assert len(rooms) > 15
    assert [name for name in rooms if name in reached(name)] == []


def test_results_of_the_arch_know_neither_command_nor_figure() -> None:
    for file in (ROOT / "fasbody" / "arch").glob("*.py"):
        if file.name not in ("__main__.py", "figures.py"):
            assert not {
                m for m in modules(file) if m.startswith(("typer", "rich")) or m.endswith((".figures", ".__main__"))
            }


@pytest.mark.parametrize("file", sources(), ids=lambda f: str(f.relative_to(ROOT)))
def test_imports_go_downwards(file: Path) -> None:
    package = file.relative_to(ROOT).parts[0]
    assert imported(file) & {*PACKAGES, *ABOVE} - {package} <= ALLOWED[package]


@pytest.mark.parametrize("foreign", DOORS)
def test_one_door(foreign: str) -> None:
    files = sources((*PACKAGES, "reproduction"))
    users = {str(file.relative_to(ROOT)) for file in files if foreign in imported(file)}
    doors = DOORS[foreign]
    assert {user for user in users if user not in doors and Path(user).name not in doors} == set()


def test_equation_index_and_code_name_the_same_equations() -> None:
    """Every `Eq. (n.m)` in the code has a row in docs/equations.md pointing to that file, and the reverse."""
    in_code: dict[str, set[str]] = {}
    for file in sources():
        for number in re.findall(r"Eqs?\. \((\d\.\d+)\)", file.read_text()):
            in_code.setdefault(number, set()).add(str(file.relative_to(ROOT)))
    index: dict[str, set[str]] = {}
    for line in (ROOT / "docs" / "equations.md").read_text().splitlines():
        row = re.match(r"\| (\d\.\d+) \|", line)
        if row:
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            index[row[1]] = set(re.findall(r"`([^`]+)`", cells[2]))
            tests = re.findall(r"`([^`]+)`", cells[3])
            assert tests, f"Eq. ({row[1]}) names no test"
            for test in tests:
                assert (ROOT / "tests" / test).exists(), f"Eq. ({row[1]}) names the missing test {test}"
    assert in_code == index


def test_no_path_of_a_developer_machine() -> None:
    for file in sources((*PACKAGES, *ABOVE)):
        assert not re.search(r"/(home|work|root|Users)/", file.read_text()), file


def test_public_functions_on_arrays_say_shapes_or_units() -> None:
    """At least 17 of 20: `(n,)`, `(n, 3)`, "shape ..." or a unit in brackets stands in the docstring."""
    silent, told = [], 0
    for file in sources():
        tree = ast.parse(file.read_text())
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
