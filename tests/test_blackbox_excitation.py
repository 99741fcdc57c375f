"""Excitation rank, single sines and their frequency, excited band."""

import linear_foot as foot
import numpy as np
import pytest
from recorded_foot import record

from identification.blackbox import excitation
from identification.blackbox.data import Series
from identification.blackbox.identify import shown_frequencies

N = 5000
RNG = np.random.default_rng(2)


@pytest.mark.parametrize("frequency", [10.0, 20.37, 50.0])
@pytest.mark.parametrize("noise", [0.0, 0.03, 0.25])
def test_a_sine_has_rank_two(frequency: float, noise: float) -> None:
    found = excitation.examine(record(foot.sine(frequency, N) + noise * RNG.standard_normal(N)))
    assert found.rank == 2
    assert found.single_sine
    assert found.frequency_hz == pytest.approx(frequency, abs=2e-3)
    assert "excites rank 2" in found.warning(8)
    assert found.warning(2) == ""


@pytest.mark.parametrize(("share", "noise", "harmonics"), [(0.2, 0.03, (1, 2)), (0.01, 0.0, (1, 2, 3))])
def test_each_harmonic_of_the_shaker_adds_two(share: float, noise: float, harmonics: tuple[int, ...]) -> None:
    """A large second one behind noise, small second and third ones without."""
    u = foot.sine(20.0, N) + noise * RNG.standard_normal(N)
    u += share * sum(foot.sine(20.0 * h, N) for h in harmonics[1:])
    found = excitation.examine(record(u))
    assert (found.harmonics, found.rank) == (harmonics, 2 * len(harmonics))


def test_lines_count_twice_each_and_broad_inputs_fill_the_limit() -> None:
    two = foot.sine(20.0, N) + 0.6 * foot.sine(33.0, N)
    assert excitation.examine(record(two)).rank == 4
    assert excitation.examine(record(foot.multisine(N, 5.0, 12) + 0.1 * RNG.standard_normal(N))).rank == 24
    for broad in (foot.prbs(N), RNG.standard_normal(N)):
        found = excitation.examine(record(broad))
        assert found.rank == found.limit == 200
        assert found.warning(60) == ""


def test_pooled_sines_add_up() -> None:
    pool = [record(foot.sine(f, 2000)) for f in np.arange(10.0, 51.0, 5.0)]
    found = excitation.examine(pool)
    assert found.rank == 18
    assert not found.single_sine
    assert excitation.examine(pool[:1] * 3).rank == 2



def test_sine_fit_standard_error() -> None:
    """Over 300 noises the scatter of the amplitude is the stated standard error."""
    truth, values, sigma = 3.0 - 1.0j, [], 0.0
    t = np.arange(1000) * 1e-3
    for seed in range(300):
        clean = (truth * np.exp(2j * np.pi * 17.3 * t)).real
        noisy = clean + 0.5 * np.random.default_rng(seed).standard_normal(1000)
        z, sigma, _ = excitation.sine_fit(noisy, 1e-3, 17.3, [1])
        values.append(z[0])
    assert np.mean(values) == pytest.approx(truth, abs=0.01)
    assert np.std(np.real(values)) == pytest.approx(sigma, rel=0.15)


def test_response_is_shown_only_where_excited() -> None:
    sine = shown_frequencies(excitation.examine(record(foot.sine(20.0, N))))
    assert sine == pytest.approx([20.0], abs=1e-3)
    lines = shown_frequencies(excitation.examine(record(foot.multisine(N, 5.0, 10))))
    assert np.abs(lines / 5.0 - np.round(lines / 5.0)).max() < 0.1
    two_bands = foot.multisine(N, 2.0, 5) + 8.0 * np.cos(2 * np.pi * 100.0 * np.arange(N) * foot.SAMPLE_TIME)
    shown = shown_frequencies(excitation.examine(record(two_bands)))
    assert not np.any((shown > 12) & (shown < 98))


@pytest.mark.parametrize("at", [50, 133, 465, 880])
def test_a_step_excites_a_band_from_the_lowest_frequency_on(at: int) -> None:
    """Its spectrum falls from zero on and has no line, wherever the step is."""
    u = (np.arange(1000) > at) * 1.0
    found = excitation.examine(Series(u, RNG.standard_normal(1000), 0.01))
    assert found.band_hz[0] == pytest.approx(0.1) and not found.lines and not found.single_sine
    assert "excited from 0.1 to" in str(found)
