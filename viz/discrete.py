"""The linear model of one step of any MJCF, from one batched step with perturbed states; see `discretise`."""

from dataclasses import dataclass

import mujoco
import numpy as np

from fasbody.engine import SHAKER_CONTROLS
from fasbody.exceptions import SettingError
from fasbody.model import Foot
from fasbody.simulate import Batch

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Discrete:
    """x_(k+1) = A x_k + B c_k of one step about rest: x = (q, q', act), c = (a_0, ..., a_3) of the base acceleration.

    `malleolus` (states,) gives the vertical velocity of the malleolus.
    """

    step: float
    A: Array
    B: Array
    malleolus: Array

    def controls(self, frequency_hz: Array) -> Array:
        """(n, 4) coefficients c of a base acceleration exp(i w t) at t = 0, as `BaseMotion.controls` makes them."""
        w = 2j * np.pi * np.asarray(frequency_hz, float)
        a, b = np.ones_like(w), np.exp(w * self.step)
        rise, j, k = (b - a) / self.step, w * a, w * b
        return np.stack([a, j, (3 * rise - 2 * j - k) / self.step, (j + k - 2 * rise) / self.step**2], -1)

    def states(self, frequency_hz: Array) -> Array:
        """(n, states) complex steady states at t = 0 under a base acceleration exp(i w t)."""
        z = np.exp(2j * np.pi * np.asarray(frequency_hz, float) * self.step)
        force = self.controls(frequency_hz) @ self.B.T
        return np.linalg.solve(z[:, None, None] * np.eye(len(self.A)) - self.A, force[..., None])[..., 0]

    def transmissibility(self, frequency_hz: Array) -> Array:
        """(n,) complex malleolus over base acceleration."""
        return 2j * np.pi * np.asarray(frequency_hz) * (self.states(frequency_hz) @ self.malleolus)


def discretise(foot: Foot) -> Discrete:
    """The linear model of one step, by central differences of one batched step.

    Raises:
        SettingError: the model has ball or free joints.
    """
    model = foot.model
    if model.nq != model.nv:
        raise SettingError(f"{foot.name}: the viewer needs joints that are slides or hinges, not balls or free ones.")
    n, n_act = model.nv, model.na
    # Large enough for MuJoCo's constraint solver, which stops at an absolute gain and would see nothing in small ones.
    size = np.concatenate([np.full(n, 1e-4), np.full(n, 1e-2), np.full(n_act, 1.0), [1.0, 1e2, 1e4, 1e6]])
    states, count = 2 * n + n_act, len(size)
    push = np.concatenate([np.diag(size), -np.diag(size)])
    controls = np.zeros((2 * count, 1, SHAKER_CONTROLS))
    controls[:, 0, 1:] = push[:, states:]
    start = np.concatenate([model.qpos0, np.zeros(n + n_act)]) + push[:, :states]
    out = Batch(foot, 2 * count, threads=1).run(controls, foot.step, *np.split(start, [n, 2 * n], axis=1))
    after = np.concatenate([out.qpos[:, -1], out.qvel[:, -1], out.act[:, -1]], axis=1)
    slope = (after[:count] - after[count:]) / (2 * size[:, None])
    data, jacobian = mujoco.MjData(model), np.zeros((3, n))
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_jacSite(model, data, jacobian, None, model.site("malleolus").id)
    row = np.concatenate([np.zeros(n), jacobian[1], np.zeros(n_act)])
    return Discrete(foot.step, slope[:states].T, slope[states:].T, row)
