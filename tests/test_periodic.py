"""Harmonic residuals: chi-square at the truth, exact Jacobian, and weights against the linear theory."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import oracle
import pytest
from scipy.stats import chi2

from fasbody.exceptions import RecordingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.engines.twin import Twin
from identification.estimate import fit_foot
from identification.periodic import Line, PeriodicProblem, split
from identification.search import explore, inverse_of_gram
from identification.space import space_of
from identification.wide import reweighed

FREQUENCIES = (10.0, 20.0, 30.0, 50.0)
LINEAR = {**oracle.TRUTH, "c_12": 0.0, "c_13": 0.0, "c_22": 0.0, "c_23": 0.0}


def lines(trial: Callable[..., Recording], p: dict = oracle.TRUTH, **more: object) -> list[Line]:
    return [Line.of(checked(trial(p, f, **more))) for f in FREQUENCIES]


def problem(foot: Foot, found: list[Line]) -> PeriodicProblem:
    return PeriodicProblem(found, Twin(foot, [line.excitation for line in found]), space_of(foot))


def test_lines_hold_the_harmonics_of_both_channels(trial: Callable[..., Recording]) -> None:
    found = Line.of(checked(trial(LINEAR, 20.0)))
    assert found.count == 5
    assert abs(found.base.amplitudes[0] + 8.95j) < 5e-3
    H = found.malleolus.amplitudes[0] / found.base.amplitudes[0]
    assert abs(H - oracle.linear_response(LINEAR, 20.0)[0]) < 5e-3
    assert {n: found.excitation.masses[n] for n in oracle.MASSES} == pytest.approx(oracle.MASSES)


def test_broadband_has_no_lines() -> None:
    rng, t = np.random.default_rng(0), np.arange(1000) / 1000
    r = Recording(t, rng.normal(0, 5, 1000), rng.normal(0, 5, 1000), file="x.csv")
    with pytest.raises(RecordingError, match=r"x\.csv: is not periodic, so it has no harmonics"):
        Line.of(checked(r))


def test_residual_at_the_truth_is_chi_square(foot: Foot, trial: Callable[..., Recording]) -> None:
    """Sums of squares over several noise seeds lie where the distribution says, one by one and together."""
    costs, size = [], 0
    for seed in range(6):
        made = problem(foot, lines(trial, seed=seed))
        q = made.space.to_q(made.space.theta(oracle.TRUTH))
        made.reweigh(q)
        r = made.residual(q)
        costs.append(r @ r)
        size = made.size
        assert r.size == size == 2 * (6 + 5 + 3 + 2)
    assert all(1e-4 < chi2.cdf(cost, size) < 1 - 1e-4 for cost in costs)
    assert 1e-3 < chi2.cdf(sum(costs), 6 * size) < 1 - 1e-3


def test_residual_of_a_wrong_foot_is_large(foot: Foot, trial: Callable[..., Recording]) -> None:
    made = problem(foot, lines(trial))
    q = made.space.to_q(made.space.theta({**oracle.TRUTH, "k_T": 1.25e5}))
    r = made.residual(q)
    assert r @ r > 10 * made.size


def test_jacobian_against_differences(foot: Foot, trial: Callable[..., Recording]) -> None:
    made = problem(foot, lines(trial))
    made.tolerance = 1e-11
    q = made.space.to_q(made.space.theta({**oracle.TRUTH, "c_12": 60.0, "delay": 2e-4}))
    J = made.jacobian(q).copy()
    for j, item in enumerate(made.space.free):
        d = 1e-5 * np.eye(q.size)[j]
        want = (made.residual(q + d) - made.residual(q - d)) / 2e-5
        assert np.abs(J[:, j] - want).max() < 1e-4 * np.abs(want).max(), item.name


def test_weights_of_a_linear_foot_are_sensor_noise_and_input_noise_through_its_response(
    foot: Foot, trial: Callable[..., Recording]
) -> None:
    """S = S_y + |H|^2 S_u at each harmonic, H from the dynamic stiffness."""
    made = problem(foot, lines(trial, LINEAR))
    q = made.space.to_q(made.space.theta(LINEAR))
    made.reweigh(q)
    for line, W in zip(made.lines, made._whiten, strict=True):
        S = np.linalg.inv(W.T @ W)
        H = oracle.linear_response(LINEAR, line.base.frequency_hz * np.arange(1, line.count + 1))
        want = np.tile(line.malleolus.std**2 + np.abs(H) ** 2 * line.base.std**2, 2)
        np.testing.assert_allclose(np.diag(S), want, rtol=2e-3)
        off = S - np.diag(np.diag(S))
        assert np.abs(off).max() < 1e-3 * want.max()


def test_log_determinant_is_that_of_the_covariance(foot: Foot, trial: Callable[..., Recording]) -> None:
    made = problem(foot, lines(trial))
    q = made.space.to_q(made.space.theta(oracle.TRUTH))
    made.reweigh(q)
    want = sum(np.linalg.slogdet(np.linalg.inv(W.T @ W))[1] for W in made._whiten)
    assert made.log_determinant == pytest.approx(want, rel=1e-9)


def test_delay_turns_the_phase(foot: Foot, trial: Callable[..., Recording]) -> None:
    made = problem(foot, lines(trial))
    made.tolerance = 1e-12
    q = made.space.to_q(made.space.theta({**oracle.TRUTH, "delay": 0.0}))
    late = made.space.to_q(made.space.theta({**oracle.TRUTH, "delay": 5e-4}))
    for line, a, b in zip(made.lines, made.predict(q), made.predict(late), strict=True):
        h = np.arange(1, line.count + 1)
        np.testing.assert_allclose(b / a, np.exp(-2j * np.pi * line.base.frequency_hz * h * 5e-4), rtol=1e-9)


def test_an_unstable_foot_has_a_large_residual_not_an_exception(foot: Foot, trial: Callable[..., Recording]) -> None:
    made = problem(foot, lines(trial))
    low, high = made.bounds
    q = made.space.to_q(made.space.theta(oracle.TRUTH))
    q[[0, 1]], q[[2, 5]] = low[[0, 1]], low[[2, 5]]
    q[[3, 6]] = high[[3, 6]]
    with np.errstate(all="ignore"):
        r = made.residual(q)
    assert np.isfinite(r).all()
    assert r @ r > 1e6


#: A foot whose ankle is too stiff for the integrator's stability at its usual step.
WITHOUT_MOTION = {
    "k_T": 8e7, "k_F": 1.5e4, "c_11": 1e3, "c_12": 0.0, "c_13": 0.1, "c_21": 700.0, "c_22": 100.0, "c_23": 400.0,
}  # fmt: skip


def test_a_point_without_a_motion_gives_no_weights_and_the_next_end_does(
    foot: Foot, trial: Callable[..., Recording]
) -> None:
    """A pooled fit whose best end had lost its orbit ended there; the weights are now those of the next end."""
    found = lines(trial)
    engine, space = Twin(foot, [line.excitation for line in found]), space_of(foot, None, {"k_T": (1e4, 1e8)})
    made, want = (PeriodicProblem(found, engine, space) for _ in range(2))
    lost, good = (space.to_q(space.theta(p)) for p in (WITHOUT_MOTION, oracle.TRUTH))
    before = [W.copy() for W in made._whiten]
    with pytest.raises(SimulationError, match=r"no periodic motion at 10 Hz with k_T = 8e\+07 N/m, k_F = "):
        made.reweigh(lost)
    assert all(np.array_equal(a, b) for a, b in zip(before, made._whiten, strict=True))  # none of some recordings only
    assert reweighed(made, [lost, good]) and not reweighed(made, [lost])
    want.reweigh(good)
    for a, b in zip(made._whiten, want._whiten, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9 * np.abs(b).max())


def test_only_where_every_start_is_lost_is_there_no_fit(foot: Foot, trial: Callable[..., Recording]) -> None:
    """A lost start is passed over; where none is left the sentence names constants, and not a vector."""
    recording = trial(oracle.TRUTH, 10.0)
    bounds = {name: (0.9 * value, 1.1 * value + 1e-9) for name, value in WITHOUT_MOTION.items()}
    with pytest.raises(SimulationError, match=r"none of 3 starts has a steady motion under .* \(.*: k_T = ") as told:
        fit_foot([recording], foot, starts=3, bounds=bounds, threads=1)
    assert "c_23 = " in str(told.value) and "[" not in str(told.value)
    millimetres = {"base_m_s2": 1e3 * recording.base_m_s2, "malleolus_m_s2": 1e3 * recording.malleolus_m_s2}
    named = replace(recording.with_channels(millimetres), file="mm.csv")
    with pytest.raises(SimulationError, match=r"^mm\.csv: the base amplitude is 8\.95e\+03 .* check its unit\. As"):
        fit_foot([named], foot, starts=3, bounds=bounds, threads=1)
    wider = bounds | {"k_T": (1e4, 1e8)}
    made = PeriodicProblem([Line.of(checked(recording))], Twin(foot, [Line.of(checked(recording)).excitation]),
                           space_of(foot, None, wider))  # fmt: skip
    starts = [made.space.to_q(made.space.theta(WITHOUT_MOTION | {"k_T": k_T})) for k_T in (8e7, 1e5)]
    descents, _ = explore(made, [("lost", starts[0]), ("good", starts[1])])
    assert [d.unstable for d in descents] == [False, True]


def test_split_and_inverse() -> None:
    np.testing.assert_array_equal(split(np.array([1 + 2j, 3 + 4j])), [1, 3, 2, 4])
    J = np.random.default_rng(0).normal(size=(20, 4))
    np.testing.assert_allclose(inverse_of_gram(J), np.linalg.inv(J.T @ J), rtol=1e-10)
    J[:, 2] = 0.0
    C = inverse_of_gram(J)
    assert np.isinf(C[2, 2])
    keep = [0, 1, 3]
    np.testing.assert_allclose(C[np.ix_(keep, keep)], np.linalg.inv(J[:, keep].T @ J[:, keep]), rtol=1e-10)


def test_parameters_at_their_bounds_have_no_covariance(foot: Foot, trial: Callable[..., Recording]) -> None:
    made = problem(foot, lines(trial))
    q = made.space.to_q(made.space.theta(oracle.TRUTH))
    active = np.ones(q.size, bool)
    active[4] = False
    C, J = made.covariance(q, active), made.jacobian(q)[:, active]
    assert np.isnan(C[4]).all()
    np.testing.assert_allclose(C[np.ix_(active, active)], np.linalg.inv(J.T @ J), rtol=1e-6)
