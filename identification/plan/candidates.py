"""The recordings that could be made, and those that the thesis made."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fasbody.acquire.person import LEVEL_S, Dose
from fasbody.foot.shaker import PEAK_TO_PEAK
from fasbody.recording.condition import ADDED_MASSES_KG
from fasbody.recording.harmonics import harmonic_count
from identification.plan.shaker import MULTISINE, SINE, Shaker

#: The thesis' protocol, section 2.2.2: frequencies [Hz], amplitude of the base [m/s^2], length [s].
THESIS_HZ = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0)
THESIS_AMPLITUDE, THESIS_S = 0.5 * PEAK_TO_PEAK, 10.0
#: Names of the protocols that are compared: the plan, the thesis', and the part of it without load.
PLANNED, THESIS, UNLOADED = "planned", "thesis", "thesis_unloaded"
#: How much more than its own mass a foot and its load may weigh on the shaker: the resonance of a damped leg.
_RESONANT = 2.5


@dataclass(frozen=True)
class Step:
    """One recording.

    Attributes:
        kind: "sine", or "multisine": harmonics of one fundamental at once.
        frequency_hz: the fundamental.
        added_mass_kg: on the knee.
        amplitude_m_s2: of the base, half of peak to peak.
        seconds: of shaking.
        tones: harmonics that a multisine plays.
        sensors: that are read.
    """

    kind: str
    frequency_hz: float
    added_mass_kg: float
    amplitude_m_s2: float
    seconds: float
    tones: int = 1
    sensors: tuple[str, ...] = ("malleolus",)

    def __str__(self) -> str:
        many = f" and its harmonics to {self.tones * self.frequency_hz:g} Hz" if self.tones > 1 else ""
        return (
            f"{self.frequency_hz:g} Hz{many}, {self.added_mass_kg:g} kg on the knee, +-{self.amplitude_m_s2:.3g} "
            f"m/s^2, {self.seconds:g} s"
        )

    def base(self, count: int) -> np.ndarray:
        """Harmonics (count,) of the base [m/s^2]; tones as flat as their phases allow (Schroeder 1970)."""
        U = np.zeros(count, complex)
        if self.kind == SINE:
            U[0] = self.amplitude_m_s2
            return U
        n = np.arange(1, self.tones + 1)
        phases = np.exp(-1j * np.pi * n * (n - 1) / self.tones)
        wave = np.real(np.exp(2j * np.pi * np.outer(np.arange(512) / 512, n)) @ phases)
        U[: self.tones] = self.amplitude_m_s2 / np.abs(wave).max() * phases
        return U

    def count(self, rate_hz: float) -> int:
        """Harmonics that a fit compares."""
        return max(harmonic_count(self.frequency_hz, rate_hz), self.tones)


def weight(mass_kg: float, load_kg: float) -> float:
    """What the shaker feels at most of a leg under its load [kg]."""
    return _RESONANT * (mass_kg + load_kg)


def candidates(shaker: Shaker, leg_kg: float) -> tuple[Step, ...]:
    """Every recording of a leg [kg] that the limits of a shaker allow, in a fixed order."""
    s, steps = shaker, []
    for load in dict.fromkeys(s.loads_kg):
        moving = weight(leg_kg, load)
        for f in s.frequencies_hz:
            for a in s.amplitudes(f, moving) if SINE in s.kinds else ():
                steps.append(Step(SINE, f, load, a, s.seconds, sensors=s.sensors))
            tones = min(harmonic_count(f, s.rate_hz), int(1.001 * s.highest_hz // f))
            for a in s.amplitudes(f, moving) if MULTISINE in s.kinds and tones > 1 else ():
                steps.append(Step(MULTISINE, f, load, a, s.seconds, tones, s.sensors))
    return tuple(steps)


def within(shaker: Shaker, leg_kg: float, steps: Sequence[Step]) -> tuple[Step, ...]:
    """Sines of a protocol as far as a shaker can make them, no stronger than it allows."""
    possible = []
    for step in steps:
        if shaker.lowest_hz <= step.frequency_hz <= shaker.highest_hz:
            most = shaker.allowed(step.frequency_hz, weight(leg_kg, step.added_mass_kg))
            possible.append(replace(step, amplitude_m_s2=min(step.amplitude_m_s2, most)))
    return tuple(possible)


def thesis(loads_kg: tuple[float, ...] = ADDED_MASSES_KG, seconds: float = THESIS_S) -> tuple[Step, ...]:
    """The thesis' protocol: nine sines under each load."""
    return tuple(Step(SINE, f, load, THESIS_AMPLITUDE, seconds) for load in loads_kg for f in THESIS_HZ)


def shaking_s(steps: Sequence[Step]) -> float:
    """How long the shaker shakes [s], without what it takes to find its level."""
    return float(sum(step.seconds for step in steps))


def exposure(steps: Sequence[Step]) -> Dose:
    """What a person gets of steps; those of several tones count as one at their frequency, of the same amplitude."""
    return sum(
        (Dose.of_sine(s.frequency_hz, s.amplitude_m_s2, s.seconds + LEVEL_S) for s in steps if s.frequency_hz), Dose()
    )
