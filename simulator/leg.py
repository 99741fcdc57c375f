"""A leg on a shaker, moved in time: a simulator that shares neither code nor method with the fits.

Coordinates are the stretches of ankle and pad [m] from static equilibrium. Two masses on linear
springs and bent dampers move as in section 4.3; what else they do is a `Departure`: a small class
that changes constants, adds forces, has states, or alters what a sensor feels. The equations of
motion are assembled from them, and all recordings of a leg are integrated at once by the classical
Runge-Kutta method.

A motion begins in the steady state of its small motion, and nothing is written down until the
slowest free vibration of that has fallen to `FORGOTTEN` of its size. Of four legs in each world of
worlds.py that left at most 4e-4 of the amplitude, and the step 8e-4 where friction and contact have
corners, 2e-5 elsewhere; cubic springs near their fold left 3e-3, a lifting heel 2e-2.
tests/test_simulator.py compares with closed forms and with DOP853.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

#: Step [s]: its error falls 16 times when it is halved.
STEP_S = 5e-4
#: What is left of a free vibration when recording begins.
FORGOTTEN = 1e-4
#: Changes of states, and of rates of stretch [m/s], from which small motion is computed: a usual
#: rate, as the slope of friction at rest tells nothing of motion.
_SMALL, _USUAL = 1e-6, 0.1
#: Steps a period, at least, where harmonics are wanted, and how many harmonics these give.
STEPS, HARMONICS = 64, 31
#: Sensors in the order of the rows of what is felt.
SENSORS = ("malleolus", "foot")


@dataclass(frozen=True)
class Leg:
    """What a leg is without load: springs, dampers c1 exp(-c2 z) cos(c3 z), masses.

    Attributes:
        k_T: spring of the ankle [N/m].
        k_F: spring of the pad [N/m].
        c_11: damper of the ankle at rest [N s/m].
        c_12: its bend [1/m].
        c_13: its wave number [1/m].
        c_21: damper of the pad at rest [N s/m].
        c_22: its bend [1/m].
        c_23: its wave number [1/m].
        m_S: mass of the shank [kg].
        m_F: mass of the foot [kg].
    """

    k_T: float
    k_F: float
    c_11: float
    c_12: float
    c_13: float
    c_21: float
    c_22: float
    c_23: float
    m_S: float
    m_F: float

    @property
    def a(self) -> float:
        """The share of the shank in the mass, m_S / (m_S + m_F)."""
        return self.m_S / (self.m_S + self.m_F)

    @property
    def stiff_ankle(self) -> bool:
        """Whether k_T is larger than where leg and mirror image are the same."""
        return self.k_T > self.a * self.k_F

    def stretches(self, s: complex) -> np.ndarray:
        """(2,) of ankle and pad over the base's acceleration [s^2], at s = i omega, if linear."""
        K_T, K_F = self.k_T + s * self.c_11, self.k_F + s * self.c_21
        M_S, M_F = self.m_S * s**2, self.m_F * s**2
        D = (M_S + K_T) * (M_F + K_F) + M_S * K_T
        return np.array([-self.m_S * K_F, -self.m_F * (M_S + K_T) - self.m_S * K_T]) / D


@dataclass(frozen=True)
class Shaking:
    """What a leg is exposed to, recording by recording in the order of the session.

    Attributes:
        load_kg: (n,) on the knee [kg].
        hz: (n,) fundamental frequency [Hz].
        base: (n, H) harmonics of the base's acceleration from the first [m/s^2].
        seed: of what differs from recording to recording.
    """

    load_kg: np.ndarray
    hz: np.ndarray
    base: np.ndarray
    seed: tuple[int, ...] = (0,)

    @cached_property
    def s(self) -> np.ndarray:
        """(n, H) i omega of the base's harmonics [rad/s]."""
        return 2j * np.pi * np.outer(self.hz, np.arange(1, self.base.shape[1] + 1))

    def at(self, t: np.ndarray) -> np.ndarray:
        """Acceleration of the base (N, n) at times t (N, n) or (N, 1) [m/s^2]."""
        turn = np.exp(2j * np.pi * self.hz * t)
        wave = np.zeros_like(turn)
        for amplitude in self.base.T[::-1]:  # Horner's scheme
            wave = (wave + amplitude) * turn
        return wave.real

    @property
    def place(self) -> np.ndarray:
        """(n,) in the session, from -0.5 to 0.5."""
        return np.arange(self.hz.size) / max(1, self.hz.size - 1) - 0.5


@dataclass(frozen=True)
class Constants:
    """A leg as it is in each recording; rows are ankle and pad, or shank and foot.

    Attributes:
        k: (2, n) springs [N/m].
        c1: (2, n) dampers at rest [N s/m].
        c2: (2, n) their bends [1/m].
        c3: (2, n) their wave numbers [1/m].
        m: (2, n) masses, with what they carry [kg].
    """

    k: np.ndarray
    c1: np.ndarray
    c2: np.ndarray
    c3: np.ndarray
    m: np.ndarray

    def scaled(self, springs: np.ndarray, dampers: np.ndarray) -> "Constants":
        """Springs and dampers times so much, (n,) or (2, n)."""
        return replace(self, k=springs * self.k, c1=dampers * self.c1)

    def carrying(self, kg: np.ndarray) -> "Constants":
        """The shank heavier by (n,) [kg]."""
        return replace(self, m=np.stack([self.m[0] + kg, self.m[1]]))


class Departure:
    """What two masses on springs and dampers do not do; each method is one way to depart.

    Attributes:
        rows: how many states it has.
        memory_s: how long it remembers beside them [s].
    """

    rows = 0
    memory_s = 0.0

    def constants(self, constants: Constants, shaking: Shaking) -> Constants:
        """The leg in each recording; the shank carries its load already."""
        return constants

    def act(self, now: "Instant", x: np.ndarray) -> None:
        """Add to forces and push; x (rows, n) are its states."""

    def rates(self, now: "Instant", x: np.ndarray, out: np.ndarray) -> None:
        """Write the rates of its states into out (rows, n), and alter what sensors feel."""


class Instant:
    """The equations of motion of a leg, and what its departures read and change at an instant.

    Attributes:
        constants: of the leg.
        shaking: what excites it.
        h: (n,) time step [s].
        number: half steps since the beginning.
        t: (n,) time, 0 where recording begins [s].
        a0: (n,) acceleration of the base [m/s^2].
        z: (2, n) stretches of ankle and pad [m].
        v: (2, n) their rates [m/s].
        c: (2, n) dampers at these stretches [N s/m].
        force: (2, n) of ankle and pad, positive where they pull [N].
        push: (n,) upward on the shank [N].
        bone: (2, n) accelerations of shank and foot [m/s^2].
        felt: (2, n) accelerations at the sensors of `SENSORS` [m/s^2].
    """

    number: int
    t: np.ndarray
    a0: np.ndarray
    z: np.ndarray
    v: np.ndarray
    c: np.ndarray
    force: np.ndarray
    push: np.ndarray
    bone: np.ndarray
    felt: np.ndarray

    def __init__(
        self, leg: Leg, departures: Sequence[Departure], shaking: Shaking, h: float | np.ndarray
    ) -> None:  # fmt: skip
        self.constants, self.shaking = under(leg, departures, shaking), shaking
        self.h = h = np.broadcast_to(h, shaking.hz.shape)
        ends = 4 + np.cumsum([0, *(d.rows for d in departures)])
        self._parts = [(d, slice(*ends[i : i + 2])) for i, d in enumerate(departures)]
        self.x = self.dx = np.zeros((2, ends[-1], h.size))

    def rates(self, x: np.ndarray, out: np.ndarray) -> None:
        """Write the rates of all states x (rows, n) into out; the base's acceleration is a0."""
        p, self.z, self.v = self.constants, x[:2], x[2:4]
        self.c = p.c1 * np.exp(-p.c2 * self.z) * np.cos(p.c3 * self.z)
        self.force, self.push = p.k * self.z + self.c * self.v, np.zeros(self.h.size)
        for departure, rows in self._parts:
            departure.act(self, x[rows])
        self.bone = np.empty_like(self.z)
        self.bone[0], self.bone[1] = self.push - self.force[0], self.force[0] - self.force[1]
        self.bone /= p.m
        out[:2], out[2], out[3] = self.v, self.bone[0] - self.bone[1], self.bone[1] - self.a0
        self.felt = self.bone
        for departure, rows in self._parts:
            departure.rates(self, x[rows], out[rows])

    def linearised(self) -> tuple[np.ndarray, np.ndarray]:
        """A (n, rows, rows) and b (n, rows) of small motion, dx/dt = A x + b a0."""
        rows, nothing = self.x.shape[1], np.zeros(self.h.size)
        change = np.full(rows + 1, _SMALL)
        change[2:4] = _USUAL
        self.number, self.t, self.a0 = 0, nothing, nothing
        A, rest = np.zeros((rows + 1, rows, self.h.size)), np.zeros((2, rows, self.h.size))
        self.rates(rest[0], rest[1])
        for i in range(rows):
            x = np.zeros_like(rest[0])
            x[i] = change[i]
            self.rates(x, A[i])
        self.a0 = nothing + change[rows]
        self.rates(rest[0], A[rows])
        A = np.moveaxis((A - rest[1]) / change[:, None, None], 2, 0)
        return A[:, :rows].swapaxes(1, 2), A[:, rows]

    def before(self, lag_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Stretches and rates (2, n) of so long ago, by Hermite's cubic, or of the beginning."""
        place = np.maximum(0.0, 0.5 * self.number - lag_s / self.h)
        at, n = place.astype(int), np.arange(self.h.size)
        f, g = (place - at)[:, None], (1 + at - place)[:, None]
        (x, dx), (y, dy) = ((self.x[i, :4, n], self.dx[i, :4, n]) for i in (at, at + 1))
        state = g**2 * (1 + 2 * f) * x + f**2 * (1 + 2 * g) * y
        state += f * g * self.h[:, None] * (g * dx - f * dy)
        return state.T[:2], state.T[2:]


def under(leg: Leg, departures: Sequence[Departure], shaking: Shaking) -> Constants:
    """The leg as it is in each recording."""
    rows = (("k_T", "k_F"), ("c_11", "c_21"), ("c_12", "c_22"), ("c_13", "c_23"), ("m_S", "m_F"))
    n = np.ones(shaking.hz.size)
    constants = Constants(*(np.outer([getattr(leg, name) for name in row], n) for row in rows))
    constants = constants.carrying(shaking.load_kg)
    for departure in departures:
        constants = departure.constants(constants, shaking)
    return constants


def motion(
    leg: Leg,
    departures: Sequence[Departure],
    shaking: Shaking,
    h: np.ndarray | float,
    steps: int,
    patience: float = 1.0,
) -> np.ndarray:
    """Accelerations (2, n, steps) that the sensors feel at times 0, h, 2 h, ... [m/s^2].

    Args:
        leg: without load.
        departures: what else it does.
        shaking: what excites it.
        h: time step [s], (n,) for one a recording.
        steps: how many are written down.
        patience: time before that, over what small motion takes to forget.

    Raises:
        ArithmeticError: no motion stayed finite.
    """
    now = Instant(leg, departures, shaking, h)
    A, b = now.linearised()
    forgetting = np.log(FORGOTTEN) / np.linalg.eigvals(A).real.max(axis=1)
    forgetting += sum(departure.memory_s for departure in departures)
    before = int(np.ceil(patience * (forgetting / now.h).max()))
    now.x, now.dx = np.zeros((2, before + steps, *now.x[0].shape))
    t = 0.5 * now.h * np.arange(-2 * before, 2 * steps)[:, None]
    now.x[0] = steady(A, b, shaking, t[0])
    felt = np.stack([now.felt for _ in runge_kutta(now, t)][before:], axis=2)
    if not np.isfinite(felt).all():
        raise ArithmeticError(f"no steady motion of {leg} with {departures}")
    return felt


def steady(A: np.ndarray, b: np.ndarray, shaking: Shaking, t: np.ndarray) -> np.ndarray:
    """States (rows, n) at times t (n,) of the steady motion of dx/dt = A x + b a0."""
    s = shaking.s[..., None]
    x = np.linalg.solve(s[..., None] * np.eye(len(A[0])) - A[:, None], b[:, None, :, None])[..., 0]
    return (x * shaking.base[..., None] * np.exp(s * t[:, None, None])).sum(axis=1).real.T


def runge_kutta(now: Instant, t: np.ndarray) -> Iterator[int]:
    """Fill now.x and now.dx from now.x[0] on, and yield before each step; t (half steps, n) [s]."""
    base, h, (k_2, k_3, k_4) = now.shaking.at(t), now.h, np.zeros((3, *now.x[0].shape))

    def rates(number: int, x: np.ndarray, out: np.ndarray) -> None:
        now.number, now.t, now.a0 = number, t[number], base[number]
        now.rates(x, out)

    for i, (x, k_1) in enumerate(zip(now.x, now.dx, strict=True)):
        rates(2 * i, x, k_1)
        yield i
        if i + 1 < len(now.x):
            rates(2 * i + 1, x + 0.5 * h * k_1, k_2)
            rates(2 * i + 1, x + 0.5 * h * k_2, k_3)
            rates(2 * i + 2, x + h * k_3, k_4)
            now.x[i + 1] = x + h / 6 * (k_1 + 2 * (k_2 + k_3) + k_4)


def harmonics(
    leg: Leg, departures: Sequence[Departure], shaking: Shaking, step_s: float = STEP_S
) -> np.ndarray:  # fmt: skip
    """Harmonics (2, n, `HARMONICS`) of what the sensors feel, from the first [m/s^2].

    A period has a whole number of steps, at least `STEPS` and of at most step_s [s].
    """
    period = np.maximum(STEPS, np.ceil(1 / (shaking.hz * step_s))).astype(int)
    h = 1 / (shaking.hz * period)
    traces = motion(leg, departures, shaking, h, period.max(), patience=1.5)
    pairs = zip(np.moveaxis(traces, 1, 0), period, strict=True)
    return np.stack([2 / m * np.fft.fft(y[:, :m])[:, 1 : HARMONICS + 1] for y, m in pairs], 1)


def sample(t: np.ndarray, hz: float, amplitudes: np.ndarray) -> np.ndarray:
    """A periodic signal (n,) at times t, of its harmonics (H,) from the first."""
    turn = np.outer(t, np.arange(1, amplitudes.size + 1))
    return np.exp(2j * np.pi * hz * turn).dot(amplitudes).real
