"""Errors are facts: each writes its sentence of them, for a terminal and for the page, and travels with them."""

import pickle
import re
import tomllib
from pathlib import Path

import pytest

from fasbody import exceptions
from fasbody.exceptions import (
    FasError,
    InputFileError,
    MissingPackageError,
    NotSmoothError,
    RecordingError,
    SettingError,
    by_name,
)
from fasbody.sentences import SETTINGS, Sentence, called

ROOT = Path(__file__).parent.parent
PACKAGES = ("fasbody", "identification", "viz")


@pytest.mark.parametrize(
    "error",
    [
        InputFileError(Path("a.csv"), "is empty", "give numbers", 3),
        MissingPackageError("h5py", "formats"),
        SettingError("no"),
        SettingError(setting="draws", quantity="the number of draws", value=1, valid="2 or more"),
        NotSmoothError("foot", 20.0, 48, 1e-3),
    ],
)
def test_an_error_comes_back_from_another_process_with_its_facts(error: FasError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error) and vars(again) == vars(error)
    assert again.on_page() == error.on_page() and again.sentence.code == error.code


def test_a_sentence_is_written_of_the_facts() -> None:
    error = SettingError(setting="draws", quantity="the number of draws", value=1, valid="2 or more")
    assert (str(error), error.on_page()) == 2 * ("the number of draws is 1; give 2 or more.",)
    with pytest.raises(TypeError, match="no attribute values"):
        SettingError("no", values=1)


@pytest.mark.parametrize("setting", [*SETTINGS, "channels.base.unit"])
def test_every_setting_has_a_name_for_each_reader(setting: str) -> None:
    remedy = Sentence("give ", called(setting, "g"))
    error = InputFileError("/tmp/x/a.csv", "has no unit", remedy, 3, setting=setting)
    assert (error.file, error.line, error.setting, error.remedy) == ("/tmp/x/a.csv", 3, setting, remedy)
    assert error.on_page("a.csv").startswith("a.csv, line 3: has no unit; give ")
    for option in ("--", "study.toml:", "[channels", "fasbody "):
        assert option not in error.on_page()
    assert re.search("--|study.toml|fasbody ", str(error))


def test_a_recording_is_named_once_and_its_reason_stands_alone() -> None:
    with pytest.raises(RecordingError) as caught, by_name("/tmp/x/a.csv"):
        raise RecordingError(problem="is too short", code="short")
    assert (str(caught.value), caught.value.reason) == ("/tmp/x/a.csv: is too short.", "is too short.")
    assert caught.value.on_page("a.csv") == "a.csv: is too short." and caught.value.code == "short"
    with pytest.raises(RecordingError) as again, by_name("other"):
        raise caught.value
    assert again.value is caught.value
    with pytest.raises(RecordingError) as stated, by_name("a.csv"):
        raise RecordingError("a cross-spectrum needs a period.")
    assert str(stated.value) == "a.csv: a cross-spectrum needs a period."
    assert stated.value.reason == "a cross-spectrum needs a period."
    assert stated.value.code.startswith(f"{__name__}:")  # where it was raised


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
    named = re.findall(r'(?:MissingPackageError|required)\(\s*[^,()]+(?:\([^)]*\))?[^,()]*,\s*"(\w+)"', text)
    named += re.findall(r"pip_install\(['\"](\w+)", text)
    assert len(named) > 15 and set(named) <= set(extras)
