"""Spikes, drift, feedback and steps: found where they are, and only there."""

from dataclasses import replace

import linear_foot as foot
import numpy as np
import pytest
from scipy.signal import lfilter

from fasbody.exceptions import SettingError
from identification.blackbox import condition, frequency
from identification.blackbox.condition import Condition
from identification.blackbox.data import Series
from identification.blackbox.identify import identify

DEN = np.poly([0.9 * np.exp(0.5j), 0.9 * np.exp(-0.5j)]).real


def clean(seed: int = 0, n: int = 1200) -> Series:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(n)
    y = lfilter([0, 1, 0.5], DEN, u)
    return Series(u, y + 0.1 * np.std(y) * rng.standard_normal(n), 1.0, "clean").centred()


def loop(gain: float, pole: float, n: int = 1500, seed: int = 1) -> Series:
    rng = np.random.default_rng(seed)
    reference, e = rng.standard_normal(n), 0.3 * rng.standard_normal(n)
    u, y = np.zeros(n), np.zeros(n)
    for t in range(n):
        y[t] = (pole * y[t - 1] + 0.5 * u[t - 1] if t else 0.0) + e[t]
        u[t] = reference[t] - gain * y[t]
    return Series(u, y, 1.0, "loop").centred()


def test_sound_recordings_are_not_blamed() -> None:
    sine = foot.sine(20.0, 2000)
    noise = 0.25 * np.random.default_rng(0).standard_normal(2000)
    for series in (*map(clean, range(6)), Series(sine, foot.linear_output(sine) + noise, 1e-3).centred()):
        assert condition.examine(series) == Condition()


def test_spikes_are_found_and_mended() -> None:
    series, where = clean(), np.array([100, 333, 334, 700, 1100])
    y, sigma = series.y.copy(), np.std(series.y)
    y[where] += 3 * sigma * np.array([1, -1, 1, 1, -1])
    repaired, found = condition.mend(replace(series, y=y))
    assert set(found) == set(where)
    assert np.abs(repaired.y - series.y).max() < 0.5 * sigma
    assert "5 outliers in the output (at sample 101, 334, 335" in condition.examine(replace(series, y=y)).warnings()[0]


@pytest.mark.parametrize(("share", "says"), [(0.985, True), (0.995, False)])
def test_an_overflow_is_no_outlier(share: float, says: bool) -> None:
    """An output cut at its own 98.5th percentile stands there for 1.5 % of the samples: no intervals."""
    series = clean(n=2000)
    cut = replace(series, y=np.minimum(series.y, np.quantile(series.y, share)))
    found = condition.examine(cut)
    oe = identify(cut, ("oe",), {"oe": (2, 2, 1)}).models["oe"]
    assert np.isfinite(oe.response.gain_std).all() != says
    assert any("no standard errors or band: the output stands at an end" in text
               for text in oe.warnings) == says  # fmt: skip
    assert any("at an end of its range for 1." in text for text in found.warnings()) == says
    assert not (says and found.spikes)


def test_drift_is_found_and_taken_off() -> None:
    series = clean()
    drifting = replace(series, y=series.y + 2 * np.std(series.y) * np.linspace(0, 1, len(series)))
    assert condition.examine(drifting.centred()).drift > 0.5
    gone = condition.detrend(drifting, 1)
    assert condition.examine(gone).drift == 0.0
    assert np.abs(np.polyfit(gone.time, gone.y, 1)).max() < 1e-9
    with pytest.raises(SettingError) as caught:
        condition.detrend(series, 9)
    assert caught.value.setting == "detrend"


def test_feedback_and_unstable_plants_in_a_loop() -> None:
    assert condition.examine(loop(0.0, 0.9)) == Condition()
    stable = condition.examine(loop(0.8, 0.9))
    assert stable.feedback and not stable.unstable and "feedback" in stable.by_prediction
    assert condition.examine(loop(0.8, 1.1)).unstable
    found = identify(loop(0.8, 1.1), ("arx", "oe"), {"oe": (1, 1, 1)})
    arx = found.models["arx"].best.model
    assert np.abs(arx.poles()).max() == pytest.approx(1.1, abs=0.03)
    assert arx.orders.nk == 1  # type: ignore[attr-defined]
    assert found.models["arx"].best.one_step_percent > 50 and not np.isfinite(found.models["arx"].best.fit_percent)
    assert np.isnan(found.models["oe"].response.gain_std).all()
    assert any("feedback biases it" in text for text in found.models["oe"].warnings)


@pytest.mark.parametrize("late", [0, 1, 3])
def test_an_output_that_comes_before_its_input_is_no_unstable_plant(late: int) -> None:
    """Channels shifted by more than the delay, or swapped (0), look like a loop that only a controller moves."""
    series = clean()
    u, y = (series.u[:-late], series.y[late:]) if late else (series.y, series.u)
    found = condition.examine(Series(u, y, 1.0, "shifted").centred())
    text = " ".join(found.warnings())
    assert found.leads == (late != 1) == ("are the channels shifted or swapped" in text)
    assert "unstable" not in text and (found.leads or found == Condition())


@pytest.mark.parametrize(("pole", "says"), [(0.9, False), (0.2, True)])
def test_a_plant_that_changes_between_the_parts_is_named(pole: float, says: bool) -> None:
    series = clean()
    other = lfilter([0, -1.0, 0.5], np.poly([pole * np.exp(0.5j), pole * np.exp(-0.5j)]).real, series.u)
    y = np.r_[series.y[:600], other[600:] if says else series.y[600:]]
    texts = identify(replace(series, y=y), ("oe",), {"oe": (2, 2, 1)}).models["oe"].warnings
    assert any("the plant may have changed" in text for text in texts) == says


@pytest.mark.long
def test_intervals_in_a_strong_loop_hold_the_plant() -> None:
    """ARX in its own world, orders not given: offered in most recordings, and right where they are."""
    shares = []
    for seed in range(12):
        response = identify(loop(0.8, 0.9, seed=seed), ("arx",)).models["arx"].response
        shift = np.exp(-2j * np.pi * response.frequency_hz)
        apart = np.abs(np.abs(response.value) - np.abs(0.5 * shift / (1 - 0.9 * shift)))
        if np.isfinite(response.gain_std).all():
            shares.append(np.mean(apart < 1.96 * response.gain_std))
    assert len(shares) >= 8 and np.mean(shares) >= 0.9


def weak(gain: float, colour: float, seed: int, n: int = 2000) -> Series:
    """A second-order plant under noise of half its output, and a controller that answers within the sample."""
    rng = np.random.default_rng(seed)
    reference, v = rng.standard_normal(n), lfilter([1.0], [1.0, -colour], rng.standard_normal(n))
    v *= 0.5 * np.std(lfilter([0, 1, 0.5], DEN, reference)) / np.std(v)
    u, w = np.zeros(n), np.zeros(n)
    for t in range(n):
        w[t] = (u[t - 1] - DEN[1] * w[t - 1] if t else 0.0) + (0.5 * u[t - 2] - DEN[2] * w[t - 2] if t > 1 else 0.0)
        u[t] = reference[t] - gain * (w[t] + v[t])
    return Series(u, w + v, 1.0, "weak").centred()


@pytest.mark.parametrize("colour", [0.0, 0.7])
def test_weak_loops_are_suspected_and_get_no_intervals(colour: float) -> None:
    """Of white noise only the sample itself shows the loop: its error comes back before the next."""
    found = [condition.examine(weak(0.05, colour, seed)) for seed in range(6)]
    assert sum(c.suspect for c in found) >= 5 and not any(c.feedback for c in found)
    assert not any(condition.examine(weak(0.0, colour, seed)).suspect for seed in range(6))
    report = identify(weak(0.1, 0.0, 0), ("bj",), {"bj": (3, 0, 1, 2, 0)})
    assert any("input may answer the output" in text for text in report.models["bj"].warnings)
    assert np.isnan(report.models["bj"].response.gain_std).all()


@pytest.mark.parametrize(("gain", "least", "most"), [(0.03, 7, 12), (0.0, 0, 1)])
def test_the_disturbance_itself_shows_weak_loops_under_strong_colour(gain: float, least: int, most: int) -> None:
    """Single errors and the sample itself show 4 of these 12 loops."""
    found = sum(condition.examine(weak(gain, 0.9, seed, 3000)).suspect for seed in range(12))
    assert least <= found <= most


@pytest.mark.parametrize(("noise", "suspect"), [(0.3, False), (2.0, True)])
def test_a_feedthrough_is_one_where_it_is_most_of_the_news(noise: float, suspect: bool) -> None:
    rng = np.random.default_rng(3)
    u = rng.standard_normal(2000)
    y = lfilter([1.0, 0.5], [1.0, -0.5], u) + noise * rng.standard_normal(2000)
    assert condition.examine(Series(u, y, 1.0, "direct").centred()).suspect == suspect


def test_a_noise_model_that_another_refutes_has_no_intervals() -> None:
    """White noise on the output is none of ARX: what predicts better is named."""
    found = identify(clean(n=4000), ("arx", "bj"), {"arx": (8, 8, 1), "bj": (2, 0, 0, 2, 1)})
    assert any("BJ (2, 0, 0, 2, 1) predicts the held-out part better" in w or "valid only for white" in w
               for w in found.models["arx"].warnings)  # fmt: skip
    assert np.isnan(found.models["arx"].response.gain_std).all()
    assert np.isfinite(found.models["bj"].response.gain_std).all()


def test_a_zero_of_the_noise_on_the_unit_circle_leaves_no_intervals() -> None:
    """Differenced noise: C = 1 - q^-1, where the estimate of its zero is no Gaussian."""
    u, e = np.random.default_rng(0).standard_normal((2, 2000))
    y = lfilter([0, 1.0], [1, -0.7], u) + lfilter([0.3, -0.3], [1, -0.7], e)
    armax = identify(Series(u, y, 1.0).centred(), ("armax",), {"armax": (1, 1, 1, 1)}).models["armax"]
    assert any("no standard errors or band: a zero of the noise model" in w for w in armax.warnings)
    assert np.isnan(armax.response.gain_std).all()


def test_steps() -> None:
    step = np.r_[np.zeros(100), np.ones(900)]
    assert condition.few_steps(step) and condition.few_steps(
        step + 1e-4 * np.random.default_rng(0).standard_normal(1000)
    )
    assert not condition.few_steps(foot.prbs(1000))
    assert not condition.few_steps(np.random.default_rng(0).standard_normal(1000))


def test_response_without_a_model_and_points_at_the_poles() -> None:
    """The local estimate lies at the truth within its error; the curve reaches the top of a sharp resonance."""
    rng = np.random.default_rng(4)
    den = np.poly([0.985 * np.exp(0.6j), 0.985 * np.exp(-0.6j)]).real
    u = rng.standard_normal(3000)
    y = lfilter([0, 1.0], den, u)
    series = Series(u, y + 0.1 * np.std(y) * rng.standard_normal(3000), 1.0, "sharp").centred()

    def exact(f: np.ndarray) -> np.ndarray:
        shift = np.exp(-2j * np.pi * f)
        return shift / np.polynomial.polynomial.polyval(shift, den)

    at = np.linspace(0.02, 0.3, 40)
    at = at[np.abs(at - 0.6 / 2 / np.pi) > 0.01]
    points = frequency.local(series, at, (0.01, 0.45))
    assert points is not None
    pull = np.abs(points.value - exact(at)) / points.std
    assert np.mean(pull < 2.45) > 0.8  # 95 % of a complex normal number
    found = identify(series, ("oe",), {"oe": (1, 2, 1)})
    top = np.abs(exact(np.linspace(0.08, 0.11, 5000))).max()
    assert np.abs(found.models["oe"].response.value).max() == pytest.approx(top, rel=0.02)
    assert found.nonparametric is not None


def test_rounding_of_a_simulated_recording_is_no_spike_and_a_spike_in_it_is() -> None:
    u = np.random.default_rng(0).standard_normal(1500)
    y = np.array([float(f"{value:.8g}") for value in lfilter([0, 1, 0.5], DEN, u)])
    assert condition.mend(Series(u, y, 1.0).centred())[1] == ()
    y[700] += 2.0
    repaired, where = condition.mend(Series(u, y, 1.0).centred())
    assert where == (700,)
    assert np.ptp(y - repaired.y) == pytest.approx(2.0, abs=1e-5)
