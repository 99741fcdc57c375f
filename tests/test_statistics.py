"""The tests of section 2.3 against formulas written out, simulation and the libraries' other routes."""

import numpy as np
import pandas as pd
import pytest
import statsmodels.formula.api as smf
from scipy import stats
from statsmodels.stats.anova import AnovaRM, anova_lm
from statsmodels.stats.multitest import multipletests

from fasbody.exceptions import RecordingError
from fasbody.transmissibility import statistics

RNG = np.random.default_rng(5)
LEVELS = RNG.normal(1.2, 0.1, (20, 1)) + np.array([0.0, 0.03, 0.08]) + RNG.normal(0, 0.05, (20, 3))


def test_paired_t_by_hand() -> None:
    a, b = LEVELS[:, 2], LEVELS[:, 0]
    d = a - b
    t = d.mean() / (d.std(ddof=1) / np.sqrt(20))
    c = statistics.paired(a, b)
    assert c.p == pytest.approx(2 * stats.t.sf(abs(t), 19))
    assert (c.difference, c.effect) == (pytest.approx(d.mean()), pytest.approx(t / np.sqrt(20)))
    assert c.verdict == "above" and c.lower < d.mean() < c.upper
    assert statistics.paired(b, a).verdict == "below"


def test_confidence_interval_covers_in_95_of_100() -> None:
    rng = np.random.default_rng(6)
    inside = [c.lower < 0.1 < c.upper for c in (statistics.one_sample(rng.normal(1.1, 0.2, 12)) for _ in range(2000))]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def test_one_way_between_two_levels_is_the_t_test_squared() -> None:
    v = statistics.one_way(LEVELS[:, :2])
    t = stats.ttest_ind(LEVELS[:, 0], LEVELS[:, 1])
    assert (v.F, v.p) == (pytest.approx(t.statistic**2), pytest.approx(t.pvalue))
    assert v.effect == pytest.approx(t.statistic**2 / (t.statistic**2 + 38))


def test_repeated_measures_between_two_levels_is_the_paired_t_test() -> None:
    v = statistics.repeated_measures(LEVELS[:, :2])
    t = stats.ttest_rel(LEVELS[:, 0], LEVELS[:, 1])
    assert (v.F, v.p, v.epsilon) == (pytest.approx(t.statistic**2), pytest.approx(t.pvalue), 1.0)


def test_repeated_measures_sees_what_subjects_hide_from_the_one_way_test() -> None:
    assert statistics.one_way(LEVELS).p > statistics.repeated_measures(LEVELS).p
    assert statistics.repeated_measures(LEVELS).p < 1e-4


def test_greenhouse_geisser_keeps_the_level_where_sphericity_fails() -> None:
    rng = np.random.default_rng(7)
    spread = np.array([0.01, 0.01, 0.3, 0.3])
    tests = [statistics.repeated_measures(rng.normal(0, spread, (12, 4))) for _ in range(200)]
    plain = [stats.f.sf(v.F, 3, 33) for v in tests]
    corrected = np.mean([v.p < 0.05 for v in tests])
    assert corrected == pytest.approx(0.05, abs=0.035)
    assert np.mean(np.array(plain) < 0.05) > corrected
    assert all(1 / 3 <= v.epsilon <= 1 for v in tests)


def test_without_gaps_it_is_the_repeated_measures_analysis_of_statsmodels() -> None:
    frame = pd.DataFrame(
        {"y": LEVELS.ravel(), "s": np.repeat(np.arange(20), 3), "level": np.tile(np.arange(3), 20).astype(str)}
    )
    F = float(AnovaRM(frame, "y", "s", within=["level"]).fit().anova_table["F Value"].iloc[0])
    v = statistics.repeated_measures(LEVELS)
    assert (v.F, v.effect) == (pytest.approx(F, rel=1e-9), pytest.approx(F / (F + 19), rel=1e-9))
    assert v.p == pytest.approx(stats.f.sf(F, 2 * v.epsilon, 38 * v.epsilon), rel=1e-9)
    assert (v.subjects, v.test) == (20, "repeated-measures ANOVA")
    unmeasured = np.vstack([LEVELS, np.full((3, 3), np.nan), [[1.2, np.nan, np.nan]]])
    assert statistics.repeated_measures(unmeasured) == v  # a subject that compares nothing changes and counts nothing


def test_with_gaps_is_the_analysis_of_variance_of_statsmodels() -> None:
    gaps = with_holes(LEVELS, (3, 1), (7, 2))
    frame = pd.DataFrame(
        {"y": gaps.ravel(), "s": np.repeat(np.arange(20), 3), "level": np.tile(np.arange(3), 20)}
    ).dropna()
    table = anova_lm(smf.ols("y ~ C(s) + C(level)", frame).fit(), typ=2)
    v = statistics.repeated_measures(gaps)
    assert pytest.approx(table.loc["C(level)", "F"]) == v.F
    assert table.loc["Residual", "df"] == 58 - 20 - 2
    whole = np.isfinite(gaps).all(axis=1)
    assert v.epsilon == pytest.approx(statistics.repeated_measures(gaps[whole]).epsilon)
    assert v.p == pytest.approx(stats.f.sf(v.F, 2 * v.epsilon, 36 * v.epsilon))
    assert (v.subjects, v.test) == (20, "repeated-measures ANOVA with gaps")


@pytest.mark.long
@pytest.mark.parametrize(
    ("subjects", "holes", "slope", "least", "most"),
    [
        (5, ((1, 1),), 0.0, 0.015, 0.055),
        (5, ((1, 1),), 1.0, 0.015, 0.08),
        (20, ((1, 1), (4, 0), (9, 2)), 0.0, 0.035, 0.06),
        (20, ((1, 1), (4, 0), (9, 2)), 1.0, 0.035, 0.065),
        (4, ((0, 0), (1, 1), (2, 2)), 0.0, 0.0, 0.03),
    ],
)
def test_with_gaps_keeps_its_level_without_any_difference(
    subjects: int, holes: tuple[tuple[int, int], ...], slope: float, least: float, most: float
) -> None:
    """Panels without a difference between levels; also where subjects differ in how they respond (no sphericity)."""
    rng = np.random.default_rng(11)
    hits = []
    for _ in range(2000):
        x = rng.normal(0, 0.3, (subjects, 1)) + rng.normal(0, 0.03, (subjects, 3))
        x += slope * rng.normal(0, 0.1, (subjects, 1)) * np.array([0, 0.5, 1])
        hits.append(statistics.repeated_measures(with_holes(x, *holes)).p < 0.05)
    assert least <= np.mean(hits) <= most


def with_holes(x: np.ndarray, *places: tuple[int, int]) -> np.ndarray:
    x = x.copy()
    for place in places:
        x[place] = np.nan
    return x


def test_levels_that_nothing_connects_are_not_compared() -> None:
    apart = np.full((6, 4), np.nan)
    apart[:3, :2], apart[3:, 2:] = LEVELS[:3, :2], LEVELS[3:6, :2]
    with pytest.raises(RecordingError, match="connected by subjects"):
        statistics.repeated_measures(apart)
    with pytest.raises(RecordingError, match="at two levels, not 2"):
        statistics.repeated_measures(with_holes(LEVELS[:3], (0, 0), (0, 1)))


def test_holm_by_hand() -> None:
    assert statistics.holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])


def test_holm_equals_statsmodels() -> None:
    p = RNG.uniform(0, 0.2, 36)
    np.testing.assert_allclose(statistics.holm(p), multipletests(p, method="holm")[1], rtol=1e-12)
