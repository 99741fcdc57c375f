"""Motion of the shaker's table: a prescribed acceleration, followed exactly by the model's base.

The base is a slide of huge armature, so the force armature x a(t) moves it with the acceleration a(t) independently of
the foot. Within each time step a(t) is a cubic, evaluated by the native callback at the integrator's own stage times
(engine.py), which keeps fourth-order Runge-Kutta fourth order. Only acceleration matters to a foot that stands on the
table alone: the base position may drift. What is tied to the world feels the position, so periodic motions begin where
they do not drift, and others are refused there (simulate.py). A constant offset of an accelerometer is taken out of a
recording beforehand.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fasbody.constants import PEAK_TO_PEAK
from fasbody.exceptions import SettingError
from fasbody.presentation import Tabled

#: Unit of time of the controls [s]. MuJoCo takes no control above 1e10, and third derivatives of a noisy base at 4 kHz
#: are larger in SI. A power of two, so that no digit is lost.
CLOCK = 2.0**-10
#: Samples finer than this need no band-limited curve [Hz]; its filter reaches so far [samples]; so large a difference
#: from the spline counts, as a share of the motion.
_FINE_HZ, _REACH, _ALIKE = 4000.0, 64, 1e-3
#: Largest array of exponentials that is cached: one of a period fits, one of a whole recording does not.
_KEPT = 20_000


@dataclass(frozen=True)
class BaseMotion(Tabled):
    """Prescribed base acceleration.

    Attributes:
        name: what to call it in messages and figures.
        duration: length [s].
        acceleration: function of time (n,) [s] -> (n,) [m/s^2].
        jerk: its time derivative [m/s^3].
        start: position [m] and velocity [m/s] from which it goes on about zero; None where it drifts.
    """

    name: str
    duration: float
    acceleration: Callable[[np.ndarray], np.ndarray]
    jerk: Callable[[np.ndarray], np.ndarray]
    start: tuple[float, float] | None = None

    def controls(self, step: float, count: int) -> np.ndarray:
        """Shaker controls of `count` steps: (count, 5) start time [s] and Taylor coefficients a0..a3 of each step.

        Time counts in units of `CLOCK`, so that all coefficients are accelerations [m/s^2].
        The cubic agrees with acceleration and jerk at both ends of the step (Hermite), so a spline with knots at the
        steps is reproduced exactly and a smooth motion to fourth order.
        """
        t = step * np.arange(count + 1)
        a, j = self.acceleration(t), self.jerk(t)
        rise = (a[1:] - a[:-1]) / step
        columns = (
            t[:-1],
            a[:-1],
            CLOCK * j[:-1],
            CLOCK**2 * ((3 * rise - 2 * j[:-1] - j[1:]) / step),
            CLOCK**3 * ((j[:-1] + j[1:] - 2 * rise) / step**2),
        )
        return np.column_stack(columns)

    def half_steps(self, step: float, count: int) -> np.ndarray:
        """The same cubics at the stage times of Runge-Kutta: (2 count + 1,) values half a step apart [m/s^2]."""
        return at_half_steps(self.controls(step, count), step)


def at_half_steps(controls: np.ndarray, step: float) -> np.ndarray:
    """Acceleration by controls (n, 5) of steps [s] at the stage times of Runge-Kutta: (2 n + 1,) values [m/s^2]."""
    _, a0, a1, a2, a3 = controls.T
    whole = step / CLOCK
    half = 0.5 * whole
    values = np.empty(2 * len(controls) + 1)
    values[:-1:2], values[1::2] = a0, a0 + half * (a1 + half * (a2 + half * a3))
    values[-1] = a0[-1] + whole * (a1[-1] + whole * (a2[-1] + whole * a3[-1]))
    return values


def harmonics(
    frequency: float, amplitudes: Sequence[complex] | np.ndarray, duration: float, name: str = ""
) -> BaseMotion:
    """Periodic motion, sum over h of Re(U_h exp(i 2 pi h f t)).

    Args:
        frequency: fundamental [Hz].
        amplitudes: complex U_1, U_2, ... [m/s^2].
        duration: [s].
        name: for messages.
    """
    U = np.asarray(amplitudes, complex)
    omega = 2j * np.pi * frequency * np.arange(1, U.size + 1)
    return _lines(name or f"harmonics of {frequency:g} Hz", duration, omega, U)


def _lines(name: str, duration: float, omega: np.ndarray, U: np.ndarray) -> BaseMotion:
    """Sum of Re(U exp(omega t)) over lines (n,) at imaginary omega [1/s]."""

    def acceleration(t: np.ndarray) -> np.ndarray:
        return (_turning(t, omega) @ U).real

    def jerk(t: np.ndarray) -> np.ndarray:
        return (_turning(t, omega) @ (omega * U)).real

    start = float((U / omega**2).sum().real), float((U / omega).sum().real)
    return BaseMotion(name, duration, acceleration, jerk, start)


def _turning(t: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """exp(omega t) of times (n,) and lines (k,): (n, k); those of a period are cached for fits."""
    t = np.asarray(t, float)
    if t.ndim != 1 or t.size == 1 or t.size * omega.size > _KEPT:
        return np.exp(np.multiply.outer(t, omega))
    return _kept_turning(t.tobytes(), omega.tobytes())


@functools.lru_cache(maxsize=16)
def _kept_turning(t: bytes, omega: bytes) -> np.ndarray:
    return np.exp(np.multiply.outer(np.frombuffer(t), np.frombuffer(omega, complex)))


def sine(frequency: float, duration: float, peak_to_peak: float = PEAK_TO_PEAK) -> BaseMotion:
    """One sine, the excitation of the thesis: frequency [Hz], duration [s], peak to peak [m/s^2]."""
    _positive(frequency=frequency, duration=duration, peak_to_peak=peak_to_peak)
    return harmonics(frequency, [-0.5j * peak_to_peak], duration, f"sine {frequency:g} Hz")


def sweep(start: float, stop: float, duration: float, peak_to_peak: float = PEAK_TO_PEAK) -> BaseMotion:
    """Swept sine whose frequency goes linearly from `start` to `stop` [Hz] at constant amplitude."""
    _positive(start=start, stop=stop, duration=duration, peak_to_peak=peak_to_peak)
    rate, amplitude = (stop - start) / duration, 0.5 * peak_to_peak

    def phase(t: np.ndarray) -> np.ndarray:
        return 2 * np.pi * (start + 0.5 * rate * t) * t

    def acceleration(t: np.ndarray) -> np.ndarray:
        return amplitude * np.sin(phase(t))

    def jerk(t: np.ndarray) -> np.ndarray:
        return amplitude * 2 * np.pi * (start + rate * t) * np.cos(phase(t))

    return BaseMotion(f"sweep {start:g} to {stop:g} Hz", duration, acceleration, jerk)


def multisine(frequencies: Sequence[float], duration: float, rms: float = 6.3, seed: int = 0) -> BaseMotion:
    """Equal sines at the given frequencies [Hz] with random phases; `rms` [m/s^2] of the whole."""
    f = np.asarray(frequencies, float)
    if f.size == 0 or np.any(f <= 0):
        raise SettingError(f"a multisine needs positive frequencies in Hz, not {list(frequencies)}.")
    _positive(duration=duration, rms=rms)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, f.size)
    U = rms * np.sqrt(2 / f.size) * np.exp(1j * phases)
    return _lines(f"multisine of {f.size} lines", duration, 2j * np.pi * f, U)


def random(low: float, high: float, duration: float, rms: float = 6.3, seed: int = 0) -> BaseMotion:
    """Band-limited random motion: Gaussian lines every 1/duration Hz between `low` and `high` [Hz], `rms` [m/s^2]."""
    _positive(low=low, high=high, duration=duration, rms=rms)
    lines = np.arange(np.ceil(low * duration), np.floor(high * duration) + 1) / duration
    if lines.size < 2:
        raise SettingError(f"random motion needs a band wider than {2 / duration:g} Hz for {duration:g} s.")
    rng = np.random.default_rng(seed)
    amplitudes = rng.normal(size=lines.size) + 1j * rng.normal(size=lines.size)
    rate = 20 * high
    count = round(rate * duration)
    spectrum = np.zeros(count // 2 + 1, complex)
    spectrum[np.round(lines * duration).astype(int)] = amplitudes
    values = np.fft.irfft(spectrum, count)
    motion = samples(np.arange(count + 1) / rate, np.append(values, values[0]) * rms / values.std())
    return BaseMotion(f"random {low:g} to {high:g} Hz", duration, motion.acceleration, motion.jerk)


def samples(time_s: ArrayLike, acceleration: ArrayLike, name: str = "recording") -> BaseMotion:
    """A recorded base acceleration, as the cubic spline through its samples.

    A spline is up to a fifth off a sine of three samples a period. Where the samples are uniform and so coarse that
    this matters, it goes through the band-limited curve instead (but for their ends, where that is not known).

    Args:
        time_s: (n,) sample times [s], datetimes or time differences; the motion begins with the
            first of them.
        acceleration: (n,) [m/s^2], offset removed. Of a pandas Series the index is not looked at.
        name: for messages.
    """
    from scipy.interpolate import CubicSpline

    t = seconds(time_s)
    t = t - t[0]
    values = np.asarray(acceleration, float)
    spline = CubicSpline(t, values)
    finer = _band_limited(t, values, spline)
    if finer is not None:
        spline = CubicSpline(*finer)
    return BaseMotion(name, float(t[-1] - t[0]), spline, spline.derivative())


def _band_limited(
    t: np.ndarray, values: np.ndarray, spline: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray] | None:
    """Finer times and values of the curve with no frequency above half the sampling rate; None where it is the spline.

    Args:
        t: (n,) times [s].
        values: (n,).
        spline: through them.
    """
    from scipy.signal import firwin, resample_poly

    n, step = t.size, t[-1] / (t.size - 1)
    parts = int(np.ceil(_FINE_HZ * step - 1e-9))
    if parts < 2 or n < 4 * _REACH or np.ptp(np.diff(t)) > 1e-6 * step:
        return None
    low_pass = firwin(2 * _REACH * parts + 1, 1 / parts, window=("kaiser", 10.0))
    at = np.arange((n - 1) * parts + 1) / parts
    coarse = spline(at * step)
    more = resample_poly(values, parts, 1, window=low_pass)[: at.size] - coarse
    more *= np.clip(np.minimum(at, at[::-1]) / _REACH - 1, 0, 1)
    if np.abs(more).max() < _ALIKE * np.std(values):
        return None
    return at * step, coarse + more


def seconds(time: ArrayLike) -> np.ndarray:
    """Times as numbers [s], as they are; time differences as seconds, and datetimes as seconds from the first."""
    stamps = plain(time)
    if stamps.dtype.kind == "M" and stamps.size:
        stamps = stamps - stamps.flat[0]
    return stamps / np.timedelta64(1, "s") if stamps.dtype.kind == "m" else stamps


def plain(values: ArrayLike) -> np.ndarray:
    """A numpy array of a row of any kind; datetimes with a time zone lose it."""
    dated = getattr(getattr(values, "dtype", None), "kind", "") == "M"
    return np.asarray(values, "datetime64[ns]") if dated else np.asarray(values)


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise SettingError(f"{name.replace('_', ' ')} of a base motion must be a positive number, not {value}.")
