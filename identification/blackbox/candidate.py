"""A model with its criteria, and its fit on data that were not used for its estimation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from identification import criteria
from identification.blackbox.data import Series
from identification.blackbox.filters import as_columns

NEGLIGIBLE = 2e-3  # of the output's amplitude left unexplained justifies no further parameter
FITTED = 2 / 3  # of the data to choose on are fitted, the rest simulated
BLOCKS = 20  # of the held-out data, over which two models' squared errors are compared


@dataclass(frozen=True, eq=False)
class Candidate:
    """One model with its criteria, and its fit on held-out data in free simulation.

    Attributes:
        model: the estimate, of any structure.
        fit_percent: over all held-out parts together.
        block_errors: mean squared simulation error in each block of the held-out data, shape (BLOCKS,).
        one_step_percent: the same fit of one-step predictions.
        score: `criteria.whitened_score` on the data fitted; NaN where not computed.
    """

    model: Any
    fit_percent: float
    block_errors: np.ndarray
    one_step_percent: float
    score: float = np.nan

    def no_worse_than(self, other: "Candidate") -> bool:
        """Whether held-out data do not show `other` to be better by two standard errors and more than negligibly."""
        more = self.block_errors - other.block_errors
        if not np.isfinite(more).all():
            return False
        undecided = float(more.mean()) <= 2.0 * float(more.std(ddof=1)) / np.sqrt(len(more))
        return undecided or self.missed**2 - other.missed**2 <= NEGLIGIBLE**2

    @property
    def missed(self) -> float:
        """Share of the output's amplitude that the simulation misses."""
        return 1.0 - self.fit_percent / 100.0

    @property
    def aic(self) -> float:
        """Akaike's criterion for each sample."""
        return float(criteria.aic(self.model.loss, self.model.parameters, self.model.samples))

    @property
    def bic(self) -> float:
        """Schwarz' criterion."""
        return float(criteria.bic(self.model.loss, self.model.parameters, self.model.samples))

    @property
    def fpe(self) -> float:
        """Akaike's final prediction error."""
        return criteria.fpe(self.model.loss, self.model.parameters, self.model.samples)

    def __str__(self) -> str:
        return f"{self.model.label}: fit {self.fit_percent:.2f} %, AIC {self.aic:.4f}, BIC {self.bic:.4f}"


def judge(model: Any, validation: Sequence[Series]) -> Candidate:
    """The model with its fit over all held-out parts together, in free simulation.

    Several outputs count alike, as shares of their standard deviations.

    The first n_k samples respond to inputs before the part, which are fitted with its initial state: they do not count.
    """
    plant = getattr(model, "linear", model)
    delay = getattr(getattr(plant, "orders", None), "nk", 0)
    fitted = np.concatenate([np.arange(len(series)) < min(delay, len(series) // 2) for series in validation])
    scale = np.std(np.concatenate([series.y for series in validation]), axis=0)
    measured = np.concatenate([series.y - series.y.mean(axis=0) for series in validation]) / scale
    simulated = [model.simulate(series) - series.y.mean(axis=0) for series in validation]
    missed = measured - np.concatenate(simulated) / scale
    squares = as_columns(missed**2).mean(axis=1)
    squares[fitted] = np.mean(squares[~fitted])
    blocks = np.array([np.mean(part) for part in np.array_split(squares, BLOCKS)])
    errors = [model.residuals(series) for series in validation]
    ends = [s.y[len(s) - len(e) :] for s, e in zip(validation, errors, strict=True)]
    seen, errors = np.concatenate(ends) / scale, np.concatenate(errors) / scale
    one_step = criteria.fit_percent(seen, seen - errors) if np.ptp(seen) else -np.inf
    rest = measured[~fitted]
    return Candidate(model, criteria.fit_percent(rest, rest - missed[~fitted]), blocks, one_step)
