"""The search space: transformations that undo each other, slopes against differences, bounds and their sentences."""

import numpy as np
import pytest

from fasbody.exceptions import SettingError
from fasbody.foot.model import Foot
from identification.parameters import DELAY, space_of

NAMES = ("k_T", "k_F", "c_11", "c_12", "c_13", "c_21", "c_22", "c_23")


def test_default_frees_all_but_the_masses_and_puts_the_delay_last(foot: Foot) -> None:
    space = space_of(foot)
    assert space.names == NAMES
    assert space.free[-1] is DELAY
    assert space.has_delay
    assert set(space.fixed) == {"m_S", "m_F"}
    assert not space_of(foot, delay=False).has_delay
    assert space_of(foot, ["delay", "k_F"]).names == ("k_F",)


def test_wild_starts_are_wild_but_inside(foot: Foot) -> None:
    space = space_of(foot, bounds={"c_12": (-10, 10)})
    rng = np.random.default_rng(0)
    theta = np.array([space.to_theta(space.random(rng)) for _ in range(200)])
    assert ((theta >= space.lower) & (theta <= space.upper)).all()
    k_F = theta[:, 1]
    assert k_F.max() / k_F.min() > 30


def test_intervals_are_symmetric_in_q_and_cut_at_the_bounds(foot: Foot) -> None:
    space = space_of(foot, ["k_T", "k_F", "c_12"], {"k_F": (9e4, 2e5)}, delay=False)
    theta = np.array([1e5, 1e5, 50.0])
    low, high = space.interval(theta, np.array([0.1, 0.1, np.nan]))
    assert np.log(high[0] / 1e5) == pytest.approx(0.1959964, rel=1e-6)
    assert np.log(1e5 / low[0]) == pytest.approx(0.1959964, rel=1e-6)
    assert (low[1], high[1]) == (pytest.approx(9e4), pytest.approx(1e5 * np.exp(0.1959964)))
    assert (low[2], high[2]) == (pytest.approx(-600), pytest.approx(600))


@pytest.mark.parametrize(
    ("free", "bounds", "sentence"),
    [
        (["k_X"], {}, "unknown parameter to estimate 'k_X'"),
        (["delay"], {}, "no parameter is free"),
        (["k_T"], {"k_F": (1e4, 2e4)}, "bounds are given for k_F, which is not free"),
        (["k_T"], {"k_T": (2e4, 1e4)}, "bounds of k_T are 20000:10000; give two positive numbers, the lower one first"),
        (["k_T"], {"k_T": (-1.0, 1e4)}, "give two positive numbers"),
        (["c_12"], {"c_12": (5.0, 5.0)}, "give two finite numbers, the lower one first"),
        (["k_T"], {"kT": (1e4, 2e4)}, "unknown parameter 'kT'"),
    ],
)
def test_what_cannot_be_meant(foot: Foot, free: list[str], bounds: dict, sentence: str) -> None:
    with pytest.raises(SettingError, match=sentence):
        space_of(foot, free, bounds)
