"""What is known of a foot before it is shaken: a population to plan for, and where it could lie after recordings.

The variables are those of the fit (`identification.variables`) with its nuisances and priors. To these a population of
feet is added, wide enough for both mirror feet: without it a plan would need a guess.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fasbody.exceptions import SettingError
from fasbody.foot.model import Foot
from fasbody.recording.condition import Condition
from fasbody.recording.known import DEPARTURES, Known
from fasbody.recording.recording import Recording
from identification.branches import EXCHANGED, has_mirror, ratio
from identification.engines.twin import twin_applies
from identification.nuisances import Nuisance, nuisances
from identification.parameters import space_of
from identification.plan.candidates import Step
from identification.variables import Variables

#: The population of feet, and where it comes from. The resonance of the leg on both springs: the thesis
#: finds it between 15 and 40 Hz (Figures 2.3 to 2.5), so 25 Hz with a standard deviation of a fifth, which
#: is half of that of the stiffness.
RESONANCE_HZ, STIFFNESS_STD = 25.0, 0.4
#: ln of k_T over that of a foot which is its own mirror image. Ankles were measured from 8 to 22 kN/m (Aruin
#: and Zatsiorsky 1984, vibration) and ten times stiffer (the thesis), heel pads from 19 (Kinoshita 1996,
#: drop) to 150 kN/m (in vivo): neither branch is likelier, and a factor of e is usual.
RATIO_STD = 1.0
#: Loss factor of each joint at the resonance: Aruin and Zatsiorsky (430 N s/m beside 1.5e4 N/m) and the heel
#: pad (30 % of its energy a cycle, Ker 1996) lie far apart, so a factor of two either way.
LOSS, LOSS_STD = 0.4, 0.7
#: Bends of dampers [1/m], rms of the one foot that is known (the thesis: 127 and -52, 198 and 38). How far
#: others have them nobody knows: a share of that between none and all. The fit's prior is wider, as it need
#: not be right.
BEND, WAVE = 97.0, 142.0


@dataclass(frozen=True, eq=False)
class PlanVariables(Variables):
    """The fit's variables, with a population of feet as a prior of the constants.

    Attributes:
        middle_hz: where stiffness and damping are dynamic, whatever has been recorded and could be.
        populated: whether the population is a prior; the fit knows of none.
    """

    middle_hz: float = 25.0
    populated: bool = True

    @cached_property
    def reference_hz(self) -> float:
        """See `Variables`."""
        return self.middle_hz

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names (n,) of the variables."""
        return (*self.constants, *(item.name for item in self.nuisances))

    @cached_property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Variables`; finite for every variable where there is a population."""
        mean, std = (x.copy() for x in super().prior)
        if self.populated:
            leg = sum(float(kg[0]) for kg in self.stated.values())
            stiff = np.log(leg * (2 * np.pi * RESONANCE_HZ) ** 2)
            loss = stiff + np.log(LOSS / (2 * np.pi * RESONANCE_HZ))
            at = [self.index[name] for name in EXCHANGED]
            mean[at] = stiff, 0.0, loss, loss
            std[at] = STIFFNESS_STD, RATIO_STD, LOSS_STD, LOSS_STD
        return mean, std

    @cached_property
    def departing(self) -> np.ndarray:
        """(n,) by which variables the world departs from the model."""
        groups = [item.group in DEPARTURES for item in self.nuisances]
        return np.array([*[False] * len(self.constants), *groups])

    def normals(self, seed: np.random.SeedSequence) -> np.ndarray:
        """Standard normal numbers (n,): the same for a variable whatever other variables there are."""
        first = np.random.default_rng(seed).standard_normal(len(self.constants))
        names = (item.name for item in self.nuisances)
        rest = [np.random.default_rng(stream(seed, name)).standard_normal() for name in names]
        return np.array([*first, *rest])

    def draw(self, seed: np.random.SeedSequence, sign: int) -> np.ndarray:
        """A foot (n,) of one branch, which departs in nothing; masses and instrument are off as they may be.

        A fit says how wide its intervals are at the likeliest foot, and few recordings show a departure.

        Args:
            seed: of the draw: the same foot whatever is recorded of it.
            sign: 1 for a stiff ankle, -1 for a stiff pad.
        """
        mean, std = self.prior
        q = np.where(self.departing, mean, mean + std * self.normals(seed))
        rng = np.random.default_rng(stream(seed, "bends"))
        bends = rng.uniform() * rng.standard_normal(4)
        for name, x in zip(("c_12", "c_22", "c_13", "c_23"), bends, strict=True):
            i = self.index[name]
            q[i] = (BEND * x if name.endswith("2") else (WAVE * x) ** 2) / self.scale[i]
        q[self.index["k_F"]] = sign * abs(q[self.index["k_F"]])
        return np.clip(q, *self.bounds)

    def logarithms(self, Q: np.ndarray) -> np.ndarray:
        """Logarithms (..., 4) of the main constants at Q (..., n), dynamic, under the smallest load."""
        values = self.dynamic(Q)
        return np.log(np.stack([values[name] for name in EXCHANGED], -1))

    def carried(self, Q: np.ndarray, other: "PlanVariables") -> np.ndarray:
        """(..., n) what other variables Q (..., m) are here; what they lack is as expected."""
        mean, _ = self.prior
        values = {name: Q[..., i] * other.scale[i] for i, name in enumerate(other.names)}
        columns = [
            values[name] / self.scale[i] if name in values else np.full(Q.shape[:-1], mean[i])
            for i, name in enumerate(self.names)
        ]
        return np.clip(np.stack(columns, -1), *self.bounds)


def stream(seed: np.random.SeedSequence, what: str) -> np.random.SeedSequence:
    """The seed of one thing among those of a draw, by its name; asking for it leaves the seed as it is."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, zlib.crc32(what.encode())))


@dataclass(frozen=True, eq=False)
class Person:
    """Who stands on the shaker, and what the laboratory knows.

    Attributes:
        foot: the model.
        body_mass_kg: of the person.
        known: by the laboratory, as in [known] of study.toml.
        name: of the person, in the recordings.
        posture: of the recordings.
    """

    foot: Foot
    body_mass_kg: float
    known: Known = field(default_factory=Known)
    name: str = "1"
    posture: str = "midstance"

    def __post_init__(self) -> None:
        if not 20 <= self.body_mass_kg <= 300:
            raise SettingError(f"the body mass is {self.body_mass_kg:g} kg; valid: 20 to 300.", "body_mass")
        if not twin_applies(self.foot) or has_mirror(space_of(self.foot).names, self.foot.parameters):
            raise SettingError(
                "plan supports the two-mass foot only (its values may be edited), and "
                f"{self.foot.name} is another model."
            )

    def condition(self, step: Step) -> Condition:
        """Under what a step is recorded."""
        return Condition(self.name, self.posture, step.added_mass_kg, self.body_mass_kg, step.frequency_hz)

    @property
    def masses(self) -> dict[str, float]:
        """Shank and foot without load [kg]."""
        masses = Condition(body_mass_kg=self.body_mass_kg).masses
        return {name: masses[name] for name in ("m_S", "m_F")}

    @property
    def leg_kg(self) -> float:
        """Shank and foot together, without load."""
        return sum(self.masses.values())

    def allowed(self, steps: Sequence[Step], earlier: Sequence[Recording], rate_hz: float) -> tuple[Nuisance, ...]:
        """What else may be true of recordings and steps together, with its prior."""
        stubs = [*earlier, *(stub(self, step, rate_hz) for step in steps)]
        sensors = tuple(dict.fromkeys(name for step in steps for name in step.sensors)) or ("malleolus",)
        return nuisances(stubs, self.known, tuple(self.masses), True, sensors)

    def variables(
        self, allowed: tuple[Nuisance, ...], recordings: Sequence[Recording], middle_hz: float
    ) -> PlanVariables:
        """The variables of some recordings."""
        foot = self.foot.values()
        space = space_of(self.foot, delay=False)
        return PlanVariables(space, allowed, recordings, foot, True, ratio([self.masses], foot), middle_hz)


def stub(person: Person, step: Step, rate_hz: float) -> Recording:
    """A step as a recording that is yet to be made: its condition and its rate, without samples worth reading."""
    t = np.arange(2) / rate_hz
    return Recording(t, np.zeros(2), np.zeros(2), condition=person.condition(step), file=str(step), origin="synthetic")
