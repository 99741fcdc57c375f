"""The table of recordings: many at once, what names say, units in doubt, a study to keep; and the bar above all."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from page_client import dropped
from viewer import Watched, served

from fasbody.exceptions import FasError
from fasbody.recording.file_names import body_mass_in_name, load_in_name
from fasbody.recording.study import BUNDLED, Study
from fasbody.sentences import begun, called
from viz.archive import packed
from viz.bench import Bench
from viz.signals import signals

NAMES = ("10hz_0kg.csv", "20hz_0kg.csv", "25hz_2.3kg.csv")
FILES = {file: (BUNDLED / "recordings" / file).read_text() for file in NAMES}
DROP = """files => {
  const data = new DataTransfer();
  for (const [name, bytes] of Object.entries(files)) data.items.add(new File([new Uint8Array(bytes)], name));
  const about = { dataTransfer: data, bubbles: true, cancelable: true };
  for (const type of ["dragover", "drop"]) document.body.dispatchEvent(new DragEvent(type, about));
}"""
#: Rows of the table as a person reads them: tick, file, frequency, seconds, the three fields, status.
TABLE = """[...byId('recordings').querySelectorAll('tr[data-id]')].map(tr => [tr.querySelector('input').checked,
  ...[...tr.cells].slice(1, -1).map(td => td.querySelector('input')?.value ?? td.textContent.trim())])"""
RECTANGLE = "(r => [r.left, r.top, r.right, r.bottom])({}.getBoundingClientRect())"
SIZES = ((1440, 900), (800, 600), (390, 844))
#: Controls that are seen and smaller than 24 px, and texts below 12 px.
SMALL = """[...document.querySelectorAll('button, select, input, [role=button], summary')]
  .filter(e => e.getClientRects().length).map(e => [e, e.getBoundingClientRect()])
  .filter(([, r]) => r.width < 23.9 || r.height < 23.9)
  .map(([e, r]) => [e.id || e.className || e.textContent, r.width, r.height])"""
FINE = """[...document.querySelectorAll('body *')]
  .filter(e => e.getClientRects().length && parseFloat(getComputedStyle(e).fontSize) < 12)
  .filter(e => [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()))
  .map(e => [e.tagName, e.id, e.className])"""


def scaled(text: str, factor: float, head: str = "") -> str:
    """A recording with other numbers, and another heading."""
    first, *rows = text.splitlines()
    numbers = [[float(x) for x in row.split(",")] for row in rows]
    return "\n".join([head or first, *(f"{t!r},{a * factor!r},{b * factor!r}" for t, a, b in numbers)])


def drop(page: Watched, files: dict[str, bytes], count: int) -> None:
    page(DROP, {name: list(content) for name, content in files.items()})
    page.until(f"bench.rows.length === {count} && byId('data_state').textContent === '' || complaint")


def typed(page: Watched, label: str, text: str) -> None:
    field = page.page.get_by_label(label, exact=True)
    field.fill(text)
    field.press("Enter")


def test_table_is_filled_many_at_once_and_kept_as_a_study(opened: Any, tmp_path: Path) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1440, 900))
        assert page("byId('next').textContent").startswith("Drop recordings anywhere")
        assert page("[byId('bundled').hidden, byId('start_fit').disabled]") == [False, True]
        drop(page, {name: text.encode() for name, text in FILES.items()}, 3)
        assert page(TABLE) == [  # loads are those of the names
            [True, "10hz_0kg.csv", "10", "3.999", "0", "", "m/s^2", "sound"],
            [True, "20hz_0kg.csv", "20", "3.999", "0", "", "m/s^2", "sound"],
            [True, "25hz_2.3kg.csv", "25", "3.999", "2.3", "", "m/s^2", "sound"],
        ]
        assert "3 without body mass" in page("byId('next').textContent")

        # one number for all that are ticked; a column from a spreadsheet; and none of it where a number is none
        typed(page, "body mass of these [kg]", "72,57")
        page.until("bench.rows.every(row => row.body_mass_kg === 72.57)")
        assert "body mass" not in page("byId('next').textContent")
        paste = """([label, text]) => {
          const field = document.querySelector(`input[aria-label="${label}"]`), data = new DataTransfer();
          data.setData("text", text);
          field.dispatchEvent(new ClipboardEvent("paste", { clipboardData: data, bubbles: true, cancelable: true }));
        }"""
        page(paste, ["load [kg] of 20hz_0kg.csv", "1.5\r\nx\r\n"])
        assert page("complaint") == '"x" is not a number.'
        page(paste, ["load [kg] of 20hz_0kg.csv", "1.5\t70\n4.5\t71"])
        assert page("complaint") == "These are two columns; paste one at a time."
        page(paste, ["load [kg] of 20hz_0kg.csv", "1.5\r\n4.5 kg\r\n9\r\n"])  # more than there are rows
        page.until("bench.rows.map(row => row.added_mass_kg).join() === '0,1.5,4.5'")
        typed(page, "load [kg] of 20hz_0kg.csv", "0")
        page.until("bench.rows[1].added_mass_kg === 0")
        page.until("document.activeElement.ariaLabel === 'load [kg] of 25hz_2.3kg.csv'")  # Enter goes down
        typed(page, "load [kg] of 25hz_2.3kg.csv", "")  # what was typed is taken back: its name counts
        page.until("bench.rows[2].added_mass_kg === 2.3")
        typed(page, "load [kg] of 25hz_2.3kg.csv", "2.3")
        page.until("bench.rows[2].added_mass_kg === 2.3")

        # ticks: all off, two by Shift; only those are meant by what is typed above the table
        page.page.get_by_role("button", name="untick all").click()
        assert page("[ticked(), byId('start_fit').disabled]") == [[], True]
        page.page.get_by_label("fit 20hz_0kg.csv").click()
        page.page.get_by_label("fit 25hz_2.3kg.csv").click(modifiers=["Shift"])
        assert page("[ticked(), byId('scope').value]") == [[1, 2], "ticked"]
        typed(page, "load of these [kg]", "4.5")
        page.until("bench.rows.map(row => row.added_mass_kg).join() === '0,4.5,4.5'")
        page(paste, ["load [kg] of 20hz_0kg.csv", "0\n2.3"])
        page.until("bench.rows.map(row => row.added_mass_kg).join() === '0,0,2.3'")
        page.page.get_by_role("button", name="tick all", exact=True).click()
        assert page("ticked()") == [0, 1, 2]

        # a study folder in one file; dropped again it says everything itself
        with page.page.expect_download() as saved:
            page.page.get_by_role("button", name="save as a study").click()
        content = Path(saved.value.path()).read_bytes()
        zipfile.ZipFile(io.BytesIO(content)).extractall(tmp_path / "kept")
        study = Study.read(tmp_path / "kept" / "study")
        conditions = [(r.condition.body_mass_kg, r.condition.added_mass_kg) for r in study]
        assert conditions == [(72.57, 0), (72.57, 0), (72.57, 2.3)] and not study.check().problems
        page.page.get_by_role("button", name="clear").click()
        page.until("bench.rows.length === 0")
        drop(page, {"study.zip": content}, 3)
        assert [[row[2], *row[4:7]] for row in page(TABLE)] == [
            ["10", "0", "72.57", "m/s^2"], ["20", "0", "72.57", "m/s^2"], ["25", "2.3", "72.57", "m/s^2"]
        ]  # fmt: skip
        assert page.complaints == []


@pytest.mark.long
def test_unit_in_doubt_is_unticked_the_foot_rests_and_a_unit_mends_it(opened: Any, tmp_path: Path) -> None:
    volts = 0.1 / 9.80665
    files = {
        "mm_10hz.csv": scaled(FILES["10hz_0kg.csv"], 1e3),
        "mm_20hz.csv": scaled(FILES["20hz_0kg.csv"], 1e3),
        "volts.csv": scaled(FILES["25hz_2.3kg.csv"], volts, "time_s,base [V],malleolus [V]"),
    }
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1440, 900))
        drop(page, {name: text.encode() for name, text in files.items()}, 3)
        page.until("byId('state').textContent.endsWith('no motion to show')")
        rows = page(TABLE)
        assert [row[0] for row in rows] == [False, False, False]
        assert all("in doubt: " in row[-1] and "check its unit." in row[-1] for row in rows[:2])
        assert "2 in an uncertain unit" in page("byId('next').textContent") and "check its unit" in page(
            "byId('error').textContent"
        )
        assert page("Object.values(plots).map(p => p.series.length)") == [0, 0, 0, 0]
        assert page("[byId('tick_all').textContent, byId('tick_all').disabled]") == ["tick all", True]
        page.page.locator("#step").click()  # there is nothing to step through, and nothing that was measured is drawn
        page.page.keyboard.press(".")
        assert page("stage.feet.measured.segments.some(s => s.node.visible)") is False

        page.page.get_by_label("which recordings").select_option("in doubt")
        typed(page, "unit of these", "furlong")
        page.until("complaint.includes('furlong')")
        typed(page, "unit of these", "mm/s^2")
        page.until("ticked().length === 2 && motion && !busy && model.recorded")
        assert [row[6] for row in page(TABLE)[:2]] == ["mm/s^2"] * 2
        assert page("motion.feet.measured.ratio") == pytest.approx(1.312, abs=2e-3)  # as recorded in m/s^2
        assert page("stage.feet.measured.segments.every(s => s.node.visible)")
        assert page("byId('error').hidden")

        typed(page, "unit of volts.csv", "100 mV/g")
        page.until("bench.rows[2].frequency_hz && ticked().length === 3")
        assert page("bench.rows[2].doubt") == ""

        # numbers that only seem to be in another unit are believed at a click
        drop(page, {"weak.csv": scaled(FILES["20hz_0kg.csv"], 0.1).encode()}, 4)
        assert "is it in g?" in page(TABLE)[3][-1] and page("ticked().length") == 3
        page.page.get_by_role("button", name="the numbers of weak.csv are in m/s^2").click()
        page.until("ticked().length === 4 && !bench.rows[3].doubt")
        assert page.complaints == []


@pytest.mark.long
def test_bar_is_in_sight_and_nothing_is_small(opened: Any, tmp_path: Path) -> None:
    fit = {
        "type": "fitted", "number": 1, "script": "x", "data": [], "curves": [], "chi_square": [], "traces": [],
        "fit": {"sentence": "Both.", "reason": "Open.", "warnings": ["A note."] * 20, "verdict": "undecided",
                "fit_percent": 98.7, "recordings": [], "branches": [
                    {"name": name, "fit_percent": 98, "values": {}, "delay_s": 0, "rows": []} for name in ("a", "b")]},
    }  # fmt: skip
    with served("--model", "foot_arch", folder=tmp_path) as url:
        page = Watched(opened, url, SIZES[0])
        for step in ("nothing", "recordings", "fit"):
            if step == "recordings":
                page.page.locator("#bundled").click()
                page.until("bench.rows.length === 12 && !busy && motion")
                assert "takes a minute" in page("byId('next').textContent")
            if step == "fit":
                page("d => receive({ ...d, type: 'fitted' })", fit)
                assert page("byId('next').textContent") == "Fit 98.7 %; the branch is undecided."
                page("receive({ ...bench, type: 'data', shown: 0, stale: 'Out of date.' })")
                assert page("byId('next').textContent").endswith("Out of date; fit again.")
            for size in SIZES:
                page.resize(*size)
                page("scrollTo(0, 1e5), document.querySelector('aside').scrollTo(0, 1e5)")
                page.settle()
                for name in ("next", "start_fit", "start_rivals"):
                    left, top, right, bottom = page(RECTANGLE.format(name))
                    assert 0 <= left < right <= size[0] and 0 <= top < bottom <= size[1], (step, size, name)
                    x, y = (left + right) / 2, (top + bottom) / 2
                    assert page(f"document.elementFromPoint({x}, {y}).closest('#bar') !== null"), (step, size, name)
                assert page("document.documentElement.scrollWidth") <= size[0]
                assert page(SMALL) == [] and page(FINE) == [], (step, size)
                if step == "recordings":
                    page("scrollTo(0, 0), tab('recordings')")
                    page.settle()
                    top, bottom = page("(r => [r.top, r.bottom])(byId('recordings').getBoundingClientRect())")
                    seen = page("(r => r.bottom)(byId('recordings_plots').getBoundingClientRect())")
                    assert min(bottom, seen, size[1]) - top > 50, size  # more than its heading
        page.page.locator("#two_masses").click()
        page.until("model.name === 'two_dof' && motion && !busy")
        assert page("byId('two_masses').hidden") and page.complaints == []


@pytest.mark.parametrize(
    ("name", "body", "load"),
    [("20hz_2.3kg.csv", None, 2.3), ("20hz_25kg.csv", None, 25), ("anna_26kg.csv", 26, None),
     ("p61,5 kg.csv", 61.5, None),     ("61kg_2.3kg.csv", 61.0, 2.3), ("61kg_62kg_1kg_2kg.csv", None, None),
     ("20hz.csv", None, None)],
)  # fmt: skip
def test_masses_that_a_name_states(bench: Bench, name: str, body: float | None, load: float | None) -> None:
    assert (body_mass_in_name(name), load_in_name(name)) == (body, load)
    bench.keep(name, FILES["20hz_0kg.csv"].encode())
    dropped(bench, [name])
    source = bench.recordings.sources[0]
    assert (source.body_mass_kg, source.added_mass_kg) == (body, load)


def test_a_correction_that_cannot_be_meant_changes_none(bench: Bench) -> None:
    for name, text in FILES.items():
        bench.keep(name, text.encode())
    dropped(bench, list(FILES))
    before = bench.document()["rows"]
    with pytest.raises(FasError, match="body mass is 7000 kg"):
        bench.correct({0: {"body_mass_kg": 60}, 1: {"body_mass_kg": 7000}})
    for changes in (None, [], {}, [[0]], [["0", {}]], [[0, []]], [[0, {}], 1]):
        with pytest.raises(FasError, match="corrections cannot be read"):
            bench.act({"type": "correct", "changes": changes})
    assert bench.document()["rows"] == before
    with pytest.raises(FasError, match=r"10hz_0kg\.csv and 2 more has no body mass"):
        bench.keep_study([0, 1, 2])


def test_all_are_removed_while_others_are_still_to_be_read(bench: Bench) -> None:
    bench.act({"type": "bundled"})
    assert bench.unread
    bench.act({"type": "remove", "numbers": list(bench.recordings.rows)})
    assert (bench.read_next()[0]["rows"], bench.current) == ([], -1)


def test_unit_of_a_study_is_corrected_and_its_masses_stay(bench: Bench) -> None:
    dropped(bench)
    row = bench.recordings.rows[0]
    bench.correct({0: {"unit": "mm/s^2"}})
    assert bench.recordings.rows[0]["body_mass_kg"] == row["body_mass_kg"] == 72.57
    first = bench.recordings.sources[0].read().base_m_s2.std()
    bench.correct({0: {"unit": ""}})
    assert bench.recordings.sources[0].read().base_m_s2.std() == pytest.approx(1e3 * first)


@pytest.mark.parametrize(
    ("heads", "volts"),
    [
        (("base_mV", "malleolus_mV"), 1e-3), (("base [mV]", "malleolus [mV]"), 1e-3),
        (("base_uV", "malleolus_uV"), 1e-6), (("base_V", "malleolus_V"), 1.0), (("base_m_s2", "malleolus_m_s2"), 1.0),
    ],
)  # fmt: skip
def test_sensitivity_is_of_the_voltage_that_a_heading_names(bench: Bench, heads: tuple[str, str], volts: float) -> None:
    bench.keep("right.csv", FILES["20hz_0kg.csv"].encode())
    text = scaled(FILES["20hz_0kg.csv"], 0.1 / 9.80665 / volts, ",".join(("time_s", *heads)))
    bench.keep("volts.csv", text.encode())
    dropped(bench, ["right.csv", "volts.csv"])
    bench.correct({1: {"unit": "100 mV/g"}})
    right, read = (bench.recordings.sources[number].read() for number in (0, 1))
    assert read.base_m_s2.std() == pytest.approx(right.base_m_s2.std(), rel=1e-6)
    assert bench.recordings.rows[1]["doubt"] == ""
    for nothing in ("0 mV/g", "1e-400 mV/g", "1e999 mV/g", "0"):
        with pytest.raises(FasError, match="sensitivity"):
            bench.correct({1: {"unit": nothing}})


def test_typed_unit_is_believed_of_a_weak_motion_and_not_of_an_impossible_one(bench: Bench) -> None:
    for name, factor in (("weak.csv", 0.1), ("huge.csv", 1e3)):
        bench.keep(name, scaled(FILES["20hz_0kg.csv"], factor).encode())
    dropped(bench, ["weak.csv", "huge.csv"])
    assert all(bench.recordings.rows[number]["doubt"] for number in (0, 1))
    bench.correct({number: {"unit": "m/s^2"} for number in (0, 1)})
    rows = bench.recordings.rows
    assert rows[0]["doubt"] == "" and "check its unit" in rows[1]["doubt"]


def test_seconds_lie_inside_the_recording_and_what_is_refused_is_not_fitted(bench: Bench) -> None:
    dropped(bench)
    source, row = bench.recordings.sources, bench.recordings.rows
    pairs = {(-1, 99): (None, None), (0.5, 99): (0.5, None), (-1, 0.5): (None, 0.5), (0, 1): (None, 1)}
    for given, kept in pairs.items():
        bench.correct({0: dict(zip(("start_s", "end_s"), given, strict=True))})
        assert (source[0].start_s, source[0].end_s) == kept == (row[0]["start_s"], row[0]["end_s"])
    assert not signals(source[0])["refused"]
    with pytest.raises(FasError, match="give two times between 0 and"):
        bench.correct({0: {"start_s": 50, "end_s": 99}})
    for end, refused in ((None, False), (0.32, True)):
        bench.correct({0: {"start_s": 0.3, "end_s": end}})
        bench.use(0)
        seen = bench.show.answer(bench.show.settings)["feet"]["measured"]
        assert (seen["fit_percent"] is None) == bool(row[0]["problem"]) == refused
        assert signals(source[0])["refused"] == refused


def test_sentences_of_the_table_name_its_own_cells(bench: Bench) -> None:
    texts = {
        "empty.csv": "", "weak.csv": scaled(FILES["20hz_0kg.csv"], 0.1),
        "volts.csv": scaled(FILES["20hz_0kg.csv"], 1, "time_s,base [V],malleolus [V]"),
    }  # fmt: skip
    for name, text in texts.items():
        bench.keep(name, text.encode())
    dropped(bench, list(texts))
    empty, weak, volts = (bench.recordings.rows[number] for number in range(3))
    assert empty["unread"].startswith("is empty") and "empty.csv" not in empty["unread"]
    assert weak["doubt"].endswith("is it in g? Then type g as its unit in the table.") and weak["believed"]
    assert volts["unread"] == "base is in V; give its sensitivity as its unit in the table, “100 mV/g”."
    with pytest.raises(FasError) as refused:
        bench.keep("a.exe", b"")
    assert str(refused.value).count(".zip") == 1
    assert begun(called("compare_rivals")).on_page == "The button Rivals"
    assert begun(called("compare_rivals")) == "fasbody rivals"


def test_kept_study_holds_what_is_known_of_its_channels(bench: Bench, tmp_path: Path) -> None:
    dropped(bench)
    bench.correct({0: {"body_mass_kg": 60}})
    assert bench.keep_study(list(range(12)))[0]["type"] == "kept"
    zipfile.ZipFile(bench.folder / ".study.zip").extractall(tmp_path)
    kept, given = Study.read(tmp_path / "study"), Study.read(BUNDLED)
    assert [r.condition.body_mass_kg for r in kept] == [60] + [72.57] * 11
    for a, b in zip(kept, given, strict=True):
        assert a.origin == "synthetic" and a.condition.added_mass_kg == b.condition.added_mass_kg
        assert a.calibration["malleolus"].delay_std_s == b.calibration["malleolus"].delay_std_s == 2e-4
        assert a.malleolus_m_s2 == pytest.approx(b.malleolus_m_s2, abs=1e-6)


def test_zip_files_are_opened_within_limits(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    good = {"a/20hz_0kg.csv": FILES["20hz_0kg.csv"].encode(), "a/notes.pdf": b"x", "a/.hidden.csv": b"x"}
    assert bench.keep("some.zip", packed(good)) == ["some/a/20hz_0kg.csv"]
    (listed, *_) = dropped(bench, ["some/a/20hz_0kg.csv"])
    assert listed["rows"][0]["frequency_hz"] == pytest.approx(20, abs=1e-3)
    for name in ("../../evil.csv", "b/../../../evil.csv", "b/c/d/e/f.csv", "b\\..\\evil.csv"):
        with pytest.raises(FasError, match="is no name for a file"):
            bench.keep("some.zip", packed({name: b"x"}))
    assert not list(bench.folder.rglob("evil*")) and not (bench.folder.parent / "evil.csv").exists()
    assert bench.keep("some.zip", packed({"/etc/passwd.csv": b"x"})) == [
        "some/etc/passwd.csv"
    ]  # in the session's folder
    with pytest.raises(FasError, match="is no zip file"):
        bench.keep("some.zip", b"PK\x03\x04 and no more")
    broken = packed(good).replace(FILES["20hz_0kg.csv"].encode()[:10], b"0123456789")
    broken = broken[:60] + bytes(40) + broken[100:]
    with pytest.raises(FasError, match="cannot be unpacked"):
        bench.keep("some.zip", broken)
    bomb = packed({"zeros.csv": bytes(2_000_000)})  # a few kB that unfold to a thousandfold
    monkeypatch.setattr("viz.uploads.LARGEST", 1_000_000)
    with pytest.raises(FasError, match="holds more than a session does"):
        bench.keep("bomb.zip", bomb)
    monkeypatch.setattr("viz.uploads.LARGEST", 64_000_000)
    liar = bomb.replace((2_000_000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    with pytest.raises(FasError, match="cannot be unpacked"):
        bench.keep("liar.zip", liar)
    monkeypatch.setattr("viz.uploads.FILES", 2)
    with pytest.raises(FasError, match="holds more than a session does"):
        bench.keep("many.zip", packed({f"{k}.csv": b"" for k in range(3)}))


def test_no_odds_beside_an_open_verdict(bench: Bench) -> None:
    from viz.fitted import fitted

    side = {"k_T_n_per_m": {"value": 1e5, "identifiability": ""}}
    document = {
        "branches": [{"name": name, "parameters": side} for name in ("stiff ankle", "stiff pad")],
        "verdict": "undecided", "verdict_reason": "No branch is decided.", "log_likelihood_ratio": 80.0,
    }  # fmt: skip
    assert "million" not in json.dumps(fitted(document, bench.show.feet["a"].parameters))
