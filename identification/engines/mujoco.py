"""MuJoCo, for any MJCF foot: one short simulation a column of the Jacobian, all columns in one batch.

Coordinates are measured from rest and exclude the base, whose own position and velocity a foot on it does not feel.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.foot.model import Foot
from fasbody.foot.simulate import Batch, Simulation
from identification.engines.engine import MALLEOLUS, PASSES, D, Orbits

#: A displacement [m or rad] and a velocity [m/s or rad/s] typical of a foot, and the share of them that is a nudge:
#: small against the motion, large against rounding.
_POSITION, _VELOCITY, _ACTIVATION, _NUDGE = 1e-3, 0.1, 1.0, 1e-4
_PARAMETER_NUDGE = 1e-6


@dataclass(frozen=True, eq=False)
class Differences:
    """Outputs of one run: y (k n,) [m/s^2], final states x (s,), and derivatives to states (s) and parameters (p)."""

    y: np.ndarray
    x: np.ndarray
    y_by_state: np.ndarray
    y_by_parameter: np.ndarray
    x_by_state: np.ndarray
    x_by_parameter: np.ndarray


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

    def final(self, out: Simulation) -> np.ndarray:
        """States (nsim, s) at the end of a simulation."""
        rest = self.foot.model.qpos0[self._q]
        return np.hstack([out.qpos[:, -1, self._q] - rest, out.qvel[:, -1, self._v], out.act[:, -1]])


class Columns:
    """Prepared batch for one foot and a set of parameters.

    Args:
        foot: the model. names: parameters whose derivatives are wanted. threads: 0 for all cores.
        sensors: whose outputs are wanted.
    """

    def __init__(self, foot: Foot, names: Sequence[str], threads: int = 0, sensors: Sequence[str] = MALLEOLUS) -> None:
        self.foot, self.names, self._coordinates, self.sensors = foot, tuple(names), Coordinates(foot), tuple(sensors)
        self.scale = self._coordinates.scale
        self.states = self.scale.size
        self._batch, self._one = Batch(foot, 1 + self.states + len(self.names), threads), Batch(foot, 1, 1)

    def alone(
        self, controls: np.ndarray, step: float, values: Mapping[str, float], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (k n,) and final states (s,) of one run without derivatives; arguments as those of `run`."""
        self._one.set({k: v for k, v in values.items() if k in self.foot.parameters})
        out = self._one.run(controls[None], step, *self._coordinates.unpack(x0[None]))
        return np.hstack([out.outputs[name] for name in self.sensors])[0], self._coordinates.final(out)[0]

    def run(self, controls: np.ndarray, step: float, values: Mapping[str, float], x0: np.ndarray) -> Differences:
        """Simulate and difference.

        Args:
            controls: (n, 5) shaker controls. step: [s]. values: all parameters by name; others than the model's are
                ignored. x0: (s,) initial states.
        """
        declared, ns = self.foot.parameters, self.states
        self._batch.set({k: v for k, v in values.items() if k in declared and k not in self.names})
        nudge = np.concatenate([_NUDGE * self.scale, np.empty(len(self.names))])
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
        final = self._coordinates.final(out)
        y = np.hstack([out.outputs[name] for name in self.sensors])
        Dy, Dx = (y[1:] - y[0]).T / nudge, (final[1:] - final[0]).T / nudge
        return Differences(y[0], final[0], Dy[:, :ns], Dy[:, ns:], Dx[:, :ns], Dx[:, ns:])


class Rollouts(Orbits[D]):
    """Motions of any MJCF foot.

    Args:
        foot: the model. drives: what moves its base. names: the parameters whose derivatives are wanted.
        threads: 0 for all cores. sensors: whose outputs are wanted.
    """

    name = "mujoco"

    def __init__(
        self,
        foot: Foot,
        drives: Sequence[D],
        names: Sequence[str],
        threads: int = 0,
        sensors: Sequence[str] = MALLEOLUS,
    ) -> None:
        self.columns, self._threads = Columns(foot, names, threads, sensors), threads
        self.state_scale = self.columns.scale
        super().__init__(foot, drives, self.columns.states, sensors)
        self._controls = [d.controls for d in self.drives]

    def forget(self) -> None:
        """Start the next orbits from rest."""
        self._frozen: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # I - monodromy, and outputs by states
        super().forget()

    def on(self, drives: Sequence[D], foot: Foot | None = None) -> "Rollouts[D]":
        """See `Engine`."""
        return Rollouts(foot or self.foot, drives, self.columns.names, self._threads, self.sensors)

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (k n,), (k n, p); `names` are those given at construction."""
        e, controls = self.drives[number], self._controls[number]
        full = {**values, **e.masses}
        theta = np.array([values[name] for name in self.columns.names])
        x = self._guess(number, theta)
        if number in self._frozen:
            x = self._near(controls, e.step, full, x, self._frozen[number][0], tolerance)
        try:
            for _ in range(PASSES):
                d = self.columns.run(controls, e.step, full, x)
                monodromy = np.eye(x.size) - d.x_by_state
                step = np.linalg.solve(monodromy, d.x - x)
                x = x + step
                gap = np.abs(step).max() / max(1e-12, np.abs(x).max())
                if gap < tolerance:
                    break
                x = self._near(controls, e.step, full, x, monodromy, tolerance)
            dx = np.linalg.solve(monodromy, d.x_by_parameter)
        except np.linalg.LinAlgError:  # neutral: any start is an orbit, or none
            gap, dx = np.inf, np.empty(0)
        self._keep(number, x, dx, theta, self.columns.names, gap)
        self._frozen[number] = monodromy, d.y_by_state
        return d.y + d.y_by_state @ step, d.y_by_parameter + d.y_by_state @ dx

    def _near(
        self,
        controls: np.ndarray,
        step: float,
        values: Mapping[str, float],
        x: np.ndarray,
        monodromy: np.ndarray,
        tolerance: float,
    ) -> np.ndarray:
        """States (s,) nearer to those that return, by Newton's method with a monodromy matrix from nearby.

        A pass costs one simulation where a new matrix costs one a state; it stops where it no longer comes nearer.
        """
        before = np.inf
        for _ in range(PASSES):
            move = np.linalg.solve(monodromy, self.columns.alone(controls, step, values, x)[1] - x)
            gap = np.abs(move).max() / max(1e-12, np.abs(x + move).max())
            if not gap < before / 2:
                break
            x, before = x + move, gap
            if gap < tolerance / 2:
                break
        return x

    def nearby(
        self, number: int, values: Mapping[str, float], names: Sequence[str], drives: Sequence[D]
    ) -> list[np.ndarray]:
        """See `Engine`: one simulation a drive, closed by the monodromy matrix of the drive that they are near to."""
        self.orbit(number, values, names, 1e-6)
        x, full = self.start(number), {**values, **self.drives[number].masses}
        monodromy, by_state = self._frozen[number]
        found = []
        for drive in drives:
            y, end = self.columns.alone(drive.controls, drive.step, full, x)
            found.append(y + by_state @ np.linalg.solve(monodromy, end - x))
        return found

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (k n,), (k n, states + p); `names` as at construction."""
        e = self.drives[number]
        d = self.columns.run(self._controls[number], e.step, {**values, **e.masses}, x0)
        derivatives = np.hstack([d.y_by_state, d.y_by_parameter])
        at = sampled(d.y.size, len(self.sensors), e.stride)
        return d.y[at], derivatives[at]


def sampled(size: int, sensors: int, stride: int) -> np.ndarray:
    """Where the samples of each sensor stand in its steps, with a sensor behind the other."""
    found: np.ndarray = np.arange(size).reshape(sensors, -1)[:, ::stride].ravel()
    return found
