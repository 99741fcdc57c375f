"""The two-mass foot: Eqs. (4.26) to (4.33).

States are x = (z1, z2, z1', z2'): z1 = y1 - y2 across the talocrural joint, z2 = y2 - y0 across the fat pad. The input
is the base acceleration, the output the malleolus acceleration.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fasbody.foot.damper import damping

#: Order of the parameters everywhere in this module.
NAMES = ("k_T", "k_F", "c_11", "c_12", "c_13", "c_21", "c_22", "c_23")
#: The two masses, whose sensitivities follow those to the parameters.
MASSES = ("m_S", "m_F")
STATES = 4


@dataclass(frozen=True)
class TwoDof:
    """Parameters and masses of the two-mass foot, in SI units."""

    k_T: float
    k_F: float
    c_11: float
    c_12: float
    c_13: float
    c_21: float
    c_22: float
    c_23: float
    m_S: float
    m_F: float

    @classmethod
    def from_values(cls, values: Mapping[str, float]) -> "TwoDof":
        """From named values, such as `Foot.values()`; other names are ignored."""
        return cls(**{name: float(values[name]) for name in (*NAMES, *MASSES)})

    @property
    def theta(self) -> np.ndarray:
        """(8,) parameters in the order of `NAMES`."""
        return np.array([getattr(self, name) for name in NAMES])

    def rates(self, t: float, x: np.ndarray, u: float) -> np.ndarray:
        """State derivative F of Eq. (4.33) at states x (4,) [m, m/s] and base acceleration u [m/s^2].

        The stretches of Eq. (4.27) obey Eq. (4.28), which is solved here for their accelerations.
        """
        f_T, f_F = self.forces(x)
        z1_ddot = (f_F - f_T) / self.m_F - f_T / self.m_S  # Eq. (4.29), first row
        z2_ddot = (f_T - f_F) / self.m_F - u  # Eq. (4.29), second row
        return np.array([x[2], x[3], z1_ddot, z2_ddot])

    def forces(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces (F_T, F_F) [N] of ankle and fat pad at states x (4, ...): the ordinates of the hysteresis loops."""
        c_T = damping(x[0], self.c_11, self.c_12, self.c_13)  # Eq. (4.32)
        c_F = damping(x[1], self.c_21, self.c_22, self.c_23)  # Eq. (4.32)
        return self.k_T * x[0] + c_T * x[2], self.k_F * x[1] + c_F * x[3]  # Eq. (4.42)

    def output(self, x: np.ndarray) -> np.ndarray:
        """Malleolus acceleration [m/s^2] at states x (4, ...)."""
        return -self.forces(x)[0] / self.m_S  # Eq. (4.31)

    def foot_output(self, x: np.ndarray) -> np.ndarray:
        """Acceleration z2'' + u of the foot's mass [m/s^2], Eq. (4.29), second row, at states x (4, ...)."""
        f_T, f_F = self.forces(x)
        return (f_T - f_F) / self.m_F

    def state_space(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A (4, 4), B (4,), C (4,) of the linear model, with c_T = c_11 and c_F = c_21."""
        k_T, k_F, c_T, c_F, m_S, m_F = self.k_T, self.k_F, self.c_11, self.c_21, self.m_S, self.m_F
        inverse_mass = (m_S + m_F) / (m_S * m_F)
        A = np.array(  # Eq. (4.30)
            [[0, 0, 1, 0], [0, 0, 0, 1], [-inverse_mass * k_T, k_F / m_F, -inverse_mass * c_T, c_F / m_F],
             [k_T / m_F, -k_F / m_F, c_T / m_F, -c_F / m_F]]
        )  # fmt: skip
        return A, np.array([0.0, 0.0, 0.0, -1.0]), -np.array([k_T, 0.0, c_T, 0.0]) / m_S

    def transmissibility(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Complex malleolus/base acceleration of the linear model at (n,) frequencies [Hz]."""
        A, B, C = self.state_space()
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequency_hz, float))
        return np.linalg.solve(s[:, None, None] * np.eye(STATES) - A, B[:, None])[..., 0] @ C

    def mirror(self) -> "TwoDof":
        """The mirror image: the other foot with the same linear response, stiffness and damping exchanged.

        They are scaled by a = m_S / (m_S + m_F), exactly for the linear part. The nonlinear constants change places
        unscaled, a starting point for a fit.
        """
        a = self.m_S / (self.m_S + self.m_F)
        return TwoDof(
            k_T=a * self.k_F, k_F=self.k_T / a, c_11=a * self.c_21, c_21=self.c_11 / a,
            c_12=self.c_22, c_13=self.c_23, c_22=self.c_12, c_23=self.c_13, m_S=self.m_S, m_F=self.m_F,
        )  # fmt: skip
