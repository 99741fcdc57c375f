"""The commands on the arch: what cannot be meant is refused before the work, in one sentence; old names still run."""

import runpy
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fasbody.arch.__main__ import app


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["sensitivity", "--figures", "{taken}"], "taken: is a file; name a folder"),
        (["load", "--figures", "{taken}"], "taken: is a file; name a folder"),
        (["reduction", "--figure", "{folder}"], "is a folder; name an SVG or PNG file"),
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
def test_old_names_run_and_say_the_new_ones(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], old: str, new: str
) -> None:
    monkeypatch.delitem(sys.modules, "fasbody.arch.__main__", raising=False)  # runpy warns where it is imported already
    monkeypatch.setattr(sys, "argv", [f"fasbody.{old}", "--seed", "-1"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(f"fasbody.{old}", run_name="__main__", alter_sys=True)
    assert ended.value.code == 2
    printed, said = capsys.readouterr()
    assert "--seed" in said  # refused by the command itself; load has no such option
    assert f"`python -m fasbody.{old}` has moved to python -m fasbody.arch {new}." in said
    assert printed == ""
