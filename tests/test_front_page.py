"""The front page says what the rest of the project says: benchmark rows, citation, version."""

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_ratios_are_those_of_the_results() -> None:
    results = [row.strip("| ").split(" | ") for row in (ROOT / "benchmarks" / "RESULTS.md").read_text().splitlines()]
    section = README.split("## How fast, how accurate")[1].split("\n## ")[0]
    shown = [row.strip("| ").split(" | ") for row in section.splitlines() if row.startswith("| ")][1:]
    assert len(shown) >= 5
    for what, compared, ratio in shown:  # the first column of the results is the topic
        found = [row for row in results if row[1:2] and row[1].startswith(what) and compared in " ".join(row[2:])]
        assert any(row[4] == ratio for row in found), f"{what}: {ratio} is not in RESULTS.md ({found})"


def test_citation_is_complete_and_agrees_with_the_package() -> None:
    """The keys that CFF 1.2.0 requires, and what both files say."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["cff-version"] == "1.2.0"
    assert cited["message"] and cited["title"].startswith(PROJECT["name"]) and cited["authors"]
    assert all(set(author) & {"name", "family-names"} for author in cited["authors"])
    assert str(cited["version"]) == PROJECT["version"] and cited["license"] == PROJECT["license"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", str(cited["date-released"]))
    for reference in cited["references"]:
        assert {"type", "title", "authors"} <= set(reference)


def test_changelog_has_the_version() -> None:
    assert f"## {PROJECT['version']}" in (ROOT / "CHANGELOG.md").read_text()


def test_example_is_fifteen_lines() -> None:
    example = README.split("## In fifteen lines")[1].split("```python\n")[1].split("```")[0]
    assert len([line for line in example.splitlines() if line.strip()]) <= 15
