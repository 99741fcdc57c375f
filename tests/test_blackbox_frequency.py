"""Frequency-response points, the rational function through them, and leaving one frequency out."""

import linear_foot as foot
import numpy as np
import pytest
from recorded_foot import record

from fasbody.exceptions import SettingError
from identification.blackbox import frequency, pem
from identification.blackbox.data import Series
from identification.blackbox.polynomial import Orders

FREQUENCIES = np.arange(10.0, 51.0, 5.0)


def nine(noise: float = 0.25, seed: int = 0) -> list[Series]:
    return [record(foot.sine(f, 4000), 100 * seed + int(f), noise) for f in FREQUENCIES]


def test_points_are_right_within_their_deviation() -> None:
    data = frequency.points(nine())
    np.testing.assert_allclose(data.frequency_hz, FREQUENCIES, atol=1e-3)
    error = np.abs(data.value - foot.response(FREQUENCIES)) / data.std
    assert error.max() < 4.5  # two numbers each, 18 in all
    assert 0.4 < error.mean() < 2.2


def test_multisine_lines_off_the_bins() -> None:
    """Lines 7.3 Hz apart do not fall on bins of a 4 s record."""
    data = frequency.points(record(foot.multisine(4000, 7.3, 8), 0, noise=0.02))
    np.testing.assert_allclose(data.frequency_hz, 7.3 * np.arange(1, 9), atol=0.01)
    assert np.abs(data.value / foot.response(data.frequency_hz) - 1).max() < 0.02


def test_repeated_recordings_are_averaged() -> None:
    one = frequency.points(nine())
    many = frequency.points([*nine(), *nine(seed=1), *nine(seed=2), *nine(seed=3)])
    assert len(many) == 9
    np.testing.assert_allclose(many.std, one.std / 2, rtol=0.05)


def test_rational_function_is_recovered_exactly() -> None:
    """Points of a known 2/4 function in s give its coefficients back."""
    num, den = [1.0, 0.4, 0.08], [1.0, 0.5, 2.1, 0.6, 0.9]
    s = 1j * FREQUENCIES / FREQUENCIES.max()
    value = np.polynomial.polynomial.polyval(s, num) / np.polynomial.polynomial.polyval(s, den)
    found = frequency.rational(frequency.Points(FREQUENCIES, value, np.full(9, 1e-6)))
    np.testing.assert_allclose(found.num, num, rtol=1e-6)
    np.testing.assert_allclose(found.den, den, rtol=1e-6)
    transfer = found.to_transfer_function()
    _, direct = transfer.freqresp(2 * np.pi * FREQUENCIES)
    np.testing.assert_allclose(direct, value, rtol=1e-6)
    np.testing.assert_allclose(np.sort_complex(found.poles()), np.sort_complex(transfer.poles), rtol=1e-6)


def test_foot_from_nine_sines_and_each_predicted_from_the_others() -> None:
    data = frequency.points(nine())
    found = frequency.rational(data)
    band = np.arange(10.0, 50.1, 1.0)
    response = found.response(band)
    assert np.abs(response.value / foot.response(band) - 1).max() < 0.006
    assert found.chi_square < 45  # 11 degrees of freedom
    left = frequency.leave_one_out(data)
    assert left.inside < 0.01
    assert left.error.shape == (9,)


def test_leaving_a_frequency_out_shows_a_model_that_cannot_predict() -> None:
    """Order four predicts the frequency left out, a first-order lag does not."""
    recordings = [record(foot.sine(f, 1500), int(f)) for f in FREQUENCIES[::2]]
    data = frequency.points(recordings)

    def worst(n: int) -> float:
        errors = []
        for k in range(1, len(recordings) - 1):
            model = pem.estimate("oe", recordings[:k] + recordings[k + 1 :], Orders(nb=n, nf=n, nk=1))
            errors.append(abs(model.response(data.frequency_hz[k]).value[0] / data.value[k] - 1))
        return max(errors)

    assert worst(4) < 0.03
    assert worst(1) > 0.3


def test_continuous_spectrum_and_too_few_points() -> None:
    with pytest.raises(SettingError, match="continuous spectrum"):
        frequency.points(record(foot.prbs(3000), 0))
    with pytest.raises(SettingError, match="record more frequencies"):
        frequency.rational(frequency.points(nine()[:3]))


def test_a_bad_rational_fit_and_nonlinear_distortion_are_said() -> None:
    """The nonlinear foot's sines have harmonics and no rational function; the linear foot's draw no sentence."""
    noise = np.random.default_rng(0)
    bent = []
    for f in FREQUENCIES:
        u = foot.sine(f, 2000)
        y = foot.linear_output(u)
        bent.append(Series(u, y + 0.004 * y**2 + 0.02 * noise.standard_normal(2000), foot.SAMPLE_TIME, "bent"))
    data = frequency.points(bent)
    size = np.max([np.abs(foot.response(np.array([f]))[0]) * foot.AMPLITUDE for f in FREQUENCIES])
    assert data.distortion == pytest.approx(0.004 * size / 2, rel=0.05)  # cos^2 = (1 + cos 2) / 2
    assert any("nonlinear distortion" in text for text in frequency.rational(data).warnings)
    assert frequency.rational(frequency.points(nine())).warnings == ()
    off = frequency.Points(data.frequency_hz, data.value * (1 + 0.1 * (-1) ** np.arange(9)), data.std)
    assert "does not fit the points" in frequency.rational(off).warnings[0]
