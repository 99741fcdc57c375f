"""The single mass on spring and damper of Figure 2.9, and which (k, c) agree with a measured transmissibility."""

from dataclasses import dataclass

import numpy as np

from fasbody.exceptions import SettingError

#: Mass of shank and foot [kg], section 2.3.3.
MASS_KG = 4.3


def response(omega: np.ndarray, m: float | np.ndarray, c: float | np.ndarray, k: float | np.ndarray) -> np.ndarray:
    """Complex y_o / y_i of a base-excited mass; all arguments broadcast.

    Args:
        omega: [rad/s]. m: [kg]. c: [N s/m]. k: [N/m].
    """
    s = 1j * omega
    return (c * s + k) / (m * s**2 + c * s + k)  # Eq. (2.4) for harmonic y_i and y_o


def transmissibility(
    omega: float | np.ndarray, m: float | np.ndarray, c: float | np.ndarray, k: float | np.ndarray
) -> np.ndarray:
    """T (n,), with the square on omega [rad/s] that the print omits (docs/errata.md); arguments as `response`."""
    return np.sqrt((k**2 + (omega * c) ** 2) / ((k - m * omega**2) ** 2 + (omega * c) ** 2))  # Eq. (2.5)


def damping_for(T: float, omega: float, m: float, k: np.ndarray) -> np.ndarray:
    """Damping c [N s/m] that gives transmissibility T at stiffness k (n,) [N/m]; NaN where none does.

    The closed form of the contour lines in Figure 2.10: Eq. (2.5) solved for c.
    """
    above = k**2 - T**2 * (k - m * omega**2) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = above / (omega**2 * (T**2 - 1))
        return np.where(squared >= 0, np.sqrt(np.maximum(squared, 0)), np.nan)


@dataclass(frozen=True, eq=False)
class Region:
    """Stiffness and damping that agree with measured transmissibilities.

    Attributes:
        k: (n,) [N/m]. c: (p,) [N s/m]. z: (p, n) largest misfit in standard deviations. limit: what agrees.
    """

    k: np.ndarray
    c: np.ndarray
    z: np.ndarray
    limit: float

    @property
    def inside(self) -> np.ndarray:
        """(p, n) True where the model agrees."""
        return self.z <= self.limit

    def __str__(self) -> str:
        if not self.inside.any():
            return f"no single mass agrees (best misfit {self.z.min():.1f} standard deviations)"
        rows, columns = np.nonzero(self.inside)
        k, c = self.k[columns], self.c[rows]
        return f"k {k.min():.3g} to {k.max():.3g} N/m, c {c.min():.3g} to {c.max():.3g} N s/m"


def region(
    frequency_hz: np.ndarray,
    measured: np.ndarray,
    std: np.ndarray,
    m: float = MASS_KG,
    k: np.ndarray | None = None,
    c: np.ndarray | None = None,
    limit: float = 1.96,
) -> Region:
    """Where in the plane of Figure 2.10 the single mass agrees with all measured transmissibilities at once.

    Args:
        frequency_hz, measured, std: (f,) frequency, transmissibility and its standard deviation. m: mass [kg].
        k, c: grids [N/m], [N s/m]; default 1e3 to 4e5 and 10 to 4000. limit: misfit that agrees [standard deviations].

    Raises:
        SettingError: shapes differ, or a standard deviation is not positive.
    """
    f, T, s = (np.atleast_1d(np.asarray(v, float)) for v in (frequency_hz, measured, std))
    if not f.shape == T.shape == s.shape or np.any(s <= 0) or np.any(f <= 0):
        raise SettingError("frequencies, transmissibilities and positive standard deviations must be equally many.")
    k = np.geomspace(1e3, 4e5, 300) if k is None else k
    c = np.geomspace(10, 4e3, 240) if c is None else c
    model = transmissibility(2 * np.pi * f[:, None, None], m, c[:, None], k)
    z = np.abs(model - T[:, None, None]) / s[:, None, None]
    return Region(k, c, z.max(axis=0), limit)
