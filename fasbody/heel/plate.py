"""A force plate: from the volts of its channels to newtons, and to the point where the force acts.

The gains and distances are those of Baines, Schwab and van Soest (2018), doi
10.1371/journal.pone.0197428, unless a study.toml says otherwise.
"""

from dataclasses import dataclass

import numpy as np

from fasbody.constants import MODEL_GRAVITY
from fasbody.exceptions import RecordingError


@dataclass(frozen=True)
class Plate:
    """Geometry and calibration of a plate with four vertical sensors.

    Attributes:
        rate_hz: samples a second.
        mass_kg: the known mass that calibrates it.
        gravity_m_s2: as the authors took it.
        centre_m: the middle of the sensors (x, y).
        reach_m: half the distance of the sensors along x and y.
    """

    rate_hz: float = 3000.0
    mass_kg: float = 25.01
    gravity_m_s2: float = MODEL_GRAVITY
    centre_m: tuple[float, float] = (0.2, 0.3)
    reach_m: tuple[float, float] = (0.12, 0.2)

    def gain(self, calibration_volts: np.ndarray) -> float:
        """Newtons a volt: the mean over calibrations.

        Args:
            calibration_volts: (n,), each the sum of the vertical channels under `mass_kg`.

        Raises:
            RecordingError: there is no calibration, or it is no plausible one.
        """
        volts = np.atleast_1d(np.asarray(calibration_volts, float))
        if volts.size == 0 or not (np.isfinite(volts).all() and (volts > 0).all()):
            raise RecordingError(
                f"there is no calibration (the volts under {self.mass_kg:g} kg), so volts cannot become newtons."
            )
        return float(np.mean(self.mass_kg * self.gravity_m_s2 / volts))

    def newtons(self, volts: np.ndarray, offset_volts: np.ndarray, gain: float) -> np.ndarray:
        """Forces (n, 4) [N] of the vertical sensors, less what the empty plate showed before.

        Args:
            volts: (n, 8) channels: x (2), y (2), z (4).
            offset_volts: (8,) of the empty plate.
            gain: of `gain` [N/V].
        """
        return gain * (np.asarray(volts, float)[:, 4:] - np.asarray(offset_volts, float)[4:])

    def application(self, forces: np.ndarray) -> np.ndarray:
        """Point of application (n, 2) [m] of four forces (n, 4) [N]; NaN where the sum is nothing."""
        f1, f2, f3, f4 = forces.T
        total = np.where(forces.sum(axis=1) == 0.0, np.nan, forces.sum(axis=1))
        x = self.centre_m[0] + self.reach_m[0] * (f2 + f3 - f1 - f4) / total
        y = self.centre_m[1] + self.reach_m[1] * (f1 + f2 - f3 - f4) / total
        return np.column_stack([x, y])
