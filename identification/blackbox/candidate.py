"""What every model offers, and how one does on held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from identification.blackbox import criteria
from identification.blackbox.data import Series
from identification.blackbox.response import Response

NEGLIGIBLE = 2e-3  # of the output's amplitude left unexplained justifies no further parameter
BLOCKS = 20  # of the held-out data, over which two models' squared errors are compared


class Model(Protocol):
    """What every estimated model offers."""

    @property
    def structure(self) -> str:
        """Arx, armax, oe, bj, ss, hw or narx."""
        ...

    @property
    def label(self) -> str:
        """Structure and orders."""
        ...

    @property
    def parameters(self) -> int:
        """Number of estimated coefficients."""
        ...

    @property
    def loss(self) -> float:
        """Mean squared residual on the estimation data."""
        ...

    @property
    def samples(self) -> int:
        """Number of residuals behind it."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences for the user."""
        ...

    def poles(self) -> np.ndarray:
        """Poles of the plant in the z plane, shape (n,)."""
        ...

    def zeros(self) -> np.ndarray:
        """Its zeros, shape (n,)."""
        ...

    def response(self, frequency_hz: ArrayLike) -> Response:
        """Frequency response at (M,) frequencies [Hz]."""
        ...

    def simulate(self, series: Series) -> np.ndarray:
        """Output (N,) in free simulation."""
        ...

    def residuals(self, series: Series) -> np.ndarray:
        """One-step prediction errors, shape (N - first,)."""
        ...


@dataclass(frozen=True, eq=False)
class Candidate:
    """One model with its criteria, and its fit on held-out data in free simulation.

    Attributes:
        model: the estimate.
        fit_percent: over all held-out parts together.
        block_errors: mean squared simulation error in each block of the held-out data, shape (BLOCKS,).
    """

    model: Model
    fit_percent: float
    block_errors: np.ndarray

    def no_worse_than(self, other: Candidate) -> bool:
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


def judge(model: Model, validation: Sequence[Series]) -> Candidate:
    """The model with its fit over all held-out parts together, in free simulation."""
    measured = np.concatenate([series.y - series.y.mean() for series in validation])
    simulated = np.concatenate([model.simulate(series) - series.y.mean() for series in validation])
    blocks = np.array([np.mean(part**2) for part in np.array_split(measured - simulated, BLOCKS)])
    return Candidate(model, criteria.fit_percent(measured, simulated), blocks)
