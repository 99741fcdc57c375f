"""What samples say of themselves: a finding for each fault with its size, and none where there is none."""

import re

import numpy as np
import pytest

from fasbody.exceptions import RecordingError
from fasbody.recording import samples
from fasbody.recording.checks import checked
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.recording import Recording
from fasbody.recording.together import expected, out_of_line

RATE, HZ = 1000, 20.0
TIME = np.arange(4000) / RATE


def sine(time_s: np.ndarray, size: float = 9.0, late_deg: float = 0.0, hz: float = HZ) -> np.ndarray:
    return size * np.sin(2 * np.pi * hz * time_s + 0.3 - np.radians(late_deg))


def found(malleolus: np.ndarray, base: np.ndarray | None = None) -> str:
    base = sine(TIME) if base is None else base
    good = checked(Recording.from_arrays(TIME[: malleolus.size], base[: malleolus.size], malleolus, name="a"))
    return " ".join(good.warnings)


FOOT = sine(TIME, 11.7, 25.0)


@pytest.mark.parametrize("digits", [15, 6, 3])
@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.3])
def test_a_sound_channel_has_no_finding(digits: int, noise: float) -> None:
    rng = np.random.default_rng(1)
    pair = (np.round(x + noise * rng.normal(size=x.size), digits) for x in (FOOT, sine(TIME)))
    assert found(*pair) == ""


@pytest.mark.parametrize(
    ("held", "own_rate"),
    [*((held, rate) for held in (True, False) for rate in (250.0, 500.0, 4000 / 27, 148.2)), (True, 600.0)],
)
def test_a_slow_channel_is_told_with_what_it_costs(held: bool, own_rate: float) -> None:
    """Amplitude and delay that are stated are those that a fit to the channel finds."""
    its = np.arange(0, 4.1, 1 / own_rate)
    values = sine(its, 11.7, 25.0)
    made = values[np.floor(TIME * own_rate + 1e-9).astype(int)] if held else np.interp(TIME, its, values)
    slow = samples.slow(np.round(made, 6))
    assert slow is not None and slow.held is held
    assert slow.interval == pytest.approx(RATE / own_rate, rel=0.05)
    change, delay_s = slow.effect(HZ, RATE)
    ratio = fit_harmonics(TIME, made, HZ, 1).amplitudes[0] / fit_harmonics(TIME, FOOT, HZ, 1).amplitudes[0]
    assert abs(ratio) - 1 == pytest.approx(change, rel=0.1, abs=1e-3)
    apart = 1.0 if held and own_rate == 148.2 else 0.1  # how old its samples are depends on how the clocks meet
    assert -np.degrees(np.angle(ratio)) == pytest.approx(360 * HZ * delay_s, abs=apart)
    text = found(np.round(made, 6))
    assert ("held until the next one" if held else "joined by straight lines") in text
    assert ("degrees late" in text) is held


@pytest.mark.parametrize(("noise", "seen"), [(0.06, True), (3.0, False)])
def test_a_held_channel_of_160_hz_is_seen_in_noise(noise: float, seen: bool) -> None:
    made = sine(np.floor(TIME * 160 + 1e-9) / 160, 11.7, 25.0) + np.random.default_rng(3).normal(0, noise, TIME.size)
    slow = samples.slow(made)
    assert (slow is not None) is seen
    assert slow is None or (slow.held, slow.interval, slow.age) == (True, 6.25, 3.0)


def test_a_held_channel_of_250_hz_is_10_8_degrees_late() -> None:
    text = found(np.repeat(sine(TIME[::4], 11.7, 25.0), 4))
    assert "sampled at 250 Hz" in text and "10.8 degrees late" in text and "delay_s = 0.0015" in text


@pytest.mark.parametrize(("share", "seen"), [(0.3, True), (0.05, True), (0.01, False)])
def test_lost_samples_that_were_filled_by_the_one_before(share: float, seen: bool) -> None:
    """The mean age of the samples is the delay that a fit finds."""
    lost = np.random.default_rng(5).random(FOOT.size) < share
    filled = FOOT[np.maximum.accumulate(np.where(lost, 0, np.arange(FOOT.size)))]
    slow = samples.slow(filled)
    assert (slow is not None) is seen
    if slow is not None:
        ratio = fit_harmonics(TIME, filled, HZ, 1).amplitudes[0] / fit_harmonics(TIME, FOOT, HZ, 1).amplitudes[0]
        assert -np.degrees(np.angle(ratio)) == pytest.approx(360 * HZ * slow.effect(HZ, RATE)[1], abs=0.2)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_spikes_are_counted_and_their_cost_is_what_they_change(noise: float) -> None:
    rng = np.random.default_rng(2)
    clean = FOOT + noise * rng.normal(size=FOOT.size)
    place = rng.choice(np.arange(10, 3990, 7), 20, replace=False)
    spiked = clean.copy()
    spiked[place] += rng.choice([-1, 1], 20) * rng.uniform(8, 40, 20)
    odd = samples.odd(spiked - spiked.mean(), 80)
    np.testing.assert_array_equal(odd.spikes, np.sort(place))
    assert odd.mark is None
    ratio = [fit_harmonics(TIME, x, HZ, 1).amplitudes[0] for x in (spiked, clean)]
    assert samples.cost(TIME, spiked, HZ, odd.spikes) == pytest.approx(ratio[0] / ratio[1], abs=2e-4)
    (cost,) = re.findall(r"20 spikes of up to .* amplitude of its sine by ([-+\d.]+) %", found(spiked))
    assert float(cost) == pytest.approx(100 * (abs(ratio[0] / ratio[1]) - 1), abs=0.03)


def test_one_spike_is_found_and_smaller_ones_than_the_noise_are_not() -> None:
    rng = np.random.default_rng(3)
    noisy = FOOT + 0.1 * rng.normal(size=FOOT.size)
    for height, seen in ((5.0, True), (0.2, False)):
        spiked = noisy.copy()
        spiked[1234] += height
        assert ("malleolus_m_s2 has a spike" in found(spiked)) is seen


@pytest.mark.parametrize("place", [[100, 900, 2000], list(range(300, 312))])
def test_a_mark_for_missing_samples_is_refused(place: list[int]) -> None:
    marked = FOOT.copy()
    marked[place] = -99.99
    with pytest.raises(
        RecordingError, match=rf"is -99\.99 m/s\^2 at {len(place)} places, .* a code for missing samples"
    ):
        found(marked)


def test_an_impact_of_each_period_without_noise_is_no_mark() -> None:
    """Identical periods: their highest sample is one number."""
    struck = np.tile(FOOT[: round(RATE / HZ)], 10)
    struck[5 :: round(RATE / HZ)] += 3.0
    odd = samples.odd(struck, 10 - HZ / RATE)
    assert odd.spikes.size == 10 and odd.mark is None


def test_a_lost_sample_is_a_jump_at_its_place() -> None:
    text = found(np.delete(FOOT, 1000))
    assert "malleolus_m_s2 jumps by" in text and "at 0.99" in text
    assert found(FOOT[:-1]) == ""


def test_coarse_steps_cost_what_is_said() -> None:
    """Over many phases the fitted amplitude scatters as much as is stated for rounding that repeats every period."""
    step, errors = 0.5, []
    for phase in np.random.default_rng(4).uniform(0, 360, 200):
        rounded = np.round(sine(TIME[:500], 9.0, phase) / step) * step
        errors.append(abs(fit_harmonics(TIME[:500], rounded, HZ, 1).amplitudes[0]) / 9 - 1)
    stated = samples.by_steps(rounded, samples.step(rounded), HZ, RATE)
    assert stated == pytest.approx(np.std(errors), rel=0.5)
    text = found(np.round(FOOT / 1.5) * 1.5)
    assert "malleolus_m_s2 has steps of 1.5 m/s^2" in text
    assert found(np.round(FOOT / 0.1) * 0.1) == ""


def test_few_samples_a_period_are_not_a_dead_sensor() -> None:
    """Eight samples a period of an exact sine take few values, and those lie on no grid."""
    t = np.arange(800) / 160
    good = checked(Recording.from_arrays(t, sine(t), sine(t, 11.7, 25.0)))
    assert good.condition.frequency_hz == pytest.approx(HZ)
    period = np.arange(800) % 8  # the same eight numbers again and again, but for their last digits
    again = [9 * np.sin(np.pi / 4 * period), 9 * np.sin(np.pi / 4 * period - 0.4)]
    assert checked(Recording.from_arrays(t, *again)).condition.frequency_hz == pytest.approx(HZ)
    with pytest.raises(RecordingError, match="dead or too coarse: it takes 5 values"):
        checked(Recording.from_arrays(t, sine(t), np.round(sine(t, 2.0, 25.0))))


@pytest.mark.parametrize(
    ("size", "lag_deg", "odd"),
    [(1.3, 25, ""), (1.3 / 9.80665, 23, "so little"), (1.3 * 9.80665, 25, "moves so much is"), (0.4, 125, ""),
     (0.8, 5, ""), (3.0, 80, ""), (0.45, 5, "so little"), (0.55, 5, ""), (6.0, 80, "")],
)  # fmt: skip
def test_amplitude_and_phase_must_be_of_a_passive_foot(size: float, lag_deg: float, odd: str) -> None:
    text = samples.impossible(size * np.exp(-1j * np.radians(lag_deg)))
    assert odd in text and bool(text) is bool(odd)


@pytest.mark.parametrize("loss", [0.0, 0.1, 1.0, 50.0])
def test_no_mass_on_a_passive_spring_is_impossible_below_its_resonance_peak(loss: float) -> None:
    """Real part of 1 / H is at most 1 for every loss factor; only a resonance without loss is called odd."""
    r = np.linspace(0.05, 6, 400)
    H = 1 / (1 - r**2 / (1 + 1j * loss))
    assert (1 / H).real.max() <= 1 + 1e-12
    assert all("so little" not in samples.impossible(h) for h in H)


def rows_of(H: np.ndarray, f: np.ndarray) -> list[dict[str, object]]:
    return [
        {"file": f"{hz:g}Hz.csv", "frequency_hz": hz, "transmissibility": abs(h), "phase_deg": np.degrees(np.angle(h)),
         "subject": "1", "posture": "midstance", "added_mass_kg": 0.0}
        for hz, h in zip(f, H, strict=True)
    ]  # fmt: skip


@pytest.mark.parametrize("wrong", range(6))
@pytest.mark.parametrize(("change", "seen"), [(1 / 9.80665, True), (np.exp(-0.7j), True), (1.15, False), (1.0, False)])
def test_a_sine_that_the_others_belie_is_named(wrong: int, change: complex, seen: bool) -> None:
    f = np.array([10.0, 15.0, 20.0, 30.0, 40.0, 50.0])
    H = expected(f, 1 / (1 - f**2 / (20**2 * (f / 20) ** 0.4 * np.exp(0.5j))))
    H[wrong] *= change
    texts = out_of_line(rows_of(H, f))
    assert [text.split(":")[0] for text in texts] == ([f"{f[wrong]:g}Hz.csv"] if seen else [])


def test_too_few_sines_belie_nothing() -> None:
    f = np.array([10.0, 20.0, 30.0, 40.0])
    assert out_of_line(rows_of(np.array([1.2, 9.0, 0.01, 1.0]) + 0j, f)) == []


def test_the_bundled_study_is_in_line() -> None:
    from fasbody.recording.study import bundled

    assert bundled().check().remarks == ()


@pytest.mark.parametrize(
    ("noise", "seen", "held"),
    [(0.005, True, True), (0.02, True, True), (0.3, False, True), (0.003, True, False), (0.03, False, False)],
)
def test_a_slow_channel_is_seen_through_noise_added_later(noise: float, seen: bool, held: bool) -> None:
    """Noise of a wire or of rounding behind the slow converter; as large as the steps themselves it hides them."""
    rng, t = np.random.default_rng(2), np.arange(4000) / 1000
    own = np.sin(2 * np.pi * 20 * t[::5])
    values = np.repeat(own, 5) if held else np.interp(t, t[::5], own)
    found = samples.slow(values + noise * rng.standard_normal(t.size))
    assert (None if found is None else (found.interval, found.held)) == ((5, held) if seen else None)


@pytest.mark.parametrize("phase", [0.0, 0.25 * np.pi, 0.5 * np.pi])
def test_four_samples_a_period_are_no_slow_channel(phase: float) -> None:
    """They are equal in pairs, or every second one is in the middle of its neighbours, at these phases."""
    t, rng = np.arange(2000) / 160, np.random.default_rng(0)
    turn = 80 * np.pi * t + phase
    base, later = (a * np.sin(turn - lag) + 0.01 * rng.standard_normal(t.size) for a, lag in ((9.0, 0.0), (8.0, 0.2)))
    assert not any("was sampled at" in text for text in checked(Recording(t, base, later)).warnings)
