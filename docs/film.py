"""Film the page for the README: a study is dropped, fitted, and flipped to its mirror foot.

    python docs/film.py

It drives a headless Chromium and needs the extras view and film, and Pillow. The film shows what the page draws; only
the waiting for the fit is cut. The study and the settings are those of the README, so the result is, too: its sentence
is kept as the comment of the GIF, and a test compares it with the README.
"""

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from fasbody.recording.study import BUNDLED
from viz.exported import CHROMIUM, chromium

FILM = Path(__file__).parent / "figures" / "workbench.gif"
SIZE = {"width": 1000, "height": 450}
SHOWN = 720  # pixels wide in the README
#: What could not be read at that size is left out: the plots and the cameras' buttons. The foot has their place.
SMALL = """
footer, header nav { display: none !important }
body { grid-template-rows: minmax(0, 1fr) !important }
main { display: grid; grid-template: auto auto minmax(0, 1fr) auto auto / minmax(0, 1fr) }
#pane { position: relative; inset: auto; grid-row: 3; min-height: 0 }
header, #error, #legend, #timeline { position: static }
header { grid-row: 1; padding: 8px 14px 6px 20px; background: #0d131a; border-bottom: 1px solid var(--line) }
#state { max-width: none }
#legend { grid-row: 4; display: none }
#timeline { grid-row: 5; padding: 8px 14px; background: #0d131a }
"""
COMMON, RARE = 200, 56  # colours: of large parts such as the sky, and of small ones such as the rings
PERIOD_FRAMES, FRAME_MS = 12, 80
#: Nothing is computed.
RESTING = "(({ busy, wanted, motion }) => !busy && !wanted && motion)(fasbody.page)"
MOMENT = 0.2  # of the first frame, as a share of the period
#: A folder that is dragged over the page, and let go there: what the desktop's file manager would hand over.
OVER = """document.body.dispatchEvent(new DragEvent("dragover", { bubbles: true, cancelable: true }))"""
DROP = """([folder, files]) => {
  document.body.classList.remove("dropping");
  const file = (name, text) =>
    ({ isFile: true, name, file: done => done(new File([text], name, { type: "text/csv" })) });
  const directory = (name, inside) =>
    ({ isFile: false, name, createReader: () => ({ readEntries: done => done(inside.splice(0)) }) });
  const at = inside => files.filter(([path]) => inside ? path.startsWith(inside) : !path.includes("/"))
    .map(([path, text]) => file(path.split("/").pop(), text));
  const study = directory(folder, [...at(""), directory("recordings", at("recordings/"))]);
  import("./files.js").then(files => files.dropped([{ webkitGetAsEntry: () => study }]));
}"""


class Camera:
    """Frames of a page, each with the time that it stays."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.frames: list[Image.Image] = []
        self.stay: list[int] = []
        self.sentence = ""  # what the fit says

    def take(self, ms: int = FRAME_MS) -> None:
        """One frame."""
        picture = Image.open(BytesIO(self.page.screenshot())).convert("RGB")
        self.frames.append(
            picture.resize((SHOWN, round(SHOWN * picture.height / picture.width)), Image.Resampling.LANCZOS)
        )
        self.stay.append(ms)

    def periods(self, count: int = 2) -> None:
        """The motion, over so many periods."""
        for _ in range(count):
            for k in range(PERIOD_FRAMES):
                self.page.evaluate(f"fasbody.showAt({k / PERIOD_FRAMES}); fasbody.clock.fresh = true")
                self.page.wait_for_timeout(60)
                self.take()

    def until(self, condition: str) -> None:
        """Wait for the page."""
        while not self.page.evaluate(f"Boolean({condition})"):
            self.page.wait_for_timeout(100)

    def save(self, file: Path) -> None:
        """One palette for all frames, so that nothing flickers."""
        every = self.frames[:: max(1, len(self.frames) // 8)]
        sheet = Image.new("RGB", (SHOWN, sum(f.height for f in every)))
        for i, frame in enumerate(every):
            sheet.paste(frame, (0, i * frame.height))
        common, rare = sheet.quantize(COMMON), sheet.quantize(RARE, Image.Quantize.MAXCOVERAGE)
        palette = Image.new("P", (1, 1))
        palette.putpalette([*(common.getpalette() or [])[: 3 * COMMON], *(rare.getpalette() or [])[: 3 * RARE]])
        first, *others = (f.quantize(palette=palette, dither=Image.Dither.NONE) for f in self.frames)
        first.save(
            file, save_all=True, append_images=others, duration=self.stay, loop=0, optimize=True, comment=self.sentence
        )


def drop(page: Any) -> None:
    """Drop the bundled study on a page."""
    files = [file for file in sorted(BUNDLED.rglob("*")) if file.is_file()]
    page.evaluate(DROP, [BUNDLED.name, [[str(file.relative_to(BUNDLED)), file.read_text()] for file in files]])


def shoot(page: Any, url: str) -> Camera:
    """The whole film."""
    page.goto(url)
    camera = Camera(page)
    camera.until("window.fasbody && fasbody.stats.motions > 0")
    page.evaluate("fasbody.play(false)")
    page.add_style_tag(content=SMALL)
    camera.until("fasbody.stage.renderer.domElement.clientHeight === document.getElementById('pane').clientHeight")
    page.evaluate(f"fasbody.showAt({MOMENT}); fasbody.clock.fresh = true")
    page.wait_for_timeout(500)
    camera.take(1200)
    page.evaluate(OVER)
    camera.take(700)
    drop(page)
    camera.until("(now => now.model.recorded && now.motion && now.motion.feet.measured && !now.busy)(fasbody.page)")
    camera.until("fasbody.bench.rows.length === 12")
    camera.periods(1)
    page.locator("#start_fit").scroll_into_view_if_needed()
    camera.periods(1)
    page.locator("#start_fit").click()
    camera.take(600)
    camera.until("fasbody.bench.found || fasbody.page.complaint")
    camera.until(RESTING)
    page.evaluate("document.getElementById('sentence').scrollIntoView()")
    camera.sentence = page.locator("#sentence").inner_text()
    camera.periods()
    camera.take(1500)
    other = page.evaluate("fasbody.bench.fit.branches.map(b => b.name)")[1]
    page.get_by_role("button", name=other).click()
    camera.until(RESTING)
    camera.periods()
    camera.take(1500)
    return camera


@contextmanager
def served(*options: str) -> Iterator[str]:
    """The address of a foot's page while it is served from an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "viz.foot", *options, "--no-browser", "--json"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            text = ""
            while "}" not in text:
                text += process.stdout.readline()
            yield json.loads(text)["url"]
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(60)


def main() -> None:
    """Serve the two-mass foot, and film it."""
    with sync_playwright() as playwright, served("--model", "two_dof") as url:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(CHROMIUM))
        shoot(browser.new_page(viewport=SIZE, color_scheme="dark"), url).save(FILM)
        browser.close()
    print(f"{FILM}: {FILM.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
