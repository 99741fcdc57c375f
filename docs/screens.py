"""The pictures of docs/tutorial.md: its commands, run one after the other in an empty folder, and what they show.

    python docs/screens.py

Terminals are drawn as SVG, pages by a headless Chromium. It takes two minutes and needs the extra dev.
"""

import shlex
import shutil
import subprocess
import sys
import tempfile
from io import BytesIO, StringIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright
from rich.console import Console
from rich.terminal_theme import MONOKAI
from rich.text import Text

from viz.exported import CHROMIUM, chromium

FIGURES = Path(__file__).parent / "figures"
COLUMNS, SHOWN = 120, 820  # characters of a terminal; pixels of a page in the tutorial
#: Rich's frame of a terminal without its web fonts.
FRAME = """<svg class="rich-terminal" viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg">
<style>
.{unique_id}-matrix {{ font-family: monospace; font-size: {char_height}px; line-height: {line_height}px; }}
{styles}
</style>
<defs>{lines}</defs>
<rect fill="#1e1e1e" width="{width}" height="{height}" rx="8"/>
<g transform="translate({terminal_x}, 12)">{backgrounds}<g class="{unique_id}-matrix">{matrix}</g></g>
</svg>
"""
#: Picture -> the command that it shows, and how many lines of it; without a picture it is only run.
STEPS: tuple[tuple[str, str, int], ...] = (
    ("", "laboratory my_study --added-mass 0 --added-mass 2.3 --seconds 4", 0),
    ("tutorial-check", "check my_study", 12),
    ("", "transmissibility my_study --out results/transmissibility", 0),
    ("tutorial-fit", "fit my_study --out results", 18),
    ("tutorial-undecided", "fit 20hz.csv --body-mass 72.5", 16),
)


def terminal(command: str, said: str, lines: int) -> str:
    """What a terminal shows of a command, as SVG."""
    shown = Console(record=True, width=COLUMNS, file=StringIO(), legacy_windows=False)
    shown.print(Text(f"$ fasbody {command}\n", style="bold"))
    body = [line for line in said.splitlines() if line.strip()]
    shown.print(Text("\n".join(body[:lines]) + ("\n..." if len(body) > lines else "")))
    svg = shown.export_svg(theme=MONOKAI, code_format=FRAME, unique_id="t", title="")
    return svg.replace("\u202f", "&#160;")


def page(file: Path, height: int) -> bytes:
    """The top of a page, as a small PNG."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(CHROMIUM))
        opened = browser.new_page(viewport={"width": 1100, "height": height})
        opened.goto(file.as_uri())
        picture = Image.open(BytesIO(opened.screenshot())).convert("RGB")
    return small(picture)


def small(picture: Image.Image) -> bytes:
    """A picture of 64 colours, as wide as the tutorial shows it."""
    size = (SHOWN, round(SHOWN * picture.height / picture.width))
    out = BytesIO()
    picture.resize(size, Image.Resampling.LANCZOS).quantize(64).save(out, "PNG", optimize=True)
    return out.getvalue()


def main() -> None:
    """Run the tutorial, and write its pictures."""
    with tempfile.TemporaryDirectory() as name:
        desk = Path(name)
        for picture, command, lines in STEPS:
            typed = [sys.executable, "-m", "fasbody", *shlex.split(command)]
            done = subprocess.run(typed, cwd=desk, check=True, capture_output=True, text=True)
            if picture:
                (FIGURES / f"{picture}.svg").write_text(terminal(command, done.stdout, lines))
            shutil.copy(desk / "my_study" / "recordings" / "20hz_0kg.csv", desk / "20hz.csv")
        loads = Image.open(desk / "results" / "transmissibility" / "loads_MB.png").convert("RGB")
        (FIGURES / "tutorial-transmissibility.png").write_bytes(small(loads))
        (FIGURES / "tutorial-report.png").write_bytes(page(desk / "results" / "report.html", 900))


if __name__ == "__main__":
    main()
