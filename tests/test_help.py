"""What `--help` shows, and what completes a command in a shell."""

import itertools
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fasbody.commands import commands
from fasbody.completion import SCRIPTS, following, script
from fasbody.exceptions import SettingError

ROOT = Path(__file__).parent.parent
#: Runs the entry point of an installed `fasbody`.
INSTALLED = "import sys; from fasbody.__main__ import start; sys.argv[0] = 'fasbody'; start()"


def helped(*arguments: str) -> str:
    done = subprocess.run([sys.executable, *arguments, "--help"], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.parametrize(
    ("words", "module"),
    [("plan run", "identification.plan run"), ("check", "fasbody.recording check"),
     *(pytest.param(*each, marks=pytest.mark.long) for each in (
         ("fit", "identification.fit"), ("recording check", "fasbody.recording check"), ("record", "fasbody.acquire"),
         ("leg name", "fasbody.leg name")))],
)  # fmt: skip
def test_help_calls_a_command_as_it_was_started(words: str, module: str) -> None:
    short, long = helped("-c", INSTALLED, *words.split()), helped("-m", *module.split())
    assert f"Usage: fasbody {words} [" in short and "python -m" not in short
    assert f"Usage: python -m {module} [" in long
    for text in (short, long):
        assert not re.search(r"<\w+|\w+\[(Path|str|int|float)\]", text)
        if "Examples:" in text:
            assert text.index("Options") < text.index("Examples:")


@pytest.mark.parametrize("module", ["fasbody heel", "fasbody.leg name"])
def test_paragraphs_are_broken_once(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A line that ended where the source's did had its rest alone in a line of its own."""
    monkeypatch.setenv("COLUMNS", "80")
    text = helped("-m", *module.split()).partition("Usage:")[2].partition("╭")[0]
    lines = [line.strip() for line in text.splitlines()]
    for line, following_ in itertools.pairwise(lines):
        if line and following_:
            assert len(line) + 1 + len(following_.split()[0]) > 78, line


def test_completion_knows_words_and_options() -> None:
    assert set(following([])) >= {command.words.split()[0] for command in commands() if command.words}
    assert {"sensitivity", "load"} <= set(following(["arch"]))
    assert "--model" in following(["fit"]) and "run" in following(["plan"])
    assert following(["nonsense"]) == []
    for shell in SCRIPTS:
        assert "fasbody --following" in script(shell)
    with pytest.raises(SettingError, match=r"unknown shell .csh."):
        script("csh")


def test_bash_completes_with_the_script() -> None:
    asked = f'{script("bash")}\nfasbody() {{ {sys.executable} -c "{INSTALLED}" "$@"; }}\n' + (
        'COMP_WORDS=(fasbody fit --bod); COMP_CWORD=2; _fasbody; echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(["bash", "-c", asked], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "--body-mass"


def test_a_package_that_hides_ours_is_named(tmp_path: Path) -> None:
    (tmp_path / "viz").mkdir()
    (tmp_path / "viz" / "__init__.py").write_text("")
    code = f"import sys; sys.path.append({str(ROOT)!r}); {INSTALLED}"
    for place, warned in ((tmp_path, True), (ROOT, False)):
        done = subprocess.run([sys.executable, "-c", code, "--version"], cwd=place, capture_output=True, text=True)
        assert ("hides the package viz" in done.stderr) == warned
