"""Replays and the fit percentage of the thesis."""

import numpy as np
import oracle
import pytest

from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Condition, Recording
from identification.certification import fit_percent, replay


def test_fit_percentage() -> None:
    """100 for a copy, 0 for the mean, negative for worse; noise of a tenth of the signal leaves 90."""
    y = np.sin(np.linspace(0, 60, 3000)) + 5
    assert fit_percent(y, y) == 100
    assert fit_percent(y, np.full_like(y, y.mean())) == pytest.approx(0)
    assert fit_percent(y, 2 * y.mean() - y) == pytest.approx(-100)
    noise = np.random.default_rng(0).normal(size=y.size)
    assert fit_percent(y, y + 0.1 * noise * np.linalg.norm(y - y.mean()) / np.linalg.norm(noise)) == pytest.approx(90)


def test_replay_of_a_transient_from_rest_is_the_recording(foot: Foot) -> None:
    """Two recordings of unlike length and load, with a delay, without noise: the traces are the oracle's."""
    recordings, delay = [], 3e-4
    for n, added in ((400, 0.0), (500, 4.5)):
        t = np.arange(n) / 1000
        condition = Condition("16", added_mass_kg=added, body_mass_kg=72.57)
        base = lambda s: 8.95 * np.sin(2 * np.pi * 20 * s) if s > 0 else 0.0  # noqa: E731
        y = oracle.malleolus({**oracle.TRUTH, **condition.masses}, base, t - delay)
        recordings.append(Recording(t, 8.95 * np.sin(2 * np.pi * 20 * t), y, condition=condition))
    values = {**oracle.TRUTH, **oracle.MASSES, "delay": delay}
    found = replay(foot, recordings, values, [np.zeros(4)] * 2, twin=True)
    for r, y in zip(recordings, found.traces, strict=True):
        assert np.abs(y - r.malleolus_m_s2)[3:].max() < 1e-3 * np.abs(y).max()
    assert min(found.fits) > 99.9
    assert found.base_error < 1e-6
    assert found.twin_difference is not None
    assert found.twin_difference < 1e-6
    assert replay(foot, recordings, values, [np.zeros(4)] * 2, twin=False).twin_difference is None
    assert checked(recordings[0]).condition.frequency_hz == pytest.approx(20, abs=0.01)


def test_one_period_in_mujoco_and_the_twin_are_the_whole_replay(foot: Foot) -> None:
    """Steady recordings: the same traces and fits as MuJoCo from end to end."""
    t = np.arange(600) / 1000
    rng = np.random.default_rng(0)
    recordings = []
    for f in (15.0, 40.0):
        condition = Condition("16", body_mass_kg=72.57, frequency_hz=f)
        base = 8.95 * np.sin(2 * np.pi * f * t) + 0.03 * rng.normal(size=t.size)
        recordings.append(Recording(t, base, base + rng.normal(size=t.size), condition=condition))
    values, starts = {**oracle.TRUTH, **oracle.MASSES, "delay": 2e-4}, [np.full(4, 1e-4)] * 2
    whole = replay(foot, recordings, values, starts, twin=True)
    for throughout in (0, 1):
        short = replay(foot, recordings, values, starts, twin=True, throughout=throughout)
        for y, other in zip(whole.traces, short.traces, strict=True):
            assert np.abs(y - other).max() < 1e-6 * np.abs(y).max()
        assert short.fits == pytest.approx(whole.fits, abs=1e-5)
        assert short.twin_difference is not None and short.twin_difference < 1e-6
    alone = replay(foot, recordings, values, starts, twin=False, throughout=0)  # MuJoCo runs all where it is alone
    assert alone.twin_difference is None and np.array_equal(alone.traces[1], whole.traces[1])
