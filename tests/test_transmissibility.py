"""Transmissibility of recordings and studies: signals of known answer, the table, the figures."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray
from matplotlib.figure import Figure
from scipy import stats
from statsmodels.stats.multitest import multipletests
from transmissibility_cases import recording, virtual_study

from fasbody.exceptions import SettingError
from fasbody.laboratory.study import Plan, make
from fasbody.recording.channels import Channel
from fasbody.recording.study import StudyFolder
from fasbody.transmissibility import figures
from fasbody.transmissibility.comparisons import against_unity, between, mixed, pairwise, resonances
from fasbody.transmissibility.estimate import Row, rows, unwrapped
from fasbody.transmissibility.findings import LOADS, findings, judged, summary
from fasbody.transmissibility.table import Table


def by_pair(found: list[Row]) -> dict[str, Row]:
    return {row.pair: row for row in found}


@pytest.mark.parametrize("f", [10.0, 20.0, 50.0])
def test_sine_fit_within_a_thousandth_and_a_tenth_of_a_degree(f: float) -> None:
    """2 % noise, 20 % second harmonic; and the bias of the thesis' method on the same recording."""
    several = [by_pair(rows(recording(f, seed=s))) for s in range(5)]  # one alone scatters by 0.04 % and 0.02 degrees
    found = several[0]
    for pair, T, phase in (("MB", 1.3, -40), ("TB", 1.1, -75), ("TM", 1.1 / 1.3, -35)):
        assert np.mean([found[pair].transmissibility for found in several]) == pytest.approx(T, rel=6e-4)
        assert np.mean([found[pair].phase_deg for found in several]) == pytest.approx(phase, abs=0.06)
        assert all(abs(found[pair].phase_deg - phase) < 0.1 for found in several)
    if f < 50:  # at 50 Hz the filter takes the second harmonic away
        assert found["MB"].transmissibility_peak_to_peak > 1.3 * 1.02


def test_stated_uncertainty_is_the_scatter_over_repetitions() -> None:
    repeated = [by_pair(rows(recording(seed=s, n=2000)))["MB"] for s in range(24)]
    T, phase = (np.array([getattr(r, name) for r in repeated]) for name in ("transmissibility", "phase_deg"))
    assert np.mean([r.transmissibility_std for r in repeated]) == pytest.approx(T.std(ddof=1), rel=0.35)
    assert np.mean([r.phase_std_deg for r in repeated]) == pytest.approx(phase.std(ddof=1), rel=0.35)


def test_a_fit_needs_no_singular_values(monkeypatch: pytest.MonkeyPatch) -> None:
    """LAPACK's SVD does not converge on some sound bases of sines."""

    def fails(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge in Linear Least Squares")

    expected = by_pair(rows(recording()))["MB"]
    monkeypatch.setattr(np.linalg, "lstsq", fails)
    found = by_pair(rows(recording()))["MB"]
    assert (found.transmissibility, found.phase_deg) == (expected.transmissibility, expected.phase_deg)


def test_unwrapping_passes_over_gaps() -> None:
    assert unwrapped([-150, np.nan, 170, 130]) == pytest.approx([-150, np.nan, -190, -230], nan_ok=True)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return virtual_study(tmp_path_factory.mktemp("made"), subjects=3)


@pytest.fixture(scope="module")
def table(study: Path) -> Table:
    return Table.of(StudyFolder.open(study), processes=1)


def test_table_has_every_subject_condition_pair_and_frequency(table: Table) -> None:
    assert len(table.frame) == 3 * 5 * 9 * 3
    assert table.pairs == ["MB", "TB", "TM"]
    assert table.conditions == [
        ("midstance", 0.0), ("midstance", 2.3), ("midstance", 4.5), ("plantarflexion", 0.0), ("dorsiflexion", 0.0),
    ]  # fmt: skip
    for curves in table.each():
        assert curves.T.shape == (3, 9)
        assert np.all(np.diff(curves.mean_phase_deg) < 15)


def test_pairs_of_one_recording_are_consistent(table: Table) -> None:
    c = {pair: table.curves(pair, "midstance", 4.5) for pair in table.pairs}
    product = c["MB"].T * c["TM"].T
    assert product == pytest.approx(c["TB"].T, rel=1e-9)
    assert c["TB"].phase_deg == pytest.approx(c["MB"].phase_deg + c["TM"].phase_deg, abs=1e-6)


def test_netcdf_and_csv_hold_the_table(table: Table) -> None:
    with xarray.open_dataset(BytesIO(table.netcdf()), engine="h5netcdf") as data:
        value = data["transmissibility"].sel(
            subject="3", posture="midstance", added_mass_kg=2.3, pair="MB", frequency_hz=30.0
        )
        c = table.curves("MB", "midstance", 2.3)
        assert float(value) == pytest.approx(c.T[c.subjects.index("3"), 4])
        assert data.attrs["origin"] == "synthetic"
    assert len(table.csv().splitlines()) == len(table.frame) + 1


def test_comparisons(table: Table) -> None:
    unity, loads, found = against_unity(table), between(table, list(LOADS)), resonances(table)
    assert set(unity["verdict"]) <= {"above", "equal", "below"}
    assert (unity["p_holm"] >= unity["p"]).all() and (loads["p_holm"] >= loads["p"]).all()
    assert len(loads) == 54 and set(loads["test"]) == {"repeated-measures ANOVA"}
    assert set(found["kind"]) <= {"peak", "plateau", "none"}
    assert set(found["shown_kind"]) <= {"peak", "plateau", "none", "undecided"}


def test_gaps_lead_to_the_analysis_that_allows_them(table: Table) -> None:
    f = table.frame
    gap = (f["subject"] == "2") & (f["frequency_hz"] == 20) & (f["added_mass_kg"] == 2.3)
    loads = between(Table(f[~gap], "synthetic"), list(LOADS))
    at = loads[(loads["frequency_hz"] == 20) & (loads["pair"] == "MB")].iloc[0]  # transmissibility, then phase
    assert at["test"] == "repeated-measures ANOVA with gaps" and at["subjects"] == 3
    whole = between(table, list(LOADS))
    before = whole[(whole["frequency_hz"] == 20) & (whole["pair"] == "MB")].iloc[0]
    assert 0.05 < at["p"] / before["p"] < 20  # one value less does not make it surer by orders of magnitude


def test_findings_judge_what_the_curves_say(table: Table) -> None:
    """Hand-made curves that contradict a statement make it fail."""
    made = {f.says: f for f in findings(table)}
    assert made["MB below 20 Hz falls with load"].holds
    frame = table.frame.copy()
    low = (frame["pair"] == "MB") & (frame["added_mass_kg"] == 4.5)
    frame.loc[low, "transmissibility"] *= 0.5
    again = {f.says: f for f in findings(Table(frame, "synthetic"))}
    assert made["MB with 4.5 kg above 1 at all frequencies"].holds
    assert not again["MB with 4.5 kg above 1 at all frequencies"].holds
    assert "10<" in again["MB with 4.5 kg above 1 at all frequencies"].came_out


def test_what_could_not_be_tested_is_no_success(table: Table) -> None:
    """Two subjects are left under 4.5 kg, and 25 Hz was not recorded under 2.3 kg."""
    f = table.frame
    few = (f["added_mass_kg"] == 4.5) & ~f["subject"].isin(["1", "2"])
    gap = (f["added_mass_kg"] == 2.3) & (f["frequency_hz"] == 25)
    left = Table(f[~few & ~gap], "synthetic")
    assert str(left.curves("TM", "midstance", 4.5).resonance) == "not tested (n = 2)"
    made = {m.says: m for m in findings(left)}
    assert len(made) == len(findings(table)) == 35
    for says in (
        "TM with 4.5 kg without a peak", "TM with 2.3 kg without a peak", "MB with 4.5 kg above 1 at all frequencies",
        "MB phase with 2.3 kg steepest within 5 Hz of the resonance", "TB alike with 2.3 and 4.5 kg at 15-35 Hz",
    ):  # fmt: skip
        assert made[says].holds is None and made[says].verdict == "not tested", says
    assert made["MB below 20 Hz falls with load"].holds is not None
    tested = [m for m in made.values() if m.holds is not None]
    assert f" of {len(tested)} statements hold, {35 - len(tested)} could not be tested." in summary(list(made.values()))
    assert "not tested (n = 2)" in set(resonances(left)["kind"])
    assert "not tested (n = 2)" in titles(figures.subjects(left, "TM", list(LOADS)))


def titles(figure: Figure) -> str:
    return " ".join(axis.get_title() for axis in figure.axes)


def test_arrows_stay_below_the_titles(table: Table) -> None:
    figure = figures.means(table, list(LOADS))
    tops = [a.get_position()[1] for axis in figure.axes for a in axis.texts]
    assert tops and max(tops) < figure.axes[0].get_ylim()[1]


def test_figures_tell_what_is_shown_beyond_chance_from_what_is_not(table: Table) -> None:
    """A peak that stands out of the scatter is filled; the same with scatter, found by the thesis' rule, is hollow."""
    f = np.arange(10.0, 55, 5)
    mean = np.array([1.0, 1.1, 1.2, 1.3, 1.5, 1.35, 1.3, 1.2, 1.1])
    panels = {}
    for scatter in (0.02, 0.2):
        rng = np.random.default_rng(4)
        lines = [
            {"file": f"{s}_{x:g}", "subject": str(s), "posture": "midstance", "added_mass_kg": 0.0, "frequency_hz": x,
             "pair": "MB", "transmissibility": m + rng.normal(0, scatter), "phase_deg": -2 * x}
            for s in range(6) for x, m in zip(f, mean, strict=True)
        ]  # fmt: skip
        panels[scatter] = Table(pd.DataFrame(lines), "synthetic")
    for scatter, filled in ((0.02, True), (0.2, False)):
        curves = panels[scatter].curves("MB", "midstance", 0.0)
        assert curves.resonance.kind == "peak" and curves.resonance_by_tests.confirms(curves.resonance) == filled
        (span,) = figures.subjects(panels[scatter], "MB", [("midstance", 0.0)]).axes[0].patches
        assert span.get_fill() == filled
        figure = figures.means(panels[scatter], [("midstance", 0.0)])
        (arrow,) = figure.axes[0].texts
        assert (arrow.arrow_patch.get_facecolor()[:3] == (1, 1, 1)) != filled
        assert arrow.xy[0] == curves.resonance.top == 30  # not the middle of its range
        assert "hollow where not significant" in figure.get_supxlabel().replace("\n", " ")
        assert not figure.axes[0].get_legend()  # one condition: its name is the title


def test_findings_take_the_nine_frequencies_from_among_others(table: Table) -> None:
    more = table.frame[table.frame["frequency_hz"] == 10].assign(frequency_hz=12.5)
    more["file"] += "x"
    wider = Table(pd.concat([table.frame, more]), "synthetic")
    assert [f.came_out for f in judged(wider)[0]] == [f.came_out for f in judged(table)[0]]
    for frame, why in (
        (table.frame.assign(frequency_hz=12.0), "nothing was recorded at 10, 15"),
        (table.frame[table.frame["subject"] == "1"], "they need at least 3 subjects, not 1"),
        (table.frame.assign(method="H1 by Welch"), "this study has broadband recordings"),
        (table.frame[table.frame["added_mass_kg"] == 2.3], "neither all three loads nor"),
    ):
        stated, said = judged(Table(frame, "synthetic"))
        assert not stated and why in said


def test_a_study_of_other_frequencies_is_judged_by_what_it_has(table: Table) -> None:
    """Without 30 Hz, statements on 30 Hz are not tested, all others come out as before."""
    less = {f.says: f for f in judged(Table(table.frame[table.frame["frequency_hz"] != 30], "synthetic"))[0]}
    whole = {f.says: f for f in judged(table)[0]}
    assert len(less) == len(whole)
    for says in ("MB below 20 Hz falls with load", "MB unloaded close to 1 at 45 and 50 Hz"):
        assert less[says].holds == whole[says].holds is not None
    assert less["MB resonance with 2.3 kg: 30-35 Hz (peak)"].holds is None


def test_verdicts_are_after_holm_over_all_tests_of_a_pair(table: Table) -> None:
    unity = against_unity(table)
    for _, part in unity.groupby("pair"):
        assert part["p_holm"].to_numpy() == pytest.approx(multipletests(part["p"], method="holm")[1])
    assert ((unity["verdict"] != "equal") == (unity["p_holm"] < 0.05)).all()
    assert ((unity["thesis_verdict"] != "equal") == (unity["p"] < 0.05)).all()
    assert (unity["verdict"] != unity["thesis_verdict"]).any()


def test_pairs_of_loads_are_told_apart(table: Table) -> None:
    which = pairwise(table, list(LOADS))
    assert len(which) == 3 * 9 * 3 * 2
    at = which[(which["pair"] == "MB") & (which["frequency_hz"] == 10) & (which["to_kg"] == 4.5)]
    values = table.levels("MB", list(LOADS), 10.0)
    row = at[(at["from_kg"] == 0) & (at["quantity"] == "transmissibility")].iloc[0]
    assert row["p"] == pytest.approx(stats.ttest_rel(values[:, 2], values[:, 0]).pvalue)
    assert row["difference"] == pytest.approx((values[:, 2] - values[:, 0]).mean())


def test_phases_are_compared_across_the_jump_of_360_degrees(table: Table) -> None:
    """The same phases turned by half a circle give the same tests."""
    turned = table.frame.assign(phase_deg=(table.frame["phase_deg"] + 540) % 360 - 180)
    one, other = (pairwise(t, list(LOADS)) for t in (table, Table(turned, "synthetic")))
    phase = one["quantity"] == "phase_deg"
    assert one[phase]["p"].to_numpy() == pytest.approx(other[phase]["p"].to_numpy(), rel=1e-6)


def test_groups_and_covariates_by_a_mixed_model() -> None:
    """A group that moves 0.3 more and a slope of 0.02 a year that were put in come out; noise does not."""
    rng = np.random.default_rng(2)
    people = pd.DataFrame(
        {"subject": [str(i) for i in range(30)], "group": ["a", "b"] * 15, "age_yr": rng.uniform(20, 60, 30),
         "shoe": rng.normal(size=30)}
    )  # fmt: skip
    lines = []
    for i, person in people.iterrows():
        own = rng.normal(0, 0.05)
        for load in (0.0, 2.3, 4.5):
            T = 1 + 0.3 * (person["group"] == "b") + 0.02 * person["age_yr"] + own + rng.normal(0, 0.03)
            lines.append(
                {"file": f"{i}{load}", "subject": person["subject"], "posture": "midstance", "added_mass_kg": load,
                 "frequency_hz": 20.0, "pair": "MB", "transmissibility": T, "phase_deg": 179 + 2 * rng.normal(),
                 "method": "sine"}
            )  # fmt: skip
    table = Table(pd.DataFrame(lines), "synthetic")
    found = mixed(table, people, "group + age_yr + shoe + added_mass_kg")
    T = found[found["quantity"] == "transmissibility"].set_index("term")
    assert T.loc["group[T.b]", "difference"] == pytest.approx(0.3, abs=0.06)
    assert T.loc["age_yr", "difference"] == pytest.approx(0.02, abs=0.003)
    assert dict(T["verdict"]) == {"group[T.b]": "above", "age_yr": "above", "shoe": "equal", "added_mass_kg": "equal"}
    with pytest.raises(SettingError, match="height"):
        mixed(table, people, "group + height")


def test_broadband_recordings_share_one_band_for_all_pairs(tmp_path: Path) -> None:
    """Random excitation from 5 to 60 Hz: no stray frequency that one of them leaks into."""
    plan = Plan(subjects=3, conditions=(("midstance", 0.0),), excitation="random", seconds=5.0, file_format="h5")
    table = Table.of(StudyFolder.open(make(tmp_path / "s", plan, processes=1)), processes=1)
    assert table.broadband
    for curves in table.each():
        assert np.isfinite(curves.T).all() and curves.resonance.subjects == 3
        assert np.all(np.diff(curves.frequency_hz) == 1) and 4 <= curves.frequency_hz[0] <= 6
        assert 58 <= curves.frequency_hz[-1] <= 62


def test_bands_need_subjects(tmp_path: Path) -> None:
    """Two subjects have no 80 % band: their lines are drawn, and the caption says so."""
    plan = Plan(subjects=2, conditions=(("midstance", 0.0),), excitation="random", seconds=5.0, file_format="h5")
    table = Table.of(StudyFolder.open(make(tmp_path / "s", plan, processes=1)), processes=1)
    figure = figures.spectrum(table, table.conditions)
    assert not figure.axes[0].collections and len(figure.axes[0].lines) == 2 + 1 + 1  # subjects, mean, unity
    assert "thin: subjects" in figure.get_supxlabel()


def test_gain_and_delay_that_study_toml_leaves_open_are_in_the_standard_deviations() -> None:
    r = recording(25.0)
    noise = by_pair(rows(r))
    told = {"malleolus": Channel(gain_std=0.02, delay_std_s=3e-4), "base": Channel(delay_std_s=4e-4)}
    total = by_pair(rows(replace(r, calibration=told)))
    for pair, gain, delay in (("MB", 0.02, 5e-4), ("TB", 0.0, 4e-4), ("TM", 0.02, 3e-4)):
        a, b = noise[pair], total[pair]
        assert b.transmissibility_std**2 == pytest.approx(a.transmissibility_std**2 + (gain * a.transmissibility) ** 2)
        assert b.phase_std_deg**2 == pytest.approx(a.phase_std_deg**2 + (360 * 25 * delay) ** 2)
        assert (a.transmissibility, a.phase_deg) == (b.transmissibility, b.phase_deg)
    assert Table.of_recordings([r]).covers.startswith("noise only")
    assert "(malleolus, base)" in Table.of_recordings([replace(r, calibration=told)]).covers


def test_the_virtual_studys_truth_lies_within_what_it_states(study: Path, table: Table) -> None:
    """Its instrument has a hidden delay and gains that scatter; study.toml says how well they are known."""
    known = pd.read_csv(study / "truth.csv").set_index(["file", "pair"])
    frame = table.frame.set_index(["file", "pair"]).loc[known.index]
    off = frame["phase_deg"] - known["phase_deg"]
    late = frame[off.index.get_level_values("pair") != "TM"]
    assert (off[late.index] / (-360 * late["frequency_hz"] * 2e-4)).median() == pytest.approx(1, abs=0.1)
    z = np.concatenate([off / frame["phase_std_deg"], (frame["transmissibility"] - known["transmissibility"])
                        / frame["transmissibility_std"]])  # fmt: skip
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.2
    assert "gain and delay" in table.covers
