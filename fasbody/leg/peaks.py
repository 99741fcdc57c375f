"""Where the resonance of a leg lies under the added masses of Chapter 2, and which statements its curves meet."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fasbody.leg.chain import Array, Leg
from fasbody.leg.statements import ADDED_KG, RANGES_HZ, STATEMENTS, Curves, judge
from fasbody.presentation import Presented, Sheet
from fasbody.transmissibility.findings import FREQUENCIES_HZ

#: From below the thesis' range, where it assumes the principal resonance.
FINE_HZ = np.arange(3.0, 60.05, 0.1)


@dataclass(frozen=True, repr=False)
class Peaks(Presented):
    """MB, TB and TM of a leg, complex, each (3, f) on `frequency_hz`, by added mass.

    Attributes:
        model: name or file.
        frequency_hz: [Hz].
        MB, TB, TM: responses.
        held: which statement holds, by `STATEMENTS`.
        lowest_hz: first mode by load [Hz].
    """

    model: str
    frequency_hz: Array
    MB: Array
    TB: Array
    TM: Array
    held: tuple[bool, ...]
    lowest_hz: tuple[float, ...]

    figures: ClassVar[str] = "fasbody.leg.figures"
    plots: ClassVar[tuple[str, ...]] = ("peaks",)

    def highest(self, pair: str, load: int) -> tuple[float, float]:
        """Frequency [Hz] and size of the highest |T| within 10-50 Hz."""
        inside = (self.frequency_hz >= 10) & (self.frequency_hz <= 50)
        T = np.abs(getattr(self, pair)[load, inside])
        return float(self.frequency_hz[inside][T.argmax()]), float(T.max())

    def records(self) -> list[dict[str, Any]]:
        """One row a load."""
        rows = []
        for load, added in enumerate(ADDED_KG):
            row: dict[str, Any] = {"added_mass_kg": added, "lowest_mode_hz": self.lowest_hz[load]}
            for pair in ("MB", "TB", "TM"):
                hz, size = self.highest(pair, load)
                row |= {f"{pair}_peak_hz": hz, f"{pair}_peak": size}
            rows.append(row)
        return rows

    def sheet(self) -> Sheet:
        """Peaks by load, and how many statements hold."""
        rows = []
        for row, (low, high) in zip(self.records(), RANGES_HZ, strict=True):
            cells = [f"{row[f'{pair}_peak_hz']:.1f} ({row[f'{pair}_peak']:.2f})" for pair in ("MB", "TB", "TM")]
            measured = f"{low:g}-{high:g}"
            rows.append((f"{row['added_mass_kg']:g}", cells[0], measured, *cells[1:], f"{row['lowest_mode_hz']:.1f}"))
        columns = (
            "load [kg]", "MB", "MB measured", "TB", "TM", "first mode",
        )  # fmt: skip
        missed = [f"{s.pair}, {s.says}" for s, held in zip(STATEMENTS, self.held, strict=True) if not held]
        note = f"{sum(self.held)} of {len(STATEMENTS)} statements hold. Missed: {'; '.join(missed) or 'none'}."
        return Sheet(
            f"{self.model}: where the transmissibility is highest in 10-50 Hz [Hz], and how high",
            columns,
            rows,
            (note,),
        )


def peaks(leg: Leg, model: str) -> Peaks:
    """Responses of a leg with malleolus and tuberosity under 0, 2.3 and 4.5 kg.

    Args:
        leg: the chain.
        model: what to call it.

    Raises:
        ModelError: it has no such site, or nothing carries the added mass.
    """
    legs = [leg.with_added(added) for added in ADDED_KG]

    def at(site: str, frequency_hz: Array) -> Array:
        return np.array([loaded.at(site, frequency_hz) for loaded in legs])

    f = np.array(FREQUENCIES_HZ)
    MB, TB = at("malleolus", FINE_HZ), at("tuberosity", FINE_HZ)
    held = judge(Curves(at("malleolus", f), at("tuberosity", f) / at("malleolus", f)))
    lowest = tuple(float(loaded.modes()[0][0]) for loaded in legs)
    return Peaks(model, FINE_HZ, MB, TB, TB / MB, tuple(bool(h) for h in held), lowest)
