"""The workbench in a real browser: a recording dropped, fitted, its mirror flipped to, the model typed over."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from viewer import Watched, browser, served

import mjcf
from fasbody.recording.study import BUNDLED

ONE = BUNDLED / "recordings" / "20hz_0kg.csv"
#: A file dropped on the page, as the desktop's file manager would.
DROP = """([name, text]) => {
  const data = new DataTransfer();
  data.items.add(new File([text], name, { type: "text/csv" }));
  const about = { dataTransfer: data, bubbles: true, cancelable: true };
  for (const type of ["dragover", "drop"]) document.body.dispatchEvent(new DragEvent(type, about));
}"""
WIDE = "document.documentElement.scrollWidth"


@pytest.fixture(scope="module")
def opened() -> Iterator[Any]:
    with browser() as found:
        yield found


def test_from_a_dropped_file_to_the_mirror_foot(opened: Any, tmp_path: Path) -> None:
    own = tmp_path / "mine.xml"
    own.write_text(mjcf.path("two_dof").read_text())
    with served("--model", str(own), folder=tmp_path) as url:
        page = Watched(opened, url, (720, 480))
        page(DROP, ["20 hz.csv", ONE.read_text()])
        page.until("model.recorded && motion && motion.feet.measured && !busy")
        assert page("bench.rows[0].frequency_hz") == pytest.approx(20, abs=1e-3)
        page("showAt(0.2); fresh = true")
        page.until("byId('state').textContent.includes('measured 1.83')")
        told = page("byId('state').textContent")
        assert "behind the base" in told and "fit of this recording" in told and "relative to the table" in told

        # the ring is where the harmonics integrate to, beside the model's own
        gain = page("stage.gain(motion, state.amplify)")
        for name in ("a", "measured"):
            ring = page(
                f"stage.feet.{name}.{'worn' if name == 'a' else 'segments'}.find(s => s.name === 'ring').shift.y"
            )
            bodies = page(f"motion.feet.{name}.bodies")
            width = len(bodies) // 64
            at = 0.2 * 64
            rows = [bodies[k * width : (k + 1) * width] for k in (int(at), int(at) + 1)]
            body, table = (width // 6 - 1) * 6 + 1, 1
            parts = [row[body] - row[table] for row in rows]
            expected = parts[0] + (parts[1] - parts[0]) * (at - int(at))
            assert ring == pytest.approx(10 * gain * expected, abs=1e-6)

        # masses are corrected in the form
        page.page.get_by_role("button", name="channels, units and masses of 20 hz.csv").click()
        page.page.locator("input[name=body_mass_kg]").fill("72.57")
        page.page.get_by_role("button", name="Read it so").click()
        page.until("bench.rows[0].body_mass_kg === 72.57 && motion && !busy")

        # a fit: bands on the sliders, both branches, the words; one button flips to the other foot
        page.page.locator("#starts").fill("2")
        page.page.locator("#start_fit").click()
        page.until("bench.found || complaints")
        assert page("complaints") == ""
        page.until("!busy && !wanted && motion")
        assert page("bench.fit.branches.length") == 2
        assert page("byId('reason').textContent").startswith("The data do not decide between")
        assert page("[...byId('parameters').querySelectorAll('.band')].filter(b => !b.hidden).length") >= 8
        assert "fit_foot" in page("byId('script').textContent")
        assert page("motion.feet.measured.fit_percent") > 99
        first, other = page("bench.fit.branches.map(b => b.values.k_T)")
        assert page("state.values.k_T") == first
        names = page("bench.fit.branches.map(b => b.name)")
        page.page.get_by_role("button", name=names[1]).click()
        page.until(f"!busy && !wanted && state.values.k_T === {other}")
        assert page("motion.feet.measured.fit_percent") > 99  # the mirror follows the sine as well
        assert first != pytest.approx(other, rel=0.1)
        page.page.locator("#undo").click()
        page.until(f"!busy && !wanted && state.values.k_T === {first}")

        # a typed value, held at the bound that the model declares
        page("byId('parameter_k_T').parentElement.querySelector('output').click()")
        page.page.locator("#parameters output input").fill("2e5")
        page.page.keyboard.press("Enter")
        page.until("!busy && !wanted && state.values.k_T === 200000")
        page.page.locator("label:has(#parameter_c_13) .free").uncheck()
        assert page("bench.free") == {"c_13": False}

        # the model in the editor: a slip is a sentence on its line, what is sound moves, and Ctrl-S saves it
        page("reset.click()")
        page.until("motion && !busy && !wanted && !Object.keys(state.values).length")
        before = page("motion.feet.a.ratio")
        page.page.locator("#edit_model").click()
        page.page.locator(".cm-content").click()
        page.page.keyboard.press("Control+Home")
        page.page.keyboard.type("<")
        page.until("byId('editor_state').classList.contains('wrong')")
        assert "mine.xml, line 1" in page("byId('editor_state').textContent")
        assert page("document.querySelectorAll('.cm-lint-marker-error').length") == 1
        page.page.keyboard.press("Backspace")
        page.until("!byId('editor_state').classList.contains('wrong') && motion && !busy")
        page(
            "(at => editor.view.dispatch({ changes: { from: at, to: at + 5, insert: '0.6e5' } }))"
            "(editor.text.indexOf('1.0e5'))"
        )
        page.until(f"motion && !busy && Math.abs(motion.feet.a.ratio - {before}) > 1e-3")
        assert "0.6e5" not in own.read_text()
        page.page.locator(".cm-content").click()
        page.page.keyboard.press("Control+s")
        page.until("byId('editor_state').textContent === 'saved'")
        page.until("motion && !busy")
        assert 'stiffness="0.6e5"' in own.read_text()

        # a study is a matrix of loads against frequencies, coloured by fit
        row = "{ file: `${f}hz_${m}.csv`, unread: '', problem: '', warnings: [], frequency_hz: f, added_mass_kg: m }"
        cells, heads = page(  # at once: the saved model may still come, and clears the fit
            "() => { bench.fit = { recordings: [{ file: '20hz_0.csv', fit_percent: 98.7 }] };"
            f"listData({{ shown: 1, rows: [0, 2.3].flatMap(m => [10, 20, 30].map(f => ({row}))) }});"
            "return ['td button', 'th'].map(q => [...byId('matrix').querySelectorAll(q)].map(b => b.textContent)); }"
        )
        assert cells == ["·", "99", "·", "·", "·", "·"]
        assert heads == ["Hz", "10", "20", "30", "no load", "+ 2.3 kg"]
        for width in (1600, 1100, 420):
            page.page.set_viewport_size({"width": width, "height": 800})
            page.page.wait_for_timeout(100)
            assert page(WIDE) <= width
        assert page.complaints == []
        host = url.removeprefix("http://")
        allowed = ("data:", "blob:", f"http://{host}", f"ws://{host}")
        assert [a for a in page.addresses if not a.startswith(allowed)] == []
