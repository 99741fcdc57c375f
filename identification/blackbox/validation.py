"""Residual tests: whiteness, and independence of the past inputs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats

from identification.blackbox.data import Series
from identification.blackbox.filters import shifted

LAGS = 25  # largest lag m
CALM = 0.05  # p-values of both tests from which standard errors for white residuals hold
ALARM = 1e-3  # p-value below which a test is reported: several recordings and structures are tested at once


@dataclass(frozen=True, eq=False)
class ResidualTest:
    """Correlations of one-step prediction errors on data not used for estimation.

    Attributes:
        lags: 1..m for the autocorrelation, shape (m,).
        auto: normalised autocorrelation at `lags`, shape (m,).
        cross_lags: -m..m, shape (2 m + 1,).
        cross: normalised cross-correlation of errors with inputs that many samples before, shape (2 m + 1,).
        cross_bound: half-width of its 99 % band, which both autocorrelations widen (Bartlett).
        bound: half-width of the 99 % band of a white sequence.
        white_p: p-value of the Ljung-Box test.
        cross_p: p-value of no correlation with inputs from the nearest lag on, all lags together.
    """

    lags: np.ndarray
    auto: np.ndarray
    cross_lags: np.ndarray
    cross: np.ndarray
    cross_bound: float
    bound: float
    white_p: float
    cross_p: float

    def warnings(self, of: str = "residuals", past: str = "past inputs") -> tuple[str, ...]:
        """Sentences for the user; the second matters more: the plant is incomplete.

        Args:
            of: what was tested.
            past: what it must not depend on.
        """
        sentences = []
        if self.white_p < ALARM:
            sentences.append(f"{of} are not white (Ljung-Box p {self.white_p:.1g}): the noise model is incomplete")
        if self.cross_p < ALARM:
            sentences.append(f"{of} depend on {past} (p {self.cross_p:.1g}): plant incomplete or nonlinear")
        return tuple(sentences)


def failed(tests: Sequence[ResidualTest], white: str = "") -> list[str]:
    """Why residuals allow no intervals; `white` is a structure that needs white ones."""
    calm, reasons = CALM / len(tests), []
    if min(test.cross_p for test in tests) < calm:
        reasons.append("its residuals depend on past inputs")
    if white and min(test.white_p for test in tests) < calm:
        reasons.append(f"those of {white} are valid only for white residuals")
    return reasons


def residual_test(errors: np.ndarray, series: Series, parameters: int = 0, nearest: int = 0) -> ResidualTest:
    """Whiteness and cross-correlation of `errors` (the last samples of `series`).

    Args:
        errors: one-step prediction errors, shape (M,), M at most N.
        series: the recording they belong to.
        parameters: number of noise-model coefficients, whose errors from a part as long as the tested one colour it.
        nearest: lag of the nearest input that errors must not depend on; 1 in a loop, where u(t) depends on e(t).
    """
    e = errors - errors.mean()
    u = series.u[len(series) - len(e) :]
    u = u - u.mean()
    n = len(e)
    lags = min(LAGS, n // 4)
    scale_e, scale_u = np.sqrt(e @ e), np.sqrt(u @ u)
    scale_u = scale_u or 1.0  # an impulse before these samples leaves no input to correlate with
    if scale_e <= 1e-12 * np.linalg.norm(series.y):  # an exact model leaves rounding, which tests mean nothing for
        e, scale_e = np.zeros(n), 1.0
    auto = np.array([e[k:] @ e[: n - k] for k in range(1, lags + 1)]) / scale_e**2
    statistic = n * (n + 2) * np.sum(auto**2 / (n - np.arange(1, lags + 1)))
    statistic *= lags / (lags + min(parameters, lags))  # coefficients err, too
    white_p = float(stats.chi2.sf(statistic, lags))
    cross_lags = np.arange(-lags, lags + 1)
    cross = np.array([e[max(k, 0) : n + min(k, 0)] @ u[max(-k, 0) : n - max(k, 0)] for k in range(-lags, lags + 1)])
    cross /= scale_e * scale_u
    # Bartlett: var = sum of the product of both autocorrelations / n
    u_auto = np.array([u[k:] @ u[: n - k] for k in range(1, lags + 1)]) / scale_u**2
    spread = max(1 + 2 * float(auto @ u_auto), 0.05)
    z = float(stats.norm.ppf(0.995))
    cross_p = _independence(e[nearest:] / scale_e, u[: n - nearest], lags)
    return ResidualTest(
        lags=np.arange(1, lags + 1), auto=auto, cross_lags=cross_lags, cross=cross,
        cross_bound=z * float(np.sqrt(spread / n)), bound=z / np.sqrt(n), white_p=white_p, cross_p=cross_p,
    )  # fmt: skip


def _independence(e: np.ndarray, u: np.ndarray, lags: int) -> float:
    """p-value that errors `e` (unit length) do not depend on inputs 0..lags samples before.

    The correlations of a smooth input at neighbouring lags are nearly one number, so they are tested together, in the
    directions that the input excites, with the covariance that both spectra imply. The statistic is halved because the
    model comes from a part as long as the tested one and errs as much.
    """
    n = len(e)
    reach = min(100, n // 4)
    taper = 1 - np.arange(reach + 1) / (reach + 1)
    past = shifted(u, lags + 1)
    rest = e - past @ linalg.lstsq(past, e, cond=1e-6, check_finite=False)[0]  # or a dependence would hide itself
    rho = np.array([rest[k:] @ rest[: n - k] for k in range(reach + 1)]) * taper
    rho = np.concatenate([rho[:0:-1], rho])
    width = reach + lags
    power = np.array([u[k:] @ u[: n - k] for k in range(width + 1)])
    power = np.concatenate([power[:0:-1], power])
    spread = np.convolve(power, rho, mode="valid")[lags : 2 * lags + 1] / n
    size, directions = np.linalg.eigh(linalg.toeplitz(spread))
    kept = size > max(1e-3 * size[-1], 1e-300)
    if not kept.any():
        return 1.0
    cross = np.array([e[k:] @ u[: n - k] for k in range(lags + 1)])
    statistic = np.sum((directions[:, kept].T @ cross) ** 2 / size[kept])
    return float(stats.chi2.sf(statistic / 2, int(kept.sum())))
