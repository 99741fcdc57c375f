"""Periodic motion by harmonic balance: Newton's method finds the coefficients of a Fourier series.

The forces of a system are computed at instants of one period and projected on the harmonics of its
motion, where what is left must vanish. What is linear may be given harmonic by harmonic, as a
dynamic stiffness. The coefficients of a signal are its mean, its cosines and its sines,

    x(t) = a_0 + sum_k a_k cos(k w t) + b_k sin(k w t)
         = a_0 + Re sum_k X_k exp(i k w t),    X_k = a_k - i b_k

`periodic` finds the motion of one system with as many harmonics as it needs; `newton` the motions
of many systems at once, with a fixed number of them.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from scipy.linalg import expm

from fasbody.exceptions import NotSmoothError, PeriodicMotionError

Array = np.ndarray
#: Harmonics to begin with, and at most: 256 instants a period.
HARMONICS, MOST_HARMONICS = 6, 48
#: Largest share of the acceleration in either of the two highest harmonics; symmetry may lack one.
SMALL = 1e-6
#: Jacobians of one solution, and steps with each.
PASSES, CHORDS = 12, 40
#: Contraction from which on a new Jacobian is computed in place of a further step.
SLOW = 0.5
#: Size of a step over the motion that ends the search. Below the second one a step that is not
#: shortened is rounding, if the Jacobian is new, was new no farther off, or has shortened steps to the third.
TIGHT, ROUNDING, PROVEN = 1e-12, 1e-6, 1e-3
#: Coordinates of rest are steps from zero as large as this at least, by the system's metric [sqrt(kg) m].
STILL = 1e-3
#: Least share of a Newton step, and least part of the amplitude by which a motion is continued.
SHORTEST, FINEST = 2.0**-8, 2.0**-7
#: Change of the Floquet multipliers that refining may leave, and how often intervals are halved.
MULTIPLIER, HALVINGS = 1e-8, 4


@dataclass(frozen=True)
class Fourier:
    """Fourier series with a number of harmonics, and its values at instants of one period.

        series = Fourier.of(6)
        position, rate, acceleration = series.at(x)
        series.project(force)

    Attributes:
        harmonics: H.
        samples: instants N of a period, more than 2 H.
    """

    harmonics: int
    samples: int

    @classmethod
    def of(cls, harmonics: int) -> "Fourier":
        """With more than four instants a harmonic, so that cubic forces are projected exactly."""
        return _fourier(harmonics)

    @property
    def size(self) -> int:
        """Coefficients 2 H + 1 of one signal."""
        return 2 * self.harmonics + 1

    @cached_property
    def order(self) -> Array:
        """Harmonic (2 H + 1,) that each coefficient belongs to."""
        k = np.arange(1, self.harmonics + 1)
        return np.concatenate([[0], k, k])

    @cached_property
    def basis(self) -> Array:
        """Values and two derivatives over w and w^2 of unit coefficients, (3, N, 2 H + 1)."""
        k, N = np.arange(1, self.harmonics + 1), self.samples
        angle = 2 * np.pi / N * np.outer(np.arange(N), k)
        cos, sin, one = np.cos(angle), np.sin(angle), np.ones((N, 1))
        values, rates = np.hstack([one, cos, sin]), np.hstack([0 * one, -k * sin, k * cos])
        return np.stack([values, rates, -(self.order**2) * values])

    @cached_property
    def projection(self) -> Array:
        """Coefficients (2 H + 1, N) of unit values."""
        return self.basis[0].T * np.where(self.order, 2.0, 1.0)[:, None] / self.samples

    def at(self, x: Array) -> Array:
        """Values and derivatives over w and w^2, (3, ..., N), of coefficients x (..., 2 H + 1)."""
        return np.stack([x @ b.T for b in self.basis])

    def project(self, values: Array) -> Array:
        """Coefficients (..., 2 H + 1) of values (..., N)."""
        return values @ self.projection.T

    def tangent(self, slopes: Array) -> Array:
        """Derivative (..., 2 H + 1, 2 H + 1) of a projected force to coefficients of a motion.

        Args:
            slopes: (3, ..., N) of the force in the motion, and in its derivatives over w and w^2.
        """
        Q, (K, C, M), (E, V, A) = self.projection, slopes[..., None, :], self.basis
        matrix: Array = (Q * K) @ E + (Q * C) @ V + (Q * M) @ A
        return matrix

    def dynamic(self, stiffness: Array) -> Array:
        """Matrix (..., 2 H + 1, 2 H + 1) of a complex stiffness (..., H + 1)."""
        H = self.harmonics
        c, s, Z = np.arange(1, H + 1), np.arange(H + 1, 2 * H + 1), stiffness[..., 1:]
        matrix = np.zeros((*stiffness.shape[:-1], self.size, self.size))
        matrix[..., 0, 0] = stiffness[..., 0].real
        matrix[..., c, c] = matrix[..., s, s] = Z.real
        matrix[..., c, s], matrix[..., s, c] = Z.imag, -Z.imag
        return matrix

    def complex(self, x: Array) -> Array:
        """Complex amplitudes (..., H) of coefficients (..., 2 H + 1)."""
        H = self.harmonics
        return x[..., 1 : H + 1] - 1j * x[..., H + 1 :]

    def real(self, amplitudes: Array, mean: Array | float = 0.0) -> Array:
        """Coefficients (..., 2 H + 1) of complex amplitudes (..., h); those above h are zero."""
        h, H = amplitudes.shape[-1], self.harmonics
        x = np.zeros((*amplitudes.shape[:-1], self.size))
        x[..., 0] = mean
        x[..., 1 : h + 1], x[..., H + 1 : H + h + 1] = amplitudes.real, -amplitudes.imag
        return x


@lru_cache(maxsize=16)
def _fourier(harmonics: int) -> Fourier:
    return Fourier(harmonics, 1 << (4 * harmonics + 3).bit_length())


class Equations(Protocol):
    """Systems that are solved together; `rows` (b,) selects some of them."""

    def residual(self, x: Array, rows: Array) -> Array:
        """What must vanish (b, m) at unknowns x (b, m)."""

    def jacobian(self, x: Array, rows: Array) -> Array:
        """Its derivative (b, m, m)."""

    def size(self, x: Array) -> Array:
        """Norm (b,) of unknowns or of steps x (b, m)."""


def newton(
    equations: Equations, x: Array, inverse: Array | None = None, tight: float = TIGHT,
    longest: float = np.inf, least: float = 0.0,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Solve many systems by damped Newton's method, a Jacobian serving as long as steps contract.

    A step is judged by the next one that the same Jacobian would take, so that stiff and soft
    directions, newtons and metres count alike (Deuflhard 2004, section 3.3).

    Args:
        equations: the systems.
        x: (b, m) unknowns to begin at.
        inverse: (b, m, m) of Jacobians of solutions nearby, with which the first steps are taken.
        tight: size of a step over that of the unknowns which ends the search.
        longest: size of a first step over that of the unknowns. Where many motions exist, a search
            with shorter ones stays near its start.
        least: size of the unknowns of which steps are a share, where they are smaller themselves.

    Returns:
        Unknowns (b, m), the inverse of the last Jacobian (b, m, m), and which are solved (b,).
    """
    search, rows = _Search(equations, np.array(x, float), tight, longest, least), np.arange(len(x))
    with np.errstate(all="ignore"):  # steps that are too long give non-finite residuals and are shortened
        if inverse is not None:
            search.inverse[:] = inverse
            rows = search.chords(rows, fresh=False)
        for _ in range(PASSES):
            if not rows.size:
                break
            search.linearise(rows)
            rows = search.chords(rows, fresh=True)
    return search.x, search.inverse, search.solved


class _Search:
    """Where Newton's method is with each of many systems."""

    def __init__(self, equations: Equations, x: Array, tight: float, longest: float, least: float) -> None:
        self.equations, self.x, self.tight, self.longest, self.least = equations, x, tight, longest, least
        count, m = x.shape
        self.inverse, self.solved = np.empty((count, m, m)), np.zeros(count, bool)

    def linearise(self, rows: Array) -> None:
        """A new Jacobian."""
        self.inverse[rows] = _inverse(self.equations.jacobian(self.x[rows], rows))

    def chords(self, rows: Array, fresh: bool) -> Array:
        """Steps with the same Jacobian; returns the rows that need a new one."""
        step, going = np.zeros_like(self.x), rows
        step[rows] = self._correction(self.x[rows], rows)
        first = self.equations.size(step)
        reach = self.longest * self.equations.size(self.x) / first
        damping = np.maximum(SHORTEST, np.fmin(1, reach))  # without a limit from rest it is no number
        new = fresh
        for _ in range(CHORDS):
            trial = self.x[going] + damping[going, None] * step[going]
            following = self._correction(trial, going)
            before, after, motion = map(self.equations.size, (step[going], following, trial))
            motion = np.maximum(motion, self.least)
            contraction = after / np.maximum(before, np.finfo(float).tiny)
            better = contraction < 1 - damping[going] / 4
            rounded = (contraction > SLOW) & (before < ROUNDING * motion)
            near = new & (first[going] < ROUNDING * motion)
            proven = fresh | near | (before < PROVEN * first[going])
            self.solved[going] = (after <= self.tight * motion) | (rounded & proven)
            self.x[going[better]], step[going[better]] = trial[better], following[better]
            damping[going] = np.where(better, np.minimum(1, 2 * damping[going]), damping[going] / 2)
            again = np.where(better, contraction < SLOW, damping[going] >= SHORTEST)
            going, fresh = going[again & ~self.solved[going]], False
            if not going.size:
                break
        return rows[~self.solved[rows] & (damping[rows] >= SHORTEST)]

    def _correction(self, x: Array, rows: Array) -> Array:
        residual = self.equations.residual(x, rows)
        step: Array = -(self.inverse[rows] @ residual[..., None])[..., 0]
        return step


def _inverse(matrices: Array) -> Array:
    """Inverse of each (b, m, m); NaN where one is singular."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(matrices, np.nan)
        return np.concatenate([_inverse(matrix[None]) for matrix in matrices])


class System(Protocol):
    """One system under a periodic excitation."""

    @property
    def name(self) -> str:
        """For messages."""

    @property
    def frequency_hz(self) -> float:
        """Of the excitation."""

    @property
    def metric(self) -> Array:
        """By which accelerations are measured (n, n), such as a mass matrix."""

    @property
    def rest(self) -> Array:
        """Coordinates (n,) of rest, without the excitation."""

    def residual(self, series: Fourier, x: Array, share: float) -> Array:
        """What must vanish (n, 2 H + 1) at coefficients x under a share of the excitation."""

    def jacobian(self, series: Fourier, x: Array, share: float) -> Array:
        """Its derivative (n (2 H + 1), n (2 H + 1))."""

    def changes(self, series: Fourier, x: Array) -> int:
        """Times a period that a constraint opens, closes or slips; zero where there are none."""


@dataclass(frozen=True)
class _Single:
    """One system as `newton` takes it."""

    system: System
    series: Fourier
    share: float

    def residual(self, x: Array, _: Array) -> Array:
        return self.system.residual(self.series, self._signals(x), self.share).reshape(1, -1)

    def jacobian(self, x: Array, _: Array) -> Array:
        return self.system.jacobian(self.series, self._signals(x), self.share)[None]

    def size(self, x: Array) -> Array:
        return np.array([np.sqrt(power(self.system, self.series, self._signals(x)).sum())])

    def _signals(self, x: Array) -> Array:
        return x.reshape(-1, self.series.size)


def power(system: System, series: Fourier, x: Array) -> Array:
    """Square of the acceleration over w^2 in each harmonic (H + 1,), first that of the mean."""
    squares = np.einsum("il,ij,jl->l", x, system.metric, x) * np.maximum(1, series.order) ** 4
    return np.bincount(series.order, squares)


def highest(system: System, series: Fourier, x: Array) -> float:
    """Share of the acceleration that is in the two highest harmonics, the larger of both."""
    squares = power(system, series, x)[1:]
    return float(np.sqrt(squares[-2:].max() / max(squares.sum(), np.finfo(float).tiny)))


@dataclass(frozen=True, eq=False)
class Solution:
    """A periodic motion.

    Attributes:
        series: its harmonics.
        x: coefficients (n, 2 H + 1).
        inverse: (m, m) of a Jacobian nearby, None if there is none.
    """

    series: Fourier
    x: Array
    inverse: Array | None = None


def periodic(system: System, start: Solution | None = None, least: int = HARMONICS) -> Solution:
    """The periodic motion of a system.

    Harmonics are doubled until either of the two highest has less than `SMALL` of the acceleration.
    Where Newton's method does not converge from `start`, or from rest, the amplitude of the excitation
    is raised step by step.

    Args:
        system: what moves.
        start: a motion nearby.
        least: number of harmonics, at least.

    Raises:
        PeriodicMotionError: there is none, or none that grows out of rest.
        NotSmoothError: its harmonics do not fall, or a constraint opens, closes or slips.
    """
    solution = start or _rest(system, Fourier.of(HARMONICS))
    while True:
        while solution.series.harmonics < least:
            solution = _doubled(solution)
        reached, solved = _solved(system, solution, 1.0)
        solution = reached if solved else _continued(system, solution.series)
        H, left = solution.series.harmonics, highest(system, solution.series, solution.x)
        changes = system.changes(solution.series, solution.x)
        if changes or (left >= SMALL and H >= MOST_HARMONICS):
            raise NotSmoothError(system.name, system.frequency_hz, H, left, changes)
        if left < SMALL:
            return solution
        least = 2 * H


def _rest(system: System, series: Fourier) -> Solution:
    return Solution(series, series.real(np.zeros((len(system.metric), 0)), system.rest))


def rest(system: System, x: Array) -> tuple[Array, bool]:
    """Coordinates (n,) at which a system stays without excitation, and whether there are any.

    Args:
        system: what rests.
        x: (n,) from where Newton's method begins.
    """
    solution, solved = _solved(system, Solution(Fourier(0, 1), x[:, None]), 0.0, STILL)
    return solution.x[:, 0], solved


def _doubled(solution: Solution) -> Solution:
    series = Fourier.of(2 * solution.series.harmonics)
    return Solution(series, series.real(solution.series.complex(solution.x), solution.x[:, 0]))


def _solved(system: System, start: Solution, share: float, least: float = 0.0) -> tuple[Solution, bool]:
    """Where Newton's method ends under a share of the excitation, and whether that is a motion."""
    near = None if start.inverse is None else start.inverse[None]
    x, inverse, solved = newton(_Single(system, start.series, share), start.x.reshape(1, -1), near, least=least)
    return Solution(start.series, x.reshape(start.x.shape), inverse[0]), bool(solved[0])


def _continued(system: System, series: Fourier) -> Solution:
    """The motion that grows out of rest with the excitation.

    Raises:
        PeriodicMotionError: it ends before.
        NotSmoothError: a constraint acts where it ends.
    """
    solution, reached, part = _rest(system, series), 0.0, 0.5
    while reached < 1:
        share = min(1.0, reached + part)
        still = _rest(system, series).x
        grown = Solution(series, still + (solution.x - still) * (share / reached if reached else 1.0))
        following, solved = _solved(system, grown, share)
        if solved:
            solution, reached, part = following, share, 2 * part
        elif part >= FINEST:
            part /= 2
        else:
            raise _ended(system, following, reached)
    return solution


def _ended(system: System, tried: Solution, share: float) -> PeriodicMotionError:
    """What ends a motion beyond a share of the excitation, at the coefficients tried last."""
    f, H = system.frequency_hz, tried.series.harmonics
    if changes := system.changes(tried.series, tried.x):
        left = highest(system, tried.series, tried.x)
        return NotSmoothError(system.name, f, H, left, changes)
    return PeriodicMotionError(system.name, f, share)


def multipliers(slopes: Array, period: float, first_order: int = 0) -> Array:
    """Floquet multipliers of a motion: by how much small departures from it grow over one period.

    An interval between two instants is passed with the matrix exponential of its middle, which is
    exact where nothing varies, however stiff, and of second order elsewhere. Intervals are halved
    and the passage extrapolated until the multipliers no longer change.

    Args:
        slopes: (3, N, n, n) of the residual in coordinates, rates and accelerations at N instants.
        period: [s].
        first_order: how many of the coordinates, the last ones, have no inertia.
    """
    A = _halved(_state_matrix(slopes, first_order))
    coarse, eigenvalues = _passed(A, period), np.empty(0)
    for _ in range(HALVINGS):
        A = _halved(A)
        fine = _passed(A, period)
        before, eigenvalues = eigenvalues, _sorted(np.linalg.eigvals((4 * fine - coarse) / 3))
        if before.size and np.abs(eigenvalues - before).max() < MULTIPLIER:
            break
        coarse = fine
    return eigenvalues


def _state_matrix(slopes: Array, first_order: int) -> Array:
    """Matrices (N, s, s) of the states' rates: coordinates, rates of those with inertia."""
    K, C, M = slopes
    n = M.shape[-1] - first_order
    # what multiplies accelerations, and the rates of what has none
    highest = np.concatenate([M[..., :n], C[..., n:]], axis=-1)
    rates = -np.linalg.solve(highest, np.concatenate([K, C[..., :n]], axis=-1))
    states = K.shape[-1] + n
    A = np.zeros((len(K), states, states))
    A[:, :n, n + first_order :] = np.eye(n)
    A[:, n : n + first_order], A[:, n + first_order :] = rates[:, n:], rates[:, :n]
    return A


def _passed(A: Array, period: float) -> Array:
    """States after one period (s, s) of unit states; odd instants are the middles of intervals."""
    after = np.eye(A.shape[-1])
    for step in expm(A[1::2] * (2 * period / len(A))):
        after = step @ after
    return after


def _halved(A: Array) -> Array:
    """The same periodic matrices at twice as many instants."""
    spectrum = np.fft.rfft(A, axis=0)
    spectrum[-1] /= 2  # half of the highest one is of the negative frequency
    return np.fft.irfft(spectrum, 2 * len(A), axis=0) * 2


def _sorted(values: Array) -> Array:
    """Largest first; of a pair the one with the positive imaginary part."""
    return values[np.lexsort((-values.imag, -values.real, -np.round(np.abs(values), 9)))]
