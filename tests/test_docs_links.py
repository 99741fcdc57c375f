"""No link inside the project is dead, and the site is built without complaint and without an outside address."""

import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from viewer import PATIENCE, browser

from docs import DOCUMENTS, ROOT, anchors, links, mentioned_files

#: Attributes and functions by which a page loads something; a plain <a href> only leads there.
LOADS = (
    r"<(?:script|img|iframe|source|video|audio)\b[^>]*\bsrc=[\"'](https?:)?//",
    r"<link\b(?![^>]*rel=[\"']?canonical)[^>]*\bhref=[\"']?(https?:)?//",
    r"url\(\s*[\"']?(https?:)?//",
    r"@import\s+[\"'](https?:)?//",
)


@pytest.mark.parametrize("file", DOCUMENTS, ids=lambda f: str(f.relative_to(ROOT)))
def test_links_lead_somewhere(file: Path) -> None:
    for path, anchor in links(file):
        target = (file.parent / path).resolve() if path else file
        assert target.exists(), f"{file.name}: {path} does not exist"
        assert target.is_relative_to(ROOT)
        if anchor:
            assert anchor in anchors(target), f"{file.name}: {path or file.name} has no heading #{anchor}"


@pytest.mark.parametrize("file", DOCUMENTS, ids=lambda f: str(f.relative_to(ROOT)))
def test_files_that_are_mentioned_exist(file: Path) -> None:
    missing = [path for path in mentioned_files(file) if not (ROOT / path).exists()]
    assert not missing, f"{file.name} mentions {missing}"


@pytest.mark.long
def test_site(tmp_path: Path) -> None:
    """The site is built and looked at in one test, as two processes of the suite would build it twice or wait."""
    site = tmp_path / "site"
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(site)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    needs_no_outside_address(site)
    has_every_document_and_every_module(site)
    with browser() as opened:
        pages_have_navigation_and_fit_at_every_width(site, opened.new_page())


def needs_no_outside_address(site: Path) -> None:
    pages = [file for kind in ("*.html", "*.css") for file in site.rglob(kind)]
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not [match[0] for load in LOADS for match in re.finditer(load, text)], page.name
        swallowed = re.search(r"<p>[^<]*\n- [^\n]*", re.sub(r"<(?!/?p>)[^>]*>", "", text))
        assert not swallowed, f"{page.name}: a list that is no list: {swallowed[0][-80:]}"
        assert not re.search(r"\]\[(mjcf|fasbody|identification|viz)\.", text), (
            f"{page.name}: a link into the reference"
        )
    assert (site / "search" / "search_index.js").stat().st_size > 100_000


def has_every_document_and_every_module(site: Path) -> None:
    for file in (ROOT / "docs").glob("*.md"):
        assert (site / f"{file.stem}.html").is_file(), file.name
    reference = "".join(page.read_text(encoding="utf-8") for page in site.glob("python_*.html"))
    for name in (
        "fasbody.foot.simulate.simulate",
        "identification.fitting.fit_foot",
        "fasbody.cell.modal.solve",
        "mjcf.path",
    ):
        assert f'id="{name}"' in reference, name
    mass = reference.split("<code>body_mass_kg</code>")[1].split("</tr>")[0]
    assert "<td>kg</td>" in mass  # each argument has its unit
    delay = reference.split('id="viz.settings.Settings"')[1].split("<code>delay_s</code>\n")[1].split("</tr>")[0]
    assert "<td>s</td>" in delay and "<code>0.0</code>" in delay  # though the docstring has no list of arguments
    commands = re.sub(r"<[^>]+>", "", (site / "commands.html").read_text(encoding="utf-8"))
    assert "fasbody fit my_study --starts 20" in commands


def until(page: Any, condition: str, otherwise: str) -> None:
    """Wait for what a busy browser does late."""
    end = time.monotonic() + PATIENCE
    while not page.evaluate(condition):
        assert time.monotonic() < end, otherwise
        time.sleep(0.05)


#: Pages of every kind: the first one, formulas, wide tables, rows with a filter, the reference, pictures.
LOOKED_AT = ("index", "equations", "benchmarks", "reproduction", "python_fit_a_foot", "examples", "credibility")


def pages_have_navigation_and_fit_at_every_width(site: Path, page: Any) -> None:
    """In a browser: a way to other pages is seen, nothing is wider than the window or comes from elsewhere."""
    asked, complaints = [], []
    page.set_default_timeout(1000 * PATIENCE)
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    for name in LOOKED_AT:
        page.set_viewport_size({"width": 1400, "height": 900})
        page.goto((site / f"{name}.html").as_uri())
        for width in (1400, 800, 420):
            page.set_viewport_size({"width": width, "height": 900})
            until(page, f"document.documentElement.scrollWidth <= {width}", f"{name} is wider than {width} px")
            until(page, WAYS, f"{name} shows no navigation at {width} px")
        height = page.evaluate("document.documentElement.scrollHeight")  # at 420 px, where it is tallest
        assert name != "reproduction" or height < 15_000, f"reproduction is {height} px tall"
    page.locator("label.md-header__button[for=__drawer]").click()  # what the narrow pages show opens the navigation
    page.get_by_role("link", name="Tutorial", exact=True).wait_for()

    page.goto((site / "cell.html").as_uri())
    for width in (420, 1400):  # a wide figure scrolls rather than shrink beyond reading
        page.set_viewport_size({"width": width, "height": 900})
        widths = "[...document.querySelectorAll('.md-content p > img')].map(i => i.getBoundingClientRect().width)"
        until(page, f"Math.min(...{widths}) > 700", f"a figure is narrow at {width} px")

    page.goto((site / "equations.html").as_uri())
    assert page.evaluate("document.fonts.ready.then(() => document.fonts.check('16px \"Fasbody Formulas\"'))")
    sizes = page.evaluate(
        "[...document.querySelectorAll('.formula > math')].map(m => m.getBoundingClientRect().height)"
    )
    assert len(sizes) > 45 and min(sizes) > 10

    page.goto((site / "reproduction.html").as_uri())
    shown = "[...document.querySelectorAll('.rows tbody tr')].filter(r => r.offsetParent).length"
    every = page.evaluate(shown)
    for wanted in ("Eq. 2.5", "Eq. 4.28"):  # the second is in a row of 4.26-4.29
        page.get_by_placeholder("Search the rows").fill(wanted)
        until(page, f"0 < {shown} && {shown} < {every / 10}", f"{wanted} is found nowhere, or in many rows")
    heights = "[...document.querySelectorAll('.rows .md-typeset__scrollwrap')].map(t => t.offsetHeight)"
    assert all(height == 0 or height > 40 for height in page.evaluate(heights))  # no frames without rows
    page.goto((site / "index.html").as_uri())
    for word, first in (
        ("Settings", "Fit a foot"), ("k_T", "Symbols"), ("insole", "How to edit the model"),
        ("t-test", "Transmissibility of a folder"), ("confidence interval", "How the fit works"),
    ):  # fmt: skip
        page.locator(".md-search__input").fill("")
        page.locator(".md-search__input").press_sequentially(word)
        page.wait_for_function(
            f"document.querySelector('.md-search-result__item h1')?.textContent.trim() === {first!r}"
        )
    assert not complaints
    assert [url for url in asked if not url.startswith("file:")] == []


#: Whether a link of the navigation, or the button that opens it, is within the window.
WAYS = """
[...document.querySelectorAll('.md-sidebar--primary a.md-nav__link, label.md-header__button[for=__drawer]')].some(e => {
  const box = e.getBoundingClientRect();
  return box.width > 0 && box.left >= 0 && box.right <= innerWidth && box.top < innerHeight;
})"""
