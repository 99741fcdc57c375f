"""A mass on spring and damper, 20 Hz, shaken by a sine, a multisine, random motion or a sweep: the answer is exact.

Both channels have noise; the shaker wanders in amplitude or frequency; hum and drift are added. The motion is
multiplied by the response in the frequency domain, over a time that is longer than the recording.
"""

from dataclasses import dataclass

import numpy as np

RATE_HZ, RESONANCE_HZ, LOW_HZ, HIGH_HZ, MARGIN_S = 1000.0, 20.0, 5.0, 50.0, 4.0
SECONDS = {"sine": 10.0, "multisine": 30.0, "random": 60.0, "sweep": 60.0}
WANDERS = ("", "AM", "FM", "hum", "drift", "20.3 Hz")


@dataclass(frozen=True)
class Case:
    """One line of the table: excitation, damping, noise as a share of each channel, and what else is wrong."""

    excitation: str
    damping: float
    noise: float
    wrong: str = ""

    def __str__(self) -> str:
        wrong = f", {self.wrong}" if self.wrong else ""
        return f"{self.excitation}, damping {100 * self.damping:g} %, noise {100 * self.noise:g} %{wrong}"

    @property
    def frequency_hz(self) -> float:
        """Of the sine."""
        return 20.3 if self.wrong == "20.3 Hz" else 20.0


def truth(frequency_hz: np.ndarray, damping: float) -> np.ndarray:
    """Transmissibility of a mass on spring and damper."""
    r = np.asarray(frequency_hz) / RESONANCE_HZ
    return (1 + 2j * damping * r) / (1 - r**2 + 2j * damping * r)


def recorded(case: Case, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, base and mass, (n,) each."""
    rng = np.random.default_rng([seed, *case_key(case)])
    seconds = SECONDS[case.excitation]
    t = np.arange(round((seconds + 2 * MARGIN_S) * RATE_HZ)) / RATE_HZ - MARGIN_S
    slow = rng.uniform(0, 2 * np.pi, 2)
    base = _base(case, t, rng, slow)
    if case.wrong == "AM":
        base = base * (1 + 0.05 * np.sin(2 * np.pi * 0.3 * t + slow[0]))
    edge = np.clip(np.minimum(t + MARGIN_S, t[-1] - t) / 1.0, 0, 1)
    base = base * np.sin(0.5 * np.pi * edge) ** 2
    f = np.fft.rfftfreq(t.size, 1 / RATE_HZ)
    mass = np.fft.irfft(truth(f, case.damping) * np.fft.rfft(base), t.size)
    inside = (t >= 0) & (t < seconds - 0.5 / RATE_HZ)
    t, channels = t[inside], [base[inside], mass[inside]]
    made = []
    for clean in channels:
        size = clean.std()
        x = clean + case.noise * size * rng.normal(size=t.size)
        if case.wrong == "hum":
            x = x + 0.05 * size * np.sin(2 * np.pi * 50.02 * t + rng.uniform(0, 2 * np.pi))
        if case.wrong == "drift":
            u = t / t[-1]
            bend = np.polynomial.chebyshev.chebval(2 * u - 1, [0, *rng.normal(size=4)])
            x = x + 0.3 * size * bend / np.ptp(bend)
        made.append(x)
    return t, made[0], made[1]


def case_key(case: Case) -> tuple[int, ...]:
    """Seed of a case's noise."""
    return (
        list(SECONDS).index(case.excitation), round(1000 * case.damping), round(1000 * case.noise),
        WANDERS.index(case.wrong),
    )  # fmt: skip


def _base(case: Case, t: np.ndarray, rng: np.random.Generator, slow: np.ndarray) -> np.ndarray:
    if case.excitation == "sine":
        wander = 0.05 / 0.2 * np.sin(2 * np.pi * 0.2 * t + slow[1]) if case.wrong == "FM" else 0.0
        return 8.95 * np.sin(2 * np.pi * case.frequency_hz * t + wander + rng.uniform(0, 2 * np.pi))
    if case.excitation == "multisine":
        lines = np.arange(LOW_HZ, HIGH_HZ, 0.5)
        lines = lines[np.arange(lines.size) % 5 != 3]  # every fifth is left out, to see distortion there
        spectrum = np.zeros(t.size // 2 + 1, complex)
        spectrum[np.round(lines * t.size / RATE_HZ).astype(int)] = np.exp(2j * np.pi * rng.uniform(size=lines.size))
        return 6.3 * np.sqrt(2 / lines.size) * 0.5 * t.size * np.fft.irfft(spectrum, t.size)
    if case.excitation == "random":
        f = np.fft.rfftfreq(t.size, 1 / RATE_HZ)
        lines = (rng.normal(size=f.size) + 1j * rng.normal(size=f.size)) * ((f >= LOW_HZ) & (f <= HIGH_HZ))
        values = np.fft.irfft(lines, t.size)
        return 6.3 * values / values.std()
    seconds = SECONDS["sweep"]
    inside = np.clip(t, 0, seconds)
    chirp = 8.95 * np.sin(2 * np.pi * (LOW_HZ + 0.5 * (HIGH_HZ - LOW_HZ) / seconds * inside) * inside)
    edge = np.clip(np.minimum(inside, seconds - inside) / 0.25, 0, 1)
    return chirp * np.sin(0.5 * np.pi * edge) ** 2
