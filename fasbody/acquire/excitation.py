"""Was the foot shaken at all? Asked of recordings whose excitation has no stated frequency (broadband, or by hand)."""

import numpy as np

from fasbody.recording.recording import Recording

#: Excitation begins here [Hz]; slower motion is drift and leaning.
_SLOWEST_HZ = 3.0
#: A base that moves by less [m/s^2 rms] is at rest: simple sensors have 0.03 to 0.1 of noise, the thesis shakes at 6.3.
_AT_REST = 0.2


def absent(recording: Recording) -> str:
    """Why a recording shows no excitation, or nothing."""
    base = recording.base_m_s2 - recording.base_m_s2.mean()
    spectrum = np.fft.rfft(base)
    frequency = np.fft.rfftfreq(base.size, 1 / recording.rate_hz)
    rms = float(np.sqrt(2 * np.sum(np.abs(spectrum[frequency >= _SLOWEST_HZ]) ** 2)) / base.size)
    if rms >= _AT_REST:
        return ""
    return f"the base is at rest ({rms:.2g} m/s^2 rms above {_SLOWEST_HZ:g} Hz); was the shaker on"
