"""Errors that all harmonics share: an uncertain gain and delay of the channels, common to all recordings of a fit.

The residual of all recordings has the covariance S + V V^T: S the noise, recording by recording, and V (n, k) what one
standard deviation of each shared error does to the harmonics, k two or fewer. With S whitened away, V becomes W V =
U s Q^T, and I + W V V^T W^T is whitened by I - sum over k of (1 - 1 / sqrt(1 + s^2)) u u^T: a few inner products.
A nuisance parameter with a normal prior, integrated out, has the same likelihood.
"""

from collections.abc import Sequence

import numpy as np

from fasbody.recording import Recording
from fasbody.shared_error import gain_and_delay

#: Rounds of the misfit's iteration, which contracts.
_ROUNDS = 20


def shared_errors(
    recordings: Sequence[Recording], frequencies_hz: Sequence[float], amplitudes: Sequence[np.ndarray], delay: bool
) -> np.ndarray:
    """V (n, k): real, then imaginary parts of each recording's harmonics, under one standard deviation of each error.

    Nothing is known of how much of a gain's uncertainty belongs to the sensor and how much to its mounting, so it is
    the same error in all recordings: then more recordings do not make it smaller.

    Args:
        recordings: with their calibration. frequencies_hz: of their fundamentals. amplitudes: (H,) malleolus harmonics
            of each [m/s^2]. delay: whether the delay is an error; not where it is estimated.
    """
    columns = []
    for recording, f, Y in zip(recordings, frequencies_hz, amplitudes, strict=True):
        gain_std, delay_std_s = gain_and_delay(recording, "malleolus", "base")
        by_delay = -2j * np.pi * f * np.arange(1, Y.size + 1) * Y
        errors = np.column_stack([gain_std * Y, (delay_std_s if delay else 0.0) * by_delay])
        columns.append(np.concatenate([errors.real, errors.imag]))
    V = np.concatenate(columns)
    return V[:, np.any(V != 0.0, axis=0)]


def misfit(r: np.ndarray, V: np.ndarray, dof: int) -> float:
    """How much larger than stated the noise must be to explain what shared errors leave of a residual, at least 1.

    Where the model misses by more than the noise, shared errors at their stated size would cost nothing beside the
    misfit, and a gain of any size would be believed. So noise and shared errors are weighed against each other after
    the noise has been raised to what is left: S x + V V^T with x = (r^T (I + V V^T / x)^-1 r) / dof, by iteration.

    Args:
        r: residual (n,) and V: shared errors (n, k), both whitened by the noise alone. dof: degrees of freedom; where
            none is left, a residual that is not zero is the end of a descent that went astray, and is judged by one.
    """
    dof = max(1, dof)
    x = max(1.0, float(r @ r) / dof)
    for _ in range(_ROUNDS):
        left = np.linalg.solve(np.eye(V.shape[1]) + V.T @ V / x, V.T @ r)
        x = max(1.0, float(r @ r - (V.T @ r) @ left / x) / dof)
    return x


def projection(V: np.ndarray) -> np.ndarray:
    """P (k, n) of the whitener I - P^T P of I + V V^T; its rows are orthogonal."""
    if not V.size:
        return np.zeros((0, V.shape[0]))
    U, s, _ = np.linalg.svd(V, full_matrices=False)
    return np.ascontiguousarray((U * np.sqrt(1 - 1 / np.sqrt(1 + s**2))).T)
