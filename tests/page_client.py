"""A page without a browser: it opens the socket of a server, asks for motions and leaves."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from typing import Any

import tornado.httpclient
import tornado.websocket

from viz.bench import Bench
from viz.feet import Show
from viz.server import Server

#: Only keeps a hung test from hanging the suite [s].
WAIT = 300.0
Client = Callable[[Server], Coroutine[Any, Any, None]]


def serve(show: Show, client: Client, bench: Bench | None = None) -> None:
    """Run a client against a server, then stop it; the server must end by itself."""

    async def both() -> None:
        server = Server(show, bench=bench)
        running = asyncio.create_task(server.run())
        try:
            await asyncio.wait_for(client(server), WAIT)
        finally:
            server.stop()
            await asyncio.wait_for(running, WAIT)

    asyncio.run(both())


async def status(url: str, **headers: str) -> tornado.httpclient.HTTPResponse:
    client = tornado.httpclient.AsyncHTTPClient(force_instance=True)
    try:
        return await client.fetch(url, headers=headers, raise_error=False)
    finally:
        client.close()


def at(url: str, path: str) -> str:
    """Another path of a server, with the token of its address."""
    origin, token = url.split("/?")
    return f"{origin}/{path}?{token}"


async def upgrade(server: Server, **headers: str) -> tornado.websocket.WebSocketClientConnection:
    request = tornado.httpclient.HTTPRequest(at(server.url, "stream").replace("http", "ws"), headers=headers)
    return await tornado.websocket.websocket_connect(request)


async def documents(socket: tornado.websocket.WebSocketClientConnection, kind: str) -> dict[str, Any]:
    """The next JSON document of a kind, the scene's messages passed over."""
    while True:
        message = await asyncio.wait_for(socket.read_message(), WAIT)
        assert message is not None
        if isinstance(message, str) and json.loads(message)["type"] == kind:
            return dict(json.loads(message))


async def leave(socket: tornado.websocket.WebSocketClientConnection) -> None:
    """Close a page and wait until the server has let go of it."""
    socket.close()
    while await asyncio.wait_for(socket.read_message(), WAIT) is not None:
        pass
    await asyncio.sleep(0.2)


async def ask(url: str, requests: int) -> tornado.websocket.WebSocketClientConnection:
    """A page that asks for motions and reads none."""
    headers = {"Origin": url.partition("/?")[0]}
    request = tornado.httpclient.HTTPRequest(at(url, "stream").replace("http", "ws"), headers=headers)
    socket = await tornado.websocket.websocket_connect(request)
    await documents(socket, "model")
    for number in range(requests):
        asked = {"type": "simulate", "frequency": 5, "peak_to_peak": 17.9, "added_mass": 0, "request": number}
        await socket.write_message(json.dumps(asked))
    return socket


def dropped(bench: Bench, names: list[str] | None = None) -> list[dict[str, Any]]:
    """Answers of a bench to dropped files, or to a request for the shipped study, until all are read."""
    answers = bench.act({"type": "bundled"} if names is None else {"type": "open", "names": names})
    return answers + [answer for _ in list(bench.unread) for answer in bench.read_next()]
