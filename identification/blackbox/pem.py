"""Prediction-error estimates of ARX, ARMAX, OE and BJ models from one or many recordings.

ARX is one least-squares problem, and so is the grid of all its orders. The others iterate from
starting values that are linear least squares, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from fasbody.exceptions import SettingError, unknown
from identification.blackbox.data import Series, listed
from identification.blackbox.filters import (
    as_columns,
    largest_root,
    lfilter,
    pole_warnings,
    pulse_response,
    shifted,
    stabilise,
)
from identification.blackbox.least_squares import Linearisation, minimise, spread, triangle
from identification.blackbox.polynomial import STRUCTURES, Orders, PolynomialModel, Residuals, pack, unpack

ONE = np.ones(1)
LONG = 25  # lags of the long ARX model whose residuals stand for e(t)
TRIAL = 8  # evaluations after which a second starting value must lead
Start = tuple[np.ndarray, Linearisation, bool]


def estimate(
    structure: str, recordings: Series | Sequence[Series], orders: Orders, *,
    starts: Sequence[PolynomialModel] = (), first_row: int = 0, quick: bool = False,
) -> PolynomialModel:  # fmt: skip
    """Prediction-error estimate of an ARX, ARMAX, OE or BJ model.

    Args:
        structure: "arx" Eq. (3.5), "armax" Eq. (3.6), "oe" Eq. (3.7) or "bj" Eq. (3.8).
        recordings: one or many, pooled with an initial state each; means removed.
        orders: numbers of coefficients and delay.
        starts: models that these orders nest, to start from beside the linear estimates; the loss ends below theirs.
        first_row: first sample whose residual counts, where models are compared on the same ones.
        quick: end within a tenth of a standard error of the minimum and try fewer starts, as a search for orders may.

    Raises:
        SettingError: unknown structure, or more parameters than samples.
    """
    pooled = listed(recordings)
    if structure not in STRUCTURES:
        raise SettingError(unknown("structure", structure, STRUCTURES) + ".")
    _check_length(pooled, orders)
    if structure == "arx":
        return _least_squares(pooled, orders, first_row)
    nested = [[embedded(model, orders)] for model in starts]
    if structure != "bj":
        families = _families(structure, pooled, orders)
    elif not nested:
        o = Orders(nb=orders.nb, nf=orders.nf, nk=orders.nk)
        plant, _, _ = _race(Residuals(pooled, o), _families("oe", pooled, o), quick=quick)
        families = _with_noise_model(pooled, orders, plant)
    else:
        families = []
    if quick and nested:
        families = [[theta for family in families for theta in family[-1:]]]
    problem = Residuals(pooled, orders, first_row)
    theta, at, converged = _race(problem, families, nested, quick=quick)
    warnings = [] if converged else ["the iterations ended before the loss had converged"]
    a, _, c, _, f = unpack(theta, orders)
    warnings += pole_warnings(np.convolve(a, f), min(map(len, pooled)))
    if largest_root(c) >= 0.9999:
        warnings.append("a zero of the noise model lies on the unit circle")
    root = spread(at, coloured=structure == "oe")
    return PolynomialModel(structure, orders, theta, root, at.loss, at.samples, pooled[0].sample_time, tuple(warnings))


def embedded(model: PolynomialModel, orders: Orders) -> np.ndarray:
    """Coefficients (d,) of the larger `orders` that make the same model: zeros where it has none.

    Raises:
        SettingError: the orders do not nest those of the model.
    """
    o = model.orders
    if not o.within(orders):
        raise SettingError(f"orders {orders} do not nest {o}.")
    a, b, c, d, f = model.polynomials
    lengths = orders.na + 1, orders.nk + orders.nb, orders.nc + 1, orders.nd + 1, orders.nf + 1
    padded = [np.pad(p, (0, n - len(p))) for p, n in zip((a, b, c, d, f), lengths, strict=True)]
    return pack(padded[0], padded[1][orders.nk :], *padded[2:])


def _race(
    problem: Residuals, families: list[list[np.ndarray]], nested: Sequence[list[np.ndarray]] = (),
    quick: bool = False,
) -> Start:  # fmt: skip
    """The end from the best admissible start of the first family, of others while they lead."""
    best: Start | None = None
    for family in [*families, *nested]:
        losses = [problem.at(t).loss if problem.admissible(t) else np.inf for t in family]
        if not np.isfinite(losses).any():
            continue
        leader = family[int(np.nanargmin(losses))]
        if best is not None:
            leader, at, _ = minimise(problem, leader, evaluations=TRIAL)
            if at.loss >= best[1].loss * (1 - 1e-6):
                continue
        evaluations, tolerance = (30, 1e-2) if quick else (60, 1e-4)
        best = minimise(problem, leader, evaluations=evaluations, tolerance=tolerance)
    if best is None:
        raise SettingError(f"no stable starting model with {problem.orders}; lower the orders.")
    return best


def _check_length(recordings: Sequence[Series], orders: Orders) -> None:
    """Refuse recordings that are shorter than their model, or of unlike sample times."""
    times = [series.sample_time for series in recordings]
    if max(times) - min(times) > 1e-6 * max(times):
        raise SettingError(
            f"recordings with sample times from {min(times):g} to {max(times):g} s cannot be pooled; resample them."
        )
    for series in recordings:
        if len(series) - orders.first_row <= 2 * orders.parameters:
            raise SettingError(
                f"{series.name}: {len(series)} samples cannot carry {orders.parameters} parameters "
                f"with a first row at {orders.first_row + 1}; record longer or lower the orders."
            )


def _least_squares(pooled: Sequence[Series], orders: Orders, first_row: int) -> PolynomialModel:
    """Least-squares ARX model, Eq. (3.5), of one recording or of many pooled."""
    if orders.nc or orders.nd or orders.nf:
        raise SettingError("an ARX model has only n_a, n_b and n_k.")
    pairs = [regressors(series, orders, max(first_row, orders.first_row)) for series in pooled]
    theta = solve(pairs)
    at = Linearisation([phi @ theta - y for phi, y in pairs], [phi for phi, _ in pairs])
    a = np.concatenate([[1.0], theta[: orders.na]])
    warnings = pole_warnings(a, min(map(len, pooled)))
    seconds = pooled[0].sample_time
    return PolynomialModel("arx", orders, theta, spread(at), at.loss, at.samples, seconds, tuple(warnings))


def regressors(series: Series, orders: Orders, first_row: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Regressor matrix [-y lags, u lags] and the output beside it, Eq. (3.5), from a row on.

    Args:
        series: of one input and output, or of several, one after another.
        orders: n_a, n_b, n_k.
        first_row: the first sample; by default the first whose regressors are all measured.
    """
    row = orders.first_row if first_row is None else first_row
    past = [-shifted(y, orders.na, 1)[row:] for y in as_columns(series.y).T]
    past += [shifted(u, orders.nb, orders.nk)[row:] for u in as_columns(series.u).T]
    return np.column_stack(past), series.y[row:]


def solve(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Least squares, (d,) or (d, p), of all (phi, y) together, by QR with pivoting.

    It is the shortest solution where columns depend on others.
    """
    phi, y = (np.concatenate(column) for column in zip(*parts, strict=True))
    scale = np.linalg.norm(phi, axis=0)
    scale[scale == 0] = 1.0
    theta, *_ = linalg.lstsq(phi / scale, y, cond=1e-13, lapack_driver="gelsy", check_finite=False)
    return (theta.T / scale).T


def long_errors(recordings: Sequence[Series], most: int = LONG) -> list[np.ndarray]:
    """Errors (N,) or (N, p) of an ARX model with many lags, which stand for e(t); 0 in its start."""
    first = recordings[0]
    signals = as_columns(first.u).shape[1] + as_columns(first.y).shape[1]
    lags = max(min(most, min(map(len, recordings)) // (4 * signals)), 1)
    pairs = []
    for series in recordings:
        phi, y = regressors(series, Orders(na=lags, nb=lags + 1, nk=0))
        pairs.append((np.column_stack([phi, np.ones(len(phi))]), y))
    theta = solve(pairs)
    return [np.concatenate([np.zeros_like(y[:lags]), y - phi @ theta]) for phi, y in pairs]


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


def grid(recordings: Series | Sequence[Series], na_max: int = 15, nb_max: int = 15, nk_max: int = 15) -> Grid:
    """Losses of the whole grid of ARX models.

    One QR of all lags serves every model: its triangle R holds the data. For given n_a and n_k a small QR of the
    columns of R leaves the output's coordinates along each further input lag, and their reversed cumulative squares
    are the losses for every n_b at once.

    Raises:
        SettingError: fewer rows than columns.
    """
    pooled = listed(recordings)
    u_lags = nb_max + nk_max - 1
    first_row = max(na_max, u_lags)
    width = na_max + u_lags + 1
    samples = sum(len(series) - first_row for series in pooled)
    if min(len(series) for series in pooled) <= first_row or samples <= width:
        raise SettingError(f"{samples + first_row} samples are too few for an ARX grid with lags up to {first_row}.")
    r = triangle(np.column_stack([shifted(s.y, na_max, 1), shifted(s.u, u_lags, 1), s.y])[first_row:] for s in pooled)

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


def _families(structure: str, recordings: Sequence[Series], orders: Orders) -> list[list[np.ndarray]]:
    """Coefficients (d,) of ARMAX or OE models to start from, in families with different minima."""
    o = orders
    if structure == "oe":
        plants = _plants(recordings, o)
        return [[pack(ONE, b, ONE, ONE, f) for b, f in family] for family in plants]
    families = []
    for family in _plants(recordings, Orders(nb=o.nb, nf=o.na, nk=o.nk)):
        noise = [np.pad(f, (0, max(o.nc - o.na, 0)))[: o.nc + 1] for _, f in family]  # white: C = A
        pairs = zip(family, noise, strict=True)
        families.append([pack(f, b, stabilise(c, 0.99), ONE, ONE) for (b, f), c in pairs])
    return [*families, [_hannan_rissanen(recordings, o)]]


def _with_noise_model(recordings: Sequence[Series], orders: Orders, plant: np.ndarray) -> list[list[np.ndarray]]:
    """Starts of a BJ model from an output-error plant: white noise, and a model of what is left."""
    _, num, _, _, f = unpack(plant, Orders(nb=orders.nb, nf=orders.nf, nk=orders.nk))
    skip = min(min(map(len, recordings)) // 4, 200)  # the start-up is not noise
    noises = [(s.y - lfilter(num, f, s.u))[skip:] for s in recordings]
    white = np.eye(1, orders.nc + 1)[0], np.eye(1, orders.nd + 1)[0]
    b = num[orders.nk :]
    return [[pack(ONE, b, c, d, f)] for c, d in (white, _noise_model(noises, orders.nc, orders.nd))]


def _plants(recordings: Sequence[Series], orders: Orders) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """Two families of pairs (B without delay, F) for an output-error plant.

    Steiglitz and McBride's iteration (least squares on data filtered by the last 1/F), in time and, for inputs that
    excite a part of the band only, on the excited lines of the spectrum, where noise elsewhere cannot pull.
    """
    lines = [_excited_lines(series) for series in recordings]
    shift, U, Y = (np.concatenate(column) for column in zip(*lines, strict=True))
    past = -Y[:, None] * shift[:, None] ** np.arange(1, orders.nf + 1)
    phi = np.hstack([past, U[:, None] * shift[:, None] ** (orders.nk + np.arange(orders.nb))])
    f, in_frequency = ONE, []
    for _ in range(16):
        weight = 1.0 / np.polynomial.polynomial.polyval(shift, f)
        rows, out = phi * weight[:, None], Y * weight
        b, f = _plant(solve([(rows.real, out.real), (rows.imag, out.imag)]), orders.nf)
        in_frequency.append((b, f))
    num, den = _long_plant(recordings, orders)
    noiseless = [replace(s, y=lfilter(num, den, s.u), part=True) for s in recordings]
    in_time = [*_iterated(recordings, orders), *_iterated(noiseless, orders)]
    return [in_frequency[3::4], [*in_time, _realised(num, den, orders)]]


def _plant(theta: np.ndarray, nf: int) -> tuple[np.ndarray, np.ndarray]:
    """B without delay and stable F from the coefficients (d,) of F and B."""
    return theta[nf:], stabilise(np.concatenate([[1.0], theta[:nf]]))


def _iterated(recordings: Sequence[Series], orders: Orders) -> list[tuple[np.ndarray, np.ndarray]]:
    """B and F after four and after eight of Steiglitz and McBride's steps."""
    arx, f, steps = Orders(na=orders.nf, nb=orders.nb, nk=orders.nk), ONE, []
    for _ in range(9):
        filtered = [replace(s, u=lfilter(ONE, f, s.u), y=lfilter(ONE, f, s.y), part=True) for s in recordings]
        b, f = _plant(solve([regressors(series, arx) for series in filtered]), orders.nf)
        steps.append((b, f))
    return steps[4::4]


def _long_plant(recordings: Sequence[Series], orders: Orders) -> tuple[np.ndarray, np.ndarray]:
    """B and stable A of a long ARX model, whose plant coloured noise does not bias."""
    lags = min(LONG, min(map(len, recordings)) // 8)
    long = Orders(na=lags, nb=lags, nk=orders.nk)
    a, b, _, _, _ = unpack(solve([regressors(series, long) for series in recordings]), long)
    return b, stabilise(a, 0.9999)


def _realised(num: np.ndarray, den: np.ndarray, orders: Orders) -> tuple[np.ndarray, np.ndarray]:
    """B and stable F of the largest modes in the Hankel matrix of a plant's pulse response."""
    size = max(2 * LONG, 2 * orders.nf + 2)
    pulse = lfilter(num, den, np.eye(1, 2 * size + orders.nk + 1)[0])[orders.nk :]
    if not orders.nf:
        return pulse[: orders.nb], ONE
    hankel = linalg.hankel(pulse[1 : size + 1], pulse[size : 2 * size])
    left, s, _ = linalg.svd(hankel, check_finite=False)
    gamma = left[:, : orders.nf] * np.sqrt(s[: orders.nf])
    f = stabilise(np.poly(linalg.lstsq(gamma[:-1], gamma[1:])[0]).real)
    columns = shifted(pulse_response(f, len(pulse)), orders.nb)
    return linalg.lstsq(columns, pulse)[0], f


def _excited_lines(series: Series) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q^-1 and the spectra (Hann window) where the input has over 1e-4 of its strongest power."""
    window = np.hanning(len(series))
    U, Y = np.fft.rfft(window * series.u), np.fft.rfft(window * series.y)
    strong = np.abs(U) > 1e-2 * np.abs(U).max()
    angle = 2 * np.pi * np.arange(len(U)) / len(series)
    return np.exp(-1j * angle[strong]), U[strong], Y[strong]


def _hannan_rissanen(recordings: Sequence[Series], orders: Orders) -> np.ndarray:
    """ARMAX: the errors of a long ARX model serve as measured e(t) in one linear problem."""
    parts = []
    for series, e in zip(recordings, long_errors(recordings), strict=True):
        row = min(LONG + max(orders.nc, orders.first_row), len(series) // 2)
        phi, out = regressors(series, orders, row)
        parts.append((np.column_stack([phi, shifted(e, orders.nc, 1)[row:]]), out))
    theta = solve(parts)
    c = np.concatenate([[1.0], theta[orders.na + orders.nb :]])
    theta[orders.na + orders.nb :] = stabilise(c, 0.99)[1:]
    return theta


def _noise_model(noises: list[np.ndarray], nc: int, nd: int) -> tuple[np.ndarray, np.ndarray]:
    """C and D of D v = C e by the same device on the noise alone."""
    if not nc + nd:
        return ONE, ONE
    lags = max(min(LONG, min(map(len, noises)) // 8), 1)
    long = solve([(shifted(v, lags, 1)[lags:], v[lags:]) for v in noises])
    first, parts = lags + max(nc, nd), []
    for v in noises:
        e = v - shifted(v, lags, 1) @ long
        past = np.column_stack([-shifted(v, nd, 1), shifted(e, nc, 1)])
        parts.append((past[first:], v[first:]))
    theta = solve(parts)
    d, c = (np.concatenate([[1.0], part]) for part in np.split(theta, [nd]))
    return stabilise(c, 0.99), stabilise(d, 0.999)


def noise_orders(noises: list[np.ndarray], largest: int) -> tuple[int, int]:
    """n_c and n_d, 0 to `largest`, that BIC prefers for D v = C e on noises (N_i,)."""
    samples = sum(map(len, noises))
    scores = {}
    for nc, nd in np.ndindex(largest + 1, largest + 1):
        c, d = _noise_model(noises, nc, nd)
        loss = sum(float(np.sum(lfilter(d, c, v) ** 2)) for v in noises) / samples
        scores[nc, nd] = samples * np.log(max(loss, 1e-300)) + (nc + nd) * np.log(samples)
    return min(scores, key=lambda key: scores[key])


def whitened(recordings: Sequence[Series], noises: Sequence[np.ndarray], order: int) -> list[Series]:
    """Recordings filtered so that noises (N_i,) like those given come out white."""
    _, d = _noise_model(list(noises), 0, order)
    return [replace(s, u=lfilter(d, ONE, s.u), y=lfilter(d, ONE, s.y), part=True) for s in recordings]
