"""`python -m fasbody` knows every command, and says what its own help says."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.text import Text
from typer_apps import HOMES, click_command, sub_commands

from fasbody.__main__ import main
from fasbody.commands import GROUPS, PACKAGES, Command, commands

ROOT = Path(__file__).parent.parent


def first_line(click_help: str | None) -> str:
    return (click_help or "").strip().splitlines()[0].strip()


def test_no_command_is_missing_and_none_invented() -> None:
    ending = 'if __name__ == "__main__":'
    said = set()
    for package in PACKAGES:
        for file in (ROOT / package).rglob("*.py"):
            _, guard, after = file.read_text().partition(ending)
            if guard and "command_line(" in after:
                said.add(".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__main__"))
    assert len(said) > 20
    assert set(HOMES) == said


@pytest.mark.parametrize("module", sorted(HOMES))
def test_map_says_what_the_command_says(module: str) -> None:
    mapped = {command.name: command.does for command in commands() if command.module == module}
    app, subs = click_command(module), sub_commands(module)
    said = {name: first_line(sub.help) for name, sub in subs.items()}
    if app.help:
        said[""] = first_line(app.help)
    assert mapped == said


@pytest.mark.parametrize("command", commands(), ids=lambda command: command.call)
def test_help_ends_with_examples_that_name_the_command(command: Command) -> None:
    app, subs = click_command(command.module), sub_commands(command.module)
    found = subs.get(command.name, app)
    _, heading, examples = found.help.partition("\n\nExamples:\n")
    assert heading, "no examples"
    for line in filter(None, examples.splitlines()):
        assert re.match(rf"  (\w+=\S+ )?python -m {re.escape(command.module)}", line), line
    for parameter in found.params:
        shown = getattr(parameter, "help", None) or ""
        assert Text.from_markup(shown).plain == shown.replace("\\[", "["), (
            f"{parameter.name}: part of {shown!r} is hidden"
        )
        assert shown or getattr(parameter, "hidden", False), f"{parameter.name}: no help"


def test_command_prints_the_map(capsys: pytest.CaptureFixture[str]) -> None:
    main(json_=False)
    printed = capsys.readouterr().out
    places = [printed.index(f"\n{title}") if number else 0 for number, title in enumerate(GROUPS)]
    assert places == sorted(places)
    for command in commands():
        assert command.call in printed
    for target in re.findall(r"^(\w+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE):
        assert re.search(rf"make [\w, ]*\b{target}\b", printed)


def test_groups_name_only_what_there_is() -> None:
    known = {command.module for command in commands()} | set(PACKAGES) | {"fasbody.acquire"}
    assert {module for modules in GROUPS.values() for module in modules} <= known


def test_map_needs_no_extra_and_is_json_when_asked() -> None:
    """No command is imported for it: neither MuJoCo nor numba is loaded."""
    code = (
        "import sys, runpy; sys.argv = ['fasbody', '--json']\n"
        "try: runpy.run_module('fasbody', run_name='__main__')\n"
        "except SystemExit: pass\n"
        "assert not {'mujoco', 'numba', 'serial', 'gmsh'} & set(sys.modules), 'heavy'\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert {entry["module"] for entry in json.loads(done.stdout)} == set(HOMES)
