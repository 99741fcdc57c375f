"""Harmonic fits: exact for sums of sines, unbiased with honest standard deviations for noisy ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fasbody.exceptions import RecordingError
from fasbody.recording import harmonics
from fasbody.recording.harmonics import find_frequency, fit_harmonics, sine_share

T = np.arange(1000) / 500.0


def signal(frequency: float, amplitudes: list[complex], t: np.ndarray = T) -> np.ndarray:
    h = np.arange(1, len(amplitudes) + 1)
    return (np.exp(2j * np.pi * frequency * np.outer(t, h)) @ np.array(amplitudes)).real


@given(frequency=st.floats(8, 60), phases=st.lists(st.floats(0, 6.28), min_size=3, max_size=3))
@settings(max_examples=15)
def test_sums_of_sines_are_recovered_exactly(frequency: float, phases: list[float]) -> None:
    """For any frequency, so for any fraction of a period in the recording."""
    U = np.array([8.95, 0.3, 0.05]) * np.exp(1j * np.array(phases))
    found = fit_harmonics(T, signal(frequency, list(U)) + 2.5, frequency, 3)
    np.testing.assert_allclose(found.amplitudes, U, atol=1e-9)
    assert found.offset == pytest.approx(2.5, abs=1e-9)
    assert found.sigma < 1e-9


def test_standard_deviations_are_honest() -> None:
    """200 noisy recordings: the scatter of the estimates is the stated one, and their mean the truth."""
    rng, U = np.random.default_rng(0), [5.0 - 3.0j, 0.4j]
    clean = signal(21.0, U)
    rows, stated, sigma = [], [], []
    for _ in range(200):
        found = fit_harmonics(T, clean + rng.normal(0, 0.3, T.size), 21.0, 2)
        rows.append(found.amplitudes)
        stated.append(found.std)
        sigma.append(found.sigma)
    parts = np.concatenate([np.real(rows), np.imag(rows)], axis=1)
    std = np.sqrt(np.mean(np.square(stated), axis=0))
    np.testing.assert_allclose(parts.std(axis=0), np.tile(std, 2), rtol=0.2)
    np.testing.assert_allclose(std, 0.3 * np.sqrt(2 / T.size), rtol=0.03)
    error = np.abs(parts.mean(axis=0) - np.concatenate([np.real(U), np.imag(U)]))
    assert (error < 4 * np.tile(std, 2) / np.sqrt(200)).all()
    assert np.mean(sigma) == pytest.approx(0.3, rel=0.01)


def test_coloured_noise_has_its_own_weight_at_each_harmonic() -> None:
    """Noise between 5 and 35 Hz only: a 20 Hz amplitude is worse than the average over all frequencies says."""
    rng = np.random.default_rng(0)
    rows, stated = [], []
    f = np.fft.rfftfreq(T.size, 2e-3)
    inside = (f > 5) & (f < 35)
    for _ in range(200):
        spectrum = np.where(inside, rng.normal(size=f.size) + 1j * rng.normal(size=f.size), 0) * 30
        found = fit_harmonics(T, signal(20.0, [8.0]) + np.fft.irfft(spectrum, T.size), 20.0, 3)
        rows.append(found.amplitudes)
        stated.append(found.std)
    std = np.sqrt(np.mean(np.square(stated), axis=0))
    have = np.real(rows).std(axis=0)
    assert have[0] == pytest.approx(std[0], rel=0.2)
    assert std[2] < 0.3 * std[0]


@pytest.mark.parametrize(
    ("power", "weight"),
    [(1.4, 1.0), (1.9, np.sqrt(1.9)), (0.75, 1.0), (0.4, np.sqrt(0.4))],
)
def test_noise_counts_as_coloured_beyond_what_chance_makes_of_white(power: float, weight: float) -> None:
    """Power within 8 Hz of the harmonic over its mean: inside 0.6 to 1.6 white noise keeps its exact weight."""
    f, rng = np.fft.rfftfreq(T.size, T[1]), np.random.default_rng(0)
    near = np.abs(f - 20) < 8.1
    share = near.mean()
    size = np.sqrt(np.where(near, power, (1 - power * share) / (1 - share)))
    noise = np.fft.irfft(size * np.exp(2j * np.pi * rng.random(f.size)), T.size)
    found = fit_harmonics(T, signal(20.0, [8.0]) + noise, 20.0, 1)
    assert found.std[0] / (found.sigma * np.sqrt(2 / T.size)) == pytest.approx(weight, rel=0.05)


def test_amplitude_wander_widens_the_standard_deviation() -> None:
    steady = fit_harmonics(T, signal(20.0, [8.0]) + np.random.default_rng(0).normal(0, 0.02, T.size), 20.0, 1)
    beating = signal(20.0, [8.0]) * (1 + 0.2 * np.sin(2 * np.pi * 1.7 * T))
    wander = fit_harmonics(T, beating + np.random.default_rng(0).normal(0, 0.02, T.size), 20.0, 1)
    assert steady.scatter < 0.01
    assert wander.scatter > 0.05
    assert wander.std[0] > 5 * steady.std[0]


@pytest.mark.parametrize("frequency", [0.9, 9.97, 20.0, 33.333, 51.2, 90.0])
def test_frequency_is_found_to_a_thousandth_of_a_line(frequency: float) -> None:
    rng = np.random.default_rng(0)
    noisy = signal(frequency, [8.95j, 0.2, 0.1j]) + rng.normal(0, 0.05, T.size)
    allowed = 3e-3 if frequency < 5 else 5e-4
    assert find_frequency(T, noisy) == pytest.approx(frequency, abs=allowed)


def test_too_few_samples_get_a_sentence() -> None:
    with pytest.raises(RecordingError, match="10 samples are too few for"):
        fit_harmonics(T[:10], T[:10], 20.0, 6)


def test_a_long_recording_is_fitted_in_blocks_as_a_short_one_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The frequency is from means of samples first; the last block has fewer samples than columns."""
    rng, t = np.random.default_rng(1), np.arange(7 * 1700 + 10) / 1000
    signal = 8.95 * np.sin(2 * np.pi * 19.37 * t) + 0.4 * np.sin(4 * np.pi * 19.37 * t + 1) + rng.normal(0, 0.3, t.size)
    once = fit_harmonics(t, signal, 19.37, 3), find_frequency(t, signal), sine_share(t, signal, 19.37)
    monkeypatch.setattr(harmonics, "_LONG", 5000)
    monkeypatch.setattr(harmonics, "_BLOCK", 1700)
    blocks = fit_harmonics(t, signal, 19.37, 3), find_frequency(t, signal), sine_share(t, signal, 19.37)
    assert blocks[0].amplitudes == pytest.approx(once[0].amplitudes, rel=1e-9)
    assert blocks[0].std == pytest.approx(once[0].std, rel=1e-6)
    assert blocks[1:] == pytest.approx(once[1:], rel=1e-9)
