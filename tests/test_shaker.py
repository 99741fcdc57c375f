"""Base motions against closed forms: what they are, and what the step's cubic makes of them."""

import numpy as np
import pytest
import thesis
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from fasbody.exceptions import SettingError
from fasbody.foot import shaker
from fasbody.foot.model import Foot
from fasbody.foot.simulate import simulate

MOTIONS = {
    "sine": shaker.sine(30.0, 1.0),
    "sweep": shaker.sweep(5.0, 60.0, 1.0),
    "multisine": shaker.multisine([11.0, 23.0, 37.0], 1.0, seed=3),
    "random": shaker.random(5.0, 60.0, 1.0, seed=3),
    "harmonics": shaker.harmonics(20.0, [-8.95j, 0.1 + 0.2j, 0.05], 1.0),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_jerk_is_the_derivative_of_the_acceleration(name: str) -> None:
    motion, t, d = MOTIONS[name], np.linspace(0.1, 0.9, 40), 1e-5
    slope = (motion.acceleration(t + d) - motion.acceleration(t - d)) / (2 * d)
    np.testing.assert_allclose(motion.jerk(t), slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize("name", MOTIONS)
def test_controls_follow_the_motion_to_fourth_order(name: str) -> None:
    motion = MOTIONS[name]

    def error(step: float) -> float:
        c = motion.controls(step, round(0.5 / step))[round(0.1 / step) :]
        s = 0.37 * step
        u = s / shaker.CLOCK
        have = c[:, 1] + u * (c[:, 2] + u * (c[:, 3] + u * c[:, 4]))
        return float(np.abs(have - motion.acceleration(c[:, 0] + s)).max())

    coarse, fine = error(1e-3), error(5e-4)
    assert coarse < 1e-3 * np.abs(motion.acceleration(np.linspace(0.1, 0.5, 400))).max()
    if name != "random":  # a spline: beyond its knots, the cubic is exact
        assert 12 < coarse / fine < 20


@pytest.mark.parametrize(("rate", "frequency"), [(500.0, 180.0), (250.0, 110.0), (500.0, 60.0)])
def test_coarse_samples_stand_for_the_band_limited_curve(rate: float, frequency: float) -> None:
    """A spline through three samples a period passes four fifths of a sine at worst."""
    t = np.arange(round(6 * rate)) / rate
    motion, fine = shaker.samples(t, np.sin(2 * np.pi * frequency * t)), np.linspace(1.0, 5.0, 20001)
    found, truth = motion.acceleration(fine), np.sin(2 * np.pi * frequency * fine)
    assert np.abs(found - truth).max() < 2e-5
    assert (
        np.abs(CubicSpline(t, np.sin(2 * np.pi * frequency * t))(fine) - truth).max() > 50 * np.abs(found - truth).max()
    )


def test_noise_at_four_kilohertz_moves_the_base(foot: Foot) -> None:
    """Its third derivative is 1e10 m/s^5 and more, beyond what MuJoCo takes for a control."""
    t = np.arange(400) / 4000
    values = np.random.default_rng(0).normal(0, 3, 400)
    motion = shaker.samples(t, values)
    controls = motion.controls(1 / 4000, 399)
    assert np.abs(controls[:, 4]).max() / shaker.CLOCK**3 > 1e10
    run = simulate(foot, motion, step=1 / 4000)
    np.testing.assert_allclose(run.base[0, :399], values[:399], atol=1e-6)


def test_sine_has_the_amplitude_of_the_thesis() -> None:
    t = np.arange(0, 1, 1e-4)
    values = shaker.sine(10.0, 1.0).acceleration(t)
    assert np.ptp(values) == pytest.approx(thesis.PEAK_TO_PEAK_M_S2, rel=1e-6)
    np.testing.assert_allclose(values, 0.5 * thesis.PEAK_TO_PEAK_M_S2 * np.sin(20 * np.pi * t), atol=1e-12)


def test_sweep_goes_from_start_to_stop() -> None:
    """Frequency from the zero crossings: linear between its ends."""
    motion = shaker.sweep(5.0, 60.0, 4.0)
    t = np.linspace(0, 4, 400_001)
    a = motion.acceleration(t)
    up = np.flatnonzero((a[:-1] < 0) & (a[1:] >= 0))
    crossing = t[up] - a[up] * (t[1] - t[0]) / (a[up + 1] - a[up])
    middle, frequency = 0.5 * (crossing[1:] + crossing[:-1]), 1 / np.diff(crossing)
    np.testing.assert_allclose(frequency, 5 + 55 * middle / 4, rtol=2e-3)


def test_multisine_has_its_lines_and_its_rms() -> None:
    t = np.arange(4000) / 4000
    values = MOTIONS["multisine"].acceleration(t)
    assert np.sqrt(np.mean(values**2)) == pytest.approx(6.3, rel=1e-9)
    size = 2 * np.abs(np.fft.rfft(values)) / 4000
    assert set(np.flatnonzero(size > 1e-6)) == {11, 23, 37}
    np.testing.assert_allclose(size[[11, 23, 37]], 6.3 * np.sqrt(2 / 3), rtol=1e-9)


def test_random_stays_in_its_band_and_has_its_rms() -> None:
    motion = shaker.random(10.0, 40.0, 8.0, rms=5.0, seed=1)
    values = motion.acceleration(np.arange(8 * 1000) / 1000)
    power = np.abs(np.fft.rfft(values)) ** 2
    f = np.fft.rfftfreq(values.size, 1e-3)
    inside = (f >= 10) & (f <= 40)
    assert power[inside].sum() > (1 - 1e-6) * power.sum()
    assert values.std() == pytest.approx(5.0, rel=1e-3)
    assert not np.allclose(values, shaker.random(10.0, 40.0, 8.0, rms=5.0, seed=2).acceleration(np.arange(8000) / 1000))


@given(frequency=st.floats(1, 100), size=st.floats(0.1, 50), phase=st.floats(0, 6.28))
@settings(max_examples=30)
def test_harmonics_are_complex_amplitudes(frequency: float, size: float, phase: float) -> None:
    t = np.linspace(0, 0.2, 50)
    motion = shaker.harmonics(frequency, [size * np.exp(1j * phase)], 0.2)
    want = size * np.cos(2 * np.pi * frequency * t + phase)
    np.testing.assert_allclose(motion.acceleration(t), want, atol=1e-9 * size)


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: shaker.sine(-1.0, 1.0), "frequency"),
        (lambda: shaker.sine(10.0, float("nan")), "duration"),
        (lambda: shaker.sweep(5.0, 60.0, 0.0), "duration"),
        (lambda: shaker.multisine([], 1.0), "positive frequencies"),
        (lambda: shaker.multisine([-3.0], 1.0), "positive frequencies"),
        (lambda: shaker.random(10.0, 11.0, 0.5), "band wider than 4 Hz"),
        (lambda: shaker.random(10.0, 40.0, 1.0, rms=-1.0), "rms"),
    ],
)
def test_impossible_motions_get_a_sentence(call, word: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SettingError, match=word):
        call()


def test_a_sine_is_known_at_one_moment_too() -> None:
    motion = shaker.sine(20.0, 1.0)
    at = motion.acceleration(np.array([0.0125]))[0]
    assert float(motion.acceleration(0.0125)) == float(motion.acceleration(np.float64(0.0125))) == at  # type: ignore[arg-type]
