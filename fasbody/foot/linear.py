"""Small motion of any foot model about the pose in which it stands: its matrices, without a time step.

linear = Linear(foot)
linear.transmissibility(np.array([10.0, 20.0]))             # complex (2,)
linear.start(20.0, [8.95])                                  # qpos, qvel and act of a rollout
"""

from collections.abc import Sequence

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.rest import corners_at_rest, eigenvalues, resting, slopes_at_rest
from fasbody.foot.steady_state import Balance

Array = np.ndarray


class Linear:
    """K + s C + s^2 M of what the engine computes, by differences of its inverse dynamics at rest.

    Args:
        foot: the model.
        balance: of the foot, where one was made already.

    Raises:
        SimulationError: it rests in no pose, or in one where something is about to touch or slip.
    """

    def __init__(self, foot: Foot, balance: Balance | None = None) -> None:
        self.foot, self._balance = foot, balance or Balance(foot)
        x = resting(self._balance)
        self._rest = self._balance.state(x)[0]
        self._slopes, names = slopes_at_rest(self._balance, x)
        does = "touches, stops or slips"
        if not names:
            names, does = corners_at_rest(self._balance, x), "has another spring or damper"
        if names:
            raise SimulationError(
                f"{foot.name}: {' and '.join(names)} {does} as soon as the foot moves at all, so that small motion "
                "about its pose of rest is not linear; press it, or leave a gap."
            )

    def transmissibility(self, frequency_hz: Array, sensor: str = "malleolus") -> Array:
        """Complex (n,) reading of a sensor over the acceleration of the base."""
        s = 2j * np.pi * np.asarray(frequency_hz, float)
        read = self._balance.reading(sensor) @ self._dynamic(s)
        ratio: Array = np.einsum("nc,nc->n", read, self._motion(s))
        return ratio

    def start(self, frequency_hz: float, base: Sequence[complex] | Array) -> tuple[Array, Array, Array]:
        """qpos, qvel and act at time zero of the steady motion under harmonics (h,) of the base [m/s^2]."""
        U = np.asarray(base, complex)
        s = 2j * np.pi * frequency_hz * np.arange(1, U.size + 1)
        x, nv = U[:, None] * self._motion(s), self._rest.size
        return self._rest + x[:, :nv].real.sum(0), (s @ x[:, :nv]).real, x[:, nv:].real.sum(0)

    def eigenvalues(self) -> Array:
        """(k,) of the motion while the base is held [1/s], each conjugate pair a mode that swings."""
        free = self._balance.free
        return eigenvalues(self._slopes[:, free][..., free])[0]

    def _dynamic(self, s: Array) -> Array:
        """Dynamic stiffness (n, r, c) at complex frequencies (n,) [1/s]."""
        powers = s[:, None] ** np.arange(3)
        stiffness: Array = np.einsum("np,prc->nrc", powers, self._slopes)
        return stiffness

    def _motion(self, s: Array) -> Array:
        """Coordinates and activations (n, c) under an acceleration exp(s t) of the base."""
        free, base = self._balance.free, self._balance.base
        D = self._dynamic(s)
        x = np.zeros(D.shape[::2], complex)
        x[:, base] = 1 / s**2
        x[:, free] = -np.linalg.solve(D[:, free][:, :, free], D[:, free, base, None] * x[:, base, None, None])[..., 0]
        return x
