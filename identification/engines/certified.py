"""MuJoCo's motion with the twin's derivatives: what certifies a fit where the compiled twin stands for the model.

Residuals and initial states come from the MuJoCo rollout alone. The derivatives are the exact sensitivities of
the same equations, which cost one simulation where differences cost one a parameter and state; certification.py
compares the two engines over whole recordings besides.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fasbody.foot.model import Foot
from fasbody.foot.simulate import Batch
from identification.engines.engine import MALLEOLUS, Whole
from identification.engines.mujoco import Coordinates, sampled
from identification.engines.twin import Twin


class CertifiedRollouts:
    """Motions of MuJoCo, derivatives of the twin.

    Args:
        foot: a model that the twin stands for.
        drives: the recordings.
        sensors: whose outputs are wanted.

    Attributes:
        base_error: largest relative error of the base acceleration that any motion realised.
    """

    def __init__(self, foot: Foot, drives: Sequence[Whole], sensors: Sequence[str] = MALLEOLUS) -> None:
        self.twin = Twin(foot, drives, sensors)
        self.drives, self.sensors, self.state_scale = self.twin.drives, self.twin.sensors, self.twin.state_scale
        self._foot, self._batch, self._coordinates = foot, Batch(foot, 1, 1), Coordinates(foot)
        self.base_error = 0.0
        self._runs: dict[int, tuple[bytes, np.ndarray, tuple[str, ...], np.ndarray]] = {}

    def run(
        self, number: int, values: Mapping[str, float], names: Sequence[str], x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Engine`: arrays (k n,), (k n, 4 + p); the last of each drive is kept, to be asked for again."""
        d = self.drives[number]
        moved = repr(sorted(values.items())).encode() + x0.tobytes()
        last, y, to, derivatives = self._runs.get(number, (b"", np.empty(0), (), np.empty(0)))
        if last != moved:
            full = self._simulate(number, {**values, **d.masses}, x0)
            y, to = full[sampled(full.size, len(self.sensors), d.stride)], ()
        if tuple(names) != to or last != moved:
            _, derivatives = self.twin.run(number, values, names, x0)
        self._runs[number] = moved, y, tuple(names), derivatives
        return y, derivatives

    def _simulate(self, number: int, full: Mapping[str, float], x0: np.ndarray) -> np.ndarray:
        """Output (k n,) [m/s^2] at every step from states x0 (4,), in the order of the model."""
        declared, drive = self._foot.parameters, self.drives[number]
        self._batch.set({name: value for name, value in full.items() if name in declared})
        out = self._batch.run(drive.controls[None], drive.step, *self._coordinates.unpack(x0[None]))
        self.base_error = max(self.base_error, out.base_error)
        return np.concatenate([out.outputs[name][0] for name in self.sensors])
