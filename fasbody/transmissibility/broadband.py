"""The response to motion of many frequencies: period by period where it repeats itself, by local models where not.

H1, H2 and Hv by Welch's method are available, too, with their resolution error.
"""

import numpy as np

from fasbody.exceptions import RecordingError, SettingError, unknown
from fasbody.recording.clock import rate_of
from fasbody.transmissibility.local import local
from fasbody.transmissibility.periodic import by_periods, period_of
from fasbody.transmissibility.response import Response
from fasbody.transmissibility.spectra import WELCH, by_welch, excited

#: The estimates to choose from; "best" is by periods or by local models.
ESTIMATES = ("best", *WELCH)


def broadband(
    time_s: np.ndarray, channels: dict[str, np.ndarray], resolution_hz: float = 1.0, estimate: str = "best"
) -> Response:
    """Channels over the base, over the band that the base excites.

    Args:
        time_s: (n,) [s], uniform.
        channels: (n,) each [m/s^2], "base" among them.
        resolution_hz: of the frequencies.
        estimate: one of `ESTIMATES`.

    Raises:
        RecordingError: shorter than three segments of that resolution, or nothing is excited.
        SettingError: no such estimate.
    """
    if estimate not in ESTIMATES:
        raise SettingError(f"{unknown('estimate', estimate, ESTIMATES)}.")
    base = channels["base"]
    rate = rate_of(time_s)
    use = np.flatnonzero(excited(base, rate, resolution_hz))
    if not use.size:
        raise RecordingError("base_m_s2 excites no band of frequencies.")
    step = rate / round(rate / resolution_hz)
    band = (float(use[0] * step), float(use[-1] * step))
    period = period_of(base, rate, band)
    best = by_periods(time_s, channels, period, band, resolution_hz) if period else None
    if best is None or not best.frequency_hz.size:  # few lines can repeat themselves nearly
        first, last = band[0] / resolution_hz - 1e-6, band[1] / resolution_hz + 1e-6
        frequency = np.arange(np.ceil(first), np.floor(last) + 1) * resolution_hz
        best = local(time_s, channels, frequency, band, resolution_hz)
    return best if estimate == "best" else _averaged(channels, rate, resolution_hz, estimate, best)


def _averaged(
    channels: dict[str, np.ndarray], rate_hz: float, resolution_hz: float, kind: str, best: Response
) -> Response:
    """By Welch's method; its resolution error is stated where it differs from the best estimate beyond noise."""
    use = excited(channels["base"], rate_hz, resolution_hz)
    H, bias, frequency = {}, {}, np.empty(0)
    outs = [name for name in channels if name != "base"]
    covariance = {(a, b): np.zeros(use.sum(), complex) for a in outs for b in outs}
    for name in outs:
        welch = by_welch(channels["base"], channels[name], rate_hz, resolution_hz, use, kind)
        frequency, H[name] = welch.frequency_hz, welch.H
        right = np.interp(frequency, best.frequency_hz, best.H[name])
        beyond = np.abs(welch.H - right) > 2 * welch.std
        bias[name] = np.where(beyond, np.abs(welch.H / right) - 1, 0.0)
        covariance[name, name] += 2 * welch.std**2
    return Response(f"{kind} by Welch", frequency, H, covariance, {}, bias)
