"""The tidy table, outliers by the thesis' quartiles, energies, and the spline curves with their bands."""

from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_fits import failed, plain
from scipy import stats

from fasbody.exceptions import InputFileError
from identification.study import summary
from identification.study.means import mean_curve, spline


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


def test_points_of_a_trend_are_rows_with_their_condition() -> None:
    def point(f: float, load: float, value: float) -> dict[str, object]:
        e = {"value": value, "std_error": 1.0, "lower": 0.0, "upper": 9.0, "identifiability": "identified"}
        return {"frequency_hz": f, "added_mass_kg": load, "parameters": {"c_11_n_s_per_m": e}}

    document = plain("trend", "3", None, None, {"stiff ankle": {}})
    document["result"]["branches"] = [{"name": "stiff ankle", "points": [point(10, 0, 5), point(20, 2.3, 7)]}]
    table = summary.tidy([document])
    assert table[["added_mass_kg", "frequency_hz", "value"]].to_numpy().tolist() == [[0, 10, 5], [2.3, 20, 7]]
    assert set(table["unit"]) == {"N s/m"}


def test_csv_comes_back() -> None:
    table = summary.tidy([plain("per-recording", "1", 0.0, 12.5, one(1 / 3))])
    back = pd.read_csv(StringIO(summary.csv(table)), dtype={"subject": str})
    assert back["value"].tolist() == pytest.approx(table["value"].tolist(), rel=1e-7)
    assert back["chosen"].tolist() == [True, False]
    assert back["frequency_hz"].tolist() == [12.5, 12.5]


def test_counts_and_energies() -> None:
    good = [plain("per-recording", str(i), 0.0, 10.02, one(1.0)) for i in range(3)]
    good[0]["result"] |= {"verdict": "decided", "fit_percent": 60.0}
    counts = summary.counts([*good, failed("8", "broken"), plain("pooled", "1", 0.0, None, one(1.0))])
    first, second = counts.to_dict("records")
    assert (first["fits"], first["done"], first["failed"], first["recordings"]) == (4, 3, 1, 3)
    assert (first["decided"], first["undecided"], first["fit_percent"]) == (1, 2, pytest.approx(80.0))
    assert second["mode"] == "pooled"
    energy = summary.cycle_table([*good, failed("8", "broken")])
    assert len(energy) == 3
    assert set(energy["frequency_hz"]) == {10.0}  # what was set, not what was found
    assert energy["fat_pad_j"].to_numpy() == pytest.approx(3 * energy["ankle_j"].to_numpy())


def test_a_broken_fit_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"status": "done", "mode": "pooled"}')
    assert summary.read_fits(tmp_path) == [{"status": "done", "mode": "pooled"}]
    (tmp_path / "b.json").write_text('{"status": ')
    with pytest.raises(InputFileError, match=r"b\.json.*not a fit"):
        summary.read_fits(tmp_path)


def test_spline_reproduces_a_cubic_and_smooths_noise() -> None:
    f, at = np.arange(10.0, 55.0, 5.0), np.linspace(10, 50, 33)
    cubic = np.polynomial.Polynomial([3.0, -0.2, 0.01, -1e-4])
    assert spline(f[::-1], cubic(f)[::-1], at) == pytest.approx(cubic(at), rel=1e-9)
    assert spline(f[:3], cubic(f[:3]), at)[:3] == pytest.approx(np.polyval(np.polyfit(f[:3], cubic(f[:3]), 2), at[:3]))
    assert np.isnan(spline(f[2:], cubic(f[2:]), at)[at < 20]).all()  # never beyond a subject's own frequencies
    noise = np.random.default_rng(0).normal(0, 1, f.size)
    assert np.std(spline(f, noise, f)) < 0.9 * np.std(noise)


def test_band_is_students_interval_of_the_subjects() -> None:
    f = np.arange(10.0, 55.0, 5.0)
    shape = np.polynomial.Polynomial([100.0, 2.0, -0.01])
    offsets = np.array([-9.0, 4.0, 1.0, 7.0, 2.0])
    rows = pd.DataFrame(
        [(str(s), x, shape(x) + o, False) for s, o in enumerate(offsets) for x in f]
        + [("wild", x, 1e9, True) for x in f],
        columns=["subject", "frequency_hz", "value", "outlier"],
    )
    c = mean_curve(rows)
    low, high = stats.t.interval(0.95, 4, loc=offsets.mean(), scale=stats.sem(offsets))
    assert c.mean == pytest.approx(shape(c.frequency_hz) + offsets.mean())
    assert c.lower == pytest.approx(shape(c.frequency_hz) + low)
    assert c.upper == pytest.approx(shape(c.frequency_hz) + high)
    two = mean_curve(rows[rows["subject"].isin(["0", "1"])])
    assert np.isnan(two.lower).all()  # two subjects have a mean, but no interval worth showing
    assert two.mean == pytest.approx(shape(two.frequency_hz) + offsets[:2].mean())
    gap = mean_curve(rows[~((rows["subject"] == "0") & (rows["frequency_hz"] == 10))])
    without = shape(10.0) + offsets[1:].mean()
    assert abs(gap.mean[0] - without) < abs(gap.mean[0] - shape(10.0) - offsets.mean())  # a gap moves its own end only
    assert gap.mean[-1] == pytest.approx(c.mean[-1], abs=0.1)
    assert mean_curve(rows[rows["outlier"]]).mean.size == 0
