"""MuJoCo's motion with the twin's derivatives: what certifies a fit where the compiled twin stands for the model.

Residuals, gaps and initial states come from the MuJoCo rollout alone. The derivatives are the exact sensitivities of
the same equations, which cost one simulation where differences cost one a parameter and state; certification.py
compares the two engines over whole recordings besides.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fasbody.foot.model import Foot
from fasbody.foot.simulate import Batch
from fasbody.foot.two_dof import NAMES, STATES, both
from identification.engines.engine import MALLEOLUS, PASSES, D, Orbits
from identification.engines.mujoco import Coordinates, sampled
from identification.engines.twin import Twin


class CertifiedRollouts(Orbits[D]):
    """Motions of MuJoCo, derivatives of the twin.

    Args:
        foot: a model that the twin stands for. drives: what moves its base. sensors: whose outputs are wanted.

    Attributes:
        base_error: largest relative error of the base acceleration that any motion realised.
    """

    name = "mujoco"

    def __init__(self, foot: Foot, drives: Sequence[D], sensors: Sequence[str] = MALLEOLUS) -> None:
        self.twin = Twin(foot, drives, sensors)
        self.state_scale, self._order = self.twin.state_scale, self.twin.order
        super().__init__(foot, drives, STATES, sensors)
        self._batch, self._coordinates = Batch(foot, 1, 1), Coordinates(foot)
        self._controls = [d.controls for d in self.drives]
        self.base_error = 0.0
        self._runs: dict[int, tuple[bytes, np.ndarray, tuple[str, ...], np.ndarray]] = {}

    def on(self, drives: Sequence[D], foot: Foot | None = None) -> "CertifiedRollouts[D]":
        """See `Engine`."""
        return CertifiedRollouts(foot or self.foot, drives, self.sensors)

    def forget(self) -> None:
        """Start the next orbits from rest."""
        self.twin.forget()
        super().forget()

    def orbit(
        self, number: int, values: Mapping[str, float], names: Sequence[str], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: Newton's method on MuJoCo's gap after one period, begun at the twin's orbit."""
        d, order = self.drives[number], self._order
        full = {**values, **d.masses}
        theta = np.array([full[name] for name in NAMES])
        self.twin.orbit(number, values, names, min(tolerance, 1e-6))
        x, gap = self.twin.start(number)[order], np.inf  # in the order of the twin
        for _ in range(PASSES):
            y, end = self._simulate(number, full, x[order])
            motion = (x, theta, full["m_S"], full["m_F"], self.twin.inputs[number], d.step, 1, 12)
            _, DY, _, S, _, DZ = both(*motion, self.twin.feet)
            monodromy = np.eye(STATES) - S[:, :STATES]
            step = np.linalg.solve(monodromy, end[order] - x)
            x = x + step
            gap = np.abs(step).max() / max(1e-12, np.abs(x).max())
            if gap < tolerance:
                break
        D = self.twin.stacked(DY, DZ)
        by_state, dx = D[:, :STATES], np.linalg.solve(monodromy, S[:, STATES:])
        self._keep(number, x[order], dx[order], theta, NAMES, gap)
        by_parameter = D[:, STATES:] + by_state @ dx
        return y + by_state @ step, by_parameter[:, [NAMES.index(name) for name in names]]

    def nearby(
        self, number: int, values: Mapping[str, float], names: Sequence[str], drives: Sequence[D]
    ) -> list[np.ndarray]:
        """See `Engine`; the twin's, as derivatives are."""
        return self.twin.nearby(number, values, names, drives)

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (k n,), (k n, 4 + p); the last of each drive is kept, to be asked for again."""
        d = self.drives[number]
        moved = repr(sorted(values.items())).encode() + x0.tobytes()
        last, y, to, derivatives = self._runs.get(number, (b"", np.empty(0), (), np.empty(0)))
        if last != moved:
            full, _ = self._simulate(number, {**values, **d.masses}, x0)
            y, to = full[sampled(full.size, len(self.sensors), d.stride)], ()
        if tuple(names) != to or last != moved:
            _, derivatives = self.twin.run(number, values, names, x0)
        self._runs[number] = moved, y, tuple(names), derivatives
        return y, derivatives

    def _simulate(self, number: int, full: Mapping[str, float], x0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Output (k n,) [m/s^2] at every step and final states (4,), from states x0 (4,), in the order of the model."""
        declared = self.foot.parameters
        self._batch.set({name: value for name, value in full.items() if name in declared})
        unpacked = self._coordinates.unpack(x0[None])
        out = self._batch.run(self._controls[number][None], self.drives[number].step, *unpacked)
        self.base_error = max(self.base_error, out.base_error)
        y = np.concatenate([out.outputs[name][0] for name in self.sensors])
        return y, self._coordinates.final(out)[0]
