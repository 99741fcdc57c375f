"""The page's server: the loopback only, no caller from another site, simulations off the event loop.

It answers with the page's files and one stream for each page, only with the session's key: see `Guarded`. A notebook
may show the page in a frame, and bring it under its own name. It runs in the process of the command. Each wait has a
limit: a simulation its computing time (`viz.motion.PATIENCE`), a silent page its pings, the start of a browser
`OPENING`, the last connections `PARTING`.
"""

import asyncio
import contextlib
import json
import re
import secrets
import signal
import sys
import threading
import time
import traceback
import webbrowser
from collections.abc import Callable, Coroutine, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from fasbody.console import console, print_json
from fasbody.exceptions import FasError, SettingError
from viz.bench import PRIVATE, Bench
from viz.display import Display, file_of, files, markup, page_json, with_token
from viz.exported import html
from viz.motion import UNWANTED, UnwantedError, still_wanted
from viz.settings import settings_from
from viz.uploads import LARGEST as LARGEST_FILE

ADDRESS = "127.0.0.1"
#: What is made here -> the name that it is saved under; the report of a fit is opened.
MADE = {
    "report": "", "results": "results.zip", "take": "foot.html", "study": "study.zip", "session": "session.zip",
}  # fmt: skip
#: Largest message a page may send, the text of a model among them, and body of a request that is no file [bytes].
LARGEST, BODY = 1_000_000, 64_000
#: Seconds after which a silent or slow browser is disconnected.
PATIENCE = 30.0
#: Seconds between the last page leaving and the end of the command, so that a reload is not the end.
GRACE = 8.0
#: Seconds after the first motion when what the first long recording needs is loaded.
LOOKING = 2.0
#: Seconds for a browser to be started, and for connections to be closed at the end.
OPENING, PARTING = 15.0, 2.0
#: The answer to a request without the session's key.
REFUSED = "Open the address that the command printed: its token is missing, or belongs to an earlier session.\n"
#: And in a notebook, which may have come under a name that nobody gave.
ELSEWHERE = (
    'If the notebook is on another machine, give its address: viz.show(foot, origin="https://hub.example.org").\n'
)
#: No script but ours and no address but this server; meshcat's control panel writes styles into the page.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host} wss://{host}; font-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors {frames}"
)
#: Origins of a notebook on this machine, of which any port may be its own.
LOCAL = (f"http://{ADDRESS}:*", "http://localhost:*")


async def serve(
    show: Display, what: str, *, port: int, browser: bool, watch: bool, json: bool, bench: Bench | None = None
) -> None:
    """A command's server: say where it is, open the browser, and run until Ctrl-C.

    Where a browser was opened the last page that is closed ends it too; started by hand it stays for the next page.
    """
    server = Server(show, port, bench)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, server.stop)
    console.print(f"{what} is at {server.url} (Ctrl-C ends it)")
    if json:
        print_json({"url": server.url})
        sys.stdout.flush()  # a calling process waits for the address

    async def look() -> None:
        if await _opened(server.address_once()):
            await server.until_alone()

    await server.run(watch, look() if browser else None)


class Server:
    """Serves one page until `stop` is called.

    Args:
        show: what is shown.
        port: 0 takes a free one.
        bench: what a page may do beyond moving sliders.
        frames: origins of notebooks that may show the page in a frame, or bring it under their own name as
            jupyter-server-proxy does; none for a page of its own.

    Attributes:
        key: of the session; the token of its address, and what a page sends with each change.
        origin: scheme, name and port.
    """

    def __init__(self, show: Display, port: int = 0, bench: Bench | None = None, frames: Iterable[str] = ()) -> None:
        self.show, self.frames = show, tuple(frames)
        self.bench = bench
        self.key = secrets.token_urlsafe(24)
        self._key_once = ""
        self._followed = asyncio.Event()  # other files are to be watched
        self.pages: set[Stream] = set()
        self.visited = asyncio.Event()  # a page was here, even if it left before its browser's starter came back
        self._pool = ThreadPoolExecutor(1, "simulation")
        self._asked: set[_Asked] = set()  # motions that pages wait for
        self.tasks: set[asyncio.Task[None]] = set()  # what pages asked for
        self._reading: asyncio.Task[None] | None = None  # what was dropped
        self._prepared = False  # what the first long recording needs is loaded
        try:
            self._sockets = tornado.netutil.bind_sockets(port, address=ADDRESS)
        except OSError as error:
            problem = f"port {port} cannot be used ({error.strerror}); leave --port out for a free one."
            raise SettingError(problem) from None
        self.port = self._sockets[0].getsockname()[1]
        self.origin = f"http://{ADDRESS}:{self.port}"
        self.hosts = {f"{ADDRESS}:{self.port}", f"localhost:{self.port}"}
        self._ended = asyncio.Event()
        routes: list[Any] = [("/", Page, {"server": self, "name": show.page}), ("/stream", Stream, {"server": self})]
        routes += [(f"/{name}", Page, {"server": self, "name": name}) for name in files(show.page)]
        routes += [("/upload", Upload, {"server": self})] if bench is not None else []
        routes += [(f"/{name}", Made, {"server": self, "name": name}) for name in MADE if bench or name == "take"]
        self._application = tornado.web.Application(
            routes, websocket_ping_interval=PATIENCE / 2, websocket_ping_timeout=PATIENCE / 2,
            websocket_max_message_size=LARGEST, log_function=lambda handler: None,
        )  # fmt: skip

    @property
    def url(self) -> str:
        """The page's address, with the token that opens it."""
        return f"{self.origin}/?token={self.key}"

    def address_once(self) -> str:
        """An address that opens the page once, for a browser's command line, which other accounts can read."""
        self._key_once = secrets.token_urlsafe(24)
        return f"{self.origin}/?token={self._key_once}"

    async def run(self, watch: bool = False, beside: Coroutine[Any, Any, None] | None = None) -> None:
        """Serve until `stop`; with `watch` follow the files of what is shown; `beside` runs along."""
        http = tornado.httpserver.HTTPServer(
            self._application,
            idle_connection_timeout=PATIENCE,
            max_body_size=BODY,
            max_buffer_size=2 * LARGEST,
        )
        http.add_sockets(self._sockets)
        if self.bench is not None:
            loop = asyncio.get_running_loop()

            def later(document: dict[str, Any]) -> None:  # from the thread that listens to the fitting process
                with contextlib.suppress(RuntimeError):  # the server has ended meanwhile
                    loop.call_soon_threadsafe(self.broadcast, document)

            self.bench.send = later
        tasks = [asyncio.create_task(work) for work in (self._watch() if watch else None, beside) if work]
        try:
            await self._ended.wait()
        finally:
            for task in (*tasks, *self.tasks):
                task.cancel()
            for asked in self._asked:
                asked.stop.set()
            http.stop()
            for page in list(self.pages):
                page.close(1001, "the viewer has ended")
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(http.close_all_connections(), PARTING)
            self._pool.shutdown(wait=False, cancel_futures=True)
            if self.bench is not None:
                self.bench.close()

    def stop(self) -> None:
        """End `run`."""
        self._ended.set()

    async def answer(self, message: dict[str, Any], page: "Stream") -> str:
        """Simulate for the settings of a page's message; nothing where its next message comes before that is done.

        An action comes first: what is computed is left, and begun again after it.
        """
        loop, mine = asyncio.get_running_loop(), _Asked()
        page.asked.replaced = True
        page.asked.stop.set()
        page.asked = mine
        self._asked.add(mine)
        answer = None
        while answer is None and not mine.replaced:
            mine.stop.clear()
            answer = await loop.run_in_executor(self._pool, self._answer, message, mine.stop)
        self._asked.discard(mine)
        if self.bench is not None and not self._prepared:  # while the first motion is displayed
            self._prepared = True
            prepare = threading.Thread(target=self.bench.prepare, name="prepare", daemon=True)
            loop.call_later(LOOKING, prepare.start)
        return answer or ""

    def _answer(self, message: dict[str, Any], stop: threading.Event) -> str | None:
        started, before = time.perf_counter(), UNWANTED.set(stop)
        try:
            still_wanted()
            answer = self.show.answer(settings_from(message))
        except UnwantedError:
            return None
        except FasError as error:
            answer = {"type": "error", "text": error.on_page()}
        except Exception as error:  # a bug: reported, or the page would repeat the request
            answer = {"type": "error", "text": _bug(error)}
        finally:
            UNWANTED.reset(before)
        number = message.get("request")
        answer |= {"request": number if isinstance(number, int) else None, "seconds": time.perf_counter() - started}
        return page_json(answer)

    async def act(self, page: "Stream", message: dict[str, Any]) -> None:
        """Do the action of a page's message and send the documents to all pages, or to that page alone."""
        assert self.bench is not None
        complaint = {"type": "complaint", "of": str(message.get("type"))[:20]}
        if not self.is_session_key(str(message.get("key", ""))):
            page.send(page_json(complaint | {"text": "this page belongs to another session; reload it."}))
            return
        before = self.show.files()
        for asked in self._asked:
            asked.stop.set()
        try:
            documents = await asyncio.get_running_loop().run_in_executor(self._pool, self.bench.act, message)
        except Exception as error:
            text = self.bench.words(error) if isinstance(error, FasError) else _bug(error)
            page.send(page_json(complaint | {"text": text}))
            return
        for document in documents:
            if document["type"] in PRIVATE:
                page.send(page_json(document))
            else:
                self.broadcast(document)
        if self.bench.unread and (self._reading is None or self._reading.done()):
            self._reading = self.begin(self._read_others())
        if self.show.files() != before:
            self._followed.set()

    async def _read_others(self) -> None:
        """Read what was dropped one by one, so that motions need not wait for the last one."""
        assert self.bench is not None
        while self.bench.unread:
            try:
                documents = await asyncio.get_running_loop().run_in_executor(self._pool, self.bench.read_next)
            except Exception as error:
                documents = [{"type": "complaint", "of": "open", "text": _bug(error)}]
            for document in documents:
                self.broadcast(document)

    def begin(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Do something beside the server's other work; what still goes on when it ends is cancelled."""
        task = asyncio.create_task(work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)
        return task

    def is_session_key(self, key: str) -> bool:
        """Whether a key is this session's."""
        return secrets.compare_digest(key.encode(errors="replace"), self.key.encode())

    def knows(self, host: str, origin: str | None) -> bool:
        """Whether a request came under a name of the server, or of a notebook's, and from no page of another origin."""
        names = [("http", name) for name in self.hosts] + [frame.split("://") for frame in self.frames]
        return any(_is_name(host, name) and origin in (None, f"{scheme}://{host}") for scheme, name in names)

    def admits(self, token: str) -> bool:
        """Whether the token of an address opens the page."""
        if self._key_once and secrets.compare_digest(token.encode(errors="replace"), self._key_once.encode()):
            self._key_once = ""
            return True
        return self.is_session_key(token)

    def broadcast(self, document: dict[str, Any]) -> None:
        """Send one document to every page."""
        text = page_json(document)
        for page in list(self.pages):
            page.send(text)

    async def _watch(self) -> None:
        """Load again whenever a file is saved; folders are watched, as editors replace files."""
        from watchfiles import awatch

        while True:
            files = self.show.files()
            self._followed.clear()
            folders = {file.parent for file in files if file.parent.is_dir()}
            if not folders:
                await self._followed.wait()
                continue
            saves = awatch(*folders, step=20, debounce=60, watch_filter=_Only(files), stop_event=self._followed)
            async with contextlib.aclosing(saves):
                async for _ in saves:
                    await self._reload()
                    if set(self.show.files()) != set(files):  # another file is included now
                        break

    async def _reload(self) -> None:
        try:
            await asyncio.get_running_loop().run_in_executor(self._pool, self.show.reload)
            self.broadcast(self.show.description())
        except Exception as error:
            text = str(error) if isinstance(error, FasError) else _bug(error)
            console.print(f"not loaded: {text}", style="yellow", markup=False)
            self.show.error = f"{text} The last good model is shown."
            self.broadcast({"type": "broken", "text": self.show.error})
        for document in self.bench.followed() if self.bench else ():
            self.broadcast(document)

    async def until_alone(self) -> None:
        """Stop once there were pages and the last one has left for good."""
        await self.visited.wait()
        alone = 0.0
        while alone < GRACE:
            await asyncio.sleep(0.2)
            alone = 0.0 if self.pages else alone + 0.2
        console.print("the last page was closed")
        self.stop()


class _Asked:
    """A motion that a page waits for: whether to stop computing it, and whether the page has asked for another."""

    def __init__(self) -> None:
        self.stop, self.replaced = threading.Event(), False


class Guarded(tornado.web.RequestHandler):
    """A request handler that answers only under the server's names, and only with the session's key.

    The address that the command prints carries the key; from then on a cookie does. Browsers share cookies between
    ports, so its name has the port. In a frame they may keep none, and under a notebook's name others would get it:
    there each address carries the key.
    """

    def initialize(self, server: "Server", name: str = "") -> None:
        """Called by tornado."""
        self.server, self.name = server, name

    def prepare(self) -> None:
        """Refuse a foreign name that resolves to this machine (DNS rebinding), and pages of other servers.

        An Origin must be scheme, name and port of this very request. Tornado asks `check_origin` only where name or
        port differ, so that https would pass.
        """
        if not self.server.knows(self.request.host, self.request.headers.get("Origin")):
            raise tornado.web.HTTPError(403)
        cookie = f"fasbody-{self.server.port}"
        if self.server.is_session_key(self.get_cookie(cookie) or ""):
            return
        if not self.server.admits(self.get_query_argument("token", "")):
            raise tornado.web.HTTPError(403)
        if self.request.host in self.server.hosts:
            self.set_cookie(cookie, self.server.key, httponly=True, samesite="Lax")

    def write_error(self, status_code: int, **more: Any) -> None:
        """A refusal is one sentence."""
        if status_code != 403:
            super().write_error(status_code, **more)
            return
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(REFUSED + (ELSEWHERE if self.server.frames else ""))


class Page(Guarded):
    """One of the page's files."""

    def set_default_headers(self) -> None:
        """No caching, no guessing of types."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Server", "fasbody")

    def get(self) -> None:
        """The file, which nothing but a notebook may frame."""
        frames = " ".join(self.server.frames) or "'none'"
        self.set_header("Content-Security-Policy", POLICY.format(host=self.request.host, frames=frames))
        kinds = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
        self.set_header("Content-Type", f"{kinds[Path(self.name).suffix]}; charset=utf-8")
        text = markup(self.name, self.server.key) if self.name.endswith(".html") else file_of(self.name).read_text()
        self.write(with_token(text, self.server.key) if self.server.frames else text)


@tornado.web.stream_request_body
class Upload(Guarded):
    """Receives a dropped file from a page with this session's key; nothing of another caller is kept."""

    def prepare(self) -> None:
        """Called with the headers, before anything of the body is read."""
        super().prepare()
        self._parts: list[bytes] = []
        self._welcome = self.server.is_session_key(self.request.headers.get("X-Key", ""))
        connection: Any = self.request.connection
        connection.set_max_body_size(LARGEST_FILE)

    def data_received(self, chunk: bytes) -> None:
        """A piece of the body; that of another session is read and dropped, so that its page gets the refusal."""
        if self._welcome:
            self._parts.append(chunk)

    def post(self) -> None:
        """Keep the file; an invalid one is refused in a sentence."""
        if not self._welcome:
            raise tornado.web.HTTPError(403)
        assert self.server.bench is not None
        try:
            names = self.server.bench.keep(self.get_query_argument("name", ""), b"".join(self._parts))
        except FasError as error:
            self.set_status(400)
            self.write({"text": self.server.bench.words(error)})
        else:
            self.write({"text": "", "names": names, "session": self.server.bench.dropped_session is not None})


class Made(Guarded):
    """What the workbench wrote: the report, which runs no script; all results and the page to take away are saved."""

    def get(self) -> None:
        """The file, once it is written."""
        bench, saved = self.server.bench, MADE[self.name]
        if bench is None:
            content, saved = html(self.server.show).encode(), self.server.show.page
        elif self.name == "results":
            content = bench.zipped()
        else:
            file = bench.folder / f".{saved}" if saved else bench.results / "report.html"
            content = file.read_bytes() if file.is_file() else b""
        if not content:
            raise tornado.web.HTTPError(404)
        self.set_header("Content-Type", "application/zip" if saved.endswith(".zip") else "text/html; charset=utf-8")
        self.set_header("Content-Security-Policy", "default-src 'none'; style-src 'unsafe-inline'; img-src data:")
        self.set_header("X-Content-Type-Options", "nosniff")
        if saved:
            self.set_header("Content-Disposition", f'attachment; filename="{saved}"')
        self.write(content)


class Stream(Guarded, tornado.websocket.WebSocketHandler):
    """One page: it gets the scene, the model, and a motion for its last request."""

    def initialize(self, server: "Server", name: str = "") -> None:
        """Called by tornado."""
        super().initialize(server, name)
        self.asked = _Asked()

    _forget: Callable[[], None] = staticmethod(lambda: None)

    def check_origin(self, origin: str) -> bool:
        """Only a page of this server may connect."""
        return self.server.knows(self.request.host, origin)

    def open(self, *_: str, **__: str) -> None:
        """Send the whole scene, then what the model is."""
        self.set_nodelay(True)
        self.server.pages.add(self)
        self.server.visited.set()

        hub, loop = self.server.show.hub, asyncio.get_running_loop()

        def later(message: bytes) -> None:  # a reload happens in the simulation's thread
            loop.call_soon_threadsafe(self.send, message)

        self._forget = lambda: hub.leave(later)
        for message in hub.join(later):
            self.send(message)
        self.send(page_json(self.server.show.description()))
        for document in self.server.bench.documents() if self.server.bench else ():
            self.send(page_json(document))

    def on_close(self) -> None:
        """Forget the page, and what is computed for it."""
        self.server.pages.discard(self)
        self.asked.replaced = True
        self.asked.stop.set()
        self._forget()

    def on_message(self, message: str | bytes) -> None:
        """A request for a motion, or for an action; the next one is read before this one is answered."""
        try:
            request = json.loads(message)
            kind = request["type"]
        except (ValueError, TypeError, KeyError, RecursionError):
            self.close(1003, "not understood")
            return
        if kind == "simulate":
            work = self._simulate(request)
        elif self.server.bench is not None:
            work = self.server.act(self, request)
        else:
            return
        self.server.begin(work)

    async def _simulate(self, request: dict[str, Any]) -> None:
        if answer := await self.server.answer(request, self):
            self.send(answer)

    def send(self, message: str | bytes) -> None:
        """Write, and forget a page that has gone."""
        try:
            written = self.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:
            self.on_close()
            return
        written.add_done_callback(lambda done: done.cancelled() or done.exception())  # a page that left is no error


def _is_name(host: str, name: str) -> bool:
    """Whether a request's host is a name, where ``*`` stands for any port."""
    return host == name or (name.endswith(":*") and re.fullmatch(re.escape(name[:-2]) + r"(:\d+)?", host) is not None)


class _Only:
    """Lets through what happens to these files."""

    def __init__(self, files: Iterable[Path]) -> None:
        self._names = {str(file) for file in files}

    def __call__(self, _: object, path: str) -> bool:
        return path in self._names


def _bug(error: Exception) -> str:
    """A sentence on a bug; its traceback goes to the terminal."""
    console.print("".join(traceback.format_exception(error)), markup=False)
    return f"the viewer failed ({type(error).__name__}: {error}); its terminal has the details."


async def _opened(url: str) -> bool:
    """Whether a browser was started; one in a terminal comes back only when it is left, which nothing waits for."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[bool] = loop.create_future()

    def tell(opened: bool) -> None:
        if not done.done():
            done.set_result(opened)

    def start() -> None:
        opened = webbrowser.open(url)
        with contextlib.suppress(RuntimeError):  # the server has ended meanwhile
            loop.call_soon_threadsafe(tell, opened)

    threading.Thread(target=start, name="browser", daemon=True).start()
    try:
        return await asyncio.wait_for(done, OPENING)
    except TimeoutError:
        return False
