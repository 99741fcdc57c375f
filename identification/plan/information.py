"""What a recording adds, to the last digit of the model: exact sensitivities of steady motion at many possible feet.

Of each foot and each recording three things are kept: the information A = J^T J on the constants and on everything
else that may be true, with J the whitened derivatives of all harmonics; and for the mirror foot, that would explain the
same motion, A, b = J^T r and c = r^T r, with r what it misses. Information of independent recordings adds up, so any
protocol is scored from these by sums, whatever its order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.recording.harmonics import Harmonics
from identification.engines.engine import Excitation
from identification.engines.twin import Twin
from identification.periodic import Line, PeriodicProblem, split
from identification.plan.candidates import Step
from identification.plan.prior import Person, PlanSpace, stub
from identification.plan.shaker import Shaker
from identification.world import Nuisance, WorldProblem

#: Noise below this share of an amplitude is not believed, as in a fit.
_FLOOR = 1e-7


@dataclass(frozen=True, eq=False)
class Seen:
    """A foot beside its mirror image, as all steps see them.

    Attributes:
        q, image: search variables (n,). A: information (C, n, n) of each of C steps. B: at the mirror image (C, n, n).
        b: (C, n) and c: (C,) of what the image misses. gain: transmissibility (C,) of each fundamental.
    """

    q: np.ndarray
    image: np.ndarray
    A: np.ndarray
    B: np.ndarray
    b: np.ndarray
    c: np.ndarray
    gain: np.ndarray


class Sight:
    """Steps as the compiled twin sees them.

    Args:
        person: on the shaker. steps: to be seen. shaker: its noise and rate. allowed: what else may be true.
        rng: of the order: a gain that drifts does so with the time, which a plan does not know yet.
    """

    def __init__(
        self,
        person: Person,
        steps: Sequence[Step],
        shaker: Shaker,
        allowed: tuple[Nuisance, ...],
        rng: np.random.Generator,
        middle_hz: float,
    ) -> None:
        self.steps, self._shaker = list(steps), shaker
        order = rng.permutation(len(self.steps))
        self._place = np.argsort(order)
        shuffled = [self.steps[i] for i in order]
        lines = [_line(person, step, shaker) for step in shuffled]
        self.space: PlanSpace = person.space(allowed, [line.recording for line in lines], middle_hz)
        weighed = any(each.group == "masses" for each in allowed)
        drives: list[Excitation] = [
            replace(line.excitation, masses={}) if weighed else line.excitation for line in lines
        ]
        sensors = tuple(dict.fromkeys(name for step in self.steps for name in step.sensors))
        engine = Twin(person.foot, drives, sensors)
        plain = PeriodicProblem(lines, engine, self.space)
        self._problem = WorldProblem(lines, engine, self.space, plain)
        self._lines = lines

    def see(self, q: np.ndarray) -> Seen | None:
        """What each step tells of a foot at q (n,); None where it, or its mirror image, has no steady motion."""
        image = self.space.image(q)
        self._problem.start(q)
        try:
            true = self._problem.responses(q)
            self._problem.start(image)
            other = self._problem.responses(image)
        except SimulationError:
            return None
        n = q.size
        A, B, b = np.empty((len(true), n, n)), np.empty((len(true), n, n)), np.empty((len(true), n))
        c, gain = np.empty(len(true)), np.empty(len(true))
        for i, (line, (Y, J), (Z, K)) in enumerate(zip(self._lines, true, other, strict=True)):
            w = 1 / self._std(line, Y)
            J, K, r = w[:, None] * split(J), w[:, None] * split(K), w * split(Z - Y)
            A[i], B[i], b[i], c[i] = J.T @ J, K.T @ K, K.T @ r, r @ r
            gain[i] = abs(Y[0] / line.base.amplitudes[0])
        if not (np.isfinite(A).all() and np.isfinite(B).all() and np.isfinite(c).all()):
            return None
        at = self._place
        return Seen(q, image, A[at], B[at], b[at], c[at], gain[at])

    def _std(self, line: Line, Y: np.ndarray) -> np.ndarray:
        """Noise (2 k H,) of real and imaginary parts: the output's own, and the input's through the foot."""
        U, H = line.base.amplitudes, line.count
        found = []
        for place in range(Y.size // H):
            y = Y[place * H : (place + 1) * H]
            gain = abs(y[0] / U[0])
            found.append(np.full(H, np.hypot(max(line.base.std[0], _FLOOR * abs(y[0])), gain * line.base.std[0])))
        return np.tile(np.concatenate(found), 2)


def _line(person: Person, step: Step, shaker: Shaker) -> Line:
    """A step as the fit sees a recording: harmonics with the noise that it will have."""
    count = step.count(shaker.rate_hz)
    U = step.base(count)
    std = np.full(count, shaker.noise_m_s2 * np.sqrt(2 / (step.seconds * shaker.rate_hz)))
    harmonics = Harmonics(step.frequency_hz, U, std, 0.0, shaker.noise_m_s2, 0.0, 0.0)
    others = dict.fromkeys(step.sensors[1:], harmonics)
    return Line(stub(person, step, shaker.rate_hz), harmonics, harmonics, others)
