"""Units of acceleration, voltage and time as files, boards and data sheets write them, and what they are in SI."""

import re
from collections.abc import Mapping
from pathlib import Path

from fasbody.exceptions import InputFileError, unknown
from fasbody.text import shown

_G = 9.80665
#: Units that a CSV header or a board may carry behind a channel's name, and what they are in SI.
UNITS = {"m_s2": 1.0, "g": _G, "mm_s2": 1e-3, "cm_s2": 1e-2}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
#: Those and what else instruments write into their files.
ACCELERATIONS = UNITS | {
    "m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "m/s**2": 1.0, "gn": _G, "mm/s^2": 1e-3, "cm/s^2": 1e-2,
}  # fmt: skip
VOLTAGES = {"v": 1.0, "mv": 1e-3}
KNOWN_UNITS = frozenset(ACCELERATIONS | VOLTAGES | TIME_UNITS)
_SENSITIVITY = re.compile(
    r"\s*([-+.\deE]+)\s*(m?V)\s*/\s*(?P<open>\()?\s*(g|m\s*/\s*s(?:(?:\^|\*\*)?2|²))\s*(?(open)\))\s*", re.IGNORECASE
)


def name_and_unit(name: str) -> tuple[str, str]:
    """Name and unit of a heading such as ``base_m_s2``, ``base [m/s^2]``, ``Base (g)``."""
    text = name.strip().strip('"').lower()
    match = re.fullmatch(r"([a-z]+)\s*[\[(]\s*([^\])]*?)\s*[\])]", text)
    if match:
        return match[1], match[2]
    stem, _, unit = text.partition("_")
    return stem, unit


def factor(file: Path, channel: str, unit: str, valid: Mapping[str, float], line: int | None = None) -> float:
    """What turns a column's numbers into SI.

    Raises:
        InputFileError: the unit is none of `valid`.
    """
    if unit.lower() not in valid:
        raise InputFileError(file, unknown(f"unit of the column {channel!r}:", shown(unit), valid), line=line)
    return valid[unit.lower()]


def volts_per_m_s2(file: Path, name: str, text: str) -> float:
    """Sensitivity in V per m/s^2 from a data sheet's "100 mV/g".

    Raises:
        InputFileError: it says no such thing.
    """
    match = _SENSITIVITY.fullmatch(text)
    try:
        assert match is not None
        return float(match[1]) * VOLTAGES[match[2].lower()] / (_G if match[4].lower() == "g" else 1.0)
    except (AssertionError, ValueError):
        place = f"channels.{name}.sensitivity = {text!r}"
        raise InputFileError(file, place, 'valid: a number (unit per m/s^2), "100 mV/g" or "10.2 mV/(m/s^2)"') from None
