"""What carries a motion and its derivatives: the protocol of the engines, and what drives them.

An engine is made for a foot and what moves its base. `run` goes once over that from given initial states; `orbit` finds
the initial states that return after it, by Newton's method on the gap (shooting), starting from the last orbit moved
along its derivative. A small gap is accepted with a first-order correction, so that a fit costs about one period of
simulation for each evaluation.
"""

import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.shaker import BaseMotion, at_half_steps, harmonics, samples
from fasbody.recording.recording import Recording
from identification.sensors import MALLEOLUS as MALLEOLUS

#: Longest time step [s], and fewest steps a period, to begin with. RK4 then errs by 1e-5 of the peak in the median of
#: fitted feet, but by 2 % where a damper is at its bound under 4.5 kg: domains.py halves it there.
LONGEST_STEP = 5e-4
FEWEST_STEPS = 48
#: Most passes of Newton's method.
PASSES = 12
#: Relative gap after one period beyond which there is no orbit.
LOST = 1e-2


class Drive(Protocol):
    """What moves the base of a foot, and the masses on it."""

    @property
    def controls(self) -> np.ndarray:
        """(n, 5) of the steps, for MuJoCo (`BaseMotion.controls`)."""

    @property
    def half_steps(self) -> np.ndarray:
        """(2 n + 1,) base acceleration at half steps [m/s^2], for the twin (`BaseMotion.half_steps`)."""

    @property
    def masses(self) -> Mapping[str, float]:
        """The masses on it [kg]."""

    @property
    def step(self) -> float:
        """Time step [s]."""

    @property
    def steps(self) -> int:
        """How many of them."""

    @property
    def stride(self) -> int:
        """Steps from one sample of the output of a run to the next."""


class _Moving(ABC):
    """A drive that moves the base as a motion says; its controls are made once."""

    @property
    @abstractmethod
    def motion(self) -> BaseMotion:
        """The base motion."""

    @property
    @abstractmethod
    def step(self) -> float:
        """Time step [s]."""

    @property
    @abstractmethod
    def steps(self) -> int:
        """How many."""

    @cached_property
    def controls(self) -> np.ndarray:
        """See `Drive`."""
        return self.motion.controls(self.step, self.steps)

    @cached_property
    def half_steps(self) -> np.ndarray:
        """See `Drive`."""
        return at_half_steps(self.controls, self.step)


@dataclass(frozen=True, eq=False)
class Excitation(_Moving):
    """One period of base motion: frequency [Hz], complex harmonics (H,) [m/s^2], and the masses on it [kg]."""

    frequency_hz: float
    amplitudes: np.ndarray
    masses: Mapping[str, float]
    longest_step: float = LONGEST_STEP  # the model's own, where it asks for a finer one

    @property
    def steps(self) -> int:
        """Steps a period."""
        return max(FEWEST_STEPS, int(np.ceil(1.0 / (self.frequency_hz * self.longest_step) - 1e-6)))

    @property
    def step(self) -> float:
        """Time step [s]."""
        return 1.0 / (self.frequency_hz * self.steps)

    @property
    def stride(self) -> int:
        """Every step is a sample."""
        return 1

    @property
    def motion(self) -> BaseMotion:
        """The base motion over one period."""
        return harmonics(self.frequency_hz, self.amplitudes, 1.0 / self.frequency_hz)

    @cached_property
    def half_steps(self) -> np.ndarray:
        """See `Drive`: the sum over the harmonics, as a fit asks for hundreds of motions that differ in these alone."""
        U = self.amplitudes
        return _units(self.frequency_hz, self.steps, U.size) @ np.concatenate([U.real, U.imag])

    def __str__(self) -> str:
        return f"{self.frequency_hz:g} Hz"


@functools.lru_cache(maxsize=32)
def _units(frequency_hz: float, steps: int, count: int) -> np.ndarray:
    """At half steps (2 n + 1, 2 count): harmonics of 1 m/s^2, their real parts first."""
    period = 1.0 / frequency_hz
    units = np.concatenate([np.eye(count), 1j * np.eye(count)])
    return np.column_stack([harmonics(frequency_hz, U, period).half_steps(period / steps, steps) for U in units])


@dataclass(frozen=True, eq=False)
class Whole(_Moving):
    """A whole recording: its base motion as the spline through its samples, each interval divided into whole steps.

    Attributes:
        recording: what was measured. stride: steps a sample.
    """

    recording: Recording
    stride: int

    @classmethod
    def of(cls, recording: Recording, foot: Foot) -> "Whole":
        """A recording that drives a foot; the step is the model's own where that is finer than LONGEST_STEP."""
        interval = 1.0 / recording.rate_hz
        return _driven(recording, max(1, int(np.ceil(interval / min(LONGEST_STEP, foot.step) - 1e-6))))

    @property
    def step(self) -> float:
        """Time step [s]."""
        return 1.0 / self.recording.rate_hz / self.stride

    @property
    def steps(self) -> int:
        """Steps in all."""
        return self.recording.time_s.size * self.stride

    @property
    def masses(self) -> Mapping[str, float]:
        """The masses on the foot [kg]."""
        return self.recording.condition.masses

    @property
    def motion(self) -> BaseMotion:
        """The base motion over the recording."""
        return _moved(self.recording)

    def __str__(self) -> str:
        return self.recording.file


@functools.lru_cache(maxsize=2)  # both branches of a fit are run under the same motion
def _driven(recording: Recording, stride: int) -> Whole:
    return Whole(recording, stride)


@functools.lru_cache(maxsize=2)  # and with a finer step under the same spline
def _moved(recording: Recording) -> BaseMotion:
    return samples(recording.time_s, recording.base_m_s2)


D = TypeVar("D", bound=Drive)


class Engine(Protocol[D]):
    """What finds motions and their derivatives, one drive at a time.

    States are in the order of the model's coordinates. Output is that of each sensor, one behind the other: (k n,) of k
    sensors.

    Attributes:
        name: "twin" or "mujoco". foot: the model. drives: what moves its base. state_scale: (s,) a displacement and a
            velocity typical of a foot. sensors: whose output it gives, the malleolus first.
    """

    name: str
    foot: Foot
    drives: list[D]
    sensors: tuple[str, ...]
    state_scale: np.ndarray

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output over one period (k n,) [m/s^2] and its derivatives (k n, p) to the named parameters.

        Args:
            number: of the drive. values: all parameters by name. names: those that the derivatives are to.
            tolerance: relative gap after one period that is accepted.

        Raises:
            SimulationError: there is no such motion.
        """

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output (k n,) [m/s^2] at the samples, from states x0 (s,), and derivatives (k n, s + p) to both."""

    def nearby(
        self, number: int, values: Mapping[str, float], names: Sequence[str], drives: Sequence[D]
    ) -> list[np.ndarray]:
        """Outputs (k n,) over one period under drives that differ a little from one, to first order in that."""

    def start(self, number: int) -> np.ndarray:
        """States (s,) of the last orbit at time zero."""

    def forget(self) -> None:
        """Start the next orbits from rest."""

    def on(self, drives: Sequence[D], foot: Foot | None = None) -> Self:
        """An engine of the same kind on other drives, and on another foot if one is given."""


@dataclass
class _Last:
    """Where the last orbit of a drive started, and how that moves with the parameters."""

    x: np.ndarray
    dx: np.ndarray
    theta: np.ndarray

    def predict(self, theta: np.ndarray) -> np.ndarray:
        if self.theta.size != theta.size:
            return self.x
        return self.x + self.dx @ (theta - self.theta)


class Orbits(Generic[D]):
    """What engines share: the last orbit of each drive, from which the next one is sought.

    Args:
        foot: the model. drives: what moves its base. states: how many a foot has. sensors: whose output is wanted.
    """

    def __init__(self, foot: Foot, drives: Sequence[D], states: int, sensors: Sequence[str]) -> None:
        self.foot, self.drives, self._states, self.sensors = foot, list(drives), states, tuple(sensors)
        self.forget()

    def forget(self) -> None:
        """Start the next orbits from rest."""
        self._last: list[_Last | None] = [None] * len(self.drives)

    def start(self, number: int) -> np.ndarray:
        """States (s,) of the last orbit at time zero."""
        last = self._last[number]
        return np.zeros(self._states) if last is None else last.x

    def _guess(self, number: int, theta: np.ndarray) -> np.ndarray:
        last = self._last[number]
        return np.zeros(self._states) if last is None else last.predict(theta)

    def _keep(
        self, number: int, x: np.ndarray, dx: np.ndarray, theta: np.ndarray, names: Sequence[str], gap: float
    ) -> None:
        """Remember an orbit of the values theta (p,) of the named parameters, or say that there is none."""
        if not gap < LOST:
            self._last[number] = None
            said = stated(self.foot, dict(zip(names, theta, strict=True)))
            raise SimulationError(f"{self.foot.name}: no periodic motion at {self.drives[number]} with {said}.")
        self._last[number] = _Last(x, dx, theta)


def stated(foot: Foot, values: Mapping[str, float]) -> str:
    """Parameters of a foot by name and unit, for a sentence."""
    units = {name: item.unit for name, item in foot.parameters.items()}
    return ", ".join(f"{name} = {value:.3g} {units.get(name, '')}".strip() for name, value in values.items())
