"""The pictures of docs/viewer.md: the foot's page beside another foot, and with a fit.

    python docs/views.py

It drives a headless Chromium and needs the extras view and film. docs/film.py makes the film of the same page.
"""

from pathlib import Path
from typing import Any

from film import RESTING, drop, served  # beside this file
from playwright.sync_api import sync_playwright

from viz.exported import CHROMIUM, chromium

FIGURES = Path(__file__).parent / "figures"
WIDE, LARGE = ({"width": w, "height": h} for w, h in ((1366, 768), (1500, 900)))
#: Time in the period at which the foot is drawn, as a share.
MOMENT = 0.2


def until(page: Any, condition: str) -> None:
    """Wait for the page."""
    while not page.evaluate(f"Boolean({condition})"):
        page.wait_for_timeout(100)


def take(page: Any, name: str) -> None:
    """One picture, at rest."""
    page.evaluate(f"fasbody.showAt({MOMENT}); fasbody.clock.fresh = true")
    page.wait_for_timeout(500)
    page.screenshot(path=FIGURES / f"viewer{name}.png")


def opened(browser: Any, url: str, size: dict[str, int]) -> Any:
    """A page whose foot moves, held still."""
    page = browser.new_page(viewport=size, color_scheme="dark")
    page.goto(url)
    until(page, "window.fasbody && fasbody.stats.motions > 0")
    page.evaluate("fasbody.play(false)")
    return page


def main() -> None:
    """Take all pictures."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(CHROMIUM))
        with served("--compare", "foot_arch@25") as url:
            page = opened(browser, url, WIDE)
            page.get_by_role("button", name="Side by side").click()
            page.get_by_role("button", name="corner", exact=True).click()
            until(page, RESTING)
            take(page, "-two")
        with served("--model", "two_dof") as url:
            page = opened(browser, url, LARGE)
            drop(page)
            until(page, "fasbody.bench.rows.length === 12 && !fasbody.page.busy")
            page.locator("#start_fit").click()
            until(page, "fasbody.bench.found || fasbody.page.complaint")
            until(page, RESTING)
            take(page, "")
        browser.close()


if __name__ == "__main__":
    main()
