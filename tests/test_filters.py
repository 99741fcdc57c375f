"""The filter and the peak-to-peak method, against the closed form and against signals of known transmissibility."""

import numpy as np
import pytest
from scipy.signal import butter, freqz

from fasbody.exceptions import SettingError
from fasbody.transmissibility.spectra import lowpass, peak_to_peak

T = np.arange(10_000) / 1000


def gain(zero_phase: bool, f: float) -> complex:
    """Response of the filter at one frequency, from the middle of a long sine."""
    x = np.exp(2j * np.pi * f * T)
    y = lowpass(x.real, 1000, zero_phase) + 1j * lowpass(x.imag, 1000, zero_phase)
    return complex(np.mean(y[3000:7000] / x[3000:7000]))


@pytest.mark.parametrize("f", [10.0, 50.0, 100.0, 150.0])
def test_single_pass_is_the_butterworth_filter_and_two_passes_its_square(f: float) -> None:
    b, a = butter(5, 100, fs=1000)
    H = freqz(b, a, worN=[f], fs=1000)[1][0]
    assert gain(False, f) == pytest.approx(H, abs=1e-6)
    assert gain(True, f) == pytest.approx(abs(H) ** 2, abs=1e-6)


def test_stated_shift_and_attenuation() -> None:
    assert np.degrees(np.angle(gain(False, 50.0))) == pytest.approx(-93, abs=1.5)
    assert 20 * np.log10(abs(gain(False, 100.0))) == pytest.approx(-3.01, abs=0.01)
    assert 20 * np.log10(abs(gain(True, 100.0))) == pytest.approx(-6.02, abs=0.02)


def test_cutoff_must_be_below_half_the_rate() -> None:
    with pytest.raises(SettingError, match="faster than 200 Hz"):
        lowpass(T, 200)


@pytest.mark.parametrize("zero_phase", [True, False])
def test_peak_to_peak_of_clean_sines_is_their_ratio(zero_phase: bool) -> None:
    base, out = np.sin(2 * np.pi * 20 * T), 1.3 * np.sin(2 * np.pi * 20 * T - 0.7)
    assert peak_to_peak(out, base, 1000, zero_phase) == pytest.approx(1.3, rel=2e-3)
    assert peak_to_peak(out, base, 1000, zero_phase, frequency_hz=20) == pytest.approx(1.3, rel=5e-3)


def test_peak_to_peak_is_biased_by_a_second_harmonic() -> None:
    w = 2 * np.pi * 10 * T
    out = 1.3 * np.sin(w) + 0.26 * np.sin(2 * w)
    fine = np.linspace(0, 2 * np.pi, 100_000)
    gains = [abs(gain(True, f)) for f in (10.0, 20.0)]
    ranges = np.ptp(1.3 * gains[0] * np.sin(fine) + 0.26 * gains[1] * np.sin(2 * fine)) / (2 * gains[0])
    assert peak_to_peak(out, np.sin(w), 1000) == pytest.approx(ranges, rel=2e-3)
    assert ranges > 1.3 * 1.03  # what a reader of section 2.2.3 should know
