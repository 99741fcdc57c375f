"""A recording before its fit: traces, spectra, columns, and the seconds that are fitted."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from page_client import dropped
from viewer import Watched, served

import fasbody as fb
import identification as idn
from fasbody.exceptions import RecordingError
from fasbody.recording.recording import Recording
from fasbody.recording.study import BUNDLED, read_file
from identification.report import methods
from viz.bench import Bench
from viz.signals import BINS, POINTS, signals
from viz.source import Source

ONE = BUNDLED / "recordings" / "20hz_0kg.csv"


def written(folder: Path, seconds: float, rate_hz: float = 1000.0) -> Source:
    """Sines of 8 and 4 m/s^2 at 20 Hz, with one sample that sticks out."""
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    base, malleolus = (size * np.sin(2 * np.pi * 20 * time) for size in (8, 4))
    malleolus[len(time) // 3] = 77
    Recording.from_arrays(time, base, malleolus).write(folder / "made.csv")
    return Source("made.csv", str(folder))


def test_a_part_is_what_lies_between_two_times() -> None:
    whole = read_file(ONE)
    part = whole.between(1.0, 2.5)
    assert part.time_s[[0, -1]] == pytest.approx([whole.time_s[0] + 1, whole.time_s[0] + 2.5])
    assert part.part_s == (1.0, 2.5) and part.condition == whole.condition
    assert whole.between() is whole
    assert whole.between(3).part_s == (3, pytest.approx(whole.time_s[-1] - whole.time_s[0]))
    assert whole.between(-5, 100).time_s.size == whole.time_s.size
    for start, end in ((2, 1), (1, 1.0001), (50, 60)):
        with pytest.raises(RecordingError, match=r"give two times between 0 and 3\.999 s"):
            whole.between(start, end)


def test_traces_keep_what_sticks_out_and_spectra_have_the_amplitude_of_sines(tmp_path: Path) -> None:
    source = written(tmp_path, 100)
    document = signals(source)
    trace = document["traces"]["malleolus"]
    assert len(trace["m_s2"]) <= POINTS + 2 and max(trace["m_s2"]) == 77
    assert trace["time_s"][0] == 0 and trace["time_s"][-1] == pytest.approx(99.999)
    for name, size in (("base", 8), ("malleolus", 4)):
        spectrum = document["spectra"][name]
        assert len(spectrum["m_s2"]) <= BINS + 2
        top = int(np.argmax(spectrum["m_s2"]))
        assert (spectrum["frequency_hz"][top], spectrum["m_s2"][top]) == (
            pytest.approx(20, abs=0.02), pytest.approx(size, rel=0.01),
        )  # fmt: skip
    assert document["used"][1].startswith("base: 'base_m_s2'") and document["part_s"] is None


def test_the_seconds_are_fitted_reported_and_in_the_lines_of_python(bench: Bench, tmp_path: Path) -> None:
    bench.keep("20hz.csv", ONE.read_bytes())
    dropped(bench, ["20hz.csv"])
    before = bench.recordings.rows[0]["seconds"]
    with pytest.raises(RecordingError, match="0 samples lie between 5 and 4 s"):
        bench.correct({0: {"start_s": 5, "end_s": 4}})
    bench.correct({0: {"start_s": 1, "end_s": "2.5"}})
    row = bench.recordings.rows[0]
    assert (row["start_s"], row["end_s"], row["seconds"], before) == (1, 2.5, pytest.approx(1.5), pytest.approx(3.999))
    assert bench.act({"type": "signals", "number": 0})[0]["part_s"] == (1.0, 2.5)
    line = bench.recordings.sources[0].line()
    assert line == "read_file(Path('20hz.csv')).between(1.0, 2.5)"
    source = Source("20hz_0kg.csv", str(ONE.parent), body_mass_kg=70.0, start_s=1.0)
    assert source.line().startswith("with_masses(read_file(") and ").between(1.0, None), 70.0, None)" in source.line()
    result = idn.fit_foot([source.read()], fb.load("two_dof"), free=["k_T", "c_11"], starts=1)
    assert methods(result)[0].endswith("20hz_0kg.csv, 1 to 3.999 s.")
    assert result.document()["recordings"][0]["part_s"] == [1.0, pytest.approx(3.999)]
    bench.correct({0: {"start_s": None, "end_s": None}})
    assert bench.recordings.rows[0]["seconds"] == before


@pytest.mark.long
def test_seconds_are_chosen_on_the_page(opened: Any, tmp_path: Path) -> None:
    """By a zoom that both traces share, and by typing; for one recording, and for all that are ticked."""
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1440, 900))
        page.open_example()
        page.page.locator("#tab_signals").click()
        page.until("viewed.plots && viewed.plots.base.series.length && byId('data_state').textContent === ''")
        assert page("byId('signals_used').textContent").startswith("time: 'time_s' in s")
        assert page("['start_s', 'end_s'].map(id => byId(id).value)") == ["0", "3.999"]
        box = page.page.locator("#signals_plots .u-over").first.bounding_box()
        left, right, middle = (box["x"] + box["width"] * share for share in (0.25, 0.75, 0.5))
        page.page.mouse.move(left, box["y"] + 20)
        page.page.mouse.down()
        page.page.mouse.move(right, box["y"] + 20, steps=5)
        page.page.mouse.up()
        ends = page("['start_s', 'end_s'].map(id => +byId(id).value)")
        assert ends == pytest.approx([1, 3], abs=0.02)
        scales = page("['base', 'sensors'].map(name => (s => [s.min, s.max])(viewed.plots[name].plot.scales.x))")
        assert scales[0] == scales[1] == pytest.approx(ends, abs=1e-3)
        page.page.mouse.move(middle, box["y"] + 20)
        shown = page("['base', 'sensors'].map(name => viewed.plots[name].plot.cursor.idx)")
        assert shown[0] == shown[1] is not None
        page.page.get_by_role("button", name="use", exact=True).click()
        page.until("viewed.plots.base.used && byId('signals_file').textContent.includes('are fitted')")
        cells = "[...byId('recordings').rows].map(tr => tr.cells[3].textContent)"
        assert page(cells)[1:3] == [f"{ends[0]:.4g} to {ends[1]:.4g}", "3.999"]
        page.page.locator("#start_s").fill("2")
        page.page.locator("#end_s").fill("1")
        page.page.keyboard.press("Enter")
        page.until("byId('error').textContent.includes('0 samples lie between 2 and 1 s')")
        page.page.locator("#end_s").fill("3.5")
        page.page.get_by_role("button", name="in all ticked").click()
        page.until(f"{cells}.filter(text => text === '2 to 3.5').length === 12")
        page.page.get_by_role("button", name="use all").click()
        page.until(f"{cells}[1] === '3.999' && !viewed.plots.base.used")
        page("tab('recordings')")
        for count in (12, 1):
            page.page.locator("#undo_correction").click()
            page.until(f"{cells}.filter(text => text.includes(' to ')).length === {count}")
        assert page.complaints == []
