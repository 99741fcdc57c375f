"""The response to random motion and sweeps by local models in the frequency domain, with the leakage as part of them.

Around each frequency the transform of a channel is Y = (B X + T) / A: the response B / A times that of the base, and a
smooth term T / A for what rings on from before the record and beyond its end (Pintelon & Schoukens, System
Identification, 2nd ed., section 7.2; with a denominator: McKelvey & Guérin 2012). The denominator follows a resonance
that a polynomial of the same window cannot, so that the window may be wide and the noise small. Noise of the base, seen
beyond the band that the shaker excites, is taken out of the normal equations, where it would make the response too
small. Windows of half the width give the resolution error.
"""

from dataclasses import replace

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.recording.clock import rate_of
from fasbody.transmissibility.response import Response, widening

#: Order of B and T; that of A is 1, as one resonance is within a window or near it.
_ORDER = 2
#: A pole that is nearer to the real frequencies than this share of a window is one of the noise.
_NEAREST = 0.6
#: A narrower window differs where it does by this times its standard deviation.
_SURE = 5.0
#: Equations with a larger condition number do not determine a response: the base drives too few lines of the window.
_SINGULAR = 1e13
#: Least bins of a window on each side.
_LEAST = 8
#: Parts of the band above the excitation in which noise is looked for.
_FLOORS = 8


def local(
    time_s: np.ndarray, channels: dict[str, np.ndarray], frequency_hz: np.ndarray, band_hz: tuple[float, float],
    resolution_hz: float,
) -> Response:  # fmt: skip
    """Channels over the base at given frequencies.

    Args:
        time_s: (n,) [s], uniform.
        channels: (n,) each [m/s^2], "base" among them.
        frequency_hz: (f,) where.
        band_hz: that the shaker excites.
        resolution_hz: half width of the windows.

    Raises:
        RecordingError: too short for a window within the band, or no window with enough lines that the base drives.
    """
    rate = rate_of(time_s)
    half = max(_LEAST, round(resolution_hz * time_s.size / rate))
    full = _windows(channels, frequency_hz, band_hz, resolution_hz, half, rate)
    driven = np.all([np.isfinite(H) for H in full.H.values()], axis=0)
    if not driven.any():
        raise RecordingError(
            f"base_m_s2 drives too few lines within {resolution_hz:g} Hz for their response; ask for a coarser "
            "resolution, or record three periods or more."
        )
    full = full.at(driven)
    if half < 2 * _LEAST:
        return full
    narrow = _windows(channels, full.frequency_hz, band_hz, resolution_hz, half // 2, rate)
    bias, covariance = {}, dict(full.covariance)
    for name, H in full.H.items():
        nearer = np.where(np.isfinite(narrow.H[name]), narrow.H[name], H)
        beyond = np.abs(H - nearer) > _SURE * narrow.ratio(name)[1]
        bias[name] = np.where(beyond, np.abs(H / nearer) - 1, 0.0)
        covariance[name, name] = covariance[name, name] + 2 * np.where(beyond, np.abs(H - nearer), 0.0) ** 2
    return replace(full, covariance=covariance, bias=bias)


def _windows(
    channels: dict[str, np.ndarray], frequency_hz: np.ndarray, band_hz: tuple[float, float], resolution_hz: float,
    half: int, rate: float,
) -> Response:  # fmt: skip
    """The same by windows of so many bins on each side."""
    n = channels["base"].size
    step = rate / n
    outs = [name for name in channels if name != "base"]
    X = np.fft.rfft(channels["base"])
    Y = np.column_stack([np.fft.rfft(channels[name]) for name in outs])
    bins = np.arange(X.size) * step
    usable = np.flatnonzero((bins > max(0.5 * step, band_hz[0] - resolution_hz)) & (bins < band_hz[1] + resolution_hz))
    if usable.size < 2 * half + 1:
        raise RecordingError(
            f"{n / rate:.3g} s are too short for a band of {band_hz[0]:.3g} to {band_hz[1]:.3g} Hz; "
            f"record at least {2 * _LEAST / max(1e-9, band_hz[1] - band_hz[0]):.3g} s."
        )
    noise = {name: floor(values, rate, band_hz[1]) for name, values in channels.items()}
    H = {name: np.empty(frequency_hz.size, complex) for name in outs}
    covariance = {(a, b): np.empty(frequency_hz.size, complex) for a in outs for b in outs}
    for i, f in enumerate(frequency_hz):
        first = int(np.clip(round(f / step) - half, usable[0], usable[-1] - 2 * half))
        place = np.arange(first, first + 2 * half + 1)
        r = (place * step - f) / (half * step)
        fits = [_fitted(r, X[place], Y[place, j], noise["base"], noise[name]) for j, name in enumerate(outs)]
        for j, a in enumerate(outs):
            H[a][i] = fits[j][0]
            for k, b in enumerate(outs):
                freedom = place.size - 2 * (_ORDER + 1) - 1
                scatter = np.sum(fits[j][2] * fits[k][2].conj()) / freedom
                spread = np.sqrt(np.abs(fits[j][1] * fits[k][1]))
                covariance[a, b][i] = scatter * spread * widening(2 * freedom) ** 2
    return Response("local rational", np.asarray(frequency_hz, float), H, covariance)


def _fitted(
    r: np.ndarray, X: np.ndarray, Y: np.ndarray, noise_in: float, noise_out: float
) -> tuple[complex, float, np.ndarray]:
    """Response in the middle, its variance for residuals of variance 1, and the residuals (bins,)."""
    powers = r[:, None] ** np.arange(_ORDER + 1)
    count = _ORDER + 1
    known = np.hstack([X[:, None] * powers, powers * np.sqrt(np.mean(np.abs(X) ** 2))])
    A = _denominator(r, known, Y, powers, noise_in, noise_out)
    basis = known / A[:, None]
    normal = basis.conj().T @ basis
    weighted = powers / np.abs(A[:, None])
    normal[:count, :count] -= noise_in * (weighted.T @ weighted)
    if np.linalg.cond(normal) > _SINGULAR:
        return complex(np.nan), np.nan, np.full(Y.size, np.nan)
    solved = np.linalg.solve(normal, basis.conj().T @ Y)
    left = Y - basis @ solved
    if np.all(A == 1):
        return complex(solved[0]), float(np.linalg.inv(normal)[0, 0].real), left
    full = np.column_stack([basis, (basis @ solved) * r / A])  # the denominator is estimated, too
    return complex(solved[0]), float(np.linalg.pinv(full.conj().T @ full, 1e-12, hermitian=True)[0, 0].real), left


def _denominator(
    r: np.ndarray, known: np.ndarray, Y: np.ndarray, powers: np.ndarray, noise_in: float, noise_out: float
) -> np.ndarray:
    """A = 1 + a r over the window (bins,); 1 throughout where its zero would lie within the band itself."""
    A = np.ones(r.size, complex)
    count = powers.shape[1]
    for _ in range(3):
        basis = np.column_stack([known, -Y * r]) / A[:, None]
        weight = 1 / np.abs(A) ** 2
        normal = basis.conj().T @ basis
        normal[:count, :count] -= noise_in * ((powers.T * weight) @ powers)
        normal[-1, -1] -= noise_out * np.sum(weight * r**2)
        right = basis.conj().T @ (Y / A)
        right[-1] += noise_out * np.sum(weight * r)
        if np.linalg.cond(normal) > _SINGULAR:
            return np.ones(r.size, complex)
        a = np.linalg.solve(normal, right)[-1]
        zero = -1 / a if a else np.inf
        if abs(np.imag(zero)) < _NEAREST and abs(np.real(zero)) < 1.6:
            return np.ones(r.size, complex)
        A = 1 + a * r
    return A


def floor(values: np.ndarray, rate_hz: float, highest_hz: float) -> float:
    """Mean power of a bin's noise, from the quietest part beyond the excitation; 0 where nothing lies beyond."""
    n = values.size
    window = np.hanning(n)
    power = np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2 / np.mean(window**2)
    f = np.arange(power.size) * rate_hz / n
    beyond = power[(f > 1.5 * highest_hz) & (f < 0.45 * rate_hz)]
    if beyond.size < 50 * _FLOORS:
        return 0.0
    return float(min(np.median(part) for part in np.array_split(beyond, _FLOORS)) / np.log(2))
