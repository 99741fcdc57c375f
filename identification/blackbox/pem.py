"""Prediction-error estimation of ARMAX, OE and BJ models from one or many recordings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from fasbody.exceptions import SettingError, unknown

from . import arx, starts
from .data import Series
from .filters import largest_root, pole_warnings, pulse_response, shifted
from .least_squares import Linearisation, Minimum, minimise, project_states, spread
from .polynomial import Orders, PolynomialModel, unpack

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
        b_and_f = _race(plant, starts.families("oe", pooled, orders)).theta
        families = starts.with_noise_model(pooled, orders, b_and_f)
    else:
        families = starts.families(structure, pooled, orders)
    if start is not None:
        families.append([start.theta])
    minimum = _race(problem, families)
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
