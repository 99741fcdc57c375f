"""What is to be recorded, and whether it is valid; a session that was planned in a file."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from fasbody.acquire import folder
from fasbody.acquire.documents import read_json
from fasbody.acquire.level import Safety
from fasbody.acquire.person import LEVEL_S, Dose, dose_of
from fasbody.acquire.timeline import LIMITS
from fasbody.exceptions import SettingError
from fasbody.foot.shaker import PEAK_TO_PEAK
from fasbody.recording.recording import Condition


@dataclass(frozen=True)
class Plan:
    """What to record.

    Attributes:
        study: folder.
        frequencies_hz: one recording each; (None,) for broadband or unknown excitation.
        condition: of all recordings; its frequency is set for each.
        seconds: length of each recording.
        peak_to_peak: base acceleration [m/s^2].
        wait_s: wait at the level before recording.
        retries: how often a recording with missing samples, or whose board stalled, is repeated.
        origin: "measured" or "synthetic".
        safety: limits of the excitation.
        truth: of a synthetic study, written with its first recording.
        one_mass: both sensors are on one mass.
        again: options with which the command begins at this recording; empty if its frequencies state them.
    """

    study: Path
    frequencies_hz: tuple[float | None, ...]
    condition: Condition
    seconds: float = 10.0
    peak_to_peak: float = PEAK_TO_PEAK
    wait_s: float = 0.5
    retries: int = 2
    origin: str = "measured"
    safety: Safety = field(default_factory=Safety)
    truth: Mapping[str, Any] | None = None
    one_mass: bool = False
    again: str = ""

    @property
    def dose(self) -> Dose:
        """What the subject will get, finding each level included."""
        frequencies_hz = [f for f in self.frequencies_hz if f is not None]
        sines = (Dose.of_sine(f, 0.5 * self.peak_to_peak, self.seconds + LEVEL_S) for f in frequencies_hz)
        return sum(sines, Dose())

    def check(self, generator: bool) -> None:
        """Refuse invalid settings, before anything moves.

        Raises:
            SettingError: which option, and what would be valid.
            InputFileError: the study is no folder, of another origin or truth, or has another body mass.
        """
        if not 0.1 <= self.seconds <= 3600:
            raise SettingError(f"a recording of {self.seconds:g} s is not possible (valid: 0.1 to 3600).", "seconds")
        if not 0 < self.peak_to_peak < math.inf:
            raise SettingError(
                f"the base acceleration is {self.peak_to_peak:g} m/s^2; it must be positive.", "peak_to_peak"
            )
        if not 0 <= self.condition.added_mass_kg <= 100:
            raise SettingError(
                f"the added mass is {self.condition.added_mass_kg:g} kg (valid: 0 to 100).", "added_mass"
            )
        for frequency in self.frequencies_hz:
            if frequency is None:
                if generator:
                    raise SettingError("the generator needs a frequency: give --frequency or --sweep.")
                continue
            if not 3 <= frequency <= 500:
                raise SettingError(f"{frequency:g} Hz is no excitation for a foot (valid: 3 to 500).")
            if self.seconds * frequency < LIMITS["periods"]:
                raise SettingError(f"{self.seconds:g} s hold fewer than 3 periods of {frequency:g} Hz; record longer.")
            if generator:
                self.safety.check(frequency, self.peak_to_peak)
        folder.check(self.study, self.condition, self.origin, self.truth)
        if generator:
            within(self.study, self.condition.subject, self.dose, self.safety)


def within(study: Path, subject: str, dose: Dose, safety: Safety) -> None:
    """Refuse a dose that, with what the subject had today, is beyond the limits of a day."""
    before = dose_of(study, subject)
    if beyond := (before + dose).beyond(safety.daily_a8, safety.daily_vdv):
        had = f" with the {before.seconds:.0f} s had today" if before.seconds else ""
        stated = "{quantity} {value:.3g}, and may be {valid}".format(**beyond)
        remedy = "record less, for a shorter time, at a lower level, or on another day"
        raise SettingError(f"the exposure planned{had} has {stated}; {remedy}.", **beyond)


#: Format of a file of planned steps.
PROTOCOL = "fasbody protocol 1"


@dataclass(frozen=True)
class PlannedStep:
    """One recording of a planned session: `amplitude_m_s2` is half of peak to peak; `kind` as in the plan."""

    frequency_hz: Annotated[float, Field(ge=3, le=500)]
    added_mass_kg: Annotated[float, Field(ge=0, le=100)]
    amplitude_m_s2: Annotated[float, Field(ge=0.01, le=100)]
    seconds: Annotated[float, Field(ge=0.1, le=3600)]
    kind: str = "sine"

    def of(self, plan: Plan) -> Plan:
        """The plan of this recording, in all else as another."""
        return replace(
            plan, frequencies_hz=(self.frequency_hz,), seconds=self.seconds, peak_to_peak=2 * self.amplitude_m_s2,
            condition=replace(plan.condition, added_mass_kg=self.added_mass_kg),
        )  # fmt: skip


@dataclass(frozen=True)
class PlannedSession:
    """A file of planned steps, as `fasbody plan` writes it.

    Attributes:
        format: `PROTOCOL`.
        body_mass_kg: of the subject.
        protocol: its steps in order.
        subject: whose.
    """

    format: Literal["fasbody protocol 1"]
    body_mass_kg: Annotated[float, Field(ge=20, le=300, description="20 to 300 kg")]
    protocol: Annotated[tuple[PlannedStep, ...], Field(min_length=1)]
    subject: str = "1"

    @classmethod
    def read(cls, file: Path) -> Self:
        """From a file.

        Raises:
            InputFileError: it is no such session, or a value is none of a step.
        """
        return read_json(cls, file, "planned session")
