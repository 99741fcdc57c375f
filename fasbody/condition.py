"""Under what a recording was made: subject, posture, load, frequency, and the masses that follow from them."""

from dataclasses import dataclass

from fasbody.exceptions import RecordingError
from fasbody.subjects import foot_mass, shank_mass

#: Postures of section 2.2.2; others may be measured as well.
POSTURES = ("midstance", "plantarflexion", "dorsiflexion")
#: What a person and a load on the knee can weigh.
_MASS_LIMITS_KG = {"body": (20, 300), "added": (0, 100)}


@dataclass(frozen=True)
class Condition:
    """Under what a recording was made. `frequency_hz` is None for broadband excitation, masses None if unknown."""

    subject: str = ""
    posture: str = "midstance"
    added_mass_kg: float = 0.0
    body_mass_kg: float | None = None
    frequency_hz: float | None = None

    @property
    def masses(self) -> dict[str, float]:
        """m_S (in the arch m_T) and m_F [kg] of section 4.5; empty if the body mass is unknown."""
        if self.body_mass_kg is None:
            return {}
        shank = shank_mass(self.body_mass_kg, self.added_mass_kg)
        return {"m_S": shank, "m_T": shank, "m_F": foot_mass(self.body_mass_kg)}


def plausible(mass_kg: float, name: str, here: str) -> float:
    """The mass of a "body" or "added" to it.

    Raises:
        RecordingError: nobody weighs that; `here` is the place it was read from.
    """
    low, high = _MASS_LIMITS_KG[name]
    if not low <= mass_kg <= high:
        raise RecordingError(f"{here}: the {name} mass is {mass_kg:g} kg; it must lie between {low} and {high} kg.")
    return mass_kg
