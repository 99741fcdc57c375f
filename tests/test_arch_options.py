"""Options that the commands on the arch share: what cannot be meant is refused before the work, in one sentence."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Command = Callable[..., Any]
COMMANDS = ("crosscheck", "sensitivity", "reduction")


@pytest.mark.parametrize("name", COMMANDS)
def test_negative_seed_is_bad_input(command: Command, name: str) -> None:
    run = command(f"fasbody.{name}", "--seed", "-1")
    assert run.returncode == 2
    assert "Traceback" not in run.stderr
    assert "--seed" in run.stderr


@pytest.mark.parametrize("name", ["sensitivity", "static_load"])
def test_figures_in_a_file_are_refused_first(command: Command, tmp_path: Path, name: str) -> None:
    (tmp_path / "taken").write_text("")
    run = command(f"fasbody.{name}", "--figures", str(tmp_path / "taken"))
    assert run.returncode == 2
    assert "taken: is a file; name a folder." in run.stderr
    assert "arch" not in run.stderr.replace(str(tmp_path), "")  # no table: the work had not begun


def test_figure_of_the_reduction_is_refused_first(command: Command, tmp_path: Path) -> None:
    run = command("fasbody.arch", "reduction", "--figure", str(tmp_path))
    assert run.returncode == 2
    assert "is a folder; name a PNG file." in run.stderr
    assert "Five bodies" not in run.stderr


@pytest.mark.parametrize("load", ["0", "-5", "1e6", "nan"])
def test_load_says_what_is_valid(command: Command, load: str) -> None:
    run = command("fasbody.arch", "load", "--load", load)
    assert run.returncode == 2
    assert "must be above 0 and below 100000 N." in run.stderr
