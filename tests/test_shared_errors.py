"""Gain and delay of the channels as study.toml states them: whitening by dense algebra, coverage of the intervals."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import oracle
import pytest
from scipy.stats import binom, chi2, multivariate_normal

from fasbody.foot.model import Foot
from fasbody.recording.channels import Channel
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording, gain_and_delay
from identification.certification import settle, standard_errors
from identification.domains import PeriodicDomain, TimeDomain
from identification.estimate import Settings, fit_foot
from identification.periodic import Line, PeriodicProblem, misfit, projection, shared_errors, split
from identification.search import descend
from identification.space import space_of

GAIN, DELAY_S = 0.01, 2e-4
STATED = {"malleolus": Channel(gain_std=0.6 * GAIN, delay_std_s=DELAY_S), "base": Channel(gain_std=0.8 * GAIN)}
FREE = ("k_T", "k_F")


def stated(recording: Recording, calibration: Mapping[str, Channel] = STATED) -> Recording:
    return replace(recording, calibration=calibration)


def problem(foot: Foot, recordings: list[Recording], delay: bool) -> PeriodicProblem:
    return PeriodicDomain(foot, recordings, space_of(foot, delay=delay), twin=True, threads=1).problem()


def test_uncertainties_of_two_channels_add_as_squares(trial: Callable[..., Recording]) -> None:
    recording = stated(trial(oracle.TRUTH, 20.0))
    assert gain_and_delay(recording, "malleolus", "base") == pytest.approx((GAIN, DELAY_S))
    assert gain_and_delay(recording, "malleolus", "tuberosity") == pytest.approx((0.6 * GAIN, DELAY_S))
    assert gain_and_delay(stated(recording, {}), "malleolus", "base") == (0.0, 0.0)


def test_projection_whitens() -> None:
    V = np.random.default_rng(0).normal(size=(12, 2)) * [30.0, 0.2]
    P = projection(V)
    W = np.eye(12) - P.T @ P
    np.testing.assert_allclose(W @ (np.eye(12) + V @ V.T) @ W.T, np.eye(12), atol=1e-11)
    assert P[0] @ P[1] == pytest.approx(0, abs=1e-14)
    assert projection(V[:, :0]).shape == (0, 12)


def test_shared_errors_are_what_a_gain_and_a_delay_do(trial: Callable[..., Recording]) -> None:
    """The harmonics of a channel made larger by 1 % and late by 0.2 ms, to first order."""
    plain = Line.of(checked(trial(oracle.TRUTH, 20.0, noise=(0, 0)))).malleolus.amplitudes
    V = shared_errors([stated(trial(oracle.TRUTH, 20.0))], [20.0], [plain], delay=True)
    late = Line.of(checked(trial(oracle.TRUTH, 20.0, noise=(0, 0), delay=1e-6))).malleolus.amplitudes
    np.testing.assert_allclose(V[:, 0], split(GAIN * plain))
    np.testing.assert_allclose(V[:, 1], split(late - plain) * DELAY_S / 1e-6, atol=2e-3 * np.abs(V[:, 1]).max())
    assert shared_errors([stated(trial(oracle.TRUTH, 20.0))], [20.0], [plain], delay=False).shape == (10, 1)


@pytest.mark.parametrize("delay", [False, True])
def test_likelihood_is_that_of_the_whole_covariance(foot: Foot, trial: Callable[..., Recording], delay: bool) -> None:
    """Two recordings of one pair of sensors: -2 log density of all harmonics together, by scipy."""
    recordings = [checked(stated(trial(oracle.TRUTH, f))) for f in (20.0, 30.0)]
    made = problem(foot, recordings, delay)
    q = made.space.to_q(made.space.theta({**oracle.TRUTH, "k_T": 1.33e5}))
    made.reweigh(q)
    Y = made.predict(q)
    error = np.concatenate([split(y - line.malleolus.amplitudes) for y, line in zip(Y, made.lines, strict=True)])
    S, row = np.zeros((error.size, error.size)), 0
    for i, line in enumerate(made.lines):
        rows = slice(row, row + 2 * line.count)
        S[rows, rows], row = made.noise(i), rows.stop
    rate = [-2j * np.pi * f * np.arange(1, y.size + 1) * y for f, y in zip((20.0, 30.0), Y, strict=True)]
    gain, late = (np.concatenate([split(y) for y in each]) for each in (Y, rate))
    S += GAIN**2 * np.outer(gain, gain) + (0.0 if delay else DELAY_S**2) * np.outer(late, late)
    r = made.residual(q)
    want = -2 * multivariate_normal(cov=S, allow_singular=True).logpdf(error) - error.size * np.log(2 * np.pi)
    assert r @ r + made.log_determinant == pytest.approx(want, rel=1e-6)
    assert r @ r == pytest.approx(error @ np.linalg.solve(S, error), rel=1e-6)
    quick = made.compiled()
    assert quick is not None
    assert quick.descend(q, 1e-8, 1e-9, 1)[1] == pytest.approx(r @ r, rel=1e-5)


def test_nothing_stated_changes_nothing(foot: Foot, trial: Callable[..., Recording]) -> None:
    recordings = [checked(trial(oracle.TRUTH, f)) for f in (20.0, 30.0)]
    made = problem(foot, recordings, True)
    q = made.space.to_q(made.space.theta(oracle.TRUTH))
    r, Y = made.residual(q), made.predict(q)
    plain = [W @ split(y - line.malleolus.amplitudes) for W, y, line in zip(made._whiten, Y, made.lines, strict=True)]
    np.testing.assert_allclose(r, np.concatenate(plain), rtol=1e-8)
    zero = problem(foot, [stated(r, {"malleolus": Channel()}) for r in recordings], True)
    np.testing.assert_array_equal(zero.residual(q), r)


def test_more_recordings_do_not_average_a_shared_gain_away(foot: Foot, trial: Callable[..., Recording]) -> None:
    """Nine recordings of a linear foot with one pair of sensors know it no better than three."""
    linear = {**oracle.TRUTH, **dict.fromkeys(("c_12", "c_13", "c_22", "c_23"), 0.0)}
    space = replace(space_of(foot, free=FREE, delay=False), fixed={**foot.values(), **linear})
    q = space.to_q(space.theta(linear))
    errors = {}
    for told in (STATED, {}):
        for seeds in (3, 9):
            data = [checked(stated(trial(linear, 20.0, seed=s), told)) for s in range(seeds)]
            made = PeriodicDomain(foot, data, space, twin=True, threads=1).problem()
            made.reweigh(q)
            errors[bool(told), seeds] = np.sqrt(np.diag(made.covariance(q, np.ones(2, bool))))
    assert errors[True, 9] == pytest.approx(errors[True, 3], rel=0.05)
    assert errors[False, 9] == pytest.approx(errors[False, 3] / np.sqrt(3), rel=0.2)


TRIALS = 80


@pytest.fixture(scope="module")
def covered(foot: Foot, trial: Callable[..., Recording]) -> dict[bool, tuple[np.ndarray, np.ndarray]]:
    """Stated or not -> (covered (n, 2) of k_T and k_F, chi-square (n,)): 20 Hz, random gain, delay and noise."""
    space = replace(space_of(foot, free=FREE, delay=False), fixed={**foot.values(), **oracle.TRUTH})
    truth = space.theta(oracle.TRUTH)
    rng = np.random.default_rng(11)
    found: dict[bool, tuple[list[np.ndarray], list[float]]] = {True: ([], []), False: ([], [])}
    for number in range(TRIALS):
        made = trial(oracle.TRUTH, 20.0, seed=number, seconds=1.0)
        gain, late = 1 + GAIN * rng.normal(), DELAY_S * rng.normal()
        line = Line.of(checked(made)).malleolus
        t = made.time_s - late
        exact = made.malleolus_m_s2
        for h, Y in enumerate(line.amplitudes, 1):  # move the harmonics, leave the noise
            turn = 2j * np.pi * h * line.frequency_hz
            exact = exact + (Y * (gain * np.exp(turn * t) - np.exp(turn * made.time_s))).real
        for told in (True, False) if number < 20 else (True,):
            data = checked(stated(replace(made, malleolus_m_s2=exact), STATED if told else {}))
            domain = PeriodicDomain(foot, [data], space, twin=True, threads=1)
            problem, end = settle(domain, descend(domain.problem(), space.to_q(truth), "truth"))
            _, covariance = standard_errors(problem, end, 0)  # not widened by the misfit
            low, high = space.interval(end.theta, np.sqrt(np.diag(covariance)))
            found[told][0].append((low <= truth) & (truth <= high))
            found[told][1].append(end.cost)
    return {told: (np.array(a), np.array(b)) for told, (a, b) in found.items()}


def test_intervals_cover_the_truth_as_often_as_they_say(covered: dict[bool, tuple[np.ndarray, np.ndarray]]) -> None:
    """95 % of 80 seeds, within what counting allows; without what study.toml states nearly none."""
    low, high = binom.ppf([1e-3, 1 - 1e-3], TRIALS, 0.95)
    for count in covered[True][0].sum(axis=0):
        assert low <= count <= high
    assert covered[False][0].mean() < 0.4


def test_misfit_of_a_stated_gain_and_delay_is_chi_square(covered: dict[bool, tuple[np.ndarray, np.ndarray]]) -> None:
    cost, dof = covered[True][1], 10 - 2
    assert 1e-3 < chi2.cdf(cost.sum(), dof * TRIALS) < 1 - 1e-3
    assert covered[False][1].mean() > 3 * dof


def test_the_time_domain_widens_its_errors_by_what_gain_and_delay_do(
    foot: Foot, trial: Callable[..., Recording]
) -> None:
    """Beside the noise: how far the estimate moves when the channel is 1 % larger, and when it is 0.2 ms late."""
    space = replace(space_of(foot, free=FREE, delay=False), fixed={**foot.values(), **oracle.TRUTH})
    q = space.to_q(space.theta(oracle.TRUTH))

    def fitted(recording: Recording, told: Mapping[str, Channel] = STATED) -> tuple[np.ndarray, np.ndarray]:
        made = TimeDomain(foot, [checked(stated(recording, told))], space, True, 1).problem()
        end = descend(made, q, "truth")
        return end.z[:2], np.sqrt(np.diag(made.covariance(end.z, np.ones(2, bool))))

    plain = trial(oracle.TRUTH, 20.0, seconds=2.0)
    here, std = fitted(plain)
    _, noise = fitted(plain, {})
    larger, _ = fitted(replace(plain, malleolus_m_s2=plain.malleolus_m_s2 * (1 + 0.1 * GAIN)))
    late, _ = fitted(trial(oracle.TRUTH, 20.0, seconds=2.0, delay=0.1 * DELAY_S))
    want = np.sqrt(noise**2 + (10 * (larger - here)) ** 2 + (10 * (late - here)) ** 2)
    assert std == pytest.approx(want, rel=0.05)
    assert (std > 1.5 * noise).all()


def test_misfit_is_where_noise_and_shared_errors_explain_what_is_left() -> None:
    rng = np.random.default_rng(3)
    V, r = rng.normal(size=(40, 2)) * [50.0, 20.0], 30.0 * rng.normal(size=40)
    x = misfit(r, V, 35)
    whole = np.linalg.inv(np.eye(40) + V @ V.T / x)
    assert x == pytest.approx(r @ whole @ r / 35, rel=1e-6) and x > 100
    assert misfit(V[:, 0] + 0.5 * rng.normal(size=40), V, 35) == 1.0  # a gain error as stated, and little noise
    assert misfit(0.0 * r, V, 0) == 1.0 and misfit(r, V, 0) > 1000  # all parameters cannot miss but astray


def test_a_model_that_misses_believes_no_gain(foot: Foot, trial: Callable[..., Recording]) -> None:
    """Stiffness that doubles from 10 to 40 Hz: fitted as one number, it must not turn to a wrong gain for help."""
    stiffer = [dict(oracle.TRUTH, k_F=k) for k in (6e4, 9.4e4, 1.4e5)]
    data = [trial(truth, f) for truth, f in zip(stiffer, (10.0, 20.0, 40.0), strict=True)]
    settings = Settings(free=("k_F", "c_21"), starts=2, threads=1)
    plain = fit_foot(data, foot, settings).branches[0]
    told = fit_foot([stated(each) for each in data], foot, settings).branches[0]
    assert plain.chi_square / plain.dof > 1000
    for name in ("k_F_n_per_m", "c_21_n_s_per_m"):
        a, b = plain.parameters[name], told.parameters[name]
        assert abs(a.value - b.value) < a.std_error
        assert b.std_error == pytest.approx(a.std_error, rel=0.5)
