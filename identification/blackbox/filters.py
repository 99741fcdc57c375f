"""What the estimators share about rational filters: roots, pulse responses, delayed columns, free runs."""

import numpy as np
from scipy import linalg, signal


def lfilter(
    num: np.ndarray | list[float], den: np.ndarray | list[float], values: np.ndarray, axis: int = 0
) -> np.ndarray:
    """`scipy.signal.lfilter` along the first axis from rest, without its detours for filters of no or few taps."""
    if len(den) == 1 and len(num) == 1:
        return values * (num[0] / den[0])
    if len(den) == 1 and values.ndim == 1:
        return np.convolve(values, num)[: len(values)] / den[0]
    return signal.lfilter(num, den, values, axis=axis)


def stabilise(polynomial: np.ndarray, radius: float = 0.9995) -> np.ndarray:
    """The monic polynomial (n,) with roots outside the unit circle mirrored into it, and none beyond `radius`."""
    if len(polynomial) < 2:
        return polynomial
    roots = np.roots(polynomial)
    size = np.abs(roots)
    roots = np.where(size > 1.0, 1.0 / np.conj(np.where(size > 1.0, roots, 1.0)), roots)
    roots *= np.minimum(1.0, radius / np.maximum(np.abs(roots), 1e-300))
    stable = np.zeros(len(polynomial))
    inside = np.poly(roots).real
    stable[: len(inside)] = inside
    return stable


def largest_root(polynomial: np.ndarray) -> float:
    """Modulus of the largest root of a polynomial (n,); 0 for a constant."""
    return float(np.abs(np.roots(polynomial)).max(initial=0.0))


def outlasting(largest: float, samples: int) -> bool:
    """Whether a free motion keeps more than a twentieth of its size over `samples`, its `largest` pole given."""
    return largest**samples > 0.05


def pole_warnings(den: np.ndarray, samples: int) -> list[str]:
    """Sentences on poles, roots of `den` (n,), that make free simulation of `samples` samples meaningless."""
    largest = largest_root(den)
    if largest >= 1.0:
        return ["unstable poles: the model predicts one step but cannot be simulated freely"]
    if outlasting(largest, samples):
        return ["a pole is so near the unit circle that its free response is longer than the recording"]
    return []


def free_run(num: np.ndarray, den: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Response (N,) of num/den to `u` plus the free motion and level that fit `y` best; infinite where it is unstable.

    The free motion covers the state at the first sample and the input before it: in the transposed direct form
    each state element enters as a pulse through 1/den.
    """
    if largest_root(den) >= 1.0:
        return np.full(len(u), np.inf)
    forced = lfilter(num, den, u)
    states = max(len(num), len(den)) - 1
    free = np.column_stack([shifted(pulse_response(den, len(u)), states), np.ones(len(u))])
    start, *_ = linalg.lstsq(free, y - forced, lapack_driver="gelsy", cond=1e-10, check_finite=False)
    return forced + free @ start


def as_columns(signals: np.ndarray) -> np.ndarray:
    """Signals as columns (N, m), of one (N,) or of several."""
    return signals.reshape(len(signals), -1)


def pulse_response(den: np.ndarray, length: int) -> np.ndarray:
    """Response (length,) of 1/den to a unit pulse at the first sample."""
    pulse = np.zeros(length)
    pulse[0] = 1.0
    return lfilter([1.0], den, pulse)


def shifted(values: np.ndarray, count: int, first: int = 0) -> np.ndarray:
    """Columns `values` delayed by first, first + 1, ... samples, zero before; shape (N, count), column-major."""
    columns = np.zeros((len(values), count), order="F")
    for k in range(count):
        lag = first + k
        columns[lag:, k] = values[: max(len(values) - lag, 0)]
    return columns
