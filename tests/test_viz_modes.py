"""The cell for the page: reading a result, its scene and server, and one sentence on bad input."""

import asyncio
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from made_cell import HZ, write
from page_client import at, documents, serve, status, upgrade
from typer.testing import CliRunner

from fasbody.exceptions import FasError
from viz import cell as command
from viz.modes import SIZE, ModeShapes, ModeShow
from viz.server import Server


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("cell"))


def test_server_shows_the_cell_and_refuses_strangers(result: Path) -> None:
    show = ModeShow(result, 2)

    async def client(server: Server) -> None:
        page = await status(server.url)
        assert page.code == 200
        assert "default-src 'none'" in page.headers["Content-Security-Policy"]
        assert b"cell.js" in page.body
        for name in ("meshcat.js", "stage.js", "playback.js", "stream.js", "cell.js", "style.css"):
            assert (await status(at(server.url, name))).code == 200
        for name in ("foot.js", "cell.html", "cell.npz", "../cell.py"):
            assert (await status(at(server.url, name))).code == 404
        assert (await status(server.url, Host="evil.example")).code == 403
        socket = await upgrade(server, Origin=server.origin)
        model = await documents(socket, "model")
        assert [mode["hz"] for mode in model["modes"]] == list(HZ)
        assert (model["mode"], model["height_um"]) == (2, pytest.approx(20))
        await socket.write_message('{"type": "simulate", "frequency": 1, "peak_to_peak": 1, "added_mass": 0}')
        assert "computed already" in (await documents(socket, "error"))["text"]
        socket.close()
        while server.pages:
            await asyncio.sleep(0.02)

    serve(show, client)


def test_wall_and_base_are_the_whole_surface(result: Path) -> None:
    shapes = ModeShapes.read(result)
    parts = shapes.parts()
    assert len(parts["wall"][1]) + len(parts["base"][1]) == len(shapes.faces)
    for vertices, faces, modes in parts.values():
        assert faces.max() == len(vertices) - 1
        assert modes.shape == (3, len(vertices), 3)
    corners = parts["wall"][0]
    assert corners.min(axis=0) == pytest.approx([-SIZE / 2, 0, -SIZE / 2], rel=0.02)
    assert parts["base"][0][:, 1] == pytest.approx(0, abs=1e-6)


def test_any_body_of_the_command_modes(tmp_path: Path) -> None:
    """A bone lies free in the picture, with its name and its own unit; one on its base stands on a dish."""
    made = write(tmp_path / "bone")
    with np.load(made / "cell.npz") as stored:
        content = dict(stored)
    document = {"body": "calcaneus", "support": "free", "modes": [{"label": "y 57%"}] * 3}
    content["vertices_um"] = 2000 * content["vertices_um"]
    (made / "cell.npz").unlink()
    for support in ("free", "base"):
        content["document"] = np.array(json.dumps(document | {"support": support}))
        np.savez_compressed(made / "body.npz", **content)
        show = ModeShow(made)
        told = show.description()
        assert told["title"].startswith("calcaneus, 80 × 40 × 80 mm, ")
        assert (told["body"], told["unit"], told["modes"][0]["label"]) == ("calcaneus", ["mm", 1e3], "along y 57%")
        assert ("base" in told["parts"]) is (support == "base")
        assert any(b"/meshcat/cell/dish" in message for message in show.hub.messages()) is (support == "base")


def test_quick_result_is_a_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("gmsh", reason="needs the extra: pip install 'fasbody[cell]'")
    monkeypatch.setattr(command, "QUICK", 9.0)
    shapes = ModeShapes.read(command.quick(tmp_path))
    assert shapes.frequencies_hz[0] == pytest.approx(18.1, rel=0.03)
    assert set(shapes.parts()) == {"wall", "base", "nucleus"}


def test_bad_input_is_one_sentence(result: Path, tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "other.npz", vertices_um=np.zeros(3))
    np.save(tmp_path / "array.npy", np.zeros(3))
    beyond = write(tmp_path / "beyond", faces=np.array([[0, 1, 10**6]]))
    nan = write(tmp_path / "nan", frequencies_hz=np.array([1.0, np.nan, 2.0]))
    wrong = write(tmp_path / "wrong", document="[]")
    for options, sentence in (
        ([str(tmp_path / "nowhere")], "there is no such file"),
        ([str(tmp_path)], "cell.npz: there is no such file"),
        ([str(tmp_path / "text.npz")], "is not a result of the cell"),
        ([str(tmp_path / "other.npz")], "is not a result of the cell"),
        ([str(tmp_path / "array.npy")], "is not a result of the cell"),
        ([str(wrong)], "is not a result of the cell"),
        ([str(beyond)], "do not fit together"),
        ([str(nan)], "do not fit together"),
        ([str(result), "--mode", "4"], "holds the modes 1 to 3"),
        ([str(result), "--mode", "0"], "the first mode of a result is 1"),
        (["--mode", "0"], "the first mode of a result is 1"),
        ([str(result), "--export", "cell.avi"], "ending must be one of"),
    ):
        run = CliRunner().invoke(command.app, options)
        assert isinstance(run.exception, FasError), options
        assert sentence in str(run.exception), options
