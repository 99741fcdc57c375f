"""What a laboratory can do: how its shaker moves, how long, with which loads and sensors, and how they hiss."""

from dataclasses import dataclass

import numpy as np

from fasbody.acquire.level import COMMANDED
from fasbody.exceptions import SettingError
from fasbody.foot.shaker import PEAK_TO_PEAK
from fasbody.recording.condition import ADDED_MASSES_KG

#: Kinds of excitation. A function generator speaks sines; a multisine needs a shaker that plays a waveform.
SINE, MULTISINE = "sine", "multisine"
KINDS = (SINE, MULTISINE)
#: Noise of a sample where nobody says one [m/s^2]: a person trembles and sways where a rig does not.
NOISE_M_S2 = 0.5
#: Who sits down anew is assumed to repeat to 2 to 5 % of a harmonic; where nobody says one, what lies between.
REPEATABILITY = 0.03
#: Standard deviations of the logarithms of both among people, where nobody says them: half of a factor
#: of two, and what makes 2 and 5 % of 3 %.
NOISE_STD, REPEATABILITY_STD = 0.35, 0.4


@dataclass(frozen=True)
class Shaker:
    """A shaker's limits and what stands around it.

    Attributes:
        lowest_hz, highest_hz, every_hz: frequencies, and the grid on which they are searched.
        amplitude_m_s2: largest amplitude of the base: half of peak to peak. The foot stays on the
            plate below gravity.
        displacement_m: largest travel of the base, peak to peak.
        force_n: largest force, None where it does not matter.
        table_kg: moving mass of the shaker and its plate, for the force.
        amplitudes_m_s2: that are tried; none for the largest alone.
        loads_kg: masses for the knee.
        kinds: of `KINDS`.
        sensors: that are worn, the malleolus' first.
        seconds: length of a recording.
        rate_hz: sampling rate.
        noise_m_s2: rms in a sample, of sensor and person; None for what recordings say, and
            about `NOISE_M_S2` before there are any.
        repeatability: relative standard deviation of a harmonic from one recording to the next;
            None likewise, and about `REPEATABILITY`.

    Raises:
        SettingError: a limit that cannot be meant.
    """

    lowest_hz: float = 10.0
    highest_hz: float = 50.0
    every_hz: float = 2.0
    amplitude_m_s2: float = 0.5 * PEAK_TO_PEAK
    displacement_m: float = 0.008
    force_n: float | None = None
    table_kg: float = 5.0
    amplitudes_m_s2: tuple[float, ...] = ()
    loads_kg: tuple[float, ...] = ADDED_MASSES_KG
    kinds: tuple[str, ...] = (SINE,)
    sensors: tuple[str, ...] = ("malleolus",)
    seconds: float = 10.0
    rate_hz: float = 1000.0
    noise_m_s2: float | None = None
    repeatability: float | None = None

    def __post_init__(self) -> None:
        limits = {
            "lowest frequency": (self.lowest_hz, 3.0, 500.0, "Hz"),
            "highest frequency": (self.highest_hz, 3.0, 500.0, "Hz"),
            "step of the frequencies": (self.every_hz, 0.1, 100.0, "Hz"),
            "amplitude": (self.amplitude_m_s2, 0.01, 100.0, "m/s^2"),
            "displacement": (self.displacement_m, 1e-6, 1.0, "m"),
            "table's mass": (self.table_kg, 0.0, 1e4, "kg"),
            "length of a recording": (self.seconds, 0.5, 3600.0, "s"),
            "sampling rate": (self.rate_hz, 50.0, 1e6, "Hz"),
            "force": (self.force_n, 0.1, 1e6, "N"),
            "noise": (self.noise_m_s2, 1e-6, 10.0, "m/s^2"),
            "repeatability": (self.repeatability, 0.0, 0.5, ""),
        }
        limits |= {f"amplitude {i + 1}": (a, 0.01, 100.0, "m/s^2") for i, a in enumerate(self.amplitudes_m_s2)}
        limits |= {f"load {i + 1}": (load, 0.0, 100.0, "kg") for i, load in enumerate(self.loads_kg)}
        for name, (value, low, high, unit) in limits.items():
            if value is not None and not low <= value <= high:
                size = f"{value:g} {unit}".strip()
                raise SettingError(f"the {name} is {size}; valid: {low:g} to {high:g}.")
        if self.highest_hz < self.lowest_hz:
            raise SettingError(
                f"the frequencies go from {self.lowest_hz:g} to {self.highest_hz:g} Hz; the lower comes first."
            )
        if not self.loads_kg:
            raise SettingError("no load is given; 0 is one.")
        for kind in self.kinds:
            if kind not in KINDS:
                raise SettingError(f"unknown kind of excitation {kind!r} (valid: {', '.join(KINDS)}).")
        if not self.kinds:
            raise SettingError(f"no kind of excitation is given (valid: {', '.join(KINDS)}).")

    @property
    def frequencies_hz(self) -> tuple[float, ...]:
        """The grid, with the highest frequency."""
        grid = np.arange(self.lowest_hz, self.highest_hz + 1e-9, self.every_hz)
        return tuple(sorted({*map(float, np.round(grid, 6)), self.highest_hz}))

    def allowed(self, frequency_hz: float, moving_kg: float) -> float:
        """The largest amplitude at a frequency [m/s^2]: by acceleration, force, and displacement with acquire's room.

        Args:
            frequency_hz: the lowest of the excitation.
            moving_kg: what the shaker feels of foot and load.
        """
        by_travel = 0.5 * COMMANDED * self.displacement_m * (2 * np.pi * frequency_hz) ** 2
        by_force = np.inf if self.force_n is None else self.force_n / max(self.table_kg + moving_kg, 1e-9)
        return float(min(self.amplitude_m_s2, by_travel, by_force))

    def amplitudes(self, frequency_hz: float, moving_kg: float) -> tuple[float, ...]:
        """The amplitudes to try at a frequency [m/s^2]: those that are wanted, each as far as the limits allow."""
        most = self.allowed(frequency_hz, moving_kg)
        return tuple(sorted({min(most, a) for a in self.amplitudes_m_s2 or (most,)}, reverse=True))
