"""The page's scripts by TypeScript's checker: types of the server's documents, misspelt names, wrong arguments."""

import shutil
import subprocess
from pathlib import Path

import pytest

from viz.display import PAGE, SCRIPT

TEMPLATES = {"foot": ("page.html", "foot.html"), "cell": ("page.html", "cell.html")}
OPTIONS = (
    "--noEmit", "--allowJs", "--checkJs", "--skipLibCheck", "--target", "es2022", "--lib", "es2023,dom,dom.iterable",
    "--strict", "false", "--types", "",
)  # fmt: skip


@pytest.fixture(scope="module")
def checker(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """TypeScript from npm's registry, in a folder that goes; nothing of it is kept with the project."""
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("no npm on this machine (apt-get install npm)")
    folder = tmp_path_factory.mktemp("typescript")
    quiet = ("--no-save", "--no-package-lock", "--no-audit", "--no-fund")
    got = subprocess.run([npm, "install", *quiet, "typescript"], cwd=folder, capture_output=True, check=False)
    if got.returncode:
        pytest.skip("TypeScript is not to be had from npm's registry")
    return folder / "node_modules" / ".bin" / "tsc"


def complaints(checker: Path, folder: Path, files: list[str]) -> list[str]:
    run = subprocess.run(
        [checker, *OPTIONS, "types.d.ts", *files], cwd=folder, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0 or run.stdout, run.stderr
    return run.stdout.splitlines()


def scripts(page: str) -> list[str]:
    names = [name for file in TEMPLATES[page] for name in SCRIPT.findall((PAGE / file).read_text())]
    return [name for name in names if not name.startswith(("vendor/", "meshcat"))]


@pytest.mark.long
@pytest.mark.parametrize("page", TEMPLATES)
def test_scripts_of_a_page_have_no_type_errors(checker: Path, page: str) -> None:
    assert complaints(checker, PAGE, scripts(page)) == []


@pytest.mark.long
def test_a_misspelt_entry_of_a_document_is_seen(checker: Path, tmp_path: Path) -> None:
    for file in (*PAGE.glob("*.js"), PAGE / "types.d.ts"):
        shutil.copy(file, tmp_path)
    script = tmp_path / "signals.js"
    text = script.read_text()
    assert "row.start_s" in text
    script.write_text(text.replace("row.start_s", "row.begin_s", 1))
    (line,) = complaints(checker, tmp_path, scripts("foot"))
    assert "begin_s" in line
