"""`python -m fasbody` knows every command, and says what its own help says."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from rich.text import Text
from typer_apps import HOMES, click_command, sub_commands

import docs
from fasbody.__main__ import main, run
from fasbody.commands import Command, commands, resolve
from fasbody.exceptions import SettingError

ROOT = Path(__file__).parent.parent
#: Where commands live; the last two are of a checkout only.
INSTALLED = ("fasbody", "identification", "viz")
PACKAGES = (*INSTALLED, "reproduction", "benchmarks")


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
    app = subs.get(command.name, app)
    _, heading, examples = app.help.partition("\n\nExamples:\n")
    assert heading, "no examples"
    assert Text.from_markup(app.help).plain == app.help.replace("\\[", "["), "part of the help is hidden"
    for line in filter(None, examples.splitlines()):
        assert docs.words(line)[2] == command.module or not command.words, line
    for parameter in app.params:
        shown = getattr(parameter, "help", None) or ""
        assert Text.from_markup(shown).plain == shown.replace("\\[", "["), (
            f"{parameter.name}: part of {shown!r} is hidden"
        )
        assert shown or getattr(parameter, "hidden", False), f"{parameter.name}: no help"


@pytest.mark.parametrize("started", ["/usr/bin/fasbody", "/somewhere/fasbody/__main__.py"])
def test_command_prints_the_map(
    started: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", [started])
    main(json_=False, version=False)
    printed = capsys.readouterr().out
    places = [
        printed.index(f"\n{title}") if number else 0
        for number, title in enumerate(dict.fromkeys(c.group for c in commands()))
    ]
    assert places == sorted(places)
    for command in commands():
        assert command.call in printed
    for target in re.findall(r"^(\w+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE):
        assert re.search(rf"make [\w, ]*\b{target}\b", printed)


def test_help_is_one_page_with_every_word(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what a wheel holds; `fasbody view` is the viewer and no list, though there is a `view cell`, too."""
    wheel = [c for c in commands() if c.module.split(".")[0] not in ("benchmarks", "reproduction")]
    monkeypatch.setattr("fasbody.__main__.commands", lambda: wheel)
    monkeypatch.setattr("sys.argv", ["fasbody", "--help"])
    run()
    printed = capsys.readouterr().out
    assert len(printed.splitlines()) < 60
    for command in wheel:
        assert set(command.words.split()) <= set(re.findall(r"\w+", printed)), command.words
    started = []
    monkeypatch.setattr("runpy.run_module", lambda module, **_: started.append(module))
    for words in (["view"], ["study"], ["cell", "--help"], ["plan"]):
        monkeypatch.setattr("sys.argv", ["fasbody", *words])
        run()
    assert started == ["viz.foot", "identification.study", "fasbody.cell", "identification.plan"]
    monkeypatch.setattr("sys.argv", ["fasbody", "arch"])
    run()
    assert "fasbody arch load: " in capsys.readouterr().out


def test_words_name_one_command_each() -> None:
    """The first words of a line find the command, the longest first, and what follows is left for it."""
    for command in commands():
        if command.words:
            assert resolve([*command.words.split(), "--json"]) == (command, ["--json"])
    assert resolve(["cell", "my_cell.vtu"])[0].words == "cell"
    with pytest.raises(SettingError, match=r"unknown command 'fti', did you mean 'fit'\?"):
        resolve(["fti"])
    with pytest.raises(SettingError) as far:
        resolve(["nonsense"])
    assert len(str(far.value)) < 150 and f"`fasbody` alone lists all {len(commands()) - 1}." in str(far.value)


def test_a_command_of_the_clone_says_so_where_it_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a wheel reproduction and benchmarks are missing."""
    installed = [command for command in commands() if command.needs != "reproduction"]
    monkeypatch.setattr("fasbody.commands.commands", lambda: installed)
    with pytest.raises(SettingError, match=r"'leg drop --json' runs in a clone of the project only"):
        resolve(["leg", "drop", "--json"])
    with pytest.raises(SettingError, match=r"unknown command 'leg dorp' \(valid: leg peaks"):
        resolve(["leg", "dorp"])


def test_installed_command_is_python_m() -> None:
    """The entry point runs what `python -m` runs; tests/test_help.py has the words of the help."""
    entry = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]["fasbody"]
    module, name = entry.split(":")
    code = f"import sys; from {module} import {name}; sys.argv = ['fasbody', *sys.argv[1:]]; {name}()"
    for words, plain in (("check x.csv", "fasbody.recording check x.csv"), ("nothing", "fasbody nothing")):
        short = subprocess.run([sys.executable, "-c", code, *words.split()], cwd=ROOT, capture_output=True, text=True)
        long = subprocess.run([sys.executable, "-m", *plain.split()], cwd=ROOT, capture_output=True, text=True)
        assert (short.stdout, short.stderr, short.returncode) == (long.stdout, long.stderr, long.returncode)
        assert short.returncode == 2


#: What no help needs; each costs a tenth of a second to a whole one.
HEAVY = ("mujoco", "numba", "scipy", "pandas", "matplotlib")
#: The single benchmarks have their own ways.
LIGHT = sorted({command.module for command in commands() if not command.module.startswith("benchmarks.")})


def test_help_imports_nothing_heavy() -> None:
    """Every installed command, one after the other in one process; the first that imports one of `HEAVY` is named."""
    code = """
import contextlib, io, runpy, sys
heavy, modules = sys.argv[1].split(), sys.argv[2:]
for module in modules:
    sys.argv = [module, "--help"]
    for known in [name for name in sys.modules if name in (module, f"{module}.__main__")]:
        del sys.modules[known]  # runpy warns of a module that another one has imported
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    if loaded := [name for name in heavy if name in sys.modules]:
        sys.exit(f"{module} --help imports {', '.join(loaded)}")
print(len(modules))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, " ".join(HEAVY), *LIGHT], cwd=ROOT, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert int(done.stdout) == len(LIGHT) > 10


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


@pytest.mark.parametrize("forced", [{}, {"FORCE_COLOR": "1"}, {"TTY_COMPATIBLE": "1"}], ids=str)
def test_progress_writes_nothing_into_a_pipe(forced: dict[str, str]) -> None:
    script = "from fasbody.console import progress_bar\nwith progress_bar() as p: list(p.track(range(3)))"
    told = {**{k: v for k, v in os.environ.items() if not k.startswith(("FORCE", "TTY"))}, **forced}
    done = subprocess.run([sys.executable, "-c", script], env=told, cwd=ROOT, capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")
