"""The response to motion of many frequencies: period by period where it repeats itself, by local models where not."""

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.transmissibility.local import local
from fasbody.transmissibility.periodic import by_periods, period_of
from fasbody.transmissibility.response import Response
from fasbody.transmissibility.spectra import excited


def broadband(time_s: np.ndarray, channels: dict[str, np.ndarray], resolution_hz: float = 1.0) -> Response:
    """Channels over the base, over the band that the base excites.

    Args:
        time_s: (n,) [s], uniform. channels: (n,) each [m/s^2], "base" among them. resolution_hz: of the frequencies.

    Raises:
        RecordingError: shorter than three segments of that resolution, or nothing is excited.
    """
    base = channels["base"]
    rate = (time_s.size - 1) / (time_s[-1] - time_s[0])
    use = np.flatnonzero(excited(base, rate, resolution_hz))
    if not use.size:
        raise RecordingError("base_m_s2 excites no band of frequencies.")
    step = rate / round(rate / resolution_hz)
    band = (float(use[0] * step), float(use[-1] * step))
    period = period_of(base, rate, band)
    if period is not None:
        return by_periods(time_s, channels, period, band, resolution_hz)
    first, last = np.ceil(band[0] / resolution_hz - 1e-6), np.floor(band[1] / resolution_hz + 1e-6)
    return local(time_s, channels, np.arange(first, last + 1) * resolution_hz, band, resolution_hz)
