"""The viewer without a server: a page that works from a file, a picture, a film."""

import base64
import contextlib
import io
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.console import console, print_json, progress_bar, write_whole
from fasbody.exceptions import MissingPackageError, SettingError
from viz.display import MODULE, SCRIPT, STYLE, Display, file_of, joined, markup, modules, page_json
from viz.motion import PER_CYCLE
from viz.scene import embedded

#: An exported page may not connect to any address.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
    "connect-src data: blob:"
)
#: Size of a picture. Drawing without a graphics card costs time by the pixel.
WIDTH, HEIGHT = 1120, 640
#: Most time for Chromium to start and to show the page [ms].
LONGEST = 180_000
#: What Chromium needs to draw without a screen and without reaching out.
CHROMIUM = (
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist", "--disable-background-networking", "--disable-sync", "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
)  # fmt: skip


#: Style by which the canvas fills the window.
CANVAS_ALONE = (
    "aside, footer, header, #legend, #timeline, #error { display: none !important } "
    "body { grid-template: 1fr / 1fr !important } main { display: block !important } "
    "#pane { position: absolute !important; inset: 0 !important }"
)

#: Pixels of the canvas by pixel of the window.
DENSITY = (
    "size => { const { renderer, viewer } = fasbody.stage; renderer.setPixelRatio(size); viewer.set_3d_pane_size() }"
)


@dataclass(frozen=True)
class Film:
    """What is drawn.

    Attributes:
        frames: of the one period, or of the whole transient.
        rate: frames a second.
        size: over a picture's.
        most: frames of a transient that are not too many.
        repeats: how often the motion is in the file.
    """

    frames: int
    rate: float
    size: float
    most: int
    repeats: int = 1


#: A GIF holds few colours and every pixel of every frame, so it is small; a period lasts two seconds in both. H.264 is
#: played once, so a film of it repeats the period.
GIF, MP4 = Film(24, 12, 0.6, 300), Film(48, 24, 1.0, 1200, repeats=4)
COLOURS = 128
#: Frames a second of a film of a transient: fewer would stutter, more are not shown by everything that plays it.
SLOWEST, FASTEST = 8.0, 50.0
#: Share of the table's power that lies below the highest frequency of a transient.
POWER = 0.99


def export_to(show: Display, file: Path, *, json: bool = False) -> None:
    """Write what `show` shows, as the file's ending says, and say so; with `json` as a document on stdout.

    Raises:
        SettingError: another ending. MissingPackageError: a tool that is not installed.
    """
    writers: dict[str, Callable[[Display], str | bytes]] = {".html": html, ".png": png, ".gif": gif, ".mp4": mp4}
    kind = file.suffix.lower()
    if kind not in writers:
        named = f"--export {file}" if file.name else "--export without a file name"
        raise SettingError(f"{named}: the ending must be one of {', '.join(writers)}.")
    size = write_whole(file, writers[kind](show)).stat().st_size
    console.print(f"written: {file} ({size / 1e6:.2f} MB)")
    if json:
        print_json({"file": str(file), "bytes": size})


def html(show: Display, documents: Mapping[str, Any] | None = None) -> str:
    """One page with scene, motion and code inside; works from file://, offline. `documents` are the exported ones."""
    data = {**(documents or show.exported(live=True)), "scene": embedded(show.hub)}
    page = markup(show.page)
    code = joined(modules(page))

    def safe(text: str) -> str:
        return text.replace("</script", "<\\/script").replace("<!--", "<\\!--")

    def module(_: re.Match[str]) -> str:
        document = page_json(data).replace("<", "\\u003c")
        carried = f'<script type="application/json" id="exported">{document}</script>'
        return f'{carried}\n<script type="module">{safe(code)}</script>'

    page = MODULE.sub(module, page)
    page = SCRIPT.sub(lambda match: f"<script>{safe(file_of(match[1]).read_text())}</script>", page)
    page = STYLE.sub(lambda match: f"<style>{file_of(match[1]).read_text()}</style>", page)
    return page.replace("<head>", f'<head>\n<meta http-equiv="Content-Security-Policy" content="{POLICY}">', 1)


def png(show: Display) -> bytes:
    """The canvas a third into the motion."""
    with _browser(show, show.exported(live=False)) as page:
        return _shot(page, 1 / 3)


def gif(show: Display) -> bytes:
    """One period as an animated GIF."""
    from PIL import Image

    documents = show.exported(live=False)
    film = paced(documents, GIF)
    images = [Image.open(io.BytesIO(frame)).convert("RGB") for frame in _frames(show, documents, film)]
    width, height = images[0].size
    strip = Image.new("RGB", (width, 4 * height))  # colours change with time: the palette is of four moments
    for i in range(4):
        strip.paste(images[i * len(images) // 4], (0, i * height))
    palette = strip.quantize(COLOURS, dither=Image.Dither.NONE)
    first, *others = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    out = io.BytesIO()
    first.save(out, "GIF", save_all=True, append_images=others, duration=round(1000 / film.rate), loop=0)
    return out.getvalue()


def mp4(show: Display) -> bytes:
    """Some periods as H.264, by ffmpeg."""
    tool, documents = ffmpeg(), show.exported(live=False)
    film = paced(documents, MP4)
    with tempfile.TemporaryDirectory() as folder:
        for i, frame in enumerate(_frames(show, documents, film)):
            (Path(folder) / f"{i:04}.png").write_bytes(frame)
        target = Path(folder) / "film.mp4"
        command = [tool, "-loglevel", "error", "-stream_loop", str(film.repeats - 1), "-framerate", f"{film.rate:.6g}",
                   "-i", f"{folder}/%04d.png", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart",
                   str(target)]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        except subprocess.TimeoutExpired:
            raise SettingError("ffmpeg has not written the film within five minutes; export a .gif.") from None
        if done.returncode:
            raise SettingError(f"ffmpeg could not write the film: {done.stderr.strip()[:200]}")
        return target.read_bytes()


def ffmpeg() -> str:
    """The system's ffmpeg, or that of imageio-ffmpeg.

    Raises:
        MissingPackageError: there is neither.
    """
    program = shutil.which("ffmpeg")
    if program is None:
        with contextlib.suppress(ImportError, RuntimeError):  # not installed; a wheel without a program
            from imageio_ffmpeg import get_ffmpeg_exe

            program = str(get_ffmpeg_exe())
    if program is None:
        raise MissingPackageError("ffmpeg", "film", otherwise="export a .gif")
    return program


def paced(documents: Mapping[str, Any], film: Film) -> Film:
    """The film of a period as it is; of a transient as long as `--slow` says, with enough frames not to be aliased.

    Raises:
        SettingError: they would be too many or too fast.
    """
    motion = next(iter(documents["motion"]["feet"].values())) if "motion" in documents else {"periodic": True}
    if motion["periodic"]:
        return film
    duration, slow = motion["duration"], documents["model"]["look"]["slow"]
    power = np.cumsum(np.abs(np.fft.rfft(motion["base"])) ** 2)
    highest = float(np.searchsorted(power, POWER * power[-1]) / duration)
    frames = ceil(duration * max(PER_CYCLE * highest, SLOWEST * slow))
    rate = frames / (duration * slow)
    if frames > film.most:
        longest = 0.95 * film.most / frames * duration
        raise SettingError(
            f"--export: {duration:g} s of motion up to {highest:.0f} Hz, {slow:g} times slower, are {frames} frames, "
            f"but {film.most} are the most; ask for --seconds {longest:.2g} or export a .html, which holds all of it."
        )
    if rate > FASTEST:
        raise SettingError(
            f"--export: a motion up to {highest:.0f} Hz only {slow:g} times slower needs {rate:.0f} frames a second, "
            f"but {FASTEST:g} are the most; ask for --slow {ceil(slow * rate / FASTEST)} or export a .html."
        )
    return replace(film, frames=frames, rate=rate, repeats=1)


def _frames(show: Display, documents: Mapping[str, Any], film: Film) -> Iterator[bytes]:
    with _browser(show, documents, film.size) as page, progress_bar() as progress:
        for k in progress.track(range(film.frames), description="drawing"):
            yield _shot(page, k / film.frames)


def _shot(page: Any, share: float) -> bytes:
    page.evaluate("share => fasbody.showAt(share)", share)
    address = page.evaluate("fasbody.stage.renderer.domElement.toDataURL('image/png')")
    return base64.b64decode(address.partition(",")[2])


def chromium() -> str | None:
    """A Chromium of the system, None if there is none."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@contextmanager
def _browser(show: Display, documents: Mapping[str, Any], size: float = 1.0) -> Iterator[Any]:
    """A headless browser with the exported page: the canvas alone, `size` times as large."""
    path = chromium()
    if path is None:
        raise SettingError("pictures and films need Chromium: apt-get install chromium, or export a .html.")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise MissingPackageError("playwright", "film", otherwise="export a .html") from None
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        file = Path(folder) / "page.html"
        file.write_text(html(show, documents))
        browser = playwright.chromium.launch(executable_path=path, args=list(CHROMIUM), timeout=LONGEST)
        try:
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, bypass_csp=True)
            page.goto(f"{file.as_uri()}?quality=fixed", timeout=LONGEST)
            page.wait_for_function("window.fasbody && fasbody.stats.motions > 0", timeout=LONGEST)
            page.add_style_tag(content=CANVAS_ALONE)
            page.evaluate("fasbody.play(false); window.requestAnimationFrame = () => 0")
            page.evaluate(DENSITY, size)
            yield page
        finally:
            browser.close()
