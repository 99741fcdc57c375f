"""MuJoCo's motion with the twin's derivatives: what certifies a fit where the compiled twin stands for the model.

Residuals, gaps and initial states come from the MuJoCo rollout alone. The derivatives are the exact sensitivities of
the same equations, which cost one simulation where differences cost one a parameter and state; replay.py compares the
two engines over whole recordings besides.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.shaker import samples
from fasbody.foot.simulate import Batch
from fasbody.foot.two_dof import NAMES, STATES, trajectory
from fasbody.recording.recording import Recording
from identification.engines.orbits import LOST, PASSES, Coordinates, Excitation, Twin, twin_order
from identification.engines.runs import TimeTwin, grid


class _Single:
    """One MuJoCo simulation of the foot, prepared once; states in the order of the twin."""

    def __init__(self, foot: Foot) -> None:
        self._batch, self._coordinates = Batch(foot, 1, 1), Coordinates(foot)
        self._declared, self.order = foot.parameters, twin_order(foot)

    def run(
        self, controls: np.ndarray, step: float, values: Mapping[str, float], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output (n,) [m/s^2] and final states (4,) from states x0 (4,)."""
        self._batch.set({name: value for name, value in values.items() if name in self._declared})
        out = self._batch.run(controls[None], step, *self._coordinates.unpack(x0[None, self.order]))
        return out.malleolus[0], self._coordinates.final(out)[0, self.order]


class CertifiedOrbits:
    """Periodic orbits; see `orbits.Engine`.

    Args:
        foot: a model that the twin stands for. excitations: what moves its base.
    """

    name = "mujoco"

    def __init__(self, foot: Foot, excitations: Sequence[Excitation]) -> None:
        self.excitations, self.twin, self._single = list(excitations), Twin(excitations), _Single(foot)
        self._foot = foot
        self._controls = [e.motion.controls(e.step, e.steps) for e in self.excitations]
        self._starts = np.zeros((len(self.excitations), STATES))

    def forget(self) -> None:
        """Start the next orbits from rest."""
        self.twin.forget()

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: Newton's method on MuJoCo's gap after one period, begun at the twin's orbit."""
        e = self.excitations[number]
        full = {**values, **e.masses}
        theta = np.array([full[name] for name in NAMES])
        self.twin.orbit(number, values, names, min(tolerance, 1e-6))
        x, gap = self.twin.start(number), np.inf
        for _ in range(PASSES):
            y, end = self._single.run(self._controls[number], e.step, full, x)
            _, D, _, S = trajectory(x, theta, full["m_S"], full["m_F"], self.twin.inputs[number], e.step, 1, 12)
            monodromy = np.eye(STATES) - S[:, :STATES]
            step = np.linalg.solve(monodromy, end - x)
            x = x + step
            gap = np.abs(step).max() / max(1e-12, np.abs(x).max())
            if gap < tolerance:
                break
        if not gap < LOST:
            raise SimulationError(f"{self._foot.name}: no periodic motion at {e.frequency_hz:g} Hz.")
        self._starts[number] = x
        by_state, by_parameter = (
            D[:, :STATES],
            D[:, STATES:] + D[:, :STATES] @ np.linalg.solve(monodromy, S[:, STATES:]),
        )
        return y + by_state @ step, by_parameter[:, [NAMES.index(name) for name in names]]

    def start(self, number: int) -> np.ndarray:
        """States (s,) of the last orbit at time zero, in the order of the model's coordinates."""
        return self._starts[number][self._single.order]


class CertifiedRuns:
    """Whole recordings; see `time_domain.TimeEngine`.

    Args:
        foot: a model that the twin stands for. recordings: what drives it.
    """

    name = "mujoco"

    def __init__(self, foot: Foot, recordings: Sequence[Recording]) -> None:
        self.twin, self._single = TimeTwin(foot, recordings), _Single(foot)
        self.state_scale = self.twin.state_scale
        self._runs = []
        for recording in recordings:
            h, n, stride = grid(recording, foot)
            motion = samples(recording.time_s - recording.time_s[0], recording.base_m_s2)
            self._runs.append((motion.controls(h, n), h, stride, recording.condition.masses))

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `TimeEngine`."""
        controls, h, stride, masses = self._runs[number]
        _, D = self.twin.run(number, values, names, x0)
        y, _ = self._single.run(controls, h, {**values, **masses}, x0[self._single.order])
        return y[::stride], D
