"""Errors travel from a worker process as the sentence that they are."""

import pickle
import re
import tomllib
from pathlib import Path

import pytest

from fasbody import exceptions
from fasbody.exceptions import FasError, InputFileError, MissingPackageError, SettingError

ROOT = Path(__file__).parent.parent
PACKAGES = ("fasbody", "identification", "viz")


@pytest.mark.parametrize(
    "error",
    [
        InputFileError(Path("a.csv"), "is empty", "give numbers", 3),
        MissingPackageError("h5py", "formats"),
        SettingError("no"),
    ],
)
def test_an_error_comes_back_from_another_process(error: FasError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error)


def test_every_error_is_one_that_commands_print() -> None:
    kinds = [kind for kind in vars(exceptions).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    assert len(kinds) > 8
    assert all(issubclass(kind, FasError | exceptions.Stopped) for kind in kinds)


def test_a_missing_package_names_the_extra_for_a_wheel_and_for_a_clone() -> None:
    """One function says how to install; no other module has a sentence of its own."""
    error = MissingPackageError("gmsh", "cell", otherwise="give a mesh")
    both = "pip install 'fasbody[cell]' (in a clone: pip install -e '.[cell]')"
    assert str(error) == f"gmsh is not installed: {both}, or give a mesh."
    broken = MissingPackageError("gmsh", "cell", "libGLU.so.1: no such file", remedy="apt-get install libglu1-mesa")
    assert str(broken) == "gmsh does not load (libGLU.so.1: no such file): apt-get install libglu1-mesa."
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    assert [file.name for file in files if "pip install" in file.read_text()] == ["exceptions.py"]


def test_every_extra_that_is_named_exists() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    text = "".join(file.read_text() for package in PACKAGES for file in (ROOT / package).rglob("*.py"))
    named = re.findall(r'MissingPackageError\(\s*[^,()]+(?:\([^)]*\))?[^,()]*,\s*"(\w+)"', text)
    named += re.findall(r"pip_install\(['\"](\w+)", text)
    assert len(named) > 15 and set(named) <= set(extras)
