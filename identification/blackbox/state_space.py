"""State-space models in innovations form: response, simulation, prediction, conversions."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from identification.blackbox.data import Series
from identification.blackbox.frequency import Response
from identification.blackbox.least_squares import project_states
from identification.blackbox.polynomial import PolynomialModel


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
    """Innovations form x(t+1) = A x + B u + K e, Eq. (3.9); y = C x + D u + e, Eq. (3.10).

    Attributes:
        A, B, C, D, K: arrays of shapes (n, n), (n,), (n,), scalar, (n,).
        x0: state at the first sample of the (first) estimation recording, shape (n,), Eq. (3.11).
        loss: mean squared one-step prediction error [output unit squared].
        samples: number of residuals.
        sample_time: seconds.
        singular_values: of the weighted data matrix, from which the order is chosen.
        transfer: the same plant as an output-error polynomial with the covariance of its coefficients.
        warnings: sentences for the user.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: float
    K: np.ndarray
    x0: np.ndarray
    loss: float
    samples: int
    sample_time: float
    singular_values: np.ndarray
    transfer: PolynomialModel
    warnings: tuple[str, ...] = field(default=())
    structure: str = "ss"

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.B)

    @property
    def parameters(self) -> int:
        """Independent coefficients: 2 n + 1 of the plant and n of the noise model."""
        return 3 * self.order + 1

    def poles(self) -> np.ndarray:
        """Eigenvalues of A, shape (n,)."""
        return np.linalg.eigvals(self.A)

    def zeros(self) -> np.ndarray:
        """Zeros of the plant, shape (n,)."""
        return self.transfer.zeros()

    @property
    def stable(self) -> bool:
        """Whether free simulation stays bounded."""
        return bool(np.all(np.abs(self.poles()) < 1.0))

    def response(self, frequency_hz: ArrayLike) -> Response:
        """Frequency response; the covariance is that of the output-error form linearised here."""
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        z = np.exp(2j * np.pi * frequency * self.sample_time)
        inverse = np.linalg.solve(
            z[:, None, None] * np.eye(self.order) - self.A, np.tile(self.B[:, None], (len(z), 1, 1)).astype(complex)
        )
        return Response(frequency, (inverse[:, :, 0] @ self.C) + self.D, self.transfer.response(frequency).spread)

    def simulate(self, series: Series) -> np.ndarray:
        """Free simulation with the initial state that fits best, shape (N,); infinite where unstable."""
        if not self.stable:
            return np.full(len(series), np.inf)
        forced = modal_response(self.A, self.C, self.B[:, None], series.u[:, None]) + self.D * series.u
        free = free_responses(self.A, self.C, len(series))
        state, _ = project_states(series.y - forced, free)
        return forced + free @ state

    def predict(self, series: Series) -> np.ndarray:
        """One-step prediction by the innovations form, initial state fitted, shape (N,)."""
        observer = self.A - np.outer(self.K, self.C)
        gain = np.column_stack([self.B - self.K * self.D, self.K])
        forced = modal_response(observer, self.C, gain, np.column_stack([series.u, series.y])) + self.D * series.u
        free = free_responses(observer, self.C, len(series))
        state, _ = project_states(series.y - forced, free)
        return forced + free @ state

    def residuals(self, series: Series) -> np.ndarray:
        """One-step prediction errors, shape (N,)."""
        return series.y - self.predict(series)

    def to_state_space(self) -> Any:
        """The plant as `scipy.signal.StateSpace`."""
        return signal.StateSpace(self.A, self.B[:, None], self.C[None, :], np.array([[self.D]]), dt=self.sample_time)

    def to_transfer_function(self) -> Any:
        """The plant as `scipy.signal.TransferFunction`."""
        return self.transfer.to_transfer_function()

    def to_zeros_poles(self) -> Any:
        """The plant as `scipy.signal.ZerosPolesGain`."""
        return self.transfer.to_zeros_poles()

    def to_control(self) -> Any:
        """The plant as a python-control transfer function."""
        return self.transfer.to_control()

    @property
    def label(self) -> str:
        """Structure and order, as `SS (4)`."""
        return f"SS ({self.order})"

    def __str__(self) -> str:
        poles = ", ".join(f"{p:.4f}" for p in self.poles())
        return f"{self.label}, loss {self.loss:.5g}, poles {poles}"


def modal_response(A: np.ndarray, C: np.ndarray, B: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """C x(t) of x(t+1) = A x + B inputs from rest, by first-order filters along the eigenvectors; shape (N,)."""
    values, vectors = np.linalg.eig(A)
    drive = inputs @ np.linalg.solve(vectors, B.astype(complex)).T
    seen = C @ vectors
    return np.sum(
        [(c * signal.lfilter([0.0, 1.0], [1.0, -p], drive[:, k])).real
         for k, (p, c) in enumerate(zip(values, seen, strict=True))], axis=0,
    )  # fmt: skip


def free_responses(A: np.ndarray, C: np.ndarray, length: int) -> np.ndarray:
    """Outputs C A^t from each unit initial state, and a level, shape (length, n + 1)."""
    values, vectors = np.linalg.eig(A)
    powers = np.vander(values, length, increasing=True).T
    return np.column_stack([((powers * (C @ vectors)) @ np.linalg.inv(vectors)).real, np.ones(length)])
