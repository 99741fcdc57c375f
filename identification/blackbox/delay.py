"""The delay n_k of a plant: where its pulse response begins, however late."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fasbody.exceptions import FasError
from identification.blackbox import pem
from identification.blackbox.data import Series
from identification.blackbox.polynomial import Orders

NEAR = range(1, 6)  # n_k always compared
CERTAIN = 4.0  # standard errors that the coefficient of direct feedthrough must stand out by
BACK = (0, 1, 2, 4, 8, 16, 32)  # samples before the peak of the pulse response at which it may begin
DECISIVE = 10.0  # N times the difference of log losses that a late response must win by
LONGEST = 1000  # samples searched for the peak


def estimate(recordings: Sequence[Series], *, far: bool = True) -> int:
    """Delay whose output-error model of order four has the least loss.

    Compared are 1 to 5 and, with `far`, lags from the peak of the pulse response backwards, then their neighbours while
    the loss falls. Where 1 is best, it is 0 when a coefficient of direct feedthrough added to B is certain.

    Args:
        recordings: estimation data, means removed.
        far: search beyond 5; without meaning for single sines, whose pulse response is periodic.
    """
    losses: dict[int, float] = {}

    def loss(nk: int) -> float:
        if nk not in losses:
            try:
                at = pem.estimate("oe", recordings, Orders(nb=4, nf=4, nk=nk))
                losses[nk] = float(np.log(max(at.loss, 1e-300)))
            except FasError:
                losses[nk] = np.inf
        return losses[nk]

    best = min(NEAR, key=lambda nk: (round(loss(nk), 4), nk))
    samples = sum(len(series) for series in recordings)
    peak = pulse_peak(recordings) if far else 0
    late = [peak - back for back in BACK if peak - back > NEAR[-1]]
    if late:
        start = min(late, key=loss)
        while (after := min((start - 1, start, start + 1), key=loss)) != start:
            start = after
        if loss(start) < loss(best) - DECISIVE / samples:
            best = start
    if not np.isfinite(loss(best)):
        return 1
    return 0 if best == 1 and _feedthrough(recordings) else best


def _feedthrough(recordings: Sequence[Series]) -> bool:
    try:
        model = pem.estimate("oe", recordings, Orders(nb=5, nf=4, nk=0))
    except FasError:
        return False
    return bool(abs(model.theta[0]) > CERTAIN * model.std_error[0])


def pulse_peak(recordings: Sequence[Series]) -> int:
    """Lag of the largest response to a pulse, from spectra divided where the input is strong."""
    length = min(len(series) for series in recordings)
    size = 2 * max(len(series) for series in recordings)  # padded, so that no end meets the beginning
    spectra = [(np.fft.rfft(series.u, size), np.fft.rfft(series.y, size)) for series in recordings]
    power = np.sum([np.abs(u) ** 2 for u, _ in spectra], axis=0)
    cross = np.sum([y * np.conj(u) for u, y in spectra], axis=0)
    pulse = np.fft.irfft(cross / (power + 0.01 * power.max()), size)
    return int(np.argmax(np.abs(pulse[: min(LONGEST, length // 4)])))
