"""A viewer, in a process of its own or in this one, and a headless Chromium, for the tests of the page."""

import asyncio
import contextlib
import io
import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer_apps import click_command

from viz.exported import CHROMIUM, chromium

ROOT = Path(__file__).parent.parent
#: Nothing here is timed; this only keeps a hung test from hanging the suite [s].
PATIENCE = 300.0


@contextmanager
def viewer(
    *options: str, module: str = "viz.foot", opener: str = "", folder: Path = ROOT, grace_s: float = 0.0
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """`python -m MODULE` with more options; yields its address and process, ends it by Ctrl-C.

    Args:
        options: of the command. module: the command. opener: shell-like command that it takes for a browser, with %s
            for the address; without one it opens none. folder: to work in. grace_s: for a reload, where it is not the
            command's own.
    """
    run = ["-m", module]
    if grace_s:
        code = (
            f"import runpy, viz.server as s; s.GRACE = {grace_s}; runpy.run_module('{module}', None, '__main__', True)"
        )
        run = ["-c", code]
    command = [sys.executable, *run, *([] if opener else ["--no-browser"]), "--json", *options]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    if opener:
        environment["BROWSER"] = opener
    process = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        text = ""
        while "}" not in text:
            line = process.stdout.readline()
            if not line:
                assert process.stderr is not None
                raise AssertionError(f"the viewer did not start: {process.stderr.read()}")
            text += line
        yield json.loads(text)["url"], process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(60)
        if process.poll() is None:
            process.kill()
        process.communicate()


@contextmanager
def served(*options: str, module: str = "viz.foot", folder: Path = ROOT) -> Iterator[str]:
    """The same command in a thread of this process, without the seconds of its imports; yields its address."""
    from viz import server as servers

    started: queue.Queue[Any] = queue.Queue()

    async def serve(show: Any, *_: Any, port: int, watch: bool, bench: Any = None, **__: Any) -> None:
        server = servers.Server(show, port, bench)
        started.put((server, asyncio.get_running_loop()))
        await server.run(watch)

    def work() -> None:
        try:
            click_command(module).main(["--no-browser", *options], prog_name=module, standalone_mode=False)
        except BaseException as error:
            started.put(error)

    thread = threading.Thread(target=work, name="viewer")
    with contextlib.chdir(folder):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(servers, "serve", serve)
            thread.start()
            found = started.get(timeout=PATIENCE)
        if isinstance(found, BaseException):
            raise found
        server, loop = found
        try:
            yield server.url
        finally:
            loop.call_soon_threadsafe(server.stop)
            thread.join(PATIENCE)


@contextmanager
def browser(*more: str) -> Iterator[Any]:
    """Headless Chromium, with more options; skips where there is none."""
    path = chromium()
    if path is None:
        pytest.skip("no Chromium on this machine (apt-get install chromium)")
    sync_api = pytest.importorskip("playwright.sync_api", reason="pip install 'fasbody[dev]'")
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=path, args=[*CHROMIUM, *more], timeout=1000 * PATIENCE)
        try:
            yield opened
        finally:
            opened.close()


#: Everything that the page's modules export, and a short name for an element; an exported page has no modules.
MODULES = """addEventListener("load", async () => {
  const entries = performance.getEntriesByType("resource").map(entry => entry.name);
  const files = entries.filter(name => /\\.js(\\?|$)/.test(name));
  const all = await Promise.all(files.filter(name => !/meshcat/.test(name)).map(name => import(name)));
  window.modules = Object.assign({ byId: id => document.getElementById(id) }, ...all);
})"""
#: An expression that names what modules export, what the page has for those who drive it, and the fields of its state.
SCOPE = (
    "with (window.modules ?? {}) with (window.fasbody ?? {}) with (window.fasbody?.page ?? {}) "
    "with (window.fasbody?.clock ?? {}) with (window.fasbody?.shown ?? {}) { %s }"
)
#: The page is there, and has a motion.
MOVES = "window.modules && window.fasbody && stats.motions > 0"


class Watched:
    """A page whose console errors and requests are kept, under its own content-security policy."""

    def __init__(self, opened: Any, url: str, size: tuple[int, int] = (720, 420)) -> None:
        for other in opened.contexts:
            other.close()  # a page that is left behind goes on drawing
        self.page = opened.new_page(viewport={"width": size[0], "height": size[1]})
        self.page.set_default_timeout(1000 * PATIENCE)
        self.complaints: list[str] = []
        self.addresses: list[str] = []
        page = self.page
        page.on("console", lambda m: m.type in ("error", "warning") and self.complaints.append(m.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.addresses.append(request.url))
        page.on("websocket", lambda socket: self.addresses.append(socket.url))
        page.add_init_script(MODULES)
        page.goto(f"{url}{'&' if '?' in url else '?'}quality=low")
        self.until(MOVES)
        self("play(false)")

    def __call__(self, expression: str, argument: Any = None) -> Any:
        is_function = re.match(r"(\w+|\([\w, ]*\)) =>", expression)
        if not is_function:
            return self.page.evaluate(SCOPE % expression, argument)
        return self.page.evaluate(f"argument => {{ {SCOPE % f'return ({expression})(argument)'} }}", argument)

    def until(self, condition: str) -> None:
        """Wait for a condition by asking; wait_for_function would need the policy lifted."""
        end = time.monotonic() + PATIENCE
        while not self(condition):
            assert time.monotonic() < end, f"never true: {condition}; {self.complaints}"
            time.sleep(0.05)

    def open_example(self) -> None:
        """Load the bundled study by its button, and wait until it moves."""
        self.page.locator("#bundled").click()
        self.until("bench.rows.length === 12 && motion && !busy && byId('data_state').textContent === ''")

    def resize(self, width: int, height: int) -> None:
        """Another size of the window, and wait until everything on the page has taken it up."""
        self.page.set_viewport_size({"width": width, "height": height})
        self.until(f"innerWidth === {width} && innerHeight === {height}")
        self.settle()

    def settle(self) -> None:
        """Wait for two pictures: before each of them the browser tells the page's parts of their new sizes."""
        self("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def canvas(self) -> np.ndarray:
        """The drawn canvas as (height, width, 3) integers."""
        from PIL import Image

        self("stage.render()")
        address = self("stage.renderer.domElement.toDataURL('image/png')")
        import base64

        image = Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2])))
        return np.asarray(image.convert("RGB")).astype(int)

    def height(self, segment: str) -> float:
        """Height of a segment of the first foot in the scene [dm]."""
        return float(self(f"stage.feet.a.segments.find(s => s.name === '{segment}').node.position.y"))


def save(file: Path, text: str) -> None:
    """As editors do: there whole or not at all, however busy the machine."""
    spare = file.with_name(f".{file.name}.new")
    spare.write_text(text)
    spare.replace(file)


def bone_share(picture: np.ndarray) -> float:
    """Share of warm bright pixels: bone, on a bluish dark ground."""
    red, blue = picture[..., 0], picture[..., 2]
    return float(((red > 140) & (red > blue + 12)).mean())


def changed_share(one: np.ndarray, other: np.ndarray) -> float:
    """Share of pixels that differ clearly."""
    return float((np.abs(one - other).max(-1) > 24).mean())


HIDE = "for (const s of stage.feet.a.segments) s.node.visible = {}"
