"""The workbench in a real browser: a recording dropped, fitted, its mirror flipped to, the model typed over."""

import io
import json
import struct
import subprocess
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from viewer import Watched, bone_share, save, served, viewer

import mjcf
from fasbody.recording.study import BUNDLED
from viz.exported import ffmpeg

ONE = BUNDLED / "recordings" / "20hz_0kg.csv"
#: A file dropped on the page, as the desktop's file manager would.
DROP = """([name, text]) => {
  const data = new DataTransfer();
  data.items.add(new File([text], name, { type: "text/csv" }));
  const about = { dataTransfer: data, bubbles: true, cancelable: true };
  for (const type of ["dragover", "drop"]) document.body.dispatchEvent(new DragEvent(type, about));
}"""
#: Left, top, width and height of an element.
RECTANGLE = "(r => [r.left, r.top, r.width, r.height])(byId(id).getBoundingClientRect())"
WIDE = "document.documentElement.scrollWidth"
#: What the fitting process says of rivals.
RIVALS = {
    "type": "rivals", "title": "", "columns": ["rival", "BIC"], "adequate": [True, False],
    "rows": [["the model", "0"], ["linear dampers", "1.6e+05"]], "notes": ["The recordings prefer the model."],
    "script": "idn.compare_rivals(recordings)",
}  # fmt: skip


@pytest.mark.long
def test_from_a_dropped_file_to_the_mirror_foot(opened: Any, tmp_path: Path) -> None:
    own = tmp_path / "mine.xml"
    own.write_text(mjcf.text("two_dof"))
    with served("--model", str(own), folder=tmp_path) as url:
        page = Watched(opened, url, (720, 480))
        page(DROP, ["20 hz.csv", ONE.read_text()])
        page.until("model.recorded && motion && motion.feet.measured && !busy")
        assert page("bench.rows[0].frequency_hz") == pytest.approx(20, abs=1e-3)
        page("showAt(0.2); fresh = true")
        page.until("byId('state').textContent.includes('measured 1.83')")
        told = page("byId('state').textContent")
        assert "behind the base" in told and "fit with these values" in told and "relative to the table" in told

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

        # masses are typed in the table
        cell = page.page.get_by_label("body mass [kg] of 20 hz.csv")
        cell.fill("72.57")
        cell.press("Enter")
        page.until("bench.rows[0].body_mass_kg === 72.57 && motion && !busy")

        # a fit: bands on the sliders, both branches, the words; one button flips to the other foot
        page.page.locator("#starts").fill("2")
        page.page.locator("#start_fit").click()
        page.until("bench.found || complaint")
        assert page("complaint") == ""
        page.until("!busy && !wanted && motion")
        assert page("bench.fit.branches.length") == 2
        assert page("byId('reason').textContent").startswith("The data do not decide between")
        assert page("[...byId('parameters').querySelectorAll('.band')].filter(b => !b.hidden).length") == 0
        assert "fit_foot" in page("byId('script').textContent")
        assert page("motion.feet.measured.fit_percent") > 99
        assert page("task") == "fit"  # which stays in sight with what to do next, whatever is open
        page("openTask('model')")
        page.page.locator("label:has(#parameter_c_12) output").click()
        page.page.locator("#parameters output input").fill("41")
        page.page.keyboard.press("Enter")
        page.until("!busy && !wanted && state.values.c_12 === 41")
        for _ in range(3):  # a lost connection changes nothing that was set, however often
            before = page("stats.motions")
            page("disconnect()")
            page.until(f"isConnected() && bench.rows.length && !busy && motion && stats.motions > {before}")
        assert not page.complaints and page("[state.values.c_12, bench.fit.branches.length, ticked()]") == [41, 2, [0]]
        page.page.locator("#undo").click()
        first, other = page("bench.fit.branches.map(b => b.values.k_T)")
        assert page("state.values.k_T") == first
        names = page("bench.fit.branches.map(b => b.name)")
        page("openTask('fit')")
        page.page.get_by_role("button", name=names[1]).click()
        page.until(f"!busy && !wanted && state.values.k_T === {other}")
        assert page("motion.feet.measured.fit_percent") > 99  # the mirror follows the sine as well
        assert first != pytest.approx(other, rel=0.1)
        page.page.keyboard.press("Control+z")
        page.until(f"!busy && !wanted && state.values.k_T === {first}")
        assert page("byId('branches').querySelector('[aria-pressed=true]').textContent") == names[0]

        # report and all results: the same numbers
        with page.page.expect_download() as saved:
            page.page.locator("#save_results").click()
        with zipfile.ZipFile(saved.value.path()) as packed:
            names = packed.namelist()
            told = json.loads(packed.read("results/result.json"))
            text = packed.read("results/report.html").decode()
        assert {"results/report.html", "results/parameters.csv", "results/figures/transmissibility.svg"} <= set(names)
        entry = told["branches"][0]["parameters"]["k_T_n_per_m"]
        assert entry["value"] == first
        assert f"fasbody view --model {own} --result results/result.json" in text

        # a typed value, held at the bound that the model declares
        page("openTask('model')")
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
        page.until("byId('editor_state').textContent === 'saved to mine.xml'")
        page.until("motion && !busy")
        assert 'stiffness="0.6e5"' in own.read_text()

        # another program's work: followed while nothing is unsaved, else somebody must choose
        theirs = own.read_text().replace("0.6e5", "0.7e5")
        save(own, theirs)
        page.until("typedText().includes('0.7e5') && motion && !busy")
        page("editor.view.dispatch({ changes: { from: 0, insert: '<!-- mine -->' } })")
        save(own, theirs.replace("0.7e5", "0.8e5"))
        page.until("!byId('conflict').hidden")
        assert page("save_model.disabled")
        page("saveModel()")
        page("take_theirs.click()")
        page.until("byId('conflict').hidden && typedText().includes('0.8e5') && motion && !busy")
        assert own.read_text() == page("typedText()") == theirs.replace("0.7e5", "0.8e5")
        page.until("!byId('stale').hidden")
        assert "the model's file was changed" in page("byId('stale').textContent")

        # rivals need three frequencies, and say so
        page.page.locator("#start_rivals").click()
        page.until("complaint")
        assert "three or more frequencies" in page("complaint")
        page(f"receive({{ ...{json.dumps(RIVALS)}, type: 'rivals' }})")
        shown = page("[...byId('rivals').rows].map(r => [r.className, ...[...r.cells].map(c => c.textContent)])")
        assert shown == [["", "rival", "BIC"], ["", "the model", "0"], ["ruled", "linear dampers", "1.6e+05"]]
        assert page("byId('rivals_sentence').textContent") == "The recordings prefer the model."
        assert page("byId('rivals_plots').hidden") is False
        page("tab('fit')")

        # a study is a matrix of loads against frequencies, coloured by fit
        row = (
            "{ file: `${f}hz_${m}.csv`, id: 3 * (m > 0) + f / 10 - 1, "
            "unread: '', problem: '', warnings: [], frequency_hz: f, added_mass_kg: m }"
        )
        again = (
            "{ file: 'b/20hz_0b.csv', id: 9, unread: '', problem: '', warnings: [], "
            "frequency_hz: 20.04, added_mass_kg: 0 }"
        )
        cells, heads, named = page(  # at once: the saved model may still come, and clears the fit
            "() => { bench.found = null; bench.fit = { branches: [{ name: 'best', values: {}, rows: [] }], "
            "warnings: [], recordings: ["
            "{ file: '20hz_0.csv', fit_percent: 98.7 }, { file: 'b/20hz_0b.csv', fit_percent: 97.5 }] };"
            f"receive({{ type: 'data', session: bench.session, stale: '', shown: 1, "
            f"rows: [...[0, 2.3].flatMap(m => [10, 20, 30].map(f => ({row}))), {again}] }});"
            "const all = q => [...byId('matrix').querySelectorAll(q)], texts = q => all(q).map(b => b.textContent);"
            "const named = all('button').map(b => b.title).filter(t => t.includes(' of 2'));"
            "return [texts('td button'), texts('th'), named]; }"
        )
        assert cells == ["·", "98.7", "·", "97.5", "·", "·", "·"]
        assert heads == ["Hz", "10", "20", "30", "no load", "repeat 2", "+ 2.3 kg"]
        assert named == ["20hz_0.csv (1 of 2 at 20 Hz): fit 98.7 %", "b/20hz_0b.csv (2 of 2 at 20.04 Hz): fit 97.5 %"]
        for width in (1600, 1100, 800, 420):
            page.resize(width, 800)
            assert page(WIDE) <= width
            inside = page(f"['editor', 'plots'].map(id => {RECTANGLE})")
            assert all(width_ > 200 and height > 80 for _, _, width_, height in inside), width
            (_, top, _, tall), (_, below, *_) = inside
            assert width in (1600, 1100) or top + tall <= below + 1  # beside or above the curves that follow it
        assert page.complaints == []
        host = url.removeprefix("http://").partition("/")[0]
        allowed = ("data:", "blob:", f"http://{host}", f"ws://{host}")
        assert [a for a in page.addresses if not a.startswith(allowed)] == []


#: What may be typed, and what it is; None where a sentence says what is wrong.
TYPED = {
    "150000": 150000, "150\u202f000": 150000, "150\u2009000": 150000, "150 000,5": 150000.5, "150'000": 150000,
    "1,500,000": 1.5e6, "1,500.5": 1500.5, "2,5": 2.5, "0,125": 0.125, "1500,125": 1500.125, ".5": 0.5, "-5": -5,
    "\u22125": -5, "1e5": 1e5, "1,5e3": 1500, " 12 ": 12,
    "150,000": None, "abc": None, "1 50": None, "1e999": None, "12 Hz": None, "--5": None, "1.2.3": None, "": None,
}  # fmt: skip


@pytest.mark.long
def test_typed_numbers_are_taken_as_meant_or_a_sentence_says_why_not(opened: Any, tmp_path: Path) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url)
        found = page("texts => texts.map(typedNumber)", list(TYPED))
        for (text, meant), value in zip(TYPED.items(), found, strict=True):
            assert isinstance(value, str) if meant is None else value == meant, text

        def typed(text: str, place: str = "output") -> str:
            page.page.locator(f"label:has(#parameter_k_F) {place}").click()
            page.page.locator("#parameters input[type=text]").fill(text)
            page.page.keyboard.press("Enter")
            return said()

        def said(row: str = "k_F") -> str:
            return str(
                page(f"[...sliders.{row}.querySelectorAll('.remark:not([hidden])')].map(r => r.textContent).join()")
            )

        low, high = page("(p => [p.lower, p.upper])(model.parameters.find(p => p.name === 'k_F'))")
        assert typed("80\u202f000") == "" and page("state.values.k_F") == 80000
        assert "bound" in typed("1e99") and page("state.values.k_F") == high
        page.until("motion && !busy && !wanted")
        assert "bound" in said()  # the motion that follows does not take it away
        assert "bound" in typed("-5") and page("state.values.k_F") == low
        assert "may mean 150000 or 150.000" in typed("150,000") and page("state.values.k_F") == low
        assert typed("abc") == '"abc" is not a number.'
        page("sliders.k_T.querySelector('output').click()")  # another field has its own, and takes none away
        page.page.locator("#parameters input[type=text]").fill("x")
        page.page.keyboard.press("Enter")
        assert (said("k_T"), said()) == ('"x" is not a number.', '"abc" is not a number.')
        page.page.locator("#parameter_k_T").press("ArrowRight")
        assert (said("k_T"), said()) == ("", '"abc" is not a number.')
        page("sliders.k_T.home()")
        page.page.locator("label:has(#parameter_k_F) output").click()  # as it was is right, too
        page.page.keyboard.press("Enter")
        assert said() == ""
        assert typed("70000") == ""
        assert page("byId('error').hidden")
        before = []
        for _ in range(5):  # one step for each that was taken, and one for k_T
            if page("state.values.k_F") not in before[-1:]:
                before.append(page("state.values.k_F"))
            page.page.locator("#undo").click()
        assert before == [70000, low, high, 80000] and page("state.values") == {}

        # a fit's bound stands apart from the slider's end; the two cannot cross
        assert typed("20000", ".ends > :first-child") == ""
        assert page("byId('parameter_k_F').parentElement.querySelector('.ends').textContent").startswith("fit ≥ 20")
        assert page("bench.bounds.k_F") == [20000, high]
        assert "an upper bound above its lower one" in typed("20000", ".ends > :last-child")
        assert page("bench.bounds.k_F") == [20000, high]
        assert typed("90000", ".ends > :last-child") == ""

        # a number of the fit, and those of a recording's form, are refused where they stand
        page(DROP, ["20hz.csv", ONE.read_text()])
        page.until("model.recorded && motion && !busy")
        page.page.locator("#starts").fill("0")
        page.page.locator("#start_fit").click()
        remarks = "'aside .remark:not([hidden]), form .remark:not([hidden])'"
        refused = f"[...document.querySelectorAll({remarks})].map(r => r.textContent)"
        assert page(refused) == ["A fit has 1 to 64 starts."]
        page.page.locator("#starts").fill("2")
        assert page(refused) == [] and not page("bench.fitBegan")
        page.page.get_by_role("button", name="channels, units and masses of 20hz.csv").click()
        form = page.page.locator("#recordings form")
        form.locator("input[name=rate_hz]").fill("1,000")
        form.get_by_role("button").click()
        assert page(refused) == ["1,000 may mean 1000 or 1.000; type one of them."]
        form.locator("input[name=rate_hz]").fill("")
        assert page(refused) == []
        cell = page.page.get_by_label("body mass [kg] of 20hz.csv")
        for text, sentence in (("heavy", '"heavy" is not a number.'), ("7000", "kg; it must lie between")):
            cell.fill(text)
            cell.press("Enter")
            page.until(f"byId('recordings').querySelector('.status').textContent.includes({json.dumps(sentence)})")
            assert page("[...document.querySelectorAll('[aria-invalid]')].map(e => e.value)") == [text]
            assert page("[model.recorded, bench.rows[0].body_mass_kg]") == [True, None]  # it is as it was
        cell.press("Escape")
        assert page("[...byId('recordings').rows].map(r => r.className)") == [""] * 3 and cell.input_value() == ""
        cell.fill("70,5")
        cell.press("Enter")
        page.until("bench.rows[0].body_mass_kg === 70.5 && motion && !busy && !complaint")

        # the band is where the thumb would be
        page("openTask('model')")
        page("sliders.k_F.set(1e5), sliders.k_F.band([9e4, 1.1e5], '')")
        left, width = page(
            "(([a, b]) => [b.left + b.width / 2 - a.left, a.width])"
            "([byId('parameter_k_F'), byId('parameter_k_F').parentElement.querySelector('.band')]"
            ".map(e => e.getBoundingClientRect()))"
        )
        share = (np.log(9e4 / low) + np.log(1.1e5 / low)) / 2 / np.log(high / low)
        assert left == pytest.approx(8 + (width - 16) * share, abs=1.0)
        assert page.complaints == []


#: What the server tells of a fit of two recordings under two loads with both branches; three are on the page.
FITTED = {
    "type": "fitted", "number": 1, "script": "",
    "fit": {
        "sentence": "", "reason": "", "warnings": [], "verdict": "undecided", "fit_percent": 99,
        "branches": [
            {"name": name, "fit_percent": 99, "values": {"k_T": k}, "delay_s": 0,
             "rows": [
                 {"name": "k_T", "unit": "N/m", "key": "k_T_n_per_m", "value": k, "known": known,
                  "interval": "10\u202f000 to 10\u202f000\u202f000"},
                 {"name": "delay", "unit": "s", "key": "delay_s", "value": 0,
                  "known": "identified, model assumed exact", "interval": "0.000192 ± 0.000012"},
             ]}
            for name, k, known in (("stiff ankle", 1.2e5, "not identifiable"), ("stiff pad", 9e4, "identified"))
        ],
        "recordings": [],
    },
    "data": [
        {"file": f"{f}.csv", "frequency_hz": f, "added_mass_kg": m, "transmissibility": 1.5, "lower": 1.4,
         "upper": 1.6, "phase_lag_deg": 179.6 + f / 100}
        for m in (0, 2.3) for f in (10, 50)
    ],
    "curves": [
        {"branch": b, "added_mass_kg": m, "frequency_hz": f, "transmissibility": 1.5, "phase_lag_deg": 179.6 + f / 100}
        for b in ("stiff ankle", "stiff pad") for m in (0, 2.3) for f in (10, 20, 30, 40, 50)
    ],
    "chi_square": [
        {"branch": b, "frequency_hz": 20, "harmonic": h, "chi_square_if_model_true": chi}
        for b, chi in (("stiff ankle", 2.0), ("stiff pad", 3.0)) for h in (1, 2)
    ],
    "traces": [
        {"file": file, "time_s": [0, 0.01, 0.02], "measured": [0, y, 0], "models": {
            b: {"model": [0, y, left], "fit_percent": fit} for b, left, fit in branches
        }}
        for file, y, branches in (
            ("here/20hz.csv", 1.0, [("stiff ankle", 0.1, 99), ("stiff pad", 0.2, 98)]),
            ("25hz.csv", 2.0, [("stiff ankle", 0.1, 99), ("stiff pad", 0.2, 98)]),
        )
    ],
}  # fmt: skip


def listed(page: Watched, *files: str, shown: int, **more: Any) -> None:
    """Recordings on the page, as the server lists them."""
    rows = [
        {"id": k, "file": file, "label": file, "unread": "", "problem": "", "warnings": [], "frequency_hz": 20 + k,
         "added_mass_kg": 0, "body_mass_kg": 70, **more}
        for k, file in enumerate(files)
    ]  # fmt: skip
    page("d => receive({ ...d, type: 'data', session: bench.session })", {"rows": rows, "shown": shown, "stale": ""})


def test_plots_of_a_fit_follow_the_branch_and_say_whose_they_are(opened: Any, tmp_path: Path) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1600, 900))
        files = ["here/20hz.csv", "25hz.csv", "20hz.csv", "35hz.csv"]
        listed(page, *files, shown=1)
        page("d => receive({ ...d, type: 'fitted' })", FITTED)
        titles = "[...['trace', 'residual', 'chi'].map(k => fitted.plots[k].title), byId('matrix').caption.textContent]"
        drawn = (
            "[fitted.plots.trace.series[1].y[2], fitted.plots.trace.series[1].label,"
            "fitted.plots.residual.series[0].y[2],"
            "fitted.plots.chi.series[0].y[0], byId('matrix').querySelector('[aria-pressed=true]').textContent]"
        )
        worn = "[plots.pad.series[0].label, plots.ankle.series[0].label, plots.traces.series[1].label]"
        motions = {}
        for name, k, left, fit, chi in (("stiff ankle", 1.2e5, 0.1, 99, 2), ("stiff pad", 9e4, 0.2, 98, 3)):
            page.page.get_by_role("button", name=name).click()
            page.until(f"motion && !busy && !wanted && state.values.k_T === {k} && isDrawn()")
            assert all(title.endswith(f" · {name}") for title in page(titles))
            assert page("fitted.plots.trace.series[0].y") == [0, 2, 0]
            assert page(drawn) == [left, f"model, {fit}.0 %", -left, chi, f"{fit}.0"]
            assert page(worn) == [name, name, name]
            known = "identified" if name == "stiff pad" else "not identifiable"
            assert page("[...byId('estimates').rows].map(r => r.lastChild.textContent)")[1] == known
            assert page("byId('estimates').querySelector('.shown').textContent") == name
            assert page("byId('estimates').querySelector('tr').lastChild.title") == f"of the {name}"
            motions[name] = page("plots.ankle.series[0].y")
        assert motions["stiff ankle"] != motions["stiff pad"]
        page.page.keyboard.press("Control+z")
        assert all(title.endswith(" · stiff ankle") for title in page(titles))
        page("sliders.k_T.set(1e5), state.values.k_T = 1e5, ask()")  # of neither branch
        page.until("!busy && !wanted && isDrawn() && !plots.pad.series[0].label")
        assert page("plots.traces.series[1].label") == "malleolus"

        # the same name in another folder is another recording: none is shown, and a sentence says so
        listed(page, *files, shown=2)
        assert page("[fitted.plots.trace.series, fitted.plots.residual.series]") == [[], []]
        assert (
            page("[...byId('fit_plots').querySelectorAll('p:not([hidden])')].map(p => p.textContent)")
            == ["20hz.csv is not in this fit."] * 2
        )
        listed(page, *files, shown=0)
        assert page("fitted.plots.trace.series[0].y") == [0, 1, 0]
        assert page("byId('fit_plots').querySelectorAll('p:not([hidden])').length") == 0

        # the mirror's dashes lie over the solid curves, and in colours of their own
        inks = page("fitted.plots.size.series.map(s => [Boolean(s.dashed), s.colour])")
        assert [dashed for dashed, _ in inks] == sorted(dashed for dashed, _ in inks)
        assert not {ink for dashed, ink in inks if dashed} & {ink for dashed, ink in inks if not dashed}
        assert page.complaints == []


#: Texts of legends and titles that reach out of their plot, and columns that reach out of matrix and estimates.
CUT = """() => {
  const out = [];
  for (const plot of Plot.seen()) {
    const box = plot.box.getBoundingClientRect();
    for (const text of [plot.head.firstChild, ...plot.head.lastChild.children]) {
      const r = text.getBoundingClientRect(), low = plot.pane.getBoundingClientRect().top;
      const cut = text.clientWidth && text.scrollWidth > text.clientWidth + 1;
      if (!r.width || r.right > box.right + 1 || r.bottom > low + 1 || cut) out.push(text.textContent);
    }
    if (plot.pane.clientHeight < 60) out.push(`${plot.title}: ${plot.pane.clientHeight} px`);
  }
  for (const strip of document.querySelectorAll("#plots > div:not([hidden])"))
    if (strip.scrollWidth > strip.clientWidth) out.push(`${strip.id}: ${strip.scrollWidth} px in ${strip.clientWidth}`);
  const ends = byId("found").getBoundingClientRect().right + 1, matrix = byId("matrix");
  const cells = [...byId("estimates").querySelectorAll("th, td")];
  if (cells.length !== 12) out.push(`${cells.length} estimates`);
  for (const cell of cells)
    if (cell.getBoundingClientRect().right > ends || cell.scrollWidth > cell.clientWidth) out.push(cell.textContent);
  return [...out, ...(matrix.scrollWidth > matrix.clientWidth ? ["matrix"] : [])];
}"""


def test_no_legend_column_or_point_is_cut(opened: Any, tmp_path: Path) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1600, 900))
        listed(page, *(f"{k}.csv" for k in range(9)), shown=1, subject="16", added_mass_kg=2.3)
        page("d => receive({ ...d, type: 'fitted' })", FITTED)
        for width in (1600, 1400, 1100, 1024, 800, 420):
            page.resize(width, 900)
            for pane in ("fit", "motion"):
                page(f"tab('{pane}')")
                page.settle()
                assert page(CUT) == [], (width, pane)

        # ticks that differ are told apart, and the points at the ends are whole
        page("tab('fit')")
        assert page("distinct([179.71, 179.72, 179.73])") == ["179.71", "179.72", "179.73"]
        assert page("distinct([0, 0.5, 1])") == ["0", "0.5", "1"]
        page.settle()
        ends = page("(p => [p.valToPos(10, 'x'), p.over.clientWidth - p.valToPos(50, 'x')])(fitted.plots.size.plot)")
        assert min(ends) >= 3  # half a point

        # values under the mouse lie over the curves, and move nothing
        tall = "fitted.plots.size.pane.clientHeight"
        before = page(tall)
        page("fitted.plots.size.plot.setCursor({ left: fitted.plots.size.plot.valToPos(10, 'x'), top: 20 })")
        assert "1.5" in page("fitted.plots.size.tip.textContent") and page(tall) == before

        # of one abscissa they share a cursor; each opens to full size, by its button or its title, and closes
        page.resize(1440, 900)
        page.settle()
        page.page.locator("#fit_plots .u-over").first.hover()
        assert page("['lag', 'chi', 'trace'].map(k => fitted.plots[k].plot.cursor.left >= 0)") == [True, True, False]
        for strip, plot in (("fit", "fitted.plots.lag"), ("motion", "plots.curve")):
            page(f"tab('{strip}')")
            figure = page.page.locator(f"#{strip}_plots figure").nth(1)
            drawn = f"{plot}.plot.width"
            page.settle()
            narrow = page(drawn)
            for act in (figure.get_by_role("button", name="full size").click, figure.locator("b").dblclick):
                act()
                page.settle()
                assert page(drawn) > 900 and page("document.querySelectorAll('figure.whole').length") == 1
                page.page.keyboard.press("Escape")
                page.settle()
                assert page(drawn) == narrow
        assert page.complaints == []


def test_recording_with_warnings_is_marked_while_another_is_shown(opened: Any, tmp_path: Path) -> None:
    marks = "[...document.querySelectorAll('#recordings .mark')].map(m => [m.closest('tr').className, m.title])"
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url)
        listed(page, "a.csv", "b.csv", shown=0)
        assert page(marks) == []
        listed(page, "a.csv", "b.csv", shown=0, warnings=["b.csv: coherence 0.10.", "more"])
        assert page(marks) == [["warned", "b.csv: coherence 0.10."]] * 2
        assert page("document.querySelectorAll('#recordings .mark')[1].getClientRects().length") == 1

        # numbers in a wrong unit: no motion, a sentence, and nothing of the motion before
        rows = [line.split(",") for line in ONE.read_text().splitlines()]
        mm = "\n".join([",".join(rows[0]), *(f"{t},{float(a) * 1e3},{float(b) * 1e3}" for t, a, b, *_ in rows[1:])])
        page(DROP, ["mm.csv", mm])
        page.until("byId('state').textContent.endsWith('mm.csv · no motion to show') && !byId('error').hidden")
        assert page("byId('error').textContent").endswith("check its unit.")
        assert page("Object.values(plots).map(p => p.series.length)") == [0, 0, 0, 0]
        assert bone_share(page.canvas()) > 0.005
        assert page("[ticked(), byId('next').textContent.includes('1 in an uncertain unit')]") == [[], True]

        # what is being read, or computed, is said until it is there
        assert page("(showRecording(bench.rows[0]), byId('data_state').textContent)") == "reading mm.csv"
        page.until("byId('data_state').textContent === ''")
        # a server that answers no more, once it has answered all
        page("sends = WebSocket.prototype.send, WebSocket.prototype.send = () => {}")
        told = "byId('state').textContent.endsWith('computing the motion')"
        page.until(f"{told} || (busy || receive({{ ...model, adopt: false }}), false)")
        page("WebSocket.prototype.send = sends, busy = false, ask()")
        page.until("byId('state').textContent.endsWith('no motion to show')")
        page.page.locator("#sine").click()
        page.until("motion && !model.recorded && plots.pad.series.length")

        # a command that was started again has nothing of what is here
        page("receive({ type: 'data', session: 'another', rows: [], shown: -1, stale: '' })")
        assert page("[ticked(), bench.rows]") == [[], []]
        assert "earlier recordings, ticks and fits are gone" in page("byId('error').textContent")
        assert page.complaints == []


def test_draft_of_another_page_is_called_a_draft(opened: Any, tmp_path: Path) -> None:
    names = "[byId('model_choice').selectedOptions[0].textContent, byId('state').textContent]"
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url)
        assert not [text for text in page(names) if "draft" in text]
        page("tellServer('check', { text: editor.text.replace('1.0e5', '0.6e5') })")
        page.until("bench.draft && motion && !busy && !wanted")
        other = Watched(opened, url)  # a fresh browser
        other.until("byId('state').textContent.includes('(draft, not saved)')")
        assert other(names)[0] == "two_dof (draft, not saved)"
        other("tellServer('check', { text: editor.text })")
        other.until("!bench.draft && motion && !busy && !byId('state').textContent.includes('draft')")
        assert other(names)[0] == "two_dof"
        assert other.complaints == []


def taken(page: Watched, name: str) -> tuple[str, bytes]:
    """Name and content of what a button of "Take away" gives."""
    page("openTask('take')")
    with page.page.expect_download() as saved:
        page.page.locator("#taking").get_by_role("button", name=name, exact=True).click()
    return saved.value.suggested_filename, Path(saved.value.path()).read_bytes()


@pytest.mark.long
def test_what_is_taken_away_opens(opened: Any, tmp_path: Path) -> None:
    """Each file is read by something else than what wrote it, and holds what the page shows."""
    from PIL import Image

    with viewer("--model", "foot_arch", "--amplify", "20", folder=tmp_path) as (url, _):
        page = Watched(opened, url, (720, 480))
        name, picture = taken(page, "Picture")
        assert name == "foot.png"
        canvas = [page(f"stage.renderer.domElement.{side}") for side in ("width", "height")]
        assert list(Image.open(io.BytesIO(picture)).size) == canvas

        # plots: vectors for print with every curve that is seen, its pixels, and its numbers
        svg = ElementTree.fromstring(taken(page, "SVG")[1])
        words = "".join(svg.itertext())
        assert all(text in words for text in ("acceleration [m/s²]", "malleolus", "transmissibility", "frequency [Hz]"))
        curves = [path for path in svg.iter("{http://www.w3.org/2000/svg}path") if path.get("stroke") == "#b45f06"]
        assert len(curves) == 4 and all(path.get("d", "").count("L") >= 60 for path in curves)
        assert "NaN" not in ElementTree.tostring(svg, "unicode")
        assert Image.open(io.BytesIO(taken(page, "PNG")[1])).size == tuple(
            3 * int(svg.get(s, 0)) for s in ("width", "height")
        )
        rows = taken(page, "CSV")[1].decode().splitlines()
        mine = [row.split(",") for row in rows if row.startswith('"transmissibility"')]
        assert [float(row[4]) for row in mine[:-1]] == page("motion.feet.a.transmissibility")

        # the scene: bones and soft parts at their true size, moving as the page moves them
        name, content = taken(page, "3-D scene")
        assert name == "foot.glb"
        trimesh = pytest.importorskip("trimesh")
        scene = trimesh.load(io.BytesIO(content), file_type="glb")
        assert {"foot a tibia", "foot a skin", "foot a aponeurosis", "foot a heel_pad"} <= set(scene.geometry)
        assert scene.extents[1] == pytest.approx(0.26, abs=0.03)
        told, numbers = glb(content)
        (motion,) = told["animations"]
        seconds = numbers[motion["samplers"][0]["input"]].ravel()
        assert seconds[-1] == pytest.approx(20 * 0.05) and len(seconds) == 25
        for channel in motion["channels"]:
            at, path = channel["target"]["node"], channel["target"]["path"]
            values = numbers[motion["samplers"][channel["sampler"]]["output"]]
            if path == "weights":
                assert values.reshape(13, -1).sum(1).tolist() == [0, *[1] * 11, 0]
                continue
            assert values[0] == pytest.approx(values[-1])  # a period
            if told["nodes"][at]["name"] == "foot a tibia" and path == "translation":
                page("showAt(10 / 24)")
                assert values[10][1] == pytest.approx(page.height("tibia"), abs=1e-5)
        before = page("[time, playing]")

        # the film: what plays it finds pictures that differ, and the bar has gone from empty to full meanwhile
        page("shares = []; watched = new MutationObserver(() => shares.push(byId('busy_bar').value))")
        page("watched.observe(byId('busy_bar'), { attributes: true, attributeFilter: ['value'] })")
        name, film = taken(page, "Film")
        shares = [share for share in page("shares") if share]
        assert shares == sorted(shares) and shares[0] < 0.3 < 0.9 < shares[-1] < 1
        assert page("byId('busy_bar').hidden && byId('data_state').textContent === ''")
        assert name == "foot.webm" and film[:4] == b"\x1a\x45\xdf\xa3"  # EBML
        assert page("[time, playing]") == before
        (tmp_path / name).write_bytes(film)
        command = [ffmpeg(), "-loglevel", "error", "-i", name, "-r", "5", "-f", "rawvideo", "-pix_fmt", "gray", "-"]
        run = subprocess.run(command, cwd=tmp_path, capture_output=True, check=True)
        drawn = np.frombuffer(run.stdout, np.uint8).reshape(-1, canvas[1], canvas[0]).astype(int)
        assert np.abs(drawn - drawn[0]).mean((1, 2)).max() > 0.5
        assert page.complaints == []


def glb(content: bytes) -> tuple[dict[str, Any], list[np.ndarray]]:
    """The document of a binary glTF, and its accessors as arrays."""
    size = struct.unpack("<I", content[12:16])[0]
    told, binary = json.loads(content[20 : 20 + size]), content[28 + size :]
    numbers = []
    for accessor in told["accessors"]:
        view = told["bufferViews"][accessor["bufferView"]]
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        array = np.frombuffer(part, {5126: np.float32, 5125: np.uint32}[accessor["componentType"]])
        numbers.append(array.reshape(accessor["count"], -1) if accessor["count"] else array)
    return dict(told), numbers
