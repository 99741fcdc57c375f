"""`python -m MODULE words...` in this process: what is printed, said and returned, without the seconds of an import.

Exit codes of real processes are test_commands.py's.
"""

import contextlib
import io
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from typer_apps import HOMES

from fasbody.console import command_line, console, run_app

ROOT = Path(__file__).parent.parent


def draw_nothing(patch: pytest.MonkeyPatch) -> None:
    """Pictures are small and empty, where files matter and not what is on them: drawing takes longer than a fit."""
    from matplotlib.figure import Figure

    empty, save = Figure(figsize=(1, 1)), Figure.savefig
    patch.setattr(Figure, "savefig", lambda _, *words, **options: save(empty, *words, **options))


def command(module: str, *words: str, cwd: Path = ROOT) -> "subprocess.CompletedProcess[str]":
    """Run a command of the map to its end, as its file does when it is run."""
    app = import_module(HOMES[module]).app
    printed, said = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(cwd), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said),
        pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as ended,
    ):  # fmt: skip
        patch.setattr(console, "_width", 200)
        patch.setattr(sys, "argv", [module, *words])
        command_line(lambda: run_app(app, list(words), f"python -m {module}"))
    code = int(ended.value.code or 0)
    return subprocess.CompletedProcess([module, *words], code, printed.getvalue(), said.getvalue())
