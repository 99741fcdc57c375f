"""State-space models by the subspace method, of one input and output or of several."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import linalg

from fasbody.exceptions import SettingError
from identification.blackbox.data import Series, listed
from identification.blackbox.filters import as_columns
from identification.blackbox.least_squares import project_states, spread, triangle
from identification.blackbox.pem import Residuals, long_errors
from identification.blackbox.pem import estimate as estimate_polynomial
from identification.blackbox.polynomial import Orders, PolynomialModel
from identification.blackbox.state_space import StateSpaceModel, driven, free_responses, unit_responses

UNREFINED = "plain subspace estimate without standard errors, for those of its linearisation would be too small"
BLOCK_ROWS = 16  # about 15 beats 30 on band-limited input; one more than the largest order requested


@dataclass(frozen=True, eq=False)
class Subspace:
    """The factor of the block Hankel data from which models of every order follow.

    Attributes:
        recordings: estimation data, means removed.
        block_rows: of past and of future.
        left: directions of the observability matrix, shape (block_rows p, block_rows p).
        singular_values: of these directions.
    """

    recordings: Sequence[Series]
    block_rows: int
    left: np.ndarray
    singular_values: np.ndarray

    def order(self) -> int:
        """Number of singular values above three times the median of the last half, the noise."""
        floor = np.median(self.singular_values[self.block_rows // 2 :])
        return int(np.clip(np.sum(self.singular_values > 3 * floor), 2, self.block_rows - 1))

    def observed(self, order: int) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """A (n, n), C (p, n) of `order` states, and a sentence where A had to be made stable.

        Raises:
            SettingError: the order exceeds what the block rows hold.
        """
        p = len(self.left) // self.block_rows
        largest = (self.block_rows - 1) * p
        if not 1 <= order <= largest:
            raise SettingError(f"state-space order {order} is not between 1 and {largest}.")
        gamma = self.left[:, :order] * np.sqrt(self.singular_values[:order])
        A, warnings = _stable(linalg.lstsq(gamma[:-p], gamma[p:])[0])
        return A, gamma[:p], warnings

    def driven_by(self, A: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """B (n, m), D (p, m) and K (n, p) of given A and C.

        B and D come from the simulated output, K from what the simulation leaves: there the errors
        of a long ARX model stand for e(t).
        """
        inputs = [as_columns(series.u) for series in self.recordings]
        outputs = [as_columns(series.y) for series in self.recordings]
        B, D = self._gains(A, C, inputs, outputs, direct=True)
        errors = [as_columns(e) for e in long_errors(self.recordings, 2 * self.block_rows)]
        left = [y - driven(A, B, C, u) - u @ D.T - e for u, y, e in zip(inputs, outputs, errors, strict=True)]
        K, _ = self._gains(A, C, errors, left, direct=False)
        stable = np.abs(np.linalg.eigvals(A - K @ C)).max() < 1.0
        return B, D, K if stable else np.zeros_like(K)

    def _gains(
        self, A: np.ndarray, C: np.ndarray, drives: list[np.ndarray], targets: list[np.ndarray],
        direct: bool,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Gains (n, q) by which drives (N, q) enter the states, and (p, q) the outputs at once.

        One least-squares problem over targets (N, p), initial states and levels projected out.
        """
        n, p, q = len(A), len(C), drives[0].shape[1]
        weight = 1.0 / np.std(np.concatenate([as_columns(s.y) for s in self.recordings]), axis=0)
        rows, out = [], []
        for drive, target in zip(drives, targets, strict=True):
            phi = np.concatenate([unit_responses(A, C, u) for u in drive.T], axis=2)
            if direct:
                through = np.einsum("tq,pr->tprq", drive, np.eye(p)).reshape(len(drive), p, p * q)
                phi = np.concatenate([phi, through], axis=2)
            free = free_responses(A, C, len(drive)) * np.tile(weight, len(drive))[:, None]
            y = (target * weight).ravel()
            _, remove = project_states(y, free)
            rows.append(remove((phi * weight[:, None]).reshape(len(y), -1)))
            out.append(remove(y))
        theta = linalg.lstsq(np.vstack(rows), np.concatenate(out), cond=1e-12)[0]
        through = theta[n * q :].reshape(p, q) if direct else np.zeros((p, q))
        return theta[: n * q].reshape(q, n).T, through

    def model(self, order: int, *, refine: bool = False) -> StateSpaceModel:
        """The model of `order` states, of one input and one output.

        Args:
            order: number of states, less than the number of block rows.
            refine: improve the plant by output-error iterations started from it. Without them there are no standard
                errors: the error is larger than a linearisation of the output error gives.
        """
        A, C, warnings = self.observed(order)
        B, D, K = self.driven_by(A, C)
        shadow = self._transfer(A, B, C, D)
        at_minimum = refine and not warnings
        if refine:
            orders = Orders(nb=order + 1, nf=order, nk=0)
            refined = estimate_polynomial("oe", self.recordings, orders, starts=[shadow])
            if refined.loss < Residuals(self.recordings, orders).at(shadow.theta).loss:
                shadow, at_minimum, warnings = refined, True, []
                A, C = linalg.companion(refined.plant[1]).T, np.eye(1, order)  # observer form
                B, D, K = self.driven_by(A, C)
        if not at_minimum:
            shadow = shadow.without_intervals()
            warnings = warnings or [UNREFINED]
        first = self.recordings[0]
        u, y = as_columns(first.u), as_columns(first.y)
        rest = y - driven(A, B, C, u) - u @ D.T
        x0 = project_states(rest.ravel(), free_responses(A, C, len(first)))[0][:order]
        model = StateSpaceModel(
            A, B[:, 0], C[0], float(D[0, 0]), K[:, 0], first.sample_time, x0, np.nan, 0,
            self.singular_values, shadow, tuple(warnings),
        )  # fmt: skip
        errors = np.concatenate([model.residuals(series) for series in self.recordings])
        return replace(model, loss=float(errors @ errors / len(errors)), samples=len(errors))

    def _transfer(self, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> PolynomialModel:
        """The plant as output-error polynomial with the covariance of its linearisation."""
        f = np.poly(A).real
        b = np.poly(A - B @ C).real + (D[0, 0] - 1.0) * f
        orders = Orders(nb=len(f), nf=len(f) - 1, nk=0)
        theta = np.concatenate([b, f[1:]])
        problem = Residuals(self.recordings, orders)
        root, loss, samples = np.full((len(theta), len(theta)), np.nan), np.nan, 1
        if problem.admissible(theta):
            at = problem.at(theta, gradient=True)
            root, loss, samples = spread(at, coloured=True), at.loss, at.samples
        seconds = self.recordings[0].sample_time
        return PolynomialModel("oe", orders, theta, root, loss, samples, seconds)


def _stable(A: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """A with eigenvalues outside 0.9999 drawn in to 0.999, and a sentence that names them."""
    values, vectors = np.linalg.eig(A)
    if np.abs(values).max() < 0.9999:
        return A, []
    inside = values * np.minimum(1.0, 0.999 / np.maximum(np.abs(values), 1e-300))
    moved = ", ".join(
        f"{p:.4f}" if p.imag else f"{p.real:.4f}"
        for p in values[np.abs(values) > 0.999] if p.imag >= 0
    )  # fmt: skip
    return (vectors * inside @ np.linalg.inv(vectors)).real, [
        f"A was scaled to be stable: pole {moved} moved to modulus 0.999, so there are no standard errors"
    ]


def decompose(recordings: Series | Sequence[Series], block_rows: int = BLOCK_ROWS) -> Subspace:
    """Singular values of the past's part in the future outputs, future inputs removed (PO-MOESP).

    Raises:
        SettingError: too few samples for the block rows.
    """
    pooled, rows = listed(recordings), block_rows
    u, y = as_columns(pooled[0].u), as_columns(pooled[0].y)
    m, p = u.shape[1], y.shape[1]
    columns = sum(len(series) - 2 * rows + 1 for series in pooled)
    if min(map(len, pooled)) < 2 * rows + 1 or columns < 2 * rows * (m + p):
        raise SettingError(
            f"a subspace estimate with {rows} block rows needs recordings of more than "
            f"{2 * rows * (m + p + 1)} samples; lower the order."
        )

    def halves(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        blocks = sliding_window_view(x, 2 * rows, axis=0).transpose(0, 2, 1)
        return blocks[:, :rows].reshape(len(blocks), -1), blocks[:, rows:].reshape(len(blocks), -1)

    stacked = []
    for series in pooled:
        (past_u, future_u), (past_y, future_y) = halves(as_columns(series.u)), halves(as_columns(series.y))
        stacked.append(np.hstack([future_u, past_u, past_y, future_y]))
    begin, end = rows * m, rows * (2 * m + p)
    left, values, _ = linalg.svd(triangle(stacked)[begin:end, end:].T, full_matrices=False)
    return Subspace(pooled, rows, left, values / np.sqrt(columns))


def estimate(
    recordings: Series | Sequence[Series], order: int | None = None, *, refine: bool = False
) -> StateSpaceModel:
    """State-space model of `order`, by default the number of singular values above the noise."""
    rows = BLOCK_ROWS if order is None else max(BLOCK_ROWS, order + 1)
    subspace = decompose(recordings, rows)
    return subspace.model(subspace.order() if order is None else order, refine=refine)
