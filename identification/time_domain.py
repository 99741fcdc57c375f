"""Every sample of recordings against a model.

A domain makes the problem of its recordings on the fastest engine that is the model, and finds the time step that a
foot's parameters ask for: halved until halving it once more changes nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification.engines.engine import MALLEOLUS, Engine, Whole
from identification.engines.mujoco import Rollouts
from identification.engines.twin import Twin
from identification.parameters import Space
from identification.time_problem import TimeProblem

#: Share of the peak by which halving the step may change an orbit, and halvings at most.
RESOLVED = 1e-4
_HALVINGS = 4


@dataclass(frozen=True, eq=False)
class TimeDomain:
    """Every sample of whole recordings; what they share is in the covariance alone.

    Attributes:
        foot: the model, with the time step to simulate with.
        recordings: checked.
        space: what is searched.
        twin: the compiled twin stands for this model.
        threads: 0 for all.
        sensors: what is fitted, the malleolus first.
        replayed: steady recordings that MuJoCo runs from end to end where it has a twin, None for
            all.
    """

    foot: Foot
    recordings: Sequence[Recording]
    space: Space
    twin: bool
    threads: int = 0
    sensors: tuple[str, ...] = MALLEOLUS
    replayed: int | None = 1

    def problem(self) -> TimeProblem:
        """A fresh problem on the fastest engine that is the model."""
        return TimeProblem(self.recordings, self._engine(self.space.names), self.space)

    @property
    def by_twin(self) -> bool:
        """Whether MuJoCo sees one period of each recording only, and the twin the samples (`Settings.replay`)."""
        return self.twin and self.replayed == 0 and all(r.condition.frequency_hz for r in self.recordings)

    def start(self, q: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Full search variable (n,) of constants q (p,) and initial states (R, s) of the two-mass foot or the model."""
        problem = self.problem()
        if not isinstance(problem.engine, Twin):
            return problem.start(q)
        order = problem.engine.order
        return np.concatenate([q, *(x[order] / problem.engine.state_scale for x in states[:, :4])])

    def _engine(self, names: Sequence[str]) -> Engine:
        drives = [Whole.of(recording, self.foot) for recording in self.recordings]
        if self.twin:
            return Twin(self.foot, drives, self.sensors)
        return Rollouts(self.foot, drives, names, self.threads, self.sensors)

    def _with_step(self, step: float) -> Self:
        return replace(self, foot=self.foot.with_values({}, step=step))

    def refined(self, z: np.ndarray) -> Self:
        """Itself, or a copy with so fine a step that the motion at z is right to 1e-4 of its peak."""
        if self.foot.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
            return self
        problem = self.problem()
        values = self.space.values(self.space.to_theta(z[: self.space.lower.size]))
        step = min(Whole.of(recording, self.foot).step for recording in self.recordings)

        def output(times: int) -> np.ndarray | None:
            engine = self._with_step(step / 2**times)._engine(())
            runs = [engine.run(i, values, (), problem.states(z, i))[0] for i in range(len(self.recordings))]
            return np.concatenate(runs) if all(np.isfinite(y).all() for y in runs) else None

        times = halvings(output)
        return self._with_step(step / 2**times) if times else self


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
