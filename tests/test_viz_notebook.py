"""The live page in the cell of a notebook: in a frame, through the notebook's own server, and of no other origin."""

import asyncio
import html
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

import tornado.httpclient
import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket
from page_client import WAIT, at, status
from viewer import browser

import fasbody as fb
import mjcf
import viz
from fasbody.exceptions import SettingError
from viz.notebook import Viewer
from viz.server import ELSEWHERE

PREFIX = "/user/me/"
#: Else Chromium looks no name up in these tests.
NAMED = "--host-resolver-rules=MAP localhost 127.0.0.1"
MOVES = "window.fasbody && fasbody.stats.motions > 0"


@pytest.fixture
def in_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a kernel, without a hub."""
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    for name in ("JUPYTERHUB_SERVICE_PREFIX", "JUPYTERHUB_PUBLIC_URL"):
        monkeypatch.delenv(name, raising=False)


@contextmanager
def shown(**options: Any) -> Iterator[Viewer]:
    viewer = viz.show("two_dof", **options)
    try:
        yield viewer
    finally:
        viewer.close()


def source(viewer: Viewer) -> str:
    """The address in the frame of the cell, which the link below it has, too."""
    cell = viewer._repr_html_()
    frame, link = re.findall(r'(?:src|href)="([^"]+)"', cell)
    assert frame == link
    return html.unescape(frame)


class _Notebook(tornado.web.RequestHandler):
    def initialize(self, cells: dict[str, str]) -> None:
        self.cells = cells

    def get(self) -> None:
        self.write(f"<!DOCTYPE html><title>notebook</title><link rel='icon' href='data:,'>{self.cells['cell']}")


class _Proxied(tornado.websocket.WebSocketHandler):
    """Brings another port under this server's name and a prefix, with the headers of the request, as Jupyter's does."""

    behind: Any = None

    async def get(self, port: str, path: str) -> None:
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            request = tornado.httpclient.HTTPRequest(self._address("ws", port, path), headers=self._passed())
            try:
                self.behind = await tornado.websocket.websocket_connect(request, on_message_callback=self._down)
            except tornado.httpclient.HTTPClientError as error:
                raise tornado.web.HTTPError(error.code) from None
            await super().get()
            return
        await self._fetch(port, path)

    async def post(self, port: str, path: str) -> None:
        await self._fetch(port, path)

    async def _fetch(self, port: str, path: str) -> None:
        answer = await tornado.httpclient.AsyncHTTPClient().fetch(
            self._address("http", port, path), method=self.request.method, headers=self._passed(),
            body=self.request.body or None, raise_error=False,
        )  # fmt: skip
        self.set_status(answer.code)
        for name, value in answer.headers.get_all():
            if name not in ("Content-Length", "Transfer-Encoding", "Connection"):
                self.set_header(name, value)
        self.finish(answer.body)

    def _address(self, scheme: str, port: str, path: str) -> str:
        return f"{scheme}://127.0.0.1:{port}/{path}?{self.request.query}"

    def _passed(self) -> dict[str, str]:
        passed = ("Host", "Origin", "Cookie", "X-Key", "Content-Type")
        return {name: value for name, value in self.request.headers.items() if name in passed}

    def _down(self, message: Any) -> None:
        if message is None:
            self.close()
        else:
            self.write_message(message, binary=isinstance(message, bytes))

    def check_origin(self, origin: str) -> bool:
        return True  # the page's own server refuses

    def on_message(self, message: Any) -> None:
        self.behind.write_message(message, binary=isinstance(message, bytes))

    def on_close(self) -> None:
        if self.behind is not None:
            self.behind.close()


@contextmanager
def notebook(cells: dict[str, str]) -> Iterator[int]:
    """A notebook's server in a thread of its own; yields its port."""
    ready, loops, ports = threading.Event(), [], []

    async def serve() -> None:
        sockets = tornado.netutil.bind_sockets(0, address="127.0.0.1")
        pages = (rf"{PREFIX}notebook", _Notebook, {"cells": cells})
        application = tornado.web.Application([pages, (rf"{PREFIX}proxy/(\d+)/(.*)", _Proxied)])
        server, ended = tornado.httpserver.HTTPServer(application), asyncio.Event()
        server.add_sockets(sockets)
        loops.append((asyncio.get_running_loop(), ended))
        ports.append(sockets[0].getsockname()[1])
        ready.set()
        await ended.wait()
        server.stop()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert ready.wait(WAIT)
    try:
        yield ports[0]
    finally:
        loops[0][0].call_soon_threadsafe(loops[0][1].set)
        thread.join(WAIT)


@pytest.mark.usefixtures("in_notebook")
def test_a_notebook_of_this_machine_may_frame_the_page_and_no_other_origin() -> None:
    with shown() as viewer:
        assert source(viewer) == viewer.url

        async def ask() -> None:
            page = await status(viewer.url)
            assert page.code == 200 and b"?token=" in page.body
            policy = page.headers["Content-Security-Policy"]
            assert policy.endswith("frame-ancestors http://127.0.0.1:* http://localhost:*")
            bare, port = viewer.url.partition("?")[0], viewer.url.rpartition(":")[2].partition("/")[0]
            for query in ("", "?token=", "?token=x"):
                assert (await status(bare + query)).code == 403
            good = ("localhost:8888", "127.0.0.1", "127.0.0.1:8888", f"localhost:{port}")
            for host in good:
                for headers in ({"Host": host}, {"Host": host, "Origin": f"http://{host}"}):
                    answer = await status(viewer.url, **headers)
                    assert answer.code == 200
                    assert ("Set-Cookie" in answer.headers) == host.endswith(port)  # other programs have that name, too
            for host in ("evil.example", "localhost.evil.example:8888", "localhost:8888x", "evil:80", "localhost:"):
                answer = await status(viewer.url, Host=host)
                assert answer.code == 403 and answer.body.decode().endswith(ELSEWHERE)
            for origin in ("http://localhost:8888", "http://evil.example", "null", f"https://127.0.0.1:{port}"):
                assert (await status(viewer.url, Origin=origin)).code == 403  # not the origin of this very request
                request = tornado.httpclient.HTTPRequest(
                    at(viewer.url, "stream").replace("http", "ws"), headers={"Origin": origin}
                )
                with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
                    await tornado.websocket.websocket_connect(request)

        asyncio.run(ask())
    assert "closed" in viewer._repr_html_() and "<iframe" not in viewer._repr_html_()


@pytest.mark.usefixtures("in_notebook")
def test_a_foot_that_was_loaded_can_be_fitted_in_the_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once no notebook could: its models were loaded before the page got them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.xml").write_text(mjcf.text("two_dof"))
    foot = fb.load("two_dof")
    for given, name, values in (
        ("two_dof", "two_dof", {}), ("foot_arch@25", "foot_arch@25", {}), (foot, "two_dof", {}),
        (foot.with_values({"k_T": 2e5}), "two_dof", {"k_T": 2e5}), (fb.load("own.xml"), "own.xml", {}),
    ):  # fmt: skip
        show = viz.notebook._display(given, None, None, None, 20.0, 0.0)
        assert (show.models, show.settings.values) == ([name], values)
    made = fb.load(mjcf.text("two_dof").replace("joint talocrural stiffness", "joint talocrural stiffness "))
    for given in (made, foot.with_values({}, step=1e-5), fb.load(tmp_path / "own.xml")):
        (tmp_path / "own.xml").unlink(missing_ok=True)
        assert viz.notebook._display(given, None, None, None, 20.0, 0.0).models == [given]


@pytest.mark.usefixtures("in_notebook")
def test_a_hub_has_the_origin_that_was_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", "/user/me/")
    with shown(origin="https://Hub.example.org/user/me/lab") as viewer:
        address, port = source(viewer), viewer.url.rpartition(":")[2].partition("/")[0]
        assert address == f"/user/me/proxy/{port}/?token={viewer.url.partition('token=')[2]}"

        async def ask() -> None:
            hub = {"Host": "hub.example.org", "Origin": "https://hub.example.org"}
            page = await status(viewer.url, **hub)
            assert page.code == 200 and "Set-Cookie" not in page.headers
            policy = page.headers["Content-Security-Policy"]
            assert policy.endswith("frame-ancestors https://hub.example.org") and "wss://hub.example.org;" in policy
            for wrong in ("http://hub.example.org", "https://hub.example.org:8000", "https://evil.example"):
                assert (await status(viewer.url, **hub | {"Origin": wrong})).code == 403
            assert (await status(viewer.url, Host="localhost:8888")).code == 403

        asyncio.run(ask())
    monkeypatch.setenv("JUPYTERHUB_PUBLIC_URL", "https://other.example.org/user/me/")
    with shown() as viewer:
        assert viewer._frames == ("https://other.example.org",)
    for wrong in ("hub.example.org", "https://a.org *", "https://a.org; script-src *", "file:///x", "https://me@a.org"):
        with pytest.raises(SettingError, match="origin"):
            viz.show("two_dof", origin=wrong)


def until(condition: Callable[[], Any], page: Any) -> None:
    """Wait, with the browser's events."""
    end = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < end
        page.wait_for_timeout(50)


@pytest.mark.long
@pytest.mark.usefixtures("in_notebook")
@pytest.mark.parametrize("proxied", [False, True])
def test_the_page_moves_in_the_cell(monkeypatch: pytest.MonkeyPatch, proxied: bool) -> None:
    if proxied:
        monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", PREFIX)
    cells: dict[str, str] = {}
    with notebook(cells) as port, shown() as viewer, browser(NAMED) as opened:
        cells["cell"] = viewer._repr_html_()
        own = viewer.url.partition("/?")[0]
        for host in ("localhost", "127.0.0.1"):  # the first is another site than the page, which gets no cookie there
            page = opened.new_page(viewport={"width": 1000, "height": 760})
            page.set_default_timeout(1000 * WAIT)
            told: list[str] = []
            page.on("console", lambda m, told=told: m.type == "error" and told.append(m.text))
            page.goto(f"http://{host}:{port}{PREFIX}notebook")
            frame = page.query_selector("iframe").content_frame()
            frame.wait_for_selector("#bundled")
            until(partial(frame.evaluate, MOVES), page)
            assert frame.evaluate("location.origin") == (f"http://{host}:{port}" if proxied else own)
            assert "token=" in frame.evaluate("location.search")  # so that the frame can be loaded again
            frame.locator("#files").set_input_files({"name": "x.csv", "mimeType": "text/csv", "buffer": b"a,b\n1,2"})
            until(partial(frame.evaluate, "fasbody.bench.rows.length"), page)
            with page.expect_download() as saved:
                frame.get_by_role("button", name="Offline page", include_hidden=True).evaluate("b => b.click()")
            assert saved.value.suggested_filename == "foot.html"
            frame.locator("#clear").evaluate("b => b.click()")
            assert told == []
            page.close()
        page = opened.new_page()
        page.goto(f"http://127.0.0.1:{port}{PREFIX}notebook")
        frame = page.query_selector("iframe").content_frame()
        until(partial(frame.evaluate, MOVES), page)
        viewer.close()  # as a kernel that is restarted; the notebook's proxy still opens a socket, and closes it
        until(lambda: "run this cell again" in frame.inner_text("#error"), page)


@pytest.mark.long
@pytest.mark.usefixtures("in_notebook")
def test_a_browser_does_not_frame_it_for_another_origin() -> None:
    cells: dict[str, str] = {}
    with notebook(cells) as port, shown(origin="https://hub.example.org") as viewer, browser(NAMED) as opened:
        cells["cell"] = f'<iframe src="{viewer.url}"></iframe>'
        page, told = opened.new_page(), []
        page.on("console", lambda m: told.append(m.text))
        page.goto(f"http://localhost:{port}{PREFIX}notebook")
        until(lambda: any("frame-ancestors" in text for text in told), page)
        assert page.frames[1].url.startswith("chrome-error:") or not page.frames[1].query_selector("#bundled")
