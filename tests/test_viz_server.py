"""The server: loopback only, refuses strangers, answers nonsense with a sentence, ends when told."""

import asyncio
import json
import signal
import sys
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")
psutil = pytest.importorskip("psutil", reason="pip install 'fasbody[dev]'")

import tornado.httpclient  # noqa: E402
import tornado.websocket  # noqa: E402
from typer.testing import CliRunner  # noqa: E402
from viewer import viewer  # noqa: E402

from fasbody.exceptions import FasError, SettingError  # noqa: E402
from identification.fit import BUNDLED  # noqa: E402
from viz import foot as command  # noqa: E402
from viz.server import Server, settings_from  # noqa: E402
from viz.show import Show  # noqa: E402

RECORDED = str(BUNDLED / "recordings" / "20hz_0kg.csv")
#: Only keeps a hung test from hanging the suite [s].
WAIT = 300.0
Client = Callable[[Server], Coroutine[Any, Any, None]]


@pytest.fixture(scope="module")
def show() -> Show:
    return Show(["two_dof"])


def serve(show: Show, client: Client) -> None:
    """Run a client against a server, then stop it; the server must end by itself."""

    async def both() -> None:
        server = Server(show)
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


async def upgrade(server: Server, **headers: str) -> tornado.websocket.WebSocketClientConnection:
    request = tornado.httpclient.HTTPRequest(server.url.replace("http", "ws") + "stream", headers=headers)
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


def test_strangers_are_refused(show: Show) -> None:
    async def client(server: Server) -> None:
        page = await status(server.url)
        assert page.code == 200
        policy = page.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe-eval" not in policy
        assert "script-src 'self';" in policy
        for name in ("meshcat.js", "stage.js", "plots.js", "foot.js", "style.css"):
            assert (await status(server.url + name)).code == 200
        for name in ("../foot.py", "foot.py", "%2e%2e/foot.py", "foot.html", "cell.html"):
            assert (await status(server.url + name)).code == 404
        assert (await status(server.url, Host="evil.example")).code == 403
        here = server.url.rstrip("/")
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


def test_pages_get_motions_and_sentences(show: Show) -> None:
    async def client(server: Server) -> None:
        sockets = [await upgrade(server, Origin=server.url.rstrip("/")) for _ in range(3)]
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


def test_help_keeps_its_units() -> None:
    text = CliRunner().invoke(command.app, ["--help"]).output
    assert "[m/s^2]" in text
    assert "[kg]" in text


def test_process_listens_on_the_loopback_only_and_ends_on_ctrl_c() -> None:
    with viewer("--model", "two_dof") as (url, process):
        connections = psutil.Process(process.pid).net_connections(kind="inet")
        listening = [c.laddr for c in connections if c.status == psutil.CONN_LISTEN]
        assert [address.ip for address in listening] == ["127.0.0.1"]
        assert str(listening[0].port) in url
        process.send_signal(signal.SIGINT)
        assert process.wait(WAIT) == 0


async def ask(url: str, requests: int) -> tornado.websocket.WebSocketClientConnection:
    """A page that asks for motions and reads none."""
    request = tornado.httpclient.HTTPRequest(url.replace("http", "ws") + "stream", headers={"Origin": url.rstrip("/")})
    socket = await tornado.websocket.websocket_connect(request)
    await documents(socket, "model")
    for number in range(requests):
        asked = {"type": "simulate", "frequency": 5, "peak_to_peak": 17.9, "added_mass": 0, "request": number}
        await socket.write_message(json.dumps(asked))
    return socket


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ends_in_the_middle_of_simulations(number: signal.Signals) -> None:
    """With a page open, its requests queued: the connection is closed and the command ends by itself."""

    async def client(url: str, process: Any) -> None:
        socket = await ask(url, 300)
        process.send_signal(number)
        while await asyncio.wait_for(socket.read_message(), WAIT) is not None:
            pass
        assert socket.close_code == 1001
        assert await asyncio.get_running_loop().run_in_executor(None, process.wait, WAIT) == 0
        socket.close()
        await asyncio.sleep(0.2)  # the connection is seen to end

    with viewer("--model", "foot_arch") as (url, process):
        asyncio.run(client(url, process))


@pytest.mark.parametrize("starting", [0, 4])
def test_closed_browser_ends_the_command_that_opened_it(starting: int) -> None:
    """A reload, gone for less than the time of grace, does not; nor does it matter whose start is told first."""

    async def client(url: str) -> None:
        await leave(await ask(url, 1))
        second = await ask(url, 1)
        assert (await documents(second, "motion"))["request"] == 0
        await leave(second)

    opener = f"{sys.executable} -c 'import time; time.sleep({starting})' %s"
    with viewer("--model", "two_dof", opener=opener) as (url, process):
        asyncio.run(client(url))
        assert process.wait(WAIT) == 0


def test_without_a_browser_of_its_own_it_stays(show: Show, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("viz.server.GRACE", 0.3)

    async def client(server: Server) -> None:
        for _ in range(2):
            await leave(await ask(server.url, 1))
            assert not server.pages
            await asyncio.sleep(1)

    serve(show, client)


def test_browser_that_never_comes_back_holds_nothing_up() -> None:
    """One in a terminal does so; the page is served meanwhile, and Ctrl-C ends the command."""

    async def client(url: str) -> None:
        socket = await ask(url, 1)
        assert (await documents(socket, "motion"))["request"] == 0
        await leave(socket)

    sleeper = f"{sys.executable} -c 'import time; time.sleep(3600)' %s"
    with viewer("--model", "two_dof", opener=sleeper) as (url, process):
        asyncio.run(client(url))
        children = psutil.Process(process.pid).children()
        try:
            process.send_signal(signal.SIGINT)
            assert process.wait(WAIT) == 0
        finally:
            for child in children:
                child.kill()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--model", "foot_arc"], "no such model"),
        (["--model", "foot_arch@high"], "no number in mm"),
        (["--model", "foot_arch@300"], "bones reach"),
        (["--model", "two_dof@25"], "five-body arch needs it"),
        (["--watch"], "file of your own"),
        (["--frequency", "0"], "must be between"),
        (["--slow", "0"], "--slow"),
        (["--port", "99999"], "between 0 (a free one) and 65535"),
        (["--port", "-3"], "between 0 (a free one) and 65535"),
        (["--sweep", "--recording", "x.csv"], "exclude each other"),
        (["--recording", "nowhere.csv"], "nowhere.csv"),
        (["--result", "nowhere.json"], "nowhere.json"),
        (["--export", "foot.avi"], "ending must be one of"),
        (["--recording", RECORDED, "--seconds", "1e-9"], "20hz_0kg.csv: has 1 of its"),
        (["--recording", "nowhere.csv"], "give a recording"),
        (["--recording", RECORDED, "--frequency", "20"], "leave it out with --recording"),
        (["--sweep", "--peak-to-peak", "5"], "leave it out with --sweep"),
        (["--seconds", "2"], "a sine is shown for one period"),
        (["--watch", "--export", "foot.html"], "exclude each other"),
        (["--model", ""], "a model needs a name: one of"),
        (["--export", ""], "without a file name: the ending must be"),
        (["--model", "foot_arch@0"], "more than 0 and less than 79 mm"),
        (["--result", "."], "give the result.json"),
        (["--sweep", "--export", "foot.gif"], "ask for --seconds"),
        (["--sweep", "--slow", "2", "--seconds", "0.2", "--export", "foot.gif"], "ask for --slow"),
    ],
)
def test_bad_options_are_one_sentence(options: list[str], sentence: str) -> None:
    run = CliRunner().invoke(command.app, options)
    assert isinstance(run.exception, FasError)
    assert sentence in str(run.exception)
