"""The tidy table, outliers by the thesis' quartiles, energies, and the spline curves with their bands."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from made_fits import failed, plain
from scipy import stats

from identification.study import summary
from identification.study.findings import Findings
from identification.study.means import BAND, mean_curve, spline


def one(value: float, other: float = 1.0, word: str = "weak") -> dict[str, dict[str, tuple[float, float | None, str]]]:
    """Two branches with one parameter."""
    return {"stiff ankle": {"k_T_n_per_m": (value, 2.0, word)}, "stiff pad": {"k_T_n_per_m": (other, None, "weak")}}


@pytest.mark.parametrize(
    ("values", "want"),
    [
        ([1, 2, 3, 4], (1.5, 3.5)),
        ([1, 2, 3, 4, 5], (1.5, 4.5)),  # the middle value belongs to neither half
        ([9, 8, 7, 6, 5, 4, 3, 2, 1], (2.5, 7.5)),
        ([7, 15, 36, 39, 40, 41], (15, 40)),  # Moore and McCabe's example
    ],
)
def test_quartiles_are_medians_of_the_halves(values: list[float], want: tuple[float, float]) -> None:
    assert summary.quartiles(np.array(values, float)) == want


def test_outliers_are_beyond_one_and_a_half_interquartile_ranges() -> None:
    values = np.array([1, 2, 3, 4, 5, 6, 7, 8, 9, 15.5])  # Q1 3, Q3 8: the upper fence is 15.5 itself
    assert not summary.outliers(values).any()
    values[-1] = 15.6
    assert list(np.flatnonzero(summary.outliers(values))) == [9]
    assert list(np.flatnonzero(summary.outliers(np.append(values, np.nan)))) == [9]
    assert list(np.flatnonzero(summary.outliers(-values))) == [9]
    assert not summary.outliers(np.array([0.0, 0.0, 1e9])).any()  # three values make no box


def test_tidy_has_a_row_a_branch_and_parameter_and_marks_outliers_within_a_condition() -> None:
    usual = [plain("per-recording", str(i), 0.0, 10.0, one(100.0 + i, other=1e6)) for i in range(6)]
    wild = plain("per-recording", "9", 0.0, 10.0, one(900.0))
    same_elsewhere = [plain("per-recording", str(i), 2.3, 10.0, one(900.0 + i)) for i in range(6)]
    table = summary.tidy([*usual, wild, *same_elsewhere, failed("7", "broken")])
    assert tuple(table.columns) == summary.COLUMNS
    assert len(table) == 2 * 13
    assert list(table.loc[table["outlier"], ["subject", "added_mass_kg"]].itertuples(index=False)) == [("9", 0.0)]
    row = table.iloc[1]
    assert (row["branch"], row["chosen"], row["parameter"], row["unit"], row["value"]) == (
        "stiff pad", False, "k_T", "N/m", 1e6,
    )  # fmt: skip
    assert np.isnan(row["std_error"])
    assert table["truth"].isna().all()


def test_counts_and_energies() -> None:
    good = [plain("per-recording", str(i), 0.0, 10.02, one(1.0)) for i in range(3)]
    good[0]["result"] |= {"verdict": "decided"}
    good[0]["result"]["branches"][0]["fit_percent"] = 60.0
    counts = summary.counts([*good, failed("8", "broken"), plain("pooled", "1", 0.0, None, one(1.0))])
    first, second = counts.to_dict("records")
    assert (first["fits"], first["done"], first["failed"], first["recordings"]) == (4, 3, 1, 3)
    assert (first["decided"], first["undecided"], first["fit_percent"]) == (1, 2, pytest.approx(80.0))
    assert second["mode"] == "pooled"
    energy = summary.cycle_table([*good, failed("8", "broken")])
    assert len(energy) == 3
    assert set(energy["frequency_hz"]) == {10.0}  # what was set, not what was found
    assert energy["fat_pad_j"].to_numpy() == pytest.approx(3 * energy["ankle_j"].to_numpy())
    assert energy["fit_percent"].tolist() == [60.0, *(d["result"]["branches"][0]["fit_percent"] for d in good[1:])]
    unfitted = {**good[0], "cycles": [{**c, "branch": "true"} for c in good[0]["cycles"]]}
    assert summary.cycle_table([unfitted])["fit_percent"].isna().all()


def test_spline_reproduces_a_cubic_and_smooths_noise() -> None:
    f, at = np.arange(10.0, 55.0, 5.0), np.linspace(10, 50, 33)
    cubic = np.polynomial.Polynomial([3.0, -0.2, 0.01, -1e-4])
    assert spline(f[::-1], cubic(f)[::-1], at) == pytest.approx(cubic(at), rel=1e-9)
    few = np.array([10.0, 15.0, 20.0, 25.0])  # a parabola, not the cubic through all four
    assert spline(few, cubic(few), at)[:9] == pytest.approx(np.polyval(np.polyfit(few, cubic(few), 2), at[:9]))
    assert spline(few[:3], cubic(few[:3]), at)[:3] == pytest.approx(
        np.polyval(np.polyfit(few[:3], cubic(few[:3]), 1), at[:3])
    )
    twice = spline(np.tile(f, 2), np.concatenate([cubic(f) + 1, cubic(f) - 3]), at)
    assert twice == pytest.approx(cubic(at) - 1, rel=1e-9)  # of all estimates, which is that of the means
    assert np.isnan(spline(f[2:], cubic(f[2:]), at)[at < 20]).all()  # never beyond a subject's own frequencies
    noise = np.random.default_rng(0).normal(0, 1, f.size)
    assert np.std(spline(f, noise, f)) < 0.9 * np.std(noise)


def curve_rows(parameter: str, values: dict[str, np.ndarray], f: np.ndarray) -> pd.DataFrame:
    """Estimates of one parameter, subject -> value at each frequency."""
    rows = [(subject, parameter, x, v, 1.0, False) for subject, own in values.items()
            for x, v in zip(f, own, strict=True)]  # fmt: skip
    columns = ["subject", "parameter", "frequency_hz", "value", "std_error", "outlier"]
    return pd.DataFrame(rows, columns=columns).assign(fit_percent=99.0)


F = np.arange(10.0, 55.0, 5.0)
SHAPE = np.polynomial.Polynomial([100.0, 2.0, -0.01])
OFFSETS = np.array([-9.0, 4.0, 1.0, 7.0, 2.0])


def test_band_is_students_interval_of_the_subjects() -> None:
    rows = curve_rows("c_22", {str(s): SHAPE(F) + o for s, o in enumerate(OFFSETS)}, F)
    wild = curve_rows("c_22", {"wild": np.full(F.size, 1e9)}, F).assign(outlier=True)
    c = mean_curve(pd.concat([rows, wild]))
    low, high = stats.t.interval(0.95, 4, loc=OFFSETS.mean(), scale=stats.sem(OFFSETS))
    assert c.mean == pytest.approx(SHAPE(c.frequency_hz) + OFFSETS.mean())
    assert c.lower == pytest.approx(SHAPE(c.frequency_hz) + low)
    assert c.upper == pytest.approx(SHAPE(c.frequency_hz) + high)
    three = mean_curve(rows[rows["subject"].isin(["0", "1", "2"])])
    assert np.isnan(three.lower).all()  # a mean, but no interval worth showing
    assert mean_curve(rows[rows["subject"].isin(["0", "1"])]).mean.size == 0  # two make no mean
    assert three.mean == pytest.approx(SHAPE(three.frequency_hz) + OFFSETS[:3].mean())
    gap = mean_curve(rows[~((rows["subject"] == "0") & (rows["frequency_hz"] == 10))])
    without = SHAPE(10.0) + OFFSETS[1:].mean()
    assert abs(gap.mean[0] - without) < abs(gap.mean[0] - SHAPE(10.0) - OFFSETS.mean())  # a gap moves its end only
    assert gap.mean[-1] == pytest.approx(c.mean[-1], abs=0.1)
    # four subjects are left at 10 Hz: Student's factor there is that of four
    assert gap.upper[0] - gap.mean[0] > stats.t.ppf(0.975, 3) * 0.8 * stats.sem(OFFSETS[1:])
    assert mean_curve(wild).mean.size == 0
    hole = mean_curve(rows[rows["frequency_hz"] != 40], F)  # recorded at 40 Hz, and no estimate there
    inside = (hole.frequency_hz > 35) & (hole.frequency_hz < 45)
    assert np.isnan(hole.mean[inside]).all() and np.isfinite(hole.mean[~inside]).all()
    assert np.isfinite(mean_curve(rows[rows["frequency_hz"] != 40]).mean).all()


def test_what_cannot_be_negative_has_the_curve_of_its_logarithm() -> None:
    """Geometric mean and Student's interval of the logarithms; straight means of such estimates fall below zero."""
    factors = np.exp([-2.0, 0.3, 0.1, 1.2, -0.7])
    values = {str(s): k * np.array([300, 200, 90, 30, 8, 2, 1, 4, 60.0]) for s, k in enumerate(factors)}
    rows = curve_rows("c_13", values, F)
    c = mean_curve(rows)
    log = np.array([spline(F, np.log(v), c.frequency_hz) for v in values.values()])
    low, high = stats.t.interval(0.95, 4, loc=log.mean(axis=0), scale=stats.sem(log, axis=0))
    assert c.mean == pytest.approx(np.exp(log.mean(axis=0)))
    assert c.lower == pytest.approx(np.exp(low))
    assert c.upper == pytest.approx(np.exp(high))
    assert c.lower.min() > 0
    assert mean_curve(rows.assign(parameter="c_12")).mean.min() < 0  # either sign


def test_estimates_at_a_bound_enter_no_mean() -> None:
    rows = curve_rows("k_T", {str(s): SHAPE(F) * (1 + s / 100) for s in range(8)}, F)
    bound = rows["subject"].isin(["5", "6"]) | ((rows["frequency_hz"] > 30) & (rows["subject"] > "2"))
    rows.loc[bound, "value"], rows.loc[bound, "std_error"] = 1e6, np.nan
    c, same = mean_curve(rows), mean_curve(rows[~bound])
    assert c.mean == pytest.approx(same.mean)
    assert c.mean.max() < 1.1 * SHAPE(F).max()
    assert np.isfinite(c.upper[c.frequency_hz < 30]).all()
    assert BAND == 4
    assert np.isnan(c.upper[c.frequency_hz > 30]).all()  # three subjects are left there
    rows.loc[rows["frequency_hz"] > 30, "std_error"] = np.nan
    assert mean_curve(rows).frequency_hz[-1] == 30.0


def test_the_tracked_branch_is_shown_where_there_is_one() -> None:
    def fit(number: int, *names: str, verdict: str = "undecided") -> dict[str, object]:
        e = {"k_T_n_per_m": (100.0 * number, 2.0, "weak")}
        made = plain("per-recording", str(number), 0.0, 10.0, dict.fromkeys(names, e))
        made["result"]["verdict"] = verdict
        return made

    ankle, pad = "stiff ankle", "stiff pad"
    fits = [fit(1, ankle, pad), fit(2, ankle, pad), fit(3, pad, ankle, verdict="decided"), fit(4, pad, ankle),
            fit(5, ankle, verdict="not compared"), fit(6, pad, ankle, verdict="decided")]  # fmt: skip
    tracked = dict(zip((d["key"] for d in fits), (pad, "undecided", ankle, pad), strict=False))
    found = [summary.displayed_branch(d, tracked) for d in fits]
    assert found == [(pad, "tracking"), (ankle, "undecided"), (ankle, "tracking"), (pad, "tracking"),
                     (ankle, "not compared"), (pad, "likelihood")]  # fmt: skip
    assert summary.displayed_branch(fits[0]) == (ankle, "undecided")
    assert summary.displayed_branch(fit(7, "best", verdict="not compared")) == ("best", "no mirror")
    table = summary.tidy(fits, tracked=tracked)
    rows = table[table["shown"]]
    assert rows["subject"].tolist() == ["1", "2", "3", "4", "5", "6"]
    assert rows["branch"].tolist() == [name for name, _ in found]
    assert rows["decided_by"].tolist() == [by for _, by in found]
    assert rows["chosen"].tolist() == [False, True, False, True, True, True]
    energy = summary.cycle_table(fits, tracked)
    assert energy["shown"].tolist() == [False, True, False, True, True, True]  # these fits have one cycle, their own
    assert [summary.displayed_fit(d, tracked) for d in fits] == [89.0, 90.0, 89.0, 90.0, 90.0, 90.0]


def test_outliers_are_sought_among_what_is_shown_and_measured() -> None:
    """The best branches agree; the tracked ones have one far off, and one at a bound that counts for nothing."""
    fits = [plain("per-recording", str(i), 0.0, 10.0, one(100.0 + i, other=10.0 + i)) for i in range(8)]
    for d in fits:
        d["result"]["branches"][1]["parameters"]["k_T_n_per_m"]["std_error"] = 1.0
    far, bound = (fits[i]["result"]["branches"][1]["parameters"]["k_T_n_per_m"] for i in (3, 5))
    far["value"] = 60.0
    bound |= {"value": 1e6, "std_error": None}
    table = summary.tidy(fits, tracked={d["key"]: "stiff pad" for d in fits})
    assert table.loc[table["outlier"], "value"].tolist() == [60.0]
    assert not summary.tidy(fits)["outlier"].any()


def test_only_what_allows_for_everything_else_may_say_identified() -> None:
    """By mode, fit, whether whatever else may be true was allowed for, own verdict and profile's."""
    wide, alone, poor = ({"fit_percent": fit, "world": w} for fit, w in ((97.0, {}), (97.0, None), (60.0, {})))
    for mode, branch, own, profile, said in (
        ("pooled", wide, "identified", None, "identified"),
        ("pooled", wide, "identified", "weak", "weak"),
        ("pooled", wide, "weak", "identified", "weak"),
        ("pooled", alone, "identified, if the model is true", None, "weak"),
        ("pooled", poor, "identified", None, "not identifiable"),
        ("per-recording", alone, "identified", "identified", "weak"),
        ("per-recording", alone, "not identifiable", None, "not identifiable"),
    ):
        assert summary.word(mode, branch, own, profile) == said


def test_one_set_of_constants_is_said_first() -> None:
    fits = [plain("pooled", str(i), 0.0, None, one(1.0)) for i in range(3)]
    for d, follows in zip(fits, (True, True, False), strict=True):
        d["result"]["branches"][0]["world"] = {"follows": follows}
    assert summary.one_set(fits[:2]) == (True, "One set of constants describes all frequencies in 2 of 2 pooled fits.")
    all_serve, sentence = summary.one_set(fits)
    assert not all_serve
    assert sentence.startswith("One set of constants describes all frequencies in 2 of 3 pooled fits: in the")
    assert summary.one_set([plain("per-recording", "1", 0.0, 10.0, one(1.0))]) == (True, "")


def test_what_matters_first_is_said_alone() -> None:
    """Constants that change are not said beside advice to search more; a poor fit is where one set serves."""

    def fit(mode: str, percent: float, follows: bool) -> dict[str, Any]:
        branch = {"name": "stiff ankle", "fit_percent": percent, "parameters": {}, "world": {"follows": follows}}
        where = {"mode": mode, "subject": "1", "posture": "midstance", "added_mass_kg": 0.0, "frequency_hz": None}
        return {**where, "status": "done", "key": f"{mode}{percent}", "result": {"branches": [branch], "verdict": ""}}

    changes = summary.first([fit("pooled", 60.0, False), fit("pooled", 99.0, True)])
    assert "1 of 2 pooled fits" in changes and "--starts" not in changes
    assert "--starts" in summary.first([fit("pooled", 60.0, True)])
    assert summary.first([fit("pooled", 99.0, True)]).endswith("1 of 1 pooled fits.")


@pytest.mark.parametrize(("chi_square", "measured"), [(19.0, True), (21.0, False)])
def test_a_recording_that_an_exact_model_misses_measures_nothing(chi_square: float, measured: bool) -> None:
    both = {name: {**e, "k_F_n_per_m": (50.0, 2.0, "weak")} for name, e in one(100.0).items()}
    fit = plain("per-recording", "1", 0.0, 10.0, both)
    fit["result"]["goodness_of_fit"] = {"chi_square": chi_square, "dof": 10}
    assert bool(summary.misfit(fit)) is not measured
    assert bool(summary.measured(summary.tidy([fit])).any()) is measured
    findings = Findings([fit])
    assert findings.subjects[0].sentence.startswith("No fit follows") is not measured
    assert ("--mode pooled" in findings.without_intervals) is not measured
