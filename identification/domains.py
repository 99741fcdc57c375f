"""The two ways to compare model and recordings: steady state, on harmonics, and time domain, on every sample.

A domain makes the problem of its recordings on the fastest engine that is the model, and finds the time step that a
foot's parameters ask for: halved until halving it once more changes nothing.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import mujoco
import numpy as np

from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification.engines.engine import MALLEOLUS, D, Engine, Excitation, Whole
from identification.engines.mujoco import Rollouts
from identification.engines.twin import Twin
from identification.periodic import Line, PeriodicProblem, excitations, misfit
from identification.search import Problem
from identification.space import SearchSpace, Space
from identification.time_domain import TimeProblem

DOMAINS = ("auto", "periodic", "time")
#: Scatter of the fundamental between parts of a recording beyond which it is not steady.
STEADY = 0.05
#: Share of the peak by which halving the step may change an orbit, and halvings at most.
RESOLVED = 1e-4
_HALVINGS = 4


def choose_domain(recordings: Sequence[Recording], wanted: str) -> tuple[str, list[str]]:
    """Periodic if every recording is steady, else time; the reason is said where it is not the usual one.

    Raises:
        SettingError: no such domain, or periodic for a recording that is not.
    """
    if wanted not in DOMAINS:
        raise SettingError(f"the domain is {wanted!r} (valid: {', '.join(DOMAINS)}).")
    if wanted == "time":
        return "time", []
    aperiodic = [recording.file for recording in recordings if recording.condition.frequency_hz is None]
    if aperiodic:
        if wanted == "periodic":
            raise SettingError(
                f"{aperiodic[0]} is not periodic, so it cannot be fitted on harmonics; use --domain time."
            )
        return "time", []
    scatter, file = _worst(recordings)
    if scatter > STEADY:
        text = f"{file} is not steady: its amplitude scatters by {100 * scatter:.0f} % (drift or beating)"
        if wanted == "periodic":
            return "periodic", [f"{text}; the weights follow the scatter."]
        return "time", [f"{text}, so all recordings are fitted in the time domain."]
    return "periodic", []


def _worst(recordings: Sequence[Recording]) -> tuple[float, str]:
    """Largest scatter of a fundamental, and in which recording."""
    lines = [Line.of(recording) for recording in recordings]
    return max((max(line.base.scatter, line.malleolus.scatter), line.recording.file) for line in lines)


def is_steady(recordings: Sequence[Recording]) -> bool:
    """Whether all recordings are in a steady state, so that their harmonics say all that they hold."""
    periodic = all(recording.condition.frequency_hz is not None for recording in recordings)
    return periodic and _worst(recordings)[0] <= STEADY


@dataclass(frozen=True, eq=False)
class Domain(ABC):
    """What is fitted, and how model and recordings are compared.

    Attributes:
        foot: the model, with the time step to simulate with. recordings: checked. space: what is searched.
        twin: the compiled twin stands for this model. threads: 0 for all. sensors: what is fitted, the malleolus first.
        replayed: steady recordings that MuJoCo runs from end to end where it has a twin, None for all.
    """

    foot: Foot
    recordings: Sequence[Recording]
    space: SearchSpace
    twin: bool
    threads: int = 0
    sensors: tuple[str, ...] = MALLEOLUS
    replayed: int | None = 1

    @abstractmethod
    def problem(self) -> Problem:
        """A fresh problem on the fastest engine that is the model."""

    @abstractmethod
    def refined(self, z: np.ndarray) -> Self:
        """Itself, or a copy whose foot has so fine a step that the motion at z is right to 1e-4 of its peak."""

    def weighed(self, z: np.ndarray) -> Self:
        """A domain that weighs what the recordings share beside the misfit at z, where exploring ended."""
        return self

    def engine(self, drives: Sequence[D], names: Sequence[str]) -> Engine[D]:
        """The twin, or MuJoCo with derivatives to the named parameters."""
        if self.twin:
            return Twin(self.foot, drives, self.sensors)
        return Rollouts(self.foot, drives, names, self.threads, self.sensors)

    def _with_step(self, step: float) -> Self:
        return replace(self, foot=self.foot.with_values({}, step=step))


@dataclass(frozen=True, eq=False)
class PeriodicDomain(Domain):
    """Steady state, on harmonics of one period.

    Attributes:
        excess: of the misfit over the noise, as `PeriodicProblem` takes it; infinite for starts far from any foot.
    """

    excess: float = 1.0

    @cached_property
    def lines(self) -> list[Line]:
        """The harmonics of the recordings."""
        return [Line.with_sensors(recording, self.sensors) for recording in self.recordings]

    def problem(self) -> PeriodicProblem:
        """See `Domain`."""
        engine = self.engine(excitations(self.lines, self.foot), self.space.names)
        return PeriodicProblem(self.lines, engine, self.space, excess=self.excess)

    def refined(self, z: np.ndarray) -> Self:
        """See `Domain`."""
        steps = []
        for number, e in enumerate(excitations(self.lines, self.foot)):
            values = self.space.values(self.space.at(number, z)[0])
            found = resolved(e, self.foot, values, self.twin)
            steps += [found.step] if found.step < e.step else []
        return self._with_step(min(steps)) if steps else self

    def weighed(self, z: np.ndarray) -> Self:
        """See `Domain`."""
        r = replace(self, excess=np.inf).problem().residual(z)
        V = np.concatenate(replace(self, excess=1.0).problem().shared_errors())
        return replace(self, excess=misfit(r, V, max(0, r.size - z.size)))


@dataclass(frozen=True, eq=False)
class TimeDomain(Domain):
    """Every sample of whole recordings; what they share is in the covariance alone."""

    space: Space

    def problem(self) -> TimeProblem:
        """See `Domain`."""
        return TimeProblem(self.recordings, self._engine(self.space.names), self.space)

    @property
    def by_twin(self) -> bool:
        """Whether MuJoCo sees one period of each recording only, and the twin the samples (`Settings.replay`)."""
        return self.twin and self.replayed == 0 and all(r.condition.frequency_hz for r in self.recordings)

    def start(self, q: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Full search variable (n,) of constants q (p,) and initial states (R, s) of the two-mass foot or the model."""
        problem = self.problem()
        if not self.twin:
            return problem.start(q)
        order = problem.engine.order
        return np.concatenate([q, *(x[order] / problem.engine.state_scale for x in states[:, :4])])

    def _engine(self, names: Sequence[str]) -> Engine[Whole]:
        return self.engine([Whole.of(recording, self.foot) for recording in self.recordings], names)

    def refined(self, z: np.ndarray) -> Self:
        """See `Domain`."""
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
        engine: Engine[Excitation] = Twin(foot, [e]) if twin else Rollouts(foot, [e], ())
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
