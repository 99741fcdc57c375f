"""What is known of a foot before it is shaken: a population to plan for, and where it could lie after recordings.

The search variables are those of the fit (`identification.world`), with its nuisances and their priors. To these a
population of feet is added, wide enough for both mirror feet: without it a plan would need a guess.
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
from identification.plan.candidates import Step
from identification.space import MASSES, space_of
from identification.world import Nuisance, WorldSpace, nuisances

#: The population. The resonance of the leg on both springs: the thesis finds it between 15 and 40 Hz (Figures 2.3 to
#: 2.5), so 25 Hz with a standard deviation of a fifth (half of that of the stiffness).
RESONANCE_HZ, STIFFNESS_STD = 25.0, 0.4
#: ln of k_T over that of a foot which is its own mirror image: neither branch is likelier, and a factor of e is usual.
RATIO_STD = 1.0
#: Loss factor of each joint at the resonance: Aruin and Zatsiorsky (430 N s/m beside 1.5e4 N/m) and the heel pad lie
#: far apart, so a factor of two either way.
LOSS, LOSS_STD = 0.4, 0.7
#: Bends of dampers that feet are drawn with [1/m]; the fit's own prior is wider, as it need not be right.
BEND, WAVE = 60.0, 100.0


@dataclass(frozen=True, eq=False)
class PlanSpace(WorldSpace):
    """The fit's search space with a population of feet as a prior.

    Attributes:
        middle_hz: of the band, the same for whatever has been recorded and whatever could be.
    """

    middle_hz: float = 25.0

    @cached_property
    def _middle(self) -> float:
        return 2 * np.pi * self.middle_hz

    @cached_property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """See `WorldSpace`: mean and standard deviation (n,), (n,), finite for every variable."""
        mean, std = (each.copy() for each in super().prior)
        leg = sum(self.stated(0).values())
        stiff = np.log(leg * (2 * np.pi * RESONANCE_HZ) ** 2)
        loss = stiff + np.log(LOSS / (2 * np.pi * RESONANCE_HZ))
        for name, middle, width in (
            ("k_T", stiff, STIFFNESS_STD), ("k_F", 0.0, RATIO_STD), ("c_11", loss, LOSS_STD), ("c_21", loss, LOSS_STD),
        ):  # fmt: skip
            mean[self.index[name]], std[self.index[name]] = middle, width
        return mean, std

    @cached_property
    def population(self) -> np.ndarray:
        """Places of the variables whose prior is the population's and not the fit's."""
        return np.array([self.index[name] for name in EXCHANGED])

    def normals(self, seed: np.random.SeedSequence) -> np.ndarray:
        """Standard normal numbers (n,): the same for a variable whatever other variables there are."""
        own = np.random.default_rng(seed).standard_normal(len(self.base))
        rest = [np.random.default_rng(stream(seed, each.name)).standard_normal() for each in self.nuisances]
        return np.array([*own, *rest])

    def draw(self, seed: np.random.SeedSequence, sign: int) -> np.ndarray:
        """A foot (n,) of one branch, which departs in nothing; masses and instrument are off as they may be.

        A fit says how wide its intervals are at the likeliest foot, and few recordings show a departure.

        Args:
            seed: of the draw: the same foot whatever is recorded of it. sign: 1 for a stiff ankle, -1 for a stiff pad.
        """
        mean, std = self.prior
        q = mean + std * self.normals(seed)
        rng = np.random.default_rng(stream(seed, "bends"))
        for name in ("c_12", "c_22"):
            q[self.index[name]] = BEND / self._scale[self.index[name]] * rng.standard_normal()
        for name in self.squared:
            q[self.index[name]] = (WAVE * rng.standard_normal()) ** 2 / self._scale[self.index[name]]
        rho = self.index["k_F"]
        q[rho] = sign * abs(q[rho])
        low, high = self.bounds
        q[self.departing] = mean[self.departing]
        return np.clip(q, low, high)

    @cached_property
    def departing(self) -> np.ndarray:
        """Places of the variables by which the world departs from the model."""
        return np.array([self.index[each.name] for each in self.nuisances if each.group in DEPARTURES], int)

    def logarithms(self, q: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """Derivatives (m, n) of the logarithms of constants, at rest and without load, to q (n,)."""
        found = self._unloaded(q)
        return np.array([found[name][1] / found[name][0] for name in names])

    def value(self, q: np.ndarray, name: str) -> float:
        """A constant at rest, without load."""
        return self._unloaded(q)[name][0]


def stream(seed: np.random.SeedSequence, what: str) -> np.random.SeedSequence:
    """The seed of one thing among those of a draw, by its name; asking for it leaves the seed as it is."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, zlib.crc32(what.encode())))


@dataclass(frozen=True, eq=False)
class Person:
    """Who stands on the shaker, and what the laboratory knows.

    Attributes:
        foot: the model. body_mass_kg: of the person. known: by the laboratory, as in [known] of study.toml.
        name, posture: of the recordings.
    """

    foot: Foot
    body_mass_kg: float
    known: Known = field(default_factory=Known)
    name: str = "1"
    posture: str = "midstance"

    def __post_init__(self) -> None:
        if not 20 <= self.body_mass_kg <= 300:
            raise SettingError(f"the body mass is {self.body_mass_kg:g} kg; valid: 20 to 300.")
        if not twin_applies(self.foot) or has_mirror(space_of(self.foot).names, self.foot.parameters):
            raise SettingError(
                f"the director plans for the two-mass foot and edits of its numbers, and {self.foot.name} is another "
                "model: its branches are not known in closed form."
            )

    def condition(self, step: Step) -> Condition:
        """Under what a step is recorded."""
        return Condition(self.name, self.posture, step.added_mass_kg, self.body_mass_kg, step.frequency_hz)

    @property
    def leg_kg(self) -> float:
        """Shank and foot without load."""
        return sum(Condition(body_mass_kg=self.body_mass_kg).masses[name] for name in ("m_S", "m_F"))

    def allowed(self, steps: Sequence[Step], earlier: Sequence[Recording], rate_hz: float) -> tuple[Nuisance, ...]:
        """What else may be true of recordings and steps together, with its prior."""
        stubs = [*earlier, *(stub(self, step, rate_hz) for step in steps)]
        sensors = tuple(dict.fromkeys(name for step in steps for name in step.sensors)) or ("malleolus",)
        return nuisances(stubs, self.known, ("m_S", "m_F"), True, sensors)

    def space(self, allowed: tuple[Nuisance, ...], recordings: Sequence[Recording], middle_hz: float) -> PlanSpace:
        """The search space of some recordings."""
        own = self.foot.values()
        masses = {name: value for name, value in own.items() if name in MASSES}
        unloaded = [Condition(body_mass_kg=self.body_mass_kg).masses]
        return PlanSpace(
            space_of(self.foot, delay=False), allowed, recordings, own, masses, True, ratio(unloaded, own), middle_hz
        )


def stub(person: Person, step: Step, rate_hz: float) -> Recording:
    """A step as a recording that is yet to be made: its condition and its rate, without samples worth reading."""
    t = np.arange(2) / rate_hz
    return Recording(t, np.zeros(2), np.zeros(2), condition=person.condition(step), file=str(step), origin="synthetic")
