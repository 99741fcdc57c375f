"""A rational function of s through the points of a measured frequency response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, signal, stats

from fasbody.exceptions import SettingError

from .response import Response
from .validation import ALARM

if TYPE_CHECKING:
    from .frequency import Points


@dataclass(frozen=True, eq=False)
class Rational:
    """G(s) = N(s) / D(s), D(0) = 1, in s = j f / f_0.

    Attributes:
        num: coefficients of rising powers of s, shape (zeros + 1,).
        den: the same, first 1, shape (poles + 1,).
        scale_hz: f_0.
        spread: square root of the covariance of (num, den[1:]).
        chi_square: weighted sum of squares left.
        freedom: its degrees of freedom.
        distortion: that of the points.
    """

    num: np.ndarray
    den: np.ndarray
    scale_hz: float
    spread: np.ndarray
    chi_square: float
    freedom: int
    distortion: float = 0.0

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences for the user."""
        found = []
        if self.freedom > 0 and stats.chi2.sf(self.chi_square, self.freedom) < ALARM:
            found.append(
                f"the rational function does not fit the points (chi2 {self.chi_square:.3g} at {self.freedom} degrees "
                "of freedom): the plant is nonlinear or changed between recordings, or the order is too low"
            )
        if self.distortion:
            found.append(
                f"nonlinear distortion: the output has harmonics up to {100 * self.distortion:.2g} % that the input "
                "lacks, so the response depends on amplitude"
            )
        return tuple(found)

    def response(self, frequency_hz: ArrayLike) -> Response:
        """Response with first-order error propagation."""
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        G, gradient = _rational(np.concatenate([self.num, self.den[1:]]), len(self.num), 1j * frequency / self.scale_hz)
        return Response(frequency, G, np.stack([gradient.real, gradient.imag], axis=1) @ self.spread)

    def poles(self) -> np.ndarray:
        """Poles [rad/s], shape (n,)."""
        return np.roots(self.den[::-1]) * 2 * np.pi * self.scale_hz

    def to_transfer_function(self) -> Any:
        """Continuous-time `scipy.signal.TransferFunction`."""
        w0 = 2 * np.pi * self.scale_hz
        num, den = (p / w0 ** np.arange(len(p)) for p in (self.num, self.den))
        return signal.TransferFunction(num[::-1], den[::-1])

    def __str__(self) -> str:
        poles = self.poles()
        listed = ", ".join(f"{abs(p) / 2 / np.pi:.2f} Hz zeta {-p.real / abs(p):.3f}" for p in poles if p.imag >= 0)
        return f"{len(self.num) - 1}/{len(self.den) - 1} rational, chi2 {self.chi_square:.3g}/{self.freedom}: {listed}"


def _rational(theta: np.ndarray, count: int, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    num, den = theta[:count], np.concatenate([[1.0], theta[count:]])
    N, D = (np.polynomial.polynomial.polyval(s, p) for p in (num, den))
    G = N / D
    gradient = np.column_stack([
        *(s**k / D for k in range(count)), *(-G * s**k / D for k in range(1, len(den))),
    ])  # fmt: skip
    return G, gradient


def rational(data: Points, zeros: int = 2, poles: int = 4) -> Rational:
    """Rational function through the points: Sanathanan and Koerner's iteration, then weighted least squares.

    Defaults are the two-mass foot's: two zeros, four poles.

    Raises:
        SettingError: fewer real numbers than coefficients.
    """
    count = zeros + 1
    if 2 * len(data) < count + poles:
        raise SettingError(
            f"{len(data)} points hold {2 * len(data)} numbers, a {zeros}/{poles} rational function has "
            f"{count + poles}; record more frequencies or lower the orders."
        )
    scale = float(data.frequency_hz.max())
    s = 1j * data.frequency_hz / scale
    std = np.maximum(data.std, 1e-12 * np.abs(data.value))
    weight = 1.0 / std
    D = np.ones(len(s), dtype=complex)
    starts = []
    for _ in range(30):
        rows = np.column_stack([
            *(s**k for k in range(count)), *(-data.value * s**k for k in range(1, poles + 1)),
        ]) * (weight / D)[:, None]  # fmt: skip
        out = data.value * weight / D
        theta = np.linalg.lstsq(np.vstack([rows.real, rows.imag]), np.concatenate([out.real, out.imag]), rcond=None)[0]
        theta[count:] = _stable(theta[count:])
        D = np.polynomial.polynomial.polyval(s, np.concatenate([[1.0], theta[count:]]))
        starts.append(theta)

    def residuals(theta: np.ndarray) -> np.ndarray:
        error = (_rational(theta, count, s)[0] - data.value) * weight
        return np.concatenate([error.real, error.imag])

    def jacobian(theta: np.ndarray) -> np.ndarray:
        gradient = _rational(theta, count, s)[1] * weight[:, None]
        return np.vstack([gradient.real, gradient.imag])

    best = min(starts, key=lambda theta: float(np.sum(residuals(theta) ** 2)))
    result = optimize.least_squares(residuals, best, jacobian, x_scale="jac", method="lm", xtol=1e-14, ftol=1e-14)
    _, size, vt = np.linalg.svd(result.jac, full_matrices=False)
    spread = vt.T / np.maximum(size, 1e-12 * size[0])
    theta = result.x
    return Rational(
        theta[:count], np.concatenate([[1.0], theta[count:]]), scale, spread, float(2 * result.cost),
        2 * len(data) - count - poles, data.distortion,
    )  # fmt: skip


def _stable(tail: np.ndarray) -> np.ndarray:
    """Coefficients 1.. of a denominator with constant term 1, its roots mirrored into the left half plane."""
    roots = np.roots(np.concatenate([[1.0], tail])[::-1])
    if len(roots) < len(tail) or not np.any(roots.real > 0):
        return tail
    mirrored = np.poly(-np.abs(roots.real) + 1j * roots.imag).real[::-1]
    return mirrored[1:] / mirrored[0]
