"""The server: refuses strangers, answers nonsense with a sentence, stays while pages come and go."""

import asyncio
import json
import struct
import time
from socket import SO_LINGER, SOL_SOCKET
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

import tornado.httpclient
import tornado.websocket
from page_client import WAIT, ask, at, documents, leave, serve, status, upgrade

from fasbody.exceptions import SettingError
from viz.bench import Bench
from viz.feet import Show
from viz.motion import still_wanted
from viz.server import REFUSED, Server
from viz.settings import Settings, settings_from


@pytest.fixture(scope="module")
def show() -> Show:
    return Show(["two_dof"])


def test_strangers_are_refused(show: Show) -> None:
    async def client(server: Server) -> None:
        page = await status(server.url)
        assert page.code == 200
        policy = page.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe-eval" not in policy
        assert "script-src 'self';" in policy
        for name in ("meshcat.js", "stage.js", "plots.js", "foot.js", "style.css", "vendor/uplot.js"):
            assert (await status(at(server.url, name))).code == 200
        for name in ("../foot.py", "foot.py", "%2e%2e/foot.py", "foot.html", "cell.html"):
            assert (await status(at(server.url, name))).code == 404
        assert (await status(server.url, Host="evil.example")).code == 403
        here = server.origin
        for origin in (
            "http://evil.example", f"http://127.0.0.1:{server.port + 1}", "null", "", f"{here}/", f"{here}.evil.org",
            *(here.replace("http:", other) for other in ("https:", "ws:", "wss:", "file:", "HTTP:")),
            here.replace("127.0.0.1", "localhost"), here.replace("//", "//me@"),
        ):  # fmt: skip
            with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
                await upgrade(server, Origin=origin)
            assert (await status(server.url, Origin=origin)).code == 403
        local = here.replace("127.0.0.1", "localhost")
        for origin, host in ((here, here), (local, local)):
            await leave(await upgrade(server, Origin=origin, Host=host.removeprefix("http://")))
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            await upgrade(server, Origin="http://evil.example", Host="evil.example")

    serve(show, client)


def test_without_the_token_of_the_address_everything_is_refused(show: Show) -> None:
    """Other accounts of this machine reach the port, too. What a browser's command line shows works once."""

    async def client(server: Server) -> None:
        paths = ("", "foot.js", "stream", "take", "upload")
        for address in [f"{server.origin}/{path}{query}" for path in paths for query in ("", "?token=", "?token=x")]:
            refused = await status(address)
            assert refused.code == 403 or (refused.code == 404 and "upload" in address)  # there is no bench
            assert "Set-Cookie" not in refused.headers
        assert refused.code == 404 and (await status(server.origin)).body.decode() == REFUSED
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            await tornado.websocket.websocket_connect(f"ws{server.origin.removeprefix('http')}/stream")
        once = server.address_once()
        page = await status(once)
        assert page.code == 200 and server.key not in once
        assert (await status(once)).code == 403
        cookie = page.headers["Set-Cookie"]
        assert "HttpOnly" in cookie and "SameSite=Lax" in cookie and f"fasbody-{server.port}=" in cookie
        assert (await status(f"{server.origin}/foot.js", Cookie=cookie.partition(";")[0])).code == 200
        assert (await status(f"{server.origin}/foot.js", Cookie=f"fasbody-{server.port}=x")).code == 403

    serve(show, client)


def test_pages_get_motions_and_sentences(show: Show) -> None:
    async def client(server: Server) -> None:
        sockets = [await upgrade(server, Origin=server.origin) for _ in range(3)]
        asked = {"type": "simulate", "frequency": 20, "peak_to_peak": 17.9, "added_mass": 0}
        for number, socket in enumerate(sockets):
            model = await documents(socket, "model")
            assert [p["name"] for p in model["parameters"]] == list(show.feet["a"].parameters)
            await socket.write_message(json.dumps(asked | {"request": number, "frequency": 20 + number}))
        for number, socket in enumerate(sockets):
            motion = await documents(socket, "motion")
            assert motion["request"] == number
            assert motion["feet"]["a"]["duration"] == pytest.approx(1 / (20 + number))
        for wrong, sentence in (
            ({"frequency": "fast"}, "cannot be read"), ({"frequency": -3}, "must be between"),
            ({"values": {"k_X": 1}}, "unknown parameter 'k_X'"), ({"values": [1]}, "cannot be read"),
            ({"frequency": 10**400}, "cannot be read"), ({"values": {"k_F": 10**400}}, "cannot be read"),
        ):  # fmt: skip
            await sockets[0].write_message(json.dumps(asked | wrong))
            assert sentence in (await documents(sockets[0], "error"))["text"]
        await sockets[2].write_message("[" * 50_000)
        while await asyncio.wait_for(sockets[2].read_message(), WAIT) is not None:
            pass
        assert (sockets[2].close_code, sockets[2].close_reason) == (1003, "not understood")
        await sockets[1].write_message("[")
        while await asyncio.wait_for(sockets[1].read_message(), WAIT) is not None:
            pass
        sockets[1].close()
        sockets[2].close()
        while len(server.pages) > 1:
            await asyncio.sleep(0.02)
        assert len(show.hub.listeners) == 1
        sockets[0].close()
        while server.pages:
            await asyncio.sleep(0.02)

    serve(show, client)
    assert not show.hub.listeners


def test_ten_killed_browsers_leave_nothing_behind(show: Show) -> None:
    """Connections that are torn off while a motion is on its way to them; the next page has its own at once."""

    async def client(server: Server) -> None:
        asked = {"type": "simulate", "frequency": 20, "peak_to_peak": 17.9, "added_mass": 0}
        for number in range(10):
            socket = await upgrade(server, Origin=server.origin)
            await socket.write_message(json.dumps(asked | {"request": number}))
            if number % 2:
                await documents(socket, "model")
            assert socket.protocol is not None and socket.protocol.stream is not None
            stream = socket.protocol.stream
            stream.socket.setsockopt(SOL_SOCKET, SO_LINGER, struct.pack("ii", 1, 0))  # no farewell: a reset
            stream.close()
            socket.close()
        last = await ask(server.url, 1)
        assert (await documents(last, "motion"))["request"] == 0
        while len(server.pages) > 1:
            await asyncio.sleep(0.02)
        assert len(show.hub.listeners) == 1
        await leave(last)

    serve(show, client)
    assert not show.hub.listeners


def test_failure_of_our_own_is_told_and_the_page_stays(show: Show, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it the socket would close and the page come back to ask the same, without end."""

    async def client(server: Server) -> None:
        socket = await ask(server.url, 0)
        asked = {"type": "simulate", "frequency": 20, "peak_to_peak": 17.9, "added_mass": 0, "request": [[1]]}
        with monkeypatch.context() as broken:
            broken.setattr(show, "answer", lambda settings: 1 / 0)
            await socket.write_message(json.dumps(asked))
            assert "the viewer failed (ZeroDivisionError" in (await documents(socket, "error"))["text"]
        await socket.write_message(json.dumps(asked | {"request": 7}))
        assert (await documents(socket, "motion"))["request"] == 7
        await leave(socket)

    serve(show, client)


def test_long_motion_makes_way(show: Show, monkeypatch: pytest.MonkeyPatch) -> None:
    """For the same page's next one, and for an action, after which it is computed again."""
    began: list[float] = []
    answer = show.answer

    def slow(settings: Settings) -> dict[str, Any]:
        began.append(settings.frequency)
        while settings.frequency == 5 and len(began) < 3:  # as one that does not settle
            still_wanted()
            time.sleep(0.01)
        return answer(settings)

    async def client(server: Server) -> None:
        socket = await ask(server.url, 0)
        asked = {"type": "simulate", "peak_to_peak": 17.9, "added_mass": 0}
        await socket.write_message(json.dumps(asked | {"request": 1, "frequency": 5}))
        while len(began) < 1:
            await asyncio.sleep(0.01)
        act = {"type": "sine", "key": server.key}
        await socket.write_message(json.dumps(act))
        assert (await documents(socket, "data"))["shown"] == -1  # before the motion
        while len(began) < 2:
            await asyncio.sleep(0.01)
        await socket.write_message(json.dumps(asked | {"request": 2, "frequency": 20}))
        assert (await documents(socket, "motion"))["request"] == 2
        assert began == [5, 5, 20]
        began.clear()
        await socket.write_message(json.dumps(asked | {"request": 3, "frequency": 5}))
        while len(began) < 1:
            await asyncio.sleep(0.01)
        await leave(socket)  # nobody waits for it
        other = await ask(server.url, 0)
        await other.write_message(json.dumps(asked | {"request": 0, "frequency": 20}))
        assert (await documents(other, "motion"))["request"] == 0
        await leave(other)

    monkeypatch.setattr(show, "answer", slow)
    serve(show, client, Bench(show))


def test_scene_keeps_the_last_of_each_property(show: Show) -> None:
    count = len(list(show.hub.messages()))
    for value in range(50):
        show.hub.property("/Grid", "visible", bool(value % 2))
    assert len(list(show.hub.messages())) == count


def test_settings_from_the_page() -> None:
    read = settings_from({"frequency": 12, "peak_to_peak": 3, "added_mass": 1, "values": {"k_F": 1e5}})
    assert (read.frequency, read.values) == (12, {"k_F": 1e5})
    with pytest.raises(SettingError):
        settings_from({})
    good = {"frequency": 12, "peak_to_peak": 3, "added_mass": 1}
    for wrong in ({"frequency": "inf"}, {"values": {"k_F": float("nan")}}, {"added_mass": float("-inf")}):
        with pytest.raises(SettingError, match="no number"):
            settings_from(good | wrong)


def test_without_a_browser_of_its_own_it_stays(show: Show, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("viz.server.GRACE", 0.3)

    async def client(server: Server) -> None:
        for _ in range(2):
            await leave(await ask(server.url, 1))
            while server.pages:
                await asyncio.sleep(0.02)
            await asyncio.sleep(1)

    serve(show, client)
