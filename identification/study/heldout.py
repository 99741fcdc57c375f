"""What a set of parameters says about a recording that was not used: predicted and measured malleolus harmonics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.foot.model import Foot
from identification.domains import resolved
from identification.engines.engine import Engine, Excitation
from identification.engines.mujoco import Rollouts
from identification.engines.twin import Twin
from identification.periodic import Line, split
from identification.space import DELAY

_TOLERANCE = 1e-6


@dataclass(frozen=True)
class HeldOut:
    """The error of one prediction.

    Attributes:
        file, frequency_hz, added_mass_kg: which recording. edge: its frequency was outside those used.
        chi_square: squared error over the noise of the measurement alone. numbers: harmonics count as two each.
        percent: norm of the error over that of the harmonics.
    """

    file: str
    frequency_hz: float
    added_mass_kg: float
    edge: bool
    chi_square: float
    numbers: int
    percent: float


def predicted(line: Line, foot: Foot, values: Mapping[str, float], twin: bool) -> np.ndarray:
    """Malleolus harmonics (H,) of a foot on the measured base, delayed like the measurement [m/s^2]."""
    excitation = resolved(line.excitation, foot, values, twin)
    engine: Engine[Excitation] = Twin(foot, [excitation]) if twin else Rollouts(foot, [excitation], ())
    y, _ = engine.orbit(0, values, (), _TOLERANCE)
    h = np.arange(1, line.count + 1)
    turn = np.exp(-2j * np.pi * line.base.frequency_hz * h * values.get(DELAY.name, 0.0))
    return 2 / y.size * np.fft.rfft(y)[h] * turn


def compare(line: Line, Y: np.ndarray, edge: bool = False) -> HeldOut:
    """Predicted harmonics (H,) against those measured; the base's noise through the measured transmissibility."""
    measured = line.malleolus.amplitudes
    gain = abs(measured[0] / line.base.amplitudes[0])
    std = np.hypot(line.malleolus.std, gain * line.base.std)
    error = split(Y - measured)
    condition = line.recording.condition
    return HeldOut(
        file=line.recording.file,
        frequency_hz=float(condition.frequency_hz or np.nan),
        added_mass_kg=condition.added_mass_kg,
        edge=edge,
        chi_square=float(np.sum((error / np.tile(std, 2)) ** 2)),
        numbers=error.size,
        percent=float(100 * np.linalg.norm(error) / np.linalg.norm(measured)),
    )


def interpolated(at: float, frequencies_hz: Sequence[float], values: Sequence[np.ndarray]) -> np.ndarray:
    """Search variables (p,) at a frequency, linear in log f between neighbours; the nearest one's beyond the ends."""
    order = np.argsort(frequencies_hz)
    x, q = np.log(np.asarray(frequencies_hz, float))[order], np.asarray(values)[order]
    return np.array([np.interp(np.log(at), x, column) for column in q.T])
