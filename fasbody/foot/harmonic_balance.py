"""Periodic motion by harmonic balance: a Fourier series, of which Newton's method finds the coefficients.

The forces of a system are computed at instants of one period and projected on the harmonics of its motion, where what
is left must vanish. What is linear may be given harmonic by harmonic, as a dynamic stiffness. Coefficients of a signal
are its mean, its cosines and its sines,

    x(t) = a_0 + sum_k a_k cos(k w t) + b_k sin(k w t) = a_0 + Re sum_k X_k exp(i k w t),    X_k = a_k - i b_k

`periodic` finds the motion of one system with as many harmonics as it needs; `newton` that of many systems at once, at
a fixed number of them.
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
#: Largest share of the acceleration in the two highest harmonics, either of which may vanish by symmetry.
SMALL = 1e-6
#: Jacobians of one solution, and steps with each.
PASSES, CHORDS = 12, 12
#: Contraction from which on a step with an old Jacobian is worth less than a new one.
SLOW = 0.25
#: Size of a step over the motion that ends the search, and below which one that is not shortened is rounding, if the
#: Jacobian is new or has shortened others by `PROVEN`.
TIGHT, ROUNDING, PROVEN = 1e-12, 1e-6, 1e-3
#: Least share of a Newton step, and least part of the amplitude by which a motion is continued.
SHORTEST, FINEST = 2.0**-8, 2.0**-7
#: Change of the Floquet multipliers that refining may leave, and how often the period is refined.
MULTIPLIER, REFINED = 1e-8, 4


@dataclass(frozen=True)
class Fourier:
    """Fourier series with a number of harmonics, and its values at instants of one period.

        series = Fourier(6)
        series.at(x), series.project(forces)

    Attributes:
        harmonics: H. samples: instants N of a period, more than 2 H.
    """

    harmonics: int
    samples: int

    @classmethod
    def of(cls, harmonics: int) -> "Fourier":
        """With at least four instants a harmonic, so that cubic forces are projected exactly."""
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
        """Values, and first and second derivatives over w and w^2, (3, N, 2 H + 1), of unit coefficients."""
        angle = np.outer(2 * np.pi * np.arange(self.samples) / self.samples, np.arange(1, self.harmonics + 1))
        c, s, k = np.cos(angle), np.sin(angle), np.arange(1, self.harmonics + 1)
        one = np.ones((self.samples, 1))
        return np.stack(
            [np.hstack([one, c, s]), np.hstack([0 * one, -k * s, k * c]), np.hstack([0 * one, -k * k * c, -k * k * s])]
        )

    @cached_property
    def projection(self) -> Array:
        """Coefficients (2 H + 1, N) of unit values."""
        return self.basis[0].T * np.where(self.order, 2.0, 1.0)[:, None] / self.samples

    def at(self, x: Array) -> Array:
        """Values and derivatives (3, ..., N), over w and w^2, of coefficients x (..., 2 H + 1)."""
        return np.stack([x @ b.T for b in self.basis])

    def project(self, values: Array) -> Array:
        """Coefficients (..., 2 H + 1) of values (..., N)."""
        return values @ self.projection.T

    def tangent(self, slopes: Array) -> Array:
        """Derivative (..., 2 H + 1, 2 H + 1) of a projected force to the coefficients of what it depends on.

        Args:
            slopes: (3, ..., N) of the force in the value, and in the derivatives over w and w^2.
        """
        return sum((self.projection * slope[..., None, :]) @ b for slope, b in zip(slopes, self.basis, strict=True))

    def dynamic(self, stiffness: Array) -> Array:
        """Matrix (..., 2 H + 1, 2 H + 1) by which a complex stiffness (..., H + 1) takes motion to force."""
        H = self.harmonics
        k, Z = np.arange(1, H + 1), stiffness[..., 1:]
        matrix = np.zeros((*stiffness.shape[:-1], self.size, self.size))
        matrix[..., 0, 0] = stiffness[..., 0].real
        matrix[..., k, k] = matrix[..., H + k, H + k] = Z.real
        matrix[..., k, H + k], matrix[..., H + k, k] = Z.imag, -Z.imag
        return matrix

    def complex(self, x: Array) -> Array:
        """Complex amplitudes (..., H) of coefficients (..., 2 H + 1)."""
        H = self.harmonics
        return x[..., 1 : H + 1] - 1j * x[..., H + 1 :]

    def real(self, amplitudes: Array, mean: Array | float = 0.0) -> Array:
        """Coefficients (..., 2 H + 1) of the first complex amplitudes (..., h) of a signal; the others are zero."""
        h, H = min(amplitudes.shape[-1], self.harmonics), self.harmonics
        x = np.zeros((*amplitudes.shape[:-1], self.size))
        x[..., 0] = mean
        x[..., 1 : h + 1], x[..., H + 1 : H + h + 1] = amplitudes[..., :h].real, -amplitudes[..., :h].imag
        return x


@lru_cache(maxsize=16)
def _fourier(harmonics: int) -> Fourier:
    return Fourier(harmonics, 1 << (4 * harmonics + 3).bit_length())


class Equations(Protocol):
    """Systems that are solved together; rows (b,) says which of them are meant."""

    def residual(self, x: Array, rows: Array) -> Array:
        """What must vanish (b, m) at unknowns x (b, m)."""

    def jacobian(self, x: Array, rows: Array) -> Array:
        """Its derivative (b, m, m)."""

    def size(self, x: Array) -> Array:
        """Norm (b,) of unknowns or of a step."""


def newton(equations: Equations, x: Array, inverse: Array | None = None) -> tuple[Array, Array, Array]:
    """Solve many systems by damped Newton's method, with the same Jacobian as long as its steps contract.

    Steps are judged by the next one that the same Jacobian would take, so that stiff and soft directions, newtons and
    metres count alike (Deuflhard 2004, section 3.3).

    Args:
        equations: the systems. x: (b, m) unknowns to begin at.
        inverse: (b, m, m) of the Jacobian of a solution nearby, with which the first steps are taken.

    Returns:
        Unknowns (b, m), the inverse of the last Jacobian (b, m, m), and which are solved (b,).
    """
    x, (count, m) = np.array(x, float), x.shape
    step, damping = np.empty_like(x), np.ones(count)
    solved, going = np.zeros(count, bool), np.arange(count)
    fresh = inverse is None
    inverse = np.empty((count, m, m)) if inverse is None else np.array(inverse)

    def correction(rows: Array, at: Array) -> Array:
        return -(inverse[rows] @ equations.residual(at, rows)[..., None])[..., 0]

    with np.errstate(all="ignore"):  # a step that leads too far is not finite, and is shortened
        for _ in range(PASSES):
            if fresh:
                inverse[going] = _inverse(equations.jacobian(x[going], going))
            step[going] = correction(going, x[going])
            first, chord = equations.size(step), going
            for _ in range(CHORDS):
                trial = x[chord] + damping[chord, None] * step[chord]
                after = correction(chord, trial)
                before, left = equations.size(step[chord]), equations.size(after)
                contraction = left / np.maximum(before, np.finfo(float).tiny)
                better = contraction < 1 - damping[chord] / 4
                motion = equations.size(trial)
                exact = fresh | (before < PROVEN * first[chord])
                rounded = exact & (before < ROUNDING * motion) & (contraction > SLOW)
                solved[chord], fresh = (left <= TIGHT * motion) | rounded, False
                x[chord[better]], step[chord[better]] = trial[better], after[better]
                damping[chord] = np.where(better, np.minimum(1, 2 * damping[chord]), damping[chord] / 2)
                again = ~solved[chord] & np.where(better, contraction < SLOW, damping[chord] >= SHORTEST)
                chord = chord[again]
                if not chord.size:
                    break
            going, fresh = going[~solved[going] & (damping[going] >= SHORTEST)], True
            damping[going] = 1
            if not going.size:
                break
    return x, inverse, solved


def _inverse(matrices: Array) -> Array:
    """Of each (b, m, m); NaN where one is singular or not finite, and so leads nowhere."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        return np.stack([np.linalg.pinv(m) if np.isfinite(m).all() else np.full_like(m, np.nan) for m in matrices])


class System(Protocol):
    """One system under a periodic excitation.

    Attributes:
        name: for messages. frequency_hz: of the excitation. metric: (n, n) by which accelerations are measured, such
            as a mass matrix.
    """

    name: str
    frequency_hz: float
    metric: Array

    def residual(self, series: Fourier, x: Array, share: float) -> Array:
        """What must vanish (n, 2 H + 1) at coefficients x (n, 2 H + 1) under a share of the excitation."""

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
    """Square of the acceleration over w^2 in each harmonic (H + 1,), the mean's displacement first."""
    each = np.einsum("il,ij,jl->l", x, system.metric, x) * np.maximum(1, series.order) ** 4
    return np.bincount(series.order, each)


def highest(system: System, series: Fourier, x: Array) -> float:
    """Share of the acceleration that is in the two highest harmonics."""
    each = power(system, series, x)[1:]
    return float(np.sqrt(each[-2:].max() / max(each.sum(), np.finfo(float).tiny)))


@dataclass(frozen=True, eq=False)
class Solution:
    """A balanced motion.

    Attributes:
        series: its harmonics. x: coefficients (n, 2 H + 1). inverse: of a Jacobian nearby.
    """

    series: Fourier
    x: Array
    inverse: Array


def periodic(system: System, start: Solution | None = None) -> Solution:
    """The periodic motion of a system.

    Harmonics are doubled until each of the two highest has less than `SMALL` of the acceleration. Where Newton's method
    does not lead there from `start`, or from rest, the amplitude of the excitation is raised step by step.

    Args:
        system: what moves. start: a motion nearby.

    Raises:
        PeriodicMotionError: there is none, or none that grows out of rest. NotSmoothError: its harmonics do not fall.
    """
    n = len(system.metric)
    first = Fourier.of(HARMONICS)
    found = start or Solution(first, np.zeros((n, first.size)), np.empty(0))
    inverse = start.inverse[None] if start else None
    while True:
        reached, solved = _solved(system, found, 1.0, inverse)
        found = reached if solved else _continued(system, found.series)
        left, changes = highest(system, found.series, found.x), system.changes(found.series, found.x)
        if changes or (left >= SMALL and found.series.harmonics >= MOST_HARMONICS):
            raise NotSmoothError(system.name, system.frequency_hz, found.series.harmonics, left, changes)
        if left < SMALL:
            return found
        found, inverse = _doubled(found), None


def _solved(system: System, start: Solution, share: float, inverse: Array | None = None) -> tuple[Solution, bool]:
    """The motion under a share of the excitation, and whether it is one: where Newton's method ended."""
    equations = _Single(system, start.series, share)
    x, inverse, solved = newton(equations, start.x.reshape(1, -1), inverse)
    return Solution(start.series, x.reshape(start.x.shape), inverse[0]), bool(solved[0])


def _doubled(found: Solution) -> Solution:
    series = Fourier.of(2 * found.series.harmonics)
    return Solution(series, series.real(found.series.complex(found.x), found.x[:, 0]), np.empty(0))


def _continued(system: System, series: Fourier) -> Solution:
    """The motion that grows out of rest with the excitation.

    Raises:
        PeriodicMotionError: it ends before. NotSmoothError: a constraint acts there.
    """
    found, reached, part = Solution(series, np.zeros((len(system.metric), series.size)), np.empty(0)), 0.0, 0.5
    while reached < 1:
        share = min(1.0, reached + part)
        grown = found.x * (share / reached if reached else 1.0)
        following, solved = _solved(system, Solution(series, grown, found.inverse), share)
        if solved:
            found, reached, part = following, share, 2 * part
            continue
        part /= 2
        if part < FINEST:
            changes = system.changes(series, following.x)
            if changes:
                left = highest(system, series, following.x)
                raise NotSmoothError(system.name, system.frequency_hz, series.harmonics, left, changes)
            raise PeriodicMotionError(system.name, system.frequency_hz, reached)
    return found


def multipliers(slopes: Array, period: float, first_order: int = 0) -> Array:
    """Floquet multipliers of a motion: by how much small departures from it grow over one period.

    Each interval between two instants is passed with the matrix exponential of its middle, which is exact where nothing
    varies, however stiff, and of second order elsewhere; intervals are halved and extrapolated until nothing changes.

    Args:
        slopes: (3, N, n, n) of the residual in coordinates, their rates and accelerations at instants of the period.
        period: [s]. first_order: how many of the coordinates, the last ones, have no inertia.
    """
    A = _halved(_state_matrix(slopes, first_order))
    coarse, found = _passed(A, period), np.empty(0)
    for _ in range(REFINED):
        A = _halved(A)
        fine = _passed(A, period)
        before, found = found, _sorted(np.linalg.eigvals((4 * fine - coarse) / 3))
        if before.size and np.abs(found - before).max() < MULTIPLIER:
            break
        coarse = fine
    return found


def _state_matrix(slopes: Array, first_order: int) -> Array:
    """Matrices (N, s, s) of the states' rates: coordinates, rates of those with inertia."""
    K, C, M = slopes
    n = M.shape[-1] - first_order
    top = np.concatenate([M[..., :n], C[..., n:]], axis=-1)  # what multiplies accelerations, and rates of the others
    rates = -np.linalg.solve(top, np.concatenate([K, C[..., :n]], axis=-1))
    count, states = len(K), K.shape[-1] + n
    A = np.zeros((count, states, states))
    A[:, :n, n + first_order :] = np.eye(n)
    A[:, n : n + first_order], A[:, n + first_order :] = rates[:, n:], rates[:, :n]
    return A


def _passed(A: Array, period: float) -> Array:
    """State after one period (s, s) of unit states; every other of the matrices is in the middle of an interval."""
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
