"""The page's modules: what they import, and what TypeScript's checker says of their types, names and arguments."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from viz.display import IMPORT, MODULE, PAGE, joined, markup, modules

PAGES = ("foot.html", "cell.html")
OPTIONS = (
    "--noEmit", "--allowJs", "--checkJs", "--skipLibCheck", "--target", "es2022", "--module", "es2022",
    "--moduleResolution", "bundler", "--lib", "es2023,dom,dom.iterable", "--types", "",
)  # fmt: skip
#: Modules of which the strict checker still complains.
LOOSE = ("cell.js", "gltf.js")
OWN = sorted(file.name for file in PAGE.glob("*.js"))


def test_each_script_of_the_page_is_a_module_that_a_page_runs() -> None:
    """No script is left with names in the global scope, and the pages name modules and meshcat only."""
    run = {name for page in PAGES for name in modules(markup(page, "key"))}
    assert {name for name in run if not name.startswith("vendor/")} == set(OWN)
    for page in PAGES:
        assert re.findall(r'<script src="([^"]+)"', markup(page, "key")) == ["meshcat.js"]
    for name in OWN:
        text = (PAGE / name).read_text()
        assert len(IMPORT.findall(text)) == len(re.findall(r"^\s*import\b(?!\()", text, re.MULTILINE)), name
        assert len(re.findall(r"\b(?:window|globalThis|self)\.\w+ ?=(?!=)|Object\.assign\(window", text)) == (
            name in ("foot.js", "cell.js")
        ), name


def test_imports_of_modules_go_one_way() -> None:
    imports = {name: set(IMPORT.findall((PAGE / name).read_text())) & set(OWN) for name in OWN}
    while free := [name for name, needed in imports.items() if not needed]:
        imports = {name: needed - set(free) for name, needed in imports.items() if name not in free}
    assert imports == {}  # what is left imports itself


@pytest.mark.parametrize("page", PAGES)
def test_modules_of_a_page_can_be_joined(page: str, tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on this machine (apt-get install nodejs)")
    file = tmp_path / "joined.mjs"
    file.write_text(joined(modules(markup(page))))
    assert re.search(r"^(import|export)\b", file.read_text(), re.MULTILINE) is None
    run = subprocess.run([node, "--check", file], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[:500]


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


def complaints(checker: Path, folder: Path, page: str, strict: str = "false") -> list[str]:
    first = MODULE.findall(markup(page, "key"))
    run = subprocess.run(
        [checker, *OPTIONS, "--strict", strict, "types.d.ts", *first], cwd=folder, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert run.returncode == 0 or run.stdout, run.stderr
    return run.stdout.splitlines()


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES)
def test_modules_of_a_page_have_no_type_errors(checker: Path, page: str) -> None:
    assert complaints(checker, PAGE, page) == []
    assert [line for line in complaints(checker, PAGE, page, "true") if not line.startswith((*LOOSE, " "))] == []


@pytest.mark.long
def test_a_misspelt_entry_of_a_document_is_seen(checker: Path, tmp_path: Path) -> None:
    folder = tmp_path / "page"
    shutil.copytree(PAGE, folder)
    script = folder / "signals.js"
    text = script.read_text()
    assert "row.start_s" in text
    script.write_text(text.replace("row.start_s", "row.begin_s", 1))
    (line,) = complaints(checker, folder, "foot.html")
    assert "begin_s" in line
