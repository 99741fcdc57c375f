"""The front page and the pages of numbers say what the rest of the project says: rows, verdicts, version."""

import re
import runpy
import tomllib
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from fasbody.foot.model import load
from fasbody.leg.chain import Leg
from fasbody.leg.peaks import peaks

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
CREDIBILITY = (ROOT / "docs" / "credibility.md").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_numbers_are_those_of_the_results() -> None:
    results = [row.strip("| ").split(" | ") for row in (ROOT / "benchmarks" / "RESULTS.md").read_text().splitlines()]
    section = (ROOT / "docs" / "speed.md").read_text()
    shown = [row.strip("| ").split(" | ") for row in section.splitlines() if row.startswith("| ")][1:]
    assert len(shown) >= 20
    known: dict[str, list[list[str]]] = {}
    for row in results:
        known.setdefault(row[1] if len(row) > 1 else "", []).append([cell.strip() for cell in row[2:]])
    for what, *cells in shown:  # the first column of the results is the topic
        if what == "what":
            continue
        found = [row for key, rows in known.items() if key.startswith(what) for row in rows]
        if len(cells) == 2:  # a comparison: with what, how many times better
            assert any(cells[0] in row[1] and row[2] == cells[1] for row in found), f"{what}: {cells} but {found}"
        else:  # a requirement: measured, required, met
            judged = [[row[0], row[1], row[-1] if row[-1] in ("yes", "NO") else "not judged"] for row in found]
            assert [*cells] in judged, f"{what}: {cells} but {found}"
    missed = sum(row[-1] == "NO" for row in results)
    assert f"\n{missed} rows of [RESULTS.md]" in section, f"speed.md should count {missed} rows"


def test_coverage_is_that_of_the_pages() -> None:
    section = CREDIBILITY.split("How far you can trust an interval")[1].split("\n\n")[1]
    seeds = re.findall(
        r"interval of \w+ holds the truth, 200 seeds \| ([\d.]+) %", (ROOT / "benchmarks" / "RESULTS.md").read_text()
    )
    low, high = (float(number) for number in re.findall(r"in (\d+) to (\d+) %", section)[0])
    assert (low, high) == (min(map(float, seeds)), max(map(float, seeds)))
    *errors, page = re.findall(r"is (\d+) % for k_F and (\d+) % for c_11 \| \[[^]]*\]\((\S+)\)", section)[0]
    text = " ".join((ROOT / "docs" / page).read_text().split())
    assert all(f"{error} % for {name}" in text for error, name in zip(errors, ("k_F", "c_11"), strict=True))
    (held,) = re.findall(r"within (\d+ of \d+) intervals", section)
    assert f"| {held} (" in CREDIBILITY.split("## Uncertainty")[1]


def test_verdicts_are_those_of_the_reproduction() -> None:
    thesis, others = (ROOT / "docs" / "reproduction.md").read_text().split("\n## Outside data")
    said = []
    for part, what in (
        (thesis, "equations, tables, figures and findings of the thesis"),
        (others, "comparisons with published numbers"),
    ):
        counts = re.findall(r"^- \*\*(\d+)\*\* (.+)$", part, re.MULTILINE)
        assert len(counts) > 1
        the = "the " * (part is thesis)
        said.append(f"Of {the}{sum(int(n) for n, _ in counts)} {what}: {', '.join(map(' '.join, counts))}")
    line = ". ".join(said)
    assert line in " ".join(CREDIBILITY.split()), f"docs/credibility.md should say: {line}"


def test_citation_is_complete_and_agrees_with_the_package() -> None:
    """The keys that CFF 1.2.0 requires, and what both files say."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["cff-version"] == "1.2.0"
    assert cited["message"] and cited["title"].startswith(PROJECT["name"]) and cited["authors"]
    assert all(set(author) & {"name", "family-names"} for author in cited["authors"])
    assert cited["license"] == PROJECT["license"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", str(cited["date-released"]))
    for reference in cited["references"]:
        assert {"type", "title", "authors"} <= set(reference)


def test_changelog_has_the_last_release_and_its_date() -> None:
    """What is cited was released; between releases the package has the next version."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    changes = (ROOT / "CHANGELOG.md").read_text()
    assert f"## {cited['version']} ({cited['date-released']})" in changes
    assert ("\n## Unreleased\n" in changes) == PROJECT["version"].endswith(".dev0")
    assert PROJECT["version"].endswith(".dev0") or str(cited["version"]) == PROJECT["version"]


def test_release_says_what_is_missing(tmp_path: Path) -> None:
    """Of this checkout, and of one in which all is filled in."""
    problems = runpy.run_path(str(ROOT / ".ci" / "release"))["problems"]
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md"):
        (tmp_path / name).write_text((ROOT / name).read_text())
    assert len(problems(tmp_path)) >= 4
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "9.8.7"\n')
    (tmp_path / "CITATION.cff").write_text("x: 1\nversion: 9.8.7\ndate-released: 2030-01-02\n")
    (tmp_path / "CHANGELOG.md").write_text("# Changes\n\n## 9.8.7 (2030-01-02)\n")
    assert problems(tmp_path) == []


def test_numbers_of_the_paper() -> None:
    """Those that cost little; tests/test_bundled.py has those of the fit."""
    paper = (ROOT / "docs" / "paper" / "paper.md").read_text()
    thesis = (ROOT / "docs" / "reproduction.md").read_text().split("\n## Outside data")[0]
    counts = re.findall(r"^- \*\*(\d+)\*\* ", thesis, re.MULTILINE)
    verdicts = r"Each of the (\d+) rows of the thesis has a verdict: (\d+) are reproduced, (\d+) corrected, (\d+)"
    found = re.findall(verdicts, paper)
    assert found == [(str(sum(map(int, counts))), *counts[:3])]
    foot = load("leg")
    result = peaks(Leg.from_model(foot.model, foot.name), foot.name)
    low, middle, high = (round(result.highest("MB", number)[0]) for number in range(3))
    assert f"lies at {low}, {middle} and {high} Hz under 0, 2.3 and 4.5 kg" in " ".join(paper.split())


def test_film_shows_the_fit_of_the_page() -> None:
    """docs/film.py keeps what the page said of the fit as the comment of the film."""
    with Image.open(ROOT / "docs" / "figures" / "workbench.gif") as film:
        said = film.info["comment"].decode()
        red, _, blue = np.moveaxis(np.asarray(film.convert("RGB")).astype(int), -1, 0)
    assert ((red > 140) & (red > blue + 12)).mean() > 0.02  # its first frame shows bone
    assert said.startswith("k_T = ") and " ".join(said.split()) in " ".join(README.split())
