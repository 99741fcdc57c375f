"""The subjects of Table 2.1 and the segment masses of section 4.5.

Under what a recording was made: subject, posture, load, frequency, and the masses that follow from them.
"""

from dataclasses import dataclass

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.presentation import Tabled

#: Share of the body mass, section 4.5 (anthropometric data).
SHANK_MASS_FRACTION = 0.0465
FOOT_MASS_FRACTION = 0.0145
#: Masses added on the knee [kg], section 2.2.2.
ADDED_MASSES_KG = (0.0, 2.3, 4.5)


@dataclass(frozen=True)
class Subject(Tabled):
    """One row of Table 2.1."""

    number: int
    age_yr: int
    height_m: float
    mass_kg: float


_TABLE_2_1 = """
1 21 1.70 50.80   2 22 1.75 77.11   3 26 1.75 79.38   4 18 1.60 63.50   5 25 1.75 76.66
6 24 1.60 45.36   7 23 1.65 54.43   8 20 1.75 70.31   9 20 1.83 70.31  10 22 1.75 77.11
11 23 1.83 81.65 12 27 1.83 88.00  13 22 1.63 61.23  14 21 1.83 79.38  15 22 1.70 74.84
16 27 1.85 72.57 17 22 1.78 61.23  18 22 1.88 72.57  19 20 1.78 71.21  20 20 1.70 86.18
"""
_NUMBERS = _TABLE_2_1.split()
SUBJECTS = {
    int(n): Subject(int(n), int(age), float(height), float(mass))
    for n, age, height, mass in zip(*(_NUMBERS[i::4] for i in range(4)), strict=True)
}


def shank_mass(body_mass_kg: float, added_mass_kg: float = 0.0) -> float:
    """m_S [kg]: the shank and what rests on the knee."""
    return SHANK_MASS_FRACTION * body_mass_kg + added_mass_kg


def foot_mass(body_mass_kg: float) -> float:
    """m_F [kg]."""
    return FOOT_MASS_FRACTION * body_mass_kg


#: Postures of section 2.2.2; others may be measured as well.
POSTURES = ("midstance", "plantarflexion", "dorsiflexion")
#: What a person and a load on the knee can weigh.
_MASS_LIMITS_KG = {"body": (20, 300), "added": (0, 100)}


@dataclass(frozen=True)
class Condition(Tabled):
    """Under what a recording was made.

    Attributes:
        subject: whose.
        posture: of the foot.
        added_mass_kg: on the knee.
        body_mass_kg: None if unknown.
        frequency_hz: of the excitation, None where it is broadband.
        seating: recordings of one subject that share it were made without standing up or taking a sensor off between
            them; "" where that is not known.
    """

    subject: str = ""
    posture: str = "midstance"
    added_mass_kg: float = 0.0
    body_mass_kg: float | None = None
    frequency_hz: float | None = None
    seating: str = ""

    @property
    def masses(self) -> dict[str, float]:
        """m_S (in the arch m_T) and m_F [kg] of section 4.5, if the body mass is known; and the added mass.

        A model that declares `added_mass` takes the last; m_S and m_T are the shank with what rests on it.
        """
        added = {"added_mass": self.added_mass_kg}
        if self.body_mass_kg is None:
            return added
        shank = shank_mass(self.body_mass_kg, self.added_mass_kg)
        return {"m_S": shank, "m_T": shank, "m_F": foot_mass(self.body_mass_kg)} | added


def plausible(mass_kg: float, name: str, where: str) -> float:
    """The mass of a "body" or "added" to it.

    Raises:
        RecordingError: nobody weighs that; `where` is the place it was read from.
    """
    low, high = _MASS_LIMITS_KG[name]
    if isinstance(mass_kg, str) or np.ndim(mass_kg):
        raise RecordingError(f"{where}: the {name} mass is {mass_kg!r}; give a number of kilograms, such as 72.5.")
    if not low <= mass_kg <= high:
        raise RecordingError(f"{where}: the {name} mass is {mass_kg:g} kg; it must lie between {low} and {high} kg.")
    return mass_kg
