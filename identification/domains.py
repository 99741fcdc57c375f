"""The time step that a foot's parameters ask for: halved until halving it once more changes nothing.

The two ways to compare model and recordings, with the two engines each: steady state and time domain.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import mujoco
import numpy as np

from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification.engines.certified import CertifiedOrbits, CertifiedRuns
from identification.engines.orbits import LONGEST_STEP, Engine, Excitation, Rollouts, Twin
from identification.engines.runs import TimeEngine, TimeRollouts, TimeTwin, grid
from identification.periodic import Line, PeriodicProblem, misfit
from identification.search import Descent
from identification.space import SearchSpace, Space
from identification.time_domain import TimeProblem

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


#: Scatter of the fundamental between parts of a recording beyond which it is not steady.
STEADY = 0.05
DOMAINS = ("auto", "periodic", "time")


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


def steady(recordings: Sequence[Recording]) -> bool:
    """Whether all recordings are in a steady state, so that their harmonics say all that they hold."""
    periodic = all(recording.condition.frequency_hz is not None for recording in recordings)
    return periodic and _worst(recordings)[0] <= STEADY


class Route(Protocol):
    """What the fit needs of a domain: problems on either engine, weights, and initial states for a replay.

    Attributes:
        foot, recordings: what is fitted. twin: the compiled twin stands for this model. threads: 0 for all.
        chi_square: whether the cost is chi-square distributed where the model is true.
    """

    foot: Foot
    recordings: list[Recording]
    twin: bool
    threads: int
    chi_square: bool

    @property
    def space(self) -> SearchSpace:
        """What is searched."""

    def refined(self, z: np.ndarray) -> Self:
        """Itself, or a copy whose foot has so fine a step that the motion at z is right to 1e-4 of its peak."""

    def exploring(self) -> Self:
        """A copy that weighs by the noise alone, for starts that are far from any foot."""

    def weighed(self, z: np.ndarray) -> Self:
        """A copy that weighs what the recordings share beside the misfit at z, where exploring ended."""

    def explorer(self) -> Any:
        """A fresh problem on the fastest engine that fits the model."""

    def certifier(self, explored: Any) -> Any:
        """The same problem, with the same weights, on the MuJoCo rollout."""

    def reweigh(self, problem: Any, descent: Descent) -> None:
        """Bring the weights up to date at a descent's end."""

    def initial_states(self, problem: Any, descent: Descent, number: int) -> np.ndarray:
        """Initial states of one recording [m, m/s] at a certified descent's end."""


@dataclass
class PeriodicRoute:
    """Steady state, on harmonics of one period; `excess` of the misfit over the noise as `PeriodicProblem` takes it."""

    foot: Foot
    recordings: list[Recording]
    space: SearchSpace
    twin: bool
    threads: int = 0
    excess: float = 1.0
    chi_square = True

    def __post_init__(self) -> None:
        self.lines = [Line.of(recording) for recording in self.recordings]

    @property
    def _excitations(self) -> list[Excitation]:
        longest = min(LONGEST_STEP, self.foot.step)
        return [replace(line.excitation, longest_step=longest) for line in self.lines]

    def refined(self, z: np.ndarray) -> Self:
        """See `Route`."""
        steps = []
        for number, e in enumerate(self._excitations):
            values = self.space.values(self.space.at(number, z)[0])
            found = resolved(e, self.foot, values, self.twin)
            steps += [found.step] if found.step < e.step else []
        return _with_step(self, min(steps)) if steps else self

    def exploring(self) -> Self:
        """See `Route`."""
        return _copy(self, excess=np.inf)

    def weighed(self, z: np.ndarray) -> Self:
        """See `Route`."""
        r = self.exploring().explorer().residual(z)
        V = np.concatenate(_copy(self, excess=1.0).explorer().shared_errors())
        return _copy(self, excess=misfit(r, V, max(0, r.size - z.size)))

    def _engine(self, excitations: Sequence[Excitation], twin: bool) -> Engine:
        return Twin(excitations) if twin else Rollouts(self.foot, excitations, self.space.names, self.threads)

    def explorer(self) -> PeriodicProblem:
        """See `Route`."""
        engine = self._engine(self._excitations, self.twin)
        return PeriodicProblem(self.lines, engine, self.space, excess=self.excess)

    def certifier(self, explored: PeriodicProblem) -> PeriodicProblem:
        """See `Route`."""
        if not self.twin:
            explored.tolerance = 1e-7
            return explored
        engine = CertifiedOrbits(self.foot, self._excitations)
        problem = PeriodicProblem(self.lines, engine, self.space, tolerance=1e-7)
        problem.weigh_as(explored)
        return problem

    def reweigh(self, problem: PeriodicProblem, descent: Descent) -> None:
        """See `Route`."""
        problem.reweigh(descent.z, lambda excitations: self._engine(excitations, self.twin))

    def initial_states(self, problem: PeriodicProblem, descent: Descent, number: int) -> np.ndarray:
        """See `Route` [m, m/s]."""
        problem.residual(descent.z)
        assert isinstance(problem.engine, Rollouts | CertifiedOrbits)
        return problem.engine.start(number)


def _copy(route: Any, **changes: Any) -> Any:
    """A copy of a route, what it has read included, with other attributes."""
    made = copy.copy(route)
    vars(made).update(changes)
    return made


def _with_step(route: Any, step: float) -> Any:
    """A copy of a route whose foot is simulated with another step [s]."""
    return _copy(route, foot=route.foot.with_values({}, step=step))


@dataclass
class TimeRoute:
    """Every sample of whole recordings."""

    foot: Foot
    recordings: list[Recording]
    space: Space
    twin: bool
    threads: int = 0
    chi_square = False

    def refined(self, z: np.ndarray) -> Self:
        """See `Route`."""
        if self.foot.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
            return self
        problem = self.explorer()
        values = self.space.values(self.space.to_theta(z[: self.space.lower.size]))
        step = min(grid(recording, self.foot)[0] for recording in self.recordings)

        def output(times: int) -> np.ndarray | None:
            engine = _with_step(self, step / 2**times)._engine(())
            runs = [engine.run(i, values, (), problem.states(z, i))[0] for i in range(len(self.recordings))]
            return np.concatenate(runs) if all(np.isfinite(y).all() for y in runs) else None

        times = halvings(output)
        return _with_step(self, step / 2**times) if times else self

    def exploring(self) -> Self:
        """See `Route`: what recordings share is in the covariance alone."""
        return self

    def weighed(self, z: np.ndarray) -> Self:
        """See `Route`."""
        return self

    def explorer(self) -> TimeProblem:
        """See `Route`."""
        return TimeProblem(self.recordings, self._engine(self.space.names), self.space)

    def _engine(self, names: Sequence[str]) -> TimeEngine:
        if self.twin:
            return TimeTwin(self.foot, self.recordings)
        return TimeRollouts(self.foot, self.recordings, names, self.threads)

    def certifier(self, explored: TimeProblem) -> TimeProblem:
        """See `Route`."""
        if not self.twin:
            return explored
        return TimeProblem(self.recordings, CertifiedRuns(self.foot, self.recordings), self.space)

    def reweigh(self, problem: TimeProblem, descent: Descent) -> None:
        """The weights come from the noise floor alone."""

    def initial_states(self, problem: TimeProblem, descent: Descent, number: int) -> np.ndarray:
        """See `Route` [m, m/s]."""
        return problem.states(descent.z, number)
