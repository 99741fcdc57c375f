"""Starting values for the prediction-error iterations, all by linear least squares.

Prediction-error estimation of ARMAX, OE and BJ models from one or many recordings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from fasbody.exceptions import SettingError, unknown
from identification.blackbox import arx
from identification.blackbox.arx import regressors, solve
from identification.blackbox.data import Series
from identification.blackbox.filters import largest_root, pole_warnings, pulse_response, shifted, stabilise
from identification.blackbox.least_squares import Linearisation, Minimum, minimise, project_states, spread
from identification.blackbox.polynomial import Orders, PolynomialModel, pack, unpack

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


TRIAL = 8  # iterations after which a second starting value must lead
RADIUS = 0.99995  # of the roots of C, D, F: beyond it a free motion outlasts any recording


class Residuals:
    """One-step prediction errors y(t) - y(t | t-1), Eq. (3.12), of A y = B/F u + C/D e and their exact derivatives.

    The general structure Eq. (3.3) covers ARX, ARMAX, OE and BJ alike.

    Filters start from rest at the first sample. Everything before the first row with complete regressors is thus
    wrong, and wrong only by free motions of 1/F and 1/C; these and the sensor's level are fitted as nuisance columns,
    for each recording its own, and projected out (so no recorded past is needed, and recordings pool).

    Args:
        recordings: estimation data, means removed.
        orders: of the model.
    """

    def __init__(self, recordings: Sequence[Series], orders: Orders) -> None:
        self.recordings = recordings
        self.orders = orders

    def admissible(self, theta: np.ndarray) -> bool:
        """Whether C, D, F of theta (d,) have all roots well inside the unit circle: stable predictor and noise."""
        _, _, c, d, f = unpack(theta, self.orders)
        return bool(np.isfinite(theta).all()) and max(map(largest_root, (c, d, f))) < RADIUS

    def at(self, theta: np.ndarray, *, gradient: bool = False) -> Linearisation:
        """Errors at theta (d,) with fitted initial states, and their derivatives when asked."""
        return Linearisation.of((self._one(series, theta, gradient) for series in self.recordings), gradient)

    def _one(self, series: Series, theta: np.ndarray, gradient: bool) -> tuple[np.ndarray, np.ndarray]:
        o = self.orders
        a, b, c, d, f = unpack(theta, o)
        first, length = o.first_row, len(series)
        w = lfilter(b, f, series.u)  # undisturbed output, Eq. (3.7)
        v = lfilter(a, [1.0], series.y) - w
        errors = lfilter(d, c, v)  # Eq. (3.14): y - (L1 y + L2 u), L1 = 1 - A D/C, L2 = B D/(C F)

        noise_states = max(o.nc, o.nd)
        tail = length - first
        free = np.empty((tail, o.nf + noise_states + 1), order="F")
        free[:, : o.nf] = shifted(lfilter(d, c, pulse_response(f, tail)), o.nf)
        free[:, o.nf : -1] = shifted(pulse_response(c, tail), noise_states)
        free[:, -1] = lfilter(d, c, np.ones(tail))
        state, remove = project_states(-errors[first:], free)
        fitted = errors[first:] + free @ state
        if not gradient:
            return fitted, np.empty((0, 0))

        # The signals behind the fitted errors: the pulses enter w through 1/F, the level enters v.
        pulses = np.zeros(length)
        pulses[first : first + o.nf] = -state[: o.nf]
        w = w + lfilter([1.0], f, pulses)
        v = lfilter(a, [1.0], series.y) - w + state[-1]
        errors = np.concatenate([np.zeros(first), fitted])
        columns = np.empty((length, o.parameters), order="F")
        df = lfilter(d, c, lfilter([1.0], f, np.column_stack([series.u, w]), axis=0), axis=0)
        ends = np.cumsum((o.na, o.nb, o.nc, o.nd, o.nf))
        columns[:, : ends[0]] = shifted(lfilter(d, c, series.y), o.na, 1)
        columns[:, ends[0] : ends[1]] = -shifted(df[:, 0], o.nb, o.nk)
        columns[:, ends[1] : ends[2]] = -shifted(lfilter([1.0], c, errors), o.nc, 1)
        columns[:, ends[2] : ends[3]] = shifted(lfilter([1.0], c, v), o.nd, 1)
        columns[:, ends[3] :] = shifted(df[:, 1], o.nf, 1)
        return fitted, remove(columns[first:])


def estimate(
    structure: str, recordings: Series | Sequence[Series], orders: Orders, *, start: PolynomialModel | None = None
) -> PolynomialModel:
    """Prediction-error estimate of an ARX, ARMAX, OE or BJ model.

    Args:
        structure: "arx", "armax" Eq. (3.6), "oe" Eq. (3.7) or "bj" Eq. (3.8).
        recordings: one or many, pooled with an initial state each; means removed.
        orders: numbers of coefficients and delay.
        start: a model of the same structure and orders to start from beside the linear estimates.

    Raises:
        SettingError: unknown structure, or more parameters than samples.
    """
    pooled = [recordings] if isinstance(recordings, Series) else list(recordings)
    if structure == "arx":
        return arx.estimate(pooled, orders)
    if structure not in ("armax", "oe", "bj"):
        raise SettingError(unknown("structure", structure, ("arx", "armax", "oe", "bj")) + ".")
    check_length(pooled, orders)
    problem = Residuals(pooled, orders)
    if structure == "bj":
        plant = Residuals(pooled, Orders(nb=orders.nb, nf=orders.nf, nk=orders.nk))
        b_and_f = _race(plant, families("oe", pooled, orders)).theta
        beginnings = with_noise_model(pooled, orders, b_and_f)
    else:
        beginnings = families(structure, pooled, orders)
    if start is not None:
        beginnings.append([start.theta])
    minimum = _race(problem, beginnings)
    warnings = []
    if not minimum.converged:
        warnings.append("the iterations ended before the loss stopped falling")
    a, _, c, _, f = unpack(minimum.theta, orders)
    warnings += pole_warnings(np.convolve(a, f), min(len(series) for series in pooled))
    if largest_root(c) >= 0.9999:
        warnings.append("a zero of the noise model lies on the unit circle")
    return PolynomialModel(
        structure, orders, minimum.theta, spread(minimum.at, coloured=structure == "oe"), minimum.at.loss,
        minimum.at.samples, pooled[0].sample_time, tuple(warnings),
    )  # fmt: skip


def _race(problem: Residuals, families: list[list[np.ndarray]]) -> Minimum:
    """The whole way from the best admissible member of the first family; from the others, while they lead."""
    best: Minimum | None = None
    for family in families:
        losses = [(problem.at(theta).loss, k) for k, theta in enumerate(family) if problem.admissible(theta)]
        losses = [(loss, k) for loss, k in losses if np.isfinite(loss)]
        if not losses:
            continue
        leader = family[min(losses)[1]]
        if best is not None:
            trial = minimise(problem, leader, iterations=TRIAL)
            if trial.at.loss >= best.at.loss * (1 - 1e-6):
                continue
            leader = trial.theta
        best = minimise(problem, leader)
    if best is None:
        raise SettingError(f"no stable starting model with {problem.orders}; lower the orders.")
    return best


def check_length(recordings: Sequence[Series], orders: Orders) -> None:
    """Refuse recordings that are shorter than their model, or of unlike sample times."""
    times = [series.sample_time for series in recordings]
    if max(times) - min(times) > 1e-6 * max(times):
        raise SettingError(
            f"recordings with sample times from {min(times):g} to {max(times):g} s cannot be pooled; resample them."
        )
    for series in recordings:
        if len(series) - orders.first_row <= 2 * orders.parameters:
            raise SettingError(
                f"{series.name}: {len(series)} samples cannot carry {orders.parameters} parameters with a first row at "
                f"{orders.first_row + 1}; record longer or lower the orders."
            )
