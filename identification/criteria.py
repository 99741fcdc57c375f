"""Numbers that compare models: AIC, FPE, BIC and the fit percentage."""

from collections.abc import Sequence

import numpy as np
from scipy import linalg


def fpe(loss: float, parameters: int, samples: int) -> float:
    """Akaike's final prediction error, Eq. (3.17), in the unit of the loss."""
    return loss * (1 + parameters / samples) / (1 - parameters / samples)


def fpe_of_few_parameters(loss: float, parameters: int, samples: int) -> float:
    """Its form for parameters much fewer than samples, Eq. (3.18)."""
    return loss * (1 + 2 * parameters / samples)


def aic(loss: float | np.ndarray, parameters: int | np.ndarray, samples: int) -> np.ndarray:
    """Akaike's criterion for each sample, losses of any shape.

    Eq. (3.19) with the parentheses closed after V: log V + 2 d / N.

    As printed, log(V + 2 d / N), the choice of order would depend on the unit of the output.
    """
    return np.log(loss) + 2 * np.asarray(parameters) / samples


def bic(loss: float | np.ndarray, parameters: int | np.ndarray, samples: int) -> np.ndarray:
    """Schwarz' criterion for each sample, of losses of any shape: log V + d log N / N."""
    return np.log(loss) + np.asarray(parameters) * np.log(samples) / samples


def fit_percent(measured: np.ndarray, simulated: np.ndarray) -> float:
    """Fit in percent of two signals, (N,) or (N, p), Eq. (3.20) with 2-norms.

    100 is perfect, 0 no better than the mean; -inf for a diverged one.
    """
    error = np.linalg.norm(measured - simulated)
    if not np.isfinite(error):
        return -np.inf
    return float(100 * (1 - error / np.linalg.norm(measured - measured.mean(axis=0))))


def whitened_score(
    errors: Sequence[np.ndarray], parameters: int, poles: int = 0, order: int = 20, samples: int = 0
) -> float:
    """Criterion, times the number of samples, of errors (N_i,) that need not be white: N log V + 4 d.

    Models that are compared need the same N, `samples` where their first rows differ; else the unit of V would choose.

    V is the variance that an autoregression of `order` leaves. So a plant too small is detected behind coloured noise,
    and one too large gains nothing by following it. A coefficient enters when it stands out by two standard errors:
    what is left out by Schwarz' stricter rule would lie outside the intervals of the rest. Each of `poles` costs as
    much again, as it may go wherever noise happens to have a peak.
    """
    left = whitened_variance(errors, order)
    count = samples or sum(len(e) for e in errors)
    return float(count * np.log(left) + 4.0 * (parameters + poles)) if left > 0 else -np.inf


def whitened_variance(errors: Sequence[np.ndarray], order: int = 20) -> float:
    """Variance of errors (N_i,) that an autoregression of `order` leaves; infinite where they are not finite."""
    count = sum(len(e) for e in errors)
    order = min(order, min(len(e) for e in errors) // 10)
    moments = np.sum([[e[: len(e) - k] @ e[k:] for k in range(order + 1)] for e in errors], axis=0) / count
    if not np.isfinite(moments).all():
        return np.inf
    if moments[0] <= 1e-300:
        return 0.0
    moments[0] *= 1 + 1e-9
    left = moments[0] - (linalg.solve_toeplitz(moments[:-1], moments[1:]) @ moments[1:] if order else 0.0)
    return float(max(left, 1e-12 * moments[0]))
