r"""Limits for the person on the shaker: weighted exposure, and what is checked before anything moves.

The base's vertical acceleration is weighted by W_k of ISO 2631-1, whose transfer function ISO 8041 states. From the
weighted acceleration a_w come the daily exposure of Directive 2002/44/EC and the vibration dose value:

    A(8) = (int a_w^2 dt / 8 h)^(1/2)        VDV = (int a_w^4 dt)^(1/4)

The limits are made for people who sit or stand with their whole body on what shakes, or hold a tool. For one foot on a
shaker no standard has any: these are stricter, as less of the body moves.
"""

import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import numpy as np

from fasbody.console import to_json, write_whole
from fasbody.exceptions import AcquisitionError, InputFileError

SESSION = "session.json"
#: Exposure action value and limit of Directive 2002/44/EC, article 3: A(8) [m/s^2] and VDV [m/s^1.75].
ACTION, LIMIT = 0.5, 1.15
VDV_ACTION, VDV_LIMIT = 9.1, 21.0
_DAY_S = 8 * 3600.0
_BUTTERWORTH = 1 / math.sqrt(2)
#: The weighted signal is evaluated in pieces so long [s]: four periods of the slowest excitation.
_PIECE_S = 1.0
#: So long is the base at its level before a recording, finding it included, by the virtual bench [s].
LEVEL_S = 4.0
#: What whoever runs the session confirms.
CHECKLIST = (
    "The person has agreed, knows that they can stop at any time, and says stop or lifts the foot if it hurts.",
    "The amplifier's emergency stop is within reach of the person or of whoever watches them, and was tried.",
    "Sitting or standing as planned, the foot flat, nobody leaning on table or shaker.",
    "The load lies on the knee alone, and cannot slip.",
    "No pregnancy, pacemaker, fresh injury, thrombosis, neuropathy or implant in the leg.",
)


def w_k(hz: np.ndarray | float) -> np.ndarray:
    """Magnitude of the vertical weighting W_k at frequencies (n,) [Hz]; ISO 8041, section 5.6."""
    s = 1j * np.maximum(np.asarray(hz, float), 1e-9)
    limits = _second(s, 0.4, _BUTTERWORTH, high=True) * _second(s, 100.0, _BUTTERWORTH)
    transition = (1 + s / 12.5) * _second(s, 12.5, 0.63)
    step = _second(s, 3.35, 0.91) / _second(s, 2.37, 0.91) * (2.37 / 3.35) ** 2
    return np.abs(limits * transition * step)


def _second(s: np.ndarray, corner_hz: float, quality: float, high: bool = False) -> np.ndarray:
    """A second-order low-pass, or high-pass, at s = i f."""
    x = corner_hz / s if high else s / corner_hz
    return np.asarray(1 / (1 + x / quality + x**2))


@dataclass(frozen=True)
class Dose:
    """Weighted exposure; doses add.

    Attributes:
        square: integral of a_w^2 [m^2/s^3].
        fourth: integral of a_w^4 [m^4/s^7].
        seconds: of shaking.

    Example:
        >>> print(Dose.of_sine(20.0, 8.95, 90.0))
        a_w 4.03 m/s^2 for 90 s: A(8) 0.225 m/s^2, VDV 13.7 m/s^1.75
    """

    square: float = 0.0
    fourth: float = 0.0
    seconds: float = 0.0

    def __add__(self, other: "Dose") -> "Dose":
        return Dose(self.square + other.square, self.fourth + other.fourth, self.seconds + other.seconds)

    @classmethod
    def of_sine(cls, hz: float, amplitude_m_s2: float, seconds: float) -> Self:
        """Of a sine of this amplitude, not rms."""
        a = float(w_k(hz)) * amplitude_m_s2
        return cls(a**2 / 2 * seconds, 3 / 8 * a**4 * seconds, seconds)

    @classmethod
    def of(cls, values: np.ndarray, rate_hz: float) -> Self:
        """Of a signal (n,) [m/s^2]; its mean does not count."""
        spectrum = np.fft.rfft(values - values.mean())
        hz = np.fft.rfftfreq(values.size, 1 / rate_hz)
        weighted = np.fft.irfft(spectrum * w_k(hz), values.size)
        return cls(float(np.sum(weighted**2) / rate_hz), float(np.sum(weighted**4) / rate_hz), values.size / rate_hz)

    @property
    def a_w(self) -> float:
        """Weighted acceleration [m/s^2 rms] while it shakes."""
        return math.sqrt(self.square / self.seconds) if self.seconds else 0.0

    @property
    def a8(self) -> float:
        """Daily exposure A(8) [m/s^2]."""
        return math.sqrt(self.square / _DAY_S)

    @property
    def vdv(self) -> float:
        """Vibration dose value [m/s^1.75]."""
        return self.fourth**0.25

    def __str__(self) -> str:
        return (
            f"a_w {self.a_w:.3g} m/s^2 for {self.seconds:.3g} s: A(8) {self.a8:.3g} m/s^2, VDV {self.vdv:.3g} m/s^1.75"
        )

    def sentence(self) -> str:
        """With what the directive has, and for whom it was made."""
        which = {
            (True, True): "Both exceed the action values",
            (True, False): "A(8) exceeds its action value, the VDV does not",
            (False, True): "The VDV exceeds its action value, A(8) does not",
            (False, False): "Neither exceeds its action value",
        }[self.a8 > ACTION, self.vdv > VDV_ACTION]
        return (
            f"Vibration exposure, weighted by W_k: {self}. These are {100 * self.a8 / LIMIT:.0f} % and "
            f"{100 * self.vdv / VDV_LIMIT:.0f} % of the daily limits of the European directive on vibration at work "
            f"({LIMIT:g} and {VDV_LIMIT:g}). {which} ({ACTION:g} and {VDV_ACTION:g}). "
            "The directive applies to people who sit or stand on a vibrating surface; it has no limit for one foot."
        )

    def beyond(self, a8: float, vdv: float) -> dict[str, Any]:
        """Facts of an error where one of two limits of a day is exceeded; none where neither is."""
        if self.a8 > a8:
            facts = {"setting": "max_exposure", "quantity": "A(8) in m/s^2", "value": self.a8}
            return facts | {"valid": f"at most {a8:g} (--max-exposure)"}
        if self.vdv > vdv:
            facts = {"setting": "max_vdv", "quantity": "VDV in m/s^1.75", "value": self.vdv}
            return facts | {"valid": f"at most {vdv:g} (--max-vdv)"}
        return {}

    def document(self) -> dict[str, float]:
        """As plain data."""
        return {
            "square": self.square, "fourth": self.fourth, "seconds": self.seconds, "a_w_m_s2": self.a_w,
            "a8_m_s2": self.a8, "vdv_m_s175": self.vdv,
        }  # fmt: skip


class Meter:
    """Adds up what a person gets while the shaker is on, and ends it at a limit.

    Args:
        before: what they had that day.
        limit_a8: A(8) beyond which nothing goes on [m/s^2].
        rate_hz: of the samples.
        limit_vdv: and VDV [m/s^1.75].
    """

    def __init__(self, before: Dose, limit_a8: float, rate_hz: float, limit_vdv: float = VDV_LIMIT) -> None:
        self._sum, self._limits, self._rate_hz = before, (limit_a8, limit_vdv), rate_hz
        self._piece: list[np.ndarray] = []

    def add(self, base: np.ndarray) -> None:
        """The base's next samples (n,) [m/s^2]."""
        self._piece.append(base)
        if sum(map(len, self._piece)) >= _PIECE_S * self._rate_hz:
            self._sum, self._piece = self.dose, []
        if beyond := self._sum.beyond(*self._limits):
            stated = "{quantity} {value:.3g}, and may be {valid}".format(**beyond)
            sentence = f"the day's exposure has {stated}; output off. Go on another day."
            raise AcquisitionError(sentence, **beyond)

    @property
    def dose(self) -> Dose:
        """Of the day, to the last sample."""
        values = np.concatenate(self._piece) if self._piece else np.zeros(0)
        return self._sum + (Dose.of(values, self._rate_hz) if values.size > 1 else Dose())


def today() -> str:
    """The day, for a table of days."""
    return datetime.now(UTC).astimezone().date().isoformat()


def noted(study: Path) -> dict[str, Any]:
    """Contents of session.json of a study; empty where there is none that can be read."""
    try:
        document = json.loads((study / SESSION).read_text())
    except (OSError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}


def note(study: Path, **values: Any) -> Path:
    """Put values into session.json of a study, and leave what else is there."""
    return write_whole(study / SESSION, to_json(noted(study) | values) + "\n")


def dose_of(study: Path, subject: str) -> Dose:
    """What a subject had today, by session.json."""
    try:
        row = noted(study)["exposure"][subject][today()]
        return Dose(*(float(row[name]) for name in ("square", "fourth", "seconds")))
    except KeyError:
        return Dose()
    except (TypeError, ValueError):
        raise InputFileError(
            study / SESSION, f"does not say what subject {subject!r} had today as numbers", "take exposure out of it"
        ) from None


def keep(study: Path, subject: str, dose: Dose) -> None:
    """Write what a subject had today, beside the other days."""
    days = noted(study).get("exposure", {})
    note(study, exposure=days | {subject: days.get(subject, {}) | {today(): dose.document()}})
