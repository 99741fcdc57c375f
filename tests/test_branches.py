"""The mirror solution and the verdict about it."""

import numpy as np
import oracle
import pytest

from identification.branches import (
    STIFF_ANKLE,
    STIFF_PAD,
    Recorded,
    has_mirror,
    judge,
    mirrored,
    pinned,
    ratio,
    side,
)

NAMES = [STIFF_ANKLE, STIFF_PAD]
A = oracle.MASSES["m_S"] / (oracle.MASSES["m_S"] + oracle.MASSES["m_F"])


def test_ratio_of_the_recordings_masses() -> None:
    assert ratio([oracle.MASSES], {}) == pytest.approx(0.0465 / (0.0465 + 0.0145), rel=1e-14)
    assert ratio([{}], oracle.MASSES) == pytest.approx(A)
    loaded = {**oracle.MASSES, "m_S": oracle.MASSES["m_S"] + 4.5}
    want = 0.5 * (A + loaded["m_S"] / (loaded["m_S"] + loaded["m_F"]))
    assert ratio([oracle.MASSES, loaded], {}) == pytest.approx(want)


@pytest.mark.parametrize("name", oracle.FEET)
def test_mirror_lies_on_the_other_side_with_the_same_linear_response(name: str) -> None:
    p = {**oracle.FEET[name], "delay": 1e-4}
    image = mirrored(p, A)
    f = np.linspace(5, 60, 20)
    want = oracle.linear_response(p, f)
    assert np.abs(oracle.linear_response(image, f) - want).max() < 1e-12 * np.abs(want).max()
    assert {side(p, A), side(image, A)} == {STIFF_ANKLE, STIFF_PAD}
    assert mirrored(image, A) == pytest.approx(p, rel=1e-12)
    assert image["delay"] == 1e-4


def test_a_mirror_needs_four_free_parameters() -> None:
    declared = {**oracle.TRUTH, **oracle.MASSES}
    assert has_mirror(["k_T", "k_F", "c_11", "c_21", "c_12"], declared) == ""
    assert "c_21 must be free for it" in has_mirror(["k_T", "k_F", "c_11"], declared)
    assert "no mirror solution that is known" in has_mirror(["k_T", "k_F", "c_11", "c_21"], ["k_T", "k_F"])


@pytest.mark.parametrize(
    ("recorded", "said", "unsaid"),
    [
        (Recorded(), "A second sensor, on the bones of the foot, usually decides. A second load can", "xcluding"),
        (Recorded(sensors=2), "A second load can decide", "bones"),
        (Recorded(loads=2), "separate them. A second sensor, on the bones of the foot, usually decides.", "--exclude"),
        (Recorded(loads=2, sensors=2), "The loads do not separate them.", "second"),
        (Recorded(loads=2, follow=True), "usually decides. Excluding", "second load"),
        (Recorded(loads=2, sensors=2, follow=True), "may find one branch. Excluding nuisance parameters", "second"),
    ],
)
def test_an_undecided_verdict_advises_what_was_not_done(recorded: Recorded, said: str, unsaid: str) -> None:
    text = judge([STIFF_ANKLE, STIFF_PAD], [100.0, 100.1], 40.0, 50, recorded=recorded).sentence
    assert said in text
    assert unsaid not in text


def test_a_bound_asks_for_a_second_load_only_where_there_is_one() -> None:
    asked = [judge([STIFF_ANKLE, STIFF_PAD], [0.0, 100.0], 40.0, 50, ["k_F"], Recorded(n)).sentence for n in (1, 2)]
    assert ["second load" in text for text in asked] == [True, False]


@pytest.mark.parametrize(("difference", "decided"), [(0.1, False), (13.7, False), (13.9, True), (400.0, True)])
def test_odds_of_a_thousand_decide(difference: float, decided: bool) -> None:
    """-2 log likelihood differs by 2 log(1000) = 13.8."""
    verdict = judge([STIFF_ANKLE, STIFF_PAD], [100.0, 100.0 + difference], 40.0, 50)
    assert verdict.word == ("decided" if decided else "undecided")
    assert verdict.log_likelihood_ratio == pytest.approx(difference / 2)
    assert ("A second load can" in verdict.sentence) is not decided
    assert not verdict.tied


def test_equal_likelihoods_are_tied_whichever_comes_first() -> None:
    """Rounding alone orders them; a millionth of a unit of log likelihood is no odds."""
    ankle_first, pad_first = (judge(names, [100.0, 100.0 + 1e-6], 40.0, 50) for names in (NAMES, NAMES[::-1]))
    assert ankle_first.tied and pad_first.tied
    assert ankle_first.sentence == pad_first.sentence
    assert "odds" not in ankle_first.sentence


def test_a_misfit_weakens_the_verdict() -> None:
    good, bad = (judge(["a", "b"], [0.0, 40.0], chi_square, 50) for chi_square in (50.0, 500.0))
    assert good.log_likelihood_ratio == pytest.approx(10 * bad.log_likelihood_ratio)
    assert good.word == "decided"
    assert bad.word == "undecided"


def test_a_branch_on_its_bound_is_not_decided_against() -> None:
    """Its likelihood is the bound's: beyond, it would fit better."""
    verdict = judge(NAMES, [100.0, 500.0], 40.0, 50, ["k_F"])
    assert verdict.word == "undecided" and verdict.log_likelihood_ratio == pytest.approx(200)
    assert "the stiff pad branch is limited by the bound of k_F" in verdict.sentence
    assert pinned({"k_F_n_per_m": True, "k_T_n_per_m": False, "c_12_per_m": True, "c_11_n_s_per_m": False}) == ["k_F"]


@pytest.mark.parametrize(("c", "rests"), [(1.0, []), (100.0, ["c_21"])])
def test_a_damper_on_zero_is_not_held_by_its_bound(c: float, rests: list[str]) -> None:
    at_bound = {"k_F_n_per_m": False, "c_21_n_s_per_m": True}
    assert pinned(at_bound, {"k_F_n_per_m": 9e4, "c_21_n_s_per_m": c}) == rests
