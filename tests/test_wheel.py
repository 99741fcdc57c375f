"""The built wheel holds code, models, templates and data; .ci/bare_wheel runs every command of it."""

import ast
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
OURS = {"fasbody", "identification", "mjcf", "viz"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from the source distribution, which is built from here."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    (file,) = folder.glob("*.whl")
    return file


def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    inside = set(zipfile.ZipFile(wheel).namelist())
    files = [f for package in ("fasbody", "identification", "mjcf", "viz") for f in (ROOT / package).rglob("*")]
    here = {str(f.relative_to(ROOT)) for f in files if f.is_file() and "__pycache__" not in f.parts}
    assert len(here) > 50
    assert here - inside == set()
    assert {name for name in inside if ".dist-info/" not in name} - here == set()
    checkout = ("tests/", "benchmarks/", "docs/", "reproduction/", "simulator/")
    assert not any(name.startswith(checkout) for name in inside)


def test_what_the_packages_import_is_declared(wheel: Path) -> None:
    """The tests above see the environment around them; this one reads what a bare install would lack.

    What is imported at once must come with `fasbody` itself, unless a whole module belongs to an extra; what a function
    imports must at least be of some extra.
    """
    inside = zipfile.ZipFile(wheel)
    (name,) = (name for name in inside.namelist() if name.endswith(".dist-info/METADATA"))
    required = re.findall(r"^Requires-Dist: ([\w.-]+)[^;\n]*(;.*extra.*)?$", inside.read(name).decode(), re.MULTILINE)
    core = {_plain(distribution) for distribution, extra in required if not extra}
    extras = {_plain(distribution) for distribution, extra in required if extra}
    assert core >= {"numpy", "mujoco"} and extras >= {"gmsh", "pyserial"}
    providers = {module: {_plain(d) for d in names} for module, names in metadata.packages_distributions().items()}
    providers |= BROUGHT_BY
    missing, nowhere = [], []
    for file in (name for name in inside.namelist() if name.endswith(".py")):
        for imported, at_import in _imports(ast.parse(inside.read(file))):
            module = imported.partition(".")[0]
            if module in sys.stdlib_module_names:
                continue
            needs_extra = imported in OF_EXTRA if module in OURS else not providers.get(module, {module}) & core
            if at_import and needs_extra and file.removesuffix(".py").replace("/", ".") not in OF_EXTRA:
                missing.append(f"{file}: {imported}")
            if module not in OURS | USED_IF_THERE and not providers.get(module, {module}) & (core | extras):
                nowhere.append(f"{file}: {imported}")
    assert not missing, f"imported at once, but not among the dependencies: {missing}"
    assert not nowhere, f"in no extra: {nowhere}"


#: Modules that are imported inside functions only, as they need the extra `view`.
OF_EXTRA = {"viz.server"}
#: Modules whose distribution has another name, or brings them as its own dependency.
BROUGHT_BY = {"pinocchio": {"pin"}, "dask": {"distributed"}, "umsgpack": {"meshcat"}, "labjack": {"labjack-ljm"}}
#: Faster where a user has it, never needed.
USED_IF_THERE = {"pypardiso"}


def _plain(distribution: str) -> str:
    return re.sub(r"[-_.]+", "-", distribution).lower()


def _imports(tree: ast.Module) -> Iterator[tuple[str, bool]]:
    """Dotted name of all that is imported, and whether that happens as soon as the file is imported."""
    waiting: list[tuple[ast.AST, bool]] = [(tree, True)]
    while waiting:  # statements alone: expressions are most of a file, and import nothing
        node, at_import = waiting.pop()
        if isinstance(node, ast.Import):
            yield from ((alias.name, at_import) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield from (
                (name, at_import) for name in [f"{node.module}", *(f"{node.module}.{a.name}" for a in node.names)]
            )
        waits = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Try)
        waits |= isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting += [(inner, at_import and not waits) for inner in getattr(node, block, ())]
