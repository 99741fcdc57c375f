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
