"""What is to be recorded, and whether it can be meant."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fasbody.acquire import folder
from fasbody.acquire.level import Safety
from fasbody.acquire.timeline import Limits
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
        peak_to_peak: wanted base acceleration [m/s^2].
        settle_s: wait at the level before recording.
        retries: so often is a recording repeated that lost samples or whose board stalled.
        origin: "measured" or "synthetic".
        safety: limits of the excitation.
        limits: of the recordings.
        truth: of a synthetic study, written with its first recording.
    """

    study: Path
    frequencies_hz: tuple[float | None, ...]
    condition: Condition
    seconds: float = 10.0
    peak_to_peak: float = PEAK_TO_PEAK
    settle_s: float = 0.5
    retries: int = 2
    origin: str = "measured"
    safety: Safety = field(default_factory=Safety)
    limits: Limits = field(default_factory=Limits)
    truth: Mapping[str, Any] | None = None

    def check(self, generator: bool) -> None:
        """Refuse what cannot be meant, before anything moves.

        Raises:
            SettingError: which option, and what would be valid.
            InputFileError: the study is no folder, of another origin or truth, or knows another body mass.
        """
        if not 0.1 <= self.seconds <= 3600:
            raise SettingError(f"a recording of {self.seconds:g} s cannot be meant (valid: 0.1 to 3600).")
        if not 0 < self.peak_to_peak < math.inf:
            raise SettingError(f"the base acceleration is {self.peak_to_peak:g} m/s^2; it must be positive.")
        if not 0 <= self.condition.added_mass_kg <= 100:
            raise SettingError(f"the added mass is {self.condition.added_mass_kg:g} kg (valid: 0 to 100).")
        for frequency in self.frequencies_hz:
            if frequency is None:
                if generator:
                    raise SettingError("the generator needs a frequency: give --frequency or --sweep.")
                continue
            if not 3 <= frequency <= 500:
                raise SettingError(f"{frequency:g} Hz is no excitation for a foot (valid: 3 to 500).")
            if self.seconds * frequency < self.limits.periods:
                raise SettingError(f"{self.seconds:g} s hold fewer than 3 periods of {frequency:g} Hz; record longer.")
            if generator:
                self.safety.check(frequency, self.peak_to_peak)
        folder.check(self.study, self.condition, self.origin, self.truth)
