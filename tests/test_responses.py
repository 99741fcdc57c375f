"""Responses of a mass on spring and damper whose answer is exact: every estimate, its interval, and what it names."""

from dataclasses import replace

import numpy as np
import pytest

from fasbody.exceptions import SettingError
from fasbody.recording.harmonics import find_frequency, fit_harmonics
from fasbody.recording.recording import Condition, Recording
from fasbody.transmissibility.broadband import broadband
from fasbody.transmissibility.estimate import rows
from fasbody.transmissibility.periodic import period_of
from fasbody.transmissibility.sines import by_segments
from fasbody.transmissibility.steps import steps_of
from fasbody.transmissibility.table import Table
from simulator.mass import Case, recorded, truth

RATE = 1000.0


def centred(base: np.ndarray, mass: np.ndarray) -> dict[str, np.ndarray]:
    return {"base": base - base.mean(), "malleolus": mass - mass.mean()}


def estimate(case: Case, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies, response over the truth, and its relative standard deviation."""
    t, base, mass = recorded(case, seed)
    if case.excitation == "sine":
        found = by_segments(t, centred(base, mass), find_frequency(t, base - base.mean()))
    else:
        found = broadband(t, centred(base, mass), 1.0)
    H, std = found.ratio("malleolus")
    inside = (found.frequency_hz >= 6.5) & (found.frequency_hz <= 45.5)
    f = found.frequency_hz[inside]
    return f, H[inside] / truth(f, case.damping), std[inside] / np.abs(H[inside])


def covered(case: Case, seeds: int) -> list[float]:
    """Share of 95 % intervals that hold size and phase [%]."""
    both = []
    for _, error, std in (estimate(case, seed) for seed in range(seeds)):
        both.append([np.abs(x) <= 1.96 * std for x in (1 - 1 / np.abs(error), np.angle(error))])
    return [100 * float(np.mean([each[i] for each in both])) for i in (0, 1)]


@pytest.mark.long
@pytest.mark.parametrize("wrong", ["", "AM", "FM", "drift", "20.3 Hz"])
def test_sines_by_segments(wrong: str) -> None:
    case = Case("sine", 0.06, 0.01, wrong)
    mean = np.mean([estimate(case, seed)[1] for seed in range(30)])
    assert abs(abs(mean) - 1) < 1e-3 and abs(np.degrees(np.angle(mean))) < 0.1
    assert min(covered(case, 30)) >= 80  # of thirty, by chance


def test_a_wander_that_is_common_does_not_widen_the_interval() -> None:
    """5 % in amplitude widened it many times if each channel's scatter were taken for noise of its own."""
    case = Case("sine", 0.25, 0.01, "AM")
    t, base, mass = recorded(case, 0)
    out, into = (fit_harmonics(t, x - x.mean(), 20.0, 1) for x in (mass, base))
    alone = float(np.hypot(out.std[0], into.std[0] * abs(truth(np.array([20.0]), 0.25)[0])) / abs(into.amplitudes[0]))
    (mine,), (still,) = (estimate(each, 0)[2] for each in (case, replace(case, wrong="")))
    assert alone > 10 * mine and mine < 3 * still


@pytest.mark.parametrize("excitation", ["multisine", "random", "sweep"])
def test_broadband_is_unbiased_at_a_resonance_and_covered(excitation: str) -> None:
    """15 % noise on both channels, damping 6 %."""
    assert all(89 <= share <= 99 for share in covered(Case(excitation, 0.06, 0.15), 3))
    f, error, std = estimate(Case(excitation, 0.06, 0.01), 0)
    at = int(np.argmin(np.abs(f - 20)))
    assert abs(error[at] - 1) < 4 * std[at] + 1e-3


def recording(base: np.ndarray, mass: np.ndarray, **given: float | None) -> Recording:
    t = np.arange(base.size) / RATE
    return Recording(t, base, mass, condition=Condition("1", **given), file="made.csv")  # type: ignore[arg-type]


def test_the_error_by_resolution_is_named() -> None:
    t, base, mass = recorded(Case("random", 0.06, 0.01), 1)
    found = broadband(t, {"base": base - base.mean(), "malleolus": mass - mass.mean()}, 1.0, "H1")
    at = int(np.argmin(np.abs(found.frequency_hz - 20)))
    wrong = np.abs(found.H["malleolus"][at]) / np.abs(truth(np.array(20.0), 0.06)) - 1
    assert wrong < -0.05
    assert found.bias["malleolus"][at] == pytest.approx(wrong, abs=0.01)
    table = Table.of_recordings([recording(base, mass)], 1.0, "H1")
    assert "the resolution of 1 Hz makes MB" in table.resolved(1.0)
    assert Table.of_recordings([recording(base, mass)]).resolved(1.0) == ""


def test_averaged_estimates_bracket_the_truth() -> None:
    """H1 is too small by the noise of the base, H2 too large by that of the mass, Hv between."""
    t, base, mass = recorded(Case("random", 0.25, 0.01), 2)
    rng = np.random.default_rng(0)
    noisy = {"base": base + 5 * rng.normal(size=t.size), "malleolus": mass + 5 * rng.normal(size=t.size)}
    sizes = {}
    for kind in ("H1", "H2", "Hv"):
        found = broadband(t, noisy, 1.0, kind)
        inside = (found.frequency_hz > 8) & (found.frequency_hz < 30)
        sizes[kind] = np.mean(np.abs(found.H["malleolus"] / truth(found.frequency_hz, 0.25))[inside])
    assert sizes["H1"] < 0.97 < 1.01 < sizes["H2"]
    assert sizes["H1"] < sizes["Hv"] < sizes["H2"]
    with pytest.raises(SettingError, match="H3"):
        broadband(t, noisy, 1.0, "H3")


def test_a_period_is_found_though_it_is_no_whole_number_of_samples() -> None:
    t = np.arange(20_000) / RATE
    period = 1.23456
    rng = np.random.default_rng(3)
    turns = 2 * np.pi * np.outer(np.arange(7, 60), t / period) + rng.uniform(0, 2 * np.pi, (53, 1))
    H = truth(np.arange(7, 60) / period, 0.06)
    base, mass = np.cos(turns).sum(axis=0), (np.exp(1j * turns) * H[:, None]).sum(axis=0).real
    band = (7 / period, 59 / period)
    assert period_of(base, RATE, band) == pytest.approx(period, rel=1e-5)
    assert period_of(rng.normal(size=t.size), RATE, (1.0, 400.0)) is None
    found = broadband(t, {"base": base, "malleolus": mass}, 0.5)
    inside = (found.frequency_hz > 6.5) & (found.frequency_hz < 45)
    right = truth(np.round(found.frequency_hz * period) / period, 0.06)
    assert np.abs(found.H["malleolus"] / right - 1)[inside].max() < 1e-3


def test_distortion_is_told_from_noise() -> None:
    """A mass whose motion is bent by a square term moves at lines that the shaker does not drive."""
    t, base, mass = recorded(Case("multisine", 0.25, 0.01), 0)
    bent = mass + 0.02 * mass**2
    straight, crooked = (broadband(t, {"base": base - base.mean(), "malleolus": y - y.mean()}) for y in (mass, bent))
    assert np.median(straight.distortion["malleolus"]) == 0
    size = np.abs(crooked.H["malleolus"])
    assert 0.01 < np.median(crooked.distortion["malleolus"] / size) < 0.3
    assert np.median(crooked.ratio("malleolus")[1] / straight.ratio("malleolus")[1]) > 3


def test_steps_of_sines_are_cut() -> None:
    t = np.arange(30_000) / RATE
    f = np.repeat([10.0, 20.0, 25.0, 40.0, 15.0], 6000)
    turn = np.exp(2j * np.pi * np.cumsum(f) / RATE)
    H = truth(f, 0.25)
    rng = np.random.default_rng(0)
    base, mass = (8.95 * turn).real, (8.95 * H * turn).real
    made = recording(base + 0.1 * rng.normal(size=t.size), mass + 0.1 * rng.normal(size=t.size))
    found = {row.frequency_hz: row for row in rows(made)}
    assert sorted(found) == [10, 15, 20, 25, 40]
    for at, row in found.items():
        right = truth(np.array(at), 0.25)
        assert row.transmissibility == pytest.approx(abs(right), abs=5 * row.transmissibility_std)
        assert row.phase_deg == pytest.approx(np.degrees(np.angle(right)), abs=5 * row.phase_std_deg)
        assert row.method.startswith("sine")
    assert not Table.of_recordings([made]).broadband


@pytest.mark.parametrize("share", [0.05, 0.15])
def test_each_step_in_pink_noise_is_one_row(share: float) -> None:
    """Noise of 15 % of the sine, its power falling with frequency; half of that already lost or split steps."""
    steps = [10.0, 15.0, 20.0, 25.0, 30.0, 40.0]
    f = np.repeat(steps, 6000)
    lines = np.fft.rfftfreq(f.size, 1 / RATE)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        spectrum = (rng.normal(size=lines.size) + 1j * rng.normal(size=lines.size)) / np.sqrt(np.maximum(lines, 1e-9))
        noise = np.fft.irfft(np.where(lines < 0.3, 0, spectrum), f.size)
        base = np.cos(2 * np.pi * np.cumsum(f) / RATE) + share * noise / noise.std()
        found = steps_of(np.arange(f.size) / RATE, base)
        assert [step for _, step in found] == pytest.approx(steps, abs=0.1)


def test_too_few_segments_take_the_noise_from_the_residual() -> None:
    t = np.arange(500) / RATE
    scores = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        turn = np.exp(2j * np.pi * 20 * t)
        channels = {"base": turn.real, "malleolus": (1.3 * np.exp(-0.7j) * turn).real}
        noisy = {name: x + 0.1 * rng.normal(size=t.size) for name, x in channels.items()}
        H, std = by_segments(t, noisy, 20.0).ratio("malleolus")
        scores.append(((H - 1.3 * np.exp(-0.7j)) / std)[0])
    assert np.std(np.real(scores)) == pytest.approx(1, abs=0.25)
