"""What sensors, amplifiers and converters do to a motion: each is a function of traces."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from simulator.leg import Shaking


@dataclass(frozen=True)
class Traces:
    """What is written down of a session, one row a recording.

    Attributes:
        t: (N,) true times [s].
        shaking: what the leg was exposed to.
        channels: (n, N) accelerations of "base", "malleolus" and "foot" [m/s^2].
    """

    t: np.ndarray
    shaking: Shaking
    channels: Mapping[str, np.ndarray]

    def rng(self, purpose: int) -> np.random.Generator:
        """The random generator of a purpose in this session."""
        return np.random.default_rng([*self.shaking.seed, purpose])

    @property
    def malleolus(self) -> np.ndarray:
        """(n, N) of the sensor on the shank [m/s^2]."""
        return self.channels["malleolus"]

    def using(self, values: np.ndarray, channel: str = "malleolus") -> "Traces":
        """The traces with other values (n, N) of a channel."""
        return replace(self, channels={**self.channels, channel: values})

    def mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> "Traces":
        """All channels changed alike."""
        return replace(self, channels={name: change(y) for name, y in self.channels.items()})


class Instrument:
    """What makes a trace differ from the motion."""

    def __call__(self, traces: Traces) -> Traces:
        """The traces as this instrument passes them on."""
        raise NotImplementedError


@dataclass(frozen=True)
class Gain(Instrument):
    """A sensor's gain is wrong.

    Attributes:
        error: as a share.
        drift: its change over the session, as a share.
        sensor: "malleolus" or "foot".
    """

    error: float
    drift: float = 0.0
    sensor: str = "malleolus"

    def __call__(self, traces: Traces) -> Traces:
        """See the class."""
        factor = (1.0 + self.error) * (1.0 + self.drift * traces.shaking.place)
        return traces.using(factor[:, None] * traces.channels[self.sensor], self.sensor)


@dataclass(frozen=True)
class Noise(Instrument):
    """White noise, as a share of what each channel measures (root mean square)."""

    share: float

    def __call__(self, traces: Traces) -> Traces:
        """See the class."""
        rng, share = traces.rng(4), self.share
        return traces.mapped(lambda y: rng.normal(y, share * y.std(axis=1, keepdims=True)))


@dataclass(frozen=True)
class Hum(Instrument):
    """Mains hum on the malleolus' channel, with a random phase in every recording.

    Attributes:
        amplitude: [m/s^2].
        hz: of the mains [Hz].
    """

    amplitude: float
    hz: float = 50.0

    def __call__(self, traces: Traces) -> Traces:
        """See the class."""
        phase = traces.rng(5).uniform(0, 2 * np.pi, (traces.shaking.hz.size, 1))
        hum = self.amplitude * np.cos(2 * np.pi * self.hz * traces.t + phase)
        return traces.using(traces.malleolus + hum)


@dataclass(frozen=True)
class CrossAxis(Instrument):
    """The malleolus' sensor feels some of a motion across its axis, which the base excites.

    Attributes:
        sensitivity: across over along the axis.
        share: of the base's motion that goes across.
        hz: of the resonance [Hz].
        zeta: its damping ratio.
    """

    sensitivity: float
    share: float
    hz: float
    zeta: float

    def __call__(self, traces: Traces) -> Traces:
        """See the class."""
        s, w = traces.shaking.s, 2 * np.pi * self.hz
        pull = w**2 + 2 * self.zeta * w * s
        across = self.share * pull / (s**2 + pull)
        turn = np.exp(s[:, :, None] * traces.t)
        motion = np.einsum("nh,nht->nt", across * traces.shaking.base, turn).real
        return traces.using(traces.malleolus + self.sensitivity * motion)


@dataclass(frozen=True)
class Clipping(Instrument):
    """An amplifier that is driven no further than a share of the session's largest malleolus."""

    share: float

    def __call__(self, traces: Traces) -> Traces:
        """See the class."""
        most = self.share * np.abs(traces.malleolus).max()
        return traces.using(np.clip(traces.malleolus, -most, most))


@dataclass(frozen=True)
class Converter(Instrument):
    """So many bits for the range of the session's largest value."""

    bits: int

    def __call__(self, traces: Traces) -> Traces:
        """See the class."""
        most = max(np.abs(y).max() for y in traces.channels.values())
        least = 1.01 * most / 2 ** (self.bits - 1)
        return traces.mapped(lambda y: least * np.round(y / least))


@dataclass(frozen=True)
class Unit(Instrument):
    """All numbers are written times a factor."""

    factor: float

    def __call__(self, traces: Traces) -> Traces:
        """See the class."""
        return traces.mapped(lambda y: self.factor * y)
