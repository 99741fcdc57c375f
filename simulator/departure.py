"""What a leg does that two masses on springs and dampers do not; see `Departure` in leg.py."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simulator.leg import SENSORS, Constants, Departure, Instant, Shaking

GRAVITY = 9.80665


@dataclass(frozen=True)
class LoadShare(Departure):
    """The leg feels a share of the load: thigh and chair carry the rest."""

    share: float

    def constants(self, constants: Constants, shaking: Shaking) -> Constants:
        """Without what they carry."""
        return constants.carrying((self.share - 1.0) * shaking.load_kg)


@dataclass(frozen=True)
class Following(Departure):
    """Springs and dampers rise with the load.

    Attributes:
        share: by so much under 2.3 kg.
        power: as a power of the static force on the pad, else in proportion to the load.
    """

    share: float
    power: bool = False

    def constants(self, constants: Constants, shaking: Shaking) -> Constants:
        """Stiffer under load."""
        factor = 1.0 + self.share * shaking.load_kg / 2.3
        if self.power:
            weight = constants.m.sum(axis=0)
            empty = weight - shaking.load_kg
            factor = (weight / empty) ** (np.log(1.0 + self.share) / np.log(1.0 + 2.3 / empty))
        return constants.scaled(factor, factor)


@dataclass(frozen=True)
class Scatter(Departure):
    """Springs and dampers differ between seatings, each for itself: log-normal about the leg's.

    Attributes:
        std: of their logarithms.
        by_load: the person sits down once a load, else once a recording.
    """

    std: float
    by_load: bool = False

    def constants(self, constants: Constants, shaking: Shaking) -> Constants:
        """As seated."""
        seating = np.arange(shaking.hz.size)
        if self.by_load:
            seating = np.unique(shaking.load_kg, return_inverse=True)[1]
        rng = np.random.default_rng([*shaking.seed, 3])
        drawn = np.exp(self.std * rng.standard_normal((seating.max() + 1, 4))[seating].T)
        return constants.scaled(drawn[:2], drawn[2:])


@dataclass(frozen=True)
class Posture(Departure):
    """Springs and dampers drift over a session, by such a share in all."""

    share: float

    def constants(self, constants: Constants, shaking: Shaking) -> Constants:
        """As they are by then."""
        factor = 1.0 + self.share * shaking.place
        return constants.scaled(factor, factor)


@dataclass(frozen=True)
class Maxwell(Departure):
    """A spring and a damper in series beside each spring.

    Attributes:
        ankle: its stiffness over k_T.
        pad: its stiffness over k_F.
        tau_s: relaxation time [s].
    """

    ankle: float
    pad: float
    tau_s: float = 5e-3
    rows = 2

    @property
    def shares(self) -> np.ndarray:
        """(2, 1) of ankle and pad."""
        return np.array([[self.ankle], [self.pad]])

    def stiffness(self, s: complex) -> np.ndarray:
        """(2,) what it adds to the dynamic stiffness at s = i omega, over the springs."""
        return self.shares[:, 0] * s * self.tau_s / (1.0 + s * self.tau_s)

    def act(self, now: Instant, x: np.ndarray) -> None:
        """States are its forces."""
        now.force += x

    def rates(self, now: Instant, x: np.ndarray, out: np.ndarray) -> None:
        """Its spring is stretched, its damper yields."""
        out[:] = self.shares * now.constants.k * now.v - x / self.tau_s


@dataclass(frozen=True)
class Exponential(Departure):
    """Springs k (exp(b z) - 1) / b, with b of ankle and pad [1/m]."""

    ankle: float
    pad: float

    def act(self, now: Instant, x: np.ndarray) -> None:
        """The difference from k z."""
        for i, b in enumerate((self.ankle, self.pad)):
            if b:
                now.force[i] += now.constants.k[i] * (np.expm1(b * now.z[i]) / b - now.z[i])


@dataclass(frozen=True)
class Polynomial(Departure):
    """Springs k z (1 + p |z| + d z^2), each with a pair for ankle and pad.

    Attributes:
        quadratic: p [1/m].
        cubic: d [1/m^2].
    """

    quadratic: tuple[float, float] = (0.0, 0.0)
    cubic: tuple[float, float] = (0.0, 0.0)

    def act(self, now: Instant, x: np.ndarray) -> None:
        """The difference from k z."""
        p, d = (np.array(pair)[:, None] for pair in (self.quadratic, self.cubic))
        now.force += now.constants.k * now.z * (p * np.abs(now.z) + d * now.z**2)


@dataclass(frozen=True)
class PowerLaw(Departure):
    """Dampers whose force is a power of speed; they dissipate what c v would of one amplitude.

    Attributes:
        exponent: of the speed.
        speed: that amplitude, of ankle and pad [m/s].
        smooth: below this share of it a damper is linear.
    """

    exponent: float
    speed: tuple[float, float]
    smooth: float = 0.05

    def act(self, now: Instant, x: np.ndarray) -> None:
        """The difference from c v."""
        v = now.v / np.array(self.speed)[:, None]
        now.force += now.c * now.v * (self._share(v) / self._dissipated - 1.0)

    def _share(self, v: np.ndarray) -> np.ndarray:
        return (v**2 + self.smooth**2) ** (0.5 * (self.exponent - 1.0))

    @cached_property
    def _dissipated(self) -> float:
        """Of a sine of the reference amplitude, over that of a linear damper."""
        v = np.cos(np.linspace(0, 2 * np.pi, 1000, endpoint=False))
        return float(2 * np.mean(self._share(v) * v**2))


@dataclass(frozen=True)
class Friction(Departure):
    """Coulomb friction of so many newtons in the ankle, smooth below a speed [m/s]."""

    newton: float
    speed: float

    def act(self, now: Instant, x: np.ndarray) -> None:
        """Against the motion."""
        now.force[0] += self.newton * np.tanh(now.v[0] / self.speed)


@dataclass(frozen=True)
class Reflex(Departure):
    """A muscle that answers stretch and rate of the ankle after a delay.

    Attributes:
        delay_s: [s].
        stretch: its stiffness over k_T.
        rate: its damping over c_11.
    """

    delay_s: float
    stretch: float
    rate: float

    @property
    def memory_s(self) -> float:  # type: ignore[override]
        """The delayed reaction acts on itself: memory in multiples of the delay."""
        return 10 * self.delay_s

    def act(self, now: Instant, x: np.ndarray) -> None:
        """Of the motion as it was."""
        (z, v), k, c = now.before(self.delay_s), now.constants.k[0], now.constants.c1[0]
        now.force[0] += self.stretch * k * z[0] + self.rate * c * v[0]


@dataclass(frozen=True)
class Thixotropy(Departure):
    """Tissue that softens while it moves and recovers at rest.

    Attributes:
        loss: share of spring and damper that motion can take away.
        time_s: of recovery [s].
        stretch: of ankle and pad, travelled [m], that takes away all but 1/e.
    """

    loss: float
    time_s: float
    stretch: tuple[float, float]
    rows = 2

    def act(self, now: Instant, x: np.ndarray) -> None:
        """States are what is broken, 0 to 1."""
        now.force -= self.loss * x * (now.constants.k * now.z + now.c * now.v)

    def rates(self, now: Instant, x: np.ndarray, out: np.ndarray) -> None:
        """Damage grows with travel and recovers with time."""
        out[:] = (1.0 - x) * np.abs(now.v) / np.array(self.stretch)[:, None] - x / self.time_s


@dataclass(frozen=True)
class Lifting(Departure):
    """A heel that lifts off where the pad would pull by more than so many times the weight."""

    weights: float

    def act(self, now: Instant, x: np.ndarray) -> None:
        """The pad pulls no further."""
        weight = self.weights * GRAVITY * now.constants.m.sum(axis=0)
        now.force[1] = np.minimum(now.force[1], weight)


@dataclass(frozen=True)
class Tremor(Departure):
    """A force on the shank of three close frequencies.

    Attributes:
        acceleration: standard deviation of force over mass [m/s^2].
        hz: in the middle [Hz].
    """

    acceleration: float
    hz: float

    def act(self, now: Instant, x: np.ndarray) -> None:
        """Other phases in every recording."""
        turn = 2 * np.pi * self.hz * now.t + 2.4 * np.arange(now.t.size)  # 2.4: golden angle
        wave = np.sin(0.93 * turn) + np.sin(turn + 1.0) + np.sin(1.07 * turn + 2.0)
        now.push = now.push + np.sqrt(2 / 3) * self.acceleration * now.constants.m[0] * wave


@dataclass(frozen=True)
class Thigh(Departure):
    """A third mass, which carries the load, on soft tissue above the shank.

    Attributes:
        kg: without load [kg].
        hz: its natural frequency on a shank at rest, without load [Hz].
        zeta: its damping ratio.
    """

    kg: float
    hz: float
    zeta: float
    rows = 2

    def constants(self, constants: Constants, shaking: Shaking) -> Constants:
        """The shank without the load."""
        return constants.carrying(-shaking.load_kg)

    def act(self, now: Instant, x: np.ndarray) -> None:
        """States are the stretch of the tissue and its rate."""
        now.push = now.push + self._force(x)

    def rates(self, now: Instant, x: np.ndarray, out: np.ndarray) -> None:
        """The thigh is pulled down as the shank is pulled up."""
        out[0] = x[1]
        out[1] = -self._force(x) / (self.kg + now.shaking.load_kg) - now.bone[0]

    def _force(self, x: np.ndarray) -> np.ndarray:
        w = 2 * np.pi * self.hz
        return self.kg * (w**2 * x[0] + 2 * self.zeta * w * x[1])


@dataclass(frozen=True)
class Rocking(Departure):
    """The leg rotates: a mass on a spring that the base's motion excites.

    Attributes:
        share: what the malleolus feels of it far above its resonance, over the base.
        hz: of the resonance [Hz].
        zeta: its damping ratio.
        foot: what the sensor on the foot feels of it.
    """

    share: float
    hz: float = 60.0
    zeta: float = 0.1
    foot: float = 0.0
    rows = 2

    def rates(self, now: Instant, x: np.ndarray, out: np.ndarray) -> None:
        """States are the rotation and its rate."""
        w = 2 * np.pi * self.hz
        out[0], out[1] = x[1], now.a0 - w**2 * x[0] - 2 * self.zeta * w * x[1]
        now.felt = now.felt + np.outer((self.share, self.foot), out[1])


@dataclass(frozen=True)
class Mount(Departure):
    """A sensor on soft tissue.

    Attributes:
        hz: its natural frequency [Hz].
        zeta: its damping ratio.
        sensor: of `SENSORS`.
    """

    hz: float
    zeta: float = 0.2
    sensor: str = "malleolus"
    rows = 2

    def rates(self, now: Instant, x: np.ndarray, out: np.ndarray) -> None:
        """States are its motion over the bone, and the rate of that."""
        w, row = 2 * np.pi * self.hz, SENSORS.index(self.sensor)
        out[0], out[1] = x[1], -now.felt[row] - w**2 * x[0] - 2 * self.zeta * w * x[1]
        now.felt = now.felt.copy()
        now.felt[row] += out[1]
