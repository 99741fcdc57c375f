"""The compiled two-mass model: Eq. (4.29) with exact sensitivities, and where it may stand for a model."""

import functools
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from fasbody.foot.model import Foot
from fasbody.foot.two_dof import MASSES, NAMES, STATES, WITH_MASSES, TwoDof, periodic, trajectory
from identification.engines.engine import PASSES, D, Orbits


class Twin(Orbits[D]):
    """Motions of the compiled two-mass model.

    Args:
        foot: a model that the twin stands for (`twin_applies`). drives: what moves its base.
    """

    name = "twin"

    def __init__(self, foot: Foot, drives: Sequence[D]) -> None:
        super().__init__(foot, drives, STATES)
        self.order, self.state_scale = twin_order(foot), np.array([1e-3, 1e-3, 0.1, 0.1])
        self.inputs = [d.motion.half_steps(d.step, d.steps) for d in self.drives]

    def on(self, drives: Sequence[D], foot: Foot | None = None) -> "Twin[D]":
        """See `Engine`."""
        return Twin(foot or self.foot, drives)

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (n,), (n, p)."""
        d = self.drives[number]
        masses = {**values, **d.masses}
        weighed = any(name in MASSES for name in names)
        order = (*NAMES, *MASSES) if weighed else NAMES
        theta = np.array([masses[name] for name in order])
        columns = WITH_MASSES if weighed else STATES + len(NAMES)
        motion = (masses["m_S"], masses["m_F"], self.inputs[number], d.step, tolerance, PASSES, columns)
        arguments = (theta[: len(NAMES)], *motion)
        try:
            Y, DY, x, dx, gap = periodic(self._guess(number, theta), *arguments)
            if not gap < tolerance:  # a bad guess: once more from rest
                Y, DY, x, dx, gap = periodic(np.zeros(STATES), *arguments)
        except np.linalg.LinAlgError:  # neutral: any start is an orbit, or none
            gap, Y, DY, x, dx = np.inf, np.empty(0), np.empty((0, 0)), np.empty(0), np.empty((0, 0))
        self._keep(number, x, dx, theta, gap)
        return Y, DY[:, [order.index(name) for name in names]]

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (n,), (n, 4 + p)."""
        d = self.drives[number]
        full = {**values, **d.masses}
        theta = np.array([full[name] for name in NAMES])
        columns = 12 if names else 0
        motion = (x0[self.order], theta, full["m_S"], full["m_F"], self.inputs[number], d.step, d.stride, columns)
        Y, DY, *_ = trajectory(*motion)
        return Y, DY[:, [*self.order, *(4 + NAMES.index(name) for name in names)]]

    def start(self, number: int) -> np.ndarray:
        """See `Engine`: states (4,)."""
        return super().start(number)[self.order]


@functools.lru_cache(maxsize=8)  # a study asks twice for each of its fits
def twin_applies(foot: Foot) -> bool:
    """Whether the compiled two-mass model is this model: the same accelerations at random states and parameters."""
    from fasbody.foot.engine import callbacks

    model = foot.model
    needed = {*NAMES, "m_S", "m_F"}
    if (
        not needed <= set(foot.parameters)
        or model.nv != 3
        or model.na
        or model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4
    ):
        return False
    joints = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)]
    if not {"talocrural", "fat_pad"} <= set(joints):
        return False
    at = [int(model.joint(name).qposadr[0]) for name in ("talocrural", "fat_pad")]
    rng = np.random.default_rng(0)
    for _ in range(8):
        values = {n: v * rng.uniform(0.5, 1.5) for n, v in foot.values().items() if n in needed}
        trial = foot.with_values(values)
        data = mujoco.MjData(trial.model)
        x, u = np.concatenate([rng.normal(0, 1e-3, 2), rng.normal(0, 0.1, 2)]), rng.normal(0, 9)
        data.qpos[at], data.qvel[at] = x[:2] + model.qpos0[at], x[2:]
        data.ctrl[foot.shaker + 1] = u
        with callbacks():
            mujoco.mj_forward(trial.model, data)
        twin = TwoDof.from_values(values)
        want = np.append(twin.rates(0.0, x, u)[2:], twin.output(x))
        have = np.append(data.qacc[at], data.sensordata[foot.sensor["malleolus"]])
        if np.abs(have - want).max() > 1e-6 * np.abs(want).max():
            return False
    return True


def twin_order(foot: Foot) -> np.ndarray:
    """(4,) where z1, z2, z1', z2' of the twin stand among the model's coordinates without the base; its own inverse."""
    ankle, pad = (int(foot.model.joint(name).qposadr[0]) for name in ("talocrural", "fat_pad"))
    return np.array([0, 1, 2, 3] if ankle < pad else [1, 0, 3, 2])
