"""Where a fit misses its recordings, and how well they repeat by themselves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fasbody.presentation import Tabled
from fasbody.recording.recording import Recording
from identification.harmonics import Measured
from identification.residual import Problem

#: Times its equal share of chi-square from which a recording, a harmonic or a sensor stands out.
STANDS_OUT = 2.0


@dataclass(frozen=True)
class Misfit(Tabled):
    """Shares of chi-square.

    Attributes:
        recordings: of each file.
        harmonics: of each harmonic, 1 the fundamental.
        sensors: of each sensor.
    """

    recordings: Mapping[str, float]
    harmonics: Mapping[int, float]
    sensors: Mapping[str, float]

    @classmethod
    def of(cls, problem: Problem, read: np.ndarray) -> "Misfit":
        """Of sensors that should read (R, S, H), with the weights of the problem."""
        squares = problem.squares(read)
        measured = problem.measured
        whole = max(float(squares.sum()), 1e-300)

        def shares(names: Sequence[Any], axes: tuple[int, int]) -> dict[Any, float]:
            return dict(zip(names, map(float, squares.sum(axes) / whole), strict=True))

        files = [line.recording.file for line in measured.lines]
        return cls(
            shares(files, (1, 2)),
            shares(range(1, squares.shape[2] + 1), (0, 1)),
            shares(measured.sensors, (0, 2)),
        )

    def standing_out(self) -> dict[str, dict[str | int, float]]:
        """What has more than twice its equal share, the largest first: by "recordings", "harmonics", "sensors"."""
        kinds: dict[str, Mapping[Any, float]] = {
            "recordings": self.recordings,
            "harmonics": self.harmonics,
            "sensors": self.sensors,
        }
        by_name = {}
        for kind, shares in kinds.items():
            most = sorted(shares.items(), key=lambda item: -item[1])
            by_name[kind] = {name: share for name, share in most if share * len(shares) > STANDS_OUT}
        return {kind: shares for kind, shares in by_name.items() if shares}


def repeats(measured: Measured) -> float | None:
    """Relative standard deviation of the transmissibility from one recording of a condition to the next.

    Pooled over all conditions that were recorded twice or more, and free of the sensors' noise; None where there is no
    such condition. No model has a part in it.

    Args:
        measured: harmonics of all recordings.
    """
    groups: dict[tuple[object, ...], list[int]] = {}
    for r, line in enumerate(measured.lines):
        groups.setdefault(_condition(line.recording), []).append(r)
    squares, noise, count = 0.0, 0.0, 0
    for rows in groups.values():
        if len(rows) > 1:
            base = measured.base[rows, 0]
            T = measured.output[rows, 0, 0] / base
            mean = T.mean()
            squares += float((np.abs(T - mean) ** 2).sum() / np.abs(mean) ** 2)
            variance = measured.output_std[rows, 0, 0] ** 2 + np.abs(T * measured.base_std[rows, 0]) ** 2
            noise += (len(rows) - 1) * float(np.mean(variance / np.abs(base) ** 2) / np.abs(mean) ** 2)
            count += len(rows) - 1
    if not count:
        return None
    return float(np.sqrt(max(0.0, 0.5 * squares - noise) / count))


def _condition(recording: Recording) -> tuple[object, ...]:
    c = recording.condition
    return c.subject, c.posture, c.added_mass_kg, round(c.frequency_hz or 0.0, 1)  # as measured, it has more digits
