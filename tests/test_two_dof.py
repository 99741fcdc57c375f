"""The two-mass equations and their compiled twin against a second implementation, closed forms and differences."""

import numpy as np
import oracle
import pytest

from fasbody.foot import shaker
from fasbody.foot.stepper import trajectory
from fasbody.foot.two_dof import NAMES, TwoDof


def foot_of(p: dict[str, float]) -> TwoDof:
    return TwoDof.from_values({**oracle.MASSES, **p})


FREQUENCIES = np.linspace(5, 60, 23)


@pytest.mark.parametrize("name", oracle.FEET)
def test_trajectory_against_dop853(name: str) -> None:
    """From a displaced start, at a step so small that only the equations could differ."""
    foot, start = foot_of(oracle.FEET[name]), (5e-4, -8e-4, 0.05, -0.08)
    motion, h, n = shaker.sine(20.0, 0.1), 2e-5, 5000
    y, *_ = trajectory(np.array(start), foot.theta, foot.m_S, foot.m_F, motion.half_steps(h, n), h, 10, 0)
    want = oracle.malleolus(oracle.FEET[name], oracle.sine(20.0), np.arange(0, n, 10) * h, start=start)
    assert np.abs(y - want).max() < 1e-7 * np.abs(want).max()


def test_forces_and_output_are_those_of_equation_4_42() -> None:
    foot, x = foot_of(oracle.TRUTH), np.array([1e-3, -7e-4, 0.2, -0.1])
    f_T, f_F = foot.forces(x)
    assert f_T == pytest.approx(oracle.ankle_of(oracle.TRUTH)(x[0], x[2]), rel=1e-14)
    assert f_F == pytest.approx(oracle.pad_of(oracle.TRUTH)(x[1], x[3]), rel=1e-14)
    assert foot.output(x) == pytest.approx(-f_T / oracle.MASSES["m_S"], rel=1e-14)
    # the malleolus acceleration is also the sum of the relative ones and the base's
    z1_ddot, z2_ddot = foot.rates(0.0, x, 3.0)[2:]
    assert z1_ddot + z2_ddot + 3.0 == pytest.approx(foot.output(x), rel=1e-12)


def test_rates_balance_the_equations_before_them() -> None:
    """The print's 4.28, and 4.27 with the accelerations y'' that follow from the stretches."""
    foot, (z1, z2, v1, v2), u = foot_of(oracle.TRUTH), (1e-3, -7e-4, 0.2, -0.1), 3.0
    a1, a2 = foot.rates(0.0, np.array([z1, z2, v1, v2]), u)[2:]
    ankle, pad = oracle.ankle_of(oracle.TRUTH)(z1, v1), oracle.pad_of(oracle.TRUTH)(z2, v2)
    assert foot.m_S * (a1 + a2 + u) + ankle == pytest.approx(0.0, abs=1e-11 * abs(ankle))
    assert foot.m_F * (a2 + u) - ankle + pad == pytest.approx(0.0, abs=1e-11 * abs(ankle))


def test_state_space_is_the_tangent_of_the_rates_at_rest() -> None:
    foot = foot_of(oracle.TRUTH)
    A, B, C = foot.state_space()
    d = 1e-7 * np.eye(4)
    tangent = np.column_stack([(foot.rates(0, e, 0) - foot.rates(0, -e, 0)) / 2e-7 for e in d])
    np.testing.assert_allclose(A, tangent, rtol=1e-4, atol=1e-3)  # the square terms of the damper do not cancel fully
    np.testing.assert_allclose(B, foot.rates(0, np.zeros(4), 1.0), atol=0)
    np.testing.assert_allclose(C, [(foot.output(e) - foot.output(-e)) / 2e-7 for e in d], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", oracle.FEET)
def test_transmissibility_against_the_dynamic_stiffness(name: str) -> None:
    want = oracle.linear_response(oracle.FEET[name], FREQUENCIES)
    np.testing.assert_allclose(foot_of(oracle.FEET[name]).transmissibility(FREQUENCIES), want, rtol=1e-12)


@pytest.mark.parametrize("name", oracle.FEET)
@pytest.mark.parametrize("added", [0.0, 4.5])
def test_mirror_has_the_same_linear_response_and_is_its_own_inverse(name: str, added: float) -> None:
    p = {**oracle.MASSES, **oracle.FEET[name], "m_S": oracle.MASSES["m_S"] + added}
    foot = TwoDof.from_values(p)
    mirror = foot.mirror()
    image = {n: getattr(mirror, n) for n in (*NAMES, "m_S", "m_F")}
    assert abs(image["k_T"] / p["k_T"] - 1) > 0.01  # another foot
    want = oracle.linear_response(p, FREQUENCIES)
    assert np.abs(oracle.linear_response(image, FREQUENCIES) - want).max() < 1e-12 * np.abs(want).max()
    back = mirror.mirror()
    np.testing.assert_allclose([getattr(back, n) for n in NAMES], foot.theta, rtol=1e-14)


def test_mirror_of_another_load_is_another_foot() -> None:
    """The ratio a depends on m_S: the mirror of the unloaded foot does not respond like it under load."""
    mirror = foot_of(oracle.TRUTH).mirror()
    image = {n: getattr(mirror, n) for n in NAMES} | {"m_S": oracle.MASSES["m_S"] + 4.5}
    loaded = {**oracle.TRUTH, "m_S": oracle.MASSES["m_S"] + 4.5}
    difference = np.abs(oracle.linear_response(image, FREQUENCIES) - oracle.linear_response(loaded, FREQUENCIES)).max()
    assert difference > 0.01


@pytest.mark.parametrize("name", ["truth", "stiff"])
def test_sensitivities_against_central_differences(name: str) -> None:
    """Derivatives to states and parameters, against differences of a second solver's output."""
    foot, start = foot_of(oracle.FEET[name]), np.array([4e-4, -6e-4, 0.04, -0.06])
    h, n, stride = 1e-4, 600, 20
    motion = shaker.sine(25.0, n * h)
    _, DY, x, S = trajectory(start, foot.theta, foot.m_S, foot.m_F, motion.half_steps(h, n), h, stride, 12)
    t = np.arange(0, n, stride) * h

    def output(x0: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return oracle.malleolus(dict(zip(NAMES, theta, strict=True)), oracle.sine(25.0), t, start=tuple(x0), rtol=1e-12)

    for j, size in enumerate([1e-6, 1e-6, 1e-4, 1e-4]):
        d = size * np.eye(4)[j]
        want = (output(start + d, foot.theta) - output(start - d, foot.theta)) / (2 * size)
        assert np.abs(DY[:, j] - want).max() < 2e-5 * np.abs(want).max(), f"state {j}"
    for j, item in enumerate(NAMES):
        size = 1e-4 * max(abs(foot.theta[j]), 1.0)
        d = size * np.eye(8)[j]
        want = (output(start, foot.theta + d) - output(start, foot.theta - d)) / (2 * size)
        assert np.abs(DY[:, 4 + j] - want).max() < 2e-5 * np.abs(want).max(), item
    for j in range(4):  # final states: differences of the twin itself
        d = 1e-6 * np.eye(4)[j]
        u = motion.half_steps(h, n)
        ends = [trajectory(start + s * d, foot.theta, foot.m_S, foot.m_F, u, h, 1, 0)[2] for s in (1, -1)]
        np.testing.assert_allclose(S[:, j], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-6 * np.abs(S[:, j]).max())
    assert np.isfinite(x).all()


def test_columns_choose_what_is_differentiated() -> None:
    foot, motion = foot_of(oracle.TRUTH), shaker.sine(25.0, 0.01)
    arguments = (np.zeros(4), foot.theta, foot.m_S, foot.m_F, motion.half_steps(5e-4, 20), 5e-4, 1)
    full = trajectory(*arguments, 12)
    for columns in (0, 4):
        Y, DY, x, _ = trajectory(*arguments, columns)
        np.testing.assert_array_equal(Y, full[0])
        np.testing.assert_array_equal(x, full[2])
        np.testing.assert_array_equal(DY[:, :columns], full[1][:, :columns])
        assert not DY[:, columns:].any()
