"""What halving the table's amplitude does to a leg that lifts off; a mode of a linear chain does not notice."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fasbody.constants import MODEL_GRAVITY
from fasbody.leg.statements import ADDED_KG
from identification.rivals.pad_balance import TABLE_M_S2
from reproduction.load_effect.lift_off import NONE, NOT_SETTLED, steady

#: What is said of motions without a period.
WORDS = {NONE: "none", NOT_SETTLED: "not settled"}
_FINE_HZ = np.arange(10.0, 50.25, 0.5)


@dataclass(frozen=True)
class Row:
    """One amplitude of the table [m/s^2] and one load: peak of MB [Hz], and there the second harmonic over the first.

    Attributes:
        air: share of the time without contact, at the peak. repeats: which periods occur within 10-50 Hz.
    """

    table: float
    added_kg: float
    peak_hz: float
    MB: float
    second: float
    air: float
    repeats: str


def halved(values: Mapping[str, float]) -> list[Row]:
    """Full and half amplitude under the three loads.

    Args:
        values: constants of the mechanism lift-off, by name.
    """
    added = np.array(ADDED_KG)
    mass, ones = values["m"] + values.get("share", 0.0) * added, np.ones(added.size)
    rows = []
    for table in (TABLE_M_S2, TABLE_M_S2 / 2):
        k, exponent, c = (ones * values[name] for name in ("k", "exponent", "c"))
        motion = steady(_FINE_HZ, mass, values["rest"] + MODEL_GRAVITY * added, k, exponent, c, table)
        for load, kg in enumerate(ADDED_KG):
            at = int(np.abs(motion.response[load]).argmax())
            periods = sorted({int(p) for p in motion.period[load]}, key=lambda p: (p <= 0, abs(p)))
            repeats = ", ".join(WORDS.get(p, str(p)) for p in periods)
            MB = float(abs(motion.response[load, at]))
            rows.append(Row(table, kg, float(_FINE_HZ[at]), MB, float(motion.second[load, at]),
                            float(motion.air[load, at]), repeats))  # fmt: skip
    return rows
