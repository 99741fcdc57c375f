"""Sines of one person under one load together: which of them does not fit the others."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

#: Sines that show what the others should be.
_ENOUGH = 5
#: A sine is out of line beyond this factor in amplitude and this angle [deg], and this times the others' scatter.
_FACTOR, _ANGLE_DEG, _SCATTER = 1.6, 20.0, 8.0


def expected(frequency_hz: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Malleolus over base (n,) of a mass on a spring whose stiffness and loss follow a power of frequency.

    Each sine gives a complex stiffness over mass, f^2 / (1 - 1 / H). The line through their logarithms is that of
    medians (Theil 1950, Sen 1968), which one wrong sine of five does not move.

    Args:
        frequency_hz: (n,) all different.
        H: (n,) complex, measured.
    """
    stiffness, x = np.log(frequency_hz**2 / (1 - 1 / H)), np.log(frequency_hz)
    turned = np.mod(stiffness.imag + 0.5, 2 * np.pi) - 0.5  # losses turn it by 0 to 90 degrees

    def line(y: np.ndarray) -> np.ndarray:
        slope = np.median([(y[j] - y[i]) / (x[j] - x[i]) for i, j in combinations(range(x.size), 2)])
        return slope * x + np.median(y - slope * x)

    return 1 / (1 - frequency_hz**2 / np.exp(line(stiffness.real) + 1j * line(turned)))


def out_of_line(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence on each sine that the others of its person, posture and load belie.

    Args:
        rows: of `checks.understood`, with subject, posture and load.
    """
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row.get("transmissibility") is not None:
            key = tuple(row.get(name) for name in ("subject", "posture", "added_mass_kg"))
            groups.setdefault(key, []).append(row)
    return [text for group in groups.values() for text in _of_one(group)]


def _of_one(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    f = np.array([row["frequency_hz"] for row in rows])
    if np.unique(np.round(f, 1)).size < max(_ENOUGH, f.size):  # a frequency twice has no slope between
        return []
    H = np.array([row["transmissibility"] * np.exp(1j * np.radians(row["phase_deg"])) for row in rows])
    off = np.log(H / expected(f, H))
    size, angle = (np.abs(part) for part in (off.real, off.imag))
    wrong = (size > np.maximum(np.log(_FACTOR), _SCATTER * np.median(size))) | (
        angle > np.maximum(np.radians(_ANGLE_DEG), _SCATTER * np.median(angle))
    )
    whose = "of its subject" if rows[0].get("subject") else "beside it, if of one person and load,"
    return [
        f"{row['file']}: the malleolus moves {np.exp(one.real):.3g} times as much as expected from "
        f"the other {f.size - 1} sines {whose}, with a phase difference of {np.degrees(one.imag):+.0f} degrees; "
        "check the file's units, columns and clocks."
        for row, one, odd in zip(rows, off, wrong, strict=True)
        if odd
    ]
