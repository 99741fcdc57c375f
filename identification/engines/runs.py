"""What runs whole recordings for the time-domain fit: the compiled twin, or any MJCF foot in MuJoCo."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np

from fasbody.foot.model import Foot
from fasbody.foot.shaker import BaseMotion, samples
from fasbody.foot.two_dof import NAMES, trajectory
from fasbody.recording.recording import Recording
from identification.engines.orbits import Columns, twin_order

#: Longest time step [s]; each sampling interval is divided into whole steps.
LONGEST_STEP = 5e-4


class TimeEngine(Protocol):
    """Runs whole recordings with derivatives."""

    name: str
    state_scale: np.ndarray

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output (n,) at the samples and derivatives (n, states + p) to initial states and named parameters."""


def grid(recording: Recording, foot: Foot) -> tuple[float, int, int]:
    """Time step [s], number of steps and steps a sample; the model's own step where it asks for a finer one."""
    interval = 1.0 / recording.rate_hz
    stride = max(1, int(np.ceil(interval / min(LONGEST_STEP, foot.step) - 1e-6)))
    return interval / stride, recording.time_s.size * stride, stride


def _driven(
    recordings: Sequence[Recording], foot: Foot
) -> Iterator[tuple[BaseMotion, float, int, int, dict[str, float]]]:
    """Base motion, time step, number of steps, steps a sample and masses of each recording."""
    for recording in recordings:
        h, n, stride = grid(recording, foot)
        motion = samples(recording.time_s - recording.time_s[0], recording.base_m_s2)
        yield motion, h, n, stride, recording.condition.masses


class TimeTwin:
    """The compiled two-mass model over whole recordings; its states come in the order of the model's coordinates.

    Args:
        foot: a model that the twin stands for. recordings: what drives it.
    """

    name = "twin"

    def __init__(self, foot: Foot, recordings: Sequence[Recording]) -> None:
        self.state_scale = np.array([1e-3, 1e-3, 0.1, 0.1])
        self.order = twin_order(foot)
        self._runs = [(u.half_steps(h, n), h, stride, masses) for u, h, n, stride, masses in _driven(recordings, foot)]

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output (n,) [m/s^2], derivatives (n, states + p); see `TimeEngine`."""
        u, h, stride, masses = self._runs[number]
        full = {**values, **masses}
        theta = np.array([full[name] for name in NAMES])
        columns = 12 if names else 0
        Y, DY, *_ = trajectory(x0[self.order], theta, full["m_S"], full["m_F"], u, h, stride, columns)
        return Y, DY[:, [*self.order, *(4 + NAMES.index(name) for name in names)]]


class TimeRollouts:
    """Any MJCF foot in MuJoCo over whole recordings.

    Args:
        foot: the model. recordings: what drives it. names: parameters whose derivatives are wanted. threads: 0 for all.
    """

    name = "mujoco"

    def __init__(self, foot: Foot, recordings: Sequence[Recording], names: Sequence[str], threads: int = 0) -> None:
        self.columns = Columns(foot, names, threads)
        self.state_scale = self.columns.scale
        self._runs = [(u.controls(h, n), h, stride, masses) for u, h, n, stride, masses in _driven(recordings, foot)]

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output (n,) [m/s^2], derivatives (n, states + p); see `TimeEngine`; `names` as at construction."""
        controls, h, stride, masses = self._runs[number]
        d = self.columns.run(controls, h, {**values, **masses}, x0)
        return d.y[::stride], np.hstack([d.y_by_state, d.y_by_parameter])[::stride]
