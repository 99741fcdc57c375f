"""Film the page for the README: a study is dropped, fitted, and flipped to its mirror foot.

    python docs/film.py

It drives a headless Chromium and needs the extras view and film, and Pillow. The film shows what the page draws; only
the waiting for the fit is cut.
"""

import json
import signal
import subprocess
import sys
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from fasbody.recording.study import BUNDLED
from viz.exported import CHROMIUM, chromium

FILM = Path(__file__).parent / "figures" / "workbench.gif"
SIZE = {"width": 1180, "height": 680}
SHOWN = 860  # pixels wide in the README
COLOURS, PERIOD_FRAMES, FRAME_MS = 160, 12, 80
#: Files dropped on the page, as the desktop's file manager would.
DROP = """files => {
  const data = new DataTransfer();
  for (const [name, text] of files) data.items.add(new File([text], name, { type: "text/csv" }));
  const about = { dataTransfer: data, bubbles: true, cancelable: true };
  for (const type of ["dragover", "drop"]) document.body.dispatchEvent(new DragEvent(type, about));
}"""


class Camera:
    """Frames of a page, each with the time that it stays."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.frames: list[Image.Image] = []
        self.stay: list[int] = []

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
                self.page.evaluate(f"showAt({k / PERIOD_FRAMES}); fresh = true")
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
        palette = sheet.quantize(COLOURS, dither=Image.Dither.NONE)
        first, *others = (f.quantize(palette=palette, dither=Image.Dither.NONE) for f in self.frames)
        first.save(file, save_all=True, append_images=others, duration=self.stay, loop=0, optimize=True)


def shoot(page: Any, url: str) -> Camera:
    """The whole film."""
    page.goto(url)
    camera = Camera(page)
    camera.until("window.stats && stats.motions > 0")
    page.evaluate("play(false)")
    camera.take(1200)
    recordings = sorted((BUNDLED / "recordings").glob("*_0kg.csv"))
    page.evaluate(DROP, [[file.name, file.read_text()] for file in recordings])
    camera.until("model.recorded && motion && motion.feet.measured && !busy")
    camera.periods()
    page.locator("#starts").fill("2")
    page.locator("#start_fit").click()
    camera.take(600)
    camera.until("bench.found || complaints")
    camera.until("!busy && !wanted && motion")
    camera.periods()
    camera.take(1500)
    other = page.evaluate("bench.fit.branches.map(b => b.name)")[1]
    page.get_by_role("button", name=other).click()
    camera.until("!busy && !wanted && motion")
    camera.periods()
    camera.take(1500)
    return camera


def main() -> None:
    """Serve a copy of the two-mass foot, and film it."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        command = [sys.executable, "-m", "viz.foot", "--model", "two_dof", "--no-browser", "--json"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            text = ""
            while "}" not in text:
                text += process.stdout.readline()
            browser = playwright.chromium.launch(executable_path=chromium(), args=list(CHROMIUM))
            shoot(browser.new_page(viewport=SIZE), json.loads(text)["url"]).save(FILM)
            browser.close()
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(60)
    print(f"{FILM}: {FILM.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
