"""The motion of rivals whose springs bend or whose shank swings, with the interface of the fit."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fasbody.foot.two_mass import PARAMETERS
from identification.motion import TwoMassMotion
from identification.rivals.steady import CONSTANTS, HARMONICS, INDEX, SERIES, Feet

#: Constants that only rivals have, behind those of the foot; w is a share of shank and load.
EXTRA = ("b_T", "p_T", "d_T", "b_F", "p_F", "d_F", "w", "f_w", "zeta_w")
#: Place of each in a row of parameters.
AT = {name: i for i, name in enumerate((*PARAMETERS, *EXTRA))}
_ROW = np.array([INDEX[name] for name in AT])


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Motions to start from: (C, R, 34) of `Feet`."""

    x: np.ndarray

    def rows(self, which: np.ndarray) -> "Coefficients":
        """Of some candidates."""
        return Coefficients(self.x[which])

    def replaced(self, other: "Coefficients", where: np.ndarray) -> "Coefficients":
        """With some candidates (C,) taken from another."""
        return Coefficients(np.where(where[:, None, None], other.x, self.x))


class RivalMotion(TwoMassMotion):
    """Motions of the two-mass foot with `EXTRA`, of which only `response` and `by_base` know."""

    def _feet(self, theta: np.ndarray) -> Feet:
        """Feet of candidates (C, R, 22), flat; the load is in their masses."""
        constants = np.zeros((theta[..., 0].size, len(CONSTANTS)))
        constants[:, _ROW] = theta.reshape(-1, len(_ROW))
        constants[:, INDEX["zeta_u"]] = 0.2
        none = np.zeros(len(constants))
        hz, U = np.tile(self.omega / (2 * np.pi), len(theta)), np.tile(self.base, (len(theta), 1))
        return Feet(constants, none, hz, none, U)

    def response(
        self, theta: np.ndarray, near: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:  # fmt: skip
        """See `Motion`."""
        (C, R, P), feet = theta.shape, self._feet(theta)
        start = np.zeros((C * R, 2 * SERIES.size)) if near is None else near.x.reshape(C * R, -1)
        x, moves = feet.solve(start)
        Y, D = feet.felt(x)[:, : self._count], feet.by_constants(x)[:, : self._count, _ROW]
        shape, lasts = (C, R, 1, self._count), np.asarray(moves.reshape(C, R).all(1))
        return Y.reshape(shape), D.reshape(*shape, P), lasts, Coefficients(x.reshape(C, R, -1))

    def by_base(self, theta: np.ndarray) -> np.ndarray:
        """See `Motion`."""
        feet = self._feet(theta[None])
        x, _ = feet.solve(np.zeros((len(feet), 2 * SERIES.size)))
        G = feet.by_base(x)[:, : self._count]
        G = G[..., np.r_[: self._count, HARMONICS : HARMONICS + self._count]]
        return np.concatenate([G.real, G.imag], 1)[:, None]
