"""The built wheel holds code, models, templates and data, and runs from another folder."""

import ast
import json
import os
import re
import shutil
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


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("site")
    options = ["--quiet", "--disable-pip-version-check", "--no-deps", "--no-index", "--target", str(target)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(wheel)], check=True, capture_output=True)
    return target


def run(installed: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(installed), "COLUMNS": "200"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    inside = set(zipfile.ZipFile(wheel).namelist())
    files = [f for package in ("fasbody", "identification", "mjcf", "viz") for f in (ROOT / package).rglob("*")]
    here = {str(f.relative_to(ROOT)) for f in files if f.is_file() and "__pycache__" not in f.parts}
    assert len(here) > 50
    assert here - inside == set()
    assert {name for name in inside if ".dist-info/" not in name} - here == set()
    checkout = ("tests/", "benchmarks/", "docs/", "reproduction/", "simulator/")
    assert not any(name.startswith(checkout) for name in inside)


def test_each_command_explains_itself(installed: Path, tmp_path: Path) -> None:
    """`python -m MODULE --help` of every command, one after the other in one process to save the imports."""
    script = """
import contextlib, io, runpy, sys
from pathlib import Path
import fasbody
from fasbody.commands import commands
print(Path(fasbody.__file__).parent.parent)
for module in sorted({command.module for command in commands()}):
    sys.argv, out = [module, "--help"], io.StringIO()
    for name in [name for name in sys.modules if name == module or name == f"{module}.__main__"]:
        del sys.modules[name]  # runpy warns of a module that another one has imported
    with contextlib.redirect_stdout(out):
        try:
            runpy.run_module(module, run_name="__main__", alter_sys=True)
            code = 0
        except SystemExit as stop:
            code = stop.code or 0
    print(module, code, f"python -m {module}" in " ".join(out.getvalue().split()))
"""
    done = run(installed, tmp_path, "-c", script)
    assert done.returncode == 0, done.stderr
    place, *lines = done.stdout.splitlines()
    assert place == str(installed)
    assert len(lines) > 12 and "identification.fit 0 True" in lines
    assert all(line.split()[1] == "0" for line in lines), lines
    assert not any(line.startswith("benchmarks") for line in lines)


def take_what_is_compiled(installed: Path) -> None:
    """Put what numba has compiled of the same files in the checkout beside those of the wheel.

    numba knows a file by its time and size. What it compiles anew would be the same, and take half a minute.
    """
    for package in ("fasbody", "identification"):
        for file in (installed / package).rglob("*.py"):
            source = ROOT / file.relative_to(installed)
            if file.read_bytes() == source.read_bytes():
                os.utime(file, ns=(0, source.stat().st_mtime_ns))
        for kept in (ROOT / package).rglob("__pycache__/*.nb[ci]"):
            (folder := installed / kept.parent.relative_to(ROOT)).mkdir(exist_ok=True)
            shutil.copy(kept, folder)


@pytest.mark.long
def test_main_job_runs_from_another_folder(installed: Path, tmp_path: Path) -> None:
    """`make fit` from the wheel: bundled study, model and template are found."""
    take_what_is_compiled(installed)
    script = """
import runpy, sys
from matplotlib.figure import Figure
empty, save = Figure(figsize=(1, 1)), Figure.savefig
Figure.savefig = lambda _, *words, **options: save(empty, *words, **options)  # drawing takes longer than the fit
sys.argv = ["identification.fit", "--starts", "1", "--out", "results"]
runpy.run_module("identification.fit", run_name="__main__", alter_sys=True)
"""
    done = run(installed, tmp_path, "-c", script)
    assert done.returncode == 0, done.stderr
    assert "synthetic" in (tmp_path / "results" / "report.html").read_text()
    result = json.loads((tmp_path / "results" / "result.json").read_text())
    assert result["verdict"] == "decided"
    if_true = result["parameters"]["k_T_n_per_m"]["if_model_true"]
    assert if_true["value"] == pytest.approx(131_000, rel=0.01)


def test_map_of_commands_is_in_the_wheel(installed: Path, tmp_path: Path) -> None:
    done = run(installed, tmp_path, "-m", "fasbody")
    assert done.returncode == 0, done.stderr
    assert "fasbody fit" in done.stdout and "fasbody view" in done.stdout


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
