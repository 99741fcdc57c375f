"""The commands on the arch: what cannot be meant is refused before the work, in one sentence."""

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
