"""A frequency response with its uncertainty, as every model gives it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Response:
    """A frequency response with its uncertainty.

    Attributes:
        frequency_hz: shape (M,).
        value: complex, shape (M,).
        spread: square root S of the covariance S S' of (real, imaginary), shape (M, 2, m).
    """

    frequency_hz: np.ndarray
    value: np.ndarray
    spread: np.ndarray

    def _along(self, direction: np.ndarray) -> np.ndarray:
        parts = np.stack([direction.real, direction.imag], axis=-1)
        return np.linalg.norm(np.einsum("mi,mij->mj", parts, self.spread), axis=1)

    @property
    def gain_std(self) -> np.ndarray:
        """Standard deviation of the gain, shape (M,)."""
        with np.errstate(invalid="ignore"):
            return self._along(self.value / np.maximum(np.abs(self.value), 1e-300))

    @property
    def phase_std_deg(self) -> np.ndarray:
        """Standard deviation of the phase in degrees, shape (M,)."""
        with np.errstate(invalid="ignore"):
            size = np.maximum(np.abs(self.value), 1e-300)
            return np.rad2deg(self._along(1j * self.value / size) / size)
