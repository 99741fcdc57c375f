"""The built wheel holds code, models, templates and data, and runs from another folder."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
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
    files = [f for package in ("fasbody", "identification", "mjcf", "viz") for f in (ROOT / package).rglob("*.*")]
    here = {str(f.relative_to(ROOT)) for f in files if f.is_file() and "__pycache__" not in f.parts}
    assert len(here) > 50
    assert here - inside == set()
    assert not any(name.startswith(("tests/", "benchmarks/", "docs/", "reproduction/")) for name in inside)


def test_command_runs_from_another_folder(installed: Path, tmp_path: Path) -> None:
    done = run(installed, tmp_path, "-m", "identification.fit", "--help")
    assert done.returncode == 0, done.stderr
    assert "python -m identification.fit my_study" in done.stdout


def test_bundled_study_model_and_template_are_found_from_another_folder(installed: Path, tmp_path: Path) -> None:
    script = """
import fasbody, identification, mjcf
from pathlib import Path
from jinja2 import PackageLoader, Environment
from fasbody.model import load
from fasbody.recording import Study
from identification.fit import BUNDLED
print(Path(fasbody.__file__).parent.parent)
print(len(Study.read(BUNDLED).recordings), load("two_dof").step)
print(Environment(loader=PackageLoader("identification")).get_template("report.html").name)
"""
    done = run(installed, tmp_path, "-c", script)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[:3] == [str(installed), "9 0.0005", "report.html"]
