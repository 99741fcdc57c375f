"""The commands on the arch: what cannot be meant is refused before the work, in one sentence; old names still run."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fasbody.arch.__main__ import app


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["sensitivity", "--figures", "{taken}"], "taken: is a file; name a folder"),
        (["load", "--figures", "{taken}"], "taken: is a file; name a folder"),
        (["reduction", "--figure", "{folder}"], "is a folder; name a PNG file"),
        *((["load", "--load", load], "must be above 0 and below 100000 N") for load in ("0", "-5", "1e6", "nan")),
        *((["sensitivity", "--trajectory", f], "must be between 1 and 1000 Hz") for f in ("0.5", "nan")),
    ],
)
def test_refused_before_the_work(tmp_path: Path, arguments: list[str], sentence: str) -> None:
    taken = tmp_path / "taken"
    taken.write_text("")
    run = CliRunner().invoke(app, [word.format(taken=taken, folder=tmp_path) for word in arguments])
    assert sentence in str(run.exception)
    assert run.output == ""  # no table: the work had not begun


@pytest.mark.parametrize(
    ("old", "new"),
    [("crosscheck", "crosscheck"), ("sensitivity", "sensitivity"), ("reduction", "reduction"), ("static_load", "load")],
)
def test_old_names_run_and_say_the_new_ones(command: Callable[..., Any], old: str, new: str) -> None:
    run = command(f"fasbody.{old}", "--seed", "-1")
    assert run.returncode == 2
    assert "Traceback" not in run.stderr
    assert "--seed" in run.stderr  # refused by the command itself; load has no such option
    assert f"`python -m fasbody.{old}` has moved to python -m fasbody.arch {new}." in run.stderr
    assert run.stdout == ""
