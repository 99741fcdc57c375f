"""What only a checkout has, by its commands: the rows of the thesis, and the benchmarks."""

import json
import re
import subprocess
import sys
from pathlib import Path

import in_process
import pytest

ROOT = Path(__file__).parent.parent
#: Number of the last table and figure of each chapter and appendix of the thesis.
TABLES = {"2": 1, "3": 2, "4": 2, "5": 2, "A": 9}
FIGURES = {"2": 10, "3": 6, "4": 25, "5": 11, "A": 5, "C": 1, "D": 3}
FIXED = "corrected (erratum)"
#: Rows that cost a moment, one of each kind of verdict that needs no study.
VERDICTS = {
    "Eq. 2.5": FIXED, "Eq. 2.4, Fig. 2.9": "reproduced", "Table 2.1": FIXED,
    "Eq. 3.19": FIXED, "Eq. 3.17-3.18": "reproduced", "Appendix B, A": FIXED,
    "Eq. 4.24-4.25": "reproduced", "Finding 4.5, 1": "reproduced",
    "Finding 3.3, 1": "contradicted", "Table A.1": "cannot be reproduced without the recordings",
    "Eq. 4.12, damping": FIXED, "Validation 3": "reproduced",
}  # fmt: skip


@pytest.fixture(scope="module")
def ids() -> list[str]:
    return [row["id"] for row in json.loads(in_process.command("reproduction", "--list", "--json").stdout)]


def items(row: str) -> set[str]:
    """What a row's id names: "Eq. 3.15-3.16, Fig. 3.1" is both equations and the figure."""
    found = set()
    for kind, chapter, first, last in re.findall(r"(Eq\.|Table|Fig\.) (\w)\.(\d+)(?:-\d\.(\d+))?", row):
        found |= {f"{kind} {chapter}.{n}" for n in range(int(first), int(last or first) + 1)}
    return found


def test_every_equation_table_and_figure_has_a_row(ids: list[str]) -> None:
    assert len(set(ids)) == len(ids) > 100
    index = (ROOT / "docs" / "equations.md").read_text()
    wanted = set().union(*map(items, re.findall(r"^### (Eq\. .+?):", index, re.MULTILINE)))
    for kind, lasts in (("Table", TABLES), ("Fig.", FIGURES)):
        wanted |= {f"{kind} {chapter}.{n}" for chapter, last in lasts.items() for n in range(1, last + 1)}
    assert wanted - set().union(*map(items, ids)) == set()


def test_the_committed_page_is_of_these_rows(ids: list[str]) -> None:
    page = (ROOT / "docs" / "reproduction.md").read_text()
    starts = r"^\| ((?:Eq\.|Fig\.|Table|Finding|Appendix|Validation)[^|]*?) \|"
    assert re.findall(starts, page, re.MULTILINE) == ids
    assert "| failed |" not in page


def test_rows_are_judged_and_kept(tmp_path: Path) -> None:
    words = [word for name in VERDICTS for word in ("--only", name)]
    words += ["--jobs", "1", "--json", "--kept", str(tmp_path)]
    for _ in range(2):  # the second time out of their files
        rows = json.loads(in_process.command("reproduction", *words).stdout)["rows"]
        assert {row["id"]: row["verdict"] for row in rows} == VERDICTS
    done = in_process.command("reproduction", "--only", "nothing")
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1


def test_a_benchmark_prints_its_rows() -> None:
    done = in_process.command("benchmarks.peak_to_peak", "--seeds", "4", "--json")
    assert [row["holds"] for row in json.loads(done.stdout)["rows"][:4]] == [True] * 4


@pytest.mark.long
def test_mutated_files_are_read_or_refused() -> None:
    """The full runs are of 2,000 files a reader."""
    words = [sys.executable, "benchmarks/fuzz_readers.py", "20"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
