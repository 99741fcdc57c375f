"""Frequency responses: of a model with its uncertainty, at measured points, and a rational function through these."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, signal, stats

from fasbody.constants import Z95
from fasbody.exceptions import RecordingError, SettingError
from fasbody.presentation import Tabled
from fasbody.transmissibility.local import local as local_response
from identification.blackbox import excitation
from identification.blackbox.data import Series, listed
from identification.blackbox.validation import ALARM

REACH = 8  # lines at either side of a frequency whose spectrum a local model describes


@dataclass(frozen=True, eq=False)
class Response:
    """A frequency response with its uncertainty.

    Attributes:
        frequency_hz: shape (M,).
        value: complex, shape (M,).
        spread: square root S of the covariance S S' of (real, imaginary), shape (M, 2, m).
    """

    frequency_hz: np.ndarray
    value: np.ndarray
    spread: np.ndarray

    def _along(self, direction: np.ndarray) -> np.ndarray:
        parts = np.stack([direction.real, direction.imag], axis=-1)
        return np.linalg.norm(np.einsum("mi,mij->mj", parts, self.spread), axis=1)

    @property
    def gain_std(self) -> np.ndarray:
        """Standard deviation of the gain, shape (M,)."""
        with np.errstate(invalid="ignore"):
            return self._along(self.value / np.maximum(np.abs(self.value), 1e-300))

    @property
    def phase_std_deg(self) -> np.ndarray:
        """Standard deviation of the phase in degrees, shape (M,)."""
        with np.errstate(invalid="ignore"):
            size = np.maximum(np.abs(self.value), 1e-300)
            return np.rad2deg(self._along(1j * self.value / size) / size)


@dataclass(frozen=True, eq=False)
class Points(Tabled):
    """Measured frequency response.

    Attributes:
        frequency_hz: rising, shape (M,).
        value: complex output over input, shape (M,).
        std: standard deviation of real and of imaginary part, shape (M,).
        distortion: largest harmonic of the output that the input's harmonics do not explain, over its fundamental,
            0 where none stands out of the noise.
    """

    frequency_hz: np.ndarray
    value: np.ndarray
    std: np.ndarray
    distortion: float = 0.0

    def __len__(self) -> int:
        return len(self.frequency_hz)

    def without(self, k: int) -> Self:
        """All points but number `k`."""
        keep = np.arange(len(self)) != k
        return replace(self, frequency_hz=self.frequency_hz[keep], value=self.value[keep], std=self.std[keep])


def points(recordings: Series | Sequence[Series]) -> Points:
    """Response at the lines of the inputs, by least-squares fits of all lines of a recording at once.

    A single sine gives its fundamental alone: the response at its harmonics is in part the plant's nonlinearity. Points
    of several recordings at one frequency are averaged with their weights.

    Raises:
        SettingError: an input has no separate lines.
    """
    pooled = listed(recordings)
    measured, distortion = [], 0.0
    for series in map(_steady, pooled):
        lines, extra = _lines(series)
        u, sigma_u, _ = excitation.sine_fit(series.u, series.sample_time, 1.0, [*lines, *extra])
        y, sigma_y, _ = excitation.sine_fit(series.y, series.sample_time, 1.0, [*lines, *extra])
        value = y[: len(lines)] / u[: len(lines)]
        std = np.sqrt(sigma_y**2 + np.abs(value) ** 2 * sigma_u**2) / np.abs(u[: len(lines)])
        measured += list(zip(lines, value, std, strict=True))
        more = np.abs(y[len(lines) :]) - 3.0 * np.abs(value).max() * np.abs(u[len(lines) :])  # 3: a resonance there
        certain = more[more > 5.0 * sigma_y]
        distortion = max(distortion, float(certain.max(initial=0.0) / np.abs(y[: len(lines)]).max()))
    return replace(_averaged(measured), distortion=distortion)


def _averaged(measured: list[tuple[float, complex, float]]) -> Points:
    """Frequency, response and deviation of each frequency, the mean where several agree in it."""
    groups: list[list[tuple[float, complex, float]]] = []
    for point in sorted(measured, key=lambda point: point[0]):
        if groups and abs(point[0] / groups[-1][0][0] - 1) < 1e-3:
            groups[-1].append(point)
        else:
            groups.append([point])
    means = []
    for group in groups:
        f, G, s = map(np.array, zip(*group, strict=True))
        weight = 1.0 / np.maximum(s, 1e-15) ** 2
        means.append((f.mean(), np.sum(weight * G) / weight.sum(), 1.0 / np.sqrt(weight.sum())))
    frequency, value, std = map(np.array, zip(*means, strict=True))
    return Points(frequency, value, std)


def with_interval(gain: float, std: float) -> str:
    """A gain with the half-width of its 95 % interval, where it has one."""
    return f"{gain:.4g}" + (f" +- {Z95 * std:.1g}" if np.isfinite(std) else "")


def local(
    recordings: Series | Sequence[Series], frequency_hz: np.ndarray, band_hz: tuple[float, float]
) -> Points | None:
    """Response without a model, by local models of the spectrum; None where windows are too short.

    Args:
        recordings: one or many, means removed; averaged with their weights.
        frequency_hz: of the response, shape (M,).
        band_hz: that the input excites.
    """
    measured = []
    for series in listed(recordings):
        resolution = REACH / (len(series) * series.sample_time)
        try:
            response = local_response(
                series.time, {"base": series.u, "out": series.y}, frequency_hz, band_hz, resolution
            )
        except RecordingError:
            continue
        measured += list(zip(response.frequency_hz, *response.ratio("out"), strict=True))
    return _averaged(measured) if measured else None


def _steady(series: Series) -> Series:
    """The recording without its start-up: tenths are cut while the first is missed half as badly again as the rest."""
    for _ in range(3):
        lines, extra = _lines(series)
        angle = 2 * np.pi * np.outer(series.time, [*lines, *extra])
        phi = np.column_stack([np.ones(len(series)), np.cos(angle), np.sin(angle)])
        rest = series.y - phi @ np.linalg.lstsq(phi, series.y, rcond=None)[0]
        tenth = len(series) // 10
        if np.std(rest[:tenth]) < 1.5 * np.std(rest[tenth:]):
            break
        series = series.cut(tenth, len(series))
    return series


def _lines(series: Series) -> tuple[list[float], list[float]]:
    """Frequencies [Hz] to report, and more that only take part in the fit."""
    frequency, harmonics = excitation.single_sine(series)
    if harmonics:
        highest = 0.5 / series.sample_time
        return [frequency], [h * frequency for h in range(2, excitation.HARMONICS + 1) if h * frequency < highest]
    u = series.u - series.u.mean()
    power = np.abs(np.fft.rfft(np.hanning(len(u)) * u)) ** 2
    peaks, _ = signal.find_peaks(power, height=1e-4 * power.max(), distance=3)
    near = np.unique(np.clip(peaks[:, None] + np.arange(-2, 3), 0, len(power) - 1))
    if len(near) > len(power) / 4 or power[near].sum() < 0.98 * power.sum():
        raise SettingError(
            f"{series.name}: the input has a continuous spectrum, not separate lines; estimate a model in time instead."
        )
    left, middle, right = (np.log(np.maximum(power[peaks + k], 1e-300)) for k in (-1, 0, 1))
    exact = peaks + 0.5 * (left - right) / (left - 2 * middle + right)  # vertex of the parabola through the logarithms
    return [float(f) for f in exact / (len(u) * series.sample_time)], []


@dataclass(frozen=True, eq=False)
class Rational(Tabled):
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
        sentences = []
        if self.freedom > 0 and stats.chi2.sf(self.chi_square, self.freedom) < ALARM:
            sentences.append(
                f"the rational function does not fit the points (chi2 {self.chi_square:.3g} at {self.freedom} degrees "
                "of freedom): the plant is nonlinear or changed between recordings, or the order is too low"
            )
        if self.distortion:
            sentences.append(
                f"nonlinear distortion: the output has harmonics up to {100 * self.distortion:.2g} % that the input "
                "lacks, so the response depends on amplitude"
            )
        return tuple(sentences)

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


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Prediction of each frequency from all others.

    Attributes:
        frequency_hz: left out, shape (M,).
        error: |predicted - measured| / |measured|, shape (M,).
    """

    frequency_hz: np.ndarray
    error: np.ndarray

    @property
    def inside(self) -> float:
        """Largest error at the frequencies between the lowest and the highest, which are interpolated."""
        return float(self.error[1:-1].max()) if len(self.error) > 2 else float(self.error.max())

    def __str__(self) -> str:
        listed = ", ".join(f"{f:.4g} Hz {100 * e:.2g} %" for f, e in zip(self.frequency_hz, self.error, strict=True))
        return f"left out one by one: {listed}"


def leave_one_out(data: Points) -> LeftOut:
    """Error of the rational fit at each point when that point is left out."""
    predicted = [rational(data.without(k)).response(f).value[0] for k, f in enumerate(data.frequency_hz)]
    return LeftOut(data.frequency_hz, np.abs(np.array(predicted) / data.value - 1))
