"""Profile likelihood: against the parabola, a brute-force grid, and cases that are open-ended."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2
from study_cases import power_laws, study

from fasbody.exceptions import SettingError
from fasbody.foot.model import Foot
from identification.fitting import Settings
from identification.parameters import Space, space_of
from identification.study.profile import RISE, Place, Profile, profiles, profiles_of
from identification.study.validation import quick_fit


class Analytic:
    """A problem in closed form over the logarithms of k_T and k_F, r and J given."""

    def __init__(self, space: Space, residual, jacobian) -> None:  # type: ignore[no-untyped-def]
        self.residual, self.jacobian = residual, jacobian
        self.bounds = space.bounds
        self.places = [Place(item, i, lambda x: float(np.exp(x))) for i, item in enumerate(space.free)]

    def profiles(self, q: np.ndarray, *places: int, enough: bool = True) -> list[Profile]:
        """From the end of a descent from q."""
        end = least_squares(self.residual, q, self.jacobian, xtol=1e-12, ftol=1e-12, gtol=1e-12).x
        return profiles(self, [self.places[i] for i in places or (0, 1)], end, enough=enough)


@pytest.fixture(scope="module")
def plane(foot: Foot) -> Space:
    return space_of(foot, ("k_T", "k_F"), None, delay=False)


def test_rise_is_chi_square_of_one() -> None:
    assert pytest.approx(3.841459, abs=1e-6) == RISE


def test_quadratic_likelihood_gives_the_wald_interval(plane: Space) -> None:
    q0 = plane.to_q(np.array([1e5, 9e4]))
    A = np.array([[8.0, 3.0], [1.0, 9.0], [2.0, -4.0]])
    problem = Analytic(plane, lambda q: A @ (q - q0), lambda q: A)
    found = problem.profiles(q0 + 0.3)
    C = np.linalg.inv(A.T @ A)
    for j, profile in enumerate(found):
        half = np.sqrt(chi2.ppf(0.95, 1) * C[j, j])
        want = np.exp([q0[j] - half, q0[j] + half])
        np.testing.assert_allclose([profile.lower, profile.upper], want, rtol=2e-3)
        np.testing.assert_allclose(profile.wald, want, rtol=1e-3)
        assert not profile.departs
        assert not profile.open_below | profile.open_above | profile.better
        rise = np.array(profile.rises)
        want_rise = (np.log(profile.values) - q0[j]) ** 2 / C[j, j]
        np.testing.assert_allclose(rise, want_rise, atol=0.02)


def test_a_curved_valley_departs_from_wald_and_agrees_with_a_grid(plane: Space) -> None:
    """r = (x + 0.08 x^2, 3 (y - x^2)): the limits solve (x + 0.08 x^2)^2 = 3.84, by hand and on a grid."""
    q0 = plane.to_q(np.array([1e5, 9e4]))

    def residual(q: np.ndarray) -> np.ndarray:
        x, y = 4 * (q - q0)
        return np.array([x + 0.08 * x**2, 3 * (y - x**2), 0.0])

    def jacobian(q: np.ndarray) -> np.ndarray:
        x = 4 * (q[0] - q0[0])
        return 4 * np.array([[1 + 0.16 * x, 0.0], [-6 * x, 3.0], [0.0, 0.0]])

    problem = Analytic(plane, residual, jacobian)
    (profile,) = problem.profiles(q0 + 0.01, 0)
    root = np.sqrt(RISE)
    x = np.array([np.roots([0.08, 1, -root]).max(), np.roots([0.08, 1, root]).max()])  # upper, lower
    np.testing.assert_allclose(np.log([profile.upper, profile.lower]) - q0[0], x / 4, atol=2e-3)
    at = np.linspace(-3, 3, 601) / 4
    grid = np.array(
        [min(np.sum(residual(q0 + np.array([u, v])) ** 2) for v in np.linspace(0, 9, 901) / 4) for u in at[::10]]
    )
    inside = at[::10][grid < RISE]
    assert inside.min() == pytest.approx(np.log(profile.lower) - q0[0], abs=0.03)
    assert inside.max() == pytest.approx(np.log(profile.upper) - q0[0], abs=0.03)
    assert profile.departs


def test_a_parameter_that_saturates_is_open_ended(plane: Space) -> None:
    """Only a lower limit exists: 4 exp(-4 x) falls to zero and stays there."""
    q0 = plane.to_q(np.array([1.5e5, 9e4]))
    problem = Analytic(
        plane,
        lambda q: np.array([2 * np.exp(-4 * (q[0] - q0[0])) - 0.05, 5 * (q[1] - q0[1]), 0.0]),
        lambda q: np.array([[-8 * np.exp(-4 * (q[0] - q0[0])), 0.0], [0.0, 5.0], [0.0, 0.0]]),
    )
    (profile,) = problem.profiles(q0, 0)
    assert profile.open_above
    assert not profile.open_below
    assert profile.departs
    assert profile.verdict == "not identifiable"
    assert np.log(profile.lower) - q0[0] == pytest.approx(-np.log((np.sqrt(RISE) + 0.05) / 2) / 4, abs=0.01)


def foot_profiles(
    foot: Foot, frequencies: tuple[float, ...], names: tuple[str, ...], noise: float = 1.0
) -> list[Profile]:
    recordings = study(lambda f, m: power_laws(20.0, m), frequencies, (0.0,), seed=3, seconds=2.0, noise=noise)
    return profiles_of(quick_fit(recordings, foot, Settings(starts=2, delay=False)), names)


def test_five_frequencies_agree_with_wald_and_hold_the_truth(foot: Foot) -> None:
    truth = power_laws(20.0, 0.0)
    for profile in foot_profiles(foot, (10.0, 20.0, 30.0, 50.0), ("k_T", "c_21")):
        assert not profile.departs, profile
        assert profile.verdict == "identified"
        name = profile.key.split("_n_")[0]
        assert profile.lower * 0.99 < truth[name] < profile.upper * 1.01


@pytest.mark.long
def test_one_frequency_does_not_know_the_ankles_damping(foot: Foot) -> None:
    """The fundamental and faint harmonics against eight constants: what is held possible of a damper limits it."""
    (profile,) = foot_profiles(foot, (20.0,), ("c_11",), noise=5.0)
    assert profile.verdict == "not identifiable"
    assert profile.departs and profile.upper > 5 * profile.lower


def test_an_unknown_parameter_is_said(foot: Foot) -> None:
    with pytest.raises(SettingError, match="unknown parameter to profile 'k_X'"):
        foot_profiles(foot, (10.0, 20.0), ("k_X",))


def test_no_profile_identifies_where_numbers_are_no_more_than_parameters(plane: Space) -> None:
    q0 = plane.to_q(np.array([1e5, 9e4]))
    A = np.array([[80.0, 3.0], [1.0, 90.0], [2.0, -4.0]])
    problem = Analytic(plane, lambda q: A @ (q - q0), lambda q: A)
    verdicts = [[p.verdict for p in problem.profiles(q0 + 0.01, enough=enough)] for enough in (True, False)]
    assert verdicts == [["identified"] * 2, ["not identifiable"] * 2]


@pytest.mark.long
def test_numbers_that_are_no_more_than_the_constants_identify_none(foot: Foot) -> None:
    """Forty hertz has two harmonics below 100 Hz, so four numbers."""
    for free, enough in ((("k_T", "k_F", "c_11"), True), (("k_T", "k_F", "c_11", "c_21"), False)):
        fit = quick_fit(study(power_laws, (40.0,), (0.0,)), foot, Settings(free=free, starts=1, delay=False))
        words = {profile.verdict for profile in profiles_of(fit, ("k_T",))}
        assert fit.problem.size == 4 and (words == {"not identifiable"}) >= (not enough)
