"""The page and the figures of a study: what they show is what the fits say, and nothing outside is needed."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from made_fits import failed, plain

from identification.estimates import RULE
from identification.figures import save
from identification.study import figures, report, summary, tables
from identification.study.findings import Findings
from identification.study.tracking import Prior
from identification.study.truth import Truth

KEYS = {
    "k_T_n_per_m": 1e5, "c_11_n_s_per_m": 300.0, "c_12_per_m": 50.0, "c_13_per_m": 80.0,
    "k_F_n_per_m": 9e4, "c_21_n_s_per_m": 700.0, "c_22_per_m": -40.0, "c_23_per_m": 90.0,
}  # fmt: skip
CHECK = {"subject": "1", "posture": "midstance", "added_mass_kg": 0.0, "frequency_hz": None, "parameter": ""}
ROW = {"edge": False, "percent": 91.5, "chi_square": 20.0, "numbers": 10}
HELD_OUT = CHECK | {"mode": "pooled", "kind": "validation", "status": "done"}
HELD_OUT |= {"result": {"held_out": {"rows": [ROW], "failed": []}, "damping": None}}
BROKEN = CHECK | {"mode": "pooled", "kind": "profile", "status": "failed", "error": "k_T cannot be."}
PICTURES = report.pictures
TRUTH = Truth({}, {key.partition("_n_")[0].removesuffix("_per_m"): value for key, value in KEYS.items()})


def branches(scale: float) -> dict[str, Any]:
    words = ("identified", "identified", "weak", "not identifiable") * 2
    near = {key: (scale * v, 0.05 * abs(v), word) for (key, v), word in zip(KEYS.items(), words, strict=True)}
    return {"stiff ankle": near, "stiff pad": {key: (3 * v, 0.05 * abs(v), "weak") for key, v in KEYS.items()}}


def study() -> list[dict[str, Any]]:
    """Seven subjects at three frequencies and two loads, one of them far off, and one broken recording."""
    rng = np.random.default_rng(1)
    fits = [
        plain("per-recording", str(s), load, f, branches(4.0 if (s, f) == (5, 20.0) else 1 + 0.03 * rng.normal()))
        for s in range(1, 8)
        for load in (0.0, 2.3)
        for f in (10.0, 20.0, 30.0)
    ]
    return [*fits, failed("6", "s6.csv: malleolus is <b>dead</b>; check the cable.")]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    files = report.write(out, Findings(study(), [HELD_OUT, BROKEN], TRUTH), "a small study", "synthetic")
    assert files[0] == out / "report.html"
    assert all(file.stat().st_size for file in files)
    return out


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without figures, whose drawing takes seconds."""
    monkeypatch.setattr(report, "pictures", lambda *_: {})


def test_page_needs_nothing_from_outside(written: Path) -> None:
    page = (written / "report.html").read_text()
    assert RULE in page  # what "identified" means, in the words of all reports
    addresses = set(re.findall(r"https?://[^\"'\s<>)]+", page))
    # names of XML vocabularies and of licence terms within SVG, which nothing fetches
    assert all(
        re.match(r"https?://(www\.w3\.org|creativecommons\.org|purl\.org|matplotlib\.org)", a) for a in addresses
    )
    assert set(re.findall(r"(?:src|href)=\"(?!#|data:)([^\"]*)", page)) == set()
    assert "<script" not in page
    assert "@import" not in page
    assert set(re.findall(r"<nav>.*?</nav>", page, re.S))
    anchors = set(re.findall(r'<a href="#([^"]+)', page))
    assert anchors <= set(re.findall(r'id="([^"]+)"', page))
    assert {"done", "mirror", "truth", "section1"} <= anchors


def test_page_says_what_the_fits_say(written: Path) -> None:
    page = (written / "report.html").read_text()
    assert "synthetic data: nobody was measured" in page
    assert "42 of 43 fits done, 1 failed." in page
    assert "mean fit 90.0 %, 0 % of estimates identified, mirror decided in 0 of 42 alone" in page
    assert "s6.csv: malleolus is &lt;b&gt;dead&lt;/b&gt;" in page
    assert "A recording of one frequency contains amplitude and phase" in page
    assert "differ by 0.1 % at most" in page  # 0.01 of 8.01
    found = pd.read_csv(written / "recovery.csv").set_index("parameter").loc["all"]
    assert f"{found['chosen']:.0f} of 336 ({100 * found['chosen'] / 336:.0f} %)" in page
    assert f"<td>{100 * found['chosen'] / 336:.0f} % of 336</td>" in page
    assert found["chosen"] == 320  # all but the two fits that are four times too high, eight parameters each
    assert "Failed (pooled, profile): k_T cannot be." in page
    assert "<td>pooled</td><td>1</td><td>1</td><td>91.5</td><td>2</td><td>–</td><td>0</td>" in page


def test_outliers_of_the_page_are_those_of_the_table(written: Path) -> None:
    table = pd.read_csv(written / "summary.csv", dtype={"subject": str})
    outliers = table[table["outlier"]]
    assert set(outliers["subject"]) >= {"5"}
    assert (outliers.loc[outliers["subject"] == "5", "frequency_hz"] == 20).sum() == 16
    page = (written / "report.html").read_text()
    count = int((outliers[outliers["added_mass_kg"] == 0]["parameter"] == "k_T").sum())
    assert f"<td>per-recording, 0 kg</td><td>{count} of 21</td>" in page


def test_figures_are_whole_and_the_same_each_time(written: Path, tmp_path: Path) -> None:
    names = {file.stem for file in (written / "figures").iterdir()}
    assert names == {
        "curves_per-recording_midstance", "transmissibility_per-recording", "loops_per-recording",
        "energies_per-recording",
    }  # fmt: skip
    for name in names:
        assert ET.parse(written / "figures" / f"{name}.svg").getroot().tag.endswith("svg")
        assert (written / "figures" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
    again = report.pictures(Findings(study(), truth=TRUTH), "synthetic")
    for name in ("loops_per-recording", "energies_per-recording"):
        assert save(again[name][0](), "svg") == (written / "figures" / f"{name}.svg").read_bytes()


def test_loops_motion_and_energies_are_drawn_in_their_units() -> None:
    cycles = [d["cycles"][0] for d in study()[:6]]
    axis = figures.loops(cycles, "synthetic").axes[0]
    assert len(axis.lines) == 3  # a loop a frequency
    x, y = axis.lines[0].get_data()
    assert (x[0], x[-1]) == (1000.0, 1000.0)  # closed, in mm
    assert max(y) == pytest.approx(2.0)
    energy = summary.cycle_table(study())
    whole, share = figures.energies(energy, "synthetic").axes
    assert whole.containers[0].lines[0].get_ydata() == pytest.approx([8e3 * np.pi] * 3)
    assert not any(len(c.lines[0].get_ydata()) for c in share.containers)  # no branch is decided: points alone
    assert share.lines[-1].get_ydata() == pytest.approx([75.0] * 21)
    told = figures.energies(energy.assign(decided_by="tracking"), "synthetic").axes[1]
    assert told.containers[0].lines[0].get_ydata() == pytest.approx([75.0] * 3)
    size, phase = figures.transmissibility(cycles, "synthetic").axes
    assert size.lines[0].get_ydata() == pytest.approx([np.sqrt(2)] * 3)
    assert phase.lines[0].get_ydata() == pytest.approx([45.0] * 3)  # a lag


def test_measured_and_lonely_and_hopeless_studies(tmp_path: Path) -> None:
    """One fit that has no cycle; then none that came about."""
    alone = plain("pooled", "1", 0.0, None, branches(1.0), origin="measured", cycles=[])
    report.write(tmp_path / "one", Findings([alone]), "one foot", "measured")
    page = (tmp_path / "one" / "report.html").read_text()
    assert "measured data" in page
    assert "nobody was measured" not in page
    assert "truth" not in page
    assert "No recording is periodic" in page
    report.write(tmp_path / "none", Findings([failed("1", "s1.csv: is too short.")]), "nothing", "of unstated origin")
    page = (tmp_path / "none" / "report.html").read_text()
    assert "0 of 1 fits done, 1 failed." in page
    assert "data of unstated origin" in page
    assert (tmp_path / "none" / "summary.csv").read_text() == ",".join(summary.COLUMNS) + "\n"


def test_tracking_turns_what_is_shown(tmp_path: Path, bare: None) -> None:
    """All fits prefer the stiff ankle a little; a prior for the pad turns them, in tables, figures and loops alike."""
    fits = study()[:-1]
    for d in fits:  # loops of both branches, as a study stores them
        other = dict(d["cycles"][0]) | {"branch": "stiff pad", "chosen": False}
        other |= {part: {**other[part], "dissipated_j": 5.0} for part in ("ankle", "fat_pad")}
        d["cycles"].append(other)
        for b, k_T in zip(d["result"]["branches"], (3e5, 2e4), strict=True):
            b["parameters"]["k_T_n_per_m"]["value"] = k_T
    found = Findings(fits, prior=Prior.read(["k_T<k_F"]), prior_text="k_T<k_F")
    assert set(found.tracked.values()) == {"stiff pad"}
    report.write(tmp_path, found, "turned", "synthetic")
    page = (tmp_path / "report.html").read_text()
    said = "Of 42 fits shown: 42 on the branch decided by all fits of the subject together (42 of them against the"
    assert said in page
    table = pd.read_csv(tmp_path / "summary.csv")
    shown = table[table["shown"]]
    assert set(shown.loc[shown["parameter"] == "k_T", "value"]) == {2e4}
    energy = pd.read_csv(tmp_path / "energy.csv")
    assert set(energy.loc[energy["shown"], "ankle_j"]) == {5.0}
    whole = figures.energies(summary.cycle_table(fits, found.tracked), "synthetic").axes[0]
    assert whole.containers[0].lines[0].get_ydata() == pytest.approx([1e4] * 3)
    _, cycles = report.example(found, "per-recording", "midstance")
    assert {c["branch"] for c in cycles} == {"stiff pad"}
    assert len(cycles) == 6
    assert all(c["decided"] for c in cycles)
    undecided = report.example(Findings(fits), "per-recording", "midstance")[1]
    assert not any(c["decided"] for c in undecided)
    styles = [
        {line.get_linestyle() for line in figures.loops(c, "synthetic").axes[0].lines} for c in (cycles, undecided)
    ]
    assert styles == [{"-"}, {"--"}]


def test_curves_leave_out_what_rests_on_a_bound() -> None:
    fits = study()[:-1]
    for d in fits[:12]:  # the first two subjects
        d["result"]["branches"][0]["parameters"]["c_13_per_m"] |= {"value": 0.0, "std_error": None, "at_bound": True}
    rows = summary.tidy(fits)
    curve = figures.curves(rows, "synthetic").axes[3]
    assert "30 of 42" in curve.get_title()
    assert min(line.get_ydata().min() for line in curve.lines if len(line.get_ydata())) > 60


def test_best_ends_that_a_second_start_met_are_counted(written: Path) -> None:
    """Starts of the study end at 10, 15 and 20; of three fits one has its best end twice on one branch."""
    assert "<th>best minimum found twice</th>" in (written / "report.html").read_text()
    fits = study()[:3]
    for d, second in zip(fits, ((10.001, "stiff ankle"), (10.001, "stiff pad"), (10.5, "stiff ankle")), strict=True):
        d["result"]["starts"][1] |= dict(zip(("cost", "branch"), second, strict=True))
    (row,) = summary.counts(fits).to_dict("records")
    assert (row["again"], row["again_of"]) == (1, 3)
    sides = [{"cost": cost, "branch": branch, "hits": hits} for cost, branch, hits in ((1, "a", 1), (2, "b", 9))]
    for starts, again in ((sides, 0), (sides[1:], 1)):  # of steady recordings the best side's own count
        (row,) = summary.counts([{**fits[0], "result": fits[0]["result"] | {"starts": starts}}]).to_dict("records")
        assert (row["again"], row["again_of"]) == (again, 1)
    assert tables.counts(fits)["best minimum found twice"].tolist() == ["1 of 3 (33 %)"]


def test_what_is_decided_alone_is_one_number_in_sentence_and_table() -> None:
    """Two fits decide alone, and tracking leaves all open: both the sentence and the table count two."""
    fits = study()[:6]
    for d in fits[:2]:
        d["result"]["verdict"] = "decided"
    found = Findings(fits)
    assert set(found.tracked.values()) == {"undecided"}
    table, said = found.table, " ".join(tables.short(found))
    (row,) = tables.branches(fits, table).to_dict("records")
    assert "mirror decided in 2 of 6 alone" in said and (row["fits"], row["decided alone"]) == (6, 2)
    shown = ("decided by all fits together", "decided by the fit alone", *summary.DECIDED_BY[2:])
    assert [row[name] for name in shown] == [0, 0, 6, 0, 0]


def test_a_misfit_has_no_odds_intervals_or_energies(tmp_path: Path, bare: None) -> None:
    """Two pooled fits of one subject: the second load's do not follow, so the first alone is weighed and counted."""
    fits = [plain("pooled", "1", load, None, branches(1.0)) for load in (0.0, 2.3)]
    for d, follow in zip(fits, (True, False), strict=True):
        d["cycles"][0]["frequency_hz"] = 20.0
        for branch in d["result"]["branches"]:
            branch["world"] = {"follows": follow, "repeatability": 0.0, "dof": 9, "objective": 1.0, "chi_square": 1.0}
    found = Findings(fits)
    assert list(found.tracked) == [fits[0]["key"]]
    offered = found.table.groupby("key")[["std_error", "lower", "upper"]].count().sum(axis=1)
    assert offered[fits[0]["key"]] > 0 == offered[fits[1]["key"]]
    assert set(found.energy["key"]) == {fits[0]["key"]}
    nothing = Findings(fits[1:])
    (subject,) = nothing.subjects
    assert subject.tracking is None and nothing.document()["tracking"][0]["tracking"] is None
    assert nothing.energy.empty and not nothing.table["std_error"].notna().any()
    assert list(PICTURES(nothing, "synthetic")) == ["transmissibility_pooled"]  # which shows how far off it is
    report.write(tmp_path, nothing, "a misfit", "synthetic")
    assert "No fit follows its recordings" in (page := (tmp_path / "report.html").read_text())
    assert " to 1<" not in page


def test_estimates_without_an_interval_are_drawn_bare() -> None:
    """One frequency has fewer numbers than constants: values without bars, and no count of intervals in the titles."""
    rows = summary.tidy(study()[:-1]).assign(std_error=np.nan, lower=np.nan, upper=np.nan)
    figure = figures.curves(rows, "synthetic")
    axis = figure.axes[0]
    drawn = [y for line in axis.lines if line.get_label() == "no interval" for y in line.get_ydata()]
    values = rows[rows["shown"] & (rows["parameter"] == "k_T")]["value"]
    assert sorted(drawn) == pytest.approx(sorted(1e-3 * values)) and " of " not in axis.get_title()
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "no interval" in texts and "branch not decided" not in texts


def test_subject_whom_the_model_follows_is_shown_or_nobody_is() -> None:
    """Subject 16 is shown before others, but not where no fit of it follows; loops of no such fit at all."""
    fits = study()[:12]  # subjects 1 and 2
    for d in fits[:6]:
        d["subject"] = "16"
    assert report.example(Findings(fits), "per-recording", "midstance")[0] == "16"
    for d in fits[:6]:
        for branch in d["result"]["branches"]:
            branch["fit_percent"] = 84.9
    assert report.example(Findings(fits), "per-recording", "midstance")[0] == "2"
    for d in fits:
        for branch in d["result"]["branches"]:
            branch["fit_percent"] = 84.9
    found = report.pictures(Findings(fits), "synthetic")
    assert not any(name.startswith("loops") for name in found)
    assert "No fit follows its recordings, so the hysteresis" in found["transmissibility_per-recording"][1]


def test_two_subjects_make_no_curve() -> None:
    rows = summary.tidy([d for d in study()[:-1] if d["subject"] in ("1", "2")])
    figure = figures.curves(rows, "synthetic")
    assert "0 kg added" in [text.get_text() for text in figure.legends[0].get_texts()]
    sizes = [len(line.get_xdata()) for line in figure.axes[0].lines if line.get_label() == "mean"]
    assert sizes == [0, 0]
    three = summary.tidy([d for d in study()[:-1] if d["subject"] in ("1", "2", "3")])
    for by, points in (("undecided", 0), ("likelihood", 121)):  # nothing decided, no mean
        drawn = figures.curves(three.assign(decided_by=by), "synthetic").axes[0].lines
        assert {len(line.get_xdata()) for line in drawn if line.get_label() == "mean"} == {points}


def test_fits_that_do_not_follow_are_said_and_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One fit at 37 %: named at the top, dotted in loops, and in no mean, box or energy."""
    fits = study()[:-1]
    bad = fits[2]
    assert (bad["subject"], bad["added_mass_kg"], bad["frequency_hz"]) == ("1", 0.0, 30.0)
    before = summary.tidy(fits)
    for branch in bad["result"]["branches"]:
        branch["fit_percent"] = 37.2
    for part in ("ankle", "fat_pad"):
        bad["cycles"][0][part]["dissipated_j"] = 1e3
    with monkeypatch.context() as patched:
        patched.setattr(report, "pictures", lambda *_: {})
        report.write(tmp_path, Findings(fits), "a bad one", "synthetic")
    page = (tmp_path / "report.html").read_text()
    said = "1 of 42 fits follow their recordings to less than 85 % "
    said += "(per-recording, subject 1, midstance, 0 kg, 30 Hz: 37.2 %)"
    assert said in page and page.index(said) < page.index("<nav>")
    assert summary.unfollowed_sentence(study()) == ""
    table, energy = summary.tidy(fits), summary.cycle_table(fits)
    lost = before[summary.measured(before)].index.difference(table[summary.measured(table)].index)
    assert set(table.loc[lost, "key"]) == {bad["key"]} and len(lost) == 16
    for by, count in (("tracking", 6), ("undecided", 0)):
        rows = tables.energies(energy.assign(decided_by=by)).set_index(["added mass [kg]", "frequency [Hz]"])
        row = rows.loc[("0", "30")]
        assert (row["cycles"], row["branch decided"]) == (6, count)
        assert float(row["median shaker [mJ]"]) == pytest.approx(8.01e3 * np.pi, rel=1e-2)
        assert row["median ankle [mJ]"] == (f"{2e3 * np.pi:.3g}" if count else "–")
    assert "41 of 42" in figures.curves(table, "synthetic").axes[0].get_title()
    mine = [d for d in fits if d["subject"] == "1"]
    cycles = report.example(Findings(mine), "per-recording", "midstance")[1]
    assert [c["follows"] for c in cycles] == [True, True, False, True, True, True]
    drawn = figures.loops(cycles, "synthetic")
    assert [line.get_linestyle() for line in drawn.axes[0].lines] == ["--", "--", ":"]
    assert "less than 85 %" in drawn.get_supxlabel()
    bad["result"]["branches"][0]["fit_percent"] = 84.0
    alone = report.pictures(Findings([bad]), "synthetic")
    assert "energies_per-recording" not in alone
    assert "loops_per-recording" not in alone
