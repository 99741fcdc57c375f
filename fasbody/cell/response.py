"""What a cell does on a shaken dish: response to base excitation from hertz to kilohertz.

Relative to the base, [M]{x''} + [C]{x'} + [K]{x} = {F(t)}, Eq. (5.1), has F = -M r a for a base acceleration a along r;
C is the loss of the standard linear solids, so that K(i omega) carries both. Everything is linear: results are per unit
of base motion.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fasbody.cell.tetmesh import NUCLEUS
from fasbody.cell.viscoelastic import ReducedCell, Solids


@dataclass(frozen=True)
class BaseResponse:
    """Frequency response to motion of the base along x, y and z in turn.

    Args:
        frequencies_hz: frequencies of the shaking (n,) [Hz].
        top: motion of the highest point over motion of the base, along the same axis, complex (3, n).
        nucleus: the same for the mean of the nucleus (3, n); NaN without one.
        relative_m: largest way of the top against the base (3, n) at a base acceleration of amplitude 1 m/s^2 [m].
    """

    frequencies_hz: NDArray[np.float64]
    top: NDArray[np.complex128]
    nucleus: NDArray[np.complex128]
    relative_m: NDArray[np.float64]

    @property
    def resonance_hz(self) -> NDArray[np.float64]:
        """Highest peak (3,) inside the range of the top's motion against the base per base displacement [Hz].

        NaN where the motion only rises towards an end of the range: an end is no resonance.
        """
        return np.array([self._peak(motion) for motion in np.abs(self.top - 1)])

    def _peak(self, motion: NDArray[np.float64]) -> float:
        inside = motion[1:-1]
        peaks = 1 + np.flatnonzero((inside > motion[:-2]) & (inside >= motion[2:]))
        return float(self.frequencies_hz[peaks[motion[peaks].argmax()]]) if len(peaks) else float("nan")

    def at(self, frequency_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Transmissibility of the top (3,) and its way against the base (3,) [m at 1 m/s^2], nearest frequency."""
        i = int(np.abs(self.frequencies_hz - frequency_hz).argmin())
        return np.abs(self.top[:, i]), self.relative_m[:, i]

    def document(self) -> dict[str, Any]:
        """Ready for JSON; transmissibilities as magnitudes."""
        return {
            "frequencies_hz": self.frequencies_hz,
            "top_transmissibility_xyz": np.abs(self.top),
            "nucleus_transmissibility_xyz": np.abs(self.nucleus),
            "relative_m_per_m_s2_xyz": self.relative_m,
            "resonance_hz_xyz": self.resonance_hz,
        }

    def __str__(self) -> str:
        none = f"none below {self.frequencies_hz[-1]:.4g} Hz"
        pairs = zip("xyz", self.resonance_hz, strict=True)
        peaks = ", ".join(f"{axis} {none if np.isnan(f) else f'{f:.4g} Hz'}" for axis, f in pairs)
        T, way = self.at(20.0)
        return (
            f"resonance (most motion of the top against the base, per base displacement): {peaks}\n"
            f"at 20 Hz the top moves {T[0]:.9g} times the base along x, and {way[0]:.3g} m against it at 1 m/s^2"
        )


def base_response(cell: ReducedCell, solids: Solids, frequencies_hz: NDArray[np.float64]) -> BaseResponse:
    """Shake the base at each frequency (n,) [Hz] along x, y and z; trust it up to `cell.reach_hz`."""
    assembly = cell.model.assembly
    shapes = assembly.expand(cell.basis)  # (m, nodes, 3)
    top = shapes[:, int(assembly.nodes_um[:, 1].argmax())]
    weight = assembly.regions[NUCLEUS].m.diagonal()
    inside = np.einsum("n,mnd->md", weight, shapes) / weight.sum() if weight.sum() > 0 else np.full(top.shape, np.nan)
    omega = 2 * np.pi * np.asarray(frequencies_hz, dtype=np.float64)
    at_top, at_nucleus = np.empty((2, 3, len(omega)), dtype=complex)
    one = np.eye(cell.basis.shape[1])
    for i, w in enumerate(omega):
        # per unit of base displacement the acceleration is -omega^2, so the load is omega^2 M r
        x = np.linalg.solve(cell.dynamic_stiffness(1j * w, solids) - w**2 * one, w**2 * cell.loads)
        at_top[:, i] = np.einsum("md,md->d", top, x)
        at_nucleus[:, i] = np.einsum("md,md->d", inside, x)
    return BaseResponse(np.asarray(frequencies_hz), 1 + at_top, 1 + at_nucleus, np.abs(at_top) / omega**2)
