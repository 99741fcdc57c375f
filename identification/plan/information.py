"""What recordings would add: derivatives of the fit's problem at all candidates, for many feet that could be.

Of each foot and each recording these are kept: the harmonics that sensors read, their derivatives to the constants and
to everything else that may be true, and the same of its rival, the foot of the other branch that explains the motion
best. A recording's information is J^T W J, with W from its noise, which falls with its length, and from how well a
person repeats, which does not. Information of independent recordings adds up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fasbody.foot.two_mass import Orbits, orbits
from fasbody.recording.harmonics import Harmonics
from identification.engines.twin import FOOT, carriers
from identification.harmonics import Line, Measured
from identification.motion import Near, TwoMassMotion
from identification.nuisances import Nuisance
from identification.optimiser import descend
from identification.plan.candidates import Step
from identification.plan.prior import Person, stub
from identification.plan.shaker import Shaker
from identification.residual import Evaluation, Problem

#: Motions that are sought at once: more of them leave the processor's cache.
_AT_ONCE = 600
#: Steps of the descent to a rival, and what is as good as on a bound.
_DESCENT, _AT_BOUND = 12, 1e-9


@dataclass(frozen=True, eq=False)
class Seen:
    """D feet of n variables beside their rivals, as C steps see them by M real numbers each.

    Attributes:
        q: (D, n) the feet.
        rival: (D, n) of the other branch.
        held: (D, n) variables of the rival that rest on a bound.
        J: (D, C, M, n) derivatives of what sensors read of the feet.
        K: (D, C, M, n) of the rivals.
        missed: (D, C, M) what sensors read of the rivals, less what they read of the feet [m/s^2].
        noise: (D, C, M) variance of a reading.
        spread: (D, C, M) variance from one recording to the next.
        scatter: (D, 2) noise of a sample [m/s^2] and repeatability that these come from.
    """

    q: np.ndarray
    rival: np.ndarray
    held: np.ndarray
    J: np.ndarray
    K: np.ndarray
    missed: np.ndarray
    noise: np.ndarray
    spread: np.ndarray
    scatter: np.ndarray

    def rows(self, which: np.ndarray | slice) -> "Seen":
        """Some of the feet."""
        return Seen(*(getattr(self, item.name)[which] for item in fields(self)))

    def joined(self, other: "Seen") -> "Seen":
        """Both together."""
        pairs = ((getattr(self, item.name), getattr(other, item.name)) for item in fields(self))
        return Seen(*map(np.concatenate, pairs))


class Sight:
    """Steps as one problem of the fit, whose residual is what sensors read.

    Args:
        person: on the shaker.
        steps: to be seen.
        shaker: its rate.
        allowed: what else may be true.
        rng: of the order: a gain that drifts does so with the time, which a plan does not know yet.
        middle_hz: of the band.
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
        order = rng.permutation(len(steps))
        self._place, self._rate_hz = np.argsort(order), shaker.rate_hz
        lines = [_line(person, steps[i], shaker.rate_hz) for i in order]
        sensors = tuple(dict.fromkeys(name for step in steps for name in step.sensors))
        measured = Measured.of(lines, sensors)
        self.variables = person.variables(allowed, [line.recording for line in lines], middle_hz)
        on_foot = [carriers(person.foot)[name] == FOOT for name in sensors]
        motion = _Exact(measured, self.variables.omega, on_foot)
        self.problem = Problem.of(measured, self.variables, motion)
        self._seconds = np.array([steps[i].seconds for i in order])

    def see(
        self, Q: np.ndarray, rival: np.ndarray, held: np.ndarray, scatter: np.ndarray
    ) -> Seen:
        """What each step reads of feet and rivals (D, n), of those that both move steadily.

        Args:
            Q: feet.
            rival: of each foot.
            held: (D, n) variables of the rival that rest on a bound.
            scatter: (D, 2) noise of a sample [m/s^2], and repeatability, of each foot.
        """
        (Y, J, moves), (Z, K, also) = self._read(Q), self._read(rival)
        J, K, missed = (self._by_step(x) for x in (J, K, Z - Y))
        noise, spread = self._variances(Y, scatter)
        noise, spread = self._by_step(noise, np.inf), self._by_step(spread)
        return Seen(Q, rival, held, J, K, missed, noise, spread, scatter).rows(moves & also)

    def rivals(self, Q: np.ndarray, scatter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The likeliest feet (D, n) of the other branch if all steps are made of feet Q, and what is at bounds.

        One step from the mirror image is not enough where much else may be true: then it may go far,
        and miss little.
        """
        Y, _, _ = self._read(Q)
        weights = 1 / np.sqrt(np.add(*self._variances(Y, scatter)))
        same = {item.name: getattr(self.problem, item.name) for item in fields(Problem)}
        problem = _Rivals(**same, motions=Y, weights=weights)
        signs = np.where(Q[:, self.variables.index["k_F"]] > 0, -1, 1)
        rival = descend(problem, self.variables.image(Q), signs, _DESCENT).Q
        low, high = (np.stack(x) for x in zip(*map(problem.bounds, signs), strict=True))
        return rival, np.minimum(rival - low, high - rival) < _AT_BOUND

    def _read(self, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All harmonics (D, N) of feet Q (D, n), their derivatives (D, N, n), and which feet move (D,)."""
        count = max(1, _AT_ONCE // len(self.problem.measured.lines))
        parts = [self.problem.evaluate(Q[i : i + count]) for i in range(0, len(Q), count)]
        N = self.problem.size
        r, J = (np.concatenate([getattr(p, x)[:, :N] for p in parts]) for x in ("residual", "jacobian"))
        return r, J, np.concatenate([p.moves for p in parts])

    def _by_step(self, x: np.ndarray, rest: float = 0.0) -> np.ndarray:
        """(D, C, M, ...) of all harmonics (D, N, ...), and the rest where a step has fewer."""
        rows = self.problem.measured.rows
        full = np.full((len(x), *rows.shape, *x.shape[2:]), rest)
        full[:, rows] = x
        return full[:, self._place]

    def _variances(self, Y: np.ndarray, scatter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of all harmonics Y (D, N): noise of the sensor and of the base through the foot, and scatter."""
        measured, D = self.problem.measured, len(Y)
        R, S, H = measured.output.shape
        full = np.zeros((D, *measured.rows.shape))
        full[:, measured.rows] = Y
        size = np.hypot(*np.moveaxis(full.reshape(D, R, 2, S, H), 2, 0))  # (D, R, S, H)
        gain = size[..., :1] / np.abs(measured.base[:, None, :1])
        noise_m_s2, repeatability = scatter.T[:, :, None, None, None]
        share = np.sqrt(2 / (self._seconds * self._rate_hz))[:, None, None]
        noise = np.broadcast_to((noise_m_s2 * share) ** 2 * (1 + gain**2), size.shape)
        variances = noise, (repeatability * size) ** 2
        noise, spread = (np.tile(x.reshape(D, R, -1), 2)[:, measured.rows] for x in variances)
        return noise, spread


class _Exact(TwoMassMotion):
    """Motions of many feet, each as exact as of one: what no recording tells must not seem to be told by rounding."""

    def orbits(self, theta: np.ndarray, near: Near | None = None, slopes: bool = True) -> Orbits:
        """See `TwoMassMotion`."""
        C, R, P = theta.shape
        start = None if near is None else near.at(theta).reshape(C * R, 2, -1)
        omega, base = np.tile(self.omega, C), np.tile(self.base, (C, 1))
        return orbits(
            theta.reshape(C * R, P), omega, base, start, slopes=slopes, tolerance=1e-10
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Paired:
    """Motions of candidates to start from, and the number (C,) of the foot that each is a rival of."""

    number: np.ndarray
    memory: object

    def rows(self, which: np.ndarray) -> "_Paired":
        return _Paired(self.number[which], self.memory.rows(which))  # type: ignore[attr-defined]

    def replaced(self, other: "_Paired", where: np.ndarray) -> "_Paired":
        return _Paired(self.number, self.memory.replaced(other.memory, where))  # type: ignore[attr-defined]


@dataclass(frozen=True, eq=False)
class _Rivals(Problem):
    """What rivals miss of motions of feet, one for each foot, so that all descend together."""

    motions: np.ndarray  # (D, N) of the feet
    weights: np.ndarray  # (D, N) one over their standard deviations

    def evaluate(self, Q: np.ndarray, near: Evaluation | None = None) -> Evaluation:
        """See `Problem`; without motions to start from there is one candidate for each foot."""
        number = np.arange(len(Q)) if near is None else near.memory.number
        now = super().evaluate(Q, near and replace(near, memory=near.memory.memory))
        N, w = self.size, self.weights[number]
        r, J = now.residual.copy(), now.jacobian.copy()
        r[:, :N] = w * (r[:, :N] - self.motions[number])
        J[:, :N] *= w[..., None]
        return Evaluation(r, J, now.moves, _Paired(number, now.memory))


def _line(person: Person, step: Step, rate_hz: float) -> Line:
    """A step as the fit sees a recording, of which nothing is measured: residuals are then what sensors read."""
    count, f = step.count(rate_hz), step.frequency_hz
    base = Harmonics(f, step.base(count), np.zeros(count), 0.0, 0.0, 0.0, 0.0)
    nothing = Harmonics(f, np.zeros(count, complex), np.ones(count), 0.0, 0.0, 0.0, 0.0)
    return Line(stub(person, step, rate_hz), base, nothing, dict.fromkeys(step.sensors[1:], nothing))
