"""The viewer: frames a second, slider to picture, dropped file to foot, fit to bands, and memory over a long run.

`python -m benchmarks.viewer`.

The server runs in a separate process. A headless Chromium draws by the processor alone, which takes both cores of a
small machine, so the delay is measured with the drawing left out too: "posed" is when the new motion is in the scene.
That is wall time, which other programs lengthen; the computing time behind it is not affected.
"""

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import numpy as np
import psutil
import tornado.websocket
import typer
from tornado.httpclient import HTTPRequest

from benchmarks.table import report
from fasbody.console import command_line, console
from fasbody.recording.study import BUNDLED
from reproduction.check import Check, at_least, at_most, told
from viz.excitation import Excitation
from viz.exported import CHROMIUM, chromium
from viz.feet import Show
from viz.settings import Settings

MODELS = ("two_dof", "foot_arch")
#: Motions before memory is first read, so that everything that is made once is made.
WARM = 100
#: Seconds in which the fitting process is made ready.
READY = 15
#: Seconds after which what a page waits for does not come.
PATIENCE = 300


@contextmanager
def viewer(model: str) -> Iterator[tuple[str, psutil.Process]]:
    """The command in a separate process; yields its address and process."""
    command = [sys.executable, "-m", "viz.foot", "--no-browser", "--json", "--model", model]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        text = ""
        while "}" not in text:
            text += process.stdout.readline()
        yield json.loads(text)["url"], psutil.Process(process.pid)
    finally:
        process.terminate()
        process.wait(20)


async def _stream(url: str, seconds: float, process: psutil.Process) -> tuple[float, float, list[float]]:
    """Ask for motion after motion: frames a second, megabytes of a motion, resident memory over time [MB]."""
    origin, _, query = url.partition("/?")
    request = HTTPRequest(f"{origin}/stream?{query}".replace("http", "ws", 1), headers={"Origin": origin})
    socket = await tornado.websocket.websocket_connect(request)
    memory, frames, size, count = [], 0, 0, 0
    started = time.perf_counter()
    while time.perf_counter() - started < seconds or count < 2 * WARM:
        asked = {"type": "simulate", "frequency": 10 + count % 40, "peak_to_peak": 17.9, "added_mass": 0}
        await socket.write_message(json.dumps(asked))
        while True:
            message = await asyncio.wait_for(socket.read_message(), 60)
            if isinstance(message, str) and json.loads(message)["type"] == "motion":
                break
        count, size = count + 1, len(message)
        frames += json.loads(message)["feet"]["a"]["frames"]
        if count >= WARM and count % 20 == 0:
            memory.append(process.memory_info().rss / 1e6)
    spent = time.perf_counter() - started
    socket.close()
    return frames / spent, size / 1e6, memory


@contextmanager
def _opened(url: str, quality: str) -> Iterator[tuple[Any, Callable[[str], float]]]:
    """A page with its first motion, and a wait for a condition that gives its seconds on the wall."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(CHROMIUM))
        try:
            page = browser.new_page(viewport={"width": 1366, "height": 768})
            page.goto(f"{url}&quality={quality}")

            def until(condition: str) -> float:
                began = time.perf_counter()
                while not page.evaluate(condition):
                    if time.perf_counter() > began + PATIENCE:
                        raise TimeoutError(f"never true: {condition}")
                    time.sleep(0.01)
                return time.perf_counter() - began

            until("window.fasbody && fasbody.stats.motions > 0")
            yield page, until
        finally:
            browser.close()


def _page(url: str, quality: str, moves: int = 20) -> tuple[dict[str, float], float]:
    """Move the frequency slider: median posed and drawn delays [ms], and pictures a second while playing."""
    with _opened(url, quality) as (page, until):
        page.wait_for_timeout(5000 if quality == "auto" else 500)  # the automatic quality has settled
        first = page.evaluate("fasbody.stats.frames")
        page.wait_for_timeout(4000)
        rate = (page.evaluate("fasbody.stats.frames") - first) / 4
        page.evaluate("fasbody.play(false); fasbody.stats.posed.length = 0; fasbody.stats.drawn.length = 0")
        for k in range(moves):
            page.locator("#frequency").fill(str(12 + 2 * (k % 20)))
            until(f"fasbody.stats.drawn.length > {k}")
        medians = {key: float(np.median(page.evaluate(f"fasbody.stats.{key}"))) for key in ("posed", "drawn")}
    return medians, rate


#: Of the bundled recordings those without a load, nine of them, are ticked.
UNLOADED = "for (const r of fasbody.bench.rows) if (r.added_mass_kg || !r.subject) fasbody.bench.chosen.delete(r.id)"


def _workbench(url: str) -> dict[str, float]:
    """Times on the wall [s]: from a dropped file to the moving foot, and from Fit to bands, nine recordings."""
    with _opened(url, "none") as (page, until):
        page.locator("#files").set_input_files(BUNDLED / "recordings" / "20hz_0kg.csv")
        dropped = until("(({ model, motion }) => model.recorded && motion && motion.feet.measured)(fasbody.page)")
        page.locator("#bundled").click()
        until("fasbody.bench.rows.length === 13")
        page.evaluate(UNLOADED)
        page.wait_for_timeout(1000 * READY)  # the fitting process has compiled
        page.locator("#start_fit").click()
        until("fasbody.bench.found && !fasbody.page.busy")
        times = {"dropped": dropped, "bands": page.evaluate("fasbody.stats.fitted") / 1e3}
        return times | {"fit": page.evaluate("fasbody.bench.found.seconds")}


def _first_fit(url: str) -> float:
    """Time on the wall [s] from Fit to bands of the same, where it is pressed as soon as the example is listed."""
    with _opened(url, "none") as (page, until):
        page.locator("#bundled").click()
        until("fasbody.bench.rows.length === 12")
        page.evaluate(UNLOADED)
        page.locator("#start_fit").click()
        until("fasbody.bench.found && !fasbody.page.busy")
        return float(page.evaluate("fasbody.stats.fitted")) / 1e3


def _drawn() -> tuple[float, float]:
    """Relative difference of model and measurement, as drawn and as accelerations, with the known constants."""
    truth = json.loads((BUNDLED / "truth.json").read_text())
    settings = Settings(values=truth["parameters"], delay_s=truth["instrument"]["delay_s"])
    show = Show(["two_dof"], Excitation.recorded(BUNDLED / "recordings" / "20hz_0kg.csv"), settings)
    feet = show.answer(show.settings)["feet"]
    model, seen = feet["a"], feet["measured"]
    shank = np.reshape(model["bodies"], (64, -1, 6))[:, -1, 1]
    ring = np.reshape(seen["bodies"], (64, 2, 6))[:, 1, 1]
    by_motion = np.std(shank - ring) / np.std(ring)
    return float(by_motion), float(
        np.std(np.subtract(model["malleolus"], seen["malleolus"])) / np.std(seen["malleolus"])
    )


def _computing(model: str) -> float:
    """Median CPU time [ms] of one answer to a slider."""
    show, spent = Show([model]), []
    for frequency in np.arange(12.0, 42.0):
        began = time.process_time()
        json.dumps(show.answer(Settings(frequency)))
        spent.append(1e3 * (time.process_time() - began))
    return float(np.median(spent))


def measure(minutes: float = 0.5) -> list[Check]:
    """All rows; the memory run takes `minutes`."""
    rows = []
    moved, accelerated = _drawn()
    rows.append(at_most("recording: drawn displacement, model against measurement", 100 * moved, 2.5, "%"))
    rows.append(told("recording: the same of their accelerations", f"{100 * accelerated:.2g} %"))
    if chromium():
        with viewer("two_dof") as (url, _):
            times = _workbench(url)
        rows.append(at_most("workbench: dropped file to moving foot", times["dropped"], 1.5, "s"))
        rows.append(at_most("workbench: Fit of nine recordings, click to bands", times["bands"], 4.0, "s"))
        rows.append(told("workbench: of that in fit_foot", f"{times['fit']:.2f} s"))
        with viewer("two_dof") as (url, _):
            first = _first_fit(url)
        rows.append(at_most("workbench: Fit of them right after example, the first of a session", first, 4.0, "s"))
    for model in MODELS:
        with viewer(model) as (url, process):
            seconds = 60 * minutes if model == MODELS[-1] else 5.0
            rate, size, memory = asyncio.run(_stream(url, seconds, process))
            rows.append(at_least(f"{model}: frames a second simulated and streamed", rate, 60))
            rows.append(told(f"{model}: one motion of 64 frames", f"{1e3 * size:.0f} kB"))
            rows.append(at_most(f"{model}: computing time of one motion, median", _computing(model), 65, "ms"))
            if model == MODELS[-1]:
                grown = memory[-1] - memory[0]
                what = f"{model}: growth of the server over {seconds / 60:.3g} min ({memory[0]:.0f} MB at first)"
                rows.append(at_most(what, grown, 10, "MB"))
            if chromium():
                delay, _ = _page(url, "none")
                what = f"{model}: slider to motion posed, drawing left out, median"
                rows.append(at_most(what, delay["posed"], 65, "ms"))
                delay, pictures = _page(url, "auto")
                software = f"{model}: drawn by the processor alone: "
                rows.append(told(f"{software}slider to motion posed", f"{delay['posed']:.0f} ms"))
                rows.append(told(f"{software}slider to picture finished", f"{delay['drawn']:.0f} ms"))
                rows.append(told(f"{software}pictures a second", f"{pictures:.1f}"))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    minutes: Annotated[float, typer.Option(help="length of the memory run")] = 0.5,
    json_: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Frames per second, time from slider to picture, and memory.

    Examples:
      python -m benchmarks.viewer --minutes 30
    """
    with console.status("measuring the viewer"):
        rows: Any = measure(minutes)
    report("The viewer", rows, json_)


if __name__ == "__main__":
    command_line(app)
