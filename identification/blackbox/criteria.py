"""Numbers that compare models: AIC, FPE, BIC and the fit percentage."""

import numpy as np


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
    """Fit in percent of two signals (N,), Eq. (3.20) with 2-norms.

    100 is perfect, 0 no better than the mean; -inf for a diverged one.
    """
    error = np.linalg.norm(measured - simulated)
    if not np.isfinite(error):
        return -np.inf
    return float(100 * (1 - error / np.linalg.norm(measured - measured.mean())))
