"""The cell's page in a real browser: what Chromium draws is the result file's."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from made_cell import write
from typer.testing import CliRunner
from viewer import Watched, changed_share, served

from viz import cell as command
from viz.modes import SIZE, ModeShapes


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("cell"))


def positions(page: Watched, part: str) -> np.ndarray:
    found = page(f"Array.from(parts.find(p => p.name === '{part}').mesh.geometry.attributes.position.array)")
    return np.reshape(found, (-1, 3))


def visible(page: Watched, part: str, shown: bool) -> np.ndarray:
    """The canvas with a part shown or not."""
    page(f"parts.find(p => p.name === '{part}').mesh.visible = {json.dumps(shown)}")
    return page.canvas()


def test_cell_in_the_browser(opened: Any, result: Path) -> None:
    parts = ModeShapes.read(result).parts()
    with served(str(result), "--mode", "2", module="viz.cell") as url:
        page = Watched(opened, url)
        assert page("state.mode") == 2

        # the wall moves along the mode by the amplitude, a quarter of the period after rest, nucleus with it
        amplitude = page("state.amplitude")
        for mode in (2, 1, 3):
            page(f"choose({mode})")
            for share, size in ((0.0, 0.0), (0.25, 1.0), (0.75, -1.0)):
                page(f"showAt({share})")
                for name, (rest, _, modes) in parts.items():
                    expected = rest + size * amplitude * SIZE / 40 * modes[mode - 1]
                    assert positions(page, name) == pytest.approx(expected, abs=1e-5)
        assert np.abs(positions(page, "base")[:, 1]).max() < 1e-6

        # pixels: the cell covers a good part, the nucleus shows through it, and both move
        page("choose(1); stage.view('side'); showAt(0)")
        side = page.canvas()
        page("stage.view('above'); showAt(0.25)")
        above = page.canvas()
        assert changed_share(side, above) > 0.1
        assert changed_share(above, visible(page, "wall", False)) > 0.08
        assert changed_share(above, visible(page, "wall", True)) == 0
        assert changed_share(above, visible(page, "nucleus", False)) > 0.002
        visible(page, "nucleus", True)
        page("showAt(0.75)")
        assert changed_share(above, page.canvas()) > 0.02

        # the colours are those of the ends of the ramp where the mode is still and where it is largest
        colours = np.reshape(page("Array.from(parts[0].mesh.geometry.attributes.color.array)"), (-1, 3))
        size = np.linalg.norm(parts["wall"][2][0], axis=1)
        for at, share in ((size.argmin(), 0), (size.argmax(), 1)):
            assert colours[at] == pytest.approx(page(f"shade('displacement', {share}).toArray()"), abs=1e-6)

        # the chosen mode's dot stands out from the plot, dark on light
        assert page("isLight() && getComputedStyle(plots.hz.dots[0]).backgroundColor") == "rgb(20, 32, 43)"
        assert page("getComputedStyle(byId('bar')).display") == "none", "nothing is being made"

        # chooser, keys, sliders, play
        page.page.locator(".choice").nth(2).click()
        assert page("state.mode") == 3
        assert "2.500 kHz" in page.page.locator(".choice").nth(2).inner_text()
        page("document.activeElement.blur()")
        for key, mode in (("2", 2), ("ArrowRight", 3), ("ArrowRight", 3), ("9", 3), ("ArrowLeft", 2)):
            page.page.keyboard.press(key)
            assert page("state.mode") == mode
        page.until("document.getElementById('state').textContent.includes('mode 2 of 3: x sway, 27.00 Hz')")
        for lines in (False, True):
            page.page.keyboard.press("m")
            pressed = "document.querySelector('#showing [title=M]').ariaPressed"
            assert page(f"[state.lines, {pressed}]") == [lines, str(lines).lower()]
        page.page.locator("#amplitude").fill("0")
        page("showAt(0.25)")
        assert positions(page, "wall") == pytest.approx(parts["wall"][0], abs=1e-5)
        before = page("time")
        page("document.activeElement.blur()")
        page.page.keyboard.press(" ")
        page.until(f"playing && time > {before}")

        # the page follows when the result is written again
        write(result, frequencies_hz=np.array([19.0, 27.0, 2500.0]))
        page.until("cell.modes[0].hz === 19")
        assert page("state.mode") == 2
        write(result)

        assert page.complaints == []
        host = url.removeprefix("http://").partition("/")[0]
        outside = [
            a for a in page.addresses if not a.startswith(("data:", "blob:", f"http://{host}/", f"ws://{host}/"))
        ]
        assert outside == []


def test_exported_cell_needs_no_server(opened: Any, result: Path, tmp_path: Path) -> None:
    file = tmp_path / "cell.html"
    run = CliRunner().invoke(command.app, [str(result), "--export", str(file), "--mode", "3", "--json"])
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)["bytes"] == file.stat().st_size < 3e6
    page = Watched(opened, file.as_uri())
    assert page("state.mode") == 3
    page("showAt(0.25)")
    with_cell = page.canvas()
    assert changed_share(with_cell, visible(page, "wall", False)) > 0.05
    assert page.complaints == []
    assert all(a.startswith(("file:", "data:", "blob:")) for a in page.addresses)
