"""The rows of the thesis: complete, uniquely named, really run, and judged by their numbers alone."""

import inspect
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from fasbody.laboratory.study import PICKED_SEED
from fasbody.runner import ROOT
from fasbody.transmissibility.findings import findings
from reproduction import run as running
from reproduction.book import CHAPTERS, ROWS
from reproduction.chapter2_findings import LISTS
from reproduction.check import Check, at_most, exactly, near
from reproduction.report import markdown
from reproduction.row import Outcome, Row, Verdict
from reproduction.run import execute, kept, key, run_rows
from reproduction.virtual import LARGE, LARGE_SEED, OTHER_SEEDS, large_findings, whatever_the_seed
from reproduction.virtual_transfer import study

#: Number of the last table and figure of each chapter and appendix of the thesis.
TABLES = {"2": 1, "3": 2, "4": 2, "5": 2, "A": 9}
FIGURES = {"2": 10, "3": 6, "4": 25, "5": 11, "A": 5, "C": 1, "D": 3}
#: Rows that cost a moment, one of each kind of verdict that needs no study.
CHEAP = {
    "Eq. 2.5": Verdict.CORRECTED, "Eq. 2.4, Fig. 2.9": Verdict.REPRODUCED, "Table 2.1": Verdict.CORRECTED,
    "Eq. 3.19": Verdict.CORRECTED, "Eq. 3.17-3.18": Verdict.REPRODUCED, "Appendix B, A": Verdict.CORRECTED,
    "Eq. 4.24-4.25": Verdict.REPRODUCED, "Finding 4.5, 1": Verdict.REPRODUCED,
    "Finding 3.3, 1": Verdict.CONTRADICTED, "Table A.1": Verdict.UNMEASURED,
    "Eq. 4.12, damping": Verdict.CORRECTED, "Validation 3": Verdict.REPRODUCED,
}  # fmt: skip


def by_id(name: str) -> Row:
    return next(row for row in ROWS if row.id == name)


def test_ids_and_files_are_unique() -> None:
    assert len({row.id for row in ROWS}) == len(ROWS) > 100
    assert len({row.file for row in ROWS}) == len(ROWS)


def test_every_equation_table_and_figure_has_a_row() -> None:
    there = {item for row in ROWS for item in row.numbers}
    index = re.findall(r"^### Eq\. (\d\.\d+):", (ROOT / "docs" / "equations.md").read_text(), re.MULTILINE)
    wanted = {f"Eq. {number}" for number in index}
    wanted |= {f"Table {chapter}.{n}" for chapter, last in TABLES.items() for n in range(1, last + 1)}
    wanted |= {f"Fig. {chapter}.{n}" for chapter, last in FIGURES.items() for n in range(1, last + 1)}
    # some equations are judged part by part: "Eq. 4.12, mass"
    assert {item for item in wanted if item not in there} == set()


def test_rows_do_not_rest_on_benchmarks() -> None:
    """What a row computes is hashed with the packages; a file beside them would not be."""
    for file in (ROOT / "reproduction").glob("*.py"):
        assert not re.search(r"^\s*(from|import) benchmarks", file.read_text(), re.MULTILINE), file


def test_a_range_in_an_id_is_each_of_its_numbers() -> None:
    row = Row("Eq. 3.15-3.16, Fig. 3.1", "", Outcome, "", "")
    assert row.numbers == ["Eq. 3.15", "Eq. 3.16", "Fig. 3.1"]
    with pytest.raises(ValueError, match="no range"):
        _ = Row("Eq. 3.2-4.1", "", Outcome, "", "").numbers


@pytest.mark.parametrize("name", CHEAP)
def test_cheap_rows_run_and_flip_when_a_number_moves(name: str) -> None:
    outcome = by_id(name).run()
    assert outcome.verdict == CHEAP[name]
    for group in ("right", "instead"):
        if checks := getattr(outcome, group):
            assert replace(outcome, **{group: [_missed(checks[0]), *checks[1:]]}).verdict == Verdict.FAILED
    if outcome.verdict == Verdict.REPRODUCED:
        moved = replace(outcome, printed=[_missed(outcome.printed[0]), *outcome.printed[1:]])
        assert moved.verdict == Verdict.CONTRADICTED
    else:
        met = [replace(check, low=-math.inf, high=math.inf) for check in outcome.printed]
        assert replace(outcome, printed=met, missing="").verdict == Verdict.REPRODUCED


def _missed(check: Check) -> Check:
    """The same check with a number outside of its limits."""
    high = math.isfinite(check.high)
    beyond = check.high + 1 + abs(check.high) if high else check.low - 1 - abs(check.low)
    return replace(check, value=beyond)


def test_verdicts_follow_from_numbers() -> None:
    good, bad = near("a", 1.0, 1.0, 0.1), near("a", 2.0, 1.0, 0.1)
    assert Outcome([good]).verdict == Verdict.REPRODUCED
    assert Outcome([good], synthetic=True).verdict == Verdict.SYNTHETIC
    assert Outcome([bad], synthetic=True).verdict == Verdict.UNMEASURED
    assert Outcome([bad]).verdict == Verdict.CONTRADICTED
    assert Outcome([bad], right=[good]).verdict == Verdict.CORRECTED
    assert Outcome([bad], right=[bad]).verdict == Verdict.FAILED
    assert Outcome([bad], instead=[good]).verdict == Verdict.CONTRADICTED
    assert Outcome([good], coherent=[bad]).verdict == Verdict.CONTRADICTED
    assert Outcome([bad], present=[good], synthetic=True).verdict == Verdict.UNRELIABLE
    assert Outcome([bad], present=[bad], synthetic=True).verdict == Verdict.UNMEASURED
    assert Outcome([good], present=[bad], synthetic=True).verdict == Verdict.SYNTHETIC
    assert Outcome(calibrated=[good]).verdict == Verdict.CALIBRATED
    assert Outcome([good], calibrated=[good]).verdict == Verdict.REPRODUCED
    assert Outcome([good], calibrated=[bad]).verdict == Verdict.CONTRADICTED
    assert Outcome([good], missing="recordings").verdict == Verdict.UNMEASURED
    assert Outcome([bad], instead=[good], missing="recordings").verdict == Verdict.UNMEASURED
    assert Outcome([at_most("a", math.nan, 1.0)]).verdict == Verdict.FAILED
    assert Outcome([]).verdict == Verdict.FAILED


@pytest.mark.parametrize("group", ["coherent", "right", "instead", "present"])
def test_nothing_is_reproduced_where_nothing_was_asked(group: str) -> None:
    """A correction that holds, or a text that agrees with itself, is no evidence that what is printed came out."""
    good, bad = near("a", 1.0, 1.0, 0.1), near("a", 2.0, 1.0, 0.1)
    for value in ([good], [bad]):
        excluded = group == "coherent" and value == [bad]
        wanted = Verdict.CONTRADICTED if excluded else Verdict.FAILED
        assert Outcome(**{group: value}).verdict == wanted  # type: ignore[arg-type]
        assert Outcome(**{group: value}, synthetic=True).verdict == wanted  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["Table 3.2", *(f"Table A.{n}" for n in range(1, 10))])
def test_a_transcription_reproduces_no_table(name: str) -> None:
    """No check of these reads a recording of a person, so no study that is added can make them come out."""
    source = inspect.getsource(getattr(by_id(name).run, "func", by_id(name).run))
    assert "missing=" in source and "measured" not in source


def test_a_statement_must_hold_with_most_seeds() -> None:
    """What comes out with the picked seed alone is not shown; what is missed counts if it is true of many subjects."""
    good, bad = exactly("a", 1, 1), exactly("a", 0, 1)
    assert whatever_the_seed([good], [True] * 8 + [False] * 2, True).verdict == Verdict.SYNTHETIC
    for checks, others in (([good], [True] * 7 + [False] * 3), ([good], [False] * 10), ([bad], [True] * 10)):
        assert whatever_the_seed(checks, others, True).verdict == Verdict.UNRELIABLE
        untrue = whatever_the_seed(checks, others, False, "n.")
        assert untrue.verdict == Verdict.UNMEASURED
        assert untrue.note == "n. Not true of 400 virtual subjects."


def test_what_the_large_study_says_is_not_chance() -> None:
    """Two large draws agree on nine statements of ten; twenty subjects disagree with them more often."""
    other = {finding.says: finding.holds is True for finding in findings(study(LARGE_SEED + 1, LARGE))}
    assert large_findings().keys() == other.keys()
    agree = sum(large_findings()[says] == holds for says, holds in other.items())
    assert agree >= 0.85 * len(other)


def test_the_picked_seed_is_none_of_the_others() -> None:
    assert PICKED_SEED not in OTHER_SEEDS
    assert len(OTHER_SEEDS) >= 20


def test_what_chose_a_constant_is_marked_as_calibration() -> None:
    """The fascia of the low arch, cut: the sag itself is within 10 %, what cutting adds is an order too small."""
    outcome = by_id("Validation 1").run()
    assert not outcome.printed and outcome.verdict == Verdict.CONTRADICTED
    (low,) = [check for check in outcome.calibrated if check.what.startswith("what cutting it adds, 20 mm")]
    assert low.value < 0.2 < 1.7 and low.low < 1.7 < low.high and not low.met
    assert by_id("Validation 5").run().verdict == Verdict.CALIBRATED
    for name in (2, 3, 4, 6, 7):
        assert by_id(f"Validation {name}").run().calibrated


def test_contradictions_of_the_text_need_no_data() -> None:
    outcome = by_id("Finding 2.3.1, 19-24")
    assert {f"Finding 2.3.1, {n}" for n in range(19, 25)} <= set(outcome.numbers)
    assert [len(set(range(10, 55, 5)) & set(range(a + 1, b + 1))) for a, b in LISTS.values()] == [2, 2, 1]


def test_a_row_that_raises_has_failed() -> None:
    def broken() -> Outcome:
        raise ZeroDivisionError("by design")

    document = execute(Row("X 1", "a broken row", broken, "", "X 1"))
    assert document["verdict"] == str(Verdict.FAILED)
    assert document["error"] == "ZeroDivisionError: by design"


def test_results_are_kept_until_the_code_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = by_id("Eq. 2.5")
    (first,) = run_rows([row], tmp_path, processes=1)
    file = tmp_path / row.file
    file.write_text(file.read_text().replace(row.what, "taken from the file"))
    assert next(run_rows([row], tmp_path, processes=1))["what"] == "taken from the file"
    again = next(run_rows([row], tmp_path, fresh=True, processes=1))
    assert again | {"cpu_seconds": 0} == first | {"cpu_seconds": 0}
    monkeypatch.setattr(running, "LIBRARIES", ("numpy",))
    assert kept(row, tmp_path) is None
    assert key(row) != first["key"]


def test_a_damaged_or_failed_result_is_not_kept(tmp_path: Path) -> None:
    row = by_id("Eq. 2.5")
    file = tmp_path / row.file
    for content in ("{", "[]", json.dumps({"key": key(row), "verdict": str(Verdict.FAILED)})):
        file.write_text(content)
        assert kept(row, tmp_path) is None


def test_the_page_has_a_line_a_row_and_its_verdict() -> None:
    outcome = Outcome([exactly("a|b", 1, 1)], note="note")
    results = {row.id: {"id": row.id, **outcome.document(), "error": None} for row in ROWS}
    lines = markdown(results).splitlines()
    assert any(f"seed {PICKED_SEED}" in line and "picked" in line for line in lines)
    for row in ROWS:
        (line,) = (line for line in lines if line.startswith(f"| {row.id} |"))
        assert "| reproduced |" in line
    thesis = sum(len(rows) for rows in CHAPTERS.values())
    assert f"- **{thesis}** reproduced" in lines


def test_the_committed_page_is_of_these_rows() -> None:
    """docs/reproduction.md was written by the rows as they are: same ids, same texts, nothing failed."""
    page = (ROOT / "docs" / "reproduction.md").read_text()
    ids = re.findall(r"^\| ((?:Eq\.|Fig\.|Table|Finding|Appendix|Validation)[^|]*?) \|", page, re.MULTILINE)
    assert ids == [row.id for row in ROWS]
    assert f"| {Verdict.FAILED} |" not in page
