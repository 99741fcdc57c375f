"""The thesis' rule and the one that shows what it claims, on panels of known shape and on chance."""

import numpy as np
import pytest
from scipy import stats

from fasbody.transmissibility.resonance import MARGIN, Resonance, _p_values, by_tests, by_thesis
from fasbody.transmissibility.statistics import paired

F = np.arange(10.0, 55, 5)
PEAK = np.array([1.0, 1.1, 1.2, 1.3, 1.4, 1.399, 1.3, 1.2, 1.1])
PLATEAU = np.array([1.5, 1.3, 1.3, 1.3, 1.2, 1.1, 1.0, 0.9, 0.8])
FALL = np.linspace(1.5, 0.7, 9)


def panel(mean: np.ndarray, spread: float, subjects: int = 20, seed: int = 8) -> np.ndarray:
    """Subjects of their own level and noise, whose mean over them is exactly `mean` up to a common constant."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, spread, (subjects, mean.size))
    return mean + noise - noise.mean(axis=0) + rng.normal(0, 0.2, (subjects, 1))


def found(r: Resonance) -> tuple[str, float, float]:
    return r.kind, r.low, r.high


def test_both_rules_find_peak_plateau_and_none() -> None:
    for rule in (by_thesis, by_tests):
        assert found(rule(F, panel(PEAK, 0.03))) == ("peak", 30, 35)
        assert found(rule(F, panel(PLATEAU, 0.03))) == ("plateau", 15, 25)
        assert rule(F, panel(FALL, 0.03)).kind == "none"
    assert by_thesis(F, panel(PEAK, 0.03)).top == 30
    assert str(by_thesis(F, panel(PLATEAU, 0.03))) == "plateau 15-25 Hz"


def test_too_little_power_makes_a_plateau_for_the_thesis_and_nothing_for_the_other() -> None:
    """A curve that falls steadily, five subjects and much noise: no difference is found between neighbours."""
    claimed = [by_thesis(F, panel(FALL, 0.15, 5, seed)).kind for seed in range(40)]
    right = [by_tests(F, panel(FALL, 0.15, 5, seed)).kind for seed in range(40)]
    assert claimed.count("plateau") == 37  # as docs/transmissibility.md says
    assert right.count("plateau") == right.count("peak") == 0 and right.count("undecided") >= 38


def test_false_peaks_are_as_rare_as_stated() -> None:
    """Flat curves: the highest of nine is chosen, and yet one in twenty at most is called a peak."""
    rng = np.random.default_rng(3)
    kinds = [by_tests(F, 1.2 + rng.normal(0, 0.05, (12, 9))).kind for _ in range(200)]
    assert kinds.count("peak") <= 16  # 5 % and two standard deviations
    assert kinds.count("none") == 0


def test_many_p_values_at_once_are_those_of_single_tests() -> None:
    x = panel(PEAK, 0.03)
    x[:, 3] = x[:, 2]
    i, j = np.triu_indices(9, 1)
    single = [paired(x[:, a], x[:, b]).p for a, b in zip(i, j, strict=True)]
    np.testing.assert_allclose(_p_values(x[:, i] - x[:, j]), single, rtol=1e-9)


def test_the_margin_decides_and_is_two_one_sided_tests() -> None:
    x = panel(PLATEAU, 0.03)
    assert by_tests(F, x, 0.001).kind == "undecided"
    block = x[:, 1:4]
    p = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        d, m = block[:, i] - block[:, j], MARGIN * block.mean()
        p += [
            stats.ttest_1samp(d, -m, alternative="greater").pvalue,
            stats.ttest_1samp(d, m, alternative="less").pvalue,
        ]
    assert max(p) < 0.05
    noisy = panel(PLATEAU, 0.2)
    d, m = noisy[:, 1] - noisy[:, 3], MARGIN * noisy[:, 1:4].mean()
    assert stats.ttest_1samp(d, m, alternative="less").pvalue > 0.05 and by_tests(F, noisy).kind != "plateau"


def test_untested_is_said_with_the_number_of_subjects() -> None:
    x = panel(PEAK, 0.03, 4)
    x[0, 3] = np.nan
    assert by_thesis(F, x).subjects == 3 and not by_thesis(F, x).left_out
    x[1, 5] = np.nan
    for rule in (by_thesis, by_tests):  # rather than two subjects, two frequencies are left out
        r = rule(F, x)
        assert (r.subjects, r.left_out) == (4, (25.0, 35.0)) and str(r).endswith("2 frequencies left out")
    x[:2] = np.nan
    for rule in (by_thesis, by_tests):
        assert str(rule(F, x)) == "not tested (n = 2)"
        assert not rule(F, x).has_range
        assert str(rule(F[:2], panel(PEAK[:2], 0.03))) == "not tested (2 frequencies)"


def test_one_frequency_is_no_range_and_places_decide_what_confirms() -> None:
    assert str(Resonance("peak", 10, 10, 10)) == "peak 10 Hz" and str(Resonance("peak", 10, 15, 10)) == "peak 10-15 Hz"
    peak = Resonance("peak", 30, 35, 35)
    assert Resonance("peak", 25, 30, 30).confirms(peak)
    for other in (Resonance("peak", 10, 15, 10), Resonance("plateau", 30, 35, 30), Resonance("undecided")):
        assert not other.confirms(peak)


def test_a_rise_within_ends_a_plateau() -> None:
    """Section 2.3.1: neighbours that do not differ. A greater one further on is no part of it."""
    rise = np.array([1.6, 1.3, 1.3, 1.3, 1.5, 1.3, 1.1, 1.0, 0.9])
    r = by_thesis(F, panel(rise, 0.03))
    assert r.kind != "plateau" or not r.low <= 30 <= r.high


@pytest.mark.parametrize("rule", [by_thesis, by_tests])
def test_flat_to_the_end_is_no_plateau(rule) -> None:  # type: ignore[no-untyped-def]
    flat = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert rule(F, panel(flat, 0.01)).kind in ("none", "undecided")
