"""What a recording adds, to the last digit of the model: exact sensitivities of steady motion at many possible feet.

Of each foot and each recording three things are kept: the information A = J^T J on the constants and on everything
else that may be true, with J the whitened derivatives of all harmonics; and for the mirror foot, that would explain the
same motion, A, b = J^T r and c = r^T r, with r what it misses. Information of independent recordings adds up, so any
protocol is scored from these by sums, whatever its order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.recording.harmonics import Harmonics
from identification.engines.engine import Excitation
from identification.engines.twin import Twin
from identification.periodic import Line, PeriodicProblem
from identification.plan.candidates import Step
from identification.plan.prior import Person, PlanSpace, stub
from identification.plan.shaker import Shaker
from identification.settle import settle
from identification.world import Nuisance, WorldProblem

#: Noise below this share of an amplitude is not believed, as in a fit.
_FLOOR = 1e-7
#: The descent to a rival: evaluations, what a last step may promise, and what is as good as on a bound.
_DESCENT, _LEFT, _AT_BOUND = 12, 0.3, 1e-9
#: Harmonics and rounds of the balance from which steady motions are sought, and its harmonics at instants of a period.
_BALANCED, _ROUNDS = 6, 2
_TURNS = np.exp(2j * np.pi * np.outer(np.arange(1, _BALANCED + 1), np.arange(4 * _BALANCED) / (4 * _BALANCED)))
_BACK = 2 * _TURNS.conj().T / _TURNS.shape[1]


@dataclass(frozen=True, eq=False)
class Seen:
    """A foot beside its mirror image, as all steps see them.

    Attributes:
        q, image: search variables (n,). A: information (C, n, n) of each of C steps. B: at the mirror image (C, n, n).
        b: (C, n) and c: (C,) of what the image misses. gain: transmissibility (C,) of each fundamental.
        held: variables (n,) of the image that rest on a bound.
    """

    q: np.ndarray
    image: np.ndarray
    held: np.ndarray
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
        self._problem = _Looked(lines, engine, self.space, plain)
        sizes, each = [line.size for line in lines], [line.count for line in lines for _ in line.sensors]
        self._first, self._first_of_sensor = (np.cumsum([0, *x[:-1]]) for x in (sizes, each))
        self._count_of_sensor = np.array(each)
        drive = [abs(line.base.amplitudes[0]) for line in lines]
        self._drive, self._drive_of_sensor = np.array(drive), np.repeat(drive, [len(line.sensors) for line in lines])
        self._noise = np.repeat([line.base.std[0] for line in lines], [len(line.sensors) for line in lines])

    def see(self, q: np.ndarray, rival: tuple[np.ndarray, np.ndarray] | None = None) -> Seen | None:
        """What each step tells of a foot at q (n,); None where it, or its mirror image, has no steady motion.

        Args:
            q: of the foot. rival: in place of the mirror image, with what it holds; see `rival`.
        """
        image, held = rival or (self.space.image(q), np.zeros(q.size, bool))
        try:
            (Y, J), (Z, K) = self._moved(q), self._moved(image)
        except SimulationError:
            return None
        w = 1 / self._std(Y)
        J, K, r = w[:, None] * J, w[:, None] * K, w * (Z - Y)
        A, B, b, c = (self._summed(x) for x in (_grams(J), _grams(K), np.real(K.conj() * r[:, None]), abs(r) ** 2))
        if not (np.isfinite(A).all() and np.isfinite(B).all() and np.isfinite(c).all()):
            return None
        gain = abs(Y[self._first] / self._drive)
        at = self._place
        return Seen(q, image, held, A[at], B[at], b[at], c[at], gain[at])

    def rival(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """The likeliest foot (n,) of the other branch if all steps are made of q (n,), and what it holds at a bound.

        One step from the mirror image is not enough where much else may be true: then it may go far, and miss little.
        None where there is no steady motion.
        """
        low, high = self.space.side(-1 if q[self.space.index["k_F"]] > 0 else 1)
        try:
            motion = self._moved(q)[0]
            rival = _Rival(self, motion, 1 / self._std(motion))
            found = settle(rival, self.space.image(q), low, high, _DESCENT, _LEFT).q
        except SimulationError:
            return None
        return found, np.minimum(found - low, high - found) < _AT_BOUND

    def _moved(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Harmonics (N,) of all steps, one behind the other, and their derivatives (N, n)."""
        self._problem.start(q)
        return self._problem.together(q)

    def _summed(self, x: np.ndarray) -> np.ndarray:
        """Sums (C, ...) over the harmonics (N, ...) of each step."""
        return np.asarray(np.add.reduceat(x, self._first, axis=0))

    def _std(self, Y: np.ndarray) -> np.ndarray:
        """Noise (N,) of real and imaginary parts: the output's own, and the input's through the foot."""
        y = abs(Y[self._first_of_sensor])
        std = np.hypot(np.maximum(self._noise, _FLOOR * y), y / self._drive_of_sensor * self._noise)
        return np.repeat(std, self._count_of_sensor)


class _Rival:
    """What a foot misses of another one's motion, with the rows of the prior, for a descent (`settle`).

    Args:
        sight: of the steps. motion: harmonics (N,) of the other one. w: one over its noise (N,).
    """

    def __init__(self, sight: Sight, motion: np.ndarray, w: np.ndarray) -> None:
        self._sight, self._motion, self._w = sight, motion, w
        self._kept: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def residual(self, q: np.ndarray) -> np.ndarray:
        """At q (n,)."""
        return self._both(q)[0]

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """At q (n,)."""
        return self._both(q)[1]

    def _both(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._kept is None or not np.array_equal(self._kept[0], q):
            (Z, K), (mean, std) = self._sight._moved(q), self._sight.space.prior
            r, K = self._w * (Z - self._motion), self._w[:, None] * K
            residual = np.concatenate([r.real, r.imag, (q - mean) / std])
            self._kept = q.copy(), residual, np.concatenate([K.real, K.imag, np.diag(1 / std)])
        return self._kept[1:]


def _grams(J: np.ndarray) -> np.ndarray:
    """Information (N, n, n) of each harmonic, from its whitened derivatives (N, n): real and imaginary part."""
    parts = np.stack([J.real, J.imag], axis=1)
    return parts.transpose(0, 2, 1) @ parts


class _Looked(WorldProblem):
    """The fit's problem, started from motions in harmonic balance: many feet are looked at, each of them once."""

    def start(self, q: np.ndarray) -> np.ndarray:
        """See `WorldProblem`."""
        super().start(q)
        if self._orbits is not None:
            theta = self.world.all_of(q)[0]
            self._orbits.near(self._balanced(theta), theta)
        return q

    def together(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All responses behind each other: harmonics (N,), and their derivatives (N, n)."""
        each = [self._sensed(name, q, *moved) for name, moved in self._motions(q).items()]
        Y, J = (np.concatenate(parts)[self._in_turn] for parts in zip(*each, strict=True))
        return Y, J

    @cached_property
    def _in_turn(self) -> np.ndarray:
        """Places (N,) of recordings with their sensors behind each other, where sensors are with their recordings."""
        whose = [(i, k) for k, numbers in enumerate(self._having.values()) for i in numbers]
        counts = [self.lines[i].count for i, _ in whose]
        return np.lexsort(np.repeat(whose, counts, axis=0).T[::-1])

    @cached_property
    def _bases(self) -> tuple[np.ndarray, np.ndarray]:
        """Of each base, for _BALANCED harmonics: i times the angular frequency [rad/s] (R, H), and its size (R, H)."""
        h, U = np.arange(1, _BALANCED + 1), np.zeros((len(self.lines), _BALANCED), complex)
        for own, line in zip(U, self.lines, strict=True):
            own[: min(_BALANCED, line.count)] = line.base.amplitudes[:_BALANCED]
        return 2j * np.pi * np.array([[line.base.frequency_hz] for line in self.lines]) * h, U

    def _balanced(self, theta: np.ndarray) -> np.ndarray:
        """States (R, 4) at time zero of the steady motion, by harmonic balance from the linear foot's."""
        s, U = self._bases
        k_T, k_F, c_11, c_12, c_13, c_21, c_22, c_23, m_S, m_F = theta.T[..., None]
        ankle, pad = k_T + c_11 * s, k_F + c_21 * s
        own, other, of_own, of_other = s**2 + ankle * (1 / m_F + 1 / m_S), s**2 + pad / m_F, pad / m_F, ankle / m_F
        below = own * other - of_own * of_other  # Eq. (4.30)
        z_1, z_2 = -of_own * U / below, -own * U / below
        for _ in range(_ROUNDS):
            # what the dampers' bends add to the forces, Eq. (4.32)
            x_1, x_2, v_1, v_2 = (np.real(z @ _TURNS) for z in (z_1, z_2, s * z_1, s * z_2))
            more_1 = c_11 * (np.exp(-c_12 * x_1) * np.cos(c_13 * x_1) - 1) * v_1 @ _BACK
            more_2 = c_21 * (np.exp(-c_22 * x_2) * np.cos(c_23 * x_2) - 1) * v_2 @ _BACK
            b_1, b_2 = (more_2 - more_1) / m_F - more_1 / m_S, (more_1 - more_2) / m_F - U
            z_1, z_2 = (other * b_1 + of_own * b_2) / below, (of_other * b_1 + own * b_2) / below
        return np.stack([z.real.sum(1) for z in (z_1, z_2, s * z_1, s * z_2)], axis=1)


def _line(person: Person, step: Step, shaker: Shaker) -> Line:
    """A step as the fit sees a recording: harmonics with the noise that it will have."""
    count = step.count(shaker.rate_hz)
    U = step.base(count)
    std = np.full(count, shaker.noise_m_s2 * np.sqrt(2 / (step.seconds * shaker.rate_hz)))
    harmonics = Harmonics(step.frequency_hz, U, std, 0.0, shaker.noise_m_s2, 0.0, 0.0)
    others = dict.fromkeys(step.sensors[1:], harmonics)
    return Line(stub(person, step, shaker.rate_hz), harmonics, harmonics, others)
