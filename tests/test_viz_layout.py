"""The page around the foot: nothing lies over it, keys work after the mouse, scales have their zero and bounds."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from viewer import Watched, save, served

import mjcf

#: Rectangle of the foot's drawn bones in pixels of the window: left, top, right, bottom.
BONES = """(() => {
  const box = [1e9, 1e9, -1e9, -1e9], pane = stage.renderer.domElement.getBoundingClientRect(), p = new THREE.Vector3();
  stage.viewer.scene.updateMatrixWorld(true);
  stage.camera.updateMatrixWorld(true);
  for (const s of stage.feet.a.segments) s.node.traverse(o => {
    if (s.name === "base" || !o.geometry) return;
    const at = o.geometry.attributes.position;
    for (let i = 0; i < at.count; i += 7) {
      p.fromBufferAttribute(at, i).applyMatrix4(o.matrixWorld).project(stage.camera);
      const x = pane.left + 0.5 * (p.x + 1) * pane.width, y = pane.top + 0.5 * (1 - p.y) * pane.height;
      box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
      box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
    }
  });
  return box;
})()"""
RECTANGLE = "(r => [r.left, r.top, r.right, r.bottom])(document.querySelector('{}').getBoundingClientRect())"


@pytest.fixture(scope="module")
def page(opened: Any) -> Iterator[Watched]:
    with served("--model", "foot_arch") as url:
        yield Watched(opened, url)


@pytest.mark.parametrize(
    "size", [(1600, 900), (720, 800), *(pytest.param((w, 800), marks=pytest.mark.long) for w in (1100, 420))]
)
def test_nothing_lies_over_the_foot(page: Watched, size: tuple[int, int]) -> None:
    page.page.set_viewport_size({"width": size[0], "height": size[1]})
    page.until(f"innerWidth === {size[0]} && innerHeight === {size[1]}")
    for message in ("", "my_foot.xml, line 3: MuJoCo cannot compile it."):
        page(f"complaint = '{message}'")
        page.until("stage.renderer.domElement.clientHeight === byId('pane').clientHeight")
        for view in ("medial", "lateral", "front", "above", "behind", "corner"):
            page(f"stage.view('{view}'); showAt(0)")
            left, top, right, bottom = page(BONES)
            pane = page(RECTANGLE.format("#pane"))
            assert pane[0] <= left < right <= pane[2], view
            assert pane[1] <= top < bottom <= pane[3], view
            assert bottom - top > 0.2 * (pane[3] - pane[1])  # and it is no speck
        for name in ("header", "#state", "#cameras", "#legend", "#timeline", *(["#error"] if message else [])):
            over = page(RECTANGLE.format(name))
            assert over[3] <= pane[1] + 0.5 or over[1] >= pane[3] - 0.5, name
        if message:
            assert page(RECTANGLE.format("#error"))[1] >= page(RECTANGLE.format("#state"))[3]
        assert page("document.documentElement.scrollWidth") <= size[0]  # nothing is cut, nothing scrolls sideways
    assert page.complaints == []


def test_keys_work_after_the_mouse(opened: Any) -> None:
    with served("--model", "two_dof") as url:
        page = Watched(opened, url, (900, 700))
        page.page.locator("#frequency").click()
        assert page("document.activeElement.id") == "frequency"
        skin = page("stage.skinShown")
        page.page.keyboard.press("k")
        assert page("stage.skinShown") is not skin
        page.page.keyboard.press("2")
        assert page("stage.viewed") == "lateral"
        before = page("state.frequency")
        page.page.keyboard.press("ArrowRight")  # stays the slider's
        assert page("state.frequency") == pytest.approx(before + 0.5)

        page.page.get_by_role("button", name="front").click()
        page("stage.view('above'); play(false)")
        page.page.keyboard.press(" ")
        assert page("playing") is True
        assert page("stage.viewed") == "above"
        page("play(false)")
        page.page.get_by_role("button", name="front").focus()  # reached with the keyboard it is pressed by it
        page.page.keyboard.press(" ")
        assert page("stage.viewed") == "front"
        assert page("playing") is False
        assert page.complaints == []


def test_scales_words_and_bounds(opened: Any) -> None:
    with served("--model", "foot_arch", "--compare", "foot_arch@25") as url:
        page = Watched(opened, url)
        foot = page("byId('parameter_k_T').parentElement.innerText")
        assert re.search("ankle stiffness k_T", foot)
        assert foot.replace("\u202f", "").split()[-2:] == ["10000", "3000000"]

        page("fresh = true")
        page.settle()
        legend = page("byId('legend').innerText")
        assert "change of tension" in legend
        assert [page(f"byId('legend').querySelectorAll('p')[{i}].children[1].textContent") for i in (0, 1)] == [
            "0",
            "0",
        ]
        assert page("RAMPS.tension.length") == 3  # 0 in the middle
        top = page("+byId('legend').querySelector('p').lastChild.textContent.replace(/[+ N]/g, '')")
        assert top == pytest.approx(
            page("Math.max(...Object.values(motion.feet).flatMap(f => f.loops.fascia.force).map(Math.abs))"), rel=0.01
        )

        # beside the model the other foot has the colours of its own tension, over it those of a ghost
        colour = "(showAt(0.3), stage.feet.b.soft.find(p => p.name === 'aponeurosis').mesh.material.color.toArray())"
        ghost = page(colour)
        page("apart(true)")
        force = "sample(motion.feet.b.loops.fascia.force, motion.feet.b, frame())"
        shown = page(f"(showAt(0.3), shade('tension', 0.5 + 0.5 * {force} / largest(motion, 'fascia')).toArray())")
        assert page(colour) == pytest.approx(shown, abs=1e-9)
        page("apart(false)")
        assert page(colour) == pytest.approx(ghost, abs=1e-9)
        assert ghost != pytest.approx(shown, abs=0.05)

        # a bound stops a value: slider, number and sentence say so
        page("state.values.k_F = 1e12; ask()")
        page.until("!busy && !wanted && state.values.k_F === 3e6")
        assert "k_F is held at its bound" in page("sliders.k_F.querySelector('.remark').textContent")
        assert page("byId('error').hidden")
        assert page("sliders.k_F.querySelector('output').textContent").replace("\u202f", "") == "3000000 N/m"

        # a table at rest: no ratio, no dot
        page.page.locator("#peak_to_peak").fill("0")
        page.until("!busy && !wanted && motion.feet.a.ratio === null && motion.feet.a.periodic")
        page("fresh = true")
        page.until("byId('state').textContent.includes('the table is at rest')")
        assert page.complaints == []


@pytest.mark.long
def test_included_file_is_watched(opened: Any, tmp_path: Path) -> None:
    """And both feet of the same file follow it."""
    whole = mjcf.text("two_dof")
    start, end = whole.index("  <custom>"), whole.index("</custom>") + len("</custom>")
    part, main = tmp_path / "parts" / "parameters.xml", tmp_path / "foot.xml"
    part.parent.mkdir()
    part.write_text(f"<mujoco>{whole[start:end]}</mujoco>")
    main.write_text(f'{whole[:start]}<include file="parts/parameters.xml"/>{whole[end:]}')
    shutil.copy(main, tmp_path / "kept.xml")
    with served("--model", str(main), "--watch", "--compare", str(main)) as url:
        page = Watched(opened, url)
        save(part, part.read_text().replace("N/m | 3e3 | 1e6", "N/m | 4e3 | 1e6"))
        page.until("model.parameters.find(p => p.name === 'k_F').lower === 4000 && motion")
        before = page("motion.feet.b.ratio")
        save(main, main.read_text().replace('stiffness="1.0e5"', 'stiffness="2.0e5"'))
        page.until(f"motion && Math.abs(motion.feet.b.ratio - {before}) > 1e-3")
        assert page("motion.feet.a.ratio") == page("motion.feet.b.ratio")
        assert page.complaints == []
