"""What the shaker and the data acquisition add to a motion: the errors of real recordings, with known sizes."""

from dataclasses import dataclass, replace

import numpy as np

from fasbody.foot import shaker
from fasbody.foot.shaker import BaseMotion
from fasbody.presentation import Tabled
from fasbody.recording.recording import Recording

#: Motions of the table that a study can have.
EXCITATIONS = ("sine", "sweep", "multisine", "random")
#: What only the strapped sensors of a virtual study have; `observe` leaves it out.
STRAPPED = ("offset_m_s2", "strap_hz", "strap_zeta", "gain_scatter")


@dataclass(frozen=True)
class Instrument(Tabled):
    """What the shaker and the data acquisition add to the motion.

    Attributes:
        rate_hz: sampling rate.
        noise_base, noise_malleolus: standard deviation of the sensor noise [m/s^2].
        bits, range_m_s2: the converter spans +-range in 2^bits steps.
        delay_s: the malleolus channel lags the base channel by this much (filters, converter).
        distortion: amplitude of the shaker's second and third harmonic over the first.
        offset_m_s2: of every channel.
        strap_hz, strap_zeta: resonance of a strapped sensor on the skin; 0 Hz: rigid.
        gain_scatter: relative standard deviation of a strapped sensor's gain from one mounting to
            the next.
    """

    rate_hz: float = 1000.0
    noise_base: float = 0.03
    noise_malleolus: float = 0.05
    bits: int = 12
    range_m_s2: float = 39.2
    delay_s: float = 2e-4
    distortion: tuple[float, float] = (0.015, 0.008)
    offset_m_s2: float = 0.0
    strap_hz: float = 0.0
    strap_zeta: float = 0.1
    gain_scatter: float = 0.0

    def amplitudes(self, rng: np.random.Generator, peak_to_peak: float = shaker.PEAK_TO_PEAK) -> np.ndarray:
        """(3,) complex harmonics of the shaker [m/s^2] at random phases; `peak_to_peak` [m/s^2] of the first."""
        phases = rng.uniform(0, 2 * np.pi, 3)
        sizes = 0.5 * peak_to_peak * np.array([1.0, *self.distortion])
        return -1j * sizes * np.exp(1j * phases)

    def motion(self, frequency_hz: float, duration_s: float, rng: np.random.Generator) -> BaseMotion:
        """Shaker motion of 17.9 m/s^2 peak to peak with its harmonics."""
        return shaker.harmonics(frequency_hz, self.amplitudes(rng), duration_s)

    def strap(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Complex ratio of what a strapped sensor and the bone under it do, at (n,) frequencies [Hz]."""
        if not self.strap_hz:
            return np.ones(np.shape(frequency_hz), complex)
        r = np.asarray(frequency_hz) / self.strap_hz
        return (1 + 2j * self.strap_zeta * r) / (1 - r**2 + 2j * self.strap_zeta * r)

    def measure(self, values: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
        """Add noise and quantise; (n,) [m/s^2]."""
        step = 2 * self.range_m_s2 / 2**self.bits
        noisy = values + rng.normal(0, noise, values.size)
        return np.clip(np.round(noisy / step) * step, -self.range_m_s2, self.range_m_s2 - step)

    def observe(self, exact: Recording, rng: np.random.Generator) -> Recording:
        """A recording as rigidly mounted sensors give it: noise and quantisation on every channel."""
        base = self.measure(exact.base_m_s2, self.noise_base, rng)
        malleolus = self.measure(exact.malleolus_m_s2, self.noise_malleolus, rng)
        others = {name: self.measure(values, self.noise_malleolus, rng) for name, values in exact.others.items()}
        return replace(exact, base_m_s2=base, malleolus_m_s2=malleolus, others=others)
