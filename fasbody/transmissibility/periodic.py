"""The response to motion that repeats itself: means over the periods, with noise and nonlinear distortion separated.

What differs from period to period is noise, what repeats at lines that the shaker does not drive is distortion of the
foot (Pintelon & Schoukens, System Identification, 2nd ed., chapter 4). The ratio of means over periods is unbiased
though both channels are noisy, unlike H1; what the shaker does to both channels alike does not widen its interval.
"""

import numpy as np

from fasbody.recording.clock import rate_of
from fasbody.recording.harmonics import least_squares
from fasbody.transmissibility.response import Response, widening

#: Periods need to be alike to this correlation, beyond what noise explains, and at least so many.
_ALIKE, _FEWEST = 0.9, 3
#: A line is driven where its power is above this share of the strongest.
_DRIVEN = 1e-3
#: Lines on each side over which scatter is taken together where periods are few, and distortion.
_TOGETHER = 4
#: The first period is left out where it differs from the others by this times their scatter.
_ONSET = 3.0


def period_of(base: np.ndarray, rate_hz: float, band_hz: tuple[float, float]) -> float | None:
    """The period [s] after which the base repeats itself, None if it does not within a third of the record.

    Args:
        base: (n,) acceleration [m/s^2].
        rate_hz: sampling rate.
        band_hz: that it excites.
    """
    n = base.size
    size = 1 << (2 * n - 1).bit_length()
    f = np.fft.rfftfreq(size, 1 / rate_hz)
    inside = (f > 0.5 * band_hz[0]) & (f < 1.2 * band_hz[1])  # outside is white noise and drift
    power = np.abs(np.fft.rfft(base - base.mean(), size)) ** 2 * inside
    covariance = np.fft.irfft(power, size)[: n // _FEWEST + 1]
    alike = covariance / max(1e-300, covariance[0]) * n / (n - np.arange(covariance.size))
    shortest = int(2 * rate_hz / max(1e-9, band_hz[1] - band_hz[0]))
    after = np.flatnonzero(alike[shortest:] < 0.3)  # beyond the main peak
    if not after.size:
        return None
    start = shortest + int(after[0])
    peaks = np.flatnonzero(alike[start:] > _ALIKE)
    if not peaks.size:
        return None
    best = alike[start:].max()
    first = start + int(np.flatnonzero(alike[start:] > best - 0.02)[0])
    near = alike[first : first + max(2, int(0.25 * rate_hz / band_hz[1]))]
    top = first + int(np.argmax(near))
    if not 0 < top < alike.size - 1:
        return None
    return _refined(base, rate_hz, top / rate_hz, band_hz)


def _refined(base: np.ndarray, rate_hz: float, period: float, band_hz: tuple[float, float]) -> float:
    """The period from the phase that the driven lines gain from the first block of periods to the last."""
    for _ in range(3):
        spectra = _blocks(base, rate_hz, period, band_hz[1])
        power = np.mean(np.abs(spectra) ** 2, axis=0)
        k = np.flatnonzero(power > _DRIVEN * power.max())
        turned = np.angle(np.sum(spectra[1:, k] * spectra[:-1, k].conj(), axis=0))  # of one line in one period
        weight = power[k] * (k + 1)
        slip = float(np.sum(weight * turned) / np.sum(weight * (k + 1)))
        period *= 1 - slip / (2 * np.pi)
    return float(period)


def _blocks(values: np.ndarray, rate_hz: float, period_s: float, highest_hz: float) -> np.ndarray:
    """Complex amplitudes of the harmonics of each period, (periods, lines).

    A period need not be a whole number of samples: amplitudes are fitted to the whole samples within, with offset and
    slope, and turned to where the period begins.
    """
    samples = period_s * rate_hz
    n = int(samples + 1e-6)
    count = int(values.size / samples) + 1
    starts = np.round(np.arange(count) * samples).astype(int)
    starts = starts[starts + n <= values.size]
    lines = min(int(1.05 * highest_hz * period_s) + 1, (n - 4) // 2)
    turn = 2j * np.pi * np.arange(1, lines + 1) / samples
    waves = np.exp(np.outer(np.arange(n), turn))
    basis = np.empty((n, 2 + 2 * lines))
    basis[:, 0], basis[:, 1] = 1.0, np.linspace(-1, 1, n)
    basis[:, 2::2], basis[:, 3::2] = waves.real, waves.imag
    solved = least_squares(basis, np.column_stack([values[s : s + n] for s in starts]))
    amplitudes = (solved[2::2] - 1j * solved[3::2]).T
    late = starts - np.arange(starts.size) * samples
    return amplitudes * np.exp(-np.outer(late, turn))


def by_periods(
    time_s: np.ndarray, channels: dict[str, np.ndarray], period_s: float, band_hz: tuple[float, float],
    resolution_hz: float,
) -> Response:  # fmt: skip
    """Channels over the base at the lines that the base drives.

    Args:
        time_s: (n,) [s], uniform.
        channels: (n,) each [m/s^2], "base" among them.
        period_s: of the base.
        band_hz: that it excites.
        resolution_hz: lines closer than that are thinned to it.
    """
    rate = rate_of(time_s)
    spectra = {name: _blocks(values, rate, period_s, band_hz[1]) for name, values in channels.items()}
    spectra = _steady(spectra)
    base = spectra["base"]
    P = len(base)
    frequency = np.arange(1, base.shape[1] + 1) / period_s
    power = np.abs(base.mean(axis=0)) ** 2
    driven = (power > _DRIVEN * power.max()) & (frequency > band_hz[0] - 0.5 * resolution_hz)
    driven &= frequency < band_hz[1] + 0.5 * resolution_hz
    outs = [name for name in channels if name != "base"]
    X = base.mean(axis=0)
    H = {name: spectra[name].mean(axis=0) / np.where(driven, X, 1) for name in outs}
    left = {name: spectra[name] - H[name] * base for name in outs}
    near = 0 if P > 15 else _TOGETHER
    covariance, distortion = {}, {}
    for a in outs:
        for b in outs:
            scatter = np.sum(left[a] * left[b].conj(), axis=0) / (P - 1) / P
            covariance[a, b], lines = _together(scatter, driven, near)
            covariance[a, b] = covariance[a, b] * widening(2 * (P - 1) * lines) ** 2
    inside = (frequency > band_hz[0]) & (frequency < band_hz[1])
    for a in outs:
        level = _distorted(frequency, spectra[a], base, H[a], driven, inside)
        covariance[a, a] = covariance[a, a] + np.where(np.isfinite(level), level, 0.0)
        distortion[a] = np.sqrt(level / 2)
    chosen = np.flatnonzero(driven)
    chosen = chosen[_thinned(frequency[chosen], resolution_hz)]
    size = np.abs(X[chosen])
    near_hz = np.round(frequency[chosen] / resolution_hz) * resolution_hz  # two loggers' clocks make one frequency
    same = np.abs(near_hz - frequency[chosen]) < 0.02 * resolution_hz
    nominal = np.where(same, near_hz, np.round(frequency[chosen], 3))
    return Response(
        f"{P} periods of {period_s:.6g} s", nominal, {a: H[a][chosen] for a in outs},
        {pair: c[chosen] / size**2 for pair, c in covariance.items()},
        {a: d[chosen] / size for a, d in distortion.items()},
    )  # fmt: skip


def _steady(spectra: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Without the first periods, in which the transient of the foot decays."""
    while len(spectra["base"]) > _FEWEST:
        worst = 0.0
        later = spectra["base"][1:]
        weight = np.abs(later.mean(axis=0)) ** 2
        use = weight > _DRIVEN * weight.max()
        for name, values in spectra.items():
            if name == "base":
                continue
            H = values[1:].mean(axis=0)[use] / later.mean(axis=0)[use]
            left = np.mean(np.abs(values[:, use] - H * spectra["base"][:, use]) ** 2, axis=1)
            worst = max(worst, float(left[0] / max(1e-300, left[1:].mean())))
        if worst < _ONSET:
            break
        spectra = {name: values[1:] for name, values in spectra.items()}
    return spectra


def _together(values: np.ndarray, driven: np.ndarray, near: int) -> tuple[np.ndarray, np.ndarray]:
    """Means over the driven lines nearby, and how many they are."""
    count = np.maximum(1, _nearby(driven.astype(float), near))
    return _nearby(np.where(driven, values, 0), near) / count, count


def _nearby(values: np.ndarray, near: int) -> np.ndarray:
    """Sums (n,) over so many neighbours on each side; "same" of numpy is longer where its kernel is."""
    return np.convolve(values, np.ones(2 * near + 1))[near : near + values.size]


def _distorted(
    frequency: np.ndarray, out: np.ndarray, base: np.ndarray, H: np.ndarray, driven: np.ndarray, inside: np.ndarray
) -> np.ndarray:
    """Power (lines,) that repeats at lines within the band that are not driven, beyond noise; nan without them."""
    silent = np.flatnonzero(inside & ~driven)
    if silent.size < 3 or driven.sum() < 3:
        return np.full(frequency.size, np.nan)
    response = np.interp(frequency[silent], frequency[driven], H[driven])
    left = out[:, silent] - response * base[:, silent]  # what the response to the base explains is no distortion
    P = len(left)
    noise = np.sum(np.abs(left - left.mean(axis=0)) ** 2, axis=0) / (P - 1) / P
    power = np.abs(left.mean(axis=0)) ** 2
    count = _nearby(np.ones(silent.size), _TOGETHER)
    power, noise = _nearby(power, _TOGETHER) / count, _nearby(noise, _TOGETHER) / count
    sure = power > 3 * noise  # so much more is not by chance
    return np.interp(frequency, frequency[silent], np.where(sure, power - noise, 0.0))


def _thinned(frequency: np.ndarray, resolution_hz: float) -> np.ndarray:
    """Indices of lines: all that are further apart than the resolution, else those nearest to its multiples."""
    if frequency.size < 2 or np.diff(frequency).min() > 0.98 * resolution_hz:
        return np.arange(frequency.size)
    multiples = np.arange(np.ceil(frequency[0] / resolution_hz), np.floor(frequency[-1] / resolution_hz) + 1)
    near = np.abs(frequency[None, :] - multiples[:, None] * resolution_hz)
    at = near.argmin(axis=1)
    return np.unique(at[near.min(axis=1) < 0.5 * resolution_hz])
