"""Starting values for the prediction-error iterations, all by linear least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from .arx import regressors, solve
from .data import Series
from .filters import shifted, stabilise
from .polynomial import Orders, pack

ONE = np.ones(1)
LONG = 25  # lags of the long ARX model whose residuals stand for e(t)


def families(structure: str, recordings: Sequence[Series], orders: Orders) -> list[list[np.ndarray]]:
    """Coefficient vectors (d,) of ARMAX or OE models to start from, in families that may lead to different minima.

    The caller takes the member with the least loss from each and lets them race.
    """
    o = orders
    if structure == "armax":
        families: list[list[np.ndarray]] = []
        for plants in _plants(recordings, Orders(nb=o.nb, nf=o.na, nk=o.nk)):
            families.append([])
            for b, f in plants:  # white output noise: C = A
                c = np.zeros(o.nc + 1)
                c[: min(o.na, o.nc) + 1] = f[: o.nc + 1]
                families[-1].append(pack(f, b, stabilise(c, 0.99), ONE, ONE))
        return [*families, [_hannan_rissanen(recordings, o)]]
    return [[pack(ONE, b, ONE, ONE, f) for b, f in plants] for plants in _plants(recordings, o)]


def with_noise_model(recordings: Sequence[Series], orders: Orders, plant: np.ndarray) -> list[list[np.ndarray]]:
    """Starting values of a BJ model from an output-error plant (b, f): white noise, and a model of what is left."""
    b, f = plant[: orders.nb], np.concatenate([[1.0], plant[orders.nb :]])
    num = np.concatenate([np.zeros(orders.nk), b])
    skip = min(min(len(series) for series in recordings) // 4, 200)  # the start-up is not noise
    c, d = _noise_model([(s.y - lfilter(num, f, s.u))[skip:] for s in recordings], orders.nc, orders.nd)
    return [[pack(ONE, b, _one(orders.nc), _one(orders.nd), f)], [pack(ONE, b, c, d, f)]]


def _one(order: int) -> np.ndarray:
    return np.concatenate([[1.0], np.zeros(order)])


def _plants(recordings: Sequence[Series], orders: Orders) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """Two families of pairs (B without delay, F) for an output-error plant.

    Steiglitz and McBride's iteration (least squares on data filtered by the last 1/F), in time and, for inputs that
    excite a part of the band only, on the excited lines of the spectrum, where noise elsewhere cannot pull.
    """
    in_time, in_frequency = [], []
    b, f = _arx([(series.u, series.y) for series in recordings], orders)
    for _ in range(8):
        b, f = _arx([(lfilter([1.0], f, s.u), lfilter([1.0], f, s.y)) for s in recordings], orders)
        in_time.append((b, f))
    lines = [_excited_lines(series) for series in recordings]
    shift, U, Y = (np.concatenate(column) for column in zip(*lines, strict=True))
    past = -Y[:, None] * shift[:, None] ** np.arange(1, orders.nf + 1)
    phi = np.hstack([past, U[:, None] * shift[:, None] ** (orders.nk + np.arange(orders.nb))])
    f = _one(orders.nf)
    for _ in range(16):
        weight = 1.0 / np.polynomial.polynomial.polyval(shift, f)
        rows, out = phi * weight[:, None], Y * weight
        theta = solve(np.vstack([rows.real, rows.imag]), np.concatenate([out.real, out.imag]))
        b, f = theta[orders.nf :], stabilise(np.concatenate([[1.0], theta[: orders.nf]]))
        in_frequency.append((b, f))
    return [in_frequency[3::4], in_time[3::4]]


def _excited_lines(series: Series) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q^-1, input and output spectrum (Hann window) where the input has more than 1e-4 of its strongest power."""
    window = np.hanning(len(series))
    U, Y = np.fft.rfft(window * series.u), np.fft.rfft(window * series.y)
    strong = np.abs(U) > 1e-2 * np.abs(U).max()
    angle = 2 * np.pi * np.arange(len(U)) / len(series)
    return np.exp(-1j * angle[strong]), U[strong], Y[strong]


def _arx(signals: Sequence[tuple[np.ndarray, np.ndarray]], orders: Orders) -> tuple[np.ndarray, np.ndarray]:
    """B and stable F from least squares on (u, y) pairs."""
    phi, out = [], []
    for u, y in signals:
        first = max(orders.nf, orders.nk + orders.nb - 1)
        phi.append(np.column_stack([-shifted(y, orders.nf, 1), shifted(u, orders.nb, orders.nk)])[first:])
        out.append(y[first:])
    theta = solve(np.vstack(phi), np.concatenate(out))
    return theta[orders.nf :], stabilise(np.concatenate([[1.0], theta[: orders.nf]]))


def _hannan_rissanen(recordings: Sequence[Series], orders: Orders) -> np.ndarray:
    """ARMAX: the residuals of a long ARX model serve as measured e(t) in one least-squares problem."""
    lags = min(LONG, min(len(series) for series in recordings) // 8)
    long = Orders(na=lags, nb=lags, nk=orders.nk)
    pairs = [regressors(series, long) for series in recordings]
    theta = solve(np.vstack([phi for phi, _ in pairs]), np.concatenate([y for _, y in pairs]))
    phi_all, y_all = [], []
    for series, (phi, y) in zip(recordings, pairs, strict=True):
        e = np.concatenate([np.zeros(long.first_row), y - phi @ theta])
        row = min(long.first_row + orders.nc, len(series) // 2)
        plain, out = regressors(series, orders, row)
        phi_all.append(np.column_stack([plain, shifted(e, orders.nc, 1)[row:]]))
        y_all.append(out)
    theta = solve(np.vstack(phi_all), np.concatenate(y_all))
    c = np.concatenate([[1.0], theta[orders.na + orders.nb :]])
    theta[orders.na + orders.nb :] = stabilise(c, 0.99)[1:]
    return theta


def _noise_model(noises: list[np.ndarray], nc: int, nd: int) -> tuple[np.ndarray, np.ndarray]:
    """C and D of D v = C e by the same device on the noise alone."""
    lags = max(min(LONG, min(len(v) for v in noises) // 8), 1)
    phi = np.vstack([shifted(v, lags, 1)[lags:] for v in noises])
    long = solve(phi, np.concatenate([v[lags:] for v in noises]))
    rows, out = [], []
    for v in noises:
        e = v - shifted(v, lags, 1) @ long
        first = lags + max(nc, nd)
        rows.append(np.column_stack([-shifted(v, nd, 1), shifted(e, nc, 1)])[first:])
        out.append(v[first:])
    theta = solve(np.vstack(rows), np.concatenate(out))
    return stabilise(np.concatenate([[1.0], theta[nd:]]), 0.99), stabilise(np.concatenate([[1.0], theta[:nd]]), 0.999)
