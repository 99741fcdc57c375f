"""The two ways to compare model and recordings, with the two engines each: steady state and time domain."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from fasbody.exceptions import SettingError
from fasbody.model import Foot
from fasbody.recording import Recording
from identification.orbits import LONGEST_STEP, Engine, Excitation, Rollouts, Twin
from identification.periodic import Line, PeriodicProblem
from identification.search import Descent
from identification.space import Space
from identification.time_domain import TimeProblem, TimeRollouts, TimeTwin

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
    lines = [Line.of(recording) for recording in recordings]
    unsteady = [(line, max(line.base.scatter, line.malleolus.scatter)) for line in lines]
    worst, scatter = max(unsteady, key=lambda item: item[1])
    if scatter > STEADY:
        text = (
            f"{worst.recording.file} is not steady: its amplitude scatters by {100 * scatter:.0f} % (drift or beating)"
        )
        if wanted == "periodic":
            return "periodic", [f"{text}; the weights follow the scatter."]
        return "time", [f"{text}, so all recordings are fitted in the time domain."]
    return "periodic", []


class Route(Protocol):
    """What the fit needs of a domain: problems on either engine, weights, and initial states for a replay.

    Attributes:
        foot, recordings, space: what is fitted. twin: the compiled twin stands for this model.
        chi_square: whether the cost is chi-square distributed where the model is true.
    """

    foot: Foot
    recordings: list[Recording]
    space: Space
    twin: bool
    chi_square: bool

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
    """Steady state, on harmonics of one period."""

    foot: Foot
    recordings: list[Recording]
    space: Space
    twin: bool
    threads: int = 0
    chi_square = True

    def __post_init__(self) -> None:
        self.lines = [Line.of(recording) for recording in self.recordings]

    def _engine(self, excitations: Sequence[Excitation], twin: bool) -> Engine:
        longest = min(LONGEST_STEP, self.foot.step)
        excitations = [replace(e, longest_step=longest) for e in excitations]
        return Twin(excitations) if twin else Rollouts(self.foot, excitations, self.space.names, self.threads)

    def explorer(self) -> PeriodicProblem:
        """See `Route` [m, m/s]."""
        engine = self._engine([line.excitation for line in self.lines], self.twin)
        return PeriodicProblem(self.lines, engine, self.space)

    def certifier(self, explored: PeriodicProblem) -> PeriodicProblem:
        """See `Route` [m, m/s]."""
        if not self.twin:
            explored.tolerance = 1e-7
            return explored
        engine = self._engine([line.excitation for line in self.lines], twin=False)
        problem = PeriodicProblem(self.lines, engine, self.space, tolerance=1e-7)
        problem.weigh_as(explored)
        return problem

    def reweigh(self, problem: PeriodicProblem, descent: Descent) -> None:
        """See `Route` [m, m/s]."""
        problem.reweigh(descent.z, lambda excitations: self._engine(excitations, self.twin))

    def initial_states(self, problem: PeriodicProblem, descent: Descent, number: int) -> np.ndarray:
        """See `Route` [m, m/s]."""
        problem.residual(descent.z)
        assert isinstance(problem.engine, Rollouts)
        return problem.engine.start(number)


@dataclass
class TimeRoute:
    """Every sample of whole recordings."""

    foot: Foot
    recordings: list[Recording]
    space: Space
    twin: bool
    threads: int = 0
    chi_square = False

    def explorer(self) -> TimeProblem:
        """See `Route` [m, m/s]."""
        engine = TimeTwin(self.foot, self.recordings) if self.twin else self._rollouts()
        return TimeProblem(self.recordings, engine, self.space)

    def _rollouts(self) -> TimeRollouts:
        return TimeRollouts(self.foot, self.recordings, self.space.names, self.threads)

    def certifier(self, explored: TimeProblem) -> TimeProblem:
        """See `Route` [m, m/s]."""
        return TimeProblem(self.recordings, self._rollouts(), self.space) if self.twin else explored

    def reweigh(self, problem: TimeProblem, descent: Descent) -> None:
        """The weights come from the noise floor alone."""

    def initial_states(self, problem: TimeProblem, descent: Descent, number: int) -> np.ndarray:
        """See `Route` [m, m/s]."""
        return problem.states(descent.z, number)
