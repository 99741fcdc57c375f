"""State-space models by the subspace method, with order from singular values and an optional OE refinement."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import linalg

from fasbody.exceptions import SettingError
from identification.blackbox.data import Series
from identification.blackbox.least_squares import project_states, spread, triangle
from identification.blackbox.pem import Residuals
from identification.blackbox.pem import estimate as estimate_polynomial
from identification.blackbox.polynomial import Orders, PolynomialModel
from identification.blackbox.state_space import StateSpaceModel, free_responses, modal_response

UNREFINED = "plain subspace estimate without standard errors, for those of its linearisation would be too small"
BLOCK_ROWS = 16  # about 15 beats 30 on band-limited input; one more than the largest order requested


@dataclass(frozen=True, eq=False)
class Subspace:
    """The factor of the block Hankel data from which models of every order follow."""

    recordings: Sequence[Series]
    block_rows: int
    left: np.ndarray
    singular_values: np.ndarray

    def order(self) -> int:
        """The number of singular values that stand out of the noise: above three times the median of the last half."""
        floor = np.median(self.singular_values[self.block_rows // 2 :])
        return int(np.clip(np.sum(self.singular_values > 3 * floor), 2, self.block_rows - 1))

    def model(self, order: int, *, refine: bool = False) -> StateSpaceModel:
        """The model of `order` states.

        Args:
            order: number of states, less than the number of block rows.
            refine: improve the plant by output-error iterations started from it. Without them there are no
                standard errors: the error is larger than a linearisation of the output error gives.

        Raises:
            SettingError: the order exceeds what the block rows hold.
        """
        if not 1 <= order < self.block_rows:
            raise SettingError(f"state-space order {order} is not between 1 and {self.block_rows - 1}.")
        gamma = self.left[:, :order] * np.sqrt(self.singular_values[:order])
        C = gamma[0]
        A = linalg.lstsq(gamma[:-1], gamma[1:])[0]
        A, warnings = _stable(A)
        B, D, x0, shadow = self._input_matrices(A, C)
        at_minimum = refine and not warnings
        if refine:
            orders = Orders(nb=order + 1, nf=order, nk=0)
            refined = estimate_polynomial("oe", self.recordings, orders, starts=[shadow])
            problem = Residuals(self.recordings, orders)
            if refined.loss < problem.at(shadow.theta).loss:
                shadow, at_minimum, warnings = refined, True, []
                A, C = linalg.companion(refined.plant[1]).T, np.eye(order)[0]  # observer form
                B, D, x0, _ = self._input_matrices(A, C)
        if not at_minimum:
            shadow = shadow.without_intervals()
            warnings = warnings or [UNREFINED]
        K = self._kalman_gain(A, C, B, D)
        model = StateSpaceModel(
            A, B, C, D, K, x0, np.nan, 0, self.recordings[0].sample_time, self.singular_values, shadow, tuple(warnings)
        )
        errors = np.concatenate([model.residuals(series) for series in self.recordings])
        return replace(model, loss=float(errors @ errors / len(errors)), samples=len(errors))

    def _input_matrices(self, A: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, float, np.ndarray, PolynomialModel]:
        """B, D and the initial state by least squares on the simulated output, given A and C."""
        order = len(C)
        rows, out = [], []
        for series in self.recordings:
            columns = [modal_response(A, C, np.eye(order)[:, [k]], series.u[:, None]) for k in range(order)]
            phi = np.column_stack([*columns, series.u])
            free = free_responses(A, C, len(series))
            _, remove = project_states(series.y, free)
            rows.append(remove(phi))
            out.append(remove(series.y))
        theta = linalg.lstsq(np.vstack(rows), np.concatenate(out), cond=1e-12)[0]
        B, D = theta[:order], float(theta[order])
        first = self.recordings[0]
        forced = modal_response(A, C, B[:, None], first.u[:, None]) + D * first.u
        x0, _ = project_states(first.y - forced, free_responses(A, C, len(first)))
        return B, D, x0[:-1], self._transfer(A, B, C, D)

    def _transfer(self, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: float) -> PolynomialModel:
        """The plant as output-error polynomial with the covariance of its linearisation."""
        f = np.poly(A).real
        b = np.poly(A - np.outer(B, C)).real + (D - 1.0) * f
        orders = Orders(nb=len(f), nf=len(f) - 1, nk=0)
        theta = np.concatenate([b, f[1:]])
        problem = Residuals(self.recordings, orders)
        root, loss, samples = np.full((len(theta), len(theta)), np.nan), np.nan, 1
        if problem.admissible(theta):
            at = problem.at(theta, gradient=True)
            root, loss, samples = spread(at, coloured=True), at.loss, at.samples
        return PolynomialModel("oe", orders, theta, root, loss, samples, self.recordings[0].sample_time)

    def _kalman_gain(self, A: np.ndarray, C: np.ndarray, B: np.ndarray, D: float) -> np.ndarray:
        """K from the disturbance left by the plant: its autocovariance gives the stochastic part.

        With R_k = cov v(t+k) v(t) = C A^(k-1) G for k >= 1, least squares gives G, and the Riccati equation of the
        covariance model (A, G, C, R_0) gives K.
        """
        disturbances = []
        for series in self.recordings:
            forced = modal_response(A, C, B[:, None], series.u[:, None]) + D * series.u
            free = free_responses(A, C, len(series))
            _, remove = project_states(series.y - forced, free)
            disturbances.append(remove(series.y - forced))
        total = sum(len(v) for v in disturbances)
        lags = 2 * self.block_rows
        R = np.zeros(lags + 1)
        for v in disturbances:
            R += np.array([v[k:] @ v[: len(v) - k] for k in range(lags + 1)]) / total
        G = linalg.lstsq(free_responses(A, C, lags)[:, :-1], R[1:], cond=1e-8)[0]
        P, gain = np.zeros_like(A), np.zeros(len(C))
        for _ in range(300):
            innovation = R[0] - C @ P @ C
            if innovation <= 0.05 * R[0]:  # not a covariance sequence within sampling error: no noise model
                return np.zeros(len(C))
            new = (G - A @ P @ C) / innovation
            P = A @ P @ A.T + np.outer(new, new) * innovation
            if np.linalg.norm(new - gain) <= 1e-10 * float(np.linalg.norm(new)):
                break
            gain = new
        return gain if np.abs(np.linalg.eigvals(A - np.outer(gain, C))).max() < 1.0 else np.zeros(len(C))


def _stable(A: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """A with eigenvalues outside 0.9999 drawn in to 0.999, and a sentence naming them if there were any."""
    values, vectors = np.linalg.eig(A)
    if np.abs(values).max() < 0.9999:
        return A, []
    inside = values * np.minimum(1.0, 0.999 / np.maximum(np.abs(values), 1e-300))
    moved = ", ".join(f"{p:.4f}" if p.imag else f"{p.real:.4f}" for p in values[np.abs(values) > 0.999] if p.imag >= 0)
    sentence = f"A was scaled to be stable: pole {moved} moved to modulus 0.999, so there are no standard errors"
    return (vectors * inside @ np.linalg.inv(vectors)).real, [sentence]


def decompose(recordings: Series | Sequence[Series], block_rows: int = BLOCK_ROWS) -> Subspace:
    """Singular values of the past's part in the future outputs.

    Raises:
        SettingError: too few samples for the block rows.
    """
    pooled = [recordings] if isinstance(recordings, Series) else list(recordings)
    i = block_rows
    columns = sum(len(series) - 2 * i + 1 for series in pooled)
    if min(len(series) for series in pooled) < 2 * i + 1 or columns < 4 * i:
        raise SettingError(
            f"a subspace estimate with {i} block rows needs recordings of more than {6 * i} samples; lower the order."
        )
    left, s = projected([(series.u[:, None], series.y[:, None]) for series in pooled], i)
    return Subspace(pooled, i, left, s / np.sqrt(columns))


def projected(signals: Sequence[tuple[np.ndarray, np.ndarray]], rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Left singular vectors and singular values of future outputs on the past, future inputs removed (PO-MOESP).

    Args:
        signals: inputs (N, m) and outputs (N, p) of each recording.
        rows: block rows of past and of future.
    """

    def halves(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        blocks = sliding_window_view(x, 2 * rows, axis=0).transpose(0, 2, 1)
        return blocks[:, :rows].reshape(len(blocks), -1), blocks[:, rows:].reshape(len(blocks), -1)

    stacked = []
    for u, y in signals:
        (past_u, future_u), (past_y, future_y) = halves(u), halves(y)
        stacked.append(np.hstack([future_u, past_u, past_y, future_y]))
    begin, end = rows * u.shape[1], rows * (2 * u.shape[1] + y.shape[1])
    left, values, _ = linalg.svd(triangle(stacked)[begin:end, end:].T, full_matrices=False)
    return left, values


def estimate(
    recordings: Series | Sequence[Series], order: int | None = None, *, refine: bool = False
) -> StateSpaceModel:
    """State-space model of `order`, by default the number of singular values above the noise."""
    rows = BLOCK_ROWS if order is None else max(BLOCK_ROWS, order + 1)
    subspace = decompose(recordings, rows)
    return subspace.model(subspace.order() if order is None else order, refine=refine)
