"""Time-domain residuals: derivatives, lossless compression, noise, and a sweep that gives the truth."""

import numpy as np
import oracle
import pytest
from scipy.linalg import toeplitz

from fasbody.foot import shaker
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Condition, Recording
from identification.engines.engine import Whole
from identification.engines.mujoco import Rollouts
from identification.engines.twin import Twin
from identification.fitting import Settings, fit_foot
from identification.parameters import space_of
from identification.time_problem import TimeProblem, _correlated, noise_floor

TRUTH = {name: float(value) for name, value in oracle.TRUTH.items()}


def sweep(seconds: float, seed: int = 0, noise: tuple[float, float] = (0.03, 0.05), delay: float = 2e-4) -> Recording:
    """From rest through 5 to 60 Hz, the malleolus channel late by `delay`, 1 kHz."""
    motion = shaker.sweep(5.0, 60.0, seconds)
    t = np.arange(round(seconds * 1000)) / 1000
    phase = lambda s: 2 * np.pi * (5 + 0.5 * 55 / seconds * s) * s  # noqa: E731
    base = lambda s: 8.95 * np.sin(phase(s)) if s > 0 else 0.0  # noqa: E731
    y = oracle.malleolus(TRUTH, base, t - delay, rtol=1e-9)
    rng = np.random.default_rng(seed)
    a = motion.acceleration(t) + rng.normal(0, noise[0], t.size)
    y = y + rng.normal(0, noise[1], t.size)
    return Recording(t, a, y, condition=Condition("16", body_mass_kg=72.57), file="sweep.csv")


@pytest.fixture(scope="module")
def short() -> Recording:
    return checked(sweep(0.4))


def problem(foot: Foot, recording: Recording, rollouts: bool = False) -> TimeProblem:
    space = space_of(foot)
    drives = [Whole.of(recording, foot)]
    engine = Rollouts(foot, drives, space.names) if rollouts else Twin(foot, drives)
    return TimeProblem([recording], engine, space)


def point(p: TimeProblem) -> np.ndarray:
    z = p.start(p.space.to_q(p.space.theta({**TRUTH, "delay": 1e-4})))
    z[-4:] = [0.2, -0.3, 0.1, 0.4]
    return z


def test_grid_divides_the_sampling_interval(foot: Foot, short: Recording) -> None:
    def grid(recording: Recording, foot: Foot) -> tuple[float, int, int]:
        whole = Whole.of(recording, foot)
        return whole.step, whole.steps, whole.stride

    assert grid(short, foot) == (pytest.approx(5e-4), 800, 2)
    slow = Recording(np.arange(100) / 300, *np.zeros((2, 100)))
    assert grid(slow, foot) == (pytest.approx(1 / 2100), 700, 7)
    assert grid(short, foot.with_values({}, step=1.5e-4)) == (pytest.approx(1e-3 / 7), 2800, 7)


def test_rows_against_differences(foot: Foot, short: Recording) -> None:
    p = problem(foot, short)
    z = point(p)
    _, r, J = p.rows(z, 0)
    assert r.size == short.time_s.size
    for j in range(z.size):
        d = 1e-5 * np.eye(z.size)[j]
        want = (p.rows(z + d, 0)[1] - p.rows(z - d, 0)[1]) / 2e-5
        assert np.abs(J[:, j] - want).max() < 1e-4 * np.abs(want).max(), j


def test_both_engines_give_the_same_rows(foot: Foot, short: Recording) -> None:
    p, m = problem(foot, short), problem(foot, short, rollouts=True)
    z = point(p)
    (y, r, J), (y_m, r_m, J_m) = p.rows(z, 0), m.rows(z, 0)
    assert np.abs(y - y_m).max() < 1e-6 * np.abs(y).max()
    assert np.abs(r - r_m).max() < 1e-3
    assert (np.abs(J - J_m).max(axis=0) < 1e-3 * np.abs(J).max(axis=0)).all()


def test_output_is_that_of_a_second_solver(foot: Foot) -> None:
    """Without noise the model's output at the truth is the recording, so the residual is the solver's error."""
    r = sweep(0.4, noise=(0.0, 0.0))
    p = problem(foot, r)
    z = p.start(p.space.to_q(p.space.theta({**TRUTH, "delay": 2e-4})))
    y, *_ = p.rows(z, 0)
    assert np.abs(y - r.malleolus_m_s2)[1:].max() < 1e-3 * np.abs(y).max()  # the first one lies before t = 0


def test_compression_keeps_cost_gradient_and_step(foot: Foot, short: Recording) -> None:
    p = problem(foot, short)
    z = point(p)
    _, r, J = p.rows(z, 0)
    R, JR = p.residual(z), p.jacobian(z)
    assert R.size < 20 < r.size == p.size
    assert pytest.approx(r @ r, rel=1e-10) == R @ R
    np.testing.assert_allclose(JR.T @ R, J.T @ r, rtol=1e-7, atol=1e-7 * np.abs(J.T @ r).max())
    np.testing.assert_allclose(JR.T @ JR, J.T @ J, rtol=1e-7, atol=1e-9 * np.abs(J.T @ J).max())


def test_noise_floor_is_the_noise(foot: Foot) -> None:
    found = [noise_floor(sweep(1.0, seed)) for seed in range(2)]
    clean = sweep(1.0, noise=(0.0, 0.0))
    gain = clean.malleolus_m_s2.std() / clean.base_m_s2.std()
    assert np.mean(found) == pytest.approx(np.hypot(0.05, gain * 0.03), rel=0.1)


def test_correlated_is_the_toeplitz_product() -> None:
    rng = np.random.default_rng(0)
    r, J = rng.normal(size=400), rng.normal(size=(400, 3))
    lags = 20
    auto = np.array([r[: r.size - k] @ r[k:] for k in range(lags)]) / r.size * (1 - np.arange(lags) / lags)
    R = toeplitz(np.concatenate([auto, np.zeros(r.size - lags)]))
    np.testing.assert_allclose(_correlated(r, J), R @ J, atol=1e-10)


@pytest.mark.parametrize("seed", [1])
def test_a_sweep_gives_the_truth_inside_its_intervals(foot: Foot, seed: int) -> None:
    free = ("k_T", "k_F", "c_11", "c_12", "c_21", "c_22", "c_23")
    start = foot.with_values({"c_13": TRUTH["c_13"]})
    result = fit_foot([sweep(2.0, seed)], start, Settings(free=free, starts=2))
    assert result.domain == "time"
    assert result.twin_mujoco_difference is not None
    assert result.twin_mujoco_difference < 1e-6
    assert result.best.name == "stiff ankle"
    for key, e in result.parameters.items():
        truth = {**TRUTH, "delay": 2e-4}[next(n for n in (*TRUTH, "delay") if key.startswith(n))]
        assert abs(e.value - truth) < 3 * e.std_error, f"{key}: {e}"
        assert e.lower < e.value < e.upper
    p = result.parameters
    assert p["k_T_n_per_m"].value == pytest.approx(TRUTH["k_T"], rel=0.03)
    assert p["k_F_n_per_m"].value == pytest.approx(TRUTH["k_F"], rel=0.03)
    assert result.fit_percent > 98
    assert result.branches[1].cost > result.best.cost
