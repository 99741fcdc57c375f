"""The column beside the foot: four tasks, what is always in sight, light and dark, and sizes that a finger hits."""

from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from viewer import MOVES, Watched, served

TASKS = ("data", "fit", "model", "take")
#: Controls below 24 px and texts below 12 px, of what is seen.
SMALL = """() => {
  const seen = e => e.checkVisibility({ visibilityProperty: true }) && e.getBoundingClientRect().width;
  const pressed = [...document.querySelectorAll("button, select, input, summary, [role=button]")].filter(seen);
  const low = pressed.filter(e => e.getBoundingClientRect().height < 23.5).map(e => e.id || e.textContent);
  const words = [...document.querySelectorAll("body *")].filter(seen).filter(e => [...e.childNodes].some(
    n => n.nodeType === 3 && n.textContent.trim()));
  return [...low, ...words.filter(e => parseFloat(getComputedStyle(e).fontSize) < 12).map(e => e.textContent)];
}"""
#: Whether an element lies in the window, and nothing over it.
IN_SIGHT = """id => (r => r.width > 0 && r.top >= 0 && r.bottom <= innerHeight && r.right <= innerWidth
  && byId(id).contains(document.elementFromPoint(r.left + r.width / 2, r.top + r.height / 2)))(
  byId(id).getBoundingClientRect())"""
#: Rows of the table of recordings that are seen whole.
ROWS = """() => {
  const box = byId("recordings_plots").getBoundingClientRect(), low = Math.min(innerHeight, box.bottom) + 1;
  const rows = [...byId("recordings").querySelectorAll("tr[data-id]")];
  return rows.filter(tr => tr.getBoundingClientRect().bottom <= low).length;
}"""
#: Share of the window that the foot has.
SHARE = "(r => r.width * r.height / innerWidth / innerHeight)(byId('pane').getBoundingClientRect())"
#: Lightness of a colour from 0 to 1: of the page, and of what is written on it.
LIGHTNESS = """() => {
  const ink = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const of = colour => {
    ink.fillStyle = colour;
    ink.fillRect(0, 0, 1, 1);
    return Math.max(...ink.getImageData(0, 0, 1, 1).data.slice(0, 3)) / 255;
  };
  return [getComputedStyle(document.body).backgroundColor, getComputedStyle(byId("next")).color].map(of);
}"""


@pytest.mark.long
def test_what_to_do_next_and_the_fit_are_in_sight_in_every_task(opened: Any, tmp_path: Any) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1440, 900))
        assert page("byId('next').textContent").startswith("Drop recordings")
        assert page(IN_SIGHT, "bundled") and page("byId('start_fit').disabled")
        page.open_example()  # one click away
        assert page("[task, document.querySelectorAll('#tasks [aria-pressed=true]').length]") == ["data", 1]
        for width, height in ((1440, 900), (800, 600), (390, 844)):
            page.resize(width, height)
            for task in TASKS:
                page.page.locator(f"#tasks [data-name={task}]").click()
                assert all(page(IN_SIGHT, name) for name in ("next", "start_fit")), (width, task)
                shown = page("[...document.querySelectorAll('section[data-task]')].filter(s => s.checkVisibility())")
                assert len(shown) >= 1 and page(SMALL) == [], (width, task)
                page("scrollTo(0, 0)")
        page.resize(1440, 900)
        page("openTask('data'), tab('motion')")
        page.settle()  # the table has the column beside the foot
        assert page(ROWS) == 12 and page("plots.curve.pane.clientHeight") > 100
        page.resize(800, 600)
        for strip in ("motion", "signals", "recordings"):
            page(f"tab('{strip}')")
            page.settle()
            assert page("byId('pane').clientHeight") >= 300  # the foot has half of what is beside the column
            assert page("document.documentElement.scrollWidth") <= 800
            if strip == "motion":
                assert page("plots.traces.pane.clientHeight") > 60
            if strip == "signals":
                page.until("viewed.plots && viewed.plots.base.series.length")
                assert page(IN_SIGHT.replace("byId(id)", "viewed.plots.base.pane"), "")
        assert page(ROWS) >= 3
        status = "[...document.querySelectorAll('#recordings td.status')]"
        assert page(f"{status}.filter(e => e.scrollWidth > e.clientWidth).length") == 0
        assert page.complaints == []


@pytest.mark.long
def test_the_focus_goes_on_and_a_reload_comes_back(opened: Any, tmp_path: Any) -> None:
    with served("--model", "foot_arch", folder=tmp_path) as url:
        page = Watched(opened, url, (800, 600))
        assert page(SHARE) >= 0.5  # in a low window the plots are folded away at first
        page.page.locator("#tab_motion").click()
        page.settle()
        assert 0.3 < page(SHARE) < 0.4 and page("Plot.seen().length") == 4
        for name, then, focus in (
            ("bundled", "bench.rows.length === 12 && !bench.unread && motion && !busy", "start_fit"),
            ("two_masses", "model.name === 'two_dof' && motion && !busy", "start_fit"),
            ("start_fit", "bench.running", "stop_fit"),
        ):
            page("byId('starts').value = 2")
            page.page.locator(f"#{name}").focus()
            page.page.keyboard.press("Enter")
            page.until(then)
            assert page("document.activeElement.id") == focus
        page.until("bench.found && !bench.running && motion && !busy")
        assert page("document.activeElement.id") == "start_fit"

        page("openTask('take'), tab('recordings')")  # no plot is seen, and none is written
        for kind in ("SVG", "PNG", "CSV"):
            page.page.get_by_role("button", name=kind, exact=True).click()
            page.until("byId('data_state').textContent.startsWith('No plot is seen')")
            page("busyWith('')")
        for task, strip in (("model", "motion"), ("fit", "fit")):
            page(f"openTask('{task}'), tab('{strip}'), showBranch(1)")
            page.page.reload()
            page.until(f"{MOVES} && bench.found && bench.rows.length === 12")
            assert page("[task, strip, bench.branch]") == [task, strip, 1]

        page("openTask('data')")
        page.page.locator("#clear").click()
        page.until("!bench.rows.length")
        assert page("byId('next').textContent").endswith("Drop recordings anywhere on this page to fit again.")
        page("openTask('model')")
        assert page("byId('showing').textContent").count("No graphics card draws this page") == 1
        assert page.complaints == []


@pytest.mark.long
def test_light_and_dark_as_the_system_has_it_or_as_the_button_says(opened: Any, tmp_path: Any) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1000, 700))
        for scheme, is_light in (("light", True), ("dark", False)):
            page.page.emulate_media(color_scheme=scheme)
            page.settle()
            ground, ink = page(LIGHTNESS)
            assert (ground > 0.8 and ink < 0.4) if is_light else (ground < 0.2 and ink > 0.8)
        stroke = "plots.curve.plot.series[1].stroke()"
        before = page(stroke)
        page.page.get_by_role("button", name="Light page").click()
        assert page(LIGHTNESS)[0] > 0.8 and page(stroke) != before
        page.page.reload()
        page.until("window.modules && window.fasbody && stats.motions > 0")
        assert page(LIGHTNESS)[0] > 0.8  # kept by this browser
        page.page.get_by_role("button", name="Dark page").click()
        assert page(LIGHTNESS)[0] < 0.2
        assert page.complaints == []


def test_a_text_beyond_what_the_page_takes_is_said_at_once(opened: Any, tmp_path: Any) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1000, 700))
        page("openEditor()")
        page("editor.view.dispatch({ changes: { from: 0, insert: `<!--${'x'.repeat(1.2e6)}-->` } })")
        page.until("byId('editor_state').textContent.includes('1.2 MB are too large for this editor')")
        assert page("isConnected()") and page.complaints == []


def test_the_token_leaves_the_address_bar_and_a_reload_needs_none(opened: Any, tmp_path: Any) -> None:
    """A page of an ended session stops asking, and says where to go."""
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1000, 700))
        assert page("location.search") == "?quality=low" and page("document.cookie") == ""
        page.page.reload()
        page.until("window.modules && window.fasbody && stats.motions > 0")
        assert page.complaints == []
        page.page.context.clear_cookies()
        page("disconnect()")
        page.until("byId('state').textContent === 'connection lost' && !byId('error').hidden")
        assert page("byId('error').textContent").startswith("Open the address that the command printed")
        page.page.reload()
        assert page.page.inner_text("body").startswith("Open the address that the command printed")
