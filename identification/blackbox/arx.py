"""ARX: least squares by QR, and the grid of all orders and delays through one shared factorisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from fasbody.exceptions import SettingError
from identification.blackbox.data import Series
from identification.blackbox.filters import pole_warnings, shifted
from identification.blackbox.least_squares import Linearisation, spread
from identification.blackbox.polynomial import Orders, PolynomialModel


def regressors(series: Series, orders: Orders, first_row: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Regressor matrix [-y lags, u lags] and the output beside it, Eq. (3.5), from `first_row` on."""
    row = orders.first_row if first_row is None else first_row
    past_output = shifted(series.y, orders.na, 1)[row:]
    past_input = shifted(series.u, orders.nb, orders.nk)[row:]
    return np.column_stack([-past_output, past_input]), series.y[row:]


def estimate(recordings: Series | Sequence[Series], orders: Orders) -> PolynomialModel:
    """Least-squares ARX model, Eq. (3.5), of one recording or of many pooled.

    Raises:
        SettingError: orders with C, D or F, or more parameters than samples.
    """
    from identification.blackbox.pem import check_length

    if orders.nc or orders.nd or orders.nf:
        raise SettingError("an ARX model has only n_a, n_b and n_k.")
    pooled = [recordings] if isinstance(recordings, Series) else list(recordings)
    check_length(pooled, orders)
    pairs = [regressors(series, orders) for series in pooled]
    theta = solve(np.vstack([phi for phi, _ in pairs]), np.concatenate([y for _, y in pairs]))
    at = Linearisation([phi @ theta - y for phi, y in pairs], [phi for phi, _ in pairs])
    a = np.concatenate([[1.0], theta[: orders.na]])
    warnings = pole_warnings(a, min(len(series) for series in pooled))
    return PolynomialModel(
        "arx", orders, theta, spread(at), at.loss, at.samples, pooled[0].sample_time, tuple(warnings)
    )


def solve(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least squares (d,) by QR with column pivoting; the shortest solution where columns depend on each other."""
    scale = np.linalg.norm(phi, axis=0)
    scale[scale == 0] = 1.0
    theta, *_ = linalg.lstsq(phi / scale, y, cond=1e-13, lapack_driver="gelsy", check_finite=False)
    return theta / scale


@dataclass(frozen=True, eq=False)
class Grid:
    """Losses of all ARX models with n_a, n_b, n_k from 1 to their largest, on the same rows.

    Attributes:
        loss: mean squared errors, shape (na_max, nb_max, nk_max); index = order - 1.
        samples: number of rows.
    """

    loss: np.ndarray
    samples: int

    @property
    def parameters(self) -> np.ndarray:
        """Number of coefficients of each model, shape of `loss`."""
        return np.indices(self.loss.shape)[:2].sum(axis=0) + 2

    def __str__(self) -> str:
        na, nb, nk = np.unravel_index(int(self.loss.argmin()), self.loss.shape)
        return f"{self.loss.size} ARX models, least loss {self.loss.min():.5g} at ({na + 1}, {nb + 1}, {nk + 1})"


def grid(recordings: Series | Sequence[Series], na_max: int = 15, nb_max: int = 15, nk_max: int = 15) -> Grid:
    """Losses of the whole grid of ARX models.

    One QR of all lags serves every model: its triangle R holds the data. For given n_a and n_k a small QR of the
    columns of R leaves the output's coordinates along each further input lag, and their reversed cumulative squares
    are the losses for every n_b at once.

    Raises:
        SettingError: fewer rows than columns.
    """
    pooled = [recordings] if isinstance(recordings, Series) else list(recordings)
    u_lags = nb_max + nk_max - 1
    first_row = max(na_max, u_lags)
    width = na_max + u_lags + 1
    samples = sum(len(series) - first_row for series in pooled)
    if min(len(series) for series in pooled) <= first_row or samples <= width:
        raise SettingError(f"{samples + first_row} samples are too few for an ARX grid with lags up to {first_row}.")
    blocks = []
    for series in pooled:
        y_past, u_past = shifted(series.y, na_max, 1), shifted(series.u, u_lags, 1)
        stacked = np.column_stack([y_past, u_past, series.y])[first_row:]
        blocks.append(linalg.qr(stacked, mode="r", overwrite_a=True, check_finite=False)[0][:width])
    r = blocks[0] if len(blocks) == 1 else linalg.qr(np.vstack(blocks), mode="r", check_finite=False)[0][:width]

    (geqrf,) = linalg.get_lapack_funcs(("geqrf",), (r,))
    loss = np.empty((na_max, nb_max, nk_max))
    for nk in range(1, nk_max + 1):
        input_lags = r[:, na_max + nk - 1 : na_max + nk - 1 + nb_max]
        for na in range(1, na_max + 1):
            small = np.asfortranarray(np.hstack([r[:, :na], input_lags, r[:, -1:]]))
            factor, *_ = geqrf(small, lwork=small.shape[1] * 32, overwrite_a=True)
            squares = factor[na : na + nb_max + 1, -1] ** 2  # the last: what no lag explains
            loss[na - 1, :, nk - 1] = np.cumsum(squares[::-1])[::-1][1:] / samples
    return Grid(loss, samples)
