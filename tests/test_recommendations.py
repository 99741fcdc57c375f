"""What is advised, and only where it was not followed; the rank of an excitation: two for each sine, none for noise."""

from dataclasses import replace

import numpy as np
import pytest

from fasbody.foot.model import load
from fasbody.recording.checks import checked
from fasbody.recording.recording import Condition, Recording
from fasbody.recording.study import bundled
from identification.estimates import Allowance, Mass
from identification.fitting import fit_foot
from identification.recommendations import LEAST_FIT, about_departures, excitation_rank
from identification.result import Departures

T = np.arange(2000) / 1000


def base(*frequencies: float, seed: int = 0, noise: float = 0.03) -> Recording:
    rng = np.random.default_rng(seed)
    a = sum(8.95 * np.sin(2 * np.pi * f * T + f) for f in frequencies) + rng.normal(0, noise, T.size)
    only = frequencies[0] if len(frequencies) == 1 else None
    return Recording(T, a, a, condition=Condition(frequency_hz=only))


def test_one_sine_has_rank_two() -> None:
    assert excitation_rank([base(20.0)]) == 2


def test_pooled_sines_add_and_equal_ones_do_not() -> None:
    assert excitation_rank([base(20.0), base(33.0, seed=1)]) == 4
    assert excitation_rank([base(20.0), base(20.0, seed=1)]) == 2
    assert excitation_rank([base(20.0), base(33.0, seed=1), base(50.0, seed=2)]) == 6


def test_harmonics_of_the_shaker_count() -> None:
    r = base(20.0)
    assert excitation_rank([replace(r, base_m_s2=r.base_m_s2 + 0.2 * np.sin(2 * np.pi * 40 * T))]) == 4


def test_multisine_counts_its_lines() -> None:
    assert excitation_rank([base(11.0, 23.0, 37.0, 41.5)]) == 8


def test_a_recording_without_a_sine_has_the_rank_of_its_band() -> None:
    rng, spectrum = np.random.default_rng(0), np.zeros(1001, complex)
    spectrum[20:100] = np.exp(1j * rng.uniform(0, 6.28, 80)) * 1000
    a = np.fft.irfft(spectrum) + rng.normal(0, 0.01, 2000)
    found = checked(Recording(T, a, np.roll(a, 3)))
    assert found.condition.frequency_hz is None
    assert excitation_rank([found]) == 160


def test_noise_up_to_half_the_sampling_rate_excites_and_a_load_makes_another_system() -> None:
    a = np.random.default_rng(0).normal(0, 3, T.size)
    assert excitation_rank([Recording(T, a, a, condition=Condition())]) > 1900
    loaded = base(20.0, seed=1)
    loaded = replace(loaded, condition=replace(loaded.condition, added_mass_kg=2.3))
    assert excitation_rank([base(20.0), loaded]) == 4


def some_departures(prior_std: float, assumed: bool) -> Departures:
    masses = tuple(Mass(name, 3.0, prior_std, 3.0, 2.5, 3.5, 0.0, assumed=assumed) for name in ("m_S", "m_F"))
    return Departures(chi_square=10.0, objective=10.0, dof=10, follows=True, masses=masses, nuisances=())


@pytest.mark.parametrize(
    ("loads", "prior_std", "assumed", "said", "unsaid"),
    [
        (1, 0.1, False, ("--mass-std", "second load"), ("--body-mass", "heavier")),
        (2, 0.1, False, ("--mass-std", "heavier load"), ("--body-mass", "second load")),
        (1, 0.02, False, ("second load",), ("--body-mass", "--mass-std")),
        (1, 0.3, True, ("--body-mass",), ("--mass-std",)),
    ],
)
def test_nothing_is_advised_that_was_done(
    loads: int, prior_std: float, assumed: bool, said: tuple[str, ...], unsaid: tuple[str, ...]
) -> None:
    (text,) = about_departures(some_departures(prior_std, assumed), loads=loads)
    assert all(each in text for each in said)
    assert not any(each in text for each in unsaid)


@pytest.mark.parametrize(("noise", "times", "warns"), [(3.0, 1.0, False), (0.03, 3.0, True)])
def test_white_noise_alone_is_no_misfit_and_a_wrong_unit_is(noise: float, times: float, warns: bool) -> None:
    """A fit percentage below the rule's, from noise alone, or from one recording of three in another unit."""
    rng = np.random.default_rng(1)
    recordings = [
        replace(r, malleolus_m_s2=scale * r.malleolus_m_s2 + rng.normal(0, noise, r.malleolus_m_s2.size))
        for r, scale in zip(bundled().recordings[:3], (1.0, times, 1.0), strict=True)
    ]
    result = fit_foot(recordings, load("two_dof"), starts=1)
    assert min(r.fit_percent for r in result.recordings) < LEAST_FIT
    assert any(" is only " in text for text in result.warnings) == warns


def with_load(off: float, seen: float, constant: float) -> Departures:
    """A leg with two loads: how far k_T's change is from none, and the sum of squares without such changes."""
    change = Allowance(
        "k_T under 2.3 kg", "load", "", "", 1.0, 0.8, 1.2, 1.135, 1.046, 1.232, off, seen, "", "load"
    )
    none = replace(change, name="k_F under 2.3 kg", value=1.0, off=0.0, seen=0.0)
    return replace(some_departures(0.1, False), nuisances=(change, none), constant=constant, masses=())


@pytest.mark.parametrize(
    ("seen", "constant", "begins"),
    [
        (0.5, 11.0, "The recordings agree with constants that do not change"),
        (0.5, 16.0, "The recordings do not settle whether constants change"),
        (4.0, 16.0, "The recordings do not settle whether constants change"),
        (4.0, 11.0, "The recordings do not settle whether constants change"),
        (4.0, 60.0, "The recordings contradict constants that do not change"),
    ],
)
def test_one_note_says_what_the_loads_show(seen: float, constant: float, begins: str) -> None:
    (text,) = about_departures(with_load(1.0, seen, constant), loads=2)
    assert text.startswith(begins)
    assert ("k_T under 2.3 kg differs by 13.5 %" in text) == (seen > 3)
    assert "A sign" not in text and ("agree" in text) == (seen < 3 and constant < 12)
