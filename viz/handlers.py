"""What the server answers: the page's files, and one stream for each page. Only to itself: see `Guarded`."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import tornado.web
import tornado.websocket

from viz.shown import file_of, markup

if TYPE_CHECKING:
    from viz.server import Server

#: No script but ours and no address but this server; meshcat's control panel writes styles into the page.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host}; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Guarded(tornado.web.RequestHandler):
    """Whatever the server answers, it answers only under its own names."""

    server: "Server"

    def prepare(self) -> None:
        """Refuse a foreign name that resolves to this machine (DNS rebinding), and every page but our own.

        An Origin must be scheme, name and port of this very request. Tornado asks `check_origin` only where name or
        port differ, so that https would pass.
        """
        origin = self.request.headers.get("Origin")
        if self.request.host not in self.server.hosts or not (origin is None or self.own(origin)):
            raise tornado.web.HTTPError(403)

    def own(self, origin: str) -> bool:
        """Whether an origin is this very server under the name that was asked for."""
        return origin == f"http://{self.request.host}"


class Page(Guarded):
    """One of the page's files."""

    def initialize(self, server: "Server", name: str) -> None:
        """Called by tornado."""
        self.server, self.name = server, name

    def set_default_headers(self) -> None:
        """No caching, no framing, no guessing of types."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Security-Policy", POLICY.format(host=self.request.host))
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Server", "fasbody")

    def get(self) -> None:
        """The file."""
        kinds = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
        self.set_header("Content-Type", f"{kinds[Path(self.name).suffix]}; charset=utf-8")
        self.write(markup(self.name) if self.name.endswith(".html") else file_of(self.name).read_bytes())


class Stream(Guarded, tornado.websocket.WebSocketHandler):
    """One page: it gets the scene, the model, and a motion for every request."""

    def initialize(self, server: "Server") -> None:
        """Called by tornado."""
        self.server = server
        self._forget: Callable[[], None] = lambda: None

    def check_origin(self, origin: str) -> bool:
        """Only our own page may connect."""
        return self.own(origin)

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
        self.send(json.dumps(self.server.show.description()))

    def on_close(self) -> None:
        """Forget the page."""
        self.server.pages.discard(self)
        self._forget()

    async def on_message(self, message: str | bytes) -> None:
        """A request for a motion."""
        try:
            request = json.loads(message)
            kind = request["type"]
        except (ValueError, TypeError, KeyError, RecursionError):
            self.close(1003, "not understood")
            return
        if kind == "simulate":
            self.send(await self.server.answer(request))

    def send(self, message: str | bytes) -> None:
        """Write, and forget a page that has gone."""
        try:
            written = self.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:
            self.on_close()
            return
        written.add_done_callback(lambda done: done.cancelled() or done.exception())  # a page that left is no error
