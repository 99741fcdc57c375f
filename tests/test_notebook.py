"""The notebook of the front page, cell by cell, as someone without the command line meets the project."""

import json
import re
import urllib.request
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

import fasbody as fb
import identification as idn
import viz
from fasbody.exceptions import SettingError
from fasbody.recording.study import BUNDLED


def test_a_study_says_what_is_wrong_with_it() -> None:
    study = fb.Study.read(BUNDLED)
    assert repr(study) == repr(fb.bundled()) == "synthetic subject 16: 12 synthetic recordings"
    three = fb.Study(study.name, study.origin, "", study.recordings[:2])
    table = three.check()
    assert "2 of 2 recordings are sound" in repr(table)
    assert table.to_dataframe()["frequency_hz"].to_list() == pytest.approx([10, 15], rel=1e-3)
    with pytest.raises(SettingError, match=r"a Checked has no plot; its numbers are in to_dataframe\(\)\."):
        table.plot()
    dead = fb.Recording.from_arrays(np.arange(2000) / 1e3, np.zeros(2000), np.zeros(2000), name="dead.csv")
    broken = fb.Study("mine", "measured", "", (study.recordings[0], dead)).check()
    assert broken.problems == ("dead.csv: base_m_s2 is dead (it varies by 0 m/s^2); check the cable and the units.",)
    lines = repr(broken).splitlines()
    assert lines[0] == "mine: 1 of 2 recordings are sound" and lines[2].startswith("dead.csv")


def test_a_fit_is_a_screen_and_a_sentence(fitted: idn.FitResult) -> None:
    text = repr(fitted)
    assert len(text.splitlines()) < 36 and max(map(len, text.splitlines())) <= 130  # two mirror feet, side by side
    assert fitted["k_T"] is fitted["k_T_n_per_m"] is fitted.best["k_T"]
    assert fitted["k_T"].interval() in text and fitted.mirror["k_T"].interval() in text
    assert {fitted.best.name, fitted.mirror.name} == {"stiff ankle", "stiff pad"}
    assert fitted["k_F"].interval() in fitted._repr_html_()
    with pytest.raises(SettingError, match="unknown estimate 'k_t', did you mean 'k_T'"):
        fitted["k_t"]


@pytest.mark.usefixtures("undrawn")
def test_a_fit_is_a_table_and_files(fitted: idn.FitResult, tmp_path: Path) -> None:
    frame = fitted.to_dataframe().set_index(["branch", "parameter"])
    assert frame.loc[(fitted.mirror.name, "k_F_n_per_m"), "value"] == fitted.mirror["k_F"].value
    files = {file.name: file for file in fitted.write(tmp_path / "results")}
    assert set(files) > {"result.json", "parameters.csv", "report.html", "transmissibility.png", "energies.csv"}
    written = pd.read_csv(files["parameters.csv"]).set_index(["branch", "parameter"])
    assert written["value"].to_numpy() == pytest.approx(frame["value"].to_numpy(), rel=1e-7)
    assert json.loads(files["result.json"].read_text())["parameters"]["k_T_n_per_m"]["value"] == fitted["k_T"].value


@pytest.mark.long
def test_every_plot_of_a_fit_can_be_drawn(fitted: idn.FitResult) -> None:
    for kind in fitted.plots:
        assert fitted.plot(kind)._repr_png_().startswith(b"\x89PNG"), kind
    upper, lower = fitted.plot("transmissibility").axes[:2]
    drawn = [dict(zip(*line.get_data(), strict=True)) for line in upper.lines]
    data, model = next(d for d in drawn if len(d) == 3), next(d for d in drawn if len(d) > 80)
    measured = fb.Transmissibility.of(fb.bundled().under(0.0)).to_dataframe().set_index("frequency_hz")
    for f, T in data.items():
        assert measured.loc[round(f), "transmissibility"] == pytest.approx(T, rel=1e-4)  # by segments
        assert model[f] == pytest.approx(T, rel=2.5 * fitted.departures.repeatability)
    assert (lower.lines[0].get_ydata() > 0).all()  # the malleolus lags


def test_a_fit_moves_the_foot_that_is_simulated(fitted: idn.FitResult, foot: fb.Foot) -> None:
    moved = foot.with_values(fitted.values())
    assert moved.values()["k_T"] == pytest.approx(fitted["k_T"].value)
    motion = fb.simulate(moved, fb.sine(20, 1))
    last = motion.to_dataframe()["time_s"] > 0.8
    peak = np.ptp(motion.to_dataframe()["malleolus_m_s2"][last]) / np.ptp(motion.to_dataframe()["base_m_s2"][last])
    table = fb.Transmissibility.of(fb.bundled().under(0.0)).to_dataframe().set_index("frequency_hz")
    assert peak == pytest.approx(table.loc[20.0, "transmissibility"], rel=0.1)
    assert "malleolus peak" in repr(motion)
    assert motion.plot().axes[1].get_ylabel() == "malleolus [m/s²]"


def test_masses_move_with_the_constants_that_scale_with_them(fitted: idn.FitResult, foot: fb.Foot) -> None:
    moved = foot.with_values(fitted).values()
    masses = {mass.name: mass.value for mass in fitted.departures.masses}
    assert set(masses) == {"m_S", "m_F"} and masses == {name: moved[name] for name in masses}


def test_the_viewer_is_beside_the_notebook(fitted: idn.FitResult, foot: fb.Foot, tmp_path: Path) -> None:
    viewer = viz.show(foot, result=fitted, browser=False, wait=False)
    try:
        assert viewer.show.settings.values["k_T"] == fitted.values()["k_T_n_per_m"]
        page = urllib.request.urlopen(viewer.url, timeout=300).read().decode()
        assert "<canvas" in page or "meshcat" in page
        assert re.fullmatch(r"two_dof at http://127\.0\.0\.1:\d+/\?token=[\w-]{32}", repr(viewer))
    finally:
        viewer.close()
    assert repr(viewer).endswith("(closed)")
    file = viz.export(foot, tmp_path / "foot.html", result=fitted)
    assert f"{fitted.values()['k_T_n_per_m']:.6f}"[:6] in file.read_text()


def test_numbers_are_grouped_and_free_of_exponents() -> None:
    """Groups of three from five digits on, as the page in the browser writes them."""
    from fasbody.presentation import grouped, readable

    shown = [readable(x, n) for x, n in ((131187.4, 6), (10432.0, 3), (9700.0, 4), (1e7, 3), (0.00019972, 3), (0.0, 3))]
    assert shown == ["131\u202f187", "10\u202f400", "9700", "10\u202f000\u202f000", "0.0002", "0"]
    assert grouped("-1234567.25 s, 0.0001234567, 9999") == "-1\u202f234\u202f567.25 s, 0.0001234567, 9999"
    assert grouped("S00123 and 20220101a") == "S00123 and 20\u202f220\u202f101a"
