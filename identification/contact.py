"""The force between foot and table over a cycle, against what gravity and the stated static force allow.

The model's pad pulls as well as it pushes; a foot that stands on a table is only pushed. By Newton's second law the
table presses with N = W + d/dt (sum of m v), W the static force and the sum over all bodies on the table. Where N is
below zero the foot would leave the table: then something else presses it down, or the recordings are of a foot that
lifts, of which the model knows nothing.

A foot that lifts leaves harmonics. To first order the pull that is missing, max(N, 0) - N, acts on the foot's mass
besides, and the linear response of the two masses says what that adds at the malleolus. Harmonics above the first that
lie as far from the model's speak for lifting; ones that lie much nearer speak against it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Shares of what lifting would add to the harmonics, above which they speak for it, and below which against it.
_FOR, _AGAINST = 0.5, 0.25


@dataclass(frozen=True, eq=False, repr=False)
class Contact:
    """The force of the table on the foot over one cycle of a recording, positive where it presses.

    Attributes:
        file, frequency_hz, added_mass_kg: of the recording.
        element: what carries the force in the model.
        static_force_n: that rests on the table without vibration.
        stated: it stands in study.toml, else it is the weight of the model's masses and the load.
        time_s, force_n: (n,) over one cycle.
        added: harmonics above the first that lifting would add at the malleolus, and measured: what
            the recording has beyond the model's, both over the first; None where nothing is known.
    """

    file: str
    frequency_hz: float
    added_mass_kg: float
    element: str
    static_force_n: float
    stated: bool
    time_s: np.ndarray
    force_n: np.ndarray
    added: float | None = None
    measured: float | None = None

    @property
    def share(self) -> float:
        """Share of the cycle in which the table would have to pull."""
        return float(np.mean(self.force_n < 0))

    @property
    def missing_n(self) -> float:
        """The force that something else must supply at least [N]."""
        return float(max(0.0, -self.force_n.min()))

    @property
    def harmonics(self) -> str:
        """What the harmonics say of lifting: "for", "against", "neither", or nothing."""
        if not self.share or not self.added or self.measured is None:
            return ""
        seen = self.measured / self.added
        return "for" if seen > _FOR else "against" if seen < _AGAINST else "neither"

    def __repr__(self) -> str:
        return f"{self.file}: {self.force_n.min():.3g} to {self.force_n.max():.3g} N on the table"

    def document(self) -> dict[str, Any]:
        """As plain data."""
        names = ("file", "frequency_hz", "added_mass_kg", "element", "static_force_n", "stated")
        about: dict[str, Any] = {name: getattr(self, name) for name in names}
        about |= {"share": self.share, "missing_n": self.missing_n}
        about |= {"harmonics_added": self.added, "harmonics_found": self.measured, "harmonics_speak": self.harmonics}
        return about | {"time_s": self.time_s.tolist(), "force_n": self.force_n.tolist()}

    def sentence(self) -> str:
        """What cannot be, in words; nothing where the table only presses."""
        if not self.share:
            return ""
        source = "the static force (known.static_force_n in study.toml)"
        source = source if self.stated else "the weight of leg and load"
        element = self.element.replace("_", " ")
        text = (
            f"At {self.frequency_hz:.4g} Hz under {self.added_mass_kg:g} kg ({self.file}) the model's {element} "
            f"pulls on the table for {100 * self.share:.0f} % of the cycle, where a real foot would lift off. To hold "
            f"it down, a force of at least {self.missing_n:.3g} N would be needed in addition to {source} "
            f"({self.static_force_n:.3g} N)."
        )
        if self.harmonics:
            added, estimated = 100 * (self.added or 0.0), 100 * (self.measured or 0.0)
            word = {
                "for": "so the foot probably lifted off",
                "against": "so the foot probably did not lift off",
                "neither": "so lift-off is neither shown nor excluded",
            }
            text += (
                f" Lift-off would add harmonics of about {added:.2g} % of the fundamental at the malleolus. Those "
                f"measured differ from the model's by {estimated:.2g} % of the fundamental, {word[self.harmonics]}."
            )
        return text


def summary(contacts: Sequence[Contact]) -> str:
    """The worst of all recordings in words, and how many are like it; nothing where the table only presses."""
    lifted = [contact for contact in contacts if contact.share]
    if not lifted:
        return ""
    worst = max(lifted, key=lambda contact: contact.missing_n)
    text = worst.sentence()
    return text + (f" {len(lifted)} of {len(contacts)} recordings are affected." if len(contacts) > 1 else "")
