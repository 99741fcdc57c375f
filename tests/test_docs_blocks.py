"""Every code block of every document: Python runs, shell runs in a sandbox, and what cannot run is at least valid.

A command that needs hardware, a browser or minutes is not run (`NOT_RUN`, or a comment `<!-- not run: why -->` above
its block); its module, sub-command and options are held against Typer all the same. Long commands are shortened
(`SHORTER`): the same command with smaller numbers.
"""

import contextlib
import importlib.util
import io
import re
import runpy
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import in_process
import numpy as np
import pytest
from typer_apps import HOMES, click_command, sub_commands

import mjcf
from docs import DOCUMENTS, ROOT, Block, blocks, inline_commands, words
from fasbody.laboratory.foot import make_study

NOT_RUN = {
    r"^(make|pip|git|source)\b": "changes the environment; `make test` is what runs this",
    r"--port|--probe|--list|acquire (recover|calibrate)|--board (audio|ni|mcc|labjack)|--firmware": "needs a board",
    r"-m viz\.(foot|cell)\b(?!.*--export \S+\.html)": "serves a page, or needs Chromium",
    r"-m mujoco\.viewer": "needs a screen",
    r"recording merge|\*\.tdms|\dhz\.tdms": "needs files of an instrument; test_merge.py and test_layouts.py do it",
    r"-m benchmarks|benchmarks/": "takes minutes",
    r"-m reproduction\b(?!.*--only \"?(Eq|Table))|-m identification\.study chapter4": "takes minutes",
    r"-m identification\.study .*--(mode|scheduler)": "takes minutes or a scheduler; tests/test_study_*.py do it",
    r"fasbody\.cell (modes|response)": "takes long; tests/test_cell_body.py runs both on a rod",
    r"fasbody\.cell (verify|sweep)": "takes a minute; reproduction/cell does it",
    r"fasbody\.cell shake": "runs once, as its output is shown (PRINTED)",
}
SHORTER = {
    r"acquire --simulate": ["--sweep", "20:30:10", "--seconds", "0.5", "--out", "virtual_bench"],
    r"identification\.fit\b": ["--starts", "1"],
    r"identification\.heel\b": ["--law", "power", "--workers", "1"],
    r"identification\.study\b": ["--starts", "1", "--workers", "1", "--frequency", "20", "--added-mass", "0"],
    r"laboratory\b.*--subjects": ["--subjects", "2", "--seconds", "1", "--frequency", "20", "--jobs", "1"],
    r"laboratory\b": ["--seconds", "1", "--frequency", "10", "--frequency", "20"],
    r"(sensitivity|reduction)\b": ["--draws", "2"],
    r"crosscheck\b": ["--samples", "5"],
    r"fasbody\.cell\b": ["--size", "9", "--modes", "5"],
    r"blackbox\b": ["--structures", "oe", "--orders", "oe=4,4,1"],
}
PLAUSIBILITY = "from reproduction import published; print(published.plausibility())"
#: Text blocks that a quick command prints: page, what the block begins with, command.
PRINTED = (
    ("black_box.md", "270 recordings", f"python -c '{PLAUSIBILITY}'"),
    pytest.param("black_box.md", "model  ", "python examples/single_sine.py", marks=pytest.mark.long),
    pytest.param("cell.md", "mode  1", "python -m fasbody.cell shake", marks=pytest.mark.long),
)  # fmt: skip
INPUTS = ("20hz.csv", "30hz.csv", "40hz.csv")
#: Last commands of blocks that this process has run, each in a folder like the next one's.
RAN: set[str] = set()


@pytest.fixture(scope="session")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the documents assume the reader to have."""
    folder = tmp_path_factory.mktemp("desk")
    study = make_study(folder / "my_study", frequencies_hz=(20.0, 30.0, 40.0), added_masses_kg=(0.0, 2.3), seconds=1.0)
    for name in INPUTS:
        hz = name.removesuffix(".csv")
        shutil.copy(study / "recordings" / f"{hz}_0kg.csv", folder / name)
        shutil.copy(study / "recordings" / f"{hz}_2.3kg.csv", folder / f"{hz}_loaded.csv")
    (folder / "my_recordings").mkdir()
    for name in INPUTS:
        shutil.copy(folder / name, folder / "my_recordings")
    shutil.copy(folder / INPUTS[0], folder / "recording.csv")
    shutil.copy(study / "study.toml", folder / "study.toml")
    shutil.copytree(study, folder / "study")
    rng = np.random.default_rng(0)
    volts = np.repeat(rng.choice([-1.0, 1.0], 100), 10)
    speed = np.convolve(volts, 0.8 ** np.arange(40))[:1000] + 0.01 * rng.standard_normal(1000)
    np.savetxt(folder / "motor.csv", np.column_stack([volts, speed]), "%.6g", ",", header="volts,speed", comments="")
    shutil.copy(mjcf.path("two_dof"), folder / "my_foot.xml")
    shutil.copy(mjcf.path("foot_arch"), folder / "my_arch.xml")
    run(["-m", "fasbody.recording", "convert", str(folder / INPUTS[0]), str(folder / "measured.tdms")])
    return folder


def run(arguments: list[str]) -> None:
    """`python -m module ...` in this process, with names that have a * in them as a shell gives them."""
    arguments = [a for word in arguments for a in (map(str, sorted(Path().glob(word))) if "*" in word else [word])]
    command, rest = resolve(arguments[1], arguments[2:])
    with contextlib.redirect_stdout(io.StringIO()):
        command.main(rest, prog_name=arguments[1], standalone_mode=False)


def resolve(module: str, rest: list[str]) -> tuple[Any, list[str]]:
    """The command that runs, its sub-command if one is named or there is a default one, and its own arguments."""
    subs = sub_commands(module)
    if rest and rest[0] in subs:
        return subs[rest[0]], rest[1:]
    if subs and not getattr(click_command(module), "invoke_without_command", False) and rest[:1] != ["--help"]:
        return next(iter(subs.values())), rest  # as fasbody.acquire does
    return click_command(module), rest


def check(command: str, whole: bool) -> None:
    """A command names things that exist; with `whole`, all of its arguments parse too.

    Raises:
        AssertionError: naming what does not exist.
    """
    program, *arguments = words(command)
    if program == "make":
        target = next(word for word in arguments if "=" not in word)
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE), f"no target {target}"
    elif program == "pip":
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        for listed in re.findall(r"\[([\w,]+)\]", command):
            assert set(listed.split(",")) <= set(extras), f"no extra {listed}"
    elif program == "python" and arguments[:1] == ["-m"]:
        check_module(arguments[1], arguments[2:], whole)
    elif program == "python" and arguments[:1] == ["-c"]:
        compile(arguments[1], command, "exec")
    elif program == "python":
        assert (ROOT / arguments[0]).is_file(), f"no file {arguments[0]}"
    else:
        assert program in ("git", "source"), f"{program} is not known to this test"


def check_module(module: str, arguments: list[str], whole: bool) -> None:
    """The module runs, and knows the options."""
    if module not in HOMES:
        assert importlib.util.find_spec(module), f"no module {module}"
        assert not module.startswith(("fasbody", "identification", "viz")), f"{module} is no command"
        return
    command, rest = resolve(module, arguments)
    if whole:
        command.make_context(module, [word for word in rest if word != "--help"], resilient_parsing=not rest)
        return
    known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)} | {"--help"}
    for word in rest:
        if word.startswith("--"):
            assert word.split("=")[0] in known, f"python -m {module} has no option {word}"


def same(printed: str, documented: str) -> bool:
    """Equal but for the last digits of numbers: one in two hundred, as another machine may round."""
    number = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
    if re.sub(number, "#", " ".join(printed.split())) != re.sub(number, "#", " ".join(documented.split())):
        return False
    found, wanted = (np.array(re.findall(number, text), float) for text in (printed, documented))
    return bool(np.allclose(found, wanted, rtol=5e-3, atol=0))


#: Pages whose commands compute long.
LONG = ("acquisition", "arch", "cell", "CONTRIBUTING", "edit_model", "heel_pad", "laboratory", "study")
LONG += ("transmissibility", "tutorial", "viewer")

SHELL_BLOCKS = [
    pytest.param(block, id=f"{file.stem}:{block.line}", marks=[pytest.mark.long] if file.stem in LONG else [])
    for file in DOCUMENTS
    for block in blocks(file)
    if block.language in ("shell", "sh", "bash") and block.commands
]
PYTHON_FILES = [file for file in DOCUMENTS if any(block.language == "python" for block in blocks(file))]


@pytest.mark.usefixtures("undrawn", "patient")
@pytest.mark.parametrize("block", SHELL_BLOCKS)
def test_shell_block(block: Block, desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lines of a block run one after the other in one folder."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))  # for the virtual bench, a process of its own
    shutil.copytree(desk, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    for command in block.commands:
        check(command, whole=True)
        program, *arguments = words(command)
        text = " ".join([program, *arguments])
        if block.not_run or any(re.search(pattern, text) for pattern in NOT_RUN):
            continue
        if command == block.commands[-1]:
            if text in RAN:
                continue
            RAN.add(text)
        if arguments[0] == "-c":
            exec(compile(arguments[1], command, "exec"), {})
            continue
        if arguments[0].endswith(".py"):
            monkeypatch.setattr("sys.argv", [str(ROOT / arguments[0]), *arguments[1:]])
            runpy.run_path(sys.argv[0], run_name="__main__")
            continue
        run([*arguments, *next((extra for pattern, extra in SHORTER.items() if re.search(pattern, text)), [])])


@pytest.mark.parametrize(("page", "begins", "command"), PRINTED)
def test_text_block_is_what_the_command_prints(
    page: str, begins: str, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each line of the block is one of those printed, or the beginning of one."""
    monkeypatch.chdir(tmp_path)
    (block,) = (block for block in blocks(ROOT / "docs" / page) if block.text.lstrip().startswith(begins))
    _, *arguments = words(command)
    if arguments[0].endswith(".py"):
        arguments[0] = str(ROOT / arguments[0])
    if arguments[0] == "-m":
        done = in_process.command(*arguments[1:], cwd=tmp_path)
        printed = (done.stdout + done.stderr).splitlines()
    else:
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            if arguments[0] == "-c":
                exec(compile(arguments[1], command, "exec"), {})
            else:
                monkeypatch.setattr("sys.argv", arguments)
                runpy.run_path(arguments[0], run_name="__main__")
        printed = out.getvalue().splitlines()
    for line in filter(str.strip, block.text.splitlines()):
        found = [" ".join(other.split()[: len(line.split())]) for other in printed]
        assert any(same(other, line) for other in found), f"{page}:{block.line} has {line!r}; printed now:\n{found}"


@pytest.mark.parametrize("file", PYTHON_FILES, ids=lambda f: f.stem)
def test_python_blocks(file: Path, desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks of a document run one after the other, and print what stands below them."""
    shutil.copytree(desk, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("identification.optimiser.ROUNDS", 1)  # test_bundled.py fits to the end
    names: dict[str, Any] = {}
    printed = ""
    for block in blocks(file):
        if block.language == "python" and not block.not_run:
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(block.text, f"{file.name}:{block.line}", "exec"), names)
            printed = out.getvalue()
        elif block.language == "output":
            assert same(printed, block.text), f"{file.name}:{block.line} is now\n{printed}"


@pytest.mark.parametrize("file", DOCUMENTS, ids=lambda f: str(f.relative_to(ROOT)))
def test_commands_in_the_text_exist(file: Path) -> None:
    for command in inline_commands(file):
        check(command, whole=False)


@pytest.mark.parametrize("file", DOCUMENTS, ids=lambda f: str(f.relative_to(ROOT)))
def test_blocks_of_settings_and_commands_keep_their_lines(file: Path) -> None:
    """TOML is TOML, and no comment in a block of commands has swallowed the next command."""
    for block in blocks(file):
        if block.language == "toml":
            assert tomllib.loads(block.text), f"{file.name}:{block.line}"
        elif block.language != "python":
            joined = [line for line in block.text.splitlines() if re.search(r"#.* (fasbody|make) \w+", line)]
            assert not joined, f"{file.name}:{block.line} {joined}"


def test_a_wrong_block_would_be_found() -> None:
    for wrong in (
        "python -m fasbody.cel", "python -m fasbody.cell --presett si", "make fitt", "pip install 'fasbody[nothing]'",
        "python -m identification.fit --starts many", "python examples/none.py",
    ):  # fmt: skip
        with pytest.raises(Exception, match=r".+"):
            check(wrong, whole=True)
    with pytest.raises(AssertionError, match="no option --fo"):
        check("python -m identification.fit --fo", whole=False)
    assert same("k 1.000 N", "k 1.001 N") and not same("k 1.00 N", "k 1.02 N") and not same("k 1 N", "c 1 N")
