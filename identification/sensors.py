"""Which accelerometers a fit compares with the model, and how well each is followed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fasbody.exceptions import SettingError, unknown

if TYPE_CHECKING:
    from fasbody.foot.model import Foot
    from fasbody.recording.harmonics import Harmonics
    from fasbody.recording.recording import Recording

#: The sensor that every recording has.
MALLEOLUS = ("malleolus",)


def chosen(
    recordings: Sequence["Recording"], foot: "Foot", chosen: Sequence[str] | None
) -> tuple[tuple[str, ...], list[str]]:
    """The sensors to fit, the malleolus first, and a sentence on each column that is not fitted.

    A column of a recording belongs to the accelerometer of its name in the model.

    Args:
        recordings: checked.
        foot: the model.
        chosen: names that were asked for, None for all that match.

    Raises:
        SettingError: a sensor that the model, or no recording, has; or the malleolus is left out.
    """
    available = [name for name in foot.sensors if name != "base"]
    read = list(dict.fromkeys(name for recording in recordings for name in recording.sensors))
    if chosen is None:
        missing = [name for name in read if name not in available]
        text = f"Not fitted, as no accelerometer of the model {foot.name} has such a name: {', '.join(missing)}."
        return (*MALLEOLUS, *(n for n in available if n in read and n not in MALLEOLUS)), [text] if missing else []
    for name in chosen:
        if name not in available:
            raise SettingError(
                f"{unknown('sensor', name, available)} in model {foot.name}; an accelerometer has its name."
            )
        if name not in read:
            raise SettingError(
                f"sensor {name!r} is asked for, and no recording has a column {name}_m_s2 that can serve."
            )
    if MALLEOLUS[0] not in chosen:
        raise SettingError(f"the malleolus is always fitted; give malleolus,{','.join(chosen)}.")
    return (*MALLEOLUS, *(name for name in dict.fromkeys(chosen) if name not in MALLEOLUS)), []


@dataclass(frozen=True)
class HarmonicFit:
    """One harmonic of one sensor, measured and modelled.

    Attributes:
        number: 1 for the fundamental.
        frequency_hz: its frequency.
        measured, model: complex amplitudes [m/s^2].
        std: noise of a real or imaginary part of the measured one [m/s^2].
    """

    number: int
    frequency_hz: float
    measured: complex
    model: complex
    std: float

    @property
    def off(self) -> float:
        """How many standard deviations of the sensor's noise lie between them."""
        return float(abs(self.model - self.measured) / self.std) if self.std > 0 else float("inf")

    def document(self) -> dict[str, float]:
        """Amplitudes and phases as plain data."""
        return {
            "harmonic": self.number, "frequency_hz": self.frequency_hz, "measured_m_s2": abs(self.measured),
            "measured_phase_deg": float(np.degrees(np.angle(self.measured))), "model_m_s2": abs(self.model),
            "model_phase_deg": float(np.degrees(np.angle(self.model))), "std_m_s2": self.std, "off": self.off,
        }  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class SensorFit:
    """One sensor in one recording, and how well the model follows it.

    Attributes:
        name: of the sensor.
        fit_percent: Eq. (3.20).
        residual_m_s2: root mean square of what the model leaves.
        measured, model: (n,) at the samples [m/s^2].
        harmonics: of a steady state, else none.
    """

    name: str
    fit_percent: float
    residual_m_s2: float
    measured: np.ndarray
    model: np.ndarray
    harmonics: tuple[HarmonicFit, ...] = ()

    @classmethod
    def of(
        cls,
        name: str,
        fit_percent: float,
        measured: np.ndarray,
        model: np.ndarray,
        harmonics: "Harmonics | None" = None,
        modelled: np.ndarray | None = None,
    ) -> "SensorFit":
        """A sensor from its traces (n,) and, of a steady state, its harmonics and the model's (H,)."""
        left = float(np.sqrt(np.mean((measured - model) ** 2)))
        lines: tuple[HarmonicFit, ...] = ()
        if harmonics is not None and modelled is not None:
            rows = zip(harmonics.amplitudes, modelled, harmonics.std, strict=True)
            f = harmonics.frequency_hz
            lines = tuple(
                HarmonicFit(h, h * f, complex(m), complex(y), float(s)) for h, (m, y, s) in enumerate(rows, 1)
            )
        return cls(name, fit_percent, left, measured, model, lines)

    def __repr__(self) -> str:
        return f"{self.name}: fit {self.fit_percent:.1f} %, residual {self.residual_m_s2:.3g} m/s^2"

    def document(self) -> dict[str, Any]:
        """As plain data, without the traces."""
        about = {"name": self.name, "fit_percent": self.fit_percent, "residual_m_s2": self.residual_m_s2}
        return about | {"harmonics": [line.document() for line in self.harmonics]}


def summary(recordings: Sequence[Sequence[SensorFit]]) -> list[str]:
    """A line on each sensor over all recordings; none where the malleolus is alone."""
    fits = [sensor for row in recordings for sensor in row]
    names = list(dict.fromkeys(sensor.name for sensor in fits))
    lines = []
    for name in names if len(names) > 1 else []:
        of_sensor = [sensor for sensor in fits if sensor.name == name]
        fit, left = (
            float(np.mean(x)) for x in ([s.fit_percent for s in of_sensor], [s.residual_m_s2 for s in of_sensor])
        )
        noun = "recording" if len(of_sensor) == 1 else "recordings"
        lines.append(f"{name}: fit {fit:.1f} %, residual {left:.3g} m/s², {len(of_sensor)} {noun}")
    return lines
