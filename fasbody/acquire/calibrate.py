"""The sensitivity of a sensor from a hand calibrator, or from a turn in gravity, with any digitiser."""

import math

import numpy as np

from fasbody.constants import GRAVITY
from fasbody.exceptions import AcquisitionError
from fasbody.recording.harmonics import columns

#: So much of full scale is clipping; so many samples of it are a click and no signal that is cut off.
FULL, STRAY = 0.999, 1
#: A calibrator's third harmonic is smaller (share of its tone), unless something on the way clips.
_THIRD = 0.03
#: A calibrator's tone is measured in pieces [s].
_PIECE_S = 0.25


def within(values: np.ndarray, what: str) -> None:
    """Raise AcquisitionError if a signal (n,) of full scale is clipped."""
    count = int(np.sum(np.abs(values) >= FULL))
    if count > STRAY:
        raise AcquisitionError(
            f"{what} is at full scale in {count} of {values.size} samples, so its peaks are cut off; turn the input's "
            "gain down and calibrate anew, loopback first."
        )


def calibrator(
    values: np.ndarray, corner_hz: float, rate_hz: float, frequency_hz: float = 159.155, rms_m_s2: float = 10.0
) -> float:
    """Acceleration at full scale [m/s^2] of a sensor on a hand calibrator.

    Args:
        values: (n,) of full scale.
        corner_hz: of the input's high-pass; 0 if direct.
        rate_hz: of the values.
        frequency_hz: of the calibrator.
        rms_m_s2: of the calibrator.
    """
    from scipy.optimize import minimize_scalar

    within(values, "the sensor on the calibrator")
    t = np.arange(values.size) / rate_hz

    def fit(hz: float, part: slice) -> tuple[float, float]:
        """Amplitude of a sine in a part, and the rms of what it leaves."""
        basis = columns(2 * np.pi * hz * t[part], 1)
        c, *_ = np.linalg.lstsq(basis, values[part], rcond=None)
        return float(np.hypot(c[1], c[2])), float(np.std(values[part] - basis @ c))

    spectrum, hz = np.abs(np.fft.rfft(values * np.hanning(values.size))), np.fft.rfftfreq(values.size, 1 / rate_hz)
    near = np.abs(hz / frequency_hz - 1) < 0.03
    peak, width = float(hz[near][np.argmax(spectrum[near])]), rate_hz / values.size
    tone_hz = float(
        minimize_scalar(lambda f: fit(f, slice(None))[1], bounds=(peak - width, peak + width), method="bounded").x
    )
    piece = round(_PIECE_S * rate_hz)
    starts = range(0, values.size - piece + 1, piece)
    parts = [fit(tone_hz, slice(start, start + piece)) for start in starts]
    size, rest = (float(np.median(column)) for column in zip(*parts, strict=True))  # a knock spoils one of them
    if not size > 10 * rest:
        raise AcquisitionError(f"no tone of {frequency_hz:g} Hz stands out; is the sensor on the running calibrator?")
    third = float(np.median([fit(3 * tone_hz, slice(start, start + piece))[0] for start in starts])) / size
    if not third < _THIRD:
        raise AcquisitionError(
            f"the tone's third harmonic is {100 * third:.2g} % of it (at most {100 * _THIRD:g}); does the sensor's "
            "amplifier clip, or does the sensor rattle?"
        )
    return float(math.sqrt(2) * rms_m_s2 / size / math.hypot(1, corner_hz / frequency_hz))


def flip(values: np.ndarray, corner_hz: float, rate_hz: float) -> float:
    """Acceleration at full scale [m/s^2] of a sensor that was turned upside down once, upright first: a step of -2 g.

    The coupling is undone exactly, as an integral; an offset makes a straight line of it, which the step stands on.

    Args:
        values: (n,) of full scale, with a second and a half of rest on either side of the turn.
        corner_hz: of the input's high-pass; 0 if direct.
        rate_hz: of the values.
    """
    within(values, "the sensor that is turned over")
    t = np.arange(values.size) / rate_hz
    whole = values + 2 * np.pi * corner_hz * np.cumsum(values) / rate_hz
    short, rest_s, turn_s = round(0.1 * rate_hz), 1.5, 0.6
    means = whole[: whole.size // short * short].reshape(-1, short).mean(axis=1)
    turn = (0.5 + float(np.argmax(np.abs(means[4:] - means[:-4]))) + 2) * short / rate_hz
    near = np.abs(t - turn)
    rest = (near > turn_s) & (near < turn_s + rest_s)
    if min(np.sum(rest & (t < turn)), np.sum(rest & (t > turn))) < 0.9 * rest_s * rate_hz:
        raise AcquisitionError("the turn is too near an end; hold still three seconds, turn over, hold still again.")
    basis = np.column_stack([np.ones(t.size), t > turn, (t - turn) * (corner_hz > 0)])[rest]
    c, *_ = np.linalg.lstsq(basis, whole[rest], rcond=None)
    noise = float(np.std(whole[rest] - basis @ c))
    if not abs(c[1]) > 4 * noise:
        raise AcquisitionError("no step stands out; hold the sensor still, turn it over once, hold it still again.")
    return float(-2 * GRAVITY / c[1])
