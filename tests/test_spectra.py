"""Cross-spectra against definitions summed term by term and against known systems."""

import numpy as np
import pytest
from scipy.signal import lfilter

from fasbody.exceptions import RecordingError
from fasbody.recording.harmonics import fit_harmonics
from fasbody.transmissibility.spectra import cross_covariance, cross_spectrum, h1


def test_cross_covariance_is_the_printed_sum() -> None:
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=40), rng.normal(size=40)
    x0, y0 = x - x.mean(), y - y.mean()
    printed = [sum(x0[i] * y0[i + k] for i in range(40 - k)) / 40 for k in range(40)]
    assert cross_covariance(x, y) == pytest.approx(np.array(printed), abs=1e-12)


@pytest.mark.parametrize("f", [10.0, 17.3, 50.0])
def test_phase_equals_the_sine_fit(f: float) -> None:
    t = np.arange(10_000) / 1000
    rng = np.random.default_rng(2)
    x = np.sin(2 * np.pi * f * t) + 0.02 * rng.normal(size=t.size)
    y = 1.3 * np.sin(2 * np.pi * f * t - 0.7) + 0.26 * np.sin(4 * np.pi * f * t) + 0.02 * rng.normal(size=t.size)
    fit = fit_harmonics(t, y, f, 1).amplitudes[0] / fit_harmonics(t, x, f, 1).amplitudes[0]
    phase = np.angle(cross_spectrum(x, y, 1000, f))
    assert np.degrees(phase - np.angle(fit)) == pytest.approx(0, abs=0.15)
    assert np.degrees(phase + 0.7) == pytest.approx(0, abs=0.2)


def test_cross_spectrum_is_the_product_of_the_transforms() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=400), rng.normal(size=400)
    X, Y = np.fft.fft(x - x.mean())[8], np.fft.fft(y - y.mean())[8]
    assert cross_spectrum(x, y, 400, 8.0) == pytest.approx(np.conj(X) * Y / 400**2, rel=1e-9)
    with pytest.raises(RecordingError, match="one period"):
        cross_spectrum(x, y, 400, 0.5)


def test_h1_finds_a_known_system_and_its_uncertainty_covers() -> None:
    rng = np.random.default_rng(4)
    x = rng.normal(size=60_000)
    clean = lfilter([0.0, 0.3, 0.1], [1.0, -1.2, 0.6], x)
    y = clean + 0.3 * clean.std() * rng.normal(size=x.size)
    estimate = h1(x, y, 1000.0, 2.0)
    z = np.exp(2j * np.pi * estimate.frequency_hz / 1000)
    H = (0.3 * z + 0.1) / (z**2 - 1.2 * z + 0.6)
    inside = estimate.frequency_hz < 300
    score = np.abs(estimate.H - H)[inside] / (estimate.std[inside] * np.sqrt(2))
    assert np.sqrt(np.mean(score**2)) == pytest.approx(1, abs=0.15)
    assert estimate.coherence[inside].mean() == pytest.approx(1 / 1.09, abs=0.25)


def test_h1_needs_three_segments() -> None:
    with pytest.raises(RecordingError, match="too short"):
        h1(np.ones(1000), np.ones(1000), 1000.0, 1.0)
