"""The page in a real browser: the foot is drawn, moves as simulated, follows the sliders, the file and the network."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from viewer import HIDE, Watched, bone_share, changed_share, save, served

import mjcf
from fasbody.foot.model import load
from fasbody.foot.shaker import PEAK_TO_PEAK
from fasbody.foot.two_mass import parameters, resolved
from fasbody.recording.study import BUNDLED
from viz.excitation import Excitation
from viz.exported import html
from viz.feet import Show
from viz.motion import periodic_motion
from viz.settings import Settings

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")
SCALE = 10.0


def assert_drawn_and_moving(page: Watched) -> None:
    """Bones cover part of the canvas and nothing else does; two moments differ."""
    page("showAt(0)")
    first, low = page.canvas(), page.height("tibia")
    page("showAt(0.25)")
    second, high = page.canvas(), page.height("tibia")
    assert bone_share(first) > 0.06
    page(HIDE.format("false"))
    without = page.canvas()
    page(HIDE.format("true"))
    assert changed_share(second, without) > 0.05
    assert bone_share(without) < 0.3 * bone_share(second)
    assert abs(high - low) > 0.01
    assert changed_share(first, second) > 0.002


def test_foot_in_the_browser(opened: Any) -> None:
    with served("--model", "foot_arch", "--frequency", "20", "--amplify", "10") as url:
        page = Watched(opened, url)
        assert_drawn_and_moving(page)

        # positions are the simulation's, at several moments
        motion = periodic_motion(load("foot_arch"), Settings(20.0))
        page("ride(false)")
        gain = page("stage.gain(motion, state.amplify)")
        assert gain == pytest.approx(10)
        for k in (0, 17, 40):
            page(f"showAt({k / 64})")
            for segment in ("tibia", "metatarsals", "calcaneus_talus"):
                body = list(motion.names).index(segment)
                shift = page(f"(s => [s.shift.x, s.shift.y])(stage.feet.a.segments.find(s => s.name === '{segment}'))")
                assert shift == pytest.approx(list(gain * SCALE * motion.bodies[k, body, :2]), abs=2e-4)

        # the heel pad is squeezed and the fascia stretched as the model says
        assert page("stage.squeeze(stage.feet.a, 'heel_pad')") != pytest.approx(1, abs=1e-3)
        ends = page(
            "(p => { const a = p.mesh.geometry.attributes.position.array; let l = 9, h = -9;"
            "for (let i = 0; i < a.length; i += 3) { l = Math.min(l, a[i]); h = Math.max(h, a[i]); } return h - l; })"
            "(stage.feet.a.soft.find(p => p.name === 'aponeurosis'))"
        )
        assert 1.7 < ends < 2.1

        # a slider runs the model again, and the numbers are that model's
        count = page("stats.motions")
        page.page.locator("#frequency").fill("33")
        page.until(f"stats.motions > {count} && Math.abs(motion.feet.a.duration - 1 / 33) < 1e-9")
        expected = periodic_motion(load("foot_arch"), Settings(33.0)).ratio
        assert page("motion.feet.a.ratio") == pytest.approx(expected, rel=1e-9)
        page.until("document.getElementById('state').textContent.includes('33 Hz')")
        page.page.locator("#added_mass").fill("4.5")
        page.until("Math.abs(state.added_mass - 4.5) < 1e-9 && !busy && !wanted")
        heavy = periodic_motion(load("foot_arch"), Settings(33.0, added_mass=4.5)).ratio
        page.until(f"Math.abs(motion.feet.a.ratio - {heavy}) < 1e-6")
        assert heavy != pytest.approx(expected, rel=0.02)
        page.page.locator("#parameter_k_F").fill("300")
        page.until("!busy && !wanted && 'k_F' in state.values")
        soft = page("state.values.k_F")
        changed = periodic_motion(load("foot_arch"), Settings(33.0, added_mass=4.5, values={"k_F": soft})).ratio
        page.until(f"Math.abs(motion.feet.a.ratio - {changed}) < 1e-6")

        # sliders return exactly: a double click, the thumb brought back by keys, the row's own button
        for act in ("dblclick", "keys", "back"):
            page.page.locator("#parameter_k_F").fill("300")
            page.until("'k_F' in state.values")
            if act == "dblclick":
                page("byId('parameter_k_F').dispatchEvent(new MouseEvent('dblclick', { bubbles: true }))")
            elif act == "back":
                page.page.locator("label:has(#parameter_k_F) .back").click()
            else:
                nominal = page(
                    "sliders.k_F.set(model.parameters.find(p => p.name === 'k_F').nominal), byId('parameter_k_F').value"
                )
                page.page.locator("#parameter_k_F").fill(str(int(nominal) - 1))
                page.page.locator("#parameter_k_F").press("ArrowRight")
            assert page("state.values") == {}, act
            assert not page("sliders.k_F.classList.contains('moved')"), act
        page.until(f"!busy && !wanted && Math.abs(motion.feet.a.ratio - {heavy}) < 1e-9")
        page.page.locator("#frequency").fill("47.5")
        page.page.locator("label:has(#frequency) .back").click()
        page.until("!busy && !wanted && state.frequency === 20 && motion.feet.a.duration === 1 / 20")
        page.page.locator("#frequency").fill("33")
        page.until("!busy && !wanted && motion.feet.a.duration === 1 / 33")

        # keys: frequency, pause, one frame on, camera
        page("document.activeElement.blur()")
        page.page.keyboard.press("ArrowUp")
        page.until("Math.abs(motion.feet.a.duration - 1 / 38) < 1e-9")
        page("play(true)")
        page.page.keyboard.press(" ")
        assert page("playing") is False
        before, camera = page("frame()"), page("stage.camera.position.toArray()")
        page.page.keyboard.press(".")
        assert page("frame()") == pytest.approx((before + 1) % 64, abs=1e-6)
        for shown in ("false", "true"):
            page.page.keyboard.press("k")
            assert page.page.get_by_role("button", name="Skin").get_attribute("aria-pressed") == shown
        page("ride(true); showAt(0.3)")
        table = page("stage.feet.a.segments.find(s => s.name === 'base').shift.y")
        assert table == pytest.approx(0, abs=1e-12)
        page.page.keyboard.press("4")
        assert page("stage.camera.position.toArray()") != camera

        # a connection lost in the middle: frames that arrive before the scene must not corrupt the pose
        page("showAt(0.2)")
        rest = [page.height(s) for s in ("tibia", "metatarsals", "navicular")]
        page(
            "() => { const p = Object.getOwnPropertyDescriptor(WebSocket.prototype, 'onmessage');"
            "Object.defineProperty(WebSocket.prototype, 'onmessage', { configurable: true, get: p.get,"
            "set(f) { p.set.call(this, m => setTimeout(() => f.call(this, m), 300)); } });"
            "window.seen = stats.motions; disconnect(); }"
        )
        page.until("stats.motions > window.seen && motion")
        page("showAt(0.2)")
        assert [page.height(s) for s in ("tibia", "metatarsals", "navicular")] == pytest.approx(rest, abs=1e-9)

        assert page.complaints == []
        host = url.removeprefix("http://").partition("/")[0]
        outside = [
            a for a in page.addresses if not a.startswith(("data:", "blob:", f"http://{host}/", f"ws://{host}/"))
        ]
        assert outside == []
        assert any(a.startswith("ws://") for a in page.addresses)


def test_edited_model_reloads_and_a_broken_one_is_told(opened: Any, tmp_path: Path) -> None:
    file = tmp_path / "my_foot.xml"
    shutil.copy(mjcf.path("two_dof"), file)
    good = file.read_text()
    with served("--model", str(file), "--watch", "--compare", "two_dof") as url:
        page = Watched(opened, url)
        before = page("motion.feet.a.ratio")
        assert before == pytest.approx(page("motion.feet.b.ratio"))
        page("stage.view('lateral'); play(false)")
        camera = page("stage.camera.position.toArray()")
        page.page.locator("#frequency").fill("25")
        page.until("Math.abs(motion.feet.a.duration - 1 / 25) < 1e-9 && !busy")
        before = page("motion.feet.a.ratio")

        line = 1 + good[: good.index('<joint name="fat_pad"')].count("\n")
        save(file, good.replace('<joint name="fat_pad"', '<join name="fat_pad"'))
        page.until("!document.getElementById('error').hidden")
        text = page("document.getElementById('error').textContent")
        assert f"line {line}" in text
        assert "last good model" in text
        assert page("motion.feet.a.ratio") == before
        page.page.locator("#frequency").fill("30")  # still told when the last good model moves on
        page.until("Math.abs(motion.feet.a.duration - 1 / 30) < 1e-9 && !busy")
        assert page("document.getElementById('error').textContent") == text
        page.page.locator("#frequency").fill("25")
        page.until("Math.abs(motion.feet.a.duration - 1 / 25) < 1e-9 && !busy")

        save(file, good.replace('stiffness="1.0e5"', 'stiffness="2.0e5"'))
        page.until("document.getElementById('error').hidden && motion")
        page.until(f"motion && Math.abs(motion.feet.a.ratio - {before}) > 1e-3")
        expected = periodic_motion(load(file), Settings(25.0)).ratio
        assert page("motion.feet.a.ratio") == pytest.approx(expected, rel=1e-9)
        assert page("motion.feet.b.ratio") == pytest.approx(before, rel=1e-9)
        assert page("stage.camera.position.toArray()") == pytest.approx(camera, abs=1e-9)
        assert page("state.frequency") == 25
        page.page.get_by_text("Side by side").click()
        page("showAt(0)")
        assert page("stage.feet.b.segments[0].node.position.z - stage.feet.a.segments[0].node.position.z") < -1
        assert page.complaints == []


def test_exported_page_needs_no_server(opened: Any, tmp_path: Path) -> None:
    """Opened from a file it asks for nothing else, and its sliders give the numbers of Python."""
    from typer.testing import CliRunner

    from viz.foot import app

    file = tmp_path / "foot.html"
    run = CliRunner().invoke(app, ["--model", "two_dof", "--export", str(file), "--json"])
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)["bytes"] == file.stat().st_size < 4e6
    page = Watched(opened, file.as_uri())
    assert_drawn_and_moving(page)
    page.page.locator("#seek").fill("0.5")
    page.until("Math.abs(frame() - 32) < 0.2")

    nominal = load("two_dof").values()
    for f, load_kg, changed in ((20.0, 0.0, {}), (9.5, 2.3, {"k_T": 6e4}), (41.0, 4.5, {"c_12": 300.0, "k_F": 4e4})):
        page.page.locator("#frequency").fill(str(f))
        page(f"Object.assign(state, {{ added_mass: {load_kg}, values: {json.dumps(changed)} }}); ask()")
        values = nominal | changed
        base = np.array([[-0.5j * PEAK_TO_PEAK]])
        theta = parameters(values | {"m_S": values["m_S"] + load_kg})
        ratio = complex(resolved(theta[None], np.array([2 * np.pi * f]), base).shank[0, 0] / base[0, 0])
        assert page("motion.feet.a.ratio") == pytest.approx(abs(ratio), rel=1e-4)  # of the page's step
        assert page("motion.feet.a.phase") == pytest.approx(np.degrees(np.angle(ratio)), abs=1e-2)
        shown = periodic_motion(load("two_dof"), Settings(f, added_mass=load_kg, values=changed))
        assert page("motion.feet.a.ratio") == pytest.approx(shown.ratio, rel=1e-3)
        bodies = np.reshape(page("motion.feet.a.bodies"), (64, 3, 6))
        assert np.abs(bodies - shown.bodies).max() < 2e-3 * np.abs(shown.bodies).max()
        for name, (x, force) in shown.loops.items():
            assert page(f"motion.feet.a.loops['{name}'].x") == pytest.approx(list(x), abs=4e-3 * np.abs(x).max())
            assert page(f"motion.feet.a.loops['{name}'].force") == pytest.approx(
                list(force), abs=4e-3 * np.abs(force).max()
            )
        assert page("motion.feet.a.transmissibility") == pytest.approx(list(np.abs(shown.transmissibility)), abs=1e-3)
    assert page("document.getElementById('error').hidden")
    assert page.complaints == []
    assert page.addresses[0].startswith("file:") and all(a.startswith(("data:", "blob:")) for a in page.addresses[1:])

    # where WebGL is off, the page says so, and all but the picture works
    page.page.add_init_script(
        "const all = HTMLCanvasElement.prototype.getContext; HTMLCanvasElement.prototype.getContext ="
        "function (kind, ...more) { return kind.includes('webgl') ? null : all.call(this, kind, ...more); }"
    )
    page.page.reload()
    page.until("window.modules && window.fasbody && stats.motions > 0 && stats.frames > 2 && plots.curve.series.length")
    assert page("byId('pane').innerText").startswith("This browser cannot draw in three dimensions: WebGL is off")
    page.page.locator("#frequency").fill("33")
    page.until("motion.feet.a.duration === 1 / 33")
    assert "Picture" not in page("byId('taking').textContent")
    assert page.complaints == ["THREE.WebGLRenderer: Error creating WebGL context."]


@pytest.mark.long
def test_exported_arch_holds_its_motions(opened: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("viz.live.FREQUENCIES", (10.0, 30.0))
    monkeypatch.setattr("viz.live.LOADS", (0.0, 2.3))
    file, show = tmp_path / "arch.html", Show(["foot_arch"])
    file.write_text(html(show))
    page = Watched(opened, file.as_uri())
    for f, load_kg in ((10, 0.0), (30, 2.3), (20, 2.3)):
        page.page.locator("#frequency").fill(str(f))
        page.page.locator("#added_mass").fill(str(load_kg))
        expected = show.answer(Settings(float(f), added_mass=load_kg))["feet"]["a"]
        assert page("motion.feet.a.ratio") == expected["ratio"]
        assert page("motion.feet.a.bodies") == expected["bodies"]
    page.page.locator("#frequency").fill("27.5")  # held is what was computed, and the slider says which
    assert page("state.frequency") == 30
    assert not page.page.locator("#parameters").is_visible()
    assert page.complaints == []


def test_exported_recording_keeps_its_ring(opened: Any, tmp_path: Path) -> None:
    file = tmp_path / "recorded.html"
    sides = [
        {"name": name, "values": {"k_T": k_T}, "delay_s": 0.0, "fit_percent": 99.0, "rows": [
            {"name": "k_T", "key": "k_T_n_per_m", "value": k_T, "known": "weak", "interval": f"{k_T:g} ± 1000",
             "lower": k_T - 1e3, "upper": k_T + 1e3}
        ]}
        for name, k_T in (("stiff ankle", 1.3e5), ("stiff pad", 7e4))
    ]  # fmt: skip
    fit = {"sentence": "It is so.", "reason": "Both.", "warnings": [], "verdict": "undecided", "fit_percent": 99}
    fit |= {"branches": sides}
    show = Show(["two_dof"], Excitation.recorded(BUNDLED / "recordings" / "20hz_0kg.csv"), fit=fit)
    file.write_text(html(show))
    page = Watched(opened, file.as_uri())
    page.page.get_by_role("button", name="stiff pad").click()  # the mirror foot, without a server
    mirrored = show.answer(replace(show.settings, values={"k_T": 7e4}))["feet"]["a"]["ratio"]
    assert page("motion.feet.a.ratio") == pytest.approx(mirrored, rel=1e-3)
    assert page("byId('parameter_k_T').parentElement.querySelector('.band').hidden") is False
    assert not page.page.locator("#data").is_visible()
    page("state.values = { k_T: 2e5 }; ask()")
    expected = show.answer(replace(show.settings, values={"k_T": 2e5}))["feet"]
    assert page("motion.feet.a.ratio") == pytest.approx(expected["a"]["ratio"], rel=1e-3)
    assert page("motion.feet.measured.fit_percent") == pytest.approx(expected["measured"]["fit_percent"], abs=0.1)
    assert page("motion.feet.measured.bodies") == expected["measured"]["bodies"]
    assert page.complaints == []
