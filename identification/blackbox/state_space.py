"""State-space models in innovations form: response, simulation, prediction, conversions."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from fasbody.presentation import Tabled
from identification.blackbox.data import Series
from identification.blackbox.frequency import Response
from identification.blackbox.least_squares import project_states
from identification.blackbox.polynomial import PolynomialModel, checked_part, control_package


@dataclass(frozen=True, eq=False)
class StateSpaceModel(Tabled):
    """Innovations form x(t+1) = A x + B u + K e, Eq. (3.9); y = C x + D u + e, Eq. (3.10).

    Attributes:
        A: (n, n).
        B: (n,).
        C: (n,).
        D: scalar.
        K: (n,).
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

    def response(self, frequency_hz: ArrayLike) -> Response:
        """Frequency response; the covariance is that of the output-error form linearised here."""
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        z = np.exp(2j * np.pi * frequency * self.sample_time)
        inverse = np.linalg.solve(
            z[:, None, None] * np.eye(self.order) - self.A, np.tile(self.B[:, None], (len(z), 1, 1)).astype(complex)
        )
        return Response(frequency, (inverse[:, :, 0] @ self.C) + self.D, self.transfer.response(frequency).spread)

    def simulate(self, u: Series | ArrayLike, x0: ArrayLike = 0.0) -> np.ndarray:
        """Free simulation, shape (N,); of a recording with the initial state that fits best, infinite where unstable.

        Args:
            u: input (N,), or a recording.
            x0: state at the first sample of an input alone, shape (n,).
        """
        if not isinstance(u, Series):
            values = np.asarray(u, dtype=float)
            start = np.broadcast_to(np.asarray(x0, dtype=float), self.order)
            return self._run(values, start)[0]
        if np.abs(self.poles()).max(initial=0.0) >= 1.0:
            return np.full(len(u), np.inf)
        forced = modal_response(self.A, self.C, self.B[:, None], u.u[:, None]) + self.D * u.u
        return _with_free_motion(self.A, self.C, u.y, forced)

    def _run(self, u: np.ndarray, x0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (N,) and the last state (n,), sample by sample, whatever the poles."""
        y, state = np.empty(len(u)), x0
        for t, value in enumerate(u):
            y[t] = self.C @ state + self.D * value
            state = self.A @ state + self.B * value
        return y, state

    def forecast(self, series: Series, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Output after the end of a recording for the input `u` (steps,) there, and its standard deviation.

        The state at the end is that of the one-step predictor, its initial state and a level fitted to the recording.
        """
        observer = self.A - np.outer(self.K, self.C)
        states = np.column_stack([np.zeros(self.order), np.zeros(self.order), np.eye(self.order)])
        seen = np.empty((len(series), states.shape[1]))  # of the data, of a level, of each initial state
        for t, (value, measured) in enumerate(zip(series.u, series.y, strict=True)):
            seen[t] = self.C @ states
            seen[t, 0] += self.D * value
            states = observer @ states
            states[:, 0] += (self.B - self.K * self.D) * value + self.K * measured
            states[:, 1] -= self.K
        seen[:, 1] += 1.0
        fitted, _ = project_states(series.y - seen[:, 0], seen[:, 1:])
        state, level = states @ np.concatenate([[1.0], fitted]), fitted[0]
        spread, answer = np.zeros(len(u)), self.K
        for k in range(1, len(u)):
            spread[k] = spread[k - 1] + (self.C @ answer) ** 2
            answer = self.A @ answer
        return self._run(u, state)[0] + level, np.sqrt(self.loss * (1.0 + spread))

    def predict(self, series: Series) -> np.ndarray:
        """One-step prediction by the innovations form, initial state fitted, shape (N,)."""
        observer = self.A - np.outer(self.K, self.C)
        gain = np.column_stack([self.B - self.K * self.D, self.K])
        forced = modal_response(observer, self.C, gain, np.column_stack([series.u, series.y])) + self.D * series.u
        return _with_free_motion(observer, self.C, series.y, forced)

    def residuals(self, series: Series) -> np.ndarray:
        """One-step prediction errors, shape (N,)."""
        return series.y - self.predict(series)

    def to_state_space(self) -> Any:
        """The plant as `scipy.signal.StateSpace`."""
        return signal.StateSpace(self.A, self.B[:, None], self.C[None, :], np.array([[self.D]]), dt=self.sample_time)

    def to_transfer_function(self) -> Any:
        """The plant as `scipy.signal.TransferFunction`."""
        return self.transfer.to_transfer_function()

    def to_control(self, part: str = "plant") -> Any:
        """The plant, or with "noise" the way from e to y, as a python-control `StateSpace`."""
        plant = checked_part(part) == "plant"
        B, D = (self.B, self.D) if plant else (self.K, 1.0)
        return control_package().StateSpace(self.A, B[:, None], self.C[None, :], [[D]], self.sample_time)

    @property
    def label(self) -> str:
        """Structure and order, as `SS (4)`."""
        return f"SS ({self.order})"

    def __str__(self) -> str:
        poles = ", ".join(f"{p:.4f}" for p in self.poles())
        return f"{self.label}, loss {self.loss:.5g}, poles {poles}"


def innovations(model: PolynomialModel | StateSpaceModel) -> StateSpaceModel:
    """A model in innovations form; a polynomial one in observer form over the denominator A F D of G and H."""
    if isinstance(model, StateSpaceModel):
        return model
    a, b, c, d, f = model.polynomials
    num, noise, den = np.convolve(b, d), np.convolve(c, f), np.convolve(np.convolve(a, f), d)
    size = max(len(num), len(noise), len(den), 2)
    num, noise, den = (np.pad(p, (0, size - len(p))) for p in (num, noise, den))
    A = np.eye(size - 1, k=1)
    A[:, 0] -= den[1:]
    B, K = num[1:] - den[1:] * num[0], noise[1:] - den[1:]
    C = np.eye(size - 1)[0]
    return StateSpaceModel(
        A, B, C, float(num[0]), K, np.zeros(size - 1), model.loss, model.samples, model.sample_time, np.zeros(0), model
    )


def modal_response(A: np.ndarray, C: np.ndarray, B: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """C x(t) of x(t+1) = A x + B inputs from rest, by first-order filters along the eigenvectors; shape (N,)."""
    values, vectors = np.linalg.eig(A)
    drive = inputs @ np.linalg.solve(vectors, B.astype(complex)).T
    seen = C @ vectors
    return np.sum(
        [(c * signal.lfilter([0.0, 1.0], [1.0, -p], drive[:, k])).real
         for k, (p, c) in enumerate(zip(values, seen, strict=True))], axis=0,
    )  # fmt: skip


def _with_free_motion(A: np.ndarray, C: np.ndarray, y: np.ndarray, forced: np.ndarray) -> np.ndarray:
    """A forced motion (N,) with the initial state and level that fit `y` (N,) best."""
    free = free_responses(A, C, len(y))
    return forced + free @ project_states(y - forced, free)[0]


def free_responses(A: np.ndarray, C: np.ndarray, length: int) -> np.ndarray:
    """Outputs C A^t from each unit initial state, and a level, shape (length, n + 1)."""
    values, vectors = np.linalg.eig(A)
    powers = np.vander(values, length, increasing=True).T
    return np.column_stack([((powers * (C @ vectors)) @ np.linalg.inv(vectors)).real, np.ones(length)])
