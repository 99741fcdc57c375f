"""What runs a foot over whole recordings: the protocol of the engines, and what drives them."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from fasbody.foot.model import Foot
from fasbody.foot.shaker import at_half_steps, samples
from fasbody.foot.simulate import check_drift
from fasbody.foot.steady_state import Balance
from fasbody.recording.recording import Recording
from identification.sensors import MALLEOLUS as MALLEOLUS

#: Longest time step [s] to begin with. RK4 then errs by 1e-5 of the peak in the median of fitted feet, but by 2 % where
#: a damper is at its bound under 4.5 kg: time_domain.py halves it there.
LONGEST_STEP = 5e-4


@dataclass(frozen=True, eq=False)
class Whole:
    """A whole recording: its base motion as the spline through its samples, each interval divided into whole steps.

    Attributes:
        recording: what was measured.
        stride: steps a sample.
    """

    recording: Recording
    stride: int

    @classmethod
    def of(cls, recording: Recording, foot: Foot) -> "Whole":
        """A recording that drives a foot; the step is the model's own where that is finer than LONGEST_STEP.

        Raises:
            SimulationError: nothing carries the foot, or it is tied to the world, and a recording does not say where
                its base is.
        """
        _check_carried(foot)
        check_drift(foot, recording.file)
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

    @cached_property
    def controls(self) -> np.ndarray:
        """(n, 5) of the steps, for MuJoCo (`BaseMotion.controls`)."""
        motion = samples(self.recording.time_s, self.recording.base_m_s2)
        return motion.controls(self.step, self.steps)

    @cached_property
    def half_steps(self) -> np.ndarray:
        """(2 n + 1,) base acceleration at half steps [m/s^2], for the twin (`BaseMotion.half_steps`)."""
        return at_half_steps(self.controls, self.step)

    def __str__(self) -> str:
        return self.recording.file


@functools.lru_cache(maxsize=2)  # the same for each recording and branch
def _check_carried(foot: Foot) -> None:
    Balance(foot).carried({})


@functools.lru_cache(maxsize=2)  # both branches of a fit are run under the same motion
def _driven(recording: Recording, stride: int) -> Whole:
    return Whole(recording, stride)


class Engine(Protocol):
    """What runs motions and their derivatives, one recording at a time.

    States are in the order of the model's coordinates. Output is that of each sensor, one behind the other: (k n,) of k
    sensors.

    Attributes:
        drives: the recordings.
        sensors: whose output it gives, the malleolus first.
        state_scale: (s,) a displacement and a velocity typical of a foot.
    """

    drives: list[Whole]
    sensors: tuple[str, ...]
    state_scale: np.ndarray

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output (k n,) [m/s^2] at the samples, from states x0 (s,), and derivatives (k n, s + p) to both."""


def stated(foot: Foot, values: Mapping[str, float]) -> str:
    """Parameters of a foot by name and unit, for a sentence."""
    units = {name: item.unit for name, item in foot.parameters.items()}
    return ", ".join(f"{name} = {value:.3g} {units.get(name, '')}".strip() for name, value in values.items())
