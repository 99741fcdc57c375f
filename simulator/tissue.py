"""Aponeurosis and plantar ligaments as tissue: laws with a toe region, from samples in a testing machine.

The springs of `Arch` have a constant stiffness. Here it follows from the stretch under the load, so that the arch is
linear only about the pose in which it stands. No number of a whole foot is in these laws but the two that are called
free.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from fasbody.arch.kinematics import Array
from fasbody.exceptions import ModelError

#: Natali 2010, plantar fascia: matrix mu [Pa], fibres k [Pa] and a [1].
NATALI_MU, NATALI_K, NATALI_A = 14.449e6, 254.02e6, 10.397
#: Ligaments of the foot, Gefen 2002 as fitted by D'Hondt 2024 (10.1371/journal.pcbi.1012219): stress [Pa] and exponent
#: [1]. Their offset of 0.18 % of stretch is left out, so that a ligament is at rest where its joint is.
LIGAMENT_STRESS, LIGAMENT_EXPONENT = 7.9884e6, 8.2061


@dataclass(frozen=True, kw_only=True)
class Tissue:
    """Aponeurosis and ligaments, by size; SI units. Numbers, or arrays of one shape for many feet at once.

    Attributes:
        arm: of the ligaments below each joint [m]. Free: one ligament stands for all that cross the joint.
        slack: elongation of the sole at which the aponeurosis begins to pull [m]. Free.
        area, length: of the aponeurosis [m^2], [m]; D'Hondt 2024, 70 mm^2 and 146 mm.
        ligament_area, ligament_length: spring ligament [m^2], [m]; D'Hondt 2024, 35 mm^2 and 14.6 mm.
    """

    arm: Any
    slack: Any
    area: Any = 70e-6
    length: Any = 0.146
    ligament_area: Any = 35e-6
    ligament_length: Any = 14.6e-3

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            low = 0.0 if name in ("area", "slack") else np.nextafter(0, 1)
            if not (np.isfinite(value) & (np.asarray(value) >= low)).all():
                valid = "zero or more" if low == 0 else "above zero"
                raise ModelError(f"tissue: {name} is {value}, but must be {valid}.")

    def tension(self, e: Array) -> Array:
        """Of the aponeurosis [N] at elongations e [m] of the sole, any shape; none while it is slack."""
        taut = np.real(e) > self.slack
        stretch = 1 + np.where(taut, e - self.slack, 0) / self.length
        fibres = NATALI_K / (2 * NATALI_A) * np.expm1(NATALI_A * (stretch**2 - 1)) * stretch**2
        cauchy = NATALI_MU * (stretch**2 - 1 / stretch) + fibres
        return self.area * cauchy / stretch  # the section shrinks as the length grows

    def moment(self, joint: int, d: Array) -> Array:
        """Of the ligaments [N m] at turns d [rad], any shape; those of the other side hold a turn the other way."""
        side = np.where(np.real(d) < 0, -1, 1)
        strain = self.arm * side * d / self.ligament_length
        return side * self.arm * self.ligament_area * LIGAMENT_STRESS * np.expm1(LIGAMENT_EXPONENT * strain)

    def tangent(self, e: Array) -> Array:
        """Stiffness of the aponeurosis [N/m] at elongations e [m] of the sole, any shape."""
        return self.tension(np.asarray(e) + 1e-30j).imag / 1e-30

    def cut(self) -> Self:
        """The same foot without its aponeurosis."""
        return replace(self, area=np.zeros_like(self.area, float))
