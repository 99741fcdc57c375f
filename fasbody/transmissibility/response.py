"""A frequency response as every estimator gives it: ratios of channels to the base, with what their intervals hold."""

from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from fasbody.constants import Z95
from fasbody.presentation import Tabled


@dataclass(frozen=True, eq=False)
class Response(Tabled):
    """Channels over the base at some frequencies.

    Attributes:
        method: how it was estimated.
        frequency_hz: (f,).
        H: channel -> (f,) complex, its motion over the base's.
        covariance: (channel, channel) -> (f,) complex covariance of two estimates, widened so that 1.96 standard
            deviations are a 95 % interval for however few segments there were.
        distortion: channel -> (f,) standard deviation by nonlinear distortion, contained in the covariance; nan where
            it cannot be distinguished from the noise.
        bias: channel -> (f,) relative error by the resolution, as far as it shows; nan where there is no such error.
    """

    method: str
    frequency_hz: np.ndarray
    H: dict[str, np.ndarray]
    covariance: dict[tuple[str, str], np.ndarray]
    distortion: dict[str, np.ndarray] = field(default_factory=dict)
    bias: dict[str, np.ndarray] = field(default_factory=dict)

    def at(self, use: np.ndarray) -> "Response":
        """At some of the frequencies, (f,) bool."""
        H, distortion, bias = ({k: v[use] for k, v in part.items()} for part in (self.H, self.distortion, self.bias))
        covariance = {pair: values[use] for pair, values in self.covariance.items()}
        return Response(self.method, self.frequency_hz[use], H, covariance, distortion, bias)

    def ratio(self, out: str, into: str = "base") -> tuple[np.ndarray, np.ndarray]:
        """One channel over another: (f,) complex, and (f,) standard deviation of its real (or imaginary) part."""
        if into == "base":
            return self.H[out], np.sqrt(self.covariance[out, out].real / 2)
        H = self.H[out] / self.H[into]  # the base's noise is in both and cancels as far as they share it
        cross = np.conj(H) * self.covariance[out, into]
        power = self.covariance[out, out].real + np.abs(H) ** 2 * self.covariance[into, into].real - 2 * cross.real
        return H, np.sqrt(np.maximum(0.0, power) / 2) / np.abs(self.H[into])

    def distorted(self, out: str, into: str = "base") -> np.ndarray:
        """(f,) standard deviation by nonlinear distortion of a ratio, nan where noise hides it."""
        H, _ = self.ratio(out, into)
        unknown = np.full(self.frequency_hz.size, np.nan)
        total = self.distortion.get(out, unknown) / np.abs(self.H[out])
        if into != "base":
            total = np.hypot(total, self.distortion.get(into, unknown) / np.abs(self.H[into]))
        return np.abs(H) * total

    def biased(self, out: str, into: str = "base") -> np.ndarray:
        """(f,) relative error of a ratio by the resolution, nan where there is none."""
        unknown = np.full(self.frequency_hz.size, np.nan)
        other = 0.0 if into == "base" else self.bias.get(into, unknown)
        return self.bias.get(out, unknown) - other


def widening(freedom: float | np.ndarray) -> np.ndarray:
    """What a standard deviation of so many degrees of freedom is taken times, so that 1.96 of it hold 95 %."""
    return stats.t.ppf(0.975, np.maximum(1.0, freedom)) / Z95
