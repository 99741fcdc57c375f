"""The compiled two-mass model: Eq. (4.29) with exact sensitivities, and where it may stand for a model."""

import functools
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from fasbody.foot.engine import SHAKER_CONTROLS
from fasbody.foot.model import Foot, can_be_constrained
from fasbody.foot.two_dof import MASSES, NAMES, STATES, WITH_MASSES, TwoDof, both, both_periodic
from identification.engines.engine import MALLEOLUS, PASSES, D, Orbits


class Twin(Orbits[D]):
    """Motions of the compiled two-mass model.

    Args:
        foot: a model that the twin stands for (`twin_applies`). drives: what moves its base.
        sensors: whose outputs are wanted, of those on one of the two masses.

    Attributes:
        feet: whether a sensor is on the foot's mass.
    """

    name = "twin"

    def __init__(self, foot: Foot, drives: Sequence[D], sensors: Sequence[str] = MALLEOLUS) -> None:
        super().__init__(foot, drives, STATES, sensors)
        self.on_foot = tuple(name != "malleolus" and carriers(foot)[name] == FOOT for name in sensors)
        self.feet = any(self.on_foot)
        self.order, self.state_scale = twin_order(foot), np.array([1e-3, 1e-3, 0.1, 0.1])
        self.inputs = [d.half_steps for d in self.drives]

    def on(self, drives: Sequence[D], foot: Foot | None = None) -> "Twin[D]":
        """See `Engine`."""
        return Twin(foot or self.foot, drives, self.sensors)

    def stacked(self, Y: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """What the sensors read (k n, ...) from what shank and foot do (n, ...), one behind the other."""
        if self.on_foot == (False,):
            return Y
        return np.concatenate([Z if on_foot else Y for on_foot in self.on_foot])

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (k n,), (k n, p)."""
        d = self.drives[number]
        masses = {**values, **d.masses}
        weighed = any(name in MASSES for name in names)
        order = (*NAMES, *MASSES) if weighed else NAMES
        theta = np.array([masses[name] for name in order])
        columns = WITH_MASSES if weighed else STATES + len(NAMES)
        motion = (masses["m_S"], masses["m_F"], self.inputs[number], d.step, tolerance, PASSES, columns, self.feet)
        arguments = (theta[: len(NAMES)], *motion)
        try:
            Y, DY, x, dx, gap, Z, DZ = both_periodic(self._guess(number, theta), *arguments)
            if not gap < tolerance:  # a bad guess: once more from rest
                Y, DY, x, dx, gap, Z, DZ = both_periodic(np.zeros(STATES), *arguments)
        except np.linalg.LinAlgError:  # neutral: any start is an orbit, or none
            gap, Y, DY, x, dx = np.inf, np.empty(0), np.empty((0, 0)), np.empty(0), np.empty((0, 0))
            Z, DZ = Y, DY
        self._keep(number, x, dx, theta, order, gap)
        wanted = [order.index(name) for name in names]
        return self.stacked(Y, Z), self.stacked(DY, DZ)[:, wanted]

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (k n,), (k n, 4 + p)."""
        d = self.drives[number]
        full = {**values, **d.masses}
        theta = np.array([full[name] for name in NAMES])
        columns = 12 if names else 0
        motion = (x0[self.order], theta, full["m_S"], full["m_F"], self.inputs[number], d.step, d.stride, columns)
        Y, DY, _, _, Z, DZ = both(*motion, self.feet)
        return self.stacked(Y, Z), self.stacked(DY, DZ)[:, [*self.order, *(4 + NAMES.index(name) for name in names)]]

    def nearby(
        self, number: int, values: Mapping[str, float], names: Sequence[str], drives: Sequence[D]
    ) -> list[np.ndarray]:
        """See `Engine`: one simulation a drive, closed by the monodromy matrix of the drive that they are near to."""
        self.orbit(number, values, names, 1e-6)
        x, full = super().start(number), {**values, **self.drives[number].masses}
        given = (x, np.array([full[name] for name in NAMES]), full["m_S"], full["m_F"])
        _, DY, _, S, _, DZ = both(*given, self.inputs[number], self.drives[number].step, 1, STATES, self.feet)
        by_state, monodromy = self.stacked(DY, DZ)[:, :STATES], np.eye(STATES) - S[:, :STATES]
        found = []
        for drive in drives:
            Y, _, end, _, Z, _ = both(*given, drive.half_steps, drive.step, 1, 0, self.feet)
            found.append(self.stacked(Y, Z) + by_state @ np.linalg.solve(monodromy, end - x))
        return found

    def start(self, number: int) -> np.ndarray:
        """See `Engine`: states (4,)."""
        return super().start(number)[self.order]


#: Which mass a sensor is on.
SHANK, FOOT = "shank", "foot"


def twin_applies(foot: Foot, sensors: Sequence[str] = MALLEOLUS) -> bool:
    """Whether the compiled two-mass model is this model: the same accelerations at random states and parameters.

    Args:
        foot: the model. sensors: each must sit on one of the two masses; any number may.
    """
    found = carriers(foot)
    return found.get("malleolus") == SHANK and all(name in found for name in sensors)


@functools.lru_cache(maxsize=8)  # a study asks twice for each of its fits
def carriers(foot: Foot) -> Mapping[str, str]:
    """Which mass of the compiled model each sensor reads; nothing where that is not this model."""
    from fasbody.foot.engine import callbacks

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
