"""A sampled motion as a later channel shows it: the polynomial through eight samples, read between them."""

import numpy as np

#: Samples that a polynomial runs through, and how many of them stand before the place that is read.
_POINTS, _BEFORE = 8, 3
#: How far [samples] a polynomial is followed beyond the first and the last sample.
_BEYOND = 3
_MIDDLE = (_POINTS - 1) / 2
#: Coefficients (powers, points) of the polynomials that are 1 at one of the points and 0 at the others.
_COEFFICIENTS = np.linalg.inv(np.vander(np.arange(_POINTS) - _MIDDLE, increasing=True))


def delayed(x: np.ndarray, samples: float, order: int = 0) -> np.ndarray:
    """A motion (n, ...) that is read later, or its derivative to the delay.

    Example:
        ``late = delayed(acceleration, delay_s * rate_hz)``

    Args:
        x: (n, ...) uniform samples, eight or more.
        samples: the delay in samples; negative where the channel is early.
        order: 0 for the motion, 1 for its derivative, per sample of delay.
    """
    n, first = len(x), int(np.floor(-samples)) - _BEFORE
    low, high = (int(np.clip(end, 0, n)) for end in (-first, n - _POINTS + 1 - first))
    late = np.empty_like(x)
    inside = _weights(np.array([-samples - first]), order)[0]
    late[low:high] = sum(w * x[low + first + j : high + first + j] for j, w in enumerate(inside))
    for rows, begin in ((slice(0, low), 0), (slice(max(low, high), n), n - _POINTS)):
        place = np.clip(np.arange(n)[rows] - samples - begin, -_BEYOND, _POINTS - 1 + _BEYOND)
        late[rows] = np.tensordot(_weights(place, order), x[begin : begin + _POINTS], 1)
    return late


def _weights(place: np.ndarray, order: int) -> np.ndarray:
    """Weights (m, 8) of the samples in the polynomial at places (m,), or in its derivative to the delay."""
    powers = np.vander(place - _MIDDLE, _POINTS, increasing=True)
    if order:
        powers[:, 1:] = -powers[:, :-1] * np.arange(1, _POINTS)
        powers[:, 0] = 0.0
    return powers @ _COEFFICIENTS
