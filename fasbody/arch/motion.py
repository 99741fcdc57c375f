"""The five-body arch stepped by MuJoCo: extrapolation, and a second try when unstable.

The error is of first order with a small constant (mjcf/foot_arch/README.md says why); `accurate` adds a run at half
the step and extrapolates, which is of second order. When a run diverges or alternates from step to step, the hinges'
dampers are first made all native, then the step is halved. The result notes both.
"""

from dataclasses import dataclass, replace

import numpy as np

from fasbody.arch.kinematics import Array
from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.shaker import BaseMotion
from fasbody.foot.simulate import HINGE_SHARE, Batch

#: How often the step may be halved.
HALVINGS = 4
#: Share of a signal that may alternate from sample to sample; a 100 Hz sine at 1e-4 s has 1e-3.
RINGING = 0.05


@dataclass(frozen=True)
class ArchMotion:
    """Motion of the stepped arch.

    Attributes:
        time: start of each step of the result [s], shape (n,).
        malleolus: its acceleration there [m/s^2], shape (n,).
        qpos: joint positions, base first, shape (n, 7).
        step: the step that was stable [s].
        note: what had to be changed to get there; empty if nothing.
    """

    time: Array
    malleolus: Array
    qpos: Array
    step: float
    note: str

    def __str__(self) -> str:
        peak = np.abs(self.malleolus).max()
        return f"{len(self.time)} samples, malleolus peak {peak:.4g} m/s^2, step {self.step:g} s" + (
            f" ({self.note})" if self.note else ""
        )


def move(foot: Foot, motion: BaseMotion, step: float | None = None, accurate: bool = False) -> ArchMotion:
    """Step the arch through a base motion from rest.

    Args:
        foot: foot_arch or an edited copy.
        motion: of the table.
        step: time step of the result [s], default the model's.
        accurate: extrapolate from this step and half of it.

    Raises:
        SimulationError: unstable even after all-native dampers and `HALVINGS` halvings.
    """
    output_step = step or foot.step
    attempts = [(output_step, HINGE_SHARE)] + [(output_step / 2**k, 1.0) for k in range(HALVINGS + 1)]
    for h, share in attempts:
        try:
            result = _run(foot, motion, h, share)
            if accurate:
                finer = _run(foot, motion, h / 2, share)
                result = replace(result, malleolus=2 * finer.malleolus[::2] - result.malleolus)
        except SimulationError:
            continue
        every = round(output_step / h)
        notes = ["dampers of the hinges all native"] if share == 1 else []
        notes += [f"step {h:g} s in place of {output_step:g} s"] if h < output_step else []
        return replace(
            result, time=result.time[::every], malleolus=result.malleolus[::every], qpos=result.qpos[::every],
            note=", ".join(notes),
        )  # fmt: skip
    raise SimulationError(f"{foot.name}: unstable down to a step of {h:g} s; its joints are too stiff or too light.")


def _run(foot: Foot, motion: BaseMotion, step: float, hinge_share: float) -> ArchMotion:
    controls = motion.controls(step, round(motion.duration / step))[None]
    batch = Batch(foot, 1, threads=1, hinge_share=hinge_share)
    result = batch.run(controls, step, *batch.initial_state([motion]))
    malleolus = result.malleolus[0]
    if np.abs(np.diff(malleolus, 2)).mean() > 4 * RINGING * np.abs(malleolus).mean():
        raise SimulationError(f"{foot.name}: the output rings at the step's own frequency.")
    return ArchMotion(step * np.arange(len(malleolus)), malleolus, result.qpos[0][:-1], step, "")
