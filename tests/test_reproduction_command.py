"""`python -m reproduction`: which rows a name means, what is refused before the work, what is printed."""

import json
from pathlib import Path

import in_process
import pytest
from typer.testing import CliRunner

from fasbody.exceptions import FasError, SettingError
from reproduction.__main__ import app, select
from reproduction.book import CHAPTERS, OUTSIDE, ROWS
from reproduction.row import Verdict


def test_selecting_by_id_item_and_title() -> None:
    assert [row.id for row in select(["Eq. 2.5"])] == ["Eq. 2.5"]
    assert [row.id for row in select(["Eq. 4.3"])] == ["Eq. 4.1-4.5"]
    assert select(["validation"]) == OUTSIDE
    assert select(["chapter 5"]) == CHAPTERS["Chapter 5: the cell"]
    assert select(None) == ROWS
    with pytest.raises(SettingError, match=r"no row is called 'Eq\. 9\.9'"):
        select(["Eq. 9.9"])


@pytest.mark.parametrize("name", [" Eq. 4.11 ", "eq. 4.11", "EQ.  4.11"])
def test_spaces_and_capitals_do_not_matter(name: str) -> None:
    assert [row.id for row in select([name])] == ["Eq. 4.10-4.11", "Eq. 4.11, motion"]


def test_a_bare_number_is_whatever_has_it() -> None:
    assert [row.id for row in select(["4.11"])] == ["Eq. 4.10-4.11", "Eq. 4.11, motion", "Fig. 4.11"]
    assert [row.id for row in select(["finding 2.3.1, 20"])] == ["Finding 2.3.1, 19-24"]
    with pytest.raises(SettingError, match="no row is called '42'"):
        select(["42"])


@pytest.mark.parametrize(
    "name, meant", [("Eq. 25", "Eq. 2.5"), ("Tabel 4.2", "Table 4.2"), ("finding 5.4,2", "Finding 5.4, 2")]
)
def test_an_unknown_name_gets_the_closest(name: str, meant: str) -> None:
    with pytest.raises(SettingError, match=f"did you mean '{meant}'"):
        select([name])


@pytest.mark.parametrize("option", ["--kept", "--page"])
def test_an_empty_place_is_refused(option: str) -> None:
    done = CliRunner().invoke(app, ["--only", "Eq. 2.5", option, ""])
    assert done.exit_code == 2
    assert option in done.output and "empty" in done.output
    assert not Path("eq-2-5.json").exists()


@pytest.mark.parametrize("name", ["", "  "])
def test_an_empty_name_is_no_row(name: str) -> None:
    with pytest.raises(SettingError, match="--only is empty"):
        select([name])


def test_the_list_as_json() -> None:
    done = CliRunner().invoke(app, ["--list", "--json", "--only", "2.5"])
    assert [row["id"] for row in json.loads(done.stdout)] == ["Eq. 2.5", "Fig. 2.5", "Finding 2.5, 42"]


@pytest.mark.parametrize(
    "options", [["--only", "Eq. 2.5", "--page", "x.md"], ["--page", "."], ["--page", "pyproject.toml/x.md"]]
)
def test_a_page_that_cannot_be_is_told_before_the_run(options: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("reproduction.run.run_rows", None)
    found = CliRunner().invoke(app, options)
    assert isinstance(found.exception, FasError)
    assert len(str(found.exception).splitlines()) == 1


def test_the_command_prints_json_and_counts(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app, ["--only", "Eq. 2.5", "--only", "Table A.2", "--jobs", "1", "--json", "--kept", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document["counts"] == {str(Verdict.CORRECTED): 1, str(Verdict.UNMEASURED): 1}
    assert {row["id"] for row in document["rows"]} == {"Eq. 2.5", "Table A.2"}
    # the kept row is found again, and a wrong name is one sentence
    done = in_process.command("reproduction", "--only", "Eq. 2.5", "--kept", str(tmp_path))
    assert "1 row; it took" in done.stdout
    done = in_process.command("reproduction", "--only", "nothing")
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1
