"""State-space models in innovations form: response, simulation, prediction, conversions."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from fasbody.presentation import Tabled
from identification.blackbox.data import Series
from identification.blackbox.filters import as_columns
from identification.blackbox.frequency import Response
from identification.blackbox.least_squares import project_states
from identification.blackbox.polynomial import PolynomialModel, control_package, model_part

DEFECTIVE = 1e8  # condition of the eigenvectors from which the recursion replaces them


@dataclass(frozen=True, eq=False)
class StateSpace(Tabled):
    """x(t+1) = A x + B u + K e, Eq. (3.9), y = C x + D u + e, Eq. (3.10), of any number of signals.

    Attributes:
        A: shape (n, n).
        B: shape (n,); of m inputs (n, m).
        C: shape (n,); of p outputs (p, n).
        D: a number; of several signals (p, m).
        K: shape (n,); of p outputs (n, p).
        sample_time: seconds.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray | float
    K: np.ndarray
    sample_time: float

    @property
    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A (n, n), B (n, m), C (p, n), D (p, m) and K (n, p), whatever the number of signals."""
        n = len(self.A)
        B, C = np.reshape(self.B, (n, -1)), np.reshape(self.C, (-1, n))
        return self.A, B, C, np.reshape(self.D, (len(C), B.shape[1])), np.reshape(self.K, (n, len(C)))

    def poles(self) -> np.ndarray:
        """Eigenvalues of A, shape (n,)."""
        return np.linalg.eigvals(self.A)

    def plant_response(self, frequency_hz: ArrayLike) -> np.ndarray:
        """Frequency response of the plant, complex, shape (M, p, m)."""
        A, B, C, D, _ = self.matrices
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        z = np.exp(2j * np.pi * frequency * self.sample_time)
        inside = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B.astype(complex)[None])
        return C @ inside + D

    def simulate(self, u: Series | ArrayLike, x0: ArrayLike = 0.0) -> np.ndarray:
        """Free simulation, shape (N,) or (N, p).

        Args:
            u: input (N,) or (N, m); or a recording, whose initial state and level are then fitted.
                For an unstable model the answer to a recording is infinite.
            x0: state at the first sample of an input alone, shape (n,).
        """
        A, B, C, D, _ = self.matrices
        inputs = as_columns(u.u if isinstance(u, Series) else np.asarray(u, dtype=float))
        if not isinstance(u, Series):
            out = run(A, B, C, inputs, x0)[0] + inputs @ D.T
        elif np.abs(self.poles()).max(initial=0.0) >= 1.0:
            out = np.full((len(u), len(C)), np.inf)
        else:
            out = with_free_motion(A, C, as_columns(u.y), driven(A, B, C, inputs) + inputs @ D.T)
        return out.reshape(len(inputs), *np.shape(self.D)[:1])

    def predict(self, series: Series) -> np.ndarray:
        """One-step prediction, initial state and level fitted, shape (N,) or (N, p)."""
        A, B, C, D, K = self.matrices
        u, y = as_columns(series.u), as_columns(series.y)
        observer, gain = A - K @ C, np.hstack([B - K @ D, K])
        forced = driven(observer, gain, C, np.hstack([u, y])) + u @ D.T
        return with_free_motion(observer, C, y, forced).reshape(series.y.shape)

    def residuals(self, series: Series) -> np.ndarray:
        """One-step prediction errors, shape (N,) or (N, p)."""
        return series.y - self.predict(series)

    def to_state_space(self) -> Any:
        """The plant as `scipy.signal.StateSpace`."""
        A, B, C, D, _ = self.matrices
        return signal.StateSpace(A, B, C, D, dt=self.sample_time)

    def to_control(self, part: str = "plant") -> Any:
        """The plant, or with "noise" the way from e to y, as a python-control `StateSpace`."""
        A, B, C, D, K = self.matrices
        B, D = model_part(part, (B, D), (K, np.eye(len(C))))
        return control_package().StateSpace(A, B, C, D, self.sample_time)


@dataclass(frozen=True, eq=False)
class StateSpaceModel(StateSpace):
    """State-space model of one input and one output, besides its matrices.

    Attributes:
        x0: state at the first sample of the (first) estimation recording, shape (n,), Eq. (3.11).
        loss: mean squared one-step prediction error [output unit squared].
        samples: number of residuals.
        singular_values: of the weighted data matrix, from which the order is chosen.
        transfer: the same plant as an output-error polynomial with its coefficients' covariance.
        warnings: sentences for the user.
    """

    D: float
    x0: np.ndarray
    loss: float
    samples: int
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

    @property
    def label(self) -> str:
        """Structure and order, as `SS (4)`."""
        return f"SS ({self.order})"

    def zeros(self) -> np.ndarray:
        """Zeros of the plant, shape (n,)."""
        return self.transfer.zeros()

    def response(self, frequency_hz: ArrayLike) -> Response:
        """Frequency response; the covariance is that of the output-error form linearised here."""
        shadow = self.transfer.response(frequency_hz)
        value = self.plant_response(frequency_hz)[:, 0, 0]
        return Response(shadow.frequency_hz, value, shadow.spread)

    def forecast(self, series: Series, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Output after the end of a recording for the input `u` (steps,), and its deviation.

        The state at the end is that of the one-step predictor; its initial state and a level are
        fitted to the recording.
        """
        observer = self.A - np.outer(self.K, self.C)
        # the answers to the data, to a level and to each initial state
        states = np.column_stack([np.zeros(self.order), np.zeros(self.order), np.eye(self.order)])
        answers = np.empty((len(series), states.shape[1]))
        for t, (value, measured) in enumerate(zip(series.u, series.y, strict=True)):
            answers[t] = self.C @ states
            answers[t, 0] += self.D * value
            states = observer @ states
            states[:, 0] += (self.B - self.K * self.D) * value + self.K * measured
            states[:, 1] -= self.K
        answers[:, 1] += 1.0
        fitted, _ = project_states(series.y - answers[:, 0], answers[:, 1:])
        state, level = states @ np.concatenate([[1.0], fitted]), fitted[0]
        noise, answer = np.zeros(len(u)), self.K
        for k in range(1, len(u)):
            noise[k] = noise[k - 1] + (self.C @ answer) ** 2
            answer = self.A @ answer
        return self.simulate(u, state) + level, np.sqrt(self.loss * (1.0 + noise))

    def to_transfer_function(self) -> Any:
        """The plant as `scipy.signal.TransferFunction`."""
        return self.transfer.to_transfer_function()

    def __str__(self) -> str:
        poles = ", ".join(f"{p:.4f}" for p in self.poles())
        return f"{self.label}, loss {self.loss:.5g}, poles {poles}"


def innovations(model: PolynomialModel | StateSpaceModel) -> StateSpaceModel:
    """A model in innovations form; a polynomial one in observer form over A F D of G and H."""
    if isinstance(model, StateSpaceModel):
        return model
    a, b, c, d, f = model.polynomials
    num, noise, den = np.convolve(b, d), np.convolve(c, f), np.convolve(np.convolve(a, f), d)
    size = max(len(num), len(noise), len(den), 2)
    num, noise, den = (np.pad(p, (0, size - len(p))) for p in (num, noise, den))
    A = np.eye(size - 1, k=1)
    A[:, 0] -= den[1:]
    B, C, K = num[1:] - den[1:] * num[0], np.eye(size - 1)[0], noise[1:] - den[1:]
    x0, unknown = np.zeros(size - 1), np.zeros(0)
    return StateSpaceModel(A, B, C, float(num[0]), K, model.sample_time, x0, model.loss, model.samples, unknown, model)


def run(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, inputs: np.ndarray, x0: ArrayLike = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """C x(t) of x(t+1) = A x + B inputs, shape (N, p), and the last state, whatever the poles."""
    out, state = np.empty((len(inputs), len(C))), np.broadcast_to(np.asarray(x0, float), len(A))
    for t, drive in enumerate(inputs @ B.T):
        out[t] = C @ state
        state = A @ state + drive
    return out, state


def unit_responses(A: np.ndarray, C: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Outputs C x(t) where a signal (N,) drives each state in turn from rest, shape (N, p, n)."""
    values, vectors = np.linalg.eig(A)
    if np.linalg.cond(vectors) > DEFECTIVE:
        states, out = np.zeros_like(A), np.empty((len(u), *C.shape))
        for t, value in enumerate(u):
            out[t] = C @ states
            states = A @ states + value * np.eye(len(A))
        return out
    modes = np.column_stack([signal.lfilter([0.0, 1.0], [1.0, -p], u.astype(complex)) for p in values])
    return np.real((modes[:, None, :] * (C @ vectors)) @ np.linalg.inv(vectors))


def driven(A: np.ndarray, B: np.ndarray, C: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """C x(t) of x(t+1) = A x + B inputs from rest, shape (N, p)."""
    return np.sum([unit_responses(A, C, u) @ b for u, b in zip(inputs.T, B.T, strict=True)], axis=0)


def free_responses(A: np.ndarray, C: np.ndarray, length: int) -> np.ndarray:
    """Outputs C A^t from each unit initial state, and each output's level, (length p, n + p)."""
    before = np.eye(1, length + 1)[0]  # a pulse one sample before the first
    free = unit_responses(A, C, before)[1:]
    levels = np.broadcast_to(np.eye(len(C)), (length, len(C), len(C)))
    return np.concatenate([free, levels], axis=2).reshape(length * len(C), -1)


def with_free_motion(A: np.ndarray, C: np.ndarray, y: np.ndarray, forced: np.ndarray) -> np.ndarray:
    """A forced motion (N, p) with the initial state and levels that fit y (N, p) best."""
    free = free_responses(A, C, len(y))
    return forced + (free @ project_states((y - forced).ravel(), free)[0]).reshape(y.shape)
