"""A planned session as a file: what `python -m fasbody.acquire --plan FILE` runs, and this room reads again."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fasbody.acquire.person import LEVEL_S, Dose
from fasbody.acquire.plan import PROTOCOL, steps_in
from fasbody.console import to_json, write_whole
from fasbody.exceptions import InputFileError
from identification.plan.candidates import Step
from identification.plan.shaker import KINDS

_TONES = 6


@dataclass(frozen=True)
class Protocol:
    """Steps in the order in which they are recorded, and whom they are for.

    Attributes:
        steps: recordings.
        subject, body_mass_kg, posture: of the person.
        seed: of the plan.
    """

    steps: tuple[Step, ...]
    subject: str
    body_mass_kg: float
    posture: str
    seed: int

    def document(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "format": PROTOCOL, "subject": self.subject, "body_mass_kg": self.body_mass_kg, "posture": self.posture,
            "seed": self.seed, "protocol": [asdict(step) for step in self.steps],
        }  # fmt: skip

    def write(self, path: Path) -> Path:
        """Write it, whole or not at all."""
        return write_whole(path, to_json(self.document()) + "\n")

    @classmethod
    def read(cls, path: Path) -> "Protocol":
        """Read it.

        Raises:
            InputFileError: it is no plan, or a step that cannot be meant.
        """
        document, planned = steps_in(path)
        steps = []
        for number, (row, step) in enumerate(zip(document["protocol"], planned, strict=True), start=1):
            tones, sensors = row.get("tones", 1), row.get("sensors", ["malleolus"])
            place = f"step {number}"
            if step.kind not in KINDS:
                raise InputFileError(path, f"{place}: unknown kind {step.kind!r}", f"valid: {', '.join(KINDS)}")
            if isinstance(tones, bool) or not isinstance(tones, int) or not 1 <= tones <= _TONES:
                raise InputFileError(path, f"{place}: tones = {tones!r}", f"valid: 1 to {_TONES}")
            if not (isinstance(sensors, list) and sensors and all(isinstance(s, str) for s in sensors)):
                raise InputFileError(path, f"{place}: sensors = {sensors!r}", 'valid: names, ["malleolus"] for example')
            steps.append(
                Step(
                    step.kind, step.frequency_hz, step.added_mass_kg, step.amplitude_m_s2, step.seconds, tones,
                    tuple(sensors),
                )
            )  # fmt: skip
        seed = document.get("seed", 0)
        person = (
            str(document.get("subject", "1")),
            float(document["body_mass_kg"]),
            str(document.get("posture", "midstance")),
        )
        return cls(tuple(steps), *person, seed if isinstance(seed, int) else 0)


def exposure(steps: Sequence[Step]) -> Dose:
    """What a person gets of steps; those of several tones count as one at their frequency, of the same amplitude."""
    return sum(
        (Dose.of_sine(s.frequency_hz, s.amplitude_m_s2, s.seconds + LEVEL_S) for s in steps if s.frequency_hz), Dose()
    )


def shaking_s(steps: Sequence[Step]) -> float:
    """How long the shaker shakes [s], without what it takes to find its level."""
    return float(sum(step.seconds for step in steps))
