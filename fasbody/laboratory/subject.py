"""Virtual subjects whose mean behaves as sections 2.3, 2.4 and 4.6 of the thesis say: a calibration, not a measurement.

The foot is the two-mass model with constants that depend on frequency and load, as the thesis found them to: k_T and
k_F rise with both, c_11 falls with frequency, c_21 rises, and is the larger. With constants that do not depend on them
the peak would fall with load. The "resonance" of these curves is therefore no mode of one linear system. The tibial
tuberosity is a light mass on a soft mount on the shank. Coefficients were fitted by least squares to a table of target
transmissibilities with the stated trends as constraints; the scatter is invented, within what the figures show.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.foot.two_dof import TwoDof
from fasbody.presentation import Tabled
from fasbody.recording.condition import POSTURES as POSTURES
from fasbody.recording.condition import SUBJECTS, foot_mass, shank_mass

#: Body mass for which the coefficients hold [kg], the mean of Table 2.1.
MEAN_MASS_KG = 70.7
#: Nonlinear constants of the dampers [1/m], without clear trend in section 4.6.
_NONLINEAR = {"c_12": 60.0, "c_13": 150.0, "c_22": 120.0, "c_23": 150.0}
#: Standard deviation of the logarithm of each constant between subjects.
BETWEEN = {"k_T": 0.10, "k_F": 0.07, "c_11": 0.15, "c_21": 0.07}
#: The same between recordings of one subject, unloaded; a load seats the foot and divides it by 1 + M / SEATING_KG.
WITHIN = {"k_F": 0.10, "c_21": 0.10}
SEATING_KG = 0.4
#: The same for frequency and damping of the tuberosity, under any load.
TUBEROSITY_SCATTER = 0.15
#: Tuberosity on the shank by added mass [kg]: undamped frequency [Hz] and damping ratio.
_TUBEROSITY = {"mass": (0.0, 2.3, 4.5), "frequency": (17.7, 25.4, 24.8), "zeta": (1.7, 1.4, 1.5)}


def constants(frequency_hz: float, added_mass_kg: float, posture: str = "midstance") -> dict[str, float]:
    """k_T, k_F [N/m], c_11, c_21 [N s/m] of the mean subject at an excitation frequency and a load.

    Dorsiflexion tightens the foot at 10 Hz and damps it slightly more above 25 Hz (section 2.4).
    """
    M = added_mass_kg
    u = np.clip(frequency_hz, 10.0, 50.0) - 10.0  # held beyond the calibrated range: k_T would turn negative below
    k_T = 68_700 + 5_000 * M + u * (46_450 + 33_690 * M) - u**2 * (615.0 + 385.0 * M)
    k_F = 19_310 + u * (3_610 + 2_518 * M)
    c_11 = 5 + 200 * M + (20 + 215 * M) * np.exp(-u / 60)
    c_21 = 656.7 + 274.6 * M + u * (6.07 - 1.35 * M)
    if posture == "dorsiflexion":
        c_21 *= 1 - 0.35 * np.exp(-((u / 4.0) ** 2)) + 0.05 / (1 + np.exp(-(u - 12) / 2))
    return {"k_T": float(k_T), "k_F": float(k_F), "c_11": float(c_11), "c_21": float(c_21)}


@dataclass(frozen=True)
class Tuberosity(Tabled):
    """Tibial tuberosity as a light mass on the shank: undamped frequency [Hz] and damping ratio."""

    frequency_hz: float
    zeta: float

    @classmethod
    def under(cls, added_mass_kg: float, rng: np.random.Generator | None = None) -> "Tuberosity":
        """For a load [kg], between those of the thesis by interpolation; with `rng`, as it happens to be that time."""
        at = _TUBEROSITY["mass"]
        chance = np.exp(rng.normal(0, TUBEROSITY_SCATTER, 2)) if rng is not None else np.ones(2)
        return cls(
            float(np.interp(added_mass_kg, at, _TUBEROSITY["frequency"]) * chance[0]),
            float(np.interp(added_mass_kg, at, _TUBEROSITY["zeta"]) * chance[1]),
        )

    def response(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Complex tuberosity / malleolus acceleration at (n,) frequencies [Hz]."""
        r = np.asarray(frequency_hz) / self.frequency_hz
        return (1 + 2j * self.zeta * r) / (1 - r**2 + 2j * self.zeta * r)


@dataclass(frozen=True)
class VirtualSubject(Tabled):
    """One subject: body mass, and how its constants differ from the mean (factors that average to one)."""

    number: int
    mass_kg: float
    factors: dict[str, float]

    def foot(
        self,
        frequency_hz: float,
        added_mass_kg: float = 0.0,
        posture: str = "midstance",
        rng: np.random.Generator | None = None,
    ) -> TwoDof:
        """The foot of one recording; with `rng`, as it happens to be placed and tensed that time.

        Constants scale with the body mass, so that a heavier subject is not a softer one.
        """
        values = constants(frequency_hz, added_mass_kg, posture)
        seat = 1 + added_mass_kg / SEATING_KG
        for name, factor in self.factors.items():
            spread = WITHIN.get(name, 0.0) / seat
            chance = np.exp(rng.normal(0, spread)) if rng is not None and spread else 1.0
            values[name] *= factor * chance * self.mass_kg / MEAN_MASS_KG
        m_S = shank_mass(self.mass_kg, added_mass_kg)
        return TwoDof(**values, **_NONLINEAR, m_S=m_S, m_F=foot_mass(self.mass_kg))


def panel(count: int, rng: np.random.Generator) -> Sequence[VirtualSubject]:
    """So many subjects with the body masses of Table 2.1 (from the start again after the twentieth)."""
    people = []
    for i in range(count):
        mass = SUBJECTS[i % len(SUBJECTS) + 1].mass_kg
        people.append(VirtualSubject(i + 1, mass, {n: float(np.exp(rng.normal(0, s))) for n, s in BETWEEN.items()}))
    return people
