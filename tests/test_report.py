"""report.html: self-contained, escaped, and showing the numbers of the result."""

from html.parser import HTMLParser
from pathlib import Path

import pytest
from test_result import result

from identification import figures, report


class Balanced(HTMLParser):
    """Collects outside addresses and checks that tags close."""

    VOID = ("meta", "link", "br", "img", "hr")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        local = ("#", "data:")
        self.outside += [v for n, v in attrs if n in ("src", "href", "xlink:href") and v and not v.startswith(local)]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


STARTS = tuple({"start": f"{i}", "cost": 10.0 * (i + 1), "branch": "stiff ankle"} for i in range(3))


@pytest.fixture(scope="module")
def text() -> str:
    return report.html(result(starts=STARTS, source="<script>alert(1)</script>", warnings=("a < b",)))


def test_page_is_whole_self_contained_and_has_its_pictures(text: str) -> None:
    page = Balanced()
    page.feed(text)
    assert page.open == []
    assert page.outside == []
    assert text.count("<svg") == text.count("</svg>") == 5
    assert "synthetic data: nobody was measured" in text
    assert "131160" in text.replace(",", "")
    assert "<script" not in text


def test_names_from_files_are_escaped(text: str) -> None:
    assert "<script>" not in text
    assert "&lt;script&gt;" in text
    assert "a &lt; b" in text


@pytest.mark.parametrize("name", ["traces", "residuals", "parameters", "waterfall", "correlation"])
def test_every_figure_has_labelled_axes(name: str) -> None:
    figure = getattr(figures, name)(result(starts=STARTS))
    labels = [axis.get_xlabel() + axis.get_ylabel() + axis.get_title() for axis in figure.axes if axis.axison]
    assert any(labels)
    picture = figures.svg(figure)
    assert picture.startswith("<svg")
    assert picture == figures.svg(getattr(figures, name)(result(starts=STARTS)))  # no date, no random names


def test_a_time_domain_result_without_mirror_twin_or_truth_has_a_page_too() -> None:
    plain = result(starts=STARTS, domain="time", branches=result().branches[:1], twin_mujoco_difference=None, truth={})
    text = report.html(plain)
    assert "no twin for this model" in text
    assert "time domain" in text


def test_write(tmp_path: Path) -> None:
    files = report.write(result(starts=STARTS), tmp_path / "out")
    assert sorted(file.name for file in files) == ["parameters.csv", "report.html", "result.json"]
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(file.name for file in files)
