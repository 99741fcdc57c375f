"""The compiled two-mass model: Eq. (4.29) with exact sensitivities, and where it may stand for a model."""

import functools
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from fasbody.foot.engine import SHAKER_CONTROLS, callbacks
from fasbody.foot.model import Foot, can_be_constrained
from fasbody.foot.two_dof import NAMES, TwoDof
from identification.engines.engine import MALLEOLUS, Whole


class Twin:
    """Motions of the compiled two-mass model.

    Args:
        foot: a model that the twin stands for (`twin_applies`).
        drives: the recordings.
        sensors: whose outputs are wanted, of those on one of the two masses.
    """

    def __init__(self, foot: Foot, drives: Sequence[Whole], sensors: Sequence[str] = MALLEOLUS) -> None:
        self.drives, self.sensors = list(drives), tuple(sensors)
        self.on_foot = tuple(name != "malleolus" and carriers(foot)[name] == FOOT for name in sensors)
        self.order, self.state_scale = twin_order(foot), np.array([1e-3, 1e-3, 0.1, 0.1])

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (k n,), (k n, 4 + p)."""
        from fasbody.foot.stepper import both  # numba, which takes a moment to load

        d = self.drives[number]
        full = {**values, **d.masses}
        theta = np.array([full[name] for name in NAMES])
        motion = (x0[self.order], theta, full["m_S"], full["m_F"], d.half_steps, d.step, d.stride)
        Y, DY, _, _, Z, DZ = both(*motion, 12 if names else 0, any(self.on_foot))
        columns = [*self.order, *(4 + NAMES.index(name) for name in names)]
        return self._stacked(Y, Z), self._stacked(DY, DZ)[:, columns]

    def _stacked(self, Y: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """What the sensors read (k n, ...) from what shank and foot do (n, ...), one behind the other."""
        return Y if self.on_foot == (False,) else np.concatenate([Z if foot else Y for foot in self.on_foot])


#: Which mass a sensor is on.
SHANK, FOOT = "shank", "foot"


def twin_applies(foot: Foot, sensors: Sequence[str] = MALLEOLUS) -> bool:
    """Whether the compiled two-mass model is this model: the same accelerations at random states and parameters.

    Args:
        foot: the model.
        sensors: each must sit on one of the two masses; any number may.
    """
    masses = carriers(foot)
    return masses.get("malleolus") == SHANK and all(name in masses for name in sensors)


@functools.lru_cache(maxsize=8)  # a study asks twice for each of its fits
def carriers(foot: Foot) -> Mapping[str, str]:
    """Which mass of the compiled model each sensor reads; nothing where that is not this model."""
    model = foot.model
    fits: dict[str, set[str]] = {name: {SHANK, FOOT} for name in foot.sensors if name != "base"}
    needed = {*NAMES, "m_S", "m_F"}
    if (
        not needed <= set(foot.parameters)
        or model.nv != 3
        or model.na
        or model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4
        # what may act beyond the states that are tried below: a strap that is slack, a stop, another actuator
        or model.ntendon
        or can_be_constrained(model)
        or model.nactuator != SHAKER_CONTROLS
    ):
        return {}
    joints = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)]
    if not {"talocrural", "fat_pad"} <= set(joints):
        return {}
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
        want, on = twin.rates(0.0, x, u)[2:], {SHANK: twin.output(x), FOOT: twin.foot_output(x)}
        size = max(np.abs(want).max(), *map(abs, on.values()))
        if np.abs(data.qacc[at] - want).max() > 1e-6 * size:
            return {}
        for name, where in fits.items():
            read = foot.sensors[name].read(data.sensordata)
            where -= {mass for mass in where if abs(read - on[mass]) > 1e-6 * size}
    return {name: where.pop() for name, where in fits.items() if where}


def twin_order(foot: Foot) -> np.ndarray:
    """(4,) where z1, z2, z1', z2' of the twin stand among the model's coordinates without the base; its own inverse."""
    ankle, pad = (int(foot.model.joint(name).qposadr[0]) for name in ("talocrural", "fat_pad"))
    return np.array([0, 1, 2, 3] if ankle < pad else [1, 0, 3, 2])
