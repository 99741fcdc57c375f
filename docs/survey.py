"""Open every page of the built site at three widths, and say what a reader would stumble over.

    make docs && python docs/survey.py [--pictures FOLDER] [PAGE ...]

A page must not be wider than the window, must show a way to other pages, and may ask for nothing from elsewhere. Wide
tables, code and formulas scroll within themselves. It drives a headless Chromium and needs the extra dev.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from playwright.sync_api import sync_playwright

from viz.exported import CHROMIUM, chromium

SITE = Path(__file__).parent.parent / "site"
WIDTHS = (420, 800, 1400)
#: Width of the page; what sticks out of the window and no box of its own scrolls; whether navigation is in the window.
LOOK = """() => {
  const page = document.documentElement.scrollWidth, out = [], outside = innerWidth + 1;
  const kept = e => { for (; e && e !== document.body; e = e.parentElement)
    if (/auto|scroll/.test(getComputedStyle(e).overflowX)) return true; };
  for (const e of document.querySelectorAll('.md-content *')) {
    const box = e.getBoundingClientRect();
    if (box.width > 2 && box.right > outside && !kept(e)) out.push(e.tagName + ' ' + e.textContent.trim().slice(0, 60));
  }
  const ways = '.md-sidebar--primary a.md-nav__link, label.md-header__button[for=__drawer]';
  const seen = [...document.querySelectorAll(ways)].some(e => {
    const box = e.getBoundingClientRect();
    return box.width > 0 && box.left >= 0 && box.right <= innerWidth && box.top < innerHeight;
  });
  const empty = [...document.querySelectorAll('.md-content img')].filter(e => !e.naturalWidth).map(e => e.src);
  return { page, out: out.slice(0, 3), seen, empty, tall: document.documentElement.scrollHeight };
}"""


def survey(site: Path, names: list[str], pictures: Path | None, widths: Sequence[int] = WIDTHS) -> list[str]:
    """Complaints, one a line."""
    found, asked = [], []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(CHROMIUM))
        page = browser.new_page()
        page.on("request", lambda request: asked.append((page.url, request.url)))
        page.on("pageerror", lambda error: found.append(f"{page.url}: {error}"))
        page.on("console", lambda said: found.append(f"{page.url}: {said.text}") if said.type == "error" else None)
        files = [site / f"{name}.html" for name in names] or [
            f for f in sorted(site.rglob("*.html")) if f.stem != "404"
        ]
        for file in files:
            for width in widths:
                page.set_viewport_size({"width": width, "height": 900})
                page.goto(file.as_uri())
                seen = page.evaluate(LOOK)
                where = f"{file.stem} at {width} px"
                if seen["page"] > width or seen["out"]:
                    found.append(f"{where}: {seen['page']} px wide; {seen['out']}")
                found += [f"{where}: no navigation"] if not seen["seen"] else []
                found += [f"{where}: no picture {address}" for address in seen["empty"]]
                if pictures:
                    page.screenshot(path=pictures / f"{file.stem}_{width}.png")
    found += [f"{where} asks {url}" for where, url in asked if not url.startswith("file:")]
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", nargs="*", help="names of pages; all unless given")
    parser.add_argument("--site", type=Path, default=SITE, help="folder of the site")
    parser.add_argument("--width", type=int, action="append", help=f"of the window; {WIDTHS} unless given")
    parser.add_argument("--pictures", type=Path, help="folder for a screenshot of each")
    given = parser.parse_args()
    if given.pictures:
        given.pictures.mkdir(parents=True, exist_ok=True)
    complaints = survey(given.site, given.page, given.pictures, given.width or WIDTHS)
    print("\n".join(complaints) or "nothing to complain about")
    sys.exit(bool(complaints))
