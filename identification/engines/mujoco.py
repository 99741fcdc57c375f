"""MuJoCo, for any MJCF foot: one short simulation a column of the Jacobian, all columns in one batch.

Coordinates are measured from rest and exclude the base, whose own position and velocity a foot on it does not feel.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fasbody.foot.model import Foot
from fasbody.foot.simulate import Batch
from identification.engines.engine import MALLEOLUS, Whole

#: A displacement [m or rad] and a velocity [m/s or rad/s] typical of a foot, and the share of them that is a nudge:
#: small against the motion, large against rounding.
_POSITION, _VELOCITY, _ACTIVATION, _NUDGE = 1e-3, 0.1, 1.0, 1e-4
_PARAMETER_NUDGE = 1e-6


class Coordinates:
    """States of a foot as the fit sees them: positions from rest, velocities and activations, without the base."""

    def __init__(self, foot: Foot) -> None:
        self.foot, model = foot, foot.model
        self._q, self._v = np.delete(np.arange(model.nq), foot.base), np.delete(np.arange(model.nv), foot.base)
        sizes = [np.full(self._q.size, _POSITION), np.full(self._v.size, _VELOCITY), np.full(model.na, _ACTIVATION)]
        self.scale = np.concatenate(sizes)

    def unpack(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """qpos, qvel, act, each (nsim, ...), of states x (nsim, s), with the base at rest."""
        model, nq, nv = self.foot.model, self._q.size, self._v.size
        qpos, qvel = np.tile(model.qpos0, (x.shape[0], 1)), np.zeros((x.shape[0], model.nv))
        qpos[:, self._q] += x[:, :nq]
        qvel[:, self._v] = x[:, nq : nq + nv]
        return qpos, qvel, x[:, nq + nv :]


class Rollouts:
    """Motions of any MJCF foot, in one batch prepared for a set of parameters.

    Args:
        foot: the model.
        drives: the recordings.
        names: the parameters whose derivatives are wanted.
        threads: 0 for all cores.
        sensors: whose outputs are wanted.
    """

    def __init__(
        self,
        foot: Foot,
        drives: Sequence[Whole],
        names: Sequence[str],
        threads: int = 0,
        sensors: Sequence[str] = MALLEOLUS,
    ) -> None:
        self.foot, self.drives, self.names, self.sensors = foot, list(drives), tuple(names), tuple(sensors)
        self._coordinates = Coordinates(foot)
        self.state_scale = self._coordinates.scale
        self._batch = Batch(foot, 1 + self.state_scale.size + len(self.names), threads)

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (k n,), (k n, states + p); `names` as at construction."""
        e = self.drives[number]
        y, D = self.simulate(e.controls, e.step, {**values, **e.masses}, x0)
        at = sampled(y.size, len(self.sensors), e.stride)
        return y[at], D[at]

    def simulate(
        self, controls: np.ndarray, step: float, values: Mapping[str, float], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (k n,) [m/s^2] at every step, and their derivatives (k n, s + p) by differences.

        Args:
            controls: (n, 5) shaker controls.
            step: [s].
            values: all parameters by name; others than the model's are ignored.
            x0: (s,) initial states.
        """
        declared, ns = self.foot.parameters, self.state_scale.size
        self._batch.set({k: v for k, v in values.items() if k in declared and k not in self.names})
        nudge = np.concatenate([_NUDGE * self.state_scale, np.empty(len(self.names))])
        for i, name in enumerate(self.names):
            item = declared[name]
            # values like c_12 pass through zero: their nudge follows the declared range instead
            size = abs(values[name]) if item.logarithmic else max(abs(item.lower), abs(item.upper))
            nudge[ns + i] = _PARAMETER_NUDGE * size
            column = np.full(self._batch.nsim, float(values[name]))  # a whole number must take the nudge too
            column[1 + ns + i] += nudge[ns + i]
            self._batch.set({name: column})
        start = np.tile(x0, (self._batch.nsim, 1))
        start[np.arange(1, ns + 1), np.arange(ns)] += nudge[:ns]
        out = self._batch.run(controls[None], step, *self._coordinates.unpack(start))
        y = np.hstack([out.outputs[name] for name in self.sensors])
        return y[0], (y[1:] - y[0]).T / nudge


def sampled(size: int, sensors: int, stride: int) -> np.ndarray:
    """Where the samples of each sensor stand in its steps, with a sensor behind the other."""
    rows: np.ndarray = np.arange(size).reshape(sensors, -1)[:, ::stride].ravel()
    return rows
