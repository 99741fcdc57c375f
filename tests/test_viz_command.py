"""`python -m viz.foot` as a process: where it listens, what ends it, and what it says to wrong options."""

import asyncio
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")
psutil = pytest.importorskip("psutil", reason="pip install 'fasbody[dev]'")

from page_client import WAIT, ask, documents, leave  # noqa: E402
from typer.testing import CliRunner  # noqa: E402
from viewer import save, viewer  # noqa: E402

from fasbody.exceptions import FasError  # noqa: E402
from fasbody.recording.study import BUNDLED  # noqa: E402
from viz import foot as command  # noqa: E402

RECORDED = str(BUNDLED / "recordings" / "20hz_0kg.csv")


@pytest.mark.long
def test_without_a_model_a_copy_to_edit_is_opened(tmp_path: Path) -> None:
    """And followed, without an option for it; what was edited there before is kept."""
    own = tmp_path / "my_foot.xml"

    async def client(url: str) -> None:
        socket = await ask(url, 1)
        assert (await documents(socket, "motion"))["feet"]["a"]["ratio"] > 0
        save(own, own.read_text().replace('data="N/m | 1e4 | 3e6', 'data="N/m | 2e4 | 3e6'))
        assert (await documents(socket, "model"))["parameters"][0]["lower"] == 2e4
        await leave(socket)

    with viewer(folder=tmp_path) as (url, _):
        asyncio.run(client(url))
    edited = own.read_text()
    with viewer(folder=tmp_path) as (url, _):
        pass
    assert own.read_text() == edited


@pytest.mark.long
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
        connections = psutil.Process(process.pid).net_connections(kind="inet")
        listening = [c.laddr for c in connections if c.status == psutil.CONN_LISTEN]
        assert [address.ip for address in listening] == ["127.0.0.1"]
        assert str(listening[0].port) in url
        asyncio.run(client(url, process))


@pytest.mark.long
def test_closed_browser_ends_the_command_that_opened_it() -> None:
    """A reload, gone for less than the time of grace, does not; nor does a browser that is slow to start."""

    async def client(url: str) -> None:
        await leave(await ask(url, 1))
        second = await ask(url, 1)
        assert (await documents(second, "motion"))["request"] == 0
        await leave(second)

    opener = f"{sys.executable} -c 'import time; time.sleep(4)' %s"
    with viewer("--model", "two_dof", opener=opener, grace_s=6.0) as (url, process):
        asyncio.run(client(url))
        assert process.wait(WAIT) == 0


@pytest.mark.long
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
        (["--model", "foot_arch@high"], "not a number in mm"),
        (["--model", "foot_arch@300"], "bones reach"),
        (["--model", "two_dof@25"], "five-body arch needs it"),
        (["--model", "two_dof", "--watch"], "file of your own"),
        (["--frequency", "0"], "must be between"),
        (["--added-mass", "-1"], "must be between"),
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
        (["--sweep", "--slow", "200", "--seconds", "0.2", "--export", "foot.gif"], "ask for --seconds"),
        (["--sweep", "--slow", "2", "--seconds", "0.2", "--export", "foot.gif"], "ask for --slow"),
    ],
)
def test_bad_options_are_one_sentence(
    options: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke(command.app, options)
    assert isinstance(run.exception, FasError)
    assert sentence in str(run.exception)
    assert not list(tmp_path.iterdir())  # nothing is written where the input is refused
