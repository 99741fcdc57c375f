"""All fits of a session: shown again, deleted, two side by side; and corrections of recordings taken back."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from page_client import dropped
from viewer import Watched, served

from fasbody.exceptions import SettingError
from fasbody.recording.study import BUNDLED
from viz.bench import Bench
from viz.history import _difference


def row(value: float, lower: float | None = None, upper: float | None = None, key: str = "k_T_n_per_m") -> Any:
    limits = {} if lower is None else {"lower": lower, "upper": upper}
    return {"key": key, "name": key.partition("_n_")[0], "unit": "N/m", "value": value, **limits}


def result(*rows: Any, name: str = "stiff ankle") -> dict[str, Any]:
    fit = {"fit_percent": 98.76, "verdict": "decided", "branches": [{"name": name, "rows": list(rows), "values": {}}]}
    return {"fit": fit, "data": [], "curves": []}


def test_interval_of_a_difference_covers_as_often_as_it_says() -> None:
    """Of two estimates with normal errors, and of two with lopsided intervals, such as of logarithms."""
    rng, hits, n = np.random.default_rng(1), np.zeros(2), 2000
    for _ in range(n):
        a, b = 100 + 3 * rng.normal(), 90 + 4 * rng.normal()
        text = _difference([row(a, a - 5.88, a + 5.88), row(b, b - 7.84, b + 7.84)], True)
        middle, half = (float(part) for part in text.split(" ± "))
        assert half == pytest.approx(9.8)
        hits[0] += abs(middle - 10) <= half
        a, b = 100 * np.exp(0.3 * rng.normal()), 50 * np.exp(0.3 * rng.normal())
        pair = [row(x, x * np.exp(-0.588), x * np.exp(0.588)) for x in (a, b)]
        text = _difference(pair, True).replace("\u202f", "")
        one, other = (float(part) for part in text.replace(" ± ", " to ").split(" to "))
        hits[1] += one <= 50 <= other if " to " in text else abs(one - 50) <= other
    assert np.all(np.abs(hits / n - 0.95) < 0.02)


@pytest.mark.parametrize("independent", [True, False])
def test_of_what_is_withheld_there_is_no_difference_either(independent: bool) -> None:
    withheld, given = {"value": 3.0, "interval": "–"}, row(2.0, 1.0, 3.0)
    assert _difference([withheld, given], independent) == _difference([given, None], independent) == "–"
    assert _difference([given, row(3.0)], independent) == "-1"


def test_two_fits_side_by_side(bench: Bench) -> None:
    """The same recording in both leaves no interval of the difference, whatever its file is called."""
    dropped(bench)
    bench.keep("copy.csv", (BUNDLED / "recordings" / "20hz_0kg.csv").read_bytes())
    dropped(bench, ["copy.csv"])
    copy = next(n for n, source in bench.recordings.sources.items() if source.file == "copy.csv")
    twin = next(n for n, source in bench.recordings.sources.items() if source.file.endswith("20hz_0kg.csv"))
    for numbers in ([twin], [copy], [twin + 1]):
        job = replace(bench._job(numbers, {}), settings={"starts": 4, "free": ["k_T"]})
        bench.history.add(job, result(row(1.2e5 + 1e4 * numbers[0], 1e5, 2.6e5), row(9e4, key="k_F_n_per_m")))
    alike, apart = (bench.act({"type": "compare_fits", "numbers": pair})[0] for pair in ([1, 2], [1, 3]))
    assert (alike["independent"], apart["independent"]) == (False, True)
    assert alike["columns"] == ["quantity", "fit 1, stiff ankle", "fit 2, stiff ankle", "difference"]
    assert ["settings", "4 starts, free: k_T", "4 starts, free: k_T", ""] in apart["rows"]
    assert ["fit", "98.8 %", "98.8 %", ""] in apart["rows"]
    assert apart["rows"][-2][0] == "k_T [N/m]" and " ± " in apart["rows"][-2][3] and " ± " not in alike["rows"][-2][3]
    for numbers, sentence in (([1], "choose two"), ([1, 1], "choose two"), ([1, 9], "no longer kept"), ("x", "choose")):
        with pytest.raises(SettingError, match=sentence):
            bench.act({"type": "compare_fits", "numbers": numbers})
    bench.act({"type": "show_fit", "number": 1})
    listed, now, _ = bench.act({"type": "remove_fit", "number": 1})
    assert [fit["number"] for fit in listed["fits"]] == [2, 3] and now["number"] == 3
    assert bench.act({"type": "remove_fit", "number": 2}) == [bench.history.document()]  # another one is shown
    assert bench.act({"type": "remove_fit", "number": 3})[1]["fit"] == {}
    with pytest.raises(SettingError, match="no longer kept"):
        bench.act({"type": "show_fit", "number": 3})


def test_corrections_are_taken_back_and_made_again(bench: Bench) -> None:
    dropped(bench)
    first, masses = bench.recordings.rows[0]["body_mass_kg"], []
    for change in ({0: {"body_mass_kg": 60}}, {0: {"body_mass_kg": 61}, 1: {"unit": "g"}}):
        bench.correct(change)
    for again in (False, False, True, True, False):
        bench.act({"type": "undo", "again": again})
        masses.append(bench.recordings.rows[0]["body_mass_kg"])
    assert masses == [60, first, 60, 61, 60] and bench.document()["undo"] == (1, 1)
    assert bench.recordings.sources[1].unit == ""
    bench.remove([0])
    bench.act({"type": "undo", "again": True})  # of what is still listed
    assert bench.recordings.sources[1].unit == "g"
    with pytest.raises(SettingError, match="nothing to redo"):
        bench.act({"type": "undo", "again": True})


@pytest.mark.long
def test_fits_are_listed_compared_and_kept_in_the_session(opened: Any, tmp_path: Any) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url, (1440, 900))
        page.open_example()
        page("byId('starts').value = 2")
        for kept in ("row.added_mass_kg === 0", "row.added_mass_kg > 0"):
            page(f"bench.chosen = new Set(bench.rows.filter(row => {kept}).map(row => row.id))")
            count = page("bench.history.length")
            page.page.locator("#start_fit").click()
            page.until(f"bench.history.length === {count + 1} && !bench.running && bench.fitNumber === {count + 1}")
        items = page.page.locator("#fits li")
        assert items.count() == 2 and "3 recordings" in items.nth(0).inner_text()
        items.nth(1).get_by_role("button", name="compare").click()
        page.until("fitted.pair && !byId('pair_plots').hidden")
        head = page("[...byId('pair').rows[0].cells].map(cell => cell.textContent)")
        assert head[1].startswith("fit 2, ") and head[3] == "difference, 95 %"
        names = page("fitted.pair.size.series.filter(s => s.label).map(s => s.label)")
        assert names == ["fit 2, 2.3 kg", "fit 1 (dashed)"]
        assert page("[...byId('pair').rows].some(tr => tr.cells[0].textContent.startsWith('k_T'))")
        items.nth(1).get_by_role("button", name="fit 1,").click()
        page.until("bench.fitNumber === 1 && byId('fits').children[1].querySelector('[aria-pressed=true]')")
        values = page("state.values.k_T")
        page("sliders.k_T.set(2e5), remember('k_T'), setValues({ k_T: 2e5 }), ask()")
        for key, value in (("Control+z", values), ("Control+y", 2e5)):
            page.page.keyboard.press(key)
            assert page("state.values.k_T") == pytest.approx(value)
        page("openTask('take')")
        with page.page.expect_download() as download:
            page.page.locator("#save_session").click()
        content = download.value.path().read_bytes()
        page("openTask('fit')")
        items.nth(0).get_by_role("button", name="delete").click()
        page.until("bench.history.length === 1 && byId('tab_pair').hidden")
        items.nth(0).get_by_role("button", name="delete").click()
        page.until("bench.history.length === 0 && !byId('no_fit').hidden && byId('history').hidden")
        assert page.complaints == []
        page.page.locator("#session_file").set_input_files(
            {"name": "session.zip", "mimeType": "application/zip", "buffer": content}
        )
        page.until("bench.history.length === 2 && bench.fit && byId('data_state').textContent === ''")
        assert page("bench.history.find(fit => fit.number === bench.fitNumber).recordings") == "9"
        assert page.complaints == []
