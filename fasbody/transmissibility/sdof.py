"""The single mass on spring and damper of Figure 2.9."""

import numpy as np

#: Mass of shank and foot [kg], section 2.3.3.
MASS_KG = 4.3


def response(omega: np.ndarray, m: float | np.ndarray, c: float | np.ndarray, k: float | np.ndarray) -> np.ndarray:
    """Complex y_o / y_i of a base-excited mass; all arguments broadcast.

    Args:
        omega: of the base [rad/s].
        m: mass [kg].
        c: damping [N s/m].
        k: stiffness [N/m].
    """
    s = 1j * omega
    return (c * s + k) / (m * s**2 + c * s + k)  # Eq. (2.4) for harmonic y_i and y_o


def transmissibility(
    omega: float | np.ndarray, m: float | np.ndarray, c: float | np.ndarray, k: float | np.ndarray
) -> np.ndarray:
    """T (n,), with the square on omega [rad/s] that the print omits (docs/errata.md); arguments as `response`."""
    return np.sqrt((k**2 + (omega * c) ** 2) / ((k - m * omega**2) ** 2 + (omega * c) ** 2))  # Eq. (2.5)
