"""The time step that a foot's parameters ask for: halved until halving it once more changes nothing."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import mujoco
import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.model import Foot
from identification.orbits import Excitation, Rollouts, Twin

#: Share of the peak by which halving the step may change an orbit, and halvings at most.
RESOLVED = 1e-4
_HALVINGS = 4


def resolved(excitation: Excitation, foot: Foot, values: Mapping[str, float], twin: bool) -> Excitation:
    """The excitation with a step at which halving it once more leaves the orbit of these values as it is (RESOLVED).

    A damper that nearly stops a part sets a time constant far below the period, m / c, which the parameters decide and
    the frequency does not. A first-order integrator's step is the model's own affair: halving would never end.

    Args:
        excitation: with the step to begin with. foot: the model. values: its parameters, all that are free.
            twin: the compiled two-mass model is this model.
    """
    if foot.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
        return excitation

    def orbit(times: int) -> np.ndarray | None:
        e = _halved(excitation, times)
        engine = Twin([e]) if twin else Rollouts(foot, [e], ())
        try:
            return engine.orbit(0, values, (), 1e-7)[0][:: 2**times]
        except SimulationError:  # beyond the integrator's stability there is no orbit, which a finer step may mend
            return None

    return _halved(excitation, halvings(orbit))


def _halved(e: Excitation, times: int) -> Excitation:
    return replace(e, longest_step=e.step / 2**times) if times else e


def halvings(output: Callable[[int], np.ndarray | None]) -> int:
    """How often a step must be halved until halving it once more changes the output by less than RESOLVED of its peak.

    Args:
        output: what follows from the step halved so many times, always at the same moments; None if nothing does.

    Returns:
        The number; 0 if no step tried is fine enough, for then another thing is wrong than the step.
    """
    coarse = output(0)
    for times in range(_HALVINGS):
        fine = output(times + 1)
        if coarse is not None and fine is not None and np.abs(fine - coarse).max() <= RESOLVED * np.abs(fine).max():
            return times
        coarse = fine
    return 0
