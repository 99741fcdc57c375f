"""Each bad recording gets its sentence, and good ones of any kind pass."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import oracle
import pytest

import mjcf
from fasbody.exceptions import RecordingError
from fasbody.foot.model import load
from fasbody.foot.shaker import harmonics
from fasbody.foot.simulate import simulate
from fasbody.foot.two_dof import TwoDof
from fasbody.recording.checks import apart, checked, gathered, understood
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.recording import Condition, Recording

RATE, N = 1000.0, 2000
T = np.arange(N) / RATE


def good(frequency: float = 20.0, nominal: float | None = None, seed: int = 0) -> Recording:
    """A linear foot's steady response with noise."""
    rng = np.random.default_rng(seed)
    H = oracle.linear_response(oracle.TRUTH, frequency)[0]
    turn = np.exp(2j * np.pi * frequency * T)
    base, malleolus = (8.95 * turn).real, (8.95 * H * turn).real
    noisy = (x + rng.normal(0, 0.05, N) for x in (base, malleolus))
    return Recording(T, *noisy, condition=Condition(frequency_hz=nominal), file="x.csv")


@pytest.mark.parametrize("frequency", [5.0, 10.0, 17.3, 33.0, 50.0, 97.0])
def test_excitation_frequency_is_found(frequency: float) -> None:
    found = checked(good(frequency))
    assert found.condition.frequency_hz == pytest.approx(frequency, abs=1e-3)
    assert found.warnings == ()


@pytest.mark.parametrize(("factor", "noise", "copied"), [(1.0, 0.0, True), (1.2, 5e-7, True), (1.2, 1e-3, False)])
def test_a_malleolus_that_is_the_base_is_refused(factor: float, noise: float, copied: bool) -> None:
    r = good()
    other = factor * r.base_m_s2 + np.random.default_rng(0).normal(0, noise, N)
    copy = replace(r, malleolus_m_s2=other)
    if copied:
        with pytest.raises(RecordingError, match=rf"is {factor:g} times base_m_s2, sample by sample: one sensor"):
            checked(copy)
    else:
        assert checked(copy).condition.frequency_hz == pytest.approx(20.0, abs=1e-3)


def test_broadband_is_none() -> None:
    rng = np.random.default_rng(0)
    r = Recording(T, rng.normal(0, 5, N), rng.normal(0, 5, N))
    assert checked(r).condition.frequency_hz is None


def test_offsets_are_taken_out_and_told() -> None:
    r = good()
    r = replace(r, base_m_s2=r.base_m_s2 + 9.81, malleolus_m_s2=r.malleolus_m_s2 - 3.0)
    found = checked(r)
    assert abs(found.base_m_s2.mean()) < 1e-12
    assert abs(found.malleolus_m_s2.mean()) < 1e-12
    assert len(found.warnings) == 2
    assert "x.csv: base_m_s2 has gravity of 9.8" in found.warnings[0]
    assert "malleolus_m_s2 has an offset of -3 m" in found.warnings[1]


@pytest.mark.parametrize(("ppm", "seen"), [(0.0, False), (10.0, False), (20.0, True), (300.0, True), (-600.0, True)])
def test_clocks_that_run_apart_are_told_with_how_much(ppm: float, seen: bool) -> None:
    t = np.arange(20_000) / RATE
    rng = np.random.default_rng(4)
    base, malleolus = (size * np.sin(40 * np.pi * at) for size, at in ((9.0, t), (12.0, (1 - 1e-6 * ppm) * t - 0.014)))
    noisy = (x + rng.normal(0, 0.05, t.size) for x in (base, malleolus))
    text = " ".join(checked(Recording(t, *noisy, file="x.csv")).warnings)
    assert (f"run apart by {abs(ppm):.0f} ppm" in text) is seen, text


def test_rounded_time_stamps_pass() -> None:
    checked(replace(good(), time_s=np.round(T, 3) + 12.0))
    checked(replace(good(), time_s=np.round(2.5 * T, 3)))  # 2.5 ms apart, printed to whole ms


CHANNELS = ("time_s", "base_m_s2", "malleolus_m_s2")
TIME, BASE, MALLEOLUS = CHANNELS


def change(name: str, f: Callable[[np.ndarray], np.ndarray]) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, **{name: f(getattr(r, name).copy())})


def put(name: str, place: int, value: float) -> Callable[[Recording], Recording]:
    def f(x: np.ndarray) -> np.ndarray:
        x[place] = value
        return x

    return change(name, f)


def told(frequency: float) -> Condition:
    return Condition(frequency_hz=frequency)


def noise() -> np.ndarray:
    return np.random.default_rng(0).normal(0, 5, N)


BAD = {
    "short": (lambda r: replace(r, **{n: getattr(r, n)[:40] for n in CHANNELS}), "has 40 samples, too short"),
    "time backwards": (put(TIME, 500, 0.1), r"time does not increase at sample 500 \(0.499 s, then 0.1 s\)"),
    "time repeated": (put(TIME, 500, 0.499), "time does not increase at sample 500"),
    "time nan": (put(TIME, 7, np.nan), "time is not a number at sample 7"),
    "gap": (
        change(TIME, lambda t: t + 0.01 * (t > 0.5)),
        r"time is not uniform: 0.011 s after 0.5 s \(sample 501 of 2000\), elsewhere 0.001 s; samples are missing",
    ),
    "reversed": (change(TIME, lambda t: t[::-1]), r"time runs backwards \(1\.999 s first, 0 s last\); sort the rows"),
    "still": (change(TIME, lambda t: 0 * t + 3), r"time stands still \(3 s first, 3 s last\)"),
    "1e300": (change(BASE, lambda x: 1e300 * x), r"base_m_s2 reaches 9\.\d*e\+300 m/s\^2 at .* s, which no body does"),
    "one spike": (put(MALLEOLUS, 77, -2e6), r"malleolus_m_s2 reaches 2e\+06 m/s\^2 at 0\.077 s, .*check its unit"),
    "nan": (put(MALLEOLUS, 321, np.nan), "malleolus_m_s2 is nan at 0.321 s; every sample must be finite"),
    "infinite": (put(BASE, 3, np.inf), "base_m_s2 is inf at 0.003 s"),
    "lengths": (change(BASE, lambda x: x[:-1]), "base_m_s2 has 1999 samples and time has 2000"),
    "dead": (change(MALLEOLUS, lambda x: 0 * x + 1.0), "malleolus_m_s2 is dead"),
    "dead base": (change(BASE, lambda x: 1e-5 * x), "base_m_s2 is dead"),
    "clipped": (
        change(MALLEOLUS, lambda x: np.clip(x, -7, 7)),
        r"malleolus_m_s2 is clipped \d+ times, .*record with a larger range",
    ),
    "clipped one side": (change(BASE, lambda x: np.maximum(x, -6)), r"base_m_s2 is clipped \d+ times"),
    "wrong table": (
        lambda r: replace(r, condition=told(25.0)),
        r"base_m_s2 vibrates at 20 Hz and recordings\.csv says 25 Hz",
    ),
    "not found": (
        lambda r: replace(r, base_m_s2=noise(), condition=told(20.0)),
        r"of 20 Hz is not found in base_m_s2 \(a sine explains \d+ % of its power\); leave frequency_hz empty",
    ),
    "units": (
        change(MALLEOLUS, lambda x: x * 1000),
        r"the malleolus moves .* times as much as the base at 20 Hz; check units",
    ),
    "tiny": (change(MALLEOLUS, lambda x: x / 1000), "the malleolus moves"),
    "sign": (change(MALLEOLUS, lambda x: -x), r"the malleolus leads the base by .* degrees"),
    "misaligned": (
        change(MALLEOLUS, lambda x: np.roll(x, -10)),
        r"the malleolus leads the base by \d+ degrees .*misaligned",
    ),
    "swapped": (lambda r: replace(r, base_m_s2=r.malleolus_m_s2, malleolus_m_s2=r.base_m_s2), "channels are swapped"),
    "tuberosity": (lambda r: replace(r, tuberosity_m_s2=np.zeros(N)), "tuberosity_m_s2 is dead"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_recordings_get_their_sentence(name: str) -> None:
    spoil, sentence = BAD[name]
    with pytest.raises(RecordingError, match=sentence) as caught:
        checked(spoil(good()))
    assert str(caught.value).startswith("x.csv: ")
    assert str(caught.value).endswith(".")


def test_too_slow_sampling_and_too_few_periods() -> None:
    with pytest.raises(RecordingError, match=r"is sampled at 1000 Hz, less than 2\.5 times its excitation of 430 Hz"):
        checked(good(430.0))
    assert "the sine fit needs no more" in checked(good(120.0)).warnings[0]
    assert "its harmonic 3 is aliased to the excitation frequency" in checked(good(250.0)).warnings[0]
    r = good(20.0)
    cut = replace(r, **{n: getattr(r, n)[:120] for n in CHANNELS})
    with pytest.raises(RecordingError, match=r"is too short: 2\.4 periods of 20\.?\d* Hz, not 3 or more"):
        checked(cut)


def at_times(t: np.ndarray, stamps: np.ndarray, noise: float = 0.0) -> Recording:
    """A sine of 20 Hz, 1.3 and -40 degrees, sampled at t and stamped otherwise."""
    rng = np.random.default_rng(1)
    turn = 8.95 * np.exp(2j * np.pi * 20 * t)
    base, malleolus = turn.real, (1.3 * np.exp(-1j * np.radians(40)) * turn).real
    noisy = (x + noise * 8.95 / np.sqrt(2) * rng.normal(size=t.size) for x in (base, malleolus))
    return Recording(stamps, *noisy, file="x.csv")


def ratio_of(recording: Recording) -> complex:
    good = checked(recording)
    fits = [
        fit_harmonics(good.time_s, x, good.condition.frequency_hz, 1) for x in (good.base_m_s2, good.malleolus_m_s2)
    ]
    return complex(fits[1].amplitudes[0] / fits[0].amplitudes[0])


TRUE = 1.3 * np.exp(-1j * np.radians(40))


def test_rounded_stamps_of_a_uniform_clock_are_accepted() -> None:
    for rate in (812.5, 1003.7, 400.0):
        t = np.arange(6000) / rate
        r = at_times(t, np.round(t, 3))
        assert abs(ratio_of(r) / TRUE - 1) < 1e-3
        assert checked(r).rate_hz == pytest.approx(rate, rel=1e-4)
    assert "are rounded to 1 ms" in checked(at_times(t * 0.4 / 0.8125, np.round(t * 0.4 / 0.8125, 3))).warnings[0]
    t = np.delete(np.arange(6000), 3000) / 812.5  # a sample is missing
    with pytest.raises(RecordingError, match="time"):
        checked(at_times(t, np.round(t, 3)))


def test_exact_stamps_that_jitter_are_accepted() -> None:
    t = np.arange(8000) / 1000 + np.random.default_rng(0).uniform(-0.35e-3, 0.35e-3, 8000)
    r = at_times(t, t)
    assert abs(ratio_of(r) / TRUE - 1) < 1e-3
    assert "its times jitter" in checked(r).warnings[0]


def test_noise_drift_and_wander_are_accepted_with_what_they_cost() -> None:
    t = np.arange(10_000) / 1000
    noisy = at_times(t, t, noise=0.15)
    assert any("is known to" in text for text in checked(replace(noisy, base_m_s2=noisy.base_m_s2 + 2 * t)).warnings)
    drift = 0.3 * 8.95 * np.sin(2 * np.pi * 0.07 * t)
    clean = at_times(t, t)
    assert abs(ratio_of(replace(clean, base_m_s2=clean.base_m_s2 + drift)) / TRUE - 1) < 2e-3
    wander = np.exp(2j * np.pi * (20 * t) + 0.5j * np.sin(2 * np.pi * 0.1 * t)) * (1 + 0.05 * np.sin(2 * t))
    r = Recording(t, (8.95 * wander).real, (8.95 * TRUE * wander).real, condition=Condition(frequency_hz=20.0))
    assert abs(ratio_of(r) / TRUE - 1) < 1e-3


def test_an_odd_amplitude_is_only_a_warning() -> None:
    r = good()
    found = checked(replace(r, base_m_s2=r.base_m_s2 / 50, malleolus_m_s2=r.malleolus_m_s2 / 50))
    assert "the base amplitude is 0.179 m/s^2 at 20 Hz" in found.warnings[0]
    assert "check its unit" in found.warnings[0]


def test_values_that_look_like_g_are_one_warning() -> None:
    like_g = [replace(r, base_m_s2=r.base_m_s2 / 9.81, malleolus_m_s2=r.malleolus_m_s2 / 9.81, file=f"{i}.csv")
              for i, r in enumerate([good()] * 3)]  # fmt: skip
    texts = gathered(["first", *(text for r in like_g for text in checked(r).warnings), "last"])
    assert len(texts) == 3
    assert texts[1].startswith("0.csv: the base amplitude is 0.912 m/s^2")
    assert texts[1].endswith("is it in g? Then name the column base_g. The same in 2 more recordings.")
    assert gathered(texts[1:2]) == texts[1:2]


def test_the_same_recording_twice_is_refused() -> None:
    one, other = good(), good(seed=1)
    apart([one, replace(one, malleolus_m_s2=other.malleolus_m_s2), other])
    with pytest.raises(RecordingError, match=r"^x\.csv and copy\.csv are the same recording \(sha256 .* leave one of"):
        apart([one, other, replace(one, file="copy.csv", condition=Condition(added_mass_kg=2.3))])


def test_more_than_fifty_g_is_a_warning_with_a_short_number() -> None:
    r = good()
    found = checked(replace(r, base_m_s2=1e4 * r.base_m_s2 + 123456.0, malleolus_m_s2=1e4 * r.malleolus_m_s2))
    text = " ".join(found.warnings)
    assert "base_m_s2 reaches 2.14e+05 m/s^2, more than is plausible for a foot on a shaker; check its unit" in text
    assert "an offset of 1.23e+05 m/s^2" in text


def test_quantised_sines_are_not_called_clipped() -> None:
    """A slow sine of a coarse converter stays several samples at its extreme value, in every period."""
    step = 78.4 / 4096
    q = lambda x: np.round(x / step) * step  # noqa: E731
    for frequency in (5.0, 10.0, 20.0):
        r = good(frequency)
        checked(replace(r, base_m_s2=q(r.base_m_s2), malleolus_m_s2=q(r.malleolus_m_s2)))
        turn = 8.95 * np.cos(2 * np.pi * frequency * T)  # without noise the tops are flat
        checked(replace(r, base_m_s2=q(turn)))


def swapped(r: Recording) -> Recording:
    return replace(r, base_m_s2=r.malleolus_m_s2, malleolus_m_s2=r.base_m_s2)


def made(ratio: float, lag_deg: float, seconds: float = 10.0) -> Recording:
    """A sine at 20 Hz whose malleolus answers with a ratio and a lag that are known."""
    t = np.arange(round(seconds * RATE)) / RATE
    rng = np.random.default_rng(1)
    turn = 8.95 * np.exp(2j * np.pi * 20.0 * t)
    out = ratio * turn * np.exp(-1j * np.radians(lag_deg))
    return Recording(t, turn.real + rng.normal(0, 0.05, t.size), out.real + rng.normal(0, 0.05, t.size), file="x.csv")


def test_channels_swapped_with_a_small_lag_are_found() -> None:
    """Beyond what a person who repeats to 5 % may seem to lead they are refused, below it is said."""
    words = r"leads the base by \d\.\d degrees at 20 Hz, .* swapped or misaligned"
    for lag, refused in ((2.0, False), (6.3, False), (7.3, True), (8.0, True)):
        checked(made(0.90, lag))
        if refused:
            with pytest.raises(RecordingError, match=words):
                checked(swapped(made(0.90, lag)))
        else:
            assert any(re.search(words, text) for text in checked(swapped(made(0.90, lag))).warnings)
    rng = np.random.default_rng(0)
    base = rng.normal(0, 5, 20000)
    late = np.convolve(base, np.exp(-np.arange(40) / 4) / 4.5)[:20000]  # first order: lags at every frequency
    broad = Recording(np.arange(20000) / RATE, base, late, file="x.csv")
    checked(broad)
    with pytest.raises(RecordingError, match="degrees over the band"):
        checked(swapped(broad))


def test_a_sensor_that_saturates_softly_is_found() -> None:
    """The tops of a tanh: the sine fit reads 0.995 for 1.30."""
    r = made(1.30, 20.0)
    soft = 9.5 * np.tanh(r.malleolus_m_s2 / 9.5)
    assert np.sqrt(2) * soft.std() / 8.95 < 1.01
    with pytest.raises(RecordingError, match=r"malleolus_m_s2 has flattened tops at 20 Hz .* its sensor saturates"):
        checked(replace(r, malleolus_m_s2=soft))
    fast = replace(r, base_m_s2=8.95 * np.cos(80 * np.pi * r.time_s))
    with pytest.raises(RecordingError, match="flattened tops at 40 Hz"):
        checked(replace(fast, malleolus_m_s2=9.5 * np.tanh(1.2 * np.cos(80 * np.pi * r.time_s - 0.3))))
    barely = checked(replace(r, malleolus_m_s2=25.0 * np.tanh(r.malleolus_m_s2 / 25.0)))
    assert "slightly flattened tops at 20 Hz" in barely.warnings[0]
    both = 30.0 * np.tanh(r.base_m_s2 / 12.0) / 2.5  # a shaker that distorts moves base and foot alike
    checked(replace(r, base_m_s2=both, malleolus_m_s2=0.8 * np.roll(both, 2)))


@pytest.mark.parametrize(("loss", "frequency", "peak"), [(2.0, 20.0, 3.0), (5.0, 30.0, 8.95)])
def test_dry_friction_is_no_sensor_that_saturates(loss: float, frequency: float, peak: float) -> None:
    """Its third harmonic is in phase with the tops, and its fifth is on the same side."""
    ankle = 'name="talocrural"'
    foot = load(mjcf.text("two_dof").replace(ankle, f'{ankle} frictionloss="{loss}"'))
    run = simulate(foot, harmonics(frequency, [peak], 3.0), step=1e-3)
    base, malleolus = (x + np.random.default_rng(1).normal(0, 0.02, x.shape) for x in (run.base, run.malleolus))
    recording = Recording(run.time[0, 1000:], base[0, 1000:], malleolus[0, 1000:], file="x.csv")
    text = " ".join(checked(recording).warnings)
    assert "malleolus_m_s2 has flattened tops" in text and "dry friction in the foot or" in text
    most = np.abs(recording.malleolus_m_s2).max() / 2
    with pytest.raises(RecordingError, match="its sensor saturates"):
        checked(replace(recording, malleolus_m_s2=most * np.tanh(recording.malleolus_m_s2 / most)))


@pytest.mark.parametrize("name", [BASE, MALLEOLUS])
@pytest.mark.parametrize("held", ["value", "noise"])
def test_a_sensor_frozen_for_a_part_is_found(name: str, held: str) -> None:
    r = made(0.9, 10.0)
    values = getattr(r, name).copy()
    values[4000:7000] = values[4000] if held == "value" else np.random.default_rng(3).normal(0, 0.05, 3000)
    with pytest.raises(RecordingError, match=rf"{name} stands still from 4 to 6\.999 s while another channel moves"):
        checked(replace(r, **{name: values}))


def test_quality_is_measured_and_judged() -> None:
    """Each number against the one that the signal was made with."""
    r = made(0.9, 10.0)
    t, wt = r.time_s, 2 * np.pi * 20.0 * r.time_s
    odd = replace(r, malleolus_m_s2=r.malleolus_m_s2 + 0.15 * 0.9 * 8.95 * np.sin(2 * wt))
    row = understood(odd)
    assert row["quality"]["malleolus"]["distortion"] == pytest.approx(0.15, abs=0.002)
    assert row["quality"]["coherence"] == pytest.approx(1, abs=1e-3)
    assert "malleolus_m_s2 has harmonics of 15 % of its fundamental" in row["warnings"][0]
    drifting = understood(replace(r, base_m_s2=r.base_m_s2 + 3.5 * t / t[-1]))
    assert drifting["quality"]["base"]["drift"] == pytest.approx(0.9 * 3.5 / 8.95, rel=0.01)  # of nine tenths' middles
    assert any("base_m_s2 drifts by 35 % of its amplitude" in text for text in drifting["warnings"])
    fading = understood(replace(r, malleolus_m_s2=r.malleolus_m_s2 * (1.2 - 0.4 * t / t[-1])))
    levels = np.array(fading["quality"]["malleolus"]["level_m_s2"])
    np.testing.assert_allclose(levels, 0.9 * 8.95 * (1.18 - 0.04 * np.arange(10)), rtol=2e-3)
    assert any("malleolus_m_s2 is not steady, 6.6 to 9.5" in text for text in fading["warnings"])
    turning = 0.9 * 8.95 * np.cos(wt - 0.4 * np.pi * t / t[-1])  # the phase runs away by 72 degrees
    lost = understood(replace(r, malleolus_m_s2=turning))
    share = abs(np.mean(np.exp(0.4j * np.pi * (np.arange(10) + 0.5) / 10))) ** 2
    assert lost["quality"]["coherence"] == pytest.approx(share, abs=5e-3)
    assert any("the coherence of malleolus and base is 0.88 at 20 Hz" in text for text in lost["warnings"])


def test_quality_of_broadband() -> None:
    rng = np.random.default_rng(0)
    base = rng.normal(0, 5, 20000)
    alone = understood(Recording(np.arange(20000) / RATE, base, rng.normal(0, 5, 20000), file="x.csv"))
    assert alone["quality"]["coherence"] < 0.2 and "coherence of malleolus and base" in alone["warnings"][0]
    assert alone["quality"]["base"]["distortion"] is None


def test_two_lightly_damped_masses_lag_by_more_than_half_a_turn() -> None:
    """Closed form: 45 Hz lies above both resonances. With a wrong sign below the first it would be refused."""
    foot = TwoDof(m_S=6.0, m_F=3.0, k_T=9e4, k_F=1.2e5, c_11=60, c_12=0, c_13=0, c_21=80, c_22=0, c_23=0)
    t = np.arange(4000) / 1000
    for hz, refused in ((45.0, False), (10.0, True)):
        ratio = complex(foot.transmissibility(np.array([hz]))[0]) * (-1 if refused else 1)
        assert np.degrees(np.angle(ratio)) > 90
        base, malleolus = (np.real(a * np.exp(2j * np.pi * hz * t)) for a in (8.95, 8.95 * ratio))
        recording = Recording(t, base, malleolus, condition=Condition(body_mass_kg=72.57, frequency_hz=hz))
        if refused:
            with pytest.raises(RecordingError, match="leads the base"):
                checked(recording)
        else:
            assert any("more than 180 degrees" in text for text in checked(recording).warnings)
